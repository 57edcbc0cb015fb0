//! Serving and refining: who is heard at each drone is held against who was expected, and drones are moved
//! by metres where that promises a user more.
//!
//! Drones hover until each has reported some rounds of the users it hears. These condition the users'
//! beliefs ([`Cloud`]); then drones whose best move promises enough try it, all at once where no user can
//! hear two of them. A trial is kept when it serves more users than the best place so far; otherwise the
//! drone's next trial, or the end, takes it away from there again. So nobody ends up serving fewer.

use crate::{
    control::place::{
        UserBelief,
        refine::{Cloud, Hearing, Move, REACH_M, best_move},
    },
    geometry::V2,
};
use skyroost_protocol::{
    message::Attached,
    units::{TimePs, UserId},
};
use std::collections::{BTreeMap, BTreeSet};

/// Rounds of trials, six seconds each. The first win most; later ones corner a place of a metre or two.
const MOST_TRIALS: u32 = 20;
/// After this time nobody begins a trial any more.
const TRIALS_FOR: TimePs = TimePs::from_ms(300_000);
/// A trial that promises less than this many users is not worth the flight.
const LEAST_GAIN_USERS: f64 = 0.02;
/// Reports of a drone's users that settle whom it hears: a user that a lost page held is in another one.
const ROUNDS: u32 = 4;
/// Pages of one round come within this time.
const ROUND_FOR: TimePs = TimePs::from_ms(500);
/// A drone is listened to for this long at most: one that hears nobody reports nobody.
const LISTEN_FOR: TimePs = TimePs::from_ms(8_000);
/// A drone this close to its place hovers.
const SETTLED_M: f64 = 0.4;

/// A place that a drone held, and whom it heard there.
#[derive(Clone, Debug, Default, PartialEq)]
struct Stay {
    pos_m: V2,
    heard: BTreeSet<UserId>,
}

/// What is being heard at a place.
#[derive(Clone, Debug, Default)]
struct Listening {
    settled: Option<TimePs>,
    round: Option<TimePs>,
    rounds: u32,
    /// Sum of the positions at each round.
    centres_m: V2,
    /// In how many rounds each user was heard.
    heard: BTreeMap<UserId, u32>,
}

impl Listening {
    fn page(&mut self, page: &Attached, pos_m: V2) {
        if self.settled.is_none_or(|settled| page.time < settled) {
            return;
        }
        if self.round.is_none_or(|round| page.time.since(round) >= ROUND_FOR) {
            self.round = Some(page.time);
            self.rounds += 1;
            self.centres_m += pos_m;
        }
        for user in &page.users {
            *self.heard.entry(user.user).or_default() += 1;
        }
    }

    fn done(&self, now: TimePs) -> bool {
        let whole = self.rounds >= ROUNDS && self.round.is_some_and(|round| now.since(round) >= ROUND_FOR);
        whole || self.settled.is_some_and(|settled| now.since(settled) >= LISTEN_FOR)
    }

    /// Users heard in half of the rounds or more.
    fn served(&self) -> BTreeSet<UserId> {
        let often = self.heard.iter().filter(|(_, times)| 2 * **times >= self.rounds);
        often.map(|(user, _)| *user).collect()
    }
}

/// A drone that serves.
#[derive(Clone, Debug)]
struct Station {
    /// Where it was sent.
    pos_m: V2,
    /// Its best place so far; none before the first report.
    best: Option<Stay>,
    listening: Listening,
}

/// What a drone is doing, by its own word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Seen {
    /// It serves, at this position.
    Serving(V2),
    /// It flies, or nothing fresh is known.
    UnderWay,
    /// It left by itself.
    Left,
}

/// A user, and what was heard of it.
#[derive(Clone, Debug)]
struct User {
    belief: UserBelief,
    heard: Vec<Hearing>,
    cloud: Cloud,
}

/// The refinement in progress. Stations are numbered in the order given.
#[derive(Debug)]
pub(super) struct Refinement {
    since: TimePs,
    radius_m: f64,
    min_distance_m: f64,
    stations: Vec<Station>,
    users: BTreeMap<UserId, User>,
    trials: u32,
    ending: bool,
}

