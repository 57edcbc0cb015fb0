//! Where the drone should be: lanes with their speed profile, the shared phase along them, the slots
//! of the triangle, and flights to a goal. Each part answers with a [`Reference`]; [`track`] turns a
//! reference into a velocity.

pub mod formation;
pub mod goto;
pub mod lanes;
pub mod zigzag;

use crate::{Vec3, io::NavFix};

/// Gain from position error to corrective velocity, 1/s.
const TRACK_GAIN_PER_S: f32 = 0.8;
/// Greatest corrective velocity, metres a second.
const TRACK_LIMIT_MPS: f32 = 3.0;

/// Gains from the errors of position and velocity to acceleration, 1/s² and 1/s: gusts push a drone aside faster than the
/// autopilot's velocity loop alone makes good. With that loop (1.2 1/s, 0.25 s behind) the whole stays well damped.
const STEADY_GAIN_PER_S2: f32 = 1.0;
const STEADY_GAIN_PER_S: f32 = 1.0;
/// Greatest acceleration against gusts, metres a second squared.
const STEADY_LIMIT_MPS2: f32 = 1.2;

/// A moving point to be at: position, velocity and acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reference {
    /// Position, metres.
    pub pos_enu_m: Vec3,
    /// Velocity, metres a second.
    pub vel_enu_mps: Vec3,
    /// Acceleration, metres a second squared.
    pub accel_enu_mps2: Vec3,
}

impl Reference {
    /// A point at rest.
    #[must_use]
    pub fn at_rest(pos_enu_m: Vec3) -> Self {
        Self { pos_enu_m, ..Self::default() }
    }
}

/// Velocity that follows `reference`: its own velocity and a bounded correction towards it.
#[must_use]
pub fn track(nav: &NavFix, reference: &Reference) -> Vec3 {
    let error = reference.pos_enu_m - nav.pos_enu_m;
    reference.vel_enu_mps + limited(error * TRACK_GAIN_PER_S, TRACK_LIMIT_MPS)
}

/// Acceleration that brings a drone back to `reference` which gusts push off it, beside [`track`].
#[must_use]
pub fn steadying(nav: &NavFix, reference: &Reference) -> Vec3 {
    let error = reference.pos_enu_m - nav.pos_enu_m;
    let slip = reference.vel_enu_mps - nav.vel_enu_mps;
    limited(error * STEADY_GAIN_PER_S2 + slip * STEADY_GAIN_PER_S, STEADY_LIMIT_MPS2)
}

/// `v`, shortened to `limit` where it is longer.
#[must_use]
pub fn limited(v: Vec3, limit: f32) -> Vec3 {
    let length_squared = v.norm_squared();
    if length_squared > limit * limit { v * (limit / libm::sqrtf(length_squared)) } else { v }
}
