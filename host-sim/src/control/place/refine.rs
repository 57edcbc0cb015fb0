//! Moving a drone by metres once it hovers: who it hears tells more of where users are than the sweep did.
//!
//! A drone hears exactly the users within its coverage radius, so a user heard from `c` is within
//! `radius_m` of `c` and one not heard is beyond. A [`Cloud`] is a user's belief conditioned on all that
//! was heard: points that stand for equal shares of the probability. [`best_move`] looks for the place
//! around a site at which a trial promises most. A trial that disappoints is flown back, so what counts
//! is the expected improvement `E[max(N - n, 0)]` over the `n` users served now (Mockus 1975), not the
//! expected service: a place that wins a user with probability 0.4 and loses one otherwise is worth 0.4.
//!
//! Users are independent given their beliefs. Deterministic: the points are a fixed spiral, not a draw.

use std::f64::consts::{FRAC_1_SQRT_2, GOLDEN_RATIO, TAU};

use super::UserBelief;
use crate::geometry::V2;

/// How far from its true distance a hovering drone may hear or miss a user: it sways by some centimetres,
/// and knows its position as well.
const HOVER_SIGMA_M: f64 = 0.15;

/// Points of the spiral that stand for a Gaussian before anything was heard.
const SPIRAL_POINTS: usize = 2_048;

/// Points of a cloud.
const CLOUD_POINTS: usize = 128;

/// A belief that leaves less than this share for what was heard was too narrow, and is widened.
const LEAST_EVIDENCE: f64 = 2e-3;

/// How often a belief is widened, each time to twice its sigma, before what was heard is put aside.
const MOST_WIDENINGS: u32 = 3;

/// A move leads at most this far from the site: several sigma of a user's position.
pub const REACH_M: f64 = 30.0;

/// Grid on which a move is sought first.
const GRID_M: f64 = 3.0;

/// Grid points from which the search climbs on.
const CLIMBS: usize = 4;

/// What a hovering drone heard of a user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hearing {
    /// Where it hovered.
    pub centre_m: V2,
    /// Whether it heard the user.
    pub heard: bool,
}

impl Hearing {
    /// Probability of this for a user at `at`.
    fn likelihood(&self, at: V2, radius_m: f64) -> f64 {
        let room_m = radius_m - (at - self.centre_m).norm();
        let z = if self.heard { room_m } else { -room_m } / HOVER_SIGMA_M;
        0.5 * libm::erfc(-z * FRAC_1_SQRT_2)
    }
}

/// Where a user may be: points that stand for equal shares of the probability.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    points_m: Vec<V2>,
    centre_m: V2,
    /// No point is farther from the centre.
    extent_m: f64,
}

impl Cloud {
    /// The belief given all that was `heard` of the user.
    ///
    /// Hearings that the belief all but rules out widen it; if it still does, they are put aside.
    #[must_use]
    pub fn new(belief: &UserBelief, heard: &[Hearing], radius_m: f64) -> Self {
        let prior = || Self::of(spiral(belief, 1.0, CLOUD_POINTS));
        if heard.is_empty() {
            return prior();
        }
        for widening in 0..=MOST_WIDENINGS {
            let points_m = spiral(belief, f64::from(1 << widening), SPIRAL_POINTS);
            let weights: Vec<f64> =
                points_m.iter().map(|p| heard.iter().map(|h| h.likelihood(*p, radius_m)).product()).collect();
            if weights.iter().sum::<f64>() >= LEAST_EVIDENCE * SPIRAL_POINTS as f64 {
                return Self::of(resampled(&points_m, &weights));
            }
        }
        prior()
    }

    fn of(points_m: Vec<V2>) -> Self {
        let centre_m = points_m.iter().sum::<V2>() / points_m.len() as f64;
        let extent_m = points_m.iter().map(|p| (p - centre_m).norm()).fold(0.0, f64::max);
        Self { points_m, centre_m, extent_m }
    }

    /// Probability that the user is within `radius_m` of `at`.
    #[must_use]
    pub fn within(&self, at: V2, radius_m: f64) -> f64 {
        let room_m = radius_m - (at - self.centre_m).norm();
        if room_m.abs() > self.extent_m {
            return if room_m > 0.0 { 1.0 } else { 0.0 };
        }
        let square_m2 = radius_m * radius_m;
        let inside = self.points_m.iter().filter(|p| (at - *p).norm_squared() <= square_m2).count();
        inside as f64 / self.points_m.len() as f64
    }

    /// Whether some place within `reach_m` of `at` may serve the user.
    #[must_use]
    pub fn in_reach(&self, at: V2, radius_m: f64, reach_m: f64) -> bool {
        (at - self.centre_m).norm() <= radius_m + reach_m + self.extent_m
    }
}

/// A move of one drone, and the users that trying it is expected to win.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Where to.
    pub to_m: V2,
    /// Expected improvement over the users served now.
    pub gain_users: f64,
}