impl Refinement {
    /// Drones serve at `sites_m`.
    pub(super) fn new(
        now: TimePs,
        sites_m: &[V2],
        users: impl Iterator<Item = (UserId, UserBelief)>,
        radius_m: f64,
        min_distance_m: f64,
    ) -> Self {
        let station = |pos_m: &V2| Station { pos_m: *pos_m, best: None, listening: Listening::default() };
        let in_question = |belief: &UserBelief| {
            sites_m.iter().any(|site| (site - belief.pos_m).norm() <= radius_m + 3.0 * REACH_M)
        };
        let users = users.filter(|(_, belief)| in_question(belief)).map(|(user, belief)| {
            (user, User { belief, heard: Vec::new(), cloud: Cloud::new(&belief, &[], radius_m) })
        });
        Self {
            since: now,
            radius_m,
            min_distance_m,
            stations: sites_m.iter().map(station).collect(),
            users: users.collect(),
            trials: 0,
            ending: false,
        }
    }

    /// A page of the users that `station` hears came while it was at `pos_m`.
    pub(super) fn page(&mut self, station: usize, page: &Attached, pos_m: V2) {
        self.stations[station].listening.page(page, pos_m);
    }

    /// Goes on at `now`; `seen` says of each station what its drone does, and `free` whether one may fly straight from a
    /// place to another. Calls `send` with the stations to be moved. True when all drones serve at their best places.
    pub(super) fn step(
        &mut self,
        now: TimePs,
        seen: &[Seen],
        free: impl Fn(V2, V2) -> bool,
        mut send: impl FnMut(usize, V2),
    ) -> bool {
        for (station, seen) in self.stations.iter_mut().zip(seen) {
            if let Seen::Serving(pos_m) = seen
                && (pos_m - station.pos_m).norm() <= SETTLED_M
            {
                station.listening.settled.get_or_insert(now);
            }
        }
        let left = |k: usize| seen[k] == Seen::Left;
        let stations = || self.stations.iter().enumerate();
        if self.ending {
            return stations().all(|(k, s)| left(k) || s.listening.settled.is_some());
        }
        let late = now.since(self.since) >= TRIALS_FOR;
        let give_up = late || stations().any(|(k, _)| left(k));
        if !give_up && !stations().all(|(_, s)| s.listening.done(now)) {
            return false;
        }
        let mut moves = BTreeMap::new();
        if !give_up {
            self.conclude();
            if self.trials < MOST_TRIALS {
                moves = self.moves(&free);
            }
        }
        self.trials += 1;
        self.ending = moves.is_empty();
        for (k, station) in self.stations.iter_mut().enumerate() {
            let back_m = station.best.as_ref().map_or(station.pos_m, |best| best.pos_m);
            let to_m = moves.get(&k).copied().unwrap_or(back_m);
            // A drone that left takes no more orders.
            if to_m != station.pos_m && seen[k] != Seen::Left {
                station.pos_m = to_m;
                station.listening = Listening::default();
                send(k, to_m);
            }
        }
        false
    }

    /// Takes in what was heard, and keeps the trials that serve more.
    fn conclude(&mut self) {
        for k in 0..self.stations.len() {
            let others = self.served_by_others(k);
            let station = &mut self.stations[k];
            let at = Stay { pos_m: station.pos_m, heard: station.listening.served() };
            let fresh = station.best.as_ref().is_none_or(|best| best.pos_m != at.pos_m);
            if !fresh {
                continue;
            }
            let listening = &station.listening;
            let centre_m = match listening.rounds {
                0 => at.pos_m,
                rounds => listening.centres_m / f64::from(rounds),
            };
            for (id, user) in &mut self.users {
                let heard = at.heard.contains(id);
                let now_and_then = !heard && listening.heard.contains_key(id);
                let chance = user.cloud.within(centre_m, self.radius_m);
                let expected = if heard { chance >= 1.0 } else { chance <= 0.0 };
                if !expected && !now_and_then {
                    user.heard.push(Hearing { centre_m, heard });
                    user.cloud = Cloud::new(&user.belief, &user.heard, self.radius_m);
                }
            }
            let count = |stay: &Stay| stay.heard.difference(&others).count();
            if station.best.as_ref().is_none_or(|best| count(&at) > count(best)) {
                station.best = Some(at);
            }
        }
    }

