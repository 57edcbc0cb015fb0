//! The simulated world: vehicles, air, navigation, clocks, radio, users and batteries.
//!
//! Each part is pure: time and inputs are arguments, parameters are a config struct whose `Default` is
//! the project's reference scenario, chance comes from a [`crate::rng`] stream of its own. Nothing here
//! knows the control center; the runner wires the parts to the flight code.
//!
//! Frames and units: positions east, north, up (ENU) in metres from the area's origin; true time in
//! integer picoseconds (clocks, radio waves) or microseconds (links) from the start of the mission.

pub mod battery;
pub mod channel;
pub mod clock;
pub mod gauss_markov;
pub mod gnss;
pub mod grid;
pub mod link;
pub mod pps;
pub mod users;
pub mod vehicle;
pub mod walkers;
pub mod wind;

/// A parameter out of its range. Every config has a `check` that finds the first one; whoever reads
/// parameters from outside calls it and adds the file and line. Constructors assert it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field}: found {found}, expected {expected}")]
pub struct ConfigError {
    /// Name of the parameter as in the scenario file.
    pub field: &'static str,
    /// Its value.
    pub found: f64,
    /// What is allowed.
    pub expected: &'static str,
}

/// The ranges that parameters of the world come in.
#[derive(Clone, Copy, Debug)]
enum Range {
    Positive,
    NotNegative,
    Probability,
    Finite,
}

/// Refuses `found` outside `range`; NaN and infinities are outside every range.
fn require(field: &'static str, found: f64, range: Range) -> Result<(), ConfigError> {
    let (inside, expected) = match range {
        Range::Positive => (found > 0.0, "a positive number"),
        Range::NotNegative => (found >= 0.0, "zero or a positive number"),
        Range::Probability => ((0.0..=1.0).contains(&found), "a probability from 0 to 1"),
        Range::Finite => (true, "a finite number"),
    };
    if inside && found.is_finite() { Ok(()) } else { Err(ConfigError { field, found, expected }) }
}

/// How many ticks of `dt_s` a part lets pass between updates every `period_s`: at least one.
fn ticks_per_update(period_s: f64, dt_s: f64) -> u32 {
    (period_s / dt_s).round().max(1.0) as u32
}

/// `v`, shortened to `limit` where it is longer.
#[inline]
fn limited(v: crate::geometry::V3, limit: f64) -> crate::geometry::V3 {
    let norm_squared = v.norm_squared();
    if norm_squared > limit * limit { v * (limit / norm_squared.sqrt()) } else { v }
}

/// Mean and unbiased variance.
#[cfg(test)]
pub(crate) fn moments(samples: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = samples.clone().count() as f64;
    let mean = samples.clone().sum::<f64>() / n;
    (mean, samples.map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_refuse_what_is_outside_and_name_it() {
        for range in [Range::Positive, Range::NotNegative, Range::Probability, Range::Finite] {
            assert!(require("x", 0.5, range).is_ok());
            assert!(require("x", f64::NAN, range).is_err());
            assert!(require("x", f64::INFINITY, range).is_err());
        }
        assert!(require("x", 0.0, Range::Positive).is_err());
        assert!(require("x", 1.1, Range::Probability).is_err());
        let error = require("sigma_m", -1.0, Range::NotNegative).unwrap_err();
        assert_eq!(error.to_string(), "sigma_m: found -1, expected zero or a positive number");
    }
}