/// The move within [`REACH_M`] of `from_m` that promises most, where `served` of `users` are served now.
/// Places that `allowed` refuses are not taken.
#[must_use]
pub fn best_move(
    from_m: V2,
    users: &[&Cloud],
    served: usize,
    radius_m: f64,
    allowed: impl Fn(V2) -> bool,
) -> Option<Move> {
    let mut counts = Counts::default();
    let mut value = |to_m: V2| {
        let gain_users = counts.improvement(users.iter().map(|u| u.within(to_m, radius_m)), served);
        Move { to_m, gain_users }
    };
    let open = |to_m: &V2| (to_m - from_m).norm() <= REACH_M && allowed(*to_m);
    let rings = (REACH_M / GRID_M) as i32;
    let grid = (-rings..=rings).flat_map(|i| (-rings..=rings).map(move |j| V2::new(i.into(), j.into())));
    let mut starts: Vec<Move> =
        grid.map(|step| from_m + step * GRID_M).filter(open).map(&mut value).collect();
    // Stable: of equals, the first of the grid.
    starts.sort_by(|a, b| b.gain_users.total_cmp(&a.gain_users));
    starts.truncate(CLIMBS);
    let climbed = starts.into_iter().map(|start| {
        let (mut best, mut step_m) = (start, 0.5 * GRID_M);
        while step_m > 0.1 {
            let ways = [V2::x(), V2::y(), -V2::x(), -V2::y()].map(|way| best.to_m + way * step_m);
            let better = ways.into_iter().filter(open).map(&mut value);
            match better.reduce(|a, b| if b.gain_users > a.gain_users { b } else { a }) {
                Some(higher) if higher.gain_users > best.gain_users + 1e-12 => best = higher,
                _ => step_m *= 0.5,
            }
        }
        best
    });
    climbed.reduce(|a, b| if b.gain_users > a.gain_users { b } else { a })
}

/// Distribution of the number of users served; kept to allocate once.
#[derive(Debug, Default)]
struct Counts {
    /// Probability of each number beyond the certain ones.
    shares: Vec<f64>,
}

impl Counts {
    /// `E[max(N - served, 0)]` for independent users with these chances.
    fn improvement(&mut self, chances: impl Iterator<Item = f64>, served: usize) -> f64 {
        let mut certain = 0;
        self.shares.clear();
        self.shares.push(1.0);
        for chance in chances {
            if chance >= 1.0 {
                certain += 1;
            } else if chance > 0.0 {
                let mut fewer = 0.0;
                for share in &mut self.shares {
                    let here = *share;
                    *share = here * (1.0 - chance) + fewer;
                    fewer = here * chance;
                }
                self.shares.push(fewer);
            }
        }
        let gain = |extra: usize| (certain + extra).saturating_sub(served) as f64;
        self.shares.iter().enumerate().map(|(extra, share)| share * gain(extra)).sum()
    }
}

/// Points of equal probability under the belief with `scale` times its sigma: a sunflower's spiral, whose
/// squared radii are quantiles of the exponential distribution.
pub(super) fn spiral(belief: &UserBelief, scale: f64, points: usize) -> Vec<V2> {
    let c = &belief.cov_m2;
    // Cholesky's factor; a covariance may be singular.
    let xx = c.m11.max(0.0).sqrt();
    let xy = if xx > 0.0 { c.m12 / xx } else { 0.0 };
    let yy = (c.m22 - xy * xy).max(0.0).sqrt();
    let point = |index: usize| {
        let share = (index as f64 + 0.5) / points as f64;
        let radius = scale * (-2.0 * (-share).ln_1p()).sqrt();
        let (sin, cos) = (TAU * (index as f64 / GOLDEN_RATIO).fract()).sin_cos();
        belief.pos_m + V2::new(xx * cos, xy * cos + yy * sin) * radius
    };
    (0..points).map(point).collect()
}

