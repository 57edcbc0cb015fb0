//! One mission for each drone as a [plan file] of QGroundControl, for autopilots that skyroost does not run on.
//!
//! Each drone flies its fleet's way, moved by its place in the triangle; the triangle keeps its orientation, as in
//! a mission of skyroost. Altitudes are relative to the take-off place, whose own height is left at zero:
//! QGroundControl asks the terrain for it. The fence is meant for QGroundControl's and the autopilots' straight
//! lines between degrees, which over a few kilometres are straight here, too.
//!
//! [plan file]: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html

use std::f64::consts::TAU;

use serde_json::{Value, json};
use thiserror::Error;

use super::SweepReport;
use crate::control::sweep::SubArea;
use crate::geometry::frame::LocalFrame;
use crate::geometry::polygon::{Polygon, convex_hull};
use crate::geometry::{V2, cross};
use crate::runner::formation::{FLEET_DRONES, fixed_orientation_rad, slot_m};

/// MAVLink's `MAV_CMD`.
mod command {
    pub(super) const WAYPOINT: u16 = 16;
    pub(super) const RETURN_TO_LAUNCH: u16 = 20;
    pub(super) const TAKEOFF: u16 = 22;
    pub(super) const CHANGE_SPEED: u16 = 178;
}
/// MAVLink's `MAV_FRAME` for commands without a place.
const FRAME_MISSION: u8 = 2;
/// And for altitudes above the take-off place.
const FRAME_RELATIVE_ALTITUDE: u8 = 3;
/// QGroundControl's mode of altitudes above the take-off place.
const ALTITUDE_RELATIVE: u8 = 1;
/// `MAV_AUTOPILOT_GENERIC`: the mission uses nothing that one autopilot has and another has not.
const AUTOPILOT_ANY: u8 = 0;
/// `MAV_TYPE_QUADROTOR`.
const QUADROTOR: u8 = 2;

/// Between the way flown and the fence, metres: GNSS without corrections, gusts, and corners.
const FENCE_ROOM_M: f64 = 50.0;
/// A longer edge of the fence is cut, so that lines straight in degrees leave it by decimetres only.
const FENCE_EDGE_M: f64 = 3_000.0;
/// Corners of the outline of the room around a point.
const ROOM_CORNERS: u8 = 8;
/// A shorter piece of way inside of a zone is the rounding of a way along its border, metres.
const TOUCH_M: f64 = 1e-3;

/// A drone would have to fly through a zone.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "drone {drone} of fleet {fleet} would cross no-fly zone {zone} {leg}; \
     expected a base (--base-m or --base-lon-lat) with straight ways to the first lanes and back from the last"
)]
pub struct WayBlocked {
    /// From 1.
    pub fleet: usize,
    /// From 1.
    pub drone: u8,
    /// From 1, as they stand in the file.
    pub zone: usize,
    /// Which part of its way.
    pub leg: &'static str,
}

/// One drone's mission.
struct Drone<'a> {
    fleet: &'a SubArea,
    /// From 0.
    slot: u8,
    home_m: V2,
    waypoints_m: Vec<V2>,
}

/// File names and contents; see [`SweepReport::flight_plans`].
pub(super) fn files(report: &SweepReport, frame: &LocalFrame) -> Result<Vec<(String, String)>, WayBlocked> {
    let drones: Vec<Drone<'_>> = report
        .plan
        .sub_areas
        .iter()
        .flat_map(|fleet| (0..FLEET_DRONES).map(move |slot| drone(report, fleet, slot)))
        .collect();
    drones.iter().try_for_each(|drone| drone.check(report.area.region.no_fly()))?;
    let file = |drone: &Drone<'_>| {
        let name = format!("fleet{}-drone{}.plan", drone.fleet.fleet + 1, drone.slot + 1);
        let mut text = format!("{:#}", document(report, frame, drone));
        text.push('\n');
        (name, text)
    };
    Ok(drones.iter().map(file).collect())
}

