//! Users that count as covered when they are in range with a given probability.
//!
//! By the radial approximation of [`super::expected`] a user is within `R` of a centre at distance d with probability p or
//! more where `d <= R - z sigma(direction)`, z being the p-quantile of the normal distribution. That is a disk whose
//! radius depends a little on the direction. It lies between two disks, of the largest and the least sigma. The
//! optimum for the smaller disks is a placement; the bound for the larger ones holds for all placements; and the sites of
//! both are counted by the rule itself. With equal sigma in all directions nothing is lost; with 3 m and 6 m
//! the disks differ by 5 m.

use super::expected::Spread;
use super::greedy::{check, none};
use super::search::SAME_VALUE;
use super::{
    Fleet, KeepOut, LARGEST_COORDINATE_M, Objective, PlaceError, PlaceUser, Placement, Site, UserBelief,
    centre,
};
use crate::geometry::V2;

/// Rounds of centres for the radii of the last ones.
const CENTRING_ROUNDS: usize = 6;

/// A user and what covering it is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Where it is believed to be.
    pub belief: UserBelief,
    /// What covering it is worth.
    pub weight: f64,
}

/// Places a fleet for the greatest weight of users that are within `radius_m` of a drone with a probability of at least
/// `confidence`. `solve` places for disks, and its bounds must hold for all placements.
///
/// # Errors
/// [`PlaceError`] names the user and the field that is not finite, out of range or negative.
pub fn place_confident(
    users: &[Wanted],
    radius_m: f64,
    confidence: f64,
    fleet: Fleet,
    mut solve: impl FnMut(&[PlaceUser]) -> Result<Placement, PlaceError>,
) -> Result<Placement, PlaceError> {
    if !(confidence > 0.0 && confidence < 1.0) {
        return Err(PlaceError::BadConfidence { found: confidence });
    }
    if !(0.0..=LARGEST_COORDINATE_M).contains(&radius_m) {
        return Err(PlaceError::BadRadius { found: radius_m });
    }
    let beliefs: Vec<UserBelief> = users.iter().map(|user| user.belief).collect();
    check(Objective::Expected { users: &beliefs, radius_m }, fleet)?;
    let rule = Rule::new(users, radius_m, quantile(confidence));
    let inner = solve(&rule.disks(f64::min))?;
    let outer = if rule.round { inner.clone() } else { solve(&rule.disks(f64::max))? };
    let best = [&inner, &outer].map(|placement| rule.counted(placement, fleet));
    let best = best.into_iter().reduce(|a, b| if b.value > a.value { b } else { a });
    let best = best.unwrap_or_else(|| none(fleet));
    let upper_bound = outer.upper_bound.max(best.value);
    Ok(Placement {
        upper_bound,
        proved_optimal: best.value >= upper_bound - SAME_VALUE,
        never_coverable: outer.never_coverable,
        ..best
    })
}

/// Whom a centre covers.
struct Rule<'a> {
    users: &'a [Wanted],
    spreads: Vec<Spread>,
    radius_m: f64,
    /// How many standard deviations must be in range.
    sigmas: f64,
    /// Whether no direction differs from any other.
    round: bool,
}

impl<'a> Rule<'a> {
    fn new(users: &'a [Wanted], radius_m: f64, sigmas: f64) -> Self {
        let spreads: Vec<Spread> = users.iter().map(|user| Spread::new(&user.belief.cov_m2)).collect();
        let round = spreads.iter().all(|spread| {
            let [least_m, most_m] = spread.sigma_range_m();
            (most_m - least_m) * sigmas.abs() < super::TOLERANCE_M
        });
        Self { users, spreads, radius_m, sigmas, round }
    }

