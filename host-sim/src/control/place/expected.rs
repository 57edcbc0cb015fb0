//! Expected service: how many users are truly within range, given how well their positions are known.
//!
//! The distance of a user from a centre is taken as normal with the variance of its position along the
//! line to the centre: `P = Phi((R - d) / sigma_radial)`. The curvature of the circle shifts the mean
//! by `sigma_tangential^2 / 2d`, 2 cm at 4 m and 500 m; the formula holds while sigma is well below R
//! (R >= 10 sigma: within 0.02).
//!
//! A step maximises the sum of these probabilities over the plane by the same branch and bound as the
//! counting objective, to a stated gap. Later drones see each user with the probability that nobody
//! serves it yet, `prod (1 - P)`: the events are taken as independent, although they share one position
//! error.

use nalgebra::Matrix2;

use super::cells::Cells;
use super::greedy::Step;
use super::refine::spiral;
use super::search::{self, Best, Bracket, Gain, Goal, Node};
use super::{KeepOut, Site};
use crate::geometry::V2;

/// A step of the expected objective is within this many expected users of its maximum, or within
/// what its smallest nodes leave open (which the upper bound accounts for).
pub const GAP_USERS: f64 = 0.01;

/// Half side of the squares of centres that are not split further; the best is then climbed from.
const SMALLEST_HALF_M: f64 = 0.25;

/// Beyond this many sigma a user is in or out for certain (3e-7 are ignored).
const CERTAIN_SIGMA: f64 = 5.0;

/// Points that stand for a user whom several drones may serve.
const UNION_POINTS: usize = 2_048;

/// A drone that adds fewer expected users than this stays at stand-by.
const LEAST_GAIN_USERS: f64 = 1e-3;

/// A located user with the uncertainty of its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UserBelief {
    /// Estimated position.
    pub pos_m: V2,
    /// Covariance of the estimate.
    pub cov_m2: Matrix2<f64>,
}

impl UserBelief {
    /// Whether the covariance is one: finite, symmetric, positive semidefinite (up to rounding).
    pub(crate) fn has_covariance(&self) -> bool {
        let c = &self.cov_m2;
        let scale = c.norm();
        scale.is_finite()
            && (c.m12 - c.m21).abs() <= 1e-9 * scale
            && c.m11 >= 0.0
            && c.m22 >= 0.0
            && c.determinant() >= -1e-9 * scale * scale
    }

    /// Probability that the user is truly within `radius_m` of `centre_m`.
    #[must_use]
    pub fn within(&self, centre_m: V2, radius_m: f64) -> f64 {
        Spread::new(&self.cov_m2).within(self.pos_m - centre_m, radius_m)
    }
}

/// Expected number of `users` truly within `radius_m` of `centre_m`, by the radial approximation of this module.
#[must_use]
pub fn expected_served(centre_m: V2, users: &[UserBelief], radius_m: f64) -> f64 {
    users.iter().map(|u| u.within(centre_m, radius_m)).sum()
}

/// Probability that a user is truly within `radius_m` of one of the sites.
///
/// Of one site by the radial approximation of this module; where several may have it, by points that stand for equal
/// shares of its probability, for what keeps it from one site may bring it to another: within 0.01.
#[must_use]
pub fn served_by_any(user: &UserBelief, sites_m: &[V2], radius_m: f64) -> f64 {
    let spread = Spread::new(&user.cov_m2);
    let chances = sites_m.iter().map(|&at| (at, spread.within(user.pos_m - at, radius_m)));
    let likely: Vec<(V2, f64)> = chances.filter(|(_, chance)| *chance > 0.0).collect();
    match likely[..] {
        [] => 0.0,
        [(_, chance)] => chance,
        _ if likely.iter().any(|(_, chance)| *chance >= 1.0) => 1.0,
        _ => {
            let points = spiral(user, 1.0, UNION_POINTS);
            let square_m2 = radius_m * radius_m;
            let inside = |p: &&V2| likely.iter().any(|(at, _)| (*p - at).norm_squared() <= square_m2);
            points.iter().filter(inside).count() as f64 / points.len() as f64
        }
    }
}

/// Standard normal distribution function.
pub(super) fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2)
}

/// A covariance, and the range of the standard deviations by direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spread {
    cov_m2: Matrix2<f64>,
    least_var_m2: f64,
    most_var_m2: f64,
    /// Beyond this much room the chance is 1, beyond this much lack of it 0.
    certain_m: f64,
}