fn drone<'a>(report: &SweepReport, fleet: &'a SubArea, slot: u8) -> Drone<'a> {
    let orientation_rad = fixed_orientation_rad(report.plan.direction_rad);
    let offset_m = slot_m(orientation_rad, slot, report.request.spacing_m);
    let way_m = fleet.approach_m.iter().chain(&fleet.path_m).chain(&fleet.way_back_m);
    Drone {
        fleet,
        slot,
        home_m: report.pads.centre_m(fleet.fleet) + offset_m,
        waypoints_m: way_m.map(|centre_m| centre_m + offset_m).collect(),
    }
}

impl Drone<'_> {
    /// From home over all waypoints back home.
    fn way_m(&self) -> Vec<V2> {
        [&[self.home_m][..], &self.waypoints_m, &[self.home_m]].concat()
    }

    /// Refuses a way through a zone.
    fn check(&self, zones: &[Polygon]) -> Result<(), WayBlocked> {
        let way_m = self.way_m();
        let last = way_m.len().saturating_sub(2);
        for (i, leg_m) in way_m.windows(2).enumerate() {
            let Some(zone) = zones.iter().position(|zone| enters(zone, leg_m[0], leg_m[1])) else { continue };
            let leg = match i {
                0 => "on its way to the first lane",
                _ if i == last => "on its way home",
                _ => "on its lanes",
            };
            return Err(WayBlocked {
                fleet: self.fleet.fleet + 1,
                drone: self.slot + 1,
                zone: zone + 1,
                leg,
            });
        }
        Ok(())
    }
}

/// Whether a straight leg runs inside of a polygon: between two places where it meets the border it is either
/// inside all along or outside.
fn enters(polygon: &Polygon, from_m: V2, to_m: V2) -> bool {
    let leg_m = to_m - from_m;
    let meets = |(a, b): (V2, V2)| {
        let edge_m = b - a;
        let slope = cross(leg_m, edge_m);
        let (along, across) = (cross(a - from_m, edge_m) / slope, cross(a - from_m, leg_m) / slope);
        (slope.abs() > 0.0 && (0.0..=1.0).contains(&along) && (0.0..=1.0).contains(&across)).then_some(along)
    };
    let mut at: Vec<f64> = polygon.edges_m().filter_map(meets).chain([0.0, 1.0]).collect();
    at.sort_by(f64::total_cmp);
    at.windows(2)
        .filter(|piece| (piece[1] - piece[0]) * leg_m.norm() > TOUCH_M)
        .any(|piece| polygon.contains_inside(from_m + leg_m * f64::midpoint(piece[0], piece[1])))
}

fn document(report: &SweepReport, frame: &LocalFrame, drone: &Drone<'_>) -> Value {
    let lat_lon_deg = |point_m: &V2| {
        let [lon_deg, lat_deg] = frame.to_lon_lat_deg(*point_m);
        [lat_deg, lon_deg]
    };
    let ring = |points_m: &[V2]| points_m.iter().map(lat_lon_deg).collect::<Vec<_>>();
    let [home_lat_deg, home_lon_deg] = lat_lon_deg(&drone.home_m);
    let inclusion = json!({ "inclusion": true, "polygon": ring(&fence_m(report, drone)), "version": 1 });
    let exclusion =
        |zone: &Polygon| json!({ "inclusion": false, "polygon": ring(zone.vertices_m()), "version": 1 });
    let exclusions = report.area.region.no_fly().iter().map(exclusion);
    json!({
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": AUTOPILOT_ANY,
            "vehicleType": QUADROTOR,
            "globalPlanAltitudeMode": ALTITUDE_RELATIVE,
            "cruiseSpeed": report.request.speed_mps,
            "hoverSpeed": report.request.speed_mps,
            "plannedHomePosition": [home_lat_deg, home_lon_deg, 0.0],
            "items": items(report, drone, lat_lon_deg),
        },
        "geoFence": {
            "version": 2,
            "circles": [],
            "polygons": std::iter::once(inclusion).chain(exclusions).collect::<Vec<_>>(),
        },
        "rallyPoints": { "version": 2, "points": [] },
    })
}

