//! Wind: one mean for all, and gusts of each vehicle's own.
//!
//! The gusts are the Dryden turbulence of MIL-F-8785C (1980), 3.7.1, flown through at constant speed V:
//! its longitudinal spectrum sigma^2 (2 L / pi V) / (1 + (L w / V)^2) is that of a first-order
//! Gauss-Markov process with tau = L / V. The transverse spectra are of second order there; they are
//! taken as first-order too, which keeps their variance and bandwidth. Spatial correlation between
//! vehicles is left out: drones of a fleet are 50 m apart, and independent gusts are the harder case
//! for a formation. The specification's length of some 300 m at 300 m height gives tau = 30 s at 10 m/s; the
//! default of 4 s stands for the rougher air behind buildings and leaves the autopilot less time.

use crate::geometry::V3;
use crate::rng::{self, Stream};
use crate::world::gauss_markov::GaussMarkov3;
use crate::world::{ConfigError, Range, require, ticks_per_update};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

/// Parameters of the wind.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WindConfig {
    /// Speed of the mean wind.
    pub mean_mps: f64,
    /// Where the mean wind blows **to**, from east, anticlockwise.
    pub towards_rad: f64,
    /// Standard deviation of the gusts, each horizontal axis.
    pub gust_sigma_mps: f64,
    /// Standard deviation of the gusts, vertical.
    pub gust_sigma_up_mps: f64,
    /// Correlation time of the gusts.
    pub gust_tau_s: f64,
    /// How often the gusts are drawn; held in between. Keep it well below `gust_tau_s`.
    pub update_period_s: f64,
}

impl Default for WindConfig {
    fn default() -> Self {
        Self {
            mean_mps: 3.0,
            towards_rad: std::f64::consts::FRAC_PI_4,
            gust_sigma_mps: 1.0,
            gust_sigma_up_mps: 0.5,
            gust_tau_s: 4.0,
            update_period_s: 0.1,
        }
    }
}

impl WindConfig {
    /// No air moves.
    #[must_use]
    pub fn calm() -> Self {
        Self { mean_mps: 0.0, gust_sigma_mps: 0.0, gust_sigma_up_mps: 0.0, ..Self::default() }
    }

    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("mean_mps", self.mean_mps, Range::NotNegative)?;
        require("towards_rad", self.towards_rad, Range::Finite)?;
        require("gust_sigma_mps", self.gust_sigma_mps, Range::NotNegative)?;
        require("gust_sigma_up_mps", self.gust_sigma_up_mps, Range::NotNegative)?;
        require("gust_tau_s", self.gust_tau_s, Range::Positive)?;
        require("update_period_s", self.update_period_s, Range::Positive)
    }

    /// The mean wind, ENU.
    #[must_use]
    pub fn mean_enu_mps(&self) -> V3 {
        let (sin, cos) = self.towards_rad.sin_cos();
        V3::new(cos, sin, 0.0) * self.mean_mps
    }
}

/// The wind at one vehicle.
#[derive(Clone, Debug)]
pub struct Wind {
    mean_enu_mps: V3,
    gusts: GaussMarkov3,
    now_enu_mps: V3,
    ticks_per_update: u32,
    ticks_left: u32,
    rng: ChaCha8Rng,
}

impl Wind {
    /// The wind at `vehicle`, read every `dt_s`.
    ///
    /// # Panics
    /// On a config that [`WindConfig::check`] refuses, or `dt_s` not positive.
    #[must_use]
    pub fn new(config: &WindConfig, dt_s: f64, seed: u64, vehicle: u64) -> Self {
        assert!(dt_s > 0.0 && config.check().is_ok(), "wind parameters are checked where they are read");
        let mut rng = rng::stream(seed, Stream::Wind, vehicle);
        let ticks_per_update = ticks_per_update(config.update_period_s, dt_s);
        let sigma = V3::new(config.gust_sigma_mps, config.gust_sigma_mps, config.gust_sigma_up_mps);
        let gusts = GaussMarkov3::new(sigma, config.gust_tau_s, f64::from(ticks_per_update) * dt_s, &mut rng);
        let mean_enu_mps = config.mean_enu_mps();
        let now_enu_mps = mean_enu_mps + gusts.value();
        Self { mean_enu_mps, gusts, now_enu_mps, ticks_per_update, ticks_left: ticks_per_update, rng }
    }

    /// The wind over the next `dt_s`, ENU. Call once per step.
    #[inline]
    pub fn step(&mut self) -> V3 {
        if self.ticks_left == 0 {
            self.ticks_left = self.ticks_per_update;
            self.now_enu_mps = self.mean_enu_mps + self.gusts.advance(&mut self.rng);
        }
        self.ticks_left -= 1;
        self.now_enu_mps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;

    #[test]
    fn truth_moments_and_correlation_of_the_default() {
        let config = WindConfig::default();
        let mut wind = Wind::new(&config, 0.02, 1, 3);
        let samples: Vec<V3> = (0..50 * 40_000).map(|_| wind.step()).collect();
        for (axis, sigma) in [(0, 1.0), (1, 1.0), (2, 0.5)] {
            let (mean, variance) = moments(samples.iter().map(|w| w[axis]));
            // 40,000 s hold about 5,000 independent gusts.
            assert!((mean - config.mean_enu_mps()[axis]).abs() < 0.06 * sigma, "axis {axis} mean {mean}");
            assert!((variance.sqrt() / sigma - 1.0).abs() < 0.04, "axis {axis} variance {variance}");
            let lag = 200; // 4 s, one correlation time
            let gust = |w: &V3| w[axis] - mean;
            let lagged = samples.iter().zip(&samples[lag..]).map(|(a, b)| gust(a) * gust(b)).sum::<f64>();
            let correlation = lagged / (samples.len() - lag) as f64 / variance;
            assert!((correlation - (-1.0_f64).exp()).abs() < 0.07, "axis {axis} at one tau {correlation}");
        }
        assert!((config.mean_enu_mps().norm() - 3.0).abs() < 1e-12);
    }

    #[test]
    fn gusts_are_held_between_updates_and_differ_between_vehicles() {
        let config = WindConfig::default();
        let (mut a, mut b) = (Wind::new(&config, 0.02, 1, 0), Wind::new(&config, 0.02, 1, 1));
        let held: Vec<V3> = (0..50).map(|_| a.step()).collect();
        for five in held.chunks(5) {
            assert!(five.iter().all(|w| *w == five[0]));
        }
        assert!(held.windows(2).filter(|w| w[0] != w[1]).count() == 9);
        assert!(b.step() != held[0]);
    }

    #[test]
    fn calm_air_is_still_and_bad_parameters_are_named() {
        let mut wind = Wind::new(&WindConfig::calm(), 0.02, 1, 0);
        assert!((0..100).all(|_| wind.step() == V3::zeros()));
        let bad = WindConfig { gust_tau_s: 0.0, ..WindConfig::default() };
        assert_eq!(bad.check().unwrap_err().field, "gust_tau_s");
    }
}