    /// Users that other stations serve at their best places.
    fn served_by_others(&self, station: usize) -> BTreeSet<UserId> {
        let others = self.stations.iter().enumerate().filter(|(k, _)| *k != station);
        others.filter_map(|(_, s)| s.best.as_ref()).flat_map(|best| &best.heard).copied().collect()
    }

    /// The next trials: the most promising first, and none that could share a user with one chosen.
    fn moves(&self, free: &impl Fn(V2, V2) -> bool) -> BTreeMap<usize, V2> {
        let mut promising: Vec<(usize, Move)> = (0..self.stations.len())
            .filter_map(|k| Some((k, self.best_move(k, free)?)))
            .filter(|(_, found)| found.gain_users >= LEAST_GAIN_USERS)
            .collect();
        promising.sort_by(|a, b| b.1.gain_users.total_cmp(&a.1.gain_users));
        let mut chosen: BTreeMap<usize, V2> = BTreeMap::new();
        for (k, found) in promising {
            let apart_m = 2.0 * self.radius_m + self.min_distance_m;
            if chosen.values().all(|other| (other - found.to_m).norm() > apart_m) {
                chosen.insert(k, found.to_m);
            }
        }
        chosen
    }

    fn best_move(&self, station: usize, free: &impl Fn(V2, V2) -> bool) -> Option<Move> {
        let best = self.stations[station].best.as_ref()?;
        let others = self.served_by_others(station);
        let in_reach = |user: &User| user.cloud.in_reach(best.pos_m, self.radius_m, REACH_M);
        let candidates = self.users.iter().filter(|(id, user)| !others.contains(id) && in_reach(user));
        let clouds: Vec<&Cloud> = candidates.map(|(_, user)| &user.cloud).collect();
        // Users whom nobody could locate are heard, but give no hint where to fly.
        let served =
            best.heard.iter().filter(|user| !others.contains(user) && self.users.contains_key(user)).count();
        let around = self.stations.iter().enumerate().filter(|(k, _)| *k != station);
        let taken: Vec<V2> =
            around.flat_map(|(_, s)| [Some(s.pos_m), s.best.as_ref().map(|b| b.pos_m)]).flatten().collect();
        // Neighbours may be on their way to a trial at the same time.
        let apart = |at: V2| taken.iter().all(|t| (t - at).norm() >= self.min_distance_m);
        let allowed = |at: V2| apart(at) && free(best.pos_m, at);
        best_move(best.pos_m, &clouds, served, self.radius_m, allowed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix2;
    use proptest::prelude::*;
    use skyroost_protocol::message::AttachedUser;

    const RADIUS_M: f64 = 500.0;
    const APART_M: f64 = 16.0;

    /// Drones that fly at 5 m/s to where they are sent and hear whom they truly reach.
    struct World {
        truth_m: Vec<V2>,
        at_m: Vec<V2>,
        goals_m: Vec<V2>,
        moves: u32,
    }

    impl World {
        fn served(&self, places_m: &[V2]) -> BTreeSet<usize> {
            let near = |user: &V2| places_m.iter().any(|p| (p - user).norm() <= RADIUS_M);
            (0..self.truth_m.len()).filter(|&u| near(&self.truth_m[u])).collect()
        }

        fn page(&self, now: TimePs, drone: usize) -> Attached {
            let near = |u: &usize| (self.truth_m[*u] - self.at_m[drone]).norm() <= RADIUS_M;
            let heard = (0..self.truth_m.len()).filter(near);
            let users = heard.map(|u| AttachedUser { user: UserId(u as u32), timing_advance: 0 });
            Attached { time: now, users: users.collect() }
        }

        /// Runs the refinement to its end; `lost` says which pages never arrive. The time it took, seconds.
        fn refine(&mut self, refinement: &mut Refinement, lost: impl Fn(i64, usize) -> bool) -> i64 {
            for tick in 1..4_000_i64 {
                let now = TimePs::from_ms(tick * 200);
                for (at, goal) in self.at_m.iter_mut().zip(&self.goals_m) {
                    let way = goal - *at;
                    *at += way * (1.0 / way.norm().max(1.0));
                }
                for drone in (0..self.at_m.len()).filter(|d| (tick + *d as i64) % 5 == 0) {
                    let page = self.page(now, drone);
                    if !page.users.is_empty() && !lost(tick / 5, drone) {
                        refinement.page(drone, &page, self.at_m[drone]);
                    }
                }
                let seen: Vec<Seen> = self.at_m.iter().map(|at| Seen::Serving(*at)).collect();
                let Self { goals_m, moves, .. } = self;
                let done = refinement.step(
                    now,
                    &seen,
                    |_, _| true,
                    |drone, to_m| {
                        goals_m[drone] = to_m;
                        *moves += 1;
                    },
                );
                if done {
                    return tick / 5;
                }
            }
            panic!("the refinement does not end");
        }
    }

    fn world(truth_m: Vec<V2>, sites_m: &[V2], errors_m: &[V2]) -> (World, Refinement) {
        let belief = |(truth, error): (&V2, &V2)| UserBelief {
            pos_m: truth + error,
            cov_m2: Matrix2::identity() * 16.0,
        };
        let beliefs: Vec<UserBelief> = truth_m.iter().zip(errors_m.iter().cycle()).map(belief).collect();
        let users = (0..).map(UserId).zip(beliefs);
        let refinement = Refinement::new(TimePs(0), sites_m, users, RADIUS_M, APART_M);
        let (at_m, goals_m) = (sites_m.to_vec(), sites_m.to_vec());
        (World { truth_m, at_m, goals_m, moves: 0 }, refinement)
    }

    #[test]
    fn a_user_missed_by_metres_is_won() {
        // Three users around the site, the third 5 m beyond the radius, and room on the other side.
        let truth_m = vec![V2::new(-490.0, 0.0), V2::new(0.0, 480.0), V2::new(505.0, 0.0)];
        let (mut world, mut refinement) = world(truth_m, &[V2::zeros()], &[V2::new(-6.0, 1.0)]);
        assert_eq!(world.served(&world.goals_m).len(), 2);
        let took_s = world.refine(&mut refinement, |_, _| false);
        assert_eq!(world.served(&world.goals_m).len(), 3, "from {:?}", world.goals_m);
        assert!(world.moves >= 1 && took_s < 60, "{} moves in {took_s} s", world.moves);
    }

    #[test]
    fn whoever_is_where_expected_moves_nobody() {
        let truth_m = vec![V2::new(-300.0, 0.0), V2::new(0.0, 400.0)];
        let (mut world, mut refinement) = world(truth_m, &[V2::zeros()], &[V2::zeros()]);
        assert!(world.refine(&mut refinement, |_, _| false) < 10);
        assert_eq!(world.moves, 0);
    }

    #[test]
    fn a_drone_that_leaves_ends_the_trials() {
        let (_, mut refinement) = world(vec![], &[V2::zeros(), V2::new(2e3, 0.0)], &[]);
        let seen = [Seen::Left, Seen::Serving(V2::new(2e3, 0.0))];
        let mut step =
            |ms| refinement.step(TimePs::from_ms(ms), &seen, |_, _| true, |_, _| panic!("nobody is moved"));
        assert!(!step(40));
        assert!(step(80));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Wherever users truly are and whichever pages are lost: it ends, nobody comes too close, and no
        /// fewer are served than before.
        #[test]
        fn nobody_ends_up_serving_fewer(
            users in prop::collection::vec((-515.0..515.0_f64, -515.0..515.0_f64), 1..14),
            errors in prop::collection::vec((-8.0..8.0_f64, -8.0..8.0_f64), 14),
            neighbour in (17.0..600.0_f64, -30.0..30.0_f64),
            losses in 0..10_i64,
        ) {
            let points = |list: Vec<(f64, f64)>| list.into_iter().map(|(x, y)| V2::new(x, y)).collect::<Vec<_>>();
            let sites_m = [V2::zeros(), V2::new(neighbour.0, neighbour.1)];
            let (mut world, mut refinement) = world(points(users), &sites_m, &points(errors));
            let before = world.served(&sites_m).len();
            world.refine(&mut refinement, |second, drone| (7 * second + 3 * drone as i64) % 31 < losses);
            prop_assert!(world.served(&world.goals_m).len() >= before);
            prop_assert!((world.goals_m[0] - world.goals_m[1]).norm() >= APART_M);
        }
    }
}
