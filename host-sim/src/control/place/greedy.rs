//! Algorithm 2: place one drone, strike off the users it serves, repeat.

use std::time::Instant;

use super::disk::Counting;
use super::expected::Chances;
use super::minlp::Minlp;
use super::search::SAME_VALUE;
use super::{Fleet, KeepOut, LARGEST_COORDINATE_M, Objective, PlaceError, PlaceUser, Placement, Site};
use crate::geometry::V2;

/// The one-drone problem over what earlier drones have left.
pub(super) trait Step {
    /// The best site, and a value that no site exceeds, allowed or not. `None`: nothing to gain.
    fn best(&self, keep_out: &KeepOut) -> Option<(Site, f64)>;

    /// A value that no site exceeds, allowed or not.
    fn ceiling(&self) -> f64;

    /// Takes from every user what the site gives it.
    fn serve(&mut self, site: &Site);
}

/// Places a fleet by Algorithm 2, every step solved exactly (for [`Objective::Expected`]: to
/// [`super::expected::GAP_USERS`]).
///
/// Among equals, a step takes more weight, then the larger margin, then the smaller east and north
/// coordinate. Deterministic.
///
/// # Errors
/// [`PlaceError`] names the user and the field that is not finite, out of range or negative.
pub fn place(objective: Objective<'_>, fleet: Fleet) -> Result<Placement, PlaceError> {
    check(objective, fleet)?;
    match objective {
        Objective::Guaranteed(users) => Ok(guaranteed(users, fleet, None)),
        Objective::Expected { users, radius_m } => {
            let Some(mut chances) = Chances::new(users, radius_m) else { return Ok(none(fleet)) };
            Ok(greedy(&mut chances, fleet))
        }
    }
}

/// Algorithm 2 on checked users; steps after `until` end early, with a bound that holds all the same.
pub(super) fn guaranteed(users: &[PlaceUser], fleet: Fleet, until: Option<Instant>) -> Placement {
    let step = Counting::new(users).map(|step| step.until(until));
    let placement = step.map_or_else(|| none(fleet), |mut step| greedy(&mut step, fleet));
    judged(users, placement)
}

/// What whole weights say about a bound, and what that says about a placement.
fn judged(users: &[PlaceUser], mut placement: Placement) -> Placement {
    placement.never_coverable = users.iter().filter(|u| u.radius_m < 0.0).count();
    // Whole weights add up to whole numbers, and so does the optimum.
    if users.iter().all(|u| u.weight.fract() == 0.0) {
        placement.upper_bound = (placement.upper_bound + SAME_VALUE).floor();
    }
    placement.proved_optimal = placement.value >= placement.upper_bound - SAME_VALUE;
    placement
}

/// Places a fleet by Algorithm 2, every step solved as the paper's program (6), with cones and integers: a reference for
/// some dozens of users. Sites may come as close together as they like.
///
/// # Errors
/// As [`place`].
pub fn place_minlp(users: &[PlaceUser], fleet: Fleet) -> Result<Placement, PlaceError> {
    check(Objective::Guaranteed(users), fleet)?;
    Ok(judged(users, greedy(&mut Minlp::new(users), fleet)))
}

/// The m steps, with a bound on any m disks: for every set S of sites, OPT <= f(S) + m max_x (f(S + x) -
/// f(S)), because coverage is submodular (Nemhauser, Wolsey and Fisher 1978). S runs over the steps.
fn greedy(step: &mut impl Step, fleet: Fleet) -> Placement {
    let mut placement = none(fleet);
    let mut keep_out = KeepOut::new(fleet.min_separation_m);
    placement.upper_bound = f64::INFINITY;
    for index in 0..=fleet.drones {
        let best = if index < fleet.drones { step.best(&keep_out) } else { None };
        let (value, mut ceiling) =
            best.as_ref().map_or((0.0, 0.0), |(site, ceiling)| (site.expected, *ceiling));
        if best.is_none() {
            ceiling = step.ceiling();
        }
        let bound = placement.value + fleet.drones as f64 * ceiling;
        placement.upper_bound = placement.upper_bound.min(bound);
        let Some((site, _)) = best else { break };
        step.serve(&site);
        keep_out.push(site.pos_m);
        placement.value += value;
        placement.covered += site.covered.len();
        placement.sites[index] = Some(site);
    }
    placement.proved_optimal = placement.value >= placement.upper_bound - SAME_VALUE;
    placement
}

/// Nothing placed.
pub(super) fn none(fleet: Fleet) -> Placement {
    Placement {
        sites: vec![None; fleet.drones],
        covered: 0,
        value: 0.0,
        upper_bound: 0.0,
        proved_optimal: true,
        never_coverable: 0,
    }
}

/// Refuses what cannot be placed.
pub(super) fn check(objective: Objective<'_>, fleet: Fleet) -> Result<(), PlaceError> {
    let in_range = |x: f64| x.abs() <= LARGEST_COORDINATE_M; // false for NaN
    let position = |user: usize, pos_m: V2| {
        let fields = [("pos_m.x", pos_m.x), ("pos_m.y", pos_m.y)];
        let bad = fields.into_iter().find(|&(_, x)| !in_range(x));
        bad.map_or(Ok(()), |(field, found)| Err(PlaceError::UserOutOfRange { user, field, found }))
    };
    if !(in_range(fleet.min_separation_m) && fleet.min_separation_m >= 0.0) {
        return Err(PlaceError::BadSeparation { found: fleet.min_separation_m });
    }
    match objective {
        Objective::Guaranteed(users) => {
            for (user, u) in users.iter().enumerate() {
                position(user, u.pos_m)?;
                if !in_range(u.radius_m) {
                    return Err(PlaceError::UserOutOfRange { user, field: "radius_m", found: u.radius_m });
                }
                if !(u.weight.is_finite() && u.weight >= 0.0) {
                    return Err(PlaceError::BadWeight { user, found: u.weight });
                }
            }
        }
        Objective::Expected { users, radius_m } => {
            if !(in_range(radius_m) && radius_m >= 0.0) {
                return Err(PlaceError::BadRadius { found: radius_m });
            }
            for (user, u) in users.iter().enumerate() {
                position(user, u.pos_m)?;
                if !u.has_covariance() {
                    return Err(PlaceError::BadCovariance { user });
                }
            }
        }
    }
    Ok(())
}
