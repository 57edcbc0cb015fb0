//! The oscillator of one drone: what its counters show at a true time.
//!
//! local = true + offset + drift * true + walk. The walk is white frequency noise: increments over `t` have
//! the variance `walk^2 t`, hence the Allan deviation `walk / sqrt(t)` (IEEE 1139; Riley, NIST SP 1065,
//! table 3). It is drawn on a grid of 0.1 s and runs straight in between, which leaves out at most
//! walk sqrt(0.1 s / 4) = 0.016 ns of it, far below the 1 ns of a capture.
//! Time is integer picoseconds; only the clock's *error* (below 0.1 ms in hours) is ever a float.

use crate::rng::{self, Stream};
use crate::world::{ConfigError, Range, require};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

/// Rate of the capture counter: ticks of 2 Tc = 1.017 ns, the report mapping k = 1 of 3GPP TS 38.133, 13.1
/// (Tc = 1 / (480 kHz * 4096), TS 38.211, 4.1).
pub const CAPTURE_TICK_HZ: u64 = 983_040_000;

/// Grid on which the random walk is drawn.
const GRID_PS: i64 = 100_000_000_000;

/// Parameters of the oscillators.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClockConfig {
    /// Offsets at the start are uniform within plus and minus this.
    pub offset_ns: f64,
    /// Drifts are constant, uniform within plus and minus this.
    pub drift_ns_per_s: f64,
    /// Random walk of the time, per square root of a second.
    pub walk_ns_per_sqrt_s: f64,
}

impl Default for ClockConfig {
    fn default() -> Self {
        Self { offset_ns: 200.0, drift_ns_per_s: 5.0, walk_ns_per_sqrt_s: 0.1 }
    }
}

impl ClockConfig {
    /// Clocks that all show true time.
    #[must_use]
    pub fn perfect() -> Self {
        Self { offset_ns: 0.0, drift_ns_per_s: 0.0, walk_ns_per_sqrt_s: 0.0 }
    }

    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("offset_ns", self.offset_ns, Range::NotNegative)?;
        require("drift_ns_per_s", self.drift_ns_per_s, Range::NotNegative)?;
        require("walk_ns_per_sqrt_s", self.walk_ns_per_sqrt_s, Range::NotNegative)
    }
}

/// The clock of one drone.
///
/// Questions come in time order, give or take [`Clock::LOOK_BACK_PS`]: the captures of one second may be
/// asked about in any order. Each costs O(1), and the answers do not depend on which are asked.
#[derive(Clone, Debug)]
pub struct Clock {
    offset_ps: f64,
    drift: f64,
    step_sigma_ps: f64,
    /// Start of the present cell of the grid.
    cell_ps: i64,
    /// The walk at the start of the cell before, at the start of the present one, and at its end.
    walk_ps: [f64; 3],
    rng: ChaCha8Rng,
}

impl Clock {
    /// How far a question may lie before the latest one.
    pub const LOOK_BACK_PS: i64 = GRID_PS;

    /// The clock of `drone`.
    ///
    /// # Panics
    /// On a config that [`ClockConfig::check`] refuses.
    #[must_use]
    pub fn new(config: &ClockConfig, seed: u64, drone: u64) -> Self {
        assert!(config.check().is_ok(), "clock parameters are checked where they are read");
        let mut rng = rng::stream(seed, Stream::Clock, drone);
        let offset_ps = 1e3 * rng::uniform(&mut rng, -config.offset_ns, config.offset_ns);
        let drift = 1e-9 * rng::uniform(&mut rng, -config.drift_ns_per_s, config.drift_ns_per_s);
        let step_sigma_ps = 1e3 * config.walk_ns_per_sqrt_s * (GRID_PS as f64 * 1e-12).sqrt();
        let first_step_ps = step_sigma_ps * rng::normal(&mut rng);
        Self { offset_ps, drift, step_sigma_ps, cell_ps: 0, walk_ps: [0.0, 0.0, first_step_ps], rng }
    }

    /// From now on the clock is so much further ahead.
    pub fn jump(&mut self, ahead_ps: f64) {
        self.offset_ps += ahead_ps;
    }

