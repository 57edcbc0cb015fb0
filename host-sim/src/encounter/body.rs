//! A point that accelerates: the vehicle of an encounter.

use crate::geometry::V3;

/// Time constant of the velocity loop, seconds.
const LOOP_S: f64 = 0.4;
/// Fastest climb and descent, metres a second.
pub(super) const VERTICAL_MPS: f64 = 3.0;
/// The hard limit of the speed, in cruise speeds.
const HARD_LIMIT: f64 = 1.2;

/// Position and velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Body {
    pub(super) pos_m: V3,
    pub(super) vel_mps: V3,
}

/// What it can do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ability {
    pub(super) accel_mps2: f64,
    pub(super) speed_mps: f64,
}

impl Body {
    /// Follows a commanded velocity for a step. Returns the velocity change, for distances in between.
    pub(super) fn step(&mut self, command_mps: V3, ability: Ability, dt_s: f64) {
        let wanted = (command_mps - self.vel_mps) / LOOP_S.max(dt_s);
        let accel = wanted * (ability.accel_mps2 / wanted.norm().max(ability.accel_mps2));
        let mut next = self.vel_mps + accel * dt_s;
        next.z = next.z.clamp(-VERTICAL_MPS, VERTICAL_MPS);
        let hard_mps = HARD_LIMIT * ability.speed_mps;
        next *= hard_mps / next.norm().max(hard_mps);
        self.pos_m += (self.vel_mps + next) * (0.5 * dt_s);
        self.vel_mps = next;
    }
}

/// Least distance of two bodies while both go straight from one state to the next.
pub(super) fn least_distance_m(from: [V3; 2], to: [V3; 2]) -> f64 {
    let (l, c) = (from[0] - from[1], (to[0] - to[1]) - (from[0] - from[1]));
    let square = c.norm_squared();
    let share = if square > 0.0 { (-l.dot(&c) / square).clamp(0.0, 1.0) } else { 0.0 };
    (l + c * share).norm()
}
