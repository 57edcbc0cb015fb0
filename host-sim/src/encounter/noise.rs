//! Errors of positions and velocities, and losses of shared states: by the interface of encounters.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use crate::geometry::V3;

/// Shares of `r_s` that are constant and that are drawn anew.
const BIAS: f64 = 0.7;
const WHITE: f64 = 0.3;
/// Radius of the error of a velocity, m/s.
const VELOCITY_MPS: f64 = 0.15;

/// Random numbers of one vehicle.
pub(super) struct Noise {
    rng: ChaCha8Rng,
    r_s_m: f64,
    bias_m: V3,
}

impl Noise {
    /// Of a vehicle; what it draws does not depend on how many others there are.
    pub(super) fn new(seed: u64, vehicle: u16, r_s_m: f64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::from(vehicle));
        let mut noise = Self { rng, r_s_m, bias_m: V3::zeros() };
        noise.bias_m = noise.in_ball() * (BIAS * r_s_m);
        noise
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in the unit ball.
    fn in_ball(&mut self) -> V3 {
        loop {
            let v = V3::from_fn(|_, _| 2.0 * self.unit() - 1.0);
            if v.norm_squared() <= 1.0 {
                return v;
            }
        }
    }

    /// A position as it is measured.
    pub(super) fn position(&mut self, true_m: V3) -> V3 {
        if self.r_s_m <= 0.0 {
            return true_m;
        }
        true_m + self.bias_m + self.in_ball() * (WHITE * self.r_s_m)
    }

    /// A velocity as it is measured.
    pub(super) fn velocity(&mut self, true_mps: V3) -> V3 {
        if self.r_s_m <= 0.0 { true_mps } else { true_mps + self.in_ball() * VELOCITY_MPS }
    }
}
