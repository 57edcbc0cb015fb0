//! The navigation solution that an autopilot hands to the flight code.
//!
//! Position error = a slow part (multipath, satellite geometry, correction age: Gauss-Markov, about a
//! minute) + a small white part. The split matters for localization: the slow part is the same over
//! a pass and does not average out. Velocity comes from Doppler: white, a few cm/s.
//! Collision avoidance is told that every shared state lies within `r_s` of the truth, so the error vector is
//! held inside that declared ball; each time that was necessary is counted.

use crate::geometry::V3;
use crate::rng::{self, Stream};
use crate::world::gauss_markov::{GaussMarkov3, normal3};
use crate::world::{ConfigError, Range, limited, require, ticks_per_update};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

/// Parameters of the navigation error.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GnssConfig {
    /// Standard deviation of the position error, each horizontal axis, both parts together.
    pub sigma_m: f64,
    /// The same, vertical.
    pub sigma_up_m: f64,
    /// Share of the position error's variance that is white.
    pub white_fraction: f64,
    /// Correlation time of the slow part.
    pub tau_s: f64,
    /// Standard deviation of the velocity error, each axis.
    pub velocity_sigma_mps: f64,
    /// The declared radius `r_s` that position errors never leave.
    pub error_bound_m: f64,
    /// The radius that velocity errors never leave.
    pub velocity_error_bound_mps: f64,
}

impl Default for GnssConfig {
    /// [`GnssConfig::rtk`].
    fn default() -> Self {
        Self::rtk()
    }
}

impl GnssConfig {
    /// Real-time kinematic with fixed ambiguities: 2 cm horizontal, 3 cm vertical.
    #[must_use]
    pub fn rtk() -> Self {
        Self {
            sigma_m: 0.02,
            sigma_up_m: 0.03,
            white_fraction: 0.1,
            tau_s: 60.0,
            velocity_sigma_mps: 0.03,
            error_bound_m: 2.0,
            velocity_error_bound_mps: 0.15,
        }
    }

    /// Without corrections: 1.5 m horizontal, 2.5 m vertical. The declared radius must be wider
    /// here (8 m, three standard deviations), and the flight code be configured with it.
    #[must_use]
    pub fn standalone() -> Self {
        Self { sigma_m: 1.5, sigma_up_m: 2.5, white_fraction: 0.01, error_bound_m: 8.0, ..Self::rtk() }
    }

    /// No error at all.
    #[must_use]
    pub fn perfect() -> Self {
        Self { sigma_m: 0.0, sigma_up_m: 0.0, velocity_sigma_mps: 0.0, ..Self::rtk() }
    }

    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("sigma_m", self.sigma_m, Range::NotNegative)?;
        require("sigma_up_m", self.sigma_up_m, Range::NotNegative)?;
        require("white_fraction", self.white_fraction, Range::Probability)?;
        require("tau_s", self.tau_s, Range::Positive)?;
        require("velocity_sigma_mps", self.velocity_sigma_mps, Range::NotNegative)?;
        require("error_bound_m", self.error_bound_m, Range::NotNegative)?;
        require("velocity_error_bound_mps", self.velocity_error_bound_mps, Range::NotNegative)
    }
}

/// What the autopilot believes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Position.
    pub pos_enu_m: V3,
    /// Velocity.
    pub vel_enu_mps: V3,
}

/// The receiver of one vehicle.
#[derive(Clone, Debug)]
pub struct Gnss {
    slow: GaussMarkov3,
    slow_from_m: V3,
    slow_per_tick_m: V3,
    ticks_per_knot: u32,
    tick: u32,
    white_sigma_m: V3,
    velocity_sigma_mps: f64,
    bound_m: f64,
    velocity_bound_mps: f64,
    clamped: u64,
    rng: ChaCha8Rng,
}

/// The slow part is drawn twice a second and runs straight in between: no steps for the flight code to
/// stumble over, at a 25th of the draws. Its variance dips by 0.4 % in the middle (tau = 60 s).
const KNOT_PERIOD_S: f64 = 0.5;

