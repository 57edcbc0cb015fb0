//! Point of closest approach, paper eqs. (8) to (12).
//!
//! For drones A and B let `l = P_A - P_B` and `c = V_A - V_B`. Flying on, their relative position at
//! time `t` is `l + c t`; it is shortest where `(l + c t) . c = 0`, so the time to closest approach is
//! `tau = -(l.c)/(c.c)` (eq. (11) is printed without the minus) and the pass distance vector
//! `l_p = l + c tau` (10) points from B to A. There is a conflict when `|l_p| < d` **and** `tau > 0`
//! ((12) omits the second). To part, A moves along `+l_p` and B along `-l_p` ((14) and (15) print the
//! same sign, which would change nothing), and their displacements add up to `d - |l_p|`.

use super::halfplanes::HalfPlane;
use super::{Neighbour, Part, braking};
use crate::{Vec3, scalar::within};

/// Longest time ahead that a closest approach is planned for, seconds.
const HORIZON_S: f32 = 8.0;
/// Shortest time over which a displacement is spread, seconds: the velocity loop needs that long.
const SOONEST_S: f32 = 0.7;
/// Below this time to closest approach each drone takes the whole displacement upon itself.
const ALONE_BELOW_S: f32 = 3.0;
/// Signed miss distance within which an encounter counts as head-on, metres.
const HEAD_ON_M: f32 = 8.0;
/// Relative speed below which there is no approach to speak of, metres a second.
const AT_REST_MPS: f32 = 0.3;
/// What the row of braking paths keeps beyond the stop gate, so that the gate need not speak, metres.
const STOP_MORE_M: f32 = 1.0;
/// Below this relative speed two drones stand in each other's way, metres a second.
const STANDING_MPS: f32 = 1.5;
/// How far a half-plane then leans to the left of the other drone.
const STANDING_LEAN: f32 = 0.4;
/// Where braking paths keep this much more than they have to, their row would bind nobody, metres.
pub(super) const STOP_SPARE_M: f32 = 20.0;

/// Something with a position and a velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mover {
    /// Position, metres.
    pub pos_enu_m: Vec3,
    /// Velocity, metres a second.
    pub vel_enu_mps: Vec3,
}

/// Closest approach of two movers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Time to closest approach (11), seconds; negative when it is over.
    pub tau_s: f32,
    /// Pass distance vector `l_p` (10), from B to A, metres.
    pub pass_m: Vec3,
}

/// Closest approach of A and B; none while they do not move against each other.
#[must_use]
pub fn approach(a: &Mover, b: &Mover) -> Option<Approach> {
    let l = a.pos_enu_m - b.pos_enu_m;
    let c = a.vel_enu_mps - b.vel_enu_mps;
    let c_squared = c.norm_squared();
    if c_squared < AT_REST_MPS * AT_REST_MPS {
        return None;
    }
    let tau_s = -l.dot(&c) / c_squared;
    Some(Approach { tau_s, pass_m: l + c * tau_s })
}

/// Emits the half-planes of velocities that keep A away from a neighbour: where both brake, and where both fly on.
pub fn rows(a: &Mover, neighbour: &Neighbour, mut emit: impl FnMut(HalfPlane)) {
    let (b, d_plan_m) = (&neighbour.mover, neighbour.plan_m);
    if let Some(row) = stop_row(a, neighbour) {
        emit(row);
    }
    if neighbour.part == Part::Nothing {
        return;
    }
    let Some(Approach { tau_s, pass_m }) = approach(a, b) else { return };
    if tau_s <= 0.0 {
        return;
    }
    let tau = within(tau_s, SOONEST_S, HORIZON_S);
    let c = a.vel_enu_mps - b.vel_enu_mps;
    let (normal, miss_m) = if tau_s > HORIZON_S {
        // Far ahead the pass vector is still all noise; part along the line of sight's true pass
        // vector, never along c, which would make both brake and wait for each other for ever.
        unit_or(pass_m, || side_of(&c))
    } else {
        passing_side(&pass_m, &c)
    };
    let share = if neighbour.part == Part::All { 1.0 } else { share_of_a(a, b, tau_s) };
    let needed_mps = share * (d_plan_m - miss_m) / tau;
    emit(HalfPlane { normal, at_least: normal.dot(&a.vel_enu_mps) + needed_mps });
}

/// A's share of the displacement: printed in (14) as `|V_B| / (|V_A| + |V_B|)`, which leaves A idle
/// when B hovers. One metre a second on both sides mends that, and close to the pass each drone
/// takes all of it, as the other may not be avoiding.
fn share_of_a(a: &Mover, b: &Mover, tau_s: f32) -> f32 {
    let (speed_a, speed_b) = (a.vel_enu_mps.norm(), b.vel_enu_mps.norm());
    let share = (speed_b + 1.0) / (speed_a + speed_b + 2.0);
    let urgency = within((ALONE_BELOW_S - tau_s) / ALONE_BELOW_S, 0.0, 1.0);
    share + (1.0 - share) * urgency
}

