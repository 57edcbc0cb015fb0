//! The pulse per second of a drone's navigation receiver.
//!
//! A pulse comes at its second but for white noise; now and then one fails, or comes far off. Receivers round
//! pulses to their own clock (some 10 ns, u-blox UBX-18010854, time pulse accuracy), which is within the noise.

use crate::rng::{self, Stream};
use crate::world::{ConfigError, Range, require};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

const PS_PER_S: i64 = 1_000_000_000_000;
/// A pulse far off is so by up to this, either way.
const OUTLIER_NS: f64 = 1e6;
/// A pulse is handed over this long after its second: by then it has come, however far off.
const HANDED_OVER_PS: i64 = 2_000_000_000;

/// Parameters of the pulses.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PpsConfig {
    /// Standard deviation of a pulse's time; 0 for a receiver without pulses.
    pub sigma_ns: f64,
    /// Probability that a pulse fails.
    pub loss: f64,
    /// Probability that a pulse is off by up to a millisecond.
    pub outlier: f64,
}

impl Default for PpsConfig {
    fn default() -> Self {
        Self { sigma_ns: 20.0, loss: 0.0, outlier: 0.0 }
    }
}

impl PpsConfig {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("sigma_ns", self.sigma_ns, Range::NotNegative)?;
        require("loss", self.loss, Range::Probability)?;
        require("outlier", self.outlier, Range::Probability)
    }
}

/// A pulse that came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TruePulse {
    /// The second that it marks.
    pub second: i64,
    /// True time at which it came.
    pub true_ps: i64,
}

/// The pulses of one receiver.
#[derive(Clone, Debug)]
pub struct Pps {
    config: PpsConfig,
    /// The next second to come: from 1 on, as one at 0 may come before time begins.
    second: i64,
    rng: ChaCha8Rng,
}

impl Pps {
    /// The pulses of `drone`'s receiver.
    ///
    /// # Panics
    /// On a config that [`PpsConfig::check`] refuses.
    #[must_use]
    pub fn new(config: PpsConfig, seed: u64, drone: u64) -> Self {
        assert!(config.check().is_ok(), "pulse parameters are checked where they are read");
        Self { config, second: 1, rng: rng::stream(seed, Stream::Pps, drone) }
    }

    /// The pulse that came since the last question, asked in order of time and more than once a second.
    pub fn pulse(&mut self, now_ps: i64) -> Option<TruePulse> {
        if self.config.sigma_ns <= 0.0 || now_ps < self.second * PS_PER_S + HANDED_OVER_PS {
            return None;
        }
        let second = self.second;
        self.second += 1;
        // As many draws for every second, so that losses move nothing else.
        let lost = rng::chance(&mut self.rng, self.config.loss);
        let outlier = rng::chance(&mut self.rng, self.config.outlier);
        let far_ns = rng::uniform(&mut self.rng, -OUTLIER_NS, OUTLIER_NS);
        let off_ns = self.config.sigma_ns * rng::normal(&mut self.rng) + if outlier { far_ns } else { 0.0 };
        (!lost).then(|| TruePulse { second, true_ps: second * PS_PER_S + (1e3 * off_ns).round() as i64 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;

    fn pulses(config: PpsConfig, seconds: i64) -> Vec<TruePulse> {
        let mut pps = Pps::new(config, 1, 3);
        (0..50 * seconds).filter_map(|step| pps.pulse(step * PS_PER_S / 50)).collect()
    }

    fn off_ns(pulses: &[TruePulse]) -> impl Iterator<Item = f64> + Clone {
        pulses.iter().map(|pulse| (pulse.true_ps - pulse.second * PS_PER_S) as f64 * 1e-3)
    }

    #[test]
    fn truth_one_a_second_with_the_noise_stated() {
        let pulses = pulses(PpsConfig { sigma_ns: 30.0, ..PpsConfig::default() }, 20_000);
        assert!(pulses.iter().map(|pulse| pulse.second).eq(1..20_000));
        let (mean, variance) = moments(off_ns(&pulses));
        assert!(mean.abs() < 4.0 * 30.0 / 141.0, "{mean}");
        assert!((variance / 900.0 - 1.0).abs() < 4.0 * (2.0 / 20_000_f64).sqrt(), "{variance}");
    }

    #[test]
    fn truth_losses_and_outliers_come_at_their_rates_and_leave_the_rest_alone() {
        let config = PpsConfig { sigma_ns: 10.0, loss: 0.2, outlier: 0.1 };
        let some = pulses(config, 10_000);
        assert!((some.len() as f64 - 8_000.0).abs() < 4.0 * 40.0, "{}", some.len());
        let far = off_ns(&some).filter(|ns| ns.abs() > 100.0).count();
        assert!((far as f64 - 800.0).abs() < 4.0 * 28.0, "{far}");
        let all = pulses(PpsConfig { sigma_ns: 10.0, ..PpsConfig::default() }, 10_000);
        let near = some.iter().filter(|pulse| off_ns(&[**pulse]).all(|ns| ns.abs() < 100.0));
        let unmoved = near.filter(|pulse| all[pulse.second as usize - 1] == **pulse).count();
        assert!(unmoved > 7_000, "{unmoved}: those that came are those of a receiver without losses");
    }

    #[test]
    fn a_receiver_without_pulses_has_none() {
        assert_eq!(pulses(PpsConfig { sigma_ns: 0.0, ..PpsConfig::default() }, 100), []);
    }
}
