//! Whether a fix deserves trust: bad fits and their second starts, mirror points, profiles, the status.

use super::model::{FixStatus, LocalizeConfig, UserFix};
use super::normal::{Fit, UserBlock};
use super::problem::{Problem, UserSpan};
use super::r95::{eigenvalues, r95};
use super::robust::{Loss, linearise};
use super::small::{Mat, dot, horizontal, inverse, mul};
use super::solve::{State, position_prior};

/// A clean pass throws out some 10 % of its captures (5 % late, more of them in pairs); beyond this share something
/// else is wrong.
const BAD_FIT_REJECTED: f64 = 0.35;
/// Beyond this share a fix is refused.
const INCONSISTENT_REJECTED: f64 = 0.5;
/// Largest deviation of a chi-square from its mean, in its standard deviations.
const CHI2_SIGMAS: f64 = 6.0;
/// Half the cost difference that a point at 3 standard deviations has.
pub(super) const COMPARABLE_COST: f64 = 4.5;
/// 95 % quantile of a chi-square with two degrees of freedom.
const CHI2_95: f64 = 5.991;
/// A descent ends when a step gains less; a first look may miss the minimum by as much as it can tell.
const ENOUGH_GAIN: f64 = 1e-3;
const GLANCE_GAIN: f64 = 0.3;
/// Occasions of a first look at a mirror point.
const GLANCE: usize = 8;
/// Share of r95 by which the prior may move a fix.
const MOST_PULL: f64 = 0.2;
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
        altitude_m: cfg.user_altitude_m,
        altitude_sigma_m: cfg.user_altitude_sigma_m,
        status: FixStatus::NotLocated,
        occasions: user.span.len() as u32,
        rejected: 0,
        last_heard_s: user.last_heard_s,
    }
}

