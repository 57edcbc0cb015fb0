//! Whether a fix deserves trust: bad fits and their second starts, mirror points, profiles, the status.

use super::model::{FixStatus, LocalizeConfig, UserFix};
use super::normal::{Fit, Sym2, UserBlock, sym_inverse, sym_mul};
use super::problem::{Problem, UserSpan};
use super::r95::{eigenvalues, r95};
use super::robust::{Loss, linearise};
use super::solve::{State, position_prior};

/// A clean pass throws out some 10 % of its captures (5 % late, more of them in pairs); beyond this share something
/// else is wrong.
const BAD_FIT_REJECTED: f64 = 0.35;
/// Beyond this share a fix is refused.
const INCONSISTENT_REJECTED: f64 = 0.6;
/// Largest deviation of a chi-square from its mean, in its standard deviations.
const CHI2_SIGMAS: f64 = 6.0;
/// Half the cost difference that a point at 3 standard deviations has.
pub(super) const COMPARABLE_COST: f64 = 4.5;
/// 95 % quantile of a chi-square with two degrees of freedom.
const CHI2_95: f64 = 5.991;
/// A descent ends when a step gains less.
const ENOUGH_GAIN: f64 = 1e-3;
/// Occasions of a first look at a mirror point.
const GLANCE: usize = 16;
/// Fixes with a smaller r95 are in the linear range (the geometry curves over some 300 m): no profile needed.
const PROFILE_FROM_R95_M: f64 = 25.0;

/// What can be said of a user without TDOAs: it was about where the drones were.
pub(super) fn not_located(user: &UserSpan, cfg: &LocalizeConfig) -> UserFix {
    let variance_m2 = cfg.expected_radius_m.powi(2);
    let cov_m2 = [[variance_m2, 0.0], [0.0, variance_m2]];
    UserFix {
        user: user.user,
        pos_m: user.centroid_m,
        cov_m2,
        r95_m: r95(cov_m2),
        status: FixStatus::NotLocated,
        occasions: user.span.len() as u32,
        rejected: 0,
        last_heard_s: user.last_heard_s,
    }
}

/// The status of user `u`; `known_clocks_cov` is its covariance if the clocks were known.
pub(super) fn status(
    problem: &Problem,
    cfg: &LocalizeConfig,
    state: &State,
    u: usize,
    fit: &Fit,
    r95_m: f64,
    known_clocks_cov: Sym2,
) -> FixStatus {
    if fit.tdoas < 2 {
        return FixStatus::NotLocated;
    }
    if rejected_share(fit) > INCONSISTENT_REJECTED || is_excessive(fit) {
        return FixStatus::Inconsistent;
    }
    if r95_m.is_nan() || r95_m > cfg.max_r95_m {
        return FixStatus::PoorGeometry;
    }
    let one = OneUser::new(problem, cfg, state, u);
    if one.has_rival(state.pos_m[u], r95_m) {
        return FixStatus::Ambiguous;
    }
    if r95_m > PROFILE_FROM_R95_M && !one.profile_is_parabola(state.pos_m[u], known_clocks_cov) {
        return FixStatus::PoorGeometry;
    }
    FixStatus::Ok
}

fn rejected_share(fit: &Fit) -> f64 {
    1.0 - f64::from(fit.accepted) / f64::from(fit.captures.max(1))
}

/// Whether the residuals are larger than their noise allows.
fn is_excessive(fit: &Fit) -> bool {
    let dof = f64::from(fit.tdoas) - 2.0;
    fit.chi2 - dof > CHI2_SIGMAS * (2.0 * dof.max(1.0)).sqrt()
}

