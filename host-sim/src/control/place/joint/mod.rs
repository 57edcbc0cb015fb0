//! The true joint optimum: m disks that together cover the most users, with a bound that proves it.
//!
//! This is the planar maximal covering location problem (Church and ReVelle 1974, Church 1984). Its linear relaxation is
//! tight, but has a column for every cell of an arrangement of circles. So columns are generated: the dual of the
//! relaxation prices every user with some `lambda <= weight`, and for any prices
//!
//! ```text
//! sum (weight - lambda) + m max_x (lambda within reach of x)                             (1)
//! ```
//!
//! is a bound on all placements. Its inner maximum is the one-disk problem with other weights, which
//! [`super::disk`] solves exactly without listing the cells. What the best prices leave open is closed by
//! enumeration: a placement better than the best one known consists of disks whose price is within the gap of the
//! dearest (`better`), and of these few `exact` finds the best combination by branch and bound.
//!
//! Steps: greedy, then exact exchanges of one drone at a time (`exchange`), then prices (`prices`, `master`), then the
//! enumeration. Each can end it with a proof, and the time limit ends it with what is proved by then.

mod exact;
mod exchange;
mod master;
mod prices;

#[cfg(test)]
mod tests;

use std::time::Instant;

use super::disk::{Counting, Deepest};
use super::greedy::{Step as _, check, guaranteed, none};
use super::search::{MOST_COLLECTED, SAME_VALUE};
use super::{Fleet, KeepOut, Objective, PlaceError, PlaceUser, Placement, Site, TOLERANCE_M, centre};
use crate::geometry::V2;
use exact::Combination;
use prices::Prices;

/// Rounding of sums of prices: bounds this much above a whole number are that number.
const ROUNDING: f64 = 1e-6;
/// Most disks that are enumerated; more do not fit a search anyway.
const MOST_ENUMERATED: usize = 50_000;
/// Nodes of a search among the disks that prices have met, and of one that is to prove the optimum.
const NODES_TO_TRY: u64 = 20_000;
const NODES_TO_PROVE: u64 = 20_000_000;
/// Users of disks looked at in a search: some seconds, and a minute. Only hundreds of drones come that far.
const WORK_TO_TRY: u64 = 1_000_000_000;
const WORK_TO_PROVE: u64 = 20_000_000_000;
/// Rounds of better centres for users that two drones could serve.
const CENTRING_ROUNDS: usize = 4;

/// A disk: where, and whom it covers, ascending.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    pub(super) at: V2,
    pub(super) users: Vec<u32>,
}

/// The instance, and the best placement of it so far.
struct Joint<'a> {
    users: &'a [PlaceUser],
    drones: usize,
    until: Option<Instant>,
    /// By how much a better placement is better at least: 1 where weights are whole numbers.
    grain: f64,
    best: Vec<Column>,
    value: f64,
    /// No placement is better than this.
    bound: f64,
}

/// Places a fleet so that it serves the greatest weight of users that any placement serves, as far as `until` allows.
///
/// The answer does not depend on the order of the users beyond ties, nor on the number of threads. The optimum is sought
/// without the fleet's separation, so that its bound holds with it. Where two of its sites are too close, the one with
/// fewer users is put where it adds the most at a distance; that or the greedy placement, which keeps it anyway, is returned.
///
/// # Errors
/// [`PlaceError`] names the user and the field that is not finite, out of range or negative.
pub fn place_joint(
    users: &[PlaceUser],
    fleet: Fleet,
    until: Option<Instant>,
) -> Result<Placement, PlaceError> {
    check(Objective::Guaranteed(users), fleet)?;
    let greedy = guaranteed(users, fleet, until);
    if greedy.proved_optimal {
        return Ok(greedy);
    }
    let whole = users.iter().all(|u| u.weight.fract() == 0.0);
    let mut joint = Joint {
        users,
        drones: fleet.drones,
        until,
        grain: if whole { 1.0 } else { SAME_VALUE },
        best: Vec::new(),
        value: 0.0,
        bound: greedy.upper_bound,
    };
    joint.take(columns_of(users, &greedy));
    joint.solve();
    let mut placement = joint.placement(fleet);
    if placement.value < greedy.value {
        // Too close together, and the greedy steps have kept apart better.
        placement = Placement { upper_bound: joint.bound, ..greedy };
        placement.proved_optimal = placement.value >= placement.upper_bound - SAME_VALUE;
    }
    Ok(placement)
}

