//! The tables of a flown mission: `users.csv` and `trajectory.csv`, metres in the local
//! east-north-up frame.

use crate::recording::{Recording, UserRecord};
use std::io::Write;

/// Header of [`write_users`].
const USERS_HEADER: [&str; 14] = [
    "id",
    "truth_x_m",
    "truth_y_m",
    "x_m",
    "y_m",
    "cov_xx_m2",
    "cov_xy_m2",
    "cov_yy_m2",
    "r95_m",
    "status",
    "occasions",
    "heard_s",
    "served_guaranteed_by",
    "served_actual_by",
];

/// Writes one row for each user; what is not known stays empty.
///
/// # Errors
/// When `out` does.
pub fn write_users(recording: &Recording, out: impl Write) -> Result<(), csv::Error> {
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(USERS_HEADER)?;
    for user in &recording.users {
        writer.write_record(user_row(user))?;
    }
    Ok(writer.flush()?)
}

/// The row of one user, in the order of the header.
fn user_row(user: &UserRecord) -> [String; 14] {
    let [truth_x_m, truth_y_m] = user.truth_m;
    let [x_m, y_m] = split(user.estimate_m);
    let [cov_xx_m2, cov_xy_m2, cov_yy_m2] = split(user.cov_m2.map(|[[xx, xy], [_, yy]]| [xx, xy, yy]));
    [
        user.id.clone(),
        decimals(Some(truth_x_m), 3),
        decimals(Some(truth_y_m), 3),
        decimals(x_m, 3),
        decimals(y_m, 3),
        decimals(cov_xx_m2, 6),
        decimals(cov_xy_m2, 6),
        decimals(cov_yy_m2, 6),
        decimals(user.r95_m, 3),
        user.status.to_owned(),
        user.occasions.to_string(),
        decimals(user.heard_s, 3),
        number(user.served_guaranteed_by),
        number(user.served_actual_by),
    ]
}

/// Writes the true tracks, `t_s,id,x_m,y_m,z_m`, by time and then by drone.
///
/// # Errors
/// When `out` does.
pub fn write_trajectory(recording: &Recording, out: impl Write) -> Result<(), csv::Error> {
    let mut samples: Vec<_> = recording
        .drones
        .iter()
        .flat_map(|drone| drone.track.iter().map(|sample| (drone.id, sample)))
        .collect();
    // Each track is in time order already, so the stable sort is one merge pass.
    samples.sort_by(|(id_a, a), (id_b, b)| a.t_s.total_cmp(&b.t_s).then(id_a.cmp(id_b)));

    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(["t_s", "id", "x_m", "y_m", "z_m"])?;
    for (id, sample) in samples {
        let [x_m, y_m, z_m] = sample.pos_enu_m.map(|coordinate_m| decimals(Some(coordinate_m), 3));
        writer.write_record([decimals(Some(sample.t_s), 3), id.to_string(), x_m, y_m, z_m])?;
    }
    Ok(writer.flush()?)
}

/// The parts of something that may be missing.
pub(super) fn split<const N: usize>(parts: Option<[f64; N]>) -> [Option<f64>; N] {
    parts.map_or([None; N], |parts| parts.map(Some))
}

pub(super) fn decimals(value: Option<f64>, places: usize) -> String {
    value.map_or_else(String::new, |value| format!("{value:.places$}"))
}

fn number(value: Option<u16>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{DroneRecord, TrackSample};

    fn text(write: impl Fn(&mut Vec<u8>) -> Result<(), csv::Error>) -> String {
        let mut bytes = Vec::new();
        assert!(write(&mut bytes).is_ok());
        String::from_utf8_lossy(&bytes).into_owned()
    }

    #[test]
    fn a_user_not_located_has_empty_fields_not_zeros() {
        let users = vec![
            UserRecord {
                id: "a, \"b\"".to_owned(),
                truth_m: [1.0, -2.5],
                estimate_m: Some([1.5, -2.0]),
                cov_m2: Some([[4.0, 0.5], [0.5, 9.0]]),
                r95_m: Some(6.25),
                status: "ok",
                occasions: 60,
                heard_s: Some(100.0),
                served_guaranteed_by: Some(3),
                served_actual_by: Some(3),
            },
            UserRecord { id: "u2".to_owned(), status: "not_located", ..UserRecord::default() },
        ];
        let recording = Recording { users, ..Recording::default() };
        insta::assert_snapshot!(text(|out| write_users(&recording, out)));
    }

    #[test]
    fn the_trajectory_runs_by_time_and_drone() {
        let track = |offset_m: f64| {
            let sample = |t_s: f64| TrackSample { t_s, pos_enu_m: [t_s + offset_m, 0.0, 300.0] };
            [0.0, 1.0, 2.5].map(sample).to_vec()
        };
        let drone = |id: u16| DroneRecord { id, fleet: None, track: track(f64::from(id)) };
        let recording = Recording { drones: vec![drone(2), drone(1)], ..Recording::default() };
        insta::assert_snapshot!(text(|out| write_trajectory(&recording, out)));
    }
}