/// Looks for users whose captures are thrown out in numbers, or fit badly, and tries other starts for them with the clocks as
/// they are. Says whether any user moved to a better point.
pub(super) fn restart_bad_fits(
    problem: &Problem,
    cfg: &LocalizeConfig,
    fits: &[Fit],
    state: &mut State,
) -> bool {
    let mut moved = false;
    for (u, fit) in fits.iter().enumerate() {
        if rejected_share(fit) <= BAD_FIT_REJECTED && !is_excessive(fit) {
            continue;
        }
        let one = OneUser::new(problem, cfg, state, u);
        let here = state.pos_m[u];
        let cost = one.cost(here);
        let best = (starts(one.user, cfg).into_iter().map(|start| one.descend(start, 1)))
            .map(|p| (p, one.cost(p)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((pos_m, best_cost)) = best
            && best_cost < cost - 1.0
        {
            state.pos_m[u] = pos_m;
            moved = true;
        }
    }
    moved
}

/// Points around the centroid, and the centroid.
pub(super) fn starts(user: &UserSpan, cfg: &LocalizeConfig) -> Vec<[f64; 2]> {
    let [x, y] = user.centroid_m;
    let [tx, ty] = user.track;
    let reach = 0.6 * cfg.expected_radius_m;
    let mut starts = vec![[x, y]];
    starts.extend((0..8).map(|k| {
        let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
        [x + reach * (cos * tx - sin * ty), y + reach * (cos * ty + sin * tx)]
    }));
    starts
}

/// How far apart two points must be to contradict each other.
pub(super) fn distinct_m(r95_m: f64) -> f64 {
    (2.0 * r95_m).max(1.0)
}

/// Ends of the major axis of the 95 % ellipse around `p`.
pub(super) fn ellipse_ends(p: [f64; 2], cov: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let [major, _] = eigenvalues(cov);
    let (sin, cos) = (0.5 * f64::atan2(2.0 * cov[0][1], cov[0][0] - cov[1][1])).sin_cos();
    let reach = (CHI2_95 * major).sqrt();
    [reach, -reach].map(|reach| [p[0] + reach * cos, p[1] + reach * sin])
}

/// Whether a rise of the cost at the end of a 95 % ellipse is what a Gaussian has there, half of `CHI2_95`. Beyond
/// a factor of 2 it is no description of the error.
pub(super) fn rise_is_parabolic(rise: f64) -> bool {
    (0.25 * CHI2_95..CHI2_95).contains(&rise)
}

/// One user with the clocks held.
struct OneUser<'a> {
    problem: &'a Problem,
    cfg: &'a LocalizeConfig,
    state: &'a State,
    user: &'a UserSpan,
}

impl<'a> OneUser<'a> {
    fn new(problem: &'a Problem, cfg: &'a LocalizeConfig, state: &'a State, u: usize) -> Self {
        Self { problem, cfg, state, user: &problem.users[u] }
    }

    /// Normal equations at `p`, from every `stride`-th occasion.
    fn linearise(&self, p: [f64; 2], loss: &Loss, stride: usize) -> UserBlock {
        let mut block = UserBlock::new(self.user, p, position_prior(self.cfg));
        for heard in self.problem.heard[self.user.span.clone()].iter().step_by(stride) {
            let (interval, fraction) = self.state.grid.locate(heard.time_s);
            let clock_ns = self.state.clocks.of_captures(heard, interval, fraction);
            block.add(heard, &linearise(heard, p, clock_ns, loss));
        }
        block
    }

    fn cost(&self, p: [f64; 2]) -> f64 {
        self.linearise(p, &Loss::new(self.cfg.robust, 1.0), 1).fit.cost
    }

    /// Graduated Levenberg-Marquardt from `start` on every `stride`-th occasion.
    fn descend(&self, start: [f64; 2], stride: usize) -> [f64; 2] {
        let mut p = start;
        for (scale, steps) in [(16.0, 2), (4.0, 2), (1.0, 10)] {
            let loss = Loss::new(self.cfg.robust, scale);
            let mut here = self.linearise(p, &loss, stride);
            let mut damping = 0.0;
            for _ in 0..steps {
                let [xx, xy, yy] = here.info;
                let d = sym_mul(sym_inverse([xx * (1.0 + damping), xy, yy * (1.0 + damping)]), here.gradient);
                let shorten = (0.5 * self.cfg.expected_radius_m / d[0].hypot(d[1])).min(1.0);
                let trial = [p[0] + shorten * d[0], p[1] + shorten * d[1]];
                let there = self.linearise(trial, &loss, stride);
                let gained = here.fit.cost - there.fit.cost;
                if gained < 0.0 {
                    damping = (damping * 10.0).max(1e-2);
                    continue;
                }
                (p, here) = (trial, there);
                damping *= 0.1;
                if gained < ENOUGH_GAIN {
                    break;
                }
            }
        }
        p
    }

    /// Whether the point mirrored at the drones' track leads to another minimum that is about as good.
    fn has_rival(&self, p: [f64; 2], r95_m: f64) -> bool {
        let [tx, ty] = self.user.track;
        let [cx, cy] = self.user.centroid_m;
        let across = (p[0] - cx) * -ty + (p[1] - cy) * tx;
        let mirrored = [p[0] + 2.0 * across * ty, p[1] - 2.0 * across * tx];
        let far = |q: [f64; 2]| (q[0] - p[0]).hypot(q[1] - p[1]) > distinct_m(r95_m);
        if !far(mirrored) {
            return false;
        }
        let stride = (self.user.span.len() / GLANCE).max(1);
        if !far(self.descend(mirrored, stride)) {
            return false;
        }
        let rival = self.descend(mirrored, 1);
        far(rival) && self.cost(rival) < self.cost(p) + COMPARABLE_COST
    }

    /// Whether the cost rises at both ends of the ellipse as its covariance claims.
    fn profile_is_parabola(&self, p: [f64; 2], [xx, xy, yy]: Sym2) -> bool {
        let cost = self.cost(p);
        ellipse_ends(p, [[xx, xy], [xy, yy]]).into_iter().all(|end| rise_is_parabolic(self.cost(end) - cost))
    }
}