    /// A disk for every user, with the smaller or the larger radius.
    fn disks(&self, which: fn(f64, f64) -> f64) -> Vec<PlaceUser> {
        let disk = |(user, spread): (&Wanted, &Spread)| {
            let [a, b] = spread.sigma_range_m().map(|sigma_m| self.radius_m - self.sigmas * sigma_m);
            PlaceUser { pos_m: user.belief.pos_m, radius_m: which(a, b), weight: user.weight }
        };
        self.users.iter().zip(&self.spreads).map(disk).collect()
    }

    /// How far a centre may move away from a user before that is no longer covered.
    fn margin_m(&self, user: usize, at: V2) -> f64 {
        let offset_m = self.users[user].belief.pos_m - at;
        let sigma_m = self.spreads[user].radial_var_m2(offset_m).sqrt();
        self.radius_m - self.sigmas * sigma_m - offset_m.norm()
    }

    /// Where all of a site's users have the most to spare: the radii are those of the directions seen from the last try.
    fn centred(&self, site: &Site) -> V2 {
        let least_m =
            |at: V2| site.covered.iter().map(|&user| self.margin_m(user, at)).fold(f64::INFINITY, f64::min);
        let (mut best, mut at) = (site.pos_m, site.pos_m);
        for _ in 0..CENTRING_ROUNDS {
            let disk = |&user: &usize| {
                let pos_m = self.users[user].belief.pos_m;
                (pos_m, self.margin_m(user, at) + (pos_m - at).norm())
            };
            let disks: Vec<(V2, f64)> = site.covered.iter().map(disk).collect();
            let Some((next, _)) = centre::most_margin(&disks, &KeepOut::default(), None) else { break };
            if least_m(next) > least_m(best) {
                best = next;
            }
            at = next;
        }
        best
    }

    /// The sites of a placement with the users that the rule gives them, each to the site that has it with most to spare.
    fn counted(&self, placement: &Placement, fleet: Fleet) -> Placement {
        let mut sites = placement.sites.clone();
        for site in sites.iter_mut().flatten() {
            site.pos_m = self.centred(site);
            *site = Site { covered: Vec::new(), margin_m: f64::INFINITY, expected: 0.0, ..site.clone() };
        }
        let mut counted = none(fleet);
        for (user, wanted) in self.users.iter().enumerate().filter(|(_, user)| user.weight > 0.0) {
            let margins = sites.iter_mut().flatten().map(|site| (self.margin_m(user, site.pos_m), site));
            let best = margins.reduce(|a, b| if b.0 > a.0 { b } else { a });
            if let Some((margin_m, site)) = best.filter(|(margin_m, _)| *margin_m >= -super::TOLERANCE_M) {
                site.covered.push(user);
                site.margin_m = site.margin_m.min(margin_m);
                site.expected += wanted.weight;
                counted.covered += 1;
                counted.value += wanted.weight;
            }
        }
        counted.sites = sites.into_iter().map(|site| site.filter(|site| !site.covered.is_empty())).collect();
        counted
    }
}

