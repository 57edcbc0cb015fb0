//! The Cramer-Rao bound of the very measurements used, and how close fixes come to it.

use std::collections::BTreeMap;

use rayon::prelude::*;
use skyroost_protocol::units::UserId;

use super::check::on_ground;
use super::clock::{Clocks, Grid, Resolution};
use super::model::{LocalizeConfig, LocalizeError, Occasion, Robust, UserFix};
use super::normal::{Normal, PositionPrior};
use super::problem::{Problem, UserSpan, split};
use super::robust::Loss;
use super::small::{Mat, dot, horizontal, inverse, mul};
use super::solve::State;

/// Information that stands for "none" where a block must be inverted: a standard deviation of 3000 km.
const NO_INFORMATION: f64 = 1e-13;
/// Bounds above this are not reported: the measurements do not determine the position.
const UNBOUNDED_M: f64 = 10_000.0;

/// Cramer-Rao bound of every user in `truth` whose captures determine its position, in square metres.
///
/// The information matrix of all captures but the `late` ones (`late[i][k]` marks capture k of occasion i) is
/// taken at the true positions, with the emission times, the positions and the clocks unknown. The
/// priors of the clocks and of uncertain altitudes count as information (a hybrid bound, Van Trees 1968,
/// section 2.4.3), and users are taken to be at the altitude assumed; no prior of the horizontal positions does. Users heard by several clock groups add up their information.
///
/// # Errors
/// A field of `cfg` out of its range, or `late` not as long as `occasions`.
pub fn crlb(
    occasions: &[Occasion],
    late: &[[bool; 3]],
    truth: &BTreeMap<UserId, [f64; 2]>,
    cfg: &LocalizeConfig,
) -> Result<BTreeMap<UserId, [[f64; 2]; 2]>, LocalizeError> {
    cfg.check()?;
    if late.len() != occasions.len() {
        return Err(LocalizeError::LateLength { found: late.len(), expected: occasions.len() });
    }
    let finite = |user: &UserId| truth.get(user).is_some_and(|p| p.iter().all(|x| x.is_finite()));
    let keep = |i: usize, k: usize| !late[i][k] && finite(&occasions[i].user);
    let (problems, _) = split(occasions, cfg, keep);
    let bounds: Vec<_> = problems.par_iter().map(|problem| bound_group(problem, truth, cfg)).collect();
    let mut joint: BTreeMap<UserId, [[f64; 2]; 2]> = BTreeMap::new();
    for (user, cov) in bounds.into_iter().flatten() {
        (joint.entry(user)).and_modify(|known| *known = parallel(*known, cov)).or_insert(cov);
    }
    Ok(joint)
}

/// Covariance of two independent estimates taken together: `(A^-1 + B^-1)^-1`.
pub(super) fn parallel(a: Mat<2>, b: Mat<2>) -> Mat<2> {
    let (a, b) = (inverse(a), inverse(b));
    inverse(std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j])))
}

fn bound_group(
    problem: &Problem,
    truth: &BTreeMap<UserId, [f64; 2]>,
    cfg: &LocalizeConfig,
) -> Vec<(UserId, Mat<2>)> {
    match () {
        () if problem.heard.is_empty() => Vec::new(),
        () if cfg.user_altitude_sigma_m > 0.0 => bound_blocks::<3>(problem, truth, cfg),
        () => bound_blocks::<2>(problem, truth, cfg),
    }
}

fn bound_blocks<const D: usize>(
    problem: &Problem,
    truth: &BTreeMap<UserId, [f64; 2]>,
    cfg: &LocalizeConfig,
) -> Vec<(UserId, Mat<2>)> {
    // Clocks enter linearly: the information does not depend on their values.
    let grid = Grid::new(problem, cfg, Resolution::Fine);
    let clocks = Clocks::from_lines(&grid, &vec![(0.0, 0.0); problem.drones.len()]);
    let at = |user: &UserSpan| truth.get(&user.user).copied().unwrap_or(user.centroid_m);
    let pos_m = problem.users.iter().map(|user| on_ground::<D>(at(user))).collect();
    let mut normal = Normal::default();
    let loss = Loss::new(Robust::None, 1.0);
    let state = State { grid, clocks, pos_m };
    let prior =
        PositionPrior { horizontal_info: NO_INFORMATION, up_info: cfg.user_altitude_sigma_m.powi(-2) };
    normal.evaluate(problem, &state, &loss, prior, |_| 1);
    let matrix = normal.envelope(&grid);
    let Some(eliminated) = normal.eliminate(&state, 0.0, matrix) else { return Vec::new() };
    let covariances = normal.covariances(&grid, &eliminated);
    (problem.users.iter().zip(covariances.iter().map(horizontal)))
        .filter(|(_, cov)| {
            cov[0][0] + cov[1][1] < UNBOUNDED_M * UNBOUNDED_M && cov[0][0] > 0.0 && cov[1][1] > 0.0
        })
        .map(|(user, cov)| (user.user, cov))
        .collect()
}

/// `sqrt(mean(e' C^-1 e) / 2)` over the users that claim a position and have a bound: 1 is as good as can be.
/// `None` without such users.
#[must_use]
pub fn crlb_ratio(
    users: &[UserFix],
    truth: &BTreeMap<UserId, [f64; 2]>,
    bound: &BTreeMap<UserId, [[f64; 2]; 2]>,
) -> Option<f64> {
    let mut sum = 0.0;
    let mut count = 0u32;
    for fix in users.iter().filter(|fix| fix.status == super::FixStatus::Ok) {
        let (Some(p), Some(cov)) = (truth.get(&fix.user), bound.get(&fix.user)) else { continue };
        let e = [fix.pos_m[0] - p[0], fix.pos_m[1] - p[1]];
        sum += dot(e, mul(&inverse(*cov), e));
        count += 1;
    }
    (count > 0).then(|| (sum / (2.0 * f64::from(count))).sqrt())
}
