//! How fleets stand, fly and turn: what a mission flies and what a sweep plan for other autopilots promises.

pub use crate::control::assemble::{FLEET_DRONES, slot_m};
use crate::{
    control::sweep::CornerModel,
    geometry::{V2, region::Region},
};
use skyroost_firmware::guidance::lanes::{ALONG_ACCEL_MPS2, CORNER_DEVIATION_M, LATERAL_ACCEL_MPS2};
use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};

/// How the flight code takes the corners of a zigzag (`guidance::lanes`) at a cruise speed in metres a second.
#[must_use]
pub fn corners(speed_mps: f64) -> CornerModel {
    // What a right-angled corner is flown at: the arc that leaves the corner by the allowed deviation.
    let fillet_m = f64::from(CORNER_DEVIATION_M) / (SQRT_2 - 1.0);
    CornerModel {
        max_accel_mps2: f64::from(ALONG_ACCEL_MPS2),
        corner_speed_mps: (f64::from(LATERAL_ACCEL_MPS2) * fillet_m).sqrt().min(speed_mps),
    }
}

/// Where slot 0 of a triangle that keeps its orientation points, in (-pi, pi], for a sweep direction in [0, pi):
/// across the lanes, left of that direction, so that a side is parallel to them.
#[must_use]
pub fn fixed_orientation_rad(sweep_direction_rad: f64) -> f64 {
    let angle = sweep_direction_rad + FRAC_PI_2;
    if angle > PI { angle - TAU } else { angle }
}

/// Where the drones stand: each fleet in its triangle, so that it takes off as it will fly, the fleets
/// side by side eastwards from the base, the reserves beyond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pads {
    base_m: V2,
    pitch_m: f64,
}

impl Pads {
    /// Pads so far apart, from a base or else from the area's corner furthest to the south-west.
    #[must_use]
    pub fn new(base_m: Option<V2>, pitch_m: f64, region: &Region) -> Self {
        let south_west = || {
            let corners = region.outer_vertices_m();
            corners.min_by(|a, b| (a.x + a.y).total_cmp(&(b.x + b.y))).unwrap_or_default()
        };
        Self { base_m: base_m.unwrap_or_else(south_west), pitch_m }
    }

    /// Centre of the `index`-th place.
    #[must_use]
    pub fn centre_m(&self, index: usize) -> V2 {
        self.base_m + V2::new(self.pitch_m * index as f64, 0.0)
    }
}