impl Gnss {
    /// The receiver of `vehicle`, read every `dt_s`.
    ///
    /// # Panics
    /// On a config that [`GnssConfig::check`] refuses, or `dt_s` not positive.
    #[must_use]
    pub fn new(config: &GnssConfig, dt_s: f64, seed: u64, vehicle: u64) -> Self {
        assert!(dt_s > 0.0 && config.check().is_ok(), "GNSS parameters are checked where they are read");
        let mut rng = rng::stream(seed, Stream::Gnss, vehicle);
        let sigma_m = V3::new(config.sigma_m, config.sigma_m, config.sigma_up_m);
        let ticks_per_knot = ticks_per_update(KNOT_PERIOD_S.min(0.1 * config.tau_s), dt_s);
        let knot_period_s = f64::from(ticks_per_knot) * dt_s;
        let slow_sigma_m = sigma_m * (1.0 - config.white_fraction).sqrt();
        Self {
            slow: GaussMarkov3::new(slow_sigma_m, config.tau_s, knot_period_s, &mut rng),
            slow_from_m: V3::zeros(),
            slow_per_tick_m: V3::zeros(),
            ticks_per_knot,
            tick: 0,
            white_sigma_m: sigma_m * config.white_fraction.sqrt(),
            velocity_sigma_mps: config.velocity_sigma_mps,
            bound_m: config.error_bound_m,
            velocity_bound_mps: config.velocity_error_bound_mps,
            clamped: 0,
            rng,
        }
    }

    /// The fix for a true position and velocity. Call once per step.
    #[inline]
    pub fn step(&mut self, pos_enu_m: V3, vel_enu_mps: V3) -> Fix {
        if self.tick == 0 {
            self.slow_from_m = self.slow.value();
            let towards_m = self.slow.advance(&mut self.rng);
            self.slow_per_tick_m = (towards_m - self.slow_from_m) / f64::from(self.ticks_per_knot);
        }
        let slow_m = self.slow_from_m + self.slow_per_tick_m * f64::from(self.tick);
        self.tick += 1;
        if self.tick == self.ticks_per_knot {
            self.tick = 0;
        }
        let error_m = slow_m + self.white_sigma_m.component_mul(&normal3(&mut self.rng));
        let velocity_error_mps = normal3(&mut self.rng) * self.velocity_sigma_mps;
        let beyond_bound = error_m.norm_squared() > self.bound_m * self.bound_m
            || velocity_error_mps.norm_squared() > self.velocity_bound_mps * self.velocity_bound_mps;
        self.clamped += u64::from(beyond_bound);
        Fix {
            pos_enu_m: pos_enu_m + limited(error_m, self.bound_m),
            vel_enu_mps: vel_enu_mps + limited(velocity_error_mps, self.velocity_bound_mps),
        }
    }