/// Normal to part along and the miss distance counted along it.
///
/// Head-on `l_p` vanishes and its direction is noise, so both must pick a side without talking: `side`
/// is horizontal and to the left of `c`; seen from B `c` and `l_p` change sign both, so the signed miss
/// distance is the same number for both, and each goes to its own left of `c`: opposite ways.
fn passing_side(pass_m: &Vec3, c: &Vec3) -> (Vec3, f32) {
    let side = side_of(c);
    let signed_miss_m = pass_m.dot(&side);
    let vertical_m = libm::fabsf(pass_m.z);
    if signed_miss_m > -HEAD_ON_M && signed_miss_m < HEAD_ON_M && vertical_m < HEAD_ON_M {
        (side, signed_miss_m)
    } else {
        unit_or(*pass_m, || side)
    }
}

/// Horizontal unit vector to the left of `c`; east for a vertical `c`.
fn side_of(c: &Vec3) -> Vec3 {
    let length = libm::sqrtf(c.x * c.x + c.y * c.y);
    if length > 1e-3 { Vec3::new(-c.y / length, c.x / length, 0.0) } else { Vec3::x() }
}

/// Direction and length of `v`, or `fallback` and zero.
fn unit_or(v: Vec3, fallback: impl FnOnce() -> Vec3) -> (Vec3, f32) {
    let length = v.norm();
    if length > 1e-3 { (v / length, length) } else { (fallback(), 0.0) }
}

/// The half-plane of PCA on braking paths: velocities from which both can come to rest without coming too close.
///
/// A change of A's velocity moves its place at the closest approach by `way_s` of it, and by what it flies until the
/// velocity loop has made the change. A takes all of it upon itself, as B may do anything.
fn stop_row(a: &Mover, neighbour: &Neighbour) -> Option<HalfPlane> {
    let v = &a.vel_enu_mps;
    let (closest, keep_m) = braking::meeting(a, v, neighbour, STOP_SPARE_M)?;
    let (normal, distance_m) = unit_or(closest.rel_m, || side_of(&(v - neighbour.mover.vel_enu_mps)));
    // Two that stand in each other's way would stand for ever: each gives way a little to its own left.
    let relative_mps = (v - neighbour.mover.vel_enu_mps).norm();
    let lean = STANDING_LEAN * within(1.0 - relative_mps / STANDING_MPS, 0.0, 1.0);
    let normal = if lean > 0.0 { (normal + side_of(&-normal) * lean).normalize() } else { normal };
    let room_m = distance_m - keep_m - STOP_MORE_M;
    let at_least = normal.dot(v) - room_m / (closest.way_s + SOONEST_S);
    (room_m < STOP_SPARE_M).then_some(HalfPlane { normal, at_least })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mover(pos: [f32; 3], vel: [f32; 3]) -> Mover {
        Mover { pos_enu_m: pos.into(), vel_enu_mps: vel.into() }
    }

    fn arbitrary() -> impl Strategy<Value = Mover> {
        (prop::array::uniform3(-100.0f32..100.0), prop::array::uniform3(-10.0f32..10.0))
            .prop_map(|(p, v)| mover(p, v))
    }

    proptest! {
        /// (9) and (10): the pass vector is orthogonal to c, and no other time comes closer.
        #[test]
        fn closest_approach_is_closest(a in arbitrary(), b in arbitrary(), t in -20.0f32..20.0) {
            let Some(found) = approach(&a, &b) else { return Ok(()) };
            let c = a.vel_enu_mps - b.vel_enu_mps;
            prop_assert!(found.pass_m.dot(&c).abs() < 1e-2 * (1.0 + c.norm_squared()));
            let at_t = (a.pos_enu_m - b.pos_enu_m) + c * t;
            prop_assert!(at_t.norm() >= found.pass_m.norm() - 1e-2);
        }

        /// Both sides of a pair part in opposite directions and together make up the whole displacement.
        #[test]
        fn the_pair_agrees(a in arbitrary(), b in arbitrary()) {
            let collect = |x: &Mover, y: &Mover| {
                let mut found = Vec::new();
                rows(x, &Neighbour { mover: *y, plan_m: 15.0, keep_m: 12.0, part: Part::Share }, |row| found.push(row));
                found
            };
            let (from_a, from_b) = (collect(&a, &b), collect(&b, &a));
            prop_assert_eq!(from_a.len(), from_b.len());
            for (x, y) in from_a.iter().zip(&from_b) {
                prop_assert!((x.normal + y.normal).norm() < 1e-3, "{:?} {:?}", x, y);
            }
            if let (Some(x), Some(y)) = (from_a.get(1), from_b.get(1)) {
                let tau = within(approach(&a, &b).unwrap().tau_s, SOONEST_S, HORIZON_S);
                let push = |row: &HalfPlane, v: &Vec3| row.at_least - row.normal.dot(v);
                let moved_m = (push(x, &a.vel_enu_mps) + push(y, &b.vel_enu_mps)) * tau;
                let miss_m = approach(&a, &b).unwrap().pass_m.norm();
                prop_assert!(moved_m >= (15.0 - miss_m) - 0.05 || miss_m > 15.0);
            }
        }
    }

    #[test]
    fn printed_sign_of_tau_is_mended() {
        let a = mover([0.0, 0.0, 0.0], [10.0, 0.0, 0.0]);
        let b = mover([100.0, 5.0, 0.0], [-10.0, 0.0, 0.0]);
        let found = approach(&a, &b).unwrap();
        assert!((found.tau_s - 5.0).abs() < 1e-5);
        assert!((found.pass_m - Vec3::new(0.0, -5.0, 0.0)).norm() < 1e-4);
    }
}
