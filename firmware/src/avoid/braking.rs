//! How close two drones come if both brake straight from now on.
//!
//! This is PCA on braking paths instead of steady flight: it asks what is left when plans fail, and is exact where the
//! others do anything but speed up towards each other.

use super::Neighbour;
use super::pca::Mover;
use crate::{
    Vec3,
    scalar::{greater, lesser, within},
};

/// Braking that is counted on, metres a second squared: below what the airframe can do.
const BRAKE_MPS2: f32 = 2.6;
/// Metres of separation more for every metre a second of both: what the velocity loop takes to turn round, and what a
/// state that is 0.2 s old does not say.
const PER_SPEED_S: f32 = 0.1;
/// Pieces into which braking paths are cut.
const PIECES: u8 = 6;

/// Where A and B are closest while both brake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// Position of A seen from B then, metres.
    pub rel_m: Vec3,
    /// A's way until then in units of its velocity, seconds: by how much `rel_m` moves for a change of it.
    pub way_s: f32,
}

/// Distance that A, at velocity `v`, has to keep from a neighbour while they brake: more the faster both are. None if
/// they part, or if their ways together are too short to matter by `spare_m`.
#[must_use]
pub fn keep_m(l: &Vec3, v: &Vec3, neighbour: &Neighbour, spare_m: f32) -> Option<f32> {
    let w = &neighbour.mover.vel_enu_mps;
    let c = v - w;
    let approach = l.dot(&c) < 0.0;
    if !approach {
        return None;
    }
    let (speed, other_speed) = (v.norm(), w.norm());
    let keep_m = neighbour.keep_m + PER_SPEED_S * (speed + other_speed);
    let near_m = keep_m + spare_m + ways_m(c.norm(), speed, other_speed);
    (l.norm_squared() < near_m * near_m).then_some(keep_m)
}

/// Whether A has nothing to do with a neighbour for now by braking paths: neither at its velocity, by `spare_m`, nor at
/// any that it can change to by `change_mps`.
#[must_use]
pub fn is_clear(a: &Mover, neighbour: &Neighbour, spare_m: f32, change_mps: f32) -> bool {
    let (v, w) = (&a.vel_enu_mps, &neighbour.mover.vel_enu_mps);
    let (relative_mps, speed_mps, other_mps) = ((v - w).norm(), v.norm(), w.norm());
    let near_m = |more_mps: f32, spare_m: f32| {
        let speed_mps = speed_mps + more_mps;
        let ways_m = ways_m(relative_mps + more_mps, speed_mps, other_mps);
        neighbour.keep_m + PER_SPEED_S * (speed_mps + other_mps) + ways_m + spare_m
    };
    let near_m = greater(near_m(0.0, spare_m), near_m(change_mps, 0.0));
    (a.pos_enu_m - neighbour.mover.pos_enu_m).norm_squared() > near_m * near_m
}

/// Bound of how far two can shift against each other while both brake, metres: never farther than both ways together,
/// `(v^2 + w^2) / 2 b`, and hardly at all where both fly alike, as mates do. There what the shared part of the velocity makes of two
/// braking times, and its difference in either, comes to `|v - w| (v + w) / 2 b` at most.
fn ways_m(relative_mps: f32, speed_mps: f32, other_mps: f32) -> f32 {
    let apart = speed_mps * speed_mps + other_mps * other_mps;
    lesser(apart, relative_mps * (speed_mps + other_mps)) * (0.5 / BRAKE_MPS2)
}

