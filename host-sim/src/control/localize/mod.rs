//! Batch UTDOA localization of the control center: all users of a sweep together with the clocks of the drones
//! that heard them (paper section 2; the captures are UL-RTOA of TS 38.215, 5.2.2).
//!
//! A fleet of three drones 50 m apart hears a user once a second while passing it. A nanosecond of clock error
//! moves a fix by 3 to 6 m, so the clocks of a fleet are unknowns of the same least-squares problem as all of its
//! users: `toa = emission + |p - d| / c + clock + noise`, Taylor-series positioning (Foy 1976, Torrieri 1984) with
//! - an unknown emission time per occasion, projected out (`robust`);
//! - two unknowns per user, or three where the altitude of the ground is uncertain, eliminated by a Schur
//!   complement (`normal`);
//! - offset, drift and random walk per drone on knots in time (`clock`), solved by a skyline Cholesky
//!   factorisation (`cholesky`);
//! - Tukey weights against late captures, tightened step by step from a start that needs no clocks (`solve`);
//! - a verdict per user (`check`) and the marginal covariance that verdict and r95 rest on.
//!
//! A closed-form start (Chan & Ho 1994) is of no use here: it needs the clocks, which are off by up to 60 us.
//!
//! Users that walk are solved for as if they stood, then followed (`walk`), and solved for again with the ways found.
//!
//! Clock groups (fleets) are independent problems, solved in parallel; a user heard by several has its
//! estimates combined by their information. Results do not depend on threads or on the order of the input.

mod bound;
mod check;
mod cholesky;
mod clock;
mod excess;
mod model;
mod motion;
mod normal;
mod problem;
mod r95;
mod robust;
mod running;
#[cfg(test)]
mod sim;
mod small;
mod solve;
#[cfg(test)]
mod tests;
mod undeclared;
mod walk;

use std::collections::BTreeMap;

use rayon::prelude::*;
use skyroost_protocol::units::UserId;

pub use bound::{crlb, crlb_ratio};
pub use model::{
    C_M_PER_NS, Capture, ClockFix, ClockModel, FixStatus, Localization, LocalizeConfig, LocalizeError,
    MAX_CAPTURES, Occasion, Robust, UserFix,
};
pub use motion::Motion;
pub use r95::r95;
pub use running::{Running, RunningFix};

/// Estimates every user and every clock from all occasions of a mission.
///
/// # Errors
/// A field of `cfg` out of its range. Unusable occasions are no error: they are dropped and counted in `warnings`.
pub fn localize(occasions: &[Occasion], cfg: &LocalizeConfig) -> Result<Localization, LocalizeError> {
    cfg.check()?;
    let (problems, dropped) = problem::split(occasions, cfg, |_, _| true);
    let answers: Vec<_> = problems.par_iter().map(|problem| walk::solve_group(problem, cfg)).collect();
    let mut localization = Localization { warnings: dropped.warnings().collect(), ..Localization::default() };
    let mut users: BTreeMap<UserId, UserFix> = BTreeMap::new();
    for answer in answers {
        localization.iterations += answer.iterations;
        localization.clocks.extend(answer.clocks);
        localization.warnings.extend(answer.warnings);
        for fix in answer.users {
            (users.entry(fix.user)).and_modify(|known| *known = combine(known, &fix, cfg)).or_insert(fix);
        }
    }
    localization.users = users.into_values().collect();
    Ok(localization)
}

impl Localization {
    /// Makes the places of users that walk those of a later time, in seconds of the mission: where they were heard last, and what
    /// they may have walked since.
    pub fn grow(&mut self, time_s: f64, cfg: &LocalizeConfig) {
        for fix in self.users.iter_mut().filter(|fix| fix.status != FixStatus::NotLocated) {
            let last_heard_s = fix.last_heard_s;
            *fix = UserFix { last_heard_s, ..grown(fix, time_s.max(last_heard_s), cfg) };
        }
    }
}

/// One fix from those of two clock groups or visits, whose noise and clocks are independent, as of the later one.
fn combine(a: &UserFix, b: &UserFix, cfg: &LocalizeConfig) -> UserFix {
    /// 99.9999 % quantile of a chi-square with two degrees of freedom: missions have thousands of users.
    const CONTRADICTION: f64 = 27.63;
    let last_heard_s = a.last_heard_s.max(b.last_heard_s);
    let [a, b] = &[a, b].map(|fix| grown(fix, last_heard_s, cfg));
    let mut joint = match (a.status, b.status) {
        (FixStatus::Ok, FixStatus::Ok) => {
            let e = [b.pos_m[0] - a.pos_m[0], b.pos_m[1] - a.pos_m[1]];
            let sum: small::Mat<2> =
                std::array::from_fn(|i| std::array::from_fn(|j| a.cov_m2[i][j] + b.cov_m2[i][j]));
            let whitened = small::mul(&small::inverse(sum), e);
            let distance = small::dot(e, whitened);
            let cov_m2 = bound::parallel(a.cov_m2, b.cov_m2);
            // p = a + A (A + B)^-1 (b - a)
            let pos_m = std::array::from_fn(|i| a.pos_m[i] + small::dot(a.cov_m2[i], whitened));
            let r95_m = r95(cov_m2);
            let status = if distance > CONTRADICTION { FixStatus::Inconsistent } else { FixStatus::Ok };
            debug_assert!(r95_m <= a.r95_m.min(b.r95_m) * (1.0 + 1e-9));
            UserFix { pos_m, cov_m2, r95_m, status, ..a.clone() }
        }
        (FixStatus::Ok, _) => a.clone(),
        (_, FixStatus::Ok) => b.clone(),
        _ if b.r95_m < a.r95_m => b.clone(),
        _ => a.clone(),
    };
    joint.occasions = a.occasions + b.occasions;
    joint.rejected = a.rejected + b.rejected;
    joint
}

/// A fix as of a later time: whoever walks has gone on. It was a good one and is one still, however wide.
fn grown(fix: &UserFix, last_heard_s: f64, cfg: &LocalizeConfig) -> UserFix {
    let mut grown = UserFix { last_heard_s, ..fix.clone() };
    if !cfg.motion.is_still() && last_heard_s > fix.last_heard_s {
        grown.cov_m2 = cfg.motion.grown(fix.cov_m2, last_heard_s - fix.last_heard_s);
        grown.r95_m = r95(grown.cov_m2);
    }
    grown
}
