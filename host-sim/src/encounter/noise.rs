//! Errors of positions and velocities, and losses of shared states: by the interface of encounters.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::geometry::V3;

/// Shares of `r_s` that are constant and that are drawn anew.
const BIAS: f64 = 0.7;
const WHITE: f64 = 0.3;
/// Radius of the error of a velocity, m/s.
const VELOCITY_MPS: f64 = 0.15;

/// How positions err. Velocities err at random under every model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseModel {
    /// By a constant and a white part, each uniform in a ball.
    #[default]
    Uniform,
    /// By the whole of `r_s`, away from the nearest neighbour: everybody seems, and believes to be, farther off than it is.
    Adversarial,
    /// So err the positions that are shared, while everybody knows exactly where it is itself.
    AdversarialShared,
}

/// Random numbers of one vehicle.
pub(super) struct Noise {
    model: NoiseModel,
    rng: ChaCha8Rng,
    r_s_m: f64,
    bias_m: V3,
    /// Unit vector away from the nearest neighbour; zero without one.
    away: V3,
}

impl Noise {
    /// Of a vehicle; what it draws does not depend on how many others there are.
    pub(super) fn new(model: NoiseModel, seed: u64, vehicle: u16, r_s_m: f64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::from(vehicle));
        let mut noise = Self { model, rng, r_s_m, bias_m: V3::zeros(), away: V3::zeros() };
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

    /// Says where the nearest neighbour is: the way from there to here, metres.
    pub(super) fn nearest(&mut self, way_m: Option<V3>) {
        self.away = way_m.and_then(|way_m| way_m.try_normalize(0.0)).unwrap_or_default();
    }

    /// A position as the vehicle itself measures it.
    pub(super) fn position(&mut self, true_m: V3) -> V3 {
        if self.model == NoiseModel::AdversarialShared { true_m } else { self.shared_position(true_m) }
    }

    /// A position as the vehicle tells it.
    pub(super) fn shared_position(&mut self, true_m: V3) -> V3 {
        match self.model {
            _ if self.r_s_m <= 0.0 => true_m,
            NoiseModel::Uniform => true_m + self.bias_m + self.in_ball() * (WHITE * self.r_s_m),
            NoiseModel::Adversarial | NoiseModel::AdversarialShared => true_m + self.away * self.r_s_m,
        }
    }

    /// A velocity as it is measured.
    pub(super) fn velocity(&mut self, true_mps: V3) -> V3 {
        if self.r_s_m <= 0.0 { true_mps } else { true_mps + self.in_ball() * VELOCITY_MPS }
    }
}
