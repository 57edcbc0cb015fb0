//! Goals that cannot all be held: nobody is sent to places that avoidance would keep two drones from.

use crate::geometry::V2;
use skyroost_protocol::units::DroneId;
use thiserror::Error;

/// Goals are commanded in whole millimetres: rounding is no conflict, metres.
const ROUNDING_M: f64 = 2e-3;

/// Two drones sent to places so near to each other that avoidance lets neither arrive.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "the goals of drone {} at ({:.1} m, {:.1} m) and drone {} at ({:.1} m, {:.1} m) are {distance_m:.2} m apart, expected \
     at least {least_m} m", .pair[0].0.0, .pair[0].1.x, .pair[0].1.y, .pair[1].0.0, .pair[1].1.x, .pair[1].1.y
)]
pub struct GoalConflict {
    /// The drones and their goals, metres.
    pub pair: [(DroneId, V2); 2],
    /// How far apart those are, metres.
    pub distance_m: f64,
    /// How far they have to be, metres.
    pub least_m: f64,
}

/// The two goals that are nearest to each other, where that is nearer than `least_m`.
pub(super) fn conflict(goals: &[(DroneId, V2)], least_m: f64) -> Option<GoalConflict> {
    let pairs = goals.iter().enumerate().flat_map(|(i, a)| goals[i + 1..].iter().map(move |b| [*a, *b]));
    let apart = pairs.map(|pair| GoalConflict { pair, distance_m: (pair[0].1 - pair[1].1).norm(), least_m });
    let nearest = apart.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    nearest.filter(|found| found.distance_m < least_m - ROUNDING_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pair_is_named() {
        let at = |id, x, y| (DroneId(id), V2::new(x, y));
        let goals = [at(1, 0.0, 0.0), at(2, 0.0, 12.0), at(5, 200.0, 0.0), at(7, 206.0, 8.0)];
        let found = conflict(&goals, 14.5).map(|found| found.to_string());
        let expected = "the goals of drone 5 at (200.0 m, 0.0 m) and drone 7 at (206.0 m, 8.0 m) are 10.00 m apart, \
                        expected at least 14.5 m";
        assert_eq!(found.as_deref(), Some(expected));
        assert_eq!(conflict(&goals, 10.0), None, "a distance that is enough");
        assert_eq!(conflict(&goals[..1], 14.5), None, "nobody to be near to");
    }
}