/// The users of every disk that some optimum may need: all sets that a disk can cover and that are no part of another
/// one. None if there are too many to list. The program that general solvers are given, to compare with.
#[must_use]
pub fn candidate_disks(users: &[PlaceUser]) -> Option<Vec<Vec<u32>>> {
    let Some(counting) = Counting::new(users) else { return Some(Vec::new()) };
    let columns = counting.all_above(SAME_VALUE, MOST_COLLECTED)?;
    Some(columns.into_iter().map(|column| column.users).collect())
}

/// The disks of a placement with all users that each covers, also those that an earlier one serves.
fn columns_of(users: &[PlaceUser], placement: &Placement) -> Vec<Column> {
    let column = |site: &Site| {
        let covers = |u: &PlaceUser| {
            u.radius_m >= 0.0 && u.weight > 0.0 && (u.pos_m - site.pos_m).norm() <= u.radius_m + TOLERANCE_M
        };
        let covered = users.iter().enumerate().filter(|(_, u)| covers(u)).map(|(user, _)| user as u32);
        Column { at: site.pos_m, users: covered.collect() }
    };
    placement.sites.iter().flatten().map(column).collect()
}

impl Joint<'_> {
    fn solve(&mut self) {
        exchange::improve(self);
        let mut prices = Prices::new(self);
        let met = prices.settle(self);
        if !self.is_proved() {
            self.combine(&prices, &met, (NODES_TO_TRY, WORK_TO_TRY));
        }
        if !self.is_proved() && !self.late() && prices.bound().is_finite() {
            self.close(&prices);
        }
    }

    /// Finds the optimum by these prices, whichever they are: the better they are, the fewer disks are left to combine.
    fn close(&mut self, prices: &Prices) {
        let Some(columns) = self.better(prices) else { return };
        let bound = self.combine(prices, &columns, (NODES_TO_PROVE, WORK_TO_PROVE));
        self.bound = self.bound.min(bound).max(self.value);
    }

    /// Takes the best combination of `columns` if it is better than the best known. Returns a bound on them all.
    fn combine(&mut self, prices: &Prices, columns: &[Column], (nodes, work): (u64, u64)) -> f64 {
        let asked = Combination {
            drones: self.drones,
            above: self.value,
            grain: self.grain,
            nodes,
            work,
            until: self.until,
        };
        let outcome = exact::best_combination(self.users, columns, prices.of_users(), asked);
        if let Some(chosen) = outcome.chosen {
            self.take(chosen.into_iter().map(|column| columns[column].clone()).collect());
        }
        outcome.bound
    }

    /// Whether time is up.
    fn late(&self) -> bool {
        self.until.is_some_and(|until| Instant::now() >= until)
    }

    /// Weight of the users that `columns` cover together.
    fn worth(&self, columns: &[Column]) -> f64 {
        let mut covered = vec![false; self.users.len()];
        let mut sum = 0.0;
        for &user in columns.iter().flat_map(|column| &column.users) {
            if !std::mem::replace(&mut covered[user as usize], true) {
                sum += self.users[user as usize].weight;
            }
        }
        sum
    }

    /// Takes a placement if it is better than the best known.
    fn take(&mut self, columns: Vec<Column>) {
        let value = self.worth(&columns);
        if value > self.value + SAME_VALUE {
            (self.best, self.value) = (columns, value);
            // A bound may be short by what the search of each disk takes for the same value.
            self.bound = self.bound.max(value);
        }
    }

    /// Lowers the bound, to a whole number where weights are.
    fn lower(&mut self, bound: f64) {
        let bound = if self.grain >= 1.0 { (bound + ROUNDING).floor() } else { bound };
        self.bound = self.bound.min(bound).max(self.value);
    }

    fn is_proved(&self) -> bool {
        self.bound < self.value + self.grain - ROUNDING.min(0.5 * self.grain)
    }

    /// All disks that a better placement may have: with prices, `m - 1` others at most at the dearest, and (1), one of
    /// price c leaves room for improvement only where `c >= dearest - (bound - better)`. None if they are too many.
    fn better(&self, prices: &Prices) -> Option<Vec<Column>> {
        let slack = prices.bound() - (self.value + self.grain);
        let least = prices.dearest() - slack - ROUNDING;
        let priced = prices.priced(self.users);
        let mut columns = Counting::new(&priced)?.until(self.until).all_above(least, MOST_ENUMERATED)?;
        columns.sort_by(|a, b| b.users.len().cmp(&a.users.len()).then_with(|| a.users.cmp(&b.users)));
        Some(columns)
    }

    /// The best placement as sites: most users first, each user with the site that has it with the larger margin, sites
    /// centred on theirs.
    fn placement(&self, fleet: Fleet) -> Placement {
        let mut keep_out = KeepOut::new(fleet.min_separation_m);
        let mut columns = self.best.clone();
        for _ in 0..CENTRING_ROUNDS {
            let owned = self.shares(&columns);
            for (column, users) in columns.iter_mut().zip(owned) {
                let disks: Vec<(V2, f64)> = (users.iter())
                    .map(|&user| (self.users[user as usize].pos_m, self.users[user as usize].radius_m))
                    .collect();
                let Some((at, margin_m)) = centre::most_margin(&disks, &KeepOut::default(), None) else {
                    continue;
                };
                if margin_m >= -TOLERANCE_M {
                    column.at = at;
                }
            }
        }
        let mut placement = none(fleet);
        placement.never_coverable = self.users.iter().filter(|u| u.radius_m < 0.0).count();
        let shares = self.shares(&columns);
        let mut sites: Vec<Site> = (columns.iter().zip(shares))
            .filter(|(_, users)| !users.is_empty())
            .map(|(column, users)| {
                let weight = users.iter().map(|&user| self.users[user as usize].weight).sum();
                let margin_m =
                    (users.iter()).map(|&user| self.margin_m(column.at, user)).fold(f64::INFINITY, f64::min);
                let covered = users.into_iter().map(|user| user as usize).collect();
                Site { pos_m: column.at, covered, margin_m, expected: weight }
            })
            .collect();
        sites.sort_by(|a, b| {
            b.expected
                .total_cmp(&a.expected)
                .then(a.pos_m.x.total_cmp(&b.pos_m.x))
                .then(a.pos_m.y.total_cmp(&b.pos_m.y))
        });
        let (mut apart, mut too_close) = (Vec::new(), 0);
        for site in sites {
            if keep_out.allows(site.pos_m) {
                keep_out.push(site.pos_m);
                apart.push(site);
            } else {
                too_close += 1;
            }
        }
        if too_close > 0 {
            self.add_apart(too_close, &mut apart, &mut keep_out);
        }
        for (place, site) in placement.sites.iter_mut().zip(apart) {
            placement.covered += site.covered.len();
            placement.value += site.expected;
            *place = Some(site);
        }
        placement.upper_bound = self.bound;
        placement.proved_optimal = self.is_proved() && placement.value >= self.value - SAME_VALUE;
        placement
    }

    /// Adds sites one after the other where they serve the most of the users left, away from those that there are.
    fn add_apart(&self, count: usize, sites: &mut Vec<Site>, keep_out: &mut KeepOut) {
        let Some(step) = Counting::new(self.users) else { return };
        let mut step = step.until(self.until);
        sites.iter().for_each(|site| step.serve(site));
        for _ in 0..count {
            let Some((site, _)) = step.best(keep_out) else { return };
            step.serve(&site);
            keep_out.push(site.pos_m);
            sites.push(site);
        }
    }

    fn margin_m(&self, at: V2, user: u32) -> f64 {
        let user = &self.users[user as usize];
        user.radius_m - (user.pos_m - at).norm()
    }

    /// Every covered user with the column that has it with the largest margin, ascending by user.
    fn shares(&self, columns: &[Column]) -> Vec<Vec<u32>> {
        let mut shares = vec![Vec::new(); columns.len()];
        let mut all: Vec<u32> = columns.iter().flat_map(|column| column.users.iter().copied()).collect();
        all.sort_unstable();
        all.dedup();
        for user in all {
            // Only columns that list it: centres move, and may come to cover others by chance.
            let holders = (0..columns.len()).filter(|&c| columns[c].users.binary_search(&user).is_ok());
            let best = holders.max_by(|&a, &b| {
                let [of_a, of_b] = [a, b].map(|c| self.margin_m(columns[c].at, user));
                of_a.total_cmp(&of_b).then(b.cmp(&a))
            });
            if let Some(column) = best {
                shares[column].push(user);
            }
        }
        shares
    }
}

/// The one-disk problem with other weights than the users' own.
fn deepest(priced: &[PlaceUser], until: Option<Instant>) -> Option<Deepest> {
    Counting::new(priced)?.until(until).deepest(0.0)
}
