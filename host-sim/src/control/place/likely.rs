//! All drones together for the expected service: the joint optimum of counted users, then exact exchanges of one drone.
//!
//! What is expected is no sum over disks that prices could bound tightly, but close to a count: most users are in or
//! out for certain. So the drones start from the joint optimum of a count, with disks that are smaller by some
//! standard deviations of a user's position, and one after the other is put where it adds the most to what the others
//! give, until nobody can be put anywhere better. Of several starts the best counts.

use rayon::prelude::*;

use super::expected::{Chances, GAP_USERS};
use super::greedy::{Step as _, check, none, place};
use super::joint::place_joint;
use super::{Fleet, KeepOut, Objective, PlaceError, PlaceUser, Placement, Site, UserBelief};
use crate::geometry::V2;

/// By how many standard deviations the disks of a start are smaller: counting users that are as likely in as out, and
/// users that are in with 84 %.
const SMALLER_BY_SIGMA: [f64; 2] = [0.0, 1.0];
/// More users are placed for greedily: their sheer number leaves little to gain, and the joint optimum takes its time.
const MOST_USERS_TOGETHER: usize = 20_000;
/// Every exchange gains [`GAP_USERS`] at least; typical are two rounds.
const MOST_ROUNDS: usize = 10;

/// Places a fleet for the greatest expected number of users truly within `radius_m` of a drone.
///
/// No drone alone can be put anywhere better than it is by more than [`GAP_USERS`], and nothing is expected to be worse than
/// what Algorithm 2 reaches. The bound holds for all placements. Deterministic, whatever the number of threads.
///
/// # Errors
/// [`PlaceError`] names the user and the field that is not finite, out of range or negative.
pub fn place_expected(users: &[UserBelief], radius_m: f64, fleet: Fleet) -> Result<Placement, PlaceError> {
    let objective = Objective::Expected { users, radius_m };
    check(objective, fleet)?;
    let greedy = place(objective, fleet)?;
    let starts: &[f64] = if users.len() > MOST_USERS_TOGETHER { &[] } else { &SMALLER_BY_SIGMA };
    let together: Vec<Placement> =
        starts.par_iter().map(|&sigmas| counted(users, radius_m, sigmas, fleet)).collect::<Result<_, _>>()?;
    let improved: Vec<Option<Placement>> = (together.par_iter().chain([&greedy]))
        .map(|start| Some(Exchange::new(users, radius_m, fleet)?.from(start)))
        .collect();
    let best = improved.into_iter().flatten().chain([greedy.clone()]);
    let best = best.reduce(|a, b| if b.value > a.value { b } else { a });
    let best = best.unwrap_or_else(|| none(fleet));
    let upper_bound = greedy.upper_bound.max(best.value);
    Ok(Placement { upper_bound, proved_optimal: best.value >= upper_bound - GAP_USERS, ..best })
}

/// The joint optimum of users within `radius_m` less so many standard deviations.
fn counted(users: &[UserBelief], radius_m: f64, sigmas: f64, fleet: Fleet) -> Result<Placement, PlaceError> {
    let disk = |user: &UserBelief| {
        let sigma_m = user.cov_m2.symmetric_eigenvalues().max().max(0.0).sqrt();
        PlaceUser { pos_m: user.pos_m, radius_m: radius_m - sigmas * sigma_m, weight: 1.0 }
    };
    let disks: Vec<PlaceUser> = users.iter().map(disk).collect();
    place_joint(&disks, fleet, None)
}

/// Drones that are put elsewhere one at a time.
struct Exchange {
    chances: Chances,
    fleet: Fleet,
}

impl Exchange {
    fn new(users: &[UserBelief], radius_m: f64, fleet: Fleet) -> Option<Self> {
        Some(Self { chances: Chances::new(users, radius_m)?, fleet })
    }

