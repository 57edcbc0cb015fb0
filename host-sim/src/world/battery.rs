//! The battery: charge over flight time.
//!
//! Energy is counted in seconds of hovering, so no voltages are needed: hovering draws 1 per second, flying draws
//! more or less by air speed, sitting with motors off draws the avionics. The power of a multirotor
//! dips slightly at moderate speed (translational lift) before drag takes over; the interpolation
//! between hover and cruise is quadratic in air speed, as drag is.

use crate::rng::{self, Stream};
use crate::world::{ConfigError, Range, require};
use serde::Deserialize;

/// Parameters of the battery.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BatteryConfig {
    /// Hovering time of a nominal full battery.
    pub endurance_s: f64,
    /// Draw at cruise speed, hovering = 1.
    pub cruise_draw: f64,
    /// Air speed at which that holds.
    pub cruise_mps: f64,
    /// Draw with motors off, hovering = 1.
    pub idle_draw: f64,
    /// Capacities are uniform within plus and minus this fraction of the nominal one.
    pub spread_fraction: f64,
}

impl Default for BatteryConfig {
    fn default() -> Self {
        Self {
            endurance_s: 21_600.0,
            cruise_draw: 1.05,
            cruise_mps: 10.0,
            idle_draw: 0.01,
            spread_fraction: 0.02,
        }
    }
}

impl BatteryConfig {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("endurance_s", self.endurance_s, Range::Positive)?;
        require("cruise_draw", self.cruise_draw, Range::NotNegative)?;
        require("cruise_mps", self.cruise_mps, Range::Positive)?;
        require("idle_draw", self.idle_draw, Range::NotNegative)?;
        require("spread_fraction", self.spread_fraction, Range::Probability)
    }
}

/// What a drone is doing, as far as its battery cares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// Motors off.
    Idle,
    /// Flying at a speed through the air.
    Flying {
        /// The air speed.
        air_speed_mps: f64,
    },
}

/// One drone's battery, full at first.
#[derive(Clone, Debug)]
pub struct Battery {
    capacity_s: f64,
    left_s: f64,
    extra_draw_per_m2ps2: f64,
    top_speed_mps: f64,
    idle_draw: f64,
}

/// Air speeds beyond this many times cruise speed draw no more than there.
const TOP_SPEED_RATIO: f64 = 1.5;

impl Battery {
    /// The battery of `drone`.
    ///
    /// # Panics
    /// On a config that [`BatteryConfig::check`] refuses.
    #[must_use]
    pub fn new(config: &BatteryConfig, seed: u64, drone: u64) -> Self {
        assert!(config.check().is_ok(), "battery parameters are checked where they are read");
        let mut rng = rng::stream(seed, Stream::Battery, drone);
        let spread = rng::uniform(&mut rng, -config.spread_fraction, config.spread_fraction);
        let capacity_s = config.endurance_s * (1.0 + spread);
        Self {
            capacity_s,
            left_s: capacity_s,
            extra_draw_per_m2ps2: (config.cruise_draw - 1.0) / (config.cruise_mps * config.cruise_mps),
            top_speed_mps: TOP_SPEED_RATIO * config.cruise_mps,
            idle_draw: config.idle_draw,
        }
    }

    /// The same with this fraction of its charge left.
    #[must_use]
    pub fn charged(self, fraction: f64) -> Self {
        Self { left_s: self.left_s * fraction.clamp(0.0, 1.0), ..self }
    }

    /// Draws for `dt_s`. An empty battery stays empty.
    pub fn step(&mut self, load: Load, dt_s: f64) {
        let draw = match load {
            Load::Idle => self.idle_draw,
            Load::Flying { air_speed_mps } => {
                let speed = air_speed_mps.clamp(0.0, self.top_speed_mps);
                1.0 + self.extra_draw_per_m2ps2 * speed * speed
            }
        };
        self.left_s = (self.left_s - draw * dt_s).max(0.0);
    }

    /// Charge in per mille of this battery's capacity, rounded down: 0 says empty or nearly so.
    #[must_use]
    pub fn charge_permille(&self) -> u16 {
        (1000.0 * self.left_s / self.capacity_s) as u16
    }

    /// Whether nothing is left: the motors stop.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.left_s <= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nominal() -> Battery {
        Battery::new(&BatteryConfig { spread_fraction: 0.0, ..BatteryConfig::default() }, 1, 0)
    }

    /// Whole seconds until empty.
    fn lasts_s(mut battery: Battery, load: Load) -> u32 {
        let mut seconds = 0;
        while !battery.is_empty() {
            battery.step(load, 1.0);
            seconds += 1;
        }
        seconds
    }

    #[test]
    fn lasts_its_endurance() {
        let at = |air_speed_mps| Load::Flying { air_speed_mps };
        assert_eq!(lasts_s(nominal(), at(0.0)), 21_600);
        assert_eq!(lasts_s(nominal(), at(10.0)), (21_600.0_f64 / 1.05).ceil() as u32);
        assert_eq!(lasts_s(nominal(), at(1e9)), lasts_s(nominal(), at(15.0)));
        assert!(lasts_s(nominal(), Load::Idle) >= 1_440_000);
    }

    #[test]
    fn charge_counts_down_from_a_thousand() {
        let mut battery = nominal();
        assert_eq!(battery.charge_permille(), 1000);
        battery.step(Load::Flying { air_speed_mps: 0.0 }, 10800.0);
        assert_eq!(battery.charge_permille(), 500);
        battery.step(Load::Flying { air_speed_mps: 0.0 }, 1e6);
        assert_eq!((battery.charge_permille(), battery.is_empty()), (0, true));
    }

    #[test]
    fn a_battery_that_is_not_full_ends_sooner() {
        assert_eq!(nominal().charged(0.5).charge_permille(), 500);
        assert_eq!(lasts_s(nominal().charged(0.5), Load::Flying { air_speed_mps: 0.0 }), 10_800);
    }

    #[test]
    fn capacities_spread_within_their_bounds() {
        let lives = (0..200).map(|drone| Battery::new(&BatteryConfig::default(), 1, drone).capacity_s);
        let (low, high) = lives.fold((f64::MAX, 0.0_f64), |(low, high), s| (low.min(s), high.max(s)));
        assert!((21_168.0..21_195.0).contains(&low) && (22_005.0..22_032.0).contains(&high), "{low} {high}");
    }

    #[test]
    fn config_names_the_bad_parameter() {
        let bad = BatteryConfig { endurance_s: f64::NAN, ..BatteryConfig::default() };
        assert_eq!(bad.check().unwrap_err().field, "endurance_s");
    }
}
