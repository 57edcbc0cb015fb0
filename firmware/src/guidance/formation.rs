//! Slots of the equilateral triangle (paper section 2: three drones, mutual distance `d`).
//!
//! A slot is a function of the track alone, the same for all three drones: nobody follows a leader,
//! so one drone's error does not shake the others.

use super::lanes::TrackPoint;
use crate::{Vec2, guidance::Reference, scalar::sin_cos};
use skyroost_protocol::message::Heading;

/// `2 pi / 3`.
const THIRD_TURN_RAD: f32 = 2.094_395_1;
/// `1 / sqrt(3)`: from side to circumradius of an equilateral triangle.
const INV_SQRT_3: f32 = 0.577_350_26;

/// One drone's place in the triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slot {
    /// From the triangle's centre to the slot at heading zero, metres.
    offset_m: Vec2,
    heading: Heading,
}

impl Slot {
    /// Slot `number` (0 to 2, anticlockwise) of a triangle with side `spacing_m`, whose slot 0 lies in
    /// direction `orientation_rad` from the centre (from east, or from the track for
    /// [`Heading::AlongTrack`]).
    #[must_use]
    pub fn new(number: u8, spacing_m: f32, orientation_rad: f32, heading: Heading) -> Self {
        let (sin, cos) = sin_cos(orientation_rad + f32::from(number) * THIRD_TURN_RAD);
        Self { offset_m: Vec2::new(cos, sin) * (spacing_m * INV_SQRT_3), heading }
    }

    /// Where this slot is, and moves, when the centre is at `track`, moving along it at `speed_mps`
    /// with `accel_mps2`, at `altitude_m`.
    #[must_use]
    pub fn reference(
        &self,
        track: &TrackPoint,
        speed_mps: f32,
        accel_mps2: f32,
        altitude_m: f32,
    ) -> Reference {
        let left = Vec2::new(-track.along.y, track.along.x);
        let turn_rate = speed_mps * track.curvature_per_m;
        let mut pos = track.pos_m;
        let mut vel = track.along * speed_mps;
        let mut accel = track.along * accel_mps2 + left * (speed_mps * turn_rate);
        match self.heading {
            Heading::Fixed => pos += self.offset_m,
            Heading::AlongTrack => {
                let arm = track.along * self.offset_m.x + left * self.offset_m.y;
                pos += arm;
                vel += Vec2::new(-arm.y, arm.x) * turn_rate;
                accel -= arm * (turn_rate * turn_rate);
            }
        }
        Reference {
            pos_enu_m: pos.push(altitude_m),
            vel_enu_mps: vel.push(0.0),
            accel_enu_mps2: accel.push(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The three slots stay `d` apart at every heading, and their velocity is the derivative of
        /// their position.
        #[test]
        fn the_triangle_is_rigid(d in 5.0f32..200.0, orientation in -3.0f32..3.0, heading in -3.0f32..3.0,
                                 curvature in -0.02f32..0.02, speed in 0.0f32..10.0, along_track: bool) {
            let mode = if along_track { Heading::AlongTrack } else { Heading::Fixed };
            let at = |dt: f32| {
                let angle = heading + curvature * speed * dt;
                let mid = heading + curvature * speed * dt * 0.5;
                let along = Vec2::new(libm::cosf(angle), libm::sinf(angle));
                let pos_m = Vec2::new(libm::cosf(mid), libm::sinf(mid)) * (speed * dt);
                TrackPoint { pos_m, along, curvature_per_m: curvature, speed_limit_mps: 10.0 }
            };
            let slots = [0, 1, 2].map(|k| Slot::new(k, d, orientation, mode));
            let now = slots.map(|s| s.reference(&at(0.0), speed, 0.0, 300.0));
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let side = (now[a].pos_enu_m - now[b].pos_enu_m).norm();
                prop_assert!((side - d).abs() < 1e-3 * d, "side {} for d {}", side, d);
            }
            let next = slots.map(|s| s.reference(&at(0.1), speed, 0.0, 300.0));
            for k in 0..3 {
                let rate = (next[k].pos_enu_m - now[k].pos_enu_m) / 0.1;
                let mean = (next[k].vel_enu_mps + now[k].vel_enu_mps) * 0.5;
                prop_assert!((rate - mean).norm() < 0.02, "{} vs {}", rate, mean);
            }
        }
    }
}
