//! Where the drones hover to serve the most users: all together with a proof, or by the paper's Algorithm 2.
//!
//! One drone is the one-disk problem (6): the centre that has the most users within their coverage
//! radius. Its maximum is found by branch and bound over squares of centres (`search`), closed by
//! the crossings of their circles ([`disk`]); among all centres that reach it, `centre`
//! takes the one farthest from losing a user. `greedy` repeats that on the users left over, `joint` places all drones
//! together and proves it, `minlp` is the paper's program as printed.
//!
//! Two objectives share that machinery. [`Objective::Guaranteed`] counts users whose whole error disk
//! is covered, as the paper does. [`Objective::Expected`] maximises the expected number of users truly
//! within the radio range, given the covariance of every position; `likely` does so for all drones together.
//!
//! Units: metres, east and north of one local origin.

mod cells;
mod centre;
mod confident;
pub mod disk;
pub mod expected;
mod greedy;
mod joint;
mod likely;
mod minlp;
mod queue;
pub mod refine;
mod search;

#[cfg(test)]
mod truth;

use crate::geometry::V2;

pub use confident::{Wanted, place_confident};
pub use expected::{UserBelief, expected_served, served_by_any};
pub use greedy::{place, place_minlp};
pub use joint::{candidate_disks, place_joint};
pub use likely::place_expected;

/// Disks are closed up to this much: a user counts at a distance of at most `radius_m + TOLERANCE_M`.
pub const TOLERANCE_M: f64 = 1e-6;

/// Coordinates and radii beyond this are refused: doubles would no longer resolve [`TOLERANCE_M`].
pub const LARGEST_COORDINATE_M: f64 = 1e8;

/// A user as the one-disk problem (6) sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceUser {
    /// Estimated position.
    pub pos_m: V2,
    /// Coverage radius less the user's own error radius, `R_C - r_i`. Negative: no drone can cover it.
    pub radius_m: f64,
    /// What covering this user is worth; 1 where users are counted.
    pub weight: f64,
}

/// What is maximised, over whom.
#[derive(Clone, Copy, Debug)]
pub enum Objective<'a> {
    /// Total weight of users with `|pos - centre| <= radius_m`: the paper's guaranteed service.
    Guaranteed(&'a [PlaceUser]),
    /// Expected number of users truly within `radius_m` of a drone.
    Expected {
        /// Users with the covariance of their position.
        users: &'a [UserBelief],
        /// Coverage radius `R_C`, the same for all.
        radius_m: f64,
    },
}

/// How many drones there are, and how close two of them may hover.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fleet {
    /// Drones to place, the `m` of Algorithm 2.
    pub drones: usize,
    /// Least distance between two sites; 0 where drones may share one.
    pub min_separation_m: f64,
}

/// Where one drone hovers, and for whom.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    /// Centre of the coverage disk.
    pub pos_m: V2,
    /// Users counted for this drone and no earlier one, ascending. Under [`Objective::Expected`] the
    /// users more likely within range than not.
    pub covered: Vec<usize>,
    /// How far the centre may drift before it loses one of `covered`: the least `radius - distance`.
    pub margin_m: f64,
    /// What this drone adds to the objective: weight, or expected users.
    pub expected: f64,
}

/// An answer of Algorithm 2.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// One entry per drone, in the order of the greedy steps. `None`: nobody is left to serve.
    pub sites: Vec<Option<Site>>,
    /// Users in the `covered` lists of all sites.
    pub covered: usize,
    /// The objective reached.
    pub value: f64,
    /// No placement of these drones, greedy or not, has a larger objective.
    pub upper_bound: f64,
    /// `value` equals `upper_bound` up to rounding.
    pub proved_optimal: bool,
    /// Users that no drone can cover (negative radius).
    pub never_coverable: usize,
}

/// Bad input of [`place`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlaceError {
    /// A coordinate or radius is not a number of metres this code can resolve.
    #[error("user {user}: {field} is {found}, expected a finite value within +-1e8 m")]
    UserOutOfRange {
        /// Index of the user.
        user: usize,
        /// Name of the offending field.
        field: &'static str,
        /// What it held.
        found: f64,
    },
    /// A weight is negative or not finite.
    #[error("user {user}: weight is {found}, expected a finite value of at least 0")]
    BadWeight {
        /// Index of the user.
        user: usize,
        /// What it held.
        found: f64,
    },
    /// A covariance matrix is not symmetric and positive semidefinite.
    #[error("user {user}: cov_m2 is not symmetric, finite and positive semidefinite")]
    BadCovariance {
        /// Index of the user.
        user: usize,
    },
    /// The confidence is no probability that a normal error can reach.
    #[error("confidence is {found}, expected a probability above 0 and below 1")]
    BadConfidence {
        /// What it held.
        found: f64,
    },
    /// The coverage radius is unusable.
    #[error("radius_m is {found}, expected a finite value in 0..=1e8")]
    BadRadius {
        /// What it held.
        found: f64,
    },
    /// The separation is unusable.
    #[error("min_separation_m is {found}, expected a finite value in 0..=1e8")]
    BadSeparation {
        /// What it held.
        found: f64,
    },
}

/// Sites already taken: a new centre keeps `radius_m` away from each.
#[derive(Clone, Debug, Default)]
pub(crate) struct KeepOut {
    centres: Vec<V2>,
    radius_m: f64,
}

impl KeepOut {
    /// New centres are put this much outside the exclusion circle, so that rounding never puts two
    /// sites closer than asked.
    const CLEARANCE_M: f64 = 1e-7;

    fn new(min_separation_m: f64) -> Self {
        Self { centres: Vec::new(), radius_m: min_separation_m }
    }

    fn push(&mut self, centre: V2) {
        if self.radius_m > 0.0 {
            self.centres.push(centre);
        }
    }

    /// Whether a drone may hover at `at`.
    fn allows(&self, at: V2) -> bool {
        self.centres.iter().all(|c| (at - c).norm() >= self.radius_m)
    }

    /// Whether the closed disk (`at`, `rho_m`) holds no allowed centre for certain.
    fn swallows(&self, at: V2, rho_m: f64) -> bool {
        self.centres.iter().any(|c| (at - c).norm() + rho_m < self.radius_m)
    }

    /// Radius of the circles on which pushed-out centres are sought.
    fn shore_m(&self) -> f64 {
        self.radius_m + Self::CLEARANCE_M
    }

    /// Exclusion centres whose shore may meet the disk (`at`, `rho_m`).
    fn near(&self, at: V2, rho_m: f64) -> impl Iterator<Item = V2> + '_ {
        let reach_m = self.shore_m() + rho_m;
        self.centres.iter().copied().filter(move |c| (at - c).norm() <= reach_m)
    }
}