impl Spread {
    pub(super) fn new(cov_m2: &Matrix2<f64>) -> Self {
        let mean = 0.5 * (cov_m2.m11 + cov_m2.m22);
        let half_spread = (0.5 * (cov_m2.m11 - cov_m2.m22)).hypot(cov_m2.m12);
        let (least_var_m2, most_var_m2) = ((mean - half_spread).max(0.0), mean + half_spread);
        let certain_m = CERTAIN_SIGMA * most_var_m2.sqrt() + super::TOLERANCE_M;
        Self { cov_m2: *cov_m2, least_var_m2, most_var_m2, certain_m }
    }

    /// The least and the greatest standard deviation of any direction.
    pub(super) fn sigma_range_m(&self) -> [f64; 2] {
        [self.least_var_m2.sqrt(), self.most_var_m2.sqrt()]
    }

    /// How much the radial variance may change while the centre moves by `rho_m`, the user at `distance_m`.
    ///
    /// The direction turns by asin(rho / d) <= rho / sqrt(d^2 - rho^2) at most, and the variance by
    /// direction changes by at most the difference of its extremes per radian.
    fn change_m2(&self, distance_m: f64, rho_m: f64) -> f64 {
        let extremes_m2 = self.most_var_m2 - self.least_var_m2;
        let clear_m2 = distance_m * distance_m - rho_m * rho_m;
        if clear_m2 > 0.0 { extremes_m2 * (rho_m / clear_m2.sqrt()).min(1.0) } else { extremes_m2 }
    }

    /// Variance along `offset_m`; the greatest one where that has no direction.
    pub(super) fn radial_var_m2(&self, offset_m: V2) -> f64 {
        let squared = offset_m.norm_squared();
        if squared > 0.0 {
            (offset_m.dot(&(self.cov_m2 * offset_m)) / squared).max(0.0)
        } else {
            self.most_var_m2
        }
    }

    fn within(&self, offset_m: V2, radius_m: f64) -> f64 {
        chance(radius_m - offset_m.norm(), self.radial_var_m2(offset_m))
    }
}

/// Probability that a normal error of this variance stays below `room_m`; closed where there is none.
fn chance(room_m: f64, var_m2: f64) -> f64 {
    let sigma_m = var_m2.sqrt();
    if room_m.abs() >= CERTAIN_SIGMA * sigma_m {
        return if room_m >= 0.0 { 1.0 } else { 0.0 };
    }
    normal_cdf(room_m / sigma_m)
}

/// The one-drone problem over users with a probability of being unserved.
#[derive(Debug)]
pub(super) struct Chances {
    cells: Cells,
    crowd: Crowd,
    /// Users in the `covered` list of an earlier site.
    counted: Vec<bool>,
}

/// What the search sees of the users.
#[derive(Debug)]
struct Crowd {
    positions_m: Vec<V2>,
    spreads: Vec<Spread>,
    /// Probability that nobody serves the user yet.
    unserved: Vec<f64>,
    radius_m: f64,
}

impl Chances {
    /// `None` without users.
    pub(super) fn new(users: &[UserBelief], radius_m: f64) -> Option<Self> {
        let positions_m: Vec<V2> = users.iter().map(|u| u.pos_m).collect();
        let spreads: Vec<Spread> = users.iter().map(|u| Spread::new(&u.cov_m2)).collect();
        let crowd = Crowd { positions_m, spreads, unserved: vec![0.0; users.len()], radius_m };
        let longest_m = (0..users.len()).map(|user| crowd.reach_m(user)).reduce(f64::max)?;
        let cells = Cells::new(&crowd.positions_m, longest_m);
        let mut chances = Self { cells, crowd, counted: vec![false; users.len()] };
        (0..users.len()).for_each(|user| chances.set_unserved(user, 1.0));
        Some(chances)
    }

    /// Leaves over what drones at `sites_m` do not serve, and counts everyone anew.
    pub(super) fn leave_over(&mut self, sites_m: &[V2]) {
        for user in 0..self.counted.len() {
            let missed = |&at: &V2| 1.0 - self.crowd.within(user, at);
            let probability = sites_m.iter().map(missed).product();
            self.set_unserved(user, probability);
            self.counted[user] = false;
        }
    }

    /// What a drone adds there.
    pub(super) fn value(&self, at: V2) -> f64 {
        self.crowd.value(at)
    }

    fn set_unserved(&mut self, user: usize, probability: f64) {
        let crowd = &self.crowd;
        let difference = probability - crowd.unserved[user];
        self.cells.add_weight(crowd.positions_m[user], crowd.reach_m(user), difference);
        self.crowd.unserved[user] = probability;
    }