/// [`CLOUD_POINTS`] of the points, each as often as its weight asks (systematic resampling).
fn resampled(points_m: &[V2], weights: &[f64]) -> Vec<V2> {
    let total: f64 = weights.iter().sum();
    let mut points = points_m.iter().zip(weights);
    let (mut sum, mut current) = (0.0, points_m.first());
    let pick = |k: usize| {
        let until = (k as f64 + 0.5) / CLOUD_POINTS as f64 * total;
        while sum < until
            && let Some((point, weight)) = points.next()
        {
            sum += weight;
            current = Some(point);
        }
        current.copied()
    };
    (0..CLOUD_POINTS).filter_map(pick).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix2;
    use proptest::prelude::*;

    const RADIUS_M: f64 = 500.0;

    fn belief(x: f64, y: f64, sigma_x_m: f64, sigma_y_m: f64, correlation: f64) -> UserBelief {
        let xy = correlation * sigma_x_m * sigma_y_m;
        let cov_m2 = Matrix2::new(sigma_x_m * sigma_x_m, xy, xy, sigma_y_m * sigma_y_m);
        UserBelief { pos_m: V2::new(x, y), cov_m2 }
    }

    #[test]
    fn truth_the_spiral_has_the_moments_of_its_belief() {
        let belief = belief(10.0, -20.0, 3.0, 5.0, -0.6);
        let points = spiral(&belief, 1.0, SPIRAL_POINTS);
        let mean = points.iter().sum::<V2>() / points.len() as f64;
        assert!((mean - belief.pos_m).norm() < 0.02, "{mean}");
        let spread: Matrix2<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
        let error = spread / points.len() as f64 - belief.cov_m2;
        assert!(error.norm() < 0.02 * belief.cov_m2.norm(), "{error}");
    }

    #[test]
    fn truth_what_is_heard_cuts_the_belief() {
        // A user on the border of a drone's disk: heard, the belief is the half inside, whose mean lies
        // sigma sqrt(2 / pi) inwards.
        let user = belief(RADIUS_M, 0.0, 4.0, 4.0, 0.0);
        for (heard, side) in [(true, -1.0), (false, 1.0)] {
            let cloud = Cloud::new(&user, &[Hearing { centre_m: V2::zeros(), heard }], RADIUS_M);
            let expected = RADIUS_M + side * 4.0 * (2.0 / std::f64::consts::PI).sqrt();
            assert!((cloud.centre_m.x - expected).abs() < 0.4, "{}", cloud.centre_m.x);
            let within = cloud.within(V2::zeros(), RADIUS_M);
            assert!((within - f64::from(u8::from(heard))).abs() < 0.05, "{within}");
        }
    }

    #[test]
    fn a_belief_that_was_too_narrow_is_widened_and_an_absurd_hearing_put_aside() {
        let hearing = |x: f64| [Hearing { centre_m: V2::new(x, 0.0), heard: true }];
        let user = belief(RADIUS_M + 12.0, 0.0, 2.0, 2.0, 0.0);
        assert!(Cloud::new(&user, &hearing(0.0), RADIUS_M).within(V2::zeros(), RADIUS_M) > 0.9);
        assert_eq!(Cloud::new(&user, &hearing(-900.0), RADIUS_M), Cloud::new(&user, &[], RADIUS_M));
    }

    /// Every outcome, one by one.
    fn by_enumeration(chances: &[f64], served: usize) -> f64 {
        let outcome = |bits: u32| {
            let with = |k: usize| bits >> k & 1 == 1;
            let chance = |(k, p): (usize, &f64)| if with(k) { *p } else { 1.0 - p };
            let share: f64 = chances.iter().enumerate().map(chance).product();
            share * (bits.count_ones() as usize).saturating_sub(served) as f64
        };
        (0..1 << chances.len()).map(outcome).sum()
    }

    proptest! {
        #[test]
        fn truth_the_improvement_is_the_mean_over_all_outcomes(
            mut chances in prop::collection::vec(0.0..=1.0_f64, 0..9),
            sure in 0..3_usize,
            served in 0..10_usize,
        ) {
            chances.iter_mut().take(sure).for_each(|p| *p = p.round());
            let found = Counts::default().improvement(chances.iter().copied(), served);
            prop_assert!((found - by_enumeration(&chances, served)).abs() < 1e-12);
        }

        /// A move stays in reach and where it is allowed, and its gain is what its place promises.
        #[test]
        fn a_move_obeys_and_keeps_its_promise(
            users in prop::collection::vec((-520.0..520.0_f64, -520.0..520.0_f64), 1..12),
            barred in (-25.0..25.0_f64, -25.0..25.0_f64),
            served in 0..12_usize,
        ) {
            let cloud = |&(x, y): &(f64, f64)| Cloud::new(&belief(x, y, 4.0, 4.0, 0.0), &[], RADIUS_M);
            let clouds: Vec<Cloud> = users.iter().map(cloud).collect();
            let clouds: Vec<&Cloud> = clouds.iter().collect();
            let allowed = |at: V2| (at - V2::from(<[f64; 2]>::from(barred))).norm() >= 16.0;
            let found = best_move(V2::zeros(), &clouds, served, RADIUS_M, allowed).unwrap();
            prop_assert!(found.to_m.norm() <= REACH_M && allowed(found.to_m));
            let chances = |at: V2| clouds.iter().map(move |c| c.within(at, RADIUS_M));
            let promise = Counts::default().improvement(chances(found.to_m), served);
            prop_assert!((found.gain_users - promise).abs() < 1e-12);
            // No place of the grid promises more.
            for at in [V2::zeros(), V2::new(6.0, -9.0), V2::new(-12.0, 21.0)] {
                let there = Counts::default().improvement(chances(at), served);
                prop_assert!(!allowed(at) || there <= found.gain_users);
            }
        }
    }

    #[test]
    fn nothing_is_allowed_so_nothing_is_found() {
        assert_eq!(best_move(V2::zeros(), &[], 0, RADIUS_M, |_| false), None);
    }
}