    /// How far the clock is ahead of true time, picoseconds.
    ///
    /// # Panics
    /// If `true_ps` is negative or lies more than [`Clock::LOOK_BACK_PS`] before an earlier question.
    pub fn error_ps(&mut self, true_ps: i64) -> f64 {
        assert!(true_ps >= 0 && true_ps >= self.cell_ps - GRID_PS, "a clock is read forwards: {true_ps} ps");
        while true_ps >= self.cell_ps + GRID_PS {
            let [_, start, end] = self.walk_ps;
            self.walk_ps = [start, end, end + self.step_sigma_ps * rng::normal(&mut self.rng)];
            self.cell_ps += GRID_PS;
        }
        let [before, start, end] = self.walk_ps;
        let in_cells = (true_ps - self.cell_ps) as f64 / GRID_PS as f64;
        let towards = if in_cells < 0.0 { start - before } else { end - start };
        self.offset_ps + self.drift * true_ps as f64 + start + towards * in_cells
    }

    /// Local time, picoseconds, rounded to the nearest. Never decreases with true time while the clock's
    /// rate error is below one half.
    ///
    /// # Panics
    /// As [`Clock::error_ps`].
    pub fn local_ps(&mut self, true_ps: i64) -> i64 {
        true_ps + self.error_ps(true_ps).round() as i64
    }

    /// The counter of `tick_hz` at a true time: whole ticks of local time. A clock that is behind shows
    /// the two's complement of a negative count in its first moments, as a 64-bit counter does; the low
    /// 32 bits (`as u32`) are what a 32-bit timer shows.
    ///
    /// # Panics
    /// As [`Clock::error_ps`].
    pub fn ticks(&mut self, true_ps: i64, tick_hz: u64) -> u64 {
        ticks_of_ps(self.local_ps(true_ps), tick_hz) as u64
    }

    /// The clock's rate error in seconds per second, the truth for an estimator of drifts.
    #[must_use]
    pub fn drift(&self) -> f64 {
        self.drift
    }
}