    fn from(mut self, start: &Placement) -> Placement {
        let mut sites: Vec<Option<V2>> =
            start.sites.iter().map(|site| site.as_ref().map(|site| site.pos_m)).collect();
        for _ in 0..MOST_ROUNDS {
            let mut moved = false;
            for drone in 0..sites.len() {
                let others: Vec<V2> =
                    (0..sites.len()).filter(|&d| d != drone).filter_map(|d| sites[d]).collect();
                let mut keep_out = KeepOut::new(self.fleet.min_separation_m);
                others.iter().for_each(|&at| keep_out.push(at));
                self.chances.leave_over(&others);
                let now = sites[drone].map_or(0.0, |at| self.chances.value(at));
                let best = self.chances.best(&keep_out).map(|(site, _)| site);
                if let Some(site) = best.filter(|site| site.expected > now + GAP_USERS) {
                    sites[drone] = Some(site.pos_m);
                    moved = true;
                }
            }
            if !moved {
                break;
            }
        }
        self.counted_one_by_one(&sites)
    }

    /// The placement with these sites, each counted after those before it.
    fn counted_one_by_one(mut self, sites: &[Option<V2>]) -> Placement {
        self.chances.leave_over(&[]);
        let mut placement = none(self.fleet);
        for (place, &at) in placement.sites.iter_mut().zip(sites) {
            let Some(at) = at else { continue };
            let site: Site = self.chances.site(at);
            self.chances.serve(&site);
            placement.covered += site.covered.len();
            placement.value += site.expected;
            *place = Some(site);
        }
        placement
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;
    use proptest::prelude::*;

    use super::*;

    fn beliefs(users: &[(f64, f64, f64, f64)]) -> Vec<UserBelief> {
        (users.iter())
            .map(|&(x, y, a, b)| UserBelief { pos_m: V2::new(x, y), cov_m2: Matrix2::new(a, 0.0, 0.0, b) })
            .collect()
    }

    /// What the sites give together, from scratch.
    fn expected(users: &[UserBelief], radius_m: f64, placement: &Placement) -> f64 {
        let sites: Vec<V2> = placement.sites.iter().flatten().map(|site| site.pos_m).collect();
        let missed =
            |user: &UserBelief| -> f64 { sites.iter().map(|&at| 1.0 - user.within(at, radius_m)).product() };
        users.iter().map(|user| 1.0 - missed(user)).sum()
    }

    proptest! {
        #[test]
        fn it_is_no_worse_than_one_after_the_other_and_keeps_what_it_says(
            users in prop::collection::vec((0.0..3000.0_f64, 0.0..3000.0_f64, 0.0..200.0_f64, 0.0..200.0_f64), 0..60),
            drones in 1..5_usize,
            separation_m in 0.0..40.0_f64,
        ) {
            let (users, fleet) = (beliefs(&users), Fleet { drones, min_separation_m: separation_m });
            let found = place_expected(&users, 500.0, fleet).unwrap();
            let greedy = place(Objective::Expected { users: &users, radius_m: 500.0 }, fleet).unwrap();
            prop_assert!(found.value >= greedy.value && found.value <= found.upper_bound);
            prop_assert!((found.value - expected(&users, 500.0, &found)).abs() < 1e-6);
            let at: Vec<V2> = found.sites.iter().flatten().map(|site| site.pos_m).collect();
            for (i, a) in at.iter().enumerate() {
                prop_assert!(at[i + 1..].iter().all(|b| (a - b).norm() >= separation_m));
            }
        }
    }

    /// One after the other, the first drone takes the four in the middle and leaves the rest scattered.
    #[test]
    fn together_is_better_where_greed_is_short_sighted() {
        let row = [0.0, 400.0, 800.0, 1200.0, 1600.0, 2000.0];
        let users: Vec<(f64, f64, f64, f64)> = row.iter().map(|&x| (x, 0.0, 9.0, 9.0)).collect();
        let (users, fleet) = (beliefs(&users), Fleet { drones: 2, min_separation_m: 15.0 });
        let found = place_expected(&users, 500.0, fleet).unwrap();
        assert!(found.value > 5.99, "{}", found.value);
        assert_eq!(found.covered, 6);
    }

    #[test]
    fn nobody_to_serve() {
        let fleet = Fleet { drones: 3, min_separation_m: 15.0 };
        let found = place_expected(&[], 500.0, fleet).unwrap();
        assert_eq!((found.sites.len(), found.covered), (3, 0));
        assert!(found.proved_optimal);
    }
}