/// Closest approach of A, at velocity `v` and seen from B at `l`, and of B, at velocity `w`, while both brake.
#[must_use]
pub fn closest(l: &Vec3, v: &Vec3, w: &Vec3) -> Closest {
    let (stop_s, other_stop_s) = (v.norm() / BRAKE_MPS2, w.norm() / BRAKE_MPS2);
    let piece_s = greater(stop_s, other_stop_s) / f32::from(PIECES);
    let mut from = *l;
    let mut best = Closest { rel_m: *l, way_s: 0.0 };
    let mut least = l.norm_squared();
    for piece in 1..=PIECES {
        let t = piece_s * f32::from(piece);
        let to = l + v * way_s(t, stop_s) - w * way_s(t, other_stop_s);
        let step = to - from;
        let square = step.norm_squared();
        let share = if square > 0.0 { within(-from.dot(&step) / square, 0.0, 1.0) } else { 0.0 };
        let rel_m = from + step * share;
        let distance_squared = rel_m.norm_squared();
        if distance_squared < least {
            least = distance_squared;
            best = Closest { rel_m, way_s: way_s(t - piece_s * (1.0 - share), stop_s) };
        }
        from = to;
    }
    best
}

/// Closest approach of A and a neighbour, and the distance to keep then, where it matters by `spare_m`.
pub(super) fn meeting(a: &Mover, v: &Vec3, neighbour: &Neighbour, spare_m: f32) -> Option<(Closest, f32)> {
    let b = &neighbour.mover;
    let l = a.pos_enu_m - b.pos_enu_m;
    let keep_m = keep_m(&l, v, neighbour, spare_m)?;
    Some((closest(&l, v, &b.vel_enu_mps), keep_m))
}

/// Way after a time in units of the velocity: `t - t^2 / 2 T` until it stops at `T`.
fn way_s(t: f32, stop_s: f32) -> f32 {
    let t = lesser(t, stop_s);
    if stop_s > 0.0 { t - 0.5 * t * t / stop_s } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(most: f32) -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-most..most).prop_map(Vec3::from)
    }

    proptest! {
        /// Against small steps of both paths.
        #[test]
        fn truth_no_moment_is_closer(l in vector(60.0), v in vector(10.0), w in vector(10.0)) {
            let found = closest(&l, &v, &w).rel_m.norm();
            let stop = |v: &Vec3| v.norm() / BRAKE_MPS2;
            let at = |i: u16| {
                let t = f32::from(i) * 0.01;
                (l + v * way_s(t, stop(&v)) - w * way_s(t, stop(&w))).norm()
            };
            let least = (0..800).map(at).fold(f32::INFINITY, lesser);
            prop_assert!((found - least).abs() < 0.6, "{} {}", found, least);
        }

        /// Nobody who is passed over comes nearer than what is to be kept.
        #[test]
        fn truth_ways_bound_the_shift(l in vector(60.0), v in vector(10.0), w in vector(10.0), alike in 0.0f32..1.0) {
            let w = w + (v - w) * alike;
            let least_m = l.norm() - ways_m((v - w).norm(), v.norm(), w.norm());
            prop_assert!(closest(&l, &v, &w).rel_m.norm() > least_m - 1e-3);
        }

        /// Who is clear has no meeting, at any velocity that it may change to.
        #[test]
        fn who_is_clear_meets_nobody(l in vector(120.0), v in vector(10.0), w in vector(10.0), change in vector(0.8)) {
            let a = Mover { pos_enu_m: l, vel_enu_mps: v };
            let neighbour = Neighbour { mover: Mover { vel_enu_mps: w, ..Mover::default() }, keep_m: 12.0, ..Neighbour::default() };
            if is_clear(&a, &neighbour, 20.0, 1.5) {
                prop_assert_eq!(meeting(&a, &v, &neighbour, 20.0), None);
                prop_assert_eq!(meeting(&a, &(v + change), &neighbour, 0.0), None);
            }
        }

        /// B sees the same distance from the other side. Not the same place: where the distance hardly changes, rounding
        /// moves that far.
        #[test]
        fn both_see_the_same(l in vector(60.0), v in vector(10.0), w in vector(10.0)) {
            let (of_a, of_b) = (closest(&l, &v, &w).rel_m, closest(&-l, &w, &v).rel_m);
            prop_assert!((of_a.norm() - of_b.norm()).abs() < 1e-3);
        }
    }
}