/// floor(`local_ps` * `tick_hz` / 10^12), exactly: a long division in base 10^6 whose every step fits 64
/// bits up to 10 GHz (an i128 division would cost ten times as much).
fn ticks_of_ps(local_ps: i64, tick_hz: u64) -> i64 {
    const MILLION: i64 = 1_000_000;
    let hz = tick_hz as i64;
    let (us, ps) = (local_ps.div_euclid(MILLION), local_ps.rem_euclid(MILLION));
    let (s, us) = (us.div_euclid(MILLION), us.rem_euclid(MILLION));
    let in_us = us * hz;
    s * hz + in_us / MILLION + (in_us % MILLION * MILLION + ps * hz) / (MILLION * MILLION)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;
    use proptest::prelude::*;

    const S: i64 = 1_000_000_000_000;

    #[test]
    fn truth_offsets_and_drifts_are_uniform() {
        let clocks: Vec<Clock> = (0..4000).map(|i| Clock::new(&ClockConfig::default(), 1, i)).collect();
        let offsets_ns = || clocks.iter().map(|c| c.offset_ps / 1e3);
        let drifts_ns = || clocks.iter().map(|c| c.drift() * 1e9);
        for ((mean, variance), half_width) in [(moments(offsets_ns()), 200.0), (moments(drifts_ns()), 5.0)] {
            let expected = half_width * half_width / 3.0;
            assert!(mean.abs() < 4.0 * (expected / 4000.0_f64).sqrt(), "{mean}");
            // The variance of a uniform sample has a relative standard error of sqrt(0.8 / n).
            assert!((variance / expected - 1.0).abs() < 0.06, "{variance}");
        }
        assert!(offsets_ns().all(|o| o.abs() <= 200.0) && drifts_ns().all(|d| d.abs() <= 5.0));
    }

    #[test]
    fn truth_walk_has_the_allan_deviation_of_white_frequency_noise() {
        for tau_s in [1, 10, 100] {
            // Second differences of time cancel offset and drift (Riley, NIST SP 1065, eq. 10).
            let mut squares = Vec::new();
            for drone in 0..400 {
                let mut clock = Clock::new(&ClockConfig::default(), 9, drone);
                let x: Vec<f64> = (0..21).map(|i| clock.error_ps(i * tau_s * S) * 1e-3).collect();
                squares.extend(x.windows(3).step_by(2).map(|x| (x[2] - 2.0 * x[1] + x[0]).powi(2) / 2.0));
            }
            let allan_variance = squares.iter().sum::<f64>() / squares.len() as f64 / (tau_s * tau_s) as f64;
            let expected = 0.01 / tau_s as f64;
            // 4000 independent second differences: 2.2 % standard error.
            assert!(
                (allan_variance / expected - 1.0).abs() < 0.1,
                "tau {tau_s}: {allan_variance} {expected}"
            );
        }
    }

    #[test]
    fn truth_walk_spreads_as_the_square_root_of_time() {
        let config = ClockConfig { offset_ns: 0.0, drift_ns_per_s: 0.0, ..ClockConfig::default() };
        for t_s in [1, 25, 400] {
            let errors = (0..4000).map(|drone| Clock::new(&config, 3, drone).error_ps(t_s * S) * 1e-3);
            let (mean, variance) = moments(errors);
            let expected = 0.01 * t_s as f64;
            assert!(mean.abs() < 4.0 * (expected / 4000.0).sqrt(), "{mean}");
            assert!((variance / expected - 1.0).abs() < 0.1, "t {t_s}: {variance} of {expected}");
        }
    }

    #[test]
    fn answers_do_not_depend_on_the_questions() {
        let mut steady = Clock::new(&ClockConfig::default(), 1, 5);
        let mut jumping = steady.clone();
        let mut last = 0;
        for i in 0..2000 {
            last = steady.local_ps(i * S / 100 + 7 * i);
        }
        let at = 1999 * S / 100 + 7 * 1999;
        assert_eq!(jumping.local_ps(at), last);
        // And looking back within the reach gives what was answered before.
        let back = at - Clock::LOOK_BACK_PS + 1_000_000_000;
        assert_eq!(jumping.local_ps(back), Clock::new(&ClockConfig::default(), 1, 5).local_ps(back));
    }

    #[test]
    #[should_panic(expected = "read forwards")]
    fn questions_far_back_are_refused() {
        let mut clock = Clock::new(&ClockConfig::default(), 1, 0);
        let _ = clock.local_ps(10 * S);
        let _ = clock.local_ps(9 * S);
    }

    #[test]
    fn perfect_clocks_count_true_time_through_wraps() {
        let mut clock = Clock::new(&ClockConfig::perfect(), 1, 0);
        assert_eq!(clock.ticks(0, CAPTURE_TICK_HZ), 0);
        assert_eq!(clock.ticks(S, CAPTURE_TICK_HZ), 983_040_000);
        // 84 MHz wraps 32 bits after 51.13 s; the last ticks of 200 minutes are still exact.
        assert_eq!(clock.ticks(52 * S, 84_000_000) as u32, (52_u64 * 84_000_000 - (1 << 32)) as u32);
        assert_eq!(clock.ticks(12_000 * S - 1, CAPTURE_TICK_HZ), 12_000 * 983_040_000 - 1);
    }

    #[test]
    fn a_clock_behind_starts_below_zero_and_its_low_bits_run_through() {
        let config = ClockConfig { drift_ns_per_s: 0.0, walk_ns_per_sqrt_s: 0.0, ..ClockConfig::default() };
        let behind = (0..50).map(|i| Clock::new(&config, 1, i)).find(|c| c.offset_ps < -10e3);
        let mut clock = behind.expect("half of all clocks are behind");
        let (first, later) = (clock.ticks(0, CAPTURE_TICK_HZ), clock.ticks(S, CAPTURE_TICK_HZ));
        assert!(first > u64::MAX / 2 && later < u64::MAX / 2);
        assert_eq!((later as u32).wrapping_sub(first as u32), 983_040_000);
    }

    proptest! {
        #[test]
        fn truth_ticks_are_the_exact_floor(local_ps in -1_000_000_000_i64..24_000 * S, tick_hz in 1..=10_000_000_000_u64) {
            let exact = (i128::from(local_ps) * i128::from(tick_hz)).div_euclid(i128::from(S));
            prop_assert_eq!(i128::from(ticks_of_ps(local_ps, tick_hz)), exact);
        }

        #[test]
        fn local_time_never_runs_backwards(seed: u64, steps in prop::collection::vec(0..2 * S, 1..50)) {
            let mut clock = Clock::new(&ClockConfig::default(), seed, 0);
            let (mut now, mut last) = (0, i64::MIN);
            for step in steps {
                now += step;
                for at in [now, now + 1] {
                    let local = clock.local_ps(at);
                    prop_assert!(local >= last);
                    last = local;
                }
            }
        }
    }
}
