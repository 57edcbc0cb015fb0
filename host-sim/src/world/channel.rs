//! The way of an SRS from a user to the drones that hear it.
//!
//! Arrival = emission + distance / c + noise, plus a delay where the direct path is blocked (NLOS). Where an SRS is
//! repeated over symbols, each arrives with noise of its own, all by the same path.
//! A drone captures only users within its coverage disk: the horizontal distance counts, as in the
//! paper's Fig. 2. The motion of a drone during the flight of the wave (some 20 micrometres) is left out.
//!
//! Chance is keyed by (occasion, drone): each pair reads its own place of one ChaCha stream per
//! occasion (occasion = nonce, drone = block counter), so results do not depend on who is
//! asked first, on other users, or on which drones are near.

use crate::geometry::V3;
use crate::rng::{self, Stream};
use crate::world::{ConfigError, Range, require};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;
use skyroost_firmware::srs::burst::{MAX_SYMBOLS, symbol_time};

/// Speed of light, metres per second.
pub const C_MPS: f64 = 299_792_458.0;

/// `ChaCha8Rng` fills its buffer four blocks of 16 words at a time: one drone's share of a stream.
const WORDS_PER_DRONE: u128 = 64;

/// Parameters of the radio channel.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ChannelConfig {
    /// Coverage radius `R_C` of a drone, horizontally.
    pub radius_m: f64,
    /// Standard deviation of the time of arrival of one symbol.
    pub toa_sigma_ns: f64,
    /// Symbols that an SRS is repeated over, 1 to 4.
    pub symbols: u8,
    /// Probability that the direct path is blocked.
    pub nlos_probability: f64,
    /// Least extra delay then.
    pub nlos_min_ns: f64,
    /// Largest extra delay then; uniform in between.
    pub nlos_max_ns: f64,
    /// Probability that a drone in range misses the signal.
    pub miss_probability: f64,
    /// Users transmit within plus and minus this of the scheduled time, uniformly.
    pub emission_error_ns: f64,
}

impl Default for ChannelConfig {
    fn default() -> Self {
        Self {
            radius_m: 500.0,
            toa_sigma_ns: 5.0,
            symbols: 1,
            nlos_probability: 0.05,
            nlos_min_ns: 100.0,
            nlos_max_ns: 1000.0,
            miss_probability: 0.0,
            emission_error_ns: 1000.0,
        }
    }
}

impl ChannelConfig {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("radius_m", self.radius_m, Range::Positive)?;
        require("toa_sigma_ns", self.toa_sigma_ns, Range::NotNegative)?;
        if !(1..=MAX_SYMBOLS).contains(&self.symbols) {
            return Err(ConfigError { field: "symbols", found: self.symbols.into(), expected: "1 to 4" });
        }
        require("nlos_probability", self.nlos_probability, Range::Probability)?;
        require("nlos_min_ns", self.nlos_min_ns, Range::NotNegative)?;
        require("nlos_max_ns", self.nlos_max_ns, Range::NotNegative)?;
        if self.nlos_max_ns < self.nlos_min_ns {
            let expected = "at least nlos_min_ns";
            return Err(ConfigError { field: "nlos_max_ns", found: self.nlos_max_ns, expected });
        }
        require("miss_probability", self.miss_probability, Range::Probability)?;
        require("emission_error_ns", self.emission_error_ns, Range::NotNegative)
    }
}

/// A captured signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// True time of the first symbol's capture, noise included.
    pub true_ps: i64,
    /// Of the other symbols' captures, as many as there are.
    repeats_ps: [i64; MAX_SYMBOLS as usize - 1],
    repeats: u8,
    /// Whether it came late, by a path that is not the direct one: the truth for whoever judges outlier tests.
    pub late: bool,
}

/// What becomes of one user's signal at one drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reception {
    /// Captured.
    Captured(Arrival),
    /// In range, but not detected.
    Missed,
    /// The drone does not cover the user.
    OutOfRange,
}

impl Arrival {
    /// True times of all captures, symbol by symbol.
    pub fn symbols_ps(&self) -> impl Iterator<Item = i64> {
        let repeats = &self.repeats_ps[..usize::from(self.repeats)];
        std::iter::once(self.true_ps).chain(repeats.iter().copied())
    }
}

impl Reception {
    /// The arrival, if there is one.
    #[must_use]
    pub fn captured(self) -> Option<Arrival> {
        if let Self::Captured(arrival) = self { Some(arrival) } else { None }
    }
}

/// The channel between all users and all drones.
#[derive(Clone, Debug)]
pub struct Channel {
    config: ChannelConfig,
    propagation: ChaCha8Rng,
    emission: ChaCha8Rng,
}

