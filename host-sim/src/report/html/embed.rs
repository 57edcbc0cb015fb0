//! The recording as the page reads it: plain arrays, rounded to what can be seen.

use serde::Serialize;

use super::track::PackedTrack;
use crate::recording::{EventRecord, PhaseRecord, PlacementRecord, Recording, SubAreaRecord, UserRecord};

/// All data of the page.
#[derive(Serialize)]
pub(super) struct Embedded<'a> {
    scenario: &'a str,
    /// A string, since a script's numbers end at 2^53.
    seed: String,
    radius_m: f64,
    swath_m: f64,
    origin_lon_lat_deg: Option<[f64; 2]>,
    /// When the page's timeline ends: at the last thing recorded.
    end_s: f64,
    /// When the sweep starts and ends, as far as the phases' names tell.
    sweep_s: [f64; 2],
    area_m: Vec<Vec<[f64; 2]>>,
    no_fly_m: Vec<Vec<[f64; 2]>>,
    fence_m: Vec<[f64; 2]>,
    sub_areas: Vec<SubAreaRecord>,
    uncovered_m: Vec<Vec<[f64; 2]>>,
    drones: Vec<EmbeddedDrone>,
    users: Vec<UserRow<'a>>,
    placements: &'a [PlacementRecord],
    phases: &'a [PhaseRecord],
    events: &'a [EventRecord],
    summary: &'a serde_json::Value,
}

/// One drone with its track.
#[derive(Serialize)]
struct EmbeddedDrone {
    id: u16,
    fleet: Option<u16>,
    track: PackedTrack,
}

/// One user as a row: id, true east and north, estimated east and north, covariance (east-east,
/// east-north, north-north), r95, status, occasions, heard, served guaranteed, served actual.
/// `data.js` names these columns in the same order.
#[derive(Serialize)]
struct UserRow<'a>(
    &'a str,
    [f64; 2],
    Option<[f64; 2]>,
    Option<[f64; 3]>,
    Option<f64>,
    &'a str,
    u32,
    Option<f64>,
    Option<u16>,
    Option<u16>,
);

impl<'a> Embedded<'a> {
    pub(super) fn new(recording: &'a Recording, summary: &'a serde_json::Value) -> Self {
        let sub_area = |it: &SubAreaRecord| SubAreaRecord {
            fleet: it.fleet,
            polygon_m: it.polygon_m.as_deref().map(to_centimetres),
            path_m: to_centimetres(&it.path_m),
        };
        let end_s = end_s(recording);
        Self {
            scenario: &recording.scenario,
            seed: recording.seed.to_string(),
            radius_m: recording.radius_m,
            swath_m: recording.swath_m,
            origin_lon_lat_deg: recording.origin_lon_lat_deg,
            end_s,
            sweep_s: sweep_s(recording, end_s),
            area_m: rings_to_centimetres(&recording.area_m),
            no_fly_m: rings_to_centimetres(&recording.no_fly_m),
            fence_m: to_centimetres(&recording.fence_m),
            sub_areas: recording.sub_areas.iter().map(sub_area).collect(),
            uncovered_m: rings_to_centimetres(&recording.uncovered_m),
            drones: recording
                .drones
                .iter()
                .map(|drone| EmbeddedDrone {
                    id: drone.id,
                    fleet: drone.fleet,
                    track: PackedTrack::new(&drone.track),
                })
                .collect(),
            users: recording.users.iter().map(UserRow::new).collect(),
            placements: &recording.placements,
            phases: &recording.phases,
            events: &recording.events,
            summary,
        }
    }

    /// The data as JSON; what is not finite becomes null.
    pub(super) fn to_json(&self) -> String {
        serde_json::to_string(self).expect("plain data with names for keys is always JSON")
    }
}

impl<'a> UserRow<'a> {
    fn new(user: &'a UserRecord) -> Self {
        let covariance = |[[ee, en], [_, nn]]: [[f64; 2]; 2]| [ee, en, nn].map(to_four_digits);
        Self(
            &user.id,
            to_centimetre(user.truth_m),
            user.estimate_m.map(to_centimetre),
            user.cov_m2.map(covariance),
            user.r95_m.map(to_four_digits),
            user.status,
            user.occasions,
            user.heard_s.map(|t_s| (t_s * 10.0).round() / 10.0),
            user.served_guaranteed_by,
            user.served_actual_by,
        )
    }
}

/// The last instant of anything recorded, at least a second so that the timeline has a length.
fn end_s(recording: &Recording) -> f64 {
    let tracks = recording.drones.iter().filter_map(|d| Some(d.track.last()?.t_s));
    let phases = recording.phases.iter().map(|p| p.t_s);
    let events = recording.events.iter().map(|e| e.t_s);
    let times = tracks.chain(phases).chain(events);
    times.filter(|t_s| t_s.is_finite()).fold(1.0, f64::max)
}

/// Start and end of the sweep: from the first phase with "sweep" in its name to the next phase
/// without; without such a phase, from the start to the last user heard.
fn sweep_s(recording: &Recording, end_s: f64) -> [f64; 2] {
    let is_sweep = |phase: &PhaseRecord| phase.name.to_lowercase().contains("sweep");
    let Some(first) = recording.phases.iter().position(is_sweep) else {
        let heard = recording.users.iter().filter_map(|u| u.heard_s);
        return [0.0, heard.fold(0.0, f64::max)];
    };
    let after = recording.phases[first..].iter().find(|phase| !is_sweep(phase));
    [recording.phases[first].t_s, after.map_or(end_s, |phase| phase.t_s)]
}

fn rings_to_centimetres(rings_m: &[Vec<[f64; 2]>]) -> Vec<Vec<[f64; 2]>> {
    rings_m.iter().map(|ring_m| to_centimetres(ring_m)).collect()
}

fn to_centimetres(points_m: &[[f64; 2]]) -> Vec<[f64; 2]> {
    points_m.iter().map(|&point_m| to_centimetre(point_m)).collect()
}

fn to_centimetre(point_m: [f64; 2]) -> [f64; 2] {
    point_m.map(|x_m| (x_m * 100.0).round() / 100.0)
}

/// Four significant digits. Non-finite values stay as they are, which JSON writes as null.
fn to_four_digits(x: f64) -> f64 {
    format!("{x:.3e}").parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn phases(named: &[(f64, &str)]) -> Vec<PhaseRecord> {
        let phase = |&(t_s, name): &(f64, &str)| PhaseRecord { t_s, name: name.into() };
        named.iter().map(phase).collect()
    }

    #[test]
    fn the_sweep_is_found_by_name_or_by_the_last_user_heard() {
        let mut recording = Recording {
            phases: phases(&[
                (0.0, "Take-off"),
                (60.0, "Sweep"),
                (90.0, "sweep, lane 2"),
                (200.0, "Placement"),
            ]),
            ..Recording::default()
        };
        assert_eq!(sweep_s(&recording, 300.0).map(f64::to_bits), [60.0, 200.0].map(f64::to_bits));
        recording.phases = phases(&[(0.0, "Stage one")]);
        recording.users = vec![UserRecord { heard_s: Some(77.0), ..UserRecord::default() }];
        assert_eq!(sweep_s(&recording, 300.0).map(f64::to_bits), [0.0, 77.0].map(f64::to_bits));
    }

    #[test]
    fn rounding_keeps_four_digits_of_any_size() {
        assert_eq!(to_four_digits(123_456.0).to_string(), "123500");
        assert_eq!(to_four_digits(-0.001_234_56).to_string(), "-0.001235");
        assert!(to_four_digits(f64::NAN).is_nan());
    }
}