/// The status of user `u`; `known_clocks_cov` is its covariance if the clocks were known.
pub(super) fn status<const D: usize>(
    problem: &Problem,
    cfg: &LocalizeConfig,
    state: &State<D>,
    u: usize,
    fit: &Fit,
    r95_m: f64,
    known_clocks_cov: &Mat<D>,
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

/// Whether the belief that a user is near the drones moved its fix by more than can be left unsaid.
pub(super) fn is_pulled<const D: usize>(
    user: &UserSpan,
    cfg: &LocalizeConfig,
    p: [f64; D],
    cov: &Mat<2>,
    r95_m: f64,
) -> bool {
    let prior = position_prior(cfg).horizontal_info;
    let away = [prior * (p[0] - user.centroid_m[0]), prior * (p[1] - user.centroid_m[1])];
    let [east, north] = mul(cov, away);
    east.hypot(north) > MOST_PULL * r95_m
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
pub(super) fn restart_bad_fits<const D: usize>(
    problem: &Problem,
    cfg: &LocalizeConfig,
    fits: &[Fit],
    state: &mut State<D>,
) -> bool {
    let mut moved = false;
    for (u, fit) in fits.iter().enumerate() {
        if rejected_share(fit) <= BAD_FIT_REJECTED && !is_excessive(fit) {
            continue;
        }
        let one = OneUser::new(problem, cfg, state, u);
        let cost = one.cost(state.pos_m[u]);
        let best = (starts(one.user, cfg).into_iter().map(|start| one.descend(start, 1, ENOUGH_GAIN)))
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

/// The centroid and points around it, at the altitude assumed.
pub(super) fn starts<const D: usize>(user: &UserSpan, cfg: &LocalizeConfig) -> Vec<[f64; D]> {
    let [x, y] = user.centroid_m;
    let [tx, ty] = user.track;
    let reach = 0.6 * cfg.expected_radius_m;
    let around = (0..8).map(|k| {
        let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
        [x + reach * (cos * tx - sin * ty), y + reach * (cos * ty + sin * tx)]
    });
    std::iter::once([x, y]).chain(around).map(on_ground).collect()
}

/// A point at the altitude assumed.
pub(super) fn on_ground<const D: usize>(p: [f64; 2]) -> [f64; D] {
    std::array::from_fn(|axis| p.get(axis).copied().unwrap_or(0.0))
}

/// Horizontal distance of two points.
pub(super) fn apart_m<const D: usize>(a: [f64; D], b: [f64; D]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

/// How far apart two points must be to contradict each other.
pub(super) fn distinct_m(r95_m: f64) -> f64 {
    (2.0 * r95_m).max(1.0)
}

/// Ends of the major axis of the horizontal 95 % ellipse around `p`, at the altitude likeliest there.
pub(super) fn ellipse_ends<const D: usize>(p: [f64; D], cov: &Mat<D>) -> [[f64; D]; 2] {
    let level = horizontal(cov);
    let [major, _] = eigenvalues(level);
    let (sin, cos) = (0.5 * f64::atan2(2.0 * level[0][1], level[0][0] - level[1][1])).sin_cos();
    let reach = (CHI2_95 * major).sqrt();
    [reach, -reach].map(|reach| {
        let away = [reach * cos, reach * sin];
        let whitened = mul(&inverse(level), away);
        std::array::from_fn(|axis| p[axis] + dot([cov[axis][0], cov[axis][1]], whitened))
    })
}

/// Whether a rise of the cost at the end of a 95 % ellipse is what a Gaussian has there, half of `CHI2_95`. Beyond
/// a factor of 2 it is no description of the error.
pub(super) fn rise_is_parabolic(rise: f64) -> bool {
    (0.25 * CHI2_95..CHI2_95).contains(&rise)
}

/// One user with the clocks held.
struct OneUser<'a, const D: usize> {
    problem: &'a Problem,
    cfg: &'a LocalizeConfig,
    state: &'a State<D>,
    user: &'a UserSpan,
}

impl<'a, const D: usize> OneUser<'a, D> {
    fn new(problem: &'a Problem, cfg: &'a LocalizeConfig, state: &'a State<D>, u: usize) -> Self {
        Self { problem, cfg, state, user: &problem.users[u] }
    }

    /// Normal equations at `p`, from every `stride`-th occasion.
    fn linearise(&self, p: [f64; D], loss: &Loss, stride: usize) -> UserBlock<D> {
        let mut block = UserBlock::new(self.user, p, position_prior(self.cfg));
        for i in self.user.span.clone().step_by(stride) {
            let heard = &self.problem.heard[i];
            block.add(heard, &linearise(heard, p, self.state.clock_ns(heard), loss));
        }
        block
    }

    fn cost(&self, p: [f64; D]) -> f64 {
        self.cost_of(p, 1)
    }

    /// Cost by every `stride`-th occasion.
    fn cost_of(&self, p: [f64; D], stride: usize) -> f64 {
        self.linearise(p, &Loss::new(self.cfg.robust, 1.0), stride).fit.cost
    }

    /// Graduated Levenberg-Marquardt from `start` on every `stride`-th occasion, until a step gains less than `enough`:
    /// the point reached, and its cost.
    fn descend(&self, start: [f64; D], stride: usize, enough: f64) -> ([f64; D], f64) {
        let mut p = start;
        let mut cost = f64::INFINITY;
        for (scale, steps) in self.cfg.robust.stages(&[(16.0, 2), (4.0, 2), (1.0, 10)]) {
            let loss = Loss::new(self.cfg.robust, *scale);
            let mut here = self.linearise(p, &loss, stride);
            let mut damping = 0.0;
            for _ in 0..*steps {
                let mut damped = here.info;
                (0..D).for_each(|axis| damped[axis][axis] *= 1.0 + damping);
                let trial = stepped(p, mul(&inverse(damped), here.gradient), self.cfg);
                let there = self.linearise(trial, &loss, stride);
                let gained = here.fit.cost - there.fit.cost;
                if gained < 0.0 {
                    damping = (damping * 10.0).max(1e-2);
                    continue;
                }
                (p, here) = (trial, there);
                damping *= 0.1;
                if gained < enough {
                    break;
                }
            }
            cost = here.fit.cost;
        }
        (p, cost)
    }

    /// Whether the point mirrored at the drones' track leads to another minimum that is about as good.
    fn has_rival(&self, p: [f64; D], r95_m: f64) -> bool {
        let [tx, ty] = self.user.track;
        let [cx, cy] = self.user.centroid_m;
        let across = (p[0] - cx) * -ty + (p[1] - cy) * tx;
        let mut mirrored = p;
        mirrored[0] += 2.0 * across * ty;
        mirrored[1] -= 2.0 * across * tx;
        let far = |q: [f64; D]| apart_m(p, q) > distinct_m(r95_m);
        if !far(mirrored) {
            return false;
        }
        let stride = (self.user.span.len() / GLANCE).max(1);
        let (glance, cost) = self.descend(mirrored, stride, GLANCE_GAIN);
        // Worse already by what some of the occasions say, and the others will say the same.
        if !far(glance) || cost > self.cost_of(p, stride) + COMPARABLE_COST {
            return false;
        }
        let (rival, cost) = self.descend(glance, 1, ENOUGH_GAIN);
        far(rival) && cost < self.cost(p) + COMPARABLE_COST
    }

    /// Whether the cost rises at both ends of the ellipse as its covariance claims.
    fn profile_is_parabola(&self, p: [f64; D], cov: &Mat<D>) -> bool {
        let cost = self.cost(p);
        ellipse_ends(p, cov).into_iter().all(|end| rise_is_parabolic(self.cost(end) - cost))
    }
}

/// A step, no longer than half the radius that users are expected in.
pub(super) fn stepped<const D: usize>(p: [f64; D], d: [f64; D], cfg: &LocalizeConfig) -> [f64; D] {
    let shorten = (0.5 * cfg.expected_radius_m / dot(d, d).sqrt()).min(1.0);
    std::array::from_fn(|axis| p[axis] + shorten * d[axis])
}