impl Channel {
    /// The channel of a simulation.
    ///
    /// # Panics
    /// On a config that [`ChannelConfig::check`] refuses.
    #[must_use]
    pub fn new(config: ChannelConfig, seed: u64) -> Self {
        assert!(config.check().is_ok(), "channel parameters are checked where they are read");
        let propagation = rng::stream(seed, Stream::Channel, 0);
        let emission = rng::stream(seed, Stream::Emission, 0);
        Self { config, propagation, emission }
    }

    /// When the user truly transmits in `occasion` (any number unique to one user's one transmission),
    /// true time in picoseconds.
    #[must_use]
    pub fn emission_ps(&self, occasion: u64, scheduled_ps: i64) -> i64 {
        let mut rng = self.emission.clone();
        rng.set_stream(occasion);
        let error_ns = rng::uniform(&mut rng, -self.config.emission_error_ns, self.config.emission_error_ns);
        scheduled_ps + (1e3 * error_ns).round() as i64
    }

    /// What a drone at `drone_enu_m` makes of the signal that a user at `user_enu_m` sent at
    /// `emission_ps`. The same answer whenever and however often it is asked.
    #[must_use]
    pub fn receive(
        &self,
        occasion: u64,
        drone: u32,
        emission_ps: i64,
        user_enu_m: V3,
        drone_enu_m: V3,
    ) -> Reception {
        let c = &self.config;
        let path_m = drone_enu_m - user_enu_m;
        if path_m.xy().norm_squared() > c.radius_m * c.radius_m {
            return Reception::OutOfRange;
        }
        let mut rng = self.propagation.clone();
        rng.set_stream(occasion);
        rng.set_word_pos(u128::from(drone) * WORDS_PER_DRONE);
        if rng::chance(&mut rng, c.miss_probability) {
            return Reception::Missed;
        }
        let late = rng::chance(&mut rng, c.nlos_probability);
        let detour_ns = rng::uniform(&mut rng, c.nlos_min_ns, c.nlos_max_ns);
        let way_ns = path_m.norm() * (1e9 / C_MPS) + if late { detour_ns } else { 0.0 };
        let mut arrival = |symbol| {
            let flight_ns = way_ns + c.toa_sigma_ns * rng::normal(&mut rng);
            emission_ps + symbol_time(symbol).0 + (1e3 * flight_ns).round() as i64
        };
        let (true_ps, repeats) = (arrival(0), c.symbols - 1);
        let mut repeats_ps = [0; MAX_SYMBOLS as usize - 1];
        for (ps, symbol) in repeats_ps.iter_mut().zip(1..c.symbols) {
            *ps = arrival(symbol);
        }
        Reception::Captured(Arrival { true_ps, repeats_ps, repeats, late })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;
    use proptest::prelude::*;

    /// 300 m up, 400 m aside: 500 m of path, 1667.82 ns.
    const USER: V3 = V3::new(100.0, 50.0, 0.0);
    const DRONE: V3 = V3::new(100.0, 450.0, 300.0);
    const FLIGHT_NS: f64 = 500.0 / 0.299_792_458;

    fn arrivals(config: ChannelConfig, n: u64) -> Vec<Arrival> {
        let channel = Channel::new(config, 1);
        (0..n).filter_map(|i| channel.receive(i / 3, (i % 3) as u32, 0, USER, DRONE).captured()).collect()
    }

    #[test]
    fn truth_moments_of_direct_and_late_arrivals() {
        let all = arrivals(ChannelConfig::default(), 200_000);
        assert_eq!(all.len(), 200_000);
        let excess_ns = |late: bool| {
            all.iter().filter(move |a| a.late == late).map(|a| a.true_ps as f64 * 1e-3 - FLIGHT_NS)
        };
        let late = excess_ns(true).count() as f64;
        assert!((late - 10_000.0).abs() < 4.0 * (10_000.0 * 0.95_f64).sqrt(), "{late} late");
        let (mean, variance) = moments(excess_ns(false));
        assert!(mean.abs() < 4.0 * 5.0 / 190_000_f64.sqrt(), "mean {mean}");
        assert!((variance / 25.0 - 1.0).abs() < 4.0 * (2.0 / 190_000_f64).sqrt(), "variance {variance}");
        let (mean, variance) = moments(excess_ns(true));
        assert!((mean - 550.0).abs() < 4.0 * 260.0 / 100.0, "late mean {mean}");
        assert!((variance / (900.0 * 900.0 / 12.0 + 25.0) - 1.0).abs() < 0.05, "late variance {variance}");
        assert!(excess_ns(true).all(|x| (70.0..1030.0).contains(&x)));
    }

    #[test]
    fn truth_symbols_share_the_way_and_not_the_noise() {
        let one = arrivals(ChannelConfig::default(), 50_000);
        let four = arrivals(ChannelConfig { symbols: 4, ..ChannelConfig::default() }, 50_000);
        let mut first_and_last = 0.0;
        for (one, four) in one.iter().zip(&four) {
            assert_eq!(
                (one.true_ps, one.late),
                (four.true_ps, four.late),
                "repeating changes no first symbol"
            );
            let excess_ns: Vec<f64> = (four.symbols_ps().zip(0..))
                .map(|(ps, symbol)| (ps - symbol_time(symbol).0) as f64 * 1e-3 - FLIGHT_NS)
                .collect();
            assert_eq!(excess_ns.len(), 4);
            let spread_ns = excess_ns.iter().map(|ns| (ns - excess_ns[0]).abs()).fold(0.0, f64::max);
            assert!(spread_ns < 50.0, "the detour is the same for all");
            if !four.late {
                first_and_last += excess_ns[0] * excess_ns[3] / 25.0;
            }
        }
        assert!((first_and_last / 50_000.0).abs() < 4.0 / 50_000_f64.sqrt(), "{first_and_last}");
        assert_eq!(one[0].symbols_ps().count(), 1);
    }

    #[test]
    fn truth_emission_errors_are_uniform() {
        let channel = Channel::new(ChannelConfig::default(), 1);
        let errors = || (0..100_000).map(|i| (channel.emission_ps(i, 5_000_000) - 5_000_000) as f64 * 1e-3);
        let (mean, variance) = moments(errors());
        assert!(mean.abs() < 4.0 * 577.4 / 316.2, "{mean}");
        assert!((variance / (1e6 / 3.0) - 1.0).abs() < 0.015, "{variance}");
        assert!(errors().all(|e| e.abs() <= 1000.0));
    }

    #[test]
    fn drones_of_an_occasion_and_occasions_of_a_drone_are_independent() {
        let channel = Channel::new(ChannelConfig { nlos_probability: 0.0, ..ChannelConfig::default() }, 4);
        let noise = |occasion, drone| {
            let arrival = channel.receive(occasion, drone, 0, USER, DRONE).captured().unwrap();
            (arrival.true_ps as f64 * 1e-3 - FLIGHT_NS) / 5.0
        };
        let n = 50_000;
        for (apart, drones) in [(0, (0, 1)), (1, (2, 2)), (0, (3, 4)), (1, (0, 3))] {
            let r = (0..n).map(|i| noise(i, drones.0) * noise(i + apart, drones.1)).sum::<f64>() / n as f64;
            assert!(r.abs() < 4.0 / (n as f64).sqrt(), "correlation {r}");
        }
    }

    #[test]
    fn range_is_horizontal_and_closed() {
        let channel = Channel::new(ChannelConfig::default(), 1);
        let at = |x_m, z_m| channel.receive(1, 0, 0, V3::zeros(), V3::new(x_m, 0.0, z_m));
        assert!(at(500.0, 300.0).captured().is_some());
        assert!(at(0.0, 5000.0).captured().is_some());
        assert_eq!(at(500.001, 0.0), Reception::OutOfRange);
    }

    #[test]
    fn misses_come_at_their_rate_and_leave_the_rest_alone() {
        let some = arrivals(ChannelConfig { miss_probability: 0.3, ..ChannelConfig::default() }, 100_000);
        assert!((some.len() as f64 - 70_000.0).abs() < 4.0 * 145.0, "{}", some.len());
        let all = arrivals(ChannelConfig::default(), 100_000);
        let mut rest = all.iter();
        assert!(
            some.iter().all(|a| rest.any(|b| a == b)),
            "the captured ones are those of a channel without misses"
        );
    }

    #[test]
    fn config_names_the_bad_parameter() {
        let bad = ChannelConfig { nlos_max_ns: 50.0, ..ChannelConfig::default() };
        assert_eq!(
            bad.check().unwrap_err().to_string(),
            "nlos_max_ns: found 50, expected at least nlos_min_ns"
        );
    }

    proptest! {
        #[test]
        fn the_answer_does_not_depend_on_earlier_questions(
            seed: u64, questions in prop::collection::vec((0..5_u64, 0..9_u32), 1..40),
        ) {
            let channel = Channel::new(ChannelConfig::default(), seed);
            for (occasion, drone) in questions {
                let alone = Channel::new(ChannelConfig::default(), seed);
                prop_assert_eq!(
                    channel.receive(occasion, drone, 0, USER, DRONE),
                    alone.receive(occasion, drone, 0, USER, DRONE)
                );
                prop_assert_eq!(channel.emission_ps(occasion, 0), alone.emission_ps(occasion, 0));
            }
        }
    }
}
