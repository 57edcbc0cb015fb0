//! What random search finds: the places that all drones came by, once a second, and which of them count.
//!
//! "The number of connected users is recorded and compared by drone-BSs in real time to find the optimal deployment"
//! (section 4). [`Reading::Simultaneous`] is that word for word. Coverage disks never overlap, so that everybody's own
//! count adds up, unless there was no room at the start.

use rand_core::Rng;

use super::{Ground, Motion};
use crate::campaign::plan::Reading;
use crate::control::place::TOLERANCE_M;
use crate::geometry::V2;
use crate::world::grid::PointGrid;

/// Cells to a radius of the grid that users are counted on: measured optimum at 5 to 500 users/km².
const CELLS_PER_RADIUS: f64 = 5.0;

/// Where all drones were, once a second from 0 on.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    drones: usize,
    /// All drones in order, second by second.
    places_m: Vec<V2>,
    /// Where in `places_m` each second ends: a drone that went home is not there any more.
    ends: Vec<usize>,
    /// Coverage disks of this radius do not overlap at any second.
    apart_m: f64,
}

impl Track {
    /// Flies drones at random for so many seconds, the last one included.
    #[must_use]
    pub fn at_random(ground: Ground, drones: usize, seconds: u32, rng: impl Rng) -> Self {
        let mut motion = Motion::new(ground, drones, rng);
        let mut places_m = Vec::with_capacity(drones * (seconds as usize + 1));
        for second in 0..=seconds {
            motion.advance(f64::from(second));
            places_m.extend(motion.positions_m());
        }
        let apart_m = if motion.started_apart() { ground.radius_m } else { 0.0 };
        let ends = (1..=seconds as usize + 1).map(|second| second * drones).collect();
        Self { drones, places_m, ends, apart_m }
    }

    /// Of places that are known, of all drones that search at each second.
    ///
    /// # Panics
    /// Where there are more of them than `drones`.
    #[must_use]
    pub fn of_places(drones: usize, seconds_m: &[Vec<V2>]) -> Self {
        assert!(seconds_m.iter().all(|places| places.len() <= drones), "no more than {drones} drones");
        let ends = seconds_m.iter().scan(0, |end, places| {
            *end += places.len();
            Some(*end)
        });
        Self { drones, ends: ends.collect(), places_m: seconds_m.concat(), apart_m: 0.0 }
    }

    /// The places of all drones that search, second by second.
    pub fn seconds(&self) -> impl Iterator<Item = &[V2]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.places_m[start..end])
    }

    /// How many users the answer serves, each drone those within `radius_m`.
    #[must_use]
    pub fn served(&self, users_m: &[V2], radius_m: f64, reading: Reading) -> usize {
        // Disks are closed, and as wide as those of every other method.
        let reach_m = radius_m + TOLERANCE_M;
        match reading {
            Reading::Simultaneous => self.best_second(users_m, radius_m, reach_m),
            Reading::Greedy => self.best_places(users_m, reach_m),
        }
    }

    fn best_second(&self, users_m: &[V2], radius_m: f64, reach_m: f64) -> usize {
        let grid = grid(users_m, reach_m);
        let served = |places_m: &[V2]| {
            if radius_m <= self.apart_m {
                places_m.iter().map(|&at| grid.count_within(at, reach_m)).sum()
            } else {
                served_together(&grid, places_m, reach_m)
            }
        };
        self.seconds().map(served).max().unwrap_or(0)
    }

    /// The place that adds the most, then the next; of equals the first one visited.
    fn best_places(&self, users_m: &[V2], reach_m: f64) -> usize {
        let mut left_m = users_m.to_vec();
        let mut adds: Vec<Option<usize>> = vec![None; self.places_m.len()];
        let mut served = 0;
        for _ in 0..self.drones {
            let grid = grid(&left_m, reach_m);
            let mut best: Option<(usize, V2)> = None;
            for (&at, adds) in self.places_m.iter().zip(&mut adds) {
                let adds = *adds.get_or_insert_with(|| grid.count_within(at, reach_m));
                if best.is_none_or(|(most, _)| adds > most) {
                    best = Some((adds, at));
                }
            }
            let Some((most, site)) = best else { break };
            served += most;
            left_m.retain(|user| (user - site).norm_squared() > reach_m * reach_m);
            // Only places whose disks overlap the one taken lose anybody.
            for (at, adds) in self.places_m.iter().zip(&mut adds) {
                if (at - site).norm() <= 2.0 * reach_m {
                    *adds = None;
                }
            }
        }
        served
    }
}

