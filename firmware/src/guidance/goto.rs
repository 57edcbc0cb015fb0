//! Flights to a goal and holding there.

use super::limited;
use crate::{
    Vec3,
    scalar::{greater, lesser, within},
};

/// Braking towards the goal, metres a second squared: below what the airframe can do, as avoidance
/// and wind want their share.
const BRAKE_MPS2: f32 = 1.2;
/// Gain close to the goal, 1/s.
const NEAR_GAIN_PER_S: f32 = 0.8;

/// Distance below which a goal counts as reached, metres.
pub const ARRIVED_M: f32 = 2.0;
/// Speed below which a goal counts as reached, metres a second.
pub const ARRIVED_MPS: f32 = 0.5;

/// Velocity towards `goal_m`: straight, at most `speed_mps` over ground and `vertical_mps` up or
/// down, braking in time to stop there.
#[must_use]
pub fn velocity(pos_enu_m: &Vec3, goal_enu_m: &Vec3, speed_mps: f32, vertical_mps: f32) -> Vec3 {
    let way = goal_enu_m - pos_enu_m;
    let horizontal = Vec3::new(way.x, way.y, 0.0);
    let distance = horizontal.norm();
    let mut v = Vec3::zeros();
    if distance > 0.0 {
        let braking = lesser(libm::sqrtf(2.0 * BRAKE_MPS2 * distance), NEAR_GAIN_PER_S * distance);
        v = horizontal * (lesser(braking, speed_mps) / distance);
    }
    v.z = within(NEAR_GAIN_PER_S * way.z, -vertical_mps, vertical_mps);
    limited(v, greater(speed_mps, vertical_mps))
}

/// How far before a goal a flight at this speed begins to brake, metres.
#[must_use]
pub fn braking_m(speed_mps: f32) -> f32 {
    greater(speed_mps * speed_mps / (2.0 * BRAKE_MPS2), speed_mps / NEAR_GAIN_PER_S)
}

/// Whether a goal is reached.
#[must_use]
pub fn arrived(pos_enu_m: &Vec3, vel_enu_mps: &Vec3, goal_enu_m: &Vec3) -> bool {
    (goal_enu_m - pos_enu_m).norm_squared() < ARRIVED_M * ARRIVED_M
        && vel_enu_mps.norm_squared() < ARRIVED_MPS * ARRIVED_MPS
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// From anywhere the goal is reached, never faster than allowed.
        #[test]
        fn every_goal_is_reached(e in -500.0f32..500.0, n in -500.0f32..500.0, u in -100.0f32..100.0) {
            let goal = Vec3::new(e, n, u);
            let (mut pos, mut vel) = (Vec3::zeros(), Vec3::zeros());
            for _ in 0..20_000 {
                vel = velocity(&pos, &goal, 10.0, 3.0);
                prop_assert!(vel.norm() <= 10.0 * 1.0001);
                prop_assert!(vel.z.abs() <= 3.0);
                pos += vel * crate::STEP_S;
            }
            prop_assert!(arrived(&pos, &vel, &goal));
        }
    }
}