    /// A drone there.
    pub(super) fn site(&self, at: V2) -> Site {
        let crowd = &self.crowd;
        let room_m = |user: usize| crowd.radius_m - (crowd.positions_m[user] - at).norm();
        let covered: Vec<usize> =
            (0..self.counted.len()).filter(|&user| !self.counted[user] && room_m(user) >= 0.0).collect();
        let margin_m = covered.iter().map(|&user| room_m(user)).fold(f64::INFINITY, f64::min);
        Site { pos_m: at, covered, margin_m, expected: crowd.value(at) }
    }

    /// Compass search uphill from `at`, down to a millimetre.
    fn climbed(&self, at: V2, keep_out: &KeepOut) -> V2 {
        let (mut at, mut value) = (at, self.crowd.value(at));
        let mut step_m = 4.0 * SMALLEST_HALF_M;
        while step_m > 1e-3 {
            let ways = [V2::x(), V2::y(), -V2::x(), -V2::y()].map(|way| at + way * step_m);
            let better =
                ways.into_iter().filter(|&to| keep_out.allows(to)).map(|to| (self.crowd.value(to), to));
            match better.reduce(|a, b| if b.0 > a.0 { b } else { a }) {
                Some((higher, to)) if higher > value + 1e-12 => (at, value) = (to, higher),
                _ => step_m *= 0.5,
            }
        }
        at
    }
}

impl Step for Chances {
    fn best(&self, keep_out: &KeepOut) -> Option<(Site, f64)> {
        let goal = Goal { above: LEAST_GAIN_USERS, gap: GAP_USERS, ..Goal::best(None) };
        let found = search::search(&self.cells, &self.crowd, keep_out, goal);
        let site = self.site(self.climbed(found.at?, keep_out));
        let ceiling = found.ceiling.max(site.expected);
        Some((site, ceiling))
    }

    fn ceiling(&self) -> f64 {
        let goal = Goal { above: LEAST_GAIN_USERS, gap: GAP_USERS, ..Goal::best(None) };
        search::search(&self.cells, &self.crowd, &KeepOut::default(), goal).ceiling
    }

    fn serve(&mut self, site: &Site) {
        for user in 0..self.counted.len() {
            let within = self.crowd.within(user, site.pos_m);
            if within > 0.0 {
                self.set_unserved(user, self.crowd.unserved[user] * (1.0 - within));
            }
        }
        site.covered.iter().for_each(|&user| self.counted[user] = true);
    }
}

impl Crowd {
    /// Distance at which a user is out for certain.
    fn reach_m(&self, user: usize) -> f64 {
        self.radius_m + self.spreads[user].certain_m
    }

    fn within(&self, user: usize, centre_m: V2) -> f64 {
        self.spreads[user].within(self.positions_m[user] - centre_m, self.radius_m)
    }

    fn value(&self, centre_m: V2) -> f64 {
        (0..self.positions_m.len()).map(|user| self.unserved[user] * self.within(user, centre_m)).sum()
    }
}

impl Gain for Crowd {
    fn bracket(&self, user: u32, at: V2, rho_m: f64) -> Bracket {
        let user = user as usize;
        let (weight, spread) = (self.unserved[user], &self.spreads[user]);
        let offset_m = self.positions_m[user] - at;
        let distance_m = offset_m.norm();
        let room_m = self.radius_m - distance_m;
        if weight <= 0.0 || room_m <= -(rho_m + spread.certain_m) {
            return Bracket::Never;
        }
        if room_m >= rho_m + spread.certain_m {
            return Bracket::Always(weight);
        }
        // With more room the chance grows. More variance hurts where there is room, and helps where not.
        let radial = spread.radial_var_m2(offset_m);
        let nearest_m = room_m + rho_m.min(distance_m);
        let slack = spread.change_m2(distance_m, rho_m);
        let helpful = if nearest_m >= 0.0 {
            (radial - slack).max(spread.least_var_m2)
        } else {
            (radial + slack).min(spread.most_var_m2)
        };
        Bracket::Varying {
            at_middle: weight * chance(room_m, radial),
            greatest: weight * chance(nearest_m, helpful),
        }
    }

    fn settle(&self, node: &Node, keep_out: &KeepOut, _: &mut Best) -> Option<f64> {
        let flat = node.open.is_empty() && keep_out.allows(node.at);
        (flat || node.half_m <= SMALLEST_HALF_M).then_some(node.ceiling)
    }
}