/// Users to be counted in disks of a radius.
pub(in crate::campaign) fn grid(users_m: &[V2], reach_m: f64) -> PointGrid {
    PointGrid::new(users_m, (reach_m / CELLS_PER_RADIUS).max(1.0))
}

/// Users within reach of any of the places, each once.
pub(in crate::campaign) fn served_together(grid: &PointGrid, places_m: &[V2], reach_m: f64) -> usize {
    let mut served: Vec<usize> = places_m.iter().flat_map(|&at| grid.within(at, reach_m)).collect();
    served.sort_unstable();
    served.dedup();
    served.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Stream};
    use proptest::prelude::*;

    fn users(count: usize, side_m: f64, seed: u64) -> Vec<V2> {
        let mut rng = rng::stream(seed, Stream::Users, 0);
        (0..count).map(|_| V2::new(rng::unit(&mut rng), rng::unit(&mut rng)) * side_m).collect()
    }

    fn ground(side_m: f64) -> Ground {
        Ground { side_m: V2::repeat(side_m), radius_m: 500.0, speed_mps: 10.0 }
    }

    /// Users in range of any place, one by one.
    fn by_hand(users_m: &[V2], places_m: &[V2], radius_m: f64) -> usize {
        let served = |user: &&V2| places_m.iter().any(|at| (at - *user).norm() <= radius_m + TOLERANCE_M);
        users_m.iter().filter(served).count()
    }

    /// All places for the first drone, then all for the second, as users count that are left.
    fn greedily_by_hand(users_m: &[V2], track: &Track, radius_m: f64) -> usize {
        let mut left_m = users_m.to_vec();
        for _ in 0..track.drones {
            let count = |at: &V2| by_hand(&left_m, &[*at], radius_m);
            let best = track.places_m.iter().fold((0, None), |best, at| {
                let count = count(at);
                if best.1.is_none() || count > best.0 { (count, Some(*at)) } else { best }
            });
            let Some(site) = best.1 else { break };
            left_m.retain(|user| (user - site).norm() > radius_m + TOLERANCE_M);
        }
        users_m.len() - left_m.len()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Also in areas without room for disjoint disks, where users must count once.
        #[test]
        fn truth_readings_count_as_by_hand(
            seed in any::<u64>(), count in 0..300_usize, drones in 1..5_usize, side_m in 1000.0..6000.0_f64, shrunk_m in 0.0..200.0_f64,
        ) {
            let (users_m, radius_m) = (users(count, side_m, seed), 500.0 - shrunk_m);
            let track = Track::at_random(ground(side_m), drones, 60, rng::stream(seed, Stream::Search, 0));
            let best = track.seconds().map(|places| by_hand(&users_m, places, radius_m)).max().unwrap();
            prop_assert_eq!(track.served(&users_m, radius_m, Reading::Simultaneous), best);
            let greedy = track.served(&users_m, radius_m, Reading::Greedy);
            prop_assert_eq!(greedy, greedily_by_hand(&users_m, &track, radius_m));
            let flown = Track::of_places(drones, &track.seconds().map(<[V2]>::to_vec).collect::<Vec<_>>());
            prop_assert_eq!(flown.served(&users_m, radius_m, Reading::Simultaneous), best);
        }
    }

    /// What random search finds at 50 users/km² on average, measured independently: 282.5 of 5000.
    #[test]
    fn truth_the_papers_square_at_one_density() {
        let found = |seed: u64| {
            let users_m = users(5000, 10_000.0, seed);
            let track = Track::at_random(ground(10_000.0), 6, 6000, rng::stream(seed, Stream::Search, 0));
            track.served(&users_m, 500.0, Reading::Simultaneous) as f64
        };
        let mean = (0..24).map(found).sum::<f64>() / 24.0;
        assert!((mean / 282.5 - 1.0).abs() < 0.02, "{mean}");
    }
}