    /// Fixes whose error had to be held inside its declared radius so far.
    #[must_use]
    pub fn clamped(&self) -> u64 {
        self.clamped
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;
    use proptest::prelude::*;

    /// Errors of `fleet` receivers over `seconds` at 50 Hz, position and velocity.
    fn errors(config: &GnssConfig, fleet: u64, seconds: usize) -> Vec<Vec<(V3, V3)>> {
        let (pos, vel) = (V3::new(5000.0, -300.0, 300.0), V3::new(10.0, 0.0, -1.0));
        let run = |vehicle| {
            let mut gnss = Gnss::new(config, 0.02, 1, vehicle);
            let sample = |_| {
                let fix = gnss.step(pos, vel);
                (fix.pos_enu_m - pos, fix.vel_enu_mps - vel)
            };
            (0..50 * seconds).map(sample).collect()
        };
        (0..fleet).map(run).collect()
    }

    #[test]
    fn truth_moments_of_rtk() {
        let runs = errors(&GnssConfig::rtk(), 20, 2000);
        let all = || runs.iter().flatten();
        for (axis, sigma) in [(0, 0.02), (1, 0.02), (2, 0.03)] {
            let (mean, variance) = moments(all().map(|e| e.0[axis]));
            // 20 x 2000 s hold about 330 independent slow errors: 5.5 % of sigma, 7.8 % of variance.
            assert!(mean.abs() < 0.2 * sigma, "mean {mean}");
            assert!((variance / (sigma * sigma) - 1.0).abs() < 0.25, "variance {variance}");
            let (_, velocity_variance) = moments(all().map(|e| e.1[axis]));
            assert!((velocity_variance.sqrt() / 0.03 - 1.0).abs() < 0.01, "{velocity_variance}");
        }
    }

    #[test]
    fn truth_slow_and_white_parts_have_their_shares() {
        let runs = errors(&GnssConfig::rtk(), 40, 600);
        // Half the mean squared difference over a lag: white variance at once, slow part 1 - exp(-lag/tau).
        let structure = |lag: usize| {
            let differences = |run: &Vec<(V3, V3)>| -> f64 {
                run.iter().zip(&run[lag..]).map(|(a, b)| 0.5 * (a.0.x - b.0.x).powi(2)).sum()
            };
            runs.iter().map(differences).sum::<f64>() / (runs.len() * (runs[0].len() - lag)) as f64
        };
        let (white, slow) = (0.1 * 0.02_f64.powi(2), 0.9 * 0.02_f64.powi(2));
        assert!((structure(1) / white - 1.0).abs() < 0.03, "{}", structure(1) / white);
        let at_tau = white + slow * (1.0 - (-1.0_f64).exp());
        assert!((structure(50 * 60) / at_tau - 1.0).abs() < 0.2, "{}", structure(50 * 60) / at_tau);
    }

    #[test]
    fn the_slow_part_never_steps() {
        let config = GnssConfig { white_fraction: 0.0, ..GnssConfig::standalone() };
        for run in errors(&config, 5, 200) {
            // A knot moves by sigma sqrt(2 * 0.5 / 60) = 0.32 m spread over 25 ticks: 1.3 cm each, times 6.
            assert!(run.windows(2).all(|w| (w[1].0 - w[0].0).xy().norm() < 0.08));
        }
    }

    #[test]
    fn rtk_hardly_ever_needs_its_bounds_and_perfect_never_errs() {
        let mut rtk = Gnss::new(&GnssConfig::rtk(), 0.02, 1, 0);
        let mut perfect = Gnss::new(&GnssConfig::perfect(), 0.02, 1, 0);
        let (pos, vel) = (V3::new(1.0, 2.0, 3.0), V3::zeros());
        for _ in 0..100_000 {
            let _ = rtk.step(pos, vel);
            assert_eq!(perfect.step(pos, vel), Fix { pos_enu_m: pos, vel_enu_mps: vel });
        }
        // |N(0, 0.03^2 I)| > 0.15 has the chi tail P(chi_3 > 5) = 1.5e-5.
        assert!(rtk.clamped() < 10, "{}", rtk.clamped());
        assert_eq!(perfect.clamped(), 0);
    }

    proptest! {
        #[test]
        fn errors_stay_inside_their_bounds(
            seed: u64, sigma_m in 0.0..5.0_f64, bound_m in 0.0..4.0_f64, velocity_sigma_mps in 0.0..0.5_f64,
        ) {
            let config =
                GnssConfig { sigma_m, error_bound_m: bound_m, velocity_sigma_mps, ..GnssConfig::standalone() };
            let mut gnss = Gnss::new(&config, 0.02, seed, 0);
            let mut at_bound = 0;
            for _ in 0..200 {
                let fix = gnss.step(V3::zeros(), V3::zeros());
                prop_assert!(fix.pos_enu_m.norm() <= bound_m * (1.0 + 1e-12));
                prop_assert!(fix.vel_enu_mps.norm() <= 0.15 * (1.0 + 1e-12));
                at_bound += u64::from(
                    fix.pos_enu_m.norm() >= bound_m * (1.0 - 1e-12)
                        || fix.vel_enu_mps.norm() >= 0.15 * (1.0 - 1e-12),
                );
            }
            prop_assert_eq!(gnss.clamped(), at_bound);
        }
    }
}
