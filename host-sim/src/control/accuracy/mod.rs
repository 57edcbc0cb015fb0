//! How well a formation can locate, before it flies: the Cramer-Rao bound of users beside a straight lane.
//!
//! - `pass`: which transmissions a user beside the lane is heard by, and the bound of their captures,
//! - `trusted`: what errors do that stay the same over a pass and that nobody estimates,
//! - `radii`: the circles that hold 95 %, by what is known and what is not,
//! - `study`: the figures to choose a formation by.
//!
//! The bounds are those of [`localize::crlb`](crate::control::localize::crlb), which the estimator is held against: of
//! captures with independent Gaussian noise of one standard deviation, none of them late or lost.

mod pass;
mod radii;
mod study;
#[cfg(test)]
mod tests;
mod trusted;

pub use radii::{SYNC_USERS, USERS_PER_KM2};
pub use study::{Accuracy, Curve, OffsetRow, Sync, TradeOff};

use crate::control::localize::LocalizeError;
use crate::geometry::V2;

/// Lengths, speeds, times and noise outside of these are mistakes.
const LENGTH_M: (f64, f64, &str) = (0.2, 1e6, "a length from 0.2 to 1e6 m");
const SPEED_MPS: (f64, f64, &str) = (1e-3, 1e4, "a speed from 0.001 to 1e4 m/s");
const PERIOD_S: (f64, f64, &str) = (1e-3, 1e6, "a time from 0.001 to 1e6 s");
const SIGMA_NS: (f64, f64, &str) = (1e-2, 1e6, "a time from 0.01 to 1e6 ns");
/// A swath's radius below this is none.
const LEAST_SWATH_RADIUS_M: f64 = 0.1;
/// Most SRS of a user while the fleet flies the swath's radius.
const MOST_STEPS: f64 = 1000.0;

/// Three drones on a straight lane, and what they hear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Formation {
    /// Corners of the triangle about its centre, for a side of one metre; the lane leads east.
    pub corners: [V2; 3],
    /// Side of the triangle.
    pub spacing_m: f64,
    /// Height of the drones above the users.
    pub altitude_m: f64,
    /// Speed along the lane.
    pub speed_mps: f64,
    /// Radius on the ground that one drone covers.
    pub radius_m: f64,
    /// From one SRS of a user to its next.
    pub srs_period_s: f64,
    /// Standard deviation of the arrival time of an SRS at a drone.
    pub sigma_toa_ns: f64,
}

/// A formation of which no accuracy can be told.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AccuracyError {
    /// A number out of its range.
    #[error("{field}: found {found:?}, expected {expected}")]
    Range {
        /// The field of [`Formation`].
        field: &'static str,
        /// Its value.
        found: f64,
        /// What would do.
        expected: &'static str,
    },
    /// The three disks have nothing in common that moves along with them.
    #[error("spacing_m: found {spacing_m:?}, expected at most {most_m:.1}, sqrt(3) times the radius")]
    NoSwath {
        /// Side of the triangle.
        spacing_m: f64,
        /// All sides up to this one leave a swath.
        most_m: f64,
    },
    /// More SRS than anyone would send.
    #[error(
        "speed_mps, srs_period_s: found {found_m:?} m from one SRS to the next, expected at least {least_m:?} m"
    )]
    TooMany {
        /// Between two SRS of a user.
        found_m: f64,
        /// The least that would do: a thousandth of the swath's radius.
        least_m: f64,
    },
    /// The estimator's own complaint.
    #[error(transparent)]
    Localize(#[from] LocalizeError),
}

impl Formation {
    /// Radius of the disk about the triangle's centre in which all three drones hear everybody: half the swath.
    #[must_use]
    pub fn swath_radius_m(&self) -> f64 {
        self.radius_m - self.spacing_m / 3f64.sqrt()
    }

    /// Checks every field and what they make together.
    ///
    /// # Errors
    /// Names the first field that is out of its range, or those that do not go together.
    pub fn check(&self) -> Result<(), AccuracyError> {
        for (field, found, (least, most, expected)) in [
            ("spacing_m", self.spacing_m, LENGTH_M),
            ("altitude_m", self.altitude_m, LENGTH_M),
            ("radius_m", self.radius_m, LENGTH_M),
            ("speed_mps", self.speed_mps, SPEED_MPS),
            ("srs_period_s", self.srs_period_s, PERIOD_S),
            ("sigma_ns", self.sigma_toa_ns, SIGMA_NS),
        ] {
            if !(least..=most).contains(&found) {
                return Err(AccuracyError::Range { field, found, expected });
            }
        }
        let swath_radius_m = self.swath_radius_m();
        if swath_radius_m < LEAST_SWATH_RADIUS_M {
            let most_m = 3f64.sqrt() * (self.radius_m - LEAST_SWATH_RADIUS_M);
            return Err(AccuracyError::NoSwath { spacing_m: self.spacing_m, most_m });
        }
        let (found_m, least_m) = (self.speed_mps * self.srs_period_s, swath_radius_m / MOST_STEPS);
        if found_m < least_m {
            return Err(AccuracyError::TooMany { found_m, least_m });
        }
        Ok(())
    }
}
