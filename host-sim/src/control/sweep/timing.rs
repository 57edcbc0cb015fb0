//! How long a path takes, and where to cut it into shares of equal or given flying time.

use crate::geometry::{V2, cross};

use super::CornerModel;

/// A path flown at one cruise speed, slowed down at each corner.
///
/// # Assumptions
/// Straight segments; the fleet passes each corner at `corner_speed_mps` and accelerates and brakes at
/// `max_accel_mps2`. The path begins and ends at cruise speed: what happens before and after is no part
/// of the sweep. A corner is any inner point where the direction changes.
pub(super) struct Timing {
    speed_mps: f64,
    accel_mps2: f64,
    /// Speed at a corner, never above cruise.
    corner_mps: f64,
}

/// Turns sharper than this count as corners.
const STRAIGHT_ON_RAD: f64 = 1e-6;

impl Timing {
    pub(super) fn new(speed_mps: f64, corner: &CornerModel) -> Self {
        let corner_mps = corner.corner_speed_mps.min(speed_mps);
        Self { speed_mps, accel_mps2: corner.max_accel_mps2, corner_mps }
    }

    /// Flying time of a whole path, seconds.
    pub(super) fn duration_s(&self, path_m: &[V2]) -> f64 {
        let route = Route::new(path_m);
        self.between_s(&route, 0.0, route.length_m())
    }

    /// When each corner of a path is passed, each leg taken at its mean speed.
    pub(super) fn flight(&self, path_m: &[V2]) -> Vec<(f64, V2)> {
        let route = Route::new(path_m);
        let mut at_s = 0.0;
        let legs_s = route.vertices.windows(2).map(|w| {
            at_s += self.segment_s(w[1].0 - w[0].0, u8::from(w[0].1) + u8::from(w[1].1));
            at_s
        });
        path_m.iter().copied().zip([0.0].into_iter().chain(legs_s)).map(|(p, t)| (t, p)).collect()
    }

    /// Flying time of the part between two distances along a route; a corner right at a cut is none.
    fn between_s(&self, route: &Route, from_m: f64, to_m: f64) -> f64 {
        let slowed = |(at_m, corner): (f64, bool)| u8::from(corner && from_m < at_m && at_m < to_m);
        route
            .vertices
            .windows(2)
            .map(|w| {
                let length_m = w[1].0.min(to_m) - w[0].0.max(from_m);
                if length_m > 0.0 { self.segment_s(length_m, slowed(w[0]) + slowed(w[1])) } else { 0.0 }
            })
            .sum()
    }

    /// Seconds for a straight segment with a corner at none, one or both of its ends.
    ///
    /// From corner speed c the speed grows as `v^2 = c^2 + 2 a s`. Each corner thus costs
    /// `(v - c)^2 / (2 a v)` on either side of it, where the segment is long enough to reach cruise.
    pub(super) fn segment_s(&self, length_m: f64, corners: u8) -> f64 {
        let (v, c, a) = (self.speed_mps, self.corner_mps, self.accel_mps2);
        let ramps = f64::from(corners);
        if corners == 0 || c >= v {
            return length_m / v;
        }
        let ramp_m = (v * v - c * c) / (2.0 * a);
        if length_m >= ramps * ramp_m {
            return (length_m - ramps * ramp_m) / v + ramps * (v - c) / a;
        }
        // Too short to reach cruise: each ramp has its share of the length.
        let peak = (c * c + 2.0 * a * length_m / ramps).sqrt();
        ramps * (peak - c) / a
    }

    /// Distances along a path at which to cut it so that the flying times of the parts are in the given
    /// proportions (they sum to 1): the end of each part, the last one being the path's.
    ///
    /// A cut is no corner, so a part's time is not just a difference along the whole; the common unit of
    /// time is found by bisection: a longer unit makes all parts reach farther. The parts together never
    /// take longer than the whole, because a cut can only save a corner.
    pub(super) fn cuts_m(&self, path_m: &[V2], proportions: &[f64]) -> Vec<f64> {
        let route = Route::new(path_m);
        let length_m = route.length_m();
        let ends = |unit_s: f64| -> Vec<f64> {
            let mut at_m = 0.0;
            proportions
                .iter()
                .map(|p| {
                    at_m = self.reach_m(&route, at_m, p * unit_s);
                    at_m
                })
                .collect()
        };
        let (mut low_s, mut high_s) = (0.0, self.between_s(&route, 0.0, length_m));
        while high_s - low_s > 1e-9 * high_s {
            let middle_s = (low_s + high_s) / 2.0;
            if ends(middle_s).last().is_some_and(|&end_m| end_m >= length_m) {
                high_s = middle_s;
            } else {
                low_s = middle_s;
            }
        }
        let mut found = ends(high_s);
        if let Some(last) = found.last_mut() {
            *last = length_m;
        }
        found
    }

    /// How far along a route one gets from `from_m` in the given time.
    fn reach_m(&self, route: &Route, from_m: f64, time_s: f64) -> f64 {
        let end_m = route.length_m();
        if self.between_s(route, from_m, end_m) <= time_s {
            return end_m;
        }
        let (mut low_m, mut high_m) = (from_m, end_m);
        while high_m - low_m > 1e-11 * end_m {
            let middle_m = (low_m + high_m) / 2.0;
            if self.between_s(route, from_m, middle_m) <= time_s {
                low_m = middle_m;
            } else {
                high_m = middle_m;
            }
        }
        low_m
    }
}

