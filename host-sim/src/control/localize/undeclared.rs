//! Clocks that are not what they were declared to be.
//!
//! A nanosecond of clock error that the model does not know moves a fix by 3 to 6 m, and over a single pass hardly
//! shows in the residuals: the position gives way instead. What does show is that a model with free offsets and
//! drifts, shared by all users, explains the captures better by more than chance. So a group whose clocks
//! are declared synchronised, or off by constants, is held against lines: first by a score test (Rao 1948), which
//! costs a single linearisation, then by the likelihood ratio of a solution with lines (Wilks 1938). Either is a
//! chi-square of as many degrees as there are new unknowns, and half of it the gain in log likelihood.
//! What a contradiction means for a user is how far the richer model puts it elsewhere.

use super::check::apart_m;
use super::clock::{Clocks, Grid, Resolution};
use super::model::{ClockModel, FixStatus, LocalizeConfig, UserFix};
use super::normal::Normal;
use super::problem::Problem;
use super::r95::r95;
use super::robust::Loss;
use super::solve::{Solved, State, position_prior, solve_blocks};

/// Quantiles of the standard normal distribution: beyond 1 in 20 chance is a poor explanation, and fixes are widened;
/// beyond 1 in 100,000 it is none, and fixes that depend on it are refused.
const POOR_CHANCE_SIGMAS: f64 = 1.645;
const NO_CHANCE_SIGMAS: f64 = 4.265;
/// A fix that moves by less than this share of its r95 stays one, with the move added to its covariance.
const IMMATERIAL: f64 = 0.25;

/// The richer model to hold a declared one against; none where clocks may already wander.
fn richer(clock: ClockModel) -> Option<(ClockModel, f64)> {
    let lines = ClockModel::SharedWander {
        offset_sigma_ns: f64::MAX,
        drift_sigma_ns_per_s: f64::MAX,
        walk_ns_per_sqrt_s: 0.0,
    };
    match clock {
        ClockModel::Synchronised => Some((lines, 2.0)),
        ClockModel::SharedConstant => Some((lines, 1.0)),
        ClockModel::SharedWander { .. } => None,
    }
}

/// Solves with a richer model of the clocks; where the captures demand it, flags users or widens their covariance and says so.
pub(super) fn hold_to_account<const D: usize>(
    problem: &Problem,
    cfg: &LocalizeConfig,
    declared: &mut Solved<D>,
) {
    let Some((clock, unknowns_per_clock)) = richer(cfg.clock) else { return };
    let clocks = problem.drones.len().saturating_sub(1) as f64;
    if clocks < 1.0 {
        return;
    }
    let freed = LocalizeConfig { clock, ..*cfg };
    let quantile = |sigmas: f64| chi_square_quantile(unknowns_per_clock * clocks, sigmas);
    // The score test sees what a single step gains: half of what counts as a poor chance is enough to look again.
    if 2.0 * score(problem, &freed, &declared.pos_m, &declared.lines) < 0.5 * quantile(POOR_CHANCE_SIGMAS) {
        return;
    }
    let free = solve_blocks::<D>(problem, &freed);
    let gain = 2.0 * (declared.cost - free.cost);
    if gain <= quantile(POOR_CHANCE_SIGMAS) {
        return;
    }
    let refuted = gain > quantile(NO_CHANCE_SIGMAS);
    let mut flagged = 0;
    let users = declared.answer.users.iter_mut().zip(&free.answer.users);
    for (fix, other) in users.filter(|(fix, _)| fix.status == FixStatus::Ok) {
        if refuted && apart_m(fix.pos_m, other.pos_m) > IMMATERIAL * fix.r95_m {
            fix.status = FixStatus::Inconsistent;
            flagged += 1;
        } else {
            widen(fix, other.pos_m, cfg);
        }
    }
    if !refuted {
        return;
    }
    let off: Vec<String> = free
        .answer
        .clocks
        .iter()
        .skip(1)
        .map(|clock| {
            format!("drone {} {:+.1} ns {:+.4} ns/s", clock.drone.0, clock.offset_ns, clock.drift_ns_per_s)
        })
        .collect();
    declared.answer.warnings.push(format!(
        "clock group {}: the captures contradict the clocks declared (chi-square {gain:.0}), {flagged} users flagged; \
         against drone {} they suggest {}; expected a model with unknown clocks",
        problem.clock_group, problem.drones[0].0, off.join(", "),
    ));
}

/// By how much the linearised cost falls when the clocks are free to become lines.
fn score<const D: usize>(
    problem: &Problem,
    freed: &LocalizeConfig,
    pos_m: &[[f64; D]],
    lines: &[(f64, f64)],
) -> f64 {
    let grid = Grid::new(problem, freed, Resolution::Fine);
    let state = State { grid, clocks: Clocks::from_lines(&grid, lines), pos_m: pos_m.to_vec() };
    let mut normal = Normal::default();
    normal.evaluate(problem, &state, &Loss::new(freed.robust, 1.0), position_prior(freed), |_| 1);
    let matrix = normal.envelope(&grid);
    let eliminated = normal.eliminate(&state, 0.0, matrix);
    eliminated.map_or(f64::INFINITY, |eliminated| normal.step(&grid, 0.0, &eliminated).predicted)
}

/// Adds a possible error to the covariance.
fn widen(fix: &mut UserFix, other_m: [f64; 2], cfg: &LocalizeConfig) {
    let e = [other_m[0] - fix.pos_m[0], other_m[1] - fix.pos_m[1]];
    for i in 0..2 {
        for j in 0..2 {
            fix.cov_m2[i][j] += e[i] * e[j];
        }
    }
    fix.r95_m = r95(fix.cov_m2);
    if fix.r95_m > cfg.max_r95_m {
        fix.status = FixStatus::PoorGeometry;
    }
}

/// Quantile of a chi-square distribution at `z` of the standard normal one (Wilson & Hilferty 1931; within 3 % up to 99.9 %).
fn chi_square_quantile(degrees: f64, z: f64) -> f64 {
    let spread = 2.0 / (9.0 * degrees);
    degrees * (1.0 - spread + z * spread.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables: 95 % and 99.9 % for 2, 4 and 10 degrees of freedom.
    #[test]
    fn truth_quantiles() {
        for (degrees, at_95, at_999) in [(2.0, 5.991, 13.816), (4.0, 9.488, 18.467), (10.0, 18.307, 29.588)] {
            for (z, expected) in [(1.644_854, at_95), (3.090_232, at_999)] {
                let found: f64 = chi_square_quantile(degrees, z);
                assert!((found / expected - 1.0).abs() < 0.03, "{degrees} {found} {expected}");
            }
        }
    }
}