/// Take-off, cruise speed, every corner of the way, return.
fn items(report: &SweepReport, drone: &Drone<'_>, lat_lon_deg: impl Fn(&V2) -> [f64; 2]) -> Vec<Value> {
    let altitude_m = report.altitude_m;
    // A heading of null is the autopilot's own choice.
    let place = |command: u16, point_m: &V2| {
        let [lat_deg, lon_deg] = lat_lon_deg(point_m);
        let params = json!([0, 0, 0, null, lat_deg, lon_deg, altitude_m]);
        json!({
            "command": command, "frame": FRAME_RELATIVE_ALTITUDE, "params": params,
            "AMSLAltAboveTerrain": null, "Altitude": altitude_m, "AltitudeMode": ALTITUDE_RELATIVE,
        })
    };
    let order =
        |command: u16, params: Value| json!({ "command": command, "frame": FRAME_MISSION, "params": params });
    const GROUND_SPEED: u8 = 1;
    const THROTTLE_AS_IT_IS: i8 = -1;
    let speed = json!([GROUND_SPEED, report.request.speed_mps, THROTTLE_AS_IT_IS, 0, 0, 0, 0]);
    let start = [place(command::TAKEOFF, &drone.home_m), order(command::CHANGE_SPEED, speed)];
    let waypoints = drone.waypoints_m.iter().map(|point_m| place(command::WAYPOINT, point_m));
    let end = [order(command::RETURN_TO_LAUNCH, json!([0, 0, 0, 0, 0, 0, 0]))];
    let mut items: Vec<Value> = start.into_iter().chain(waypoints).chain(end).collect();
    for (number, item) in (1..).zip(&mut items) {
        item["type"] = json!("SimpleItem");
        item["autoContinue"] = json!(true);
        item["doJumpId"] = json!(number);
    }
    items
}

/// A convex fence, anticlockwise, around the area and all of a drone's way, with room.
fn fence_m(report: &SweepReport, drone: &Drone<'_>) -> Vec<V2> {
    let corner = |k: u8| TAU * f64::from(k) / f64::from(ROOM_CORNERS);
    // The circle of the room touches the sides of its outline from within.
    let reach_m = FENCE_ROOM_M / (TAU / f64::from(2 * ROOM_CORNERS)).cos();
    let room =
        |p: V2| (0..ROOM_CORNERS).map(move |k| p + V2::new(corner(k).cos(), corner(k).sin()) * reach_m);
    let inside = report.area.region.outer_vertices_m().chain(drone.way_m());
    let hull_m = convex_hull(&inside.flat_map(room).collect::<Vec<_>>());
    let next = hull_m.iter().cycle().skip(1);
    let cut = |(&from, &to): (&V2, &V2)| {
        let pieces = ((to - from).norm() / FENCE_EDGE_M).ceil().max(1.0) as u32;
        (0..pieces).map(move |k| from + (to - from) * (f64::from(k) / f64::from(pieces))).collect::<Vec<_>>()
    };
    hull_m.iter().zip(next).flat_map(cut).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_leg_enters_what_it_runs_through_and_not_what_it_touches() {
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [5.0, 5.0], [0.0, 10.0]];
        let notched = Polygon::new(&corners.map(V2::from)).unwrap();
        for (from, to, inside) in [
            ([-5.0, 2.0], [15.0, 2.0], true),
            ([1.0, 1.0], [2.0, 1.0], true),
            ([-5.0, 8.0], [1.0, 8.0], true),
            ([4.0, 9.0], [6.0, 9.0], false), // in the notch
            ([0.0, 0.0], [10.0, 0.0], false),
            ([-5.0, 5.0], [5.0, 15.0], false), // past a corner
            ([-5.0, 11.0], [15.0, 11.0], false),
            ([0.0, 10.0], [10.0, 10.0], false), // from tip to tip
        ] {
            assert_eq!(enters(&notched, V2::from(from), V2::from(to)), inside, "{from:?} to {to:?}");
            assert_eq!(enters(&notched, V2::from(to), V2::from(from)), inside, "{to:?} to {from:?}");
        }
    }
}