/// A path as far as its timing goes: for each vertex the distance along the path, and whether it is a corner.
struct Route {
    vertices: Vec<(f64, bool)>,
}

impl Route {
    fn new(path_m: &[V2]) -> Self {
        let mut at_m = 0.0;
        let vertices = (0..path_m.len())
            .map(|i| {
                if i > 0 {
                    at_m += (path_m[i] - path_m[i - 1]).norm();
                }
                let inner = i > 0 && i + 1 < path_m.len();
                (at_m, inner && is_corner(path_m[i] - path_m[i - 1], path_m[i + 1] - path_m[i]))
            })
            .collect();
        Self { vertices }
    }

    fn length_m(&self) -> f64 {
        self.vertices.last().map_or(0.0, |v| v.0)
    }
}

fn is_corner(before: V2, after: V2) -> bool {
    let turned = cross(before, after).abs() > STRAIGHT_ON_RAD * before.norm() * after.norm();
    turned || before.dot(&after) < 0.0
}

/// Length of a path, metres.
pub(super) fn length_m(path_m: &[V2]) -> f64 {
    path_m.windows(2).fold(0.0, |sum, w| sum + (w[1] - w[0]).norm())
}

/// The part of a path between two distances along it; both cut points belong to it.
pub(super) fn part(path_m: &[V2], from_m: f64, to_m: f64) -> Vec<V2> {
    let mut kept = Vec::new();
    let mut start_m = 0.0;
    for w in path_m.windows(2) {
        let length_m = (w[1] - w[0]).norm();
        let end_m = start_m + length_m;
        let at = |s_m: f64| w[0] + (w[1] - w[0]) * ((s_m - start_m) / length_m).clamp(0.0, 1.0);
        if length_m > 0.0 && end_m >= from_m && start_m <= to_m {
            for p in [at(from_m), at(to_m)] {
                if kept.last().is_none_or(|q: &V2| (p - q).norm() > 1e-9) {
                    kept.push(p);
                }
            }
        }
        start_m = end_m;
    }
    if kept.is_empty() {
        kept.extend(path_m.first());
    }
    kept
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn timing(corner_speed_mps: f64) -> Timing {
        Timing::new(10.0, &CornerModel { max_accel_mps2: 3.0, corner_speed_mps })
    }

    fn zigzag(lanes: usize, spacing_m: f64) -> Vec<V2> {
        (0..2 * lanes)
            .map(|i| V2::new(if i.div_ceil(2) % 2 == 0 { 0.0 } else { 1000.0 }, (i / 2) as f64 * spacing_m))
            .collect()
    }

    #[test]
    fn truth_a_corner_costs_what_the_ramps_lose() {
        let square = [V2::new(0.0, 0.0), V2::new(100.0, 0.0), V2::new(100.0, 100.0)];
        let lost_s = timing(2.0).duration_s(&square) - 20.0;
        assert!((lost_s - 8.0f64.powi(2) / (3.0 * 10.0)).abs() < 1e-12);
        // Through the corner without slowing down nothing is lost.
        assert!((timing(12.0).duration_s(&square) - 20.0).abs() < 1e-12);
    }

    #[test]
    fn truth_a_short_segment_agrees_with_step_by_step_integration() {
        // 6 m between two stops: 3 m at 3 m/s2 up to sqrt(18) m/s, then down again.
        assert!((timing(0.0).segment_s(6.0, 2) - 2.0 * 18f64.sqrt() / 3.0).abs() < 1e-12);
        let (mut s, mut v, mut t) = (0.0, 1.0, 0.0);
        while s < 7.0 {
            v = (v + 3.0 * 1e-5_f64).min(10.0);
            s += v * 1e-5;
            t += 1e-5;
        }
        assert!((timing(1.0).segment_s(7.0, 1) - t).abs() < 1e-3);
    }

    proptest! {
        #[test]
        fn parts_take_their_share_of_the_time(
            lanes in 1usize..9, corner_mps in 0.0..12.0f64, weights in prop::collection::vec(0.1..1.0f64, 1..5),
            spacing_m in 1.0..500.0f64,
        ) {
            let timing = timing(corner_mps);
            let path_m = zigzag(lanes, spacing_m);
            let total: f64 = weights.iter().sum();
            let proportions: Vec<f64> = weights.iter().map(|w| w / total).collect();
            let mut from_m = 0.0;
            let parts: Vec<Vec<V2>> = timing
                .cuts_m(&path_m, &proportions)
                .into_iter()
                .map(|to_m| part(&path_m, std::mem::replace(&mut from_m, to_m), to_m))
                .collect();
            let times: Vec<f64> = parts.iter().map(|p| timing.duration_s(p)).collect();
            let sum_s: f64 = times.iter().sum();
            for (time_s, p) in times.iter().zip(&proportions) {
                // A cut right at a corner saves that corner's loss at once: the time of a part jumps there.
                prop_assert!((time_s - p * sum_s).abs() < 7.0, "{time_s} s of {sum_s} s for {p}");
            }
            let flown_m: f64 = parts.iter().map(|p| length_m(p)).sum();
            prop_assert!((flown_m - length_m(&path_m)).abs() < 1e-6);
            for w in parts.windows(2) {
                prop_assert_eq!(w[0].last(), w[1].first());
            }
        }
    }
}