/// The p-quantile of the standard normal distribution, by bisection of its distribution function.
fn quantile(p: f64) -> f64 {
    let (mut low, mut high) = (-40.0, 40.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if super::expected::normal_cdf(middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;
    use proptest::prelude::*;

    use super::super::{place, place_joint};
    use super::*;

    #[test]
    fn truth_quantiles_of_the_tables() {
        for (p, z) in [(0.5, 0.0), (0.95, 1.644_853_627), (0.975, 1.959_963_985), (0.999, 3.090_232_306)] {
            assert!((quantile(p) - z).abs() < 1e-8, "{p}");
        }
    }

    /// One drone on a line with two users: it must be off-centre towards the one that is known less well.
    #[test]
    fn direction_counts() {
        let user = |x: f64, xx: f64, yy: f64| Wanted {
            belief: UserBelief { pos_m: V2::new(x, 0.0), cov_m2: Matrix2::new(xx, 0.0, 0.0, yy) },
            weight: 1.0,
        };
        let fleet = Fleet { drones: 1, min_separation_m: 0.0 };
        let solve = |disks: &[PlaceUser]| place_joint(disks, fleet, None);
        // 1.645 (10 + 2) m of the 1000 m are lost along the line, not 1.645 (10 + 30) m.
        let users = [user(0.0, 100.0, 4.0), user(980.0, 4.0, 900.0)];
        let found = place_confident(&users, 500.0, 0.95, fleet, solve).unwrap();
        assert!(found.covered == 2 && found.proved_optimal, "{found:?}");
        let users = [user(0.0, 100.0, 4.0), user(981.0, 4.0, 900.0)];
        let found = place_confident(&users, 500.0, 0.95, fleet, solve).unwrap();
        assert_eq!((found.covered, found.proved_optimal), (1, false));
        assert!((found.upper_bound - 2.0).abs() < 1e-9);
    }

    proptest! {
        /// Everyone who counts is in range with the probability asked for, and no other placement beats the bound.
        #[test]
        fn what_counts_is_likely_enough(
            users in prop::collection::vec(
                (0.0..2500.0_f64, 0.0..2500.0_f64, 1.0..15.0_f64, 1.0..15.0_f64, -0.9..0.9_f64), 0..40),
            confidence in 0.5..0.999_f64,
            drones in 1..4_usize,
        ) {
            let users: Vec<Wanted> = users.iter().map(|&(x, y, a, b, c)| Wanted {
                belief: UserBelief { pos_m: V2::new(x, y), cov_m2: Matrix2::new(a * a, a * b * c, a * b * c, b * b) },
                weight: 1.0,
            }).collect();
            let fleet = Fleet { drones, min_separation_m: 0.0 };
            let found = place_confident(&users, 500.0, confidence, fleet, |disks| place_joint(disks, fleet, None)).unwrap();
            for site in found.sites.iter().flatten() {
                for &user in &site.covered {
                    prop_assert!(users[user].belief.within(site.pos_m, 500.0) >= confidence - 1e-6);
                }
            }
            let greedy = place_confident(&users, 500.0, confidence, fleet, |disks| place(Objective::Guaranteed(disks), fleet)).unwrap();
            prop_assert!(greedy.value <= found.upper_bound + 1e-9 && found.value <= greedy.upper_bound + 1e-9);
            let listed: usize = found.sites.iter().flatten().map(|site| site.covered.len()).sum();
            prop_assert_eq!(listed, found.covered);
        }

        /// Without uncertainty the rule is the plain disk.
        #[test]
        fn certain_users_are_covered_as_disks(
            users in prop::collection::vec((0.0..2000.0_f64, 0.0..2000.0_f64), 1..30),
        ) {
            let wanted: Vec<Wanted> = users.iter().map(|&(x, y)| Wanted {
                belief: UserBelief { pos_m: V2::new(x, y), cov_m2: Matrix2::zeros() },
                weight: 1.0,
            }).collect();
            let fleet = Fleet { drones: 2, min_separation_m: 0.0 };
            let found = place_confident(&wanted, 500.0, 0.95, fleet, |disks| place_joint(disks, fleet, None)).unwrap();
            let disks: Vec<PlaceUser> = users.iter().map(|&(x, y)| PlaceUser { pos_m: V2::new(x, y), radius_m: 500.0, weight: 1.0 }).collect();
            let plain = place_joint(&disks, fleet, None).unwrap();
            prop_assert!((found.value - plain.value).abs() < 1e-9);
            prop_assert_eq!(found.proved_optimal, plain.proved_optimal);
        }
    }

    #[test]
    fn a_confidence_is_a_probability() {
        let fleet = Fleet { drones: 1, min_separation_m: 0.0 };
        for found in [0.0, 1.0, -0.5, f64::NAN] {
            let refused = place_confident(&[], 500.0, found, fleet, |_| unreachable!());
            assert!(matches!(refused, Err(PlaceError::BadConfidence { .. })));
        }
    }
}
