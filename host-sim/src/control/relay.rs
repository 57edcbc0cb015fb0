//! Whose state is relayed to whom: every drone hears of its nearest neighbours.
//!
//! Collision avoidance needs the states of the drones nearby, and a radio cannot carry those of all.
//! The control center sends each drone the `k` nearest. A cubic grid of about one drone per cell keeps
//! this linear in the fleet: cells are searched in growing shells until no nearer drone is possible.

use crate::geometry::V3;

/// Nearest neighbours of every drone, with buffers that are kept from one update to the next.
///
/// # Example
/// ```
/// use skyroost_host_sim::control::relay::Relay;
/// use skyroost_host_sim::geometry::V3;
/// let mut relay = Relay::new(2);
/// relay.update(&[V3::zeros(), V3::x() * 50.0, V3::x() * 90.0, V3::x() * 1000.0]);
/// assert_eq!(relay.neighbours(0), [1, 2]);
/// ```
#[derive(Clone, Debug)]
pub struct Relay {
    most: usize,
    drones: usize,
    /// `most` entries per drone, of which the first `min(most, drones - 1)` are used.
    nearest: Vec<u16>,
    grid: Grid,
    /// Neighbours of one drone found so far, as (squared distance, index).
    found: Vec<(f64, u16)>,
}

impl Relay {
    /// For fleets in which every drone is told of at most `most` others.
    #[must_use]
    pub fn new(most: usize) -> Self {
        Self { most, drones: 0, nearest: Vec::new(), grid: Grid::default(), found: Vec::new() }
    }

    /// Takes the positions of all drones, in the order of their indices. Allocates only when the fleet
    /// is larger than any before.
    ///
    /// # Panics
    /// If a coordinate is not finite or there are more than 65,536 drones: a caller's mistake.
    pub fn update(&mut self, positions_m: &[V3]) {
        assert!(positions_m.len() <= 1 << 16, "{} drones, expected at most 65,536", positions_m.len());
        assert!(positions_m.iter().all(|p| p.iter().all(|x| x.is_finite())), "positions are finite");
        self.drones = positions_m.len();
        self.nearest.clear();
        self.nearest.resize(self.drones * self.most, 0);
        let wanted = self.most.min(self.drones.saturating_sub(1));
        if wanted == 0 {
            return;
        }
        self.grid.fill(positions_m);
        for drone in 0..self.drones {
            self.grid.nearest(positions_m, drone, wanted, &mut self.found);
            let row = &mut self.nearest[drone * self.most..][..wanted];
            row.iter_mut().zip(&self.found).for_each(|(slot, &(_, other))| *slot = other);
        }
    }

    /// The nearest other drones, the nearest first, equals by index; empty for a drone that is not
    /// part of the fleet.
    #[must_use]
    pub fn neighbours(&self, drone: usize) -> &[u16] {
        if drone >= self.drones {
            return &[];
        }
        &self.nearest[drone * self.most..][..self.most.min(self.drones - 1)]
    }
}

/// Drones bucketed in cubes.
#[derive(Clone, Debug, Default)]
struct Grid {
    low_m: V3,
    side_m: f64,
    counts: [usize; 3],
    /// `members[start[c]..start[c + 1]]` are the drones of cell `c`, ascending.
    start: Vec<u32>,
    members: Vec<u16>,
}

impl Grid {
    /// Cells per axis at most, so that a stray drone far away does not cost memory.
    const MOST_PER_AXIS: usize = 64;

    fn fill(&mut self, positions_m: &[V3]) {
        let low = positions_m.iter().fold(positions_m[0], |a, p| a.inf(p));
        let extent_m = positions_m.iter().fold(positions_m[0], |a, p| a.sup(p)) - low;
        self.low_m = low;
        // The side at which the box holds about one cell per drone; flat boxes count as flat.
        let longest_m = extent_m.max();
        let mut axes = 0;
        let mut volume = 1.0;
        for extent in extent_m.iter().filter(|&&e| e > 0.05 * longest_m) {
            volume *= extent / longest_m;
            axes += 1;
        }
        let relative =
            if axes == 0 { 1.0 } else { (volume / positions_m.len() as f64).powf(1.0 / f64::from(axes)) };
        self.side_m = (longest_m * relative).max(longest_m / Self::MOST_PER_AXIS as f64);
        if self.side_m <= 0.0 {
            self.side_m = 1.0;
        }
        for axis in 0..3 {
            self.counts[axis] = ((extent_m[axis] / self.side_m) as usize + 1).min(Self::MOST_PER_AXIS + 1);
        }
        let cells = self.counts.iter().product::<usize>();
        // Counting sort: count, then the end of every cell, then fill each from its end downwards.
        self.start.clear();
        self.start.resize(cells + 1, 0);
        for p in positions_m {
            let cell = self.index(self.cell(*p));
            self.start[cell] += 1;
        }
        let mut end = 0;
        for slot in &mut self.start {
            end += *slot;
            *slot = end;
        }
        self.members.clear();
        self.members.resize(positions_m.len(), 0);
        for (drone, p) in positions_m.iter().enumerate().rev() {
            let cell = self.index(self.cell(*p));
            self.start[cell] -= 1;
            self.members[self.start[cell] as usize] = drone as u16;
        }
    }

    fn cell(&self, position_m: V3) -> [usize; 3] {
        let place = (position_m - self.low_m) / self.side_m;
        std::array::from_fn(|axis| (place[axis] as usize).min(self.counts[axis] - 1))
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// The `wanted` nearest of `drone`, sorted, into `found`.
    fn nearest(&self, positions_m: &[V3], drone: usize, wanted: usize, found: &mut Vec<(f64, u16)>) {
        found.clear();
        let here = self.cell(positions_m[drone]);
        let order = |a: &(f64, u16), b: &(f64, u16)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        let last_shell = self.counts.iter().max().copied().unwrap_or(1);
        for shell in 0..last_shell {
            self.shell(here, shell, |members| {
                for &other in members.iter().filter(|&&other| usize::from(other) != drone) {
                    let squared_m2 = (positions_m[usize::from(other)] - positions_m[drone]).norm_squared();
                    found.push((squared_m2, other));
                }
            });
            if found.len() >= wanted {
                found.select_nth_unstable_by(wanted - 1, order);
                found.truncate(wanted);
                // Whatever lies outside the shells so far is at least this far away. Strictly less: an
                // equally distant drone of smaller index may still come, and rounding of the cells too.
                let clear_m = shell as f64 * self.side_m * (1.0 - 1e-9);
                if found[wanted - 1].0 < clear_m * clear_m {
                    break;
                }
            }
        }
        found.sort_unstable_by(order);
    }

    /// Visits the cells at Chebyshev distance `shell` from `here`.
    fn shell(&self, here: [usize; 3], shell: usize, mut visit: impl FnMut(&[u16])) {
        let low: [usize; 3] = std::array::from_fn(|axis| here[axis].saturating_sub(shell));
        let high: [usize; 3] = std::array::from_fn(|axis| (here[axis] + shell).min(self.counts[axis] - 1));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let on_face = here[2].abs_diff(z) == shell || here[1].abs_diff(y) == shell;
                let mut cells = |from: usize, to: usize| {
                    // Cells of one row follow each other in memory.
                    let (from, to) = (self.index([from, y, z]), self.index([to, y, z]));
                    visit(&self.members[self.start[from] as usize..self.start[to + 1] as usize]);
                };
                if on_face {
                    cells(low[0], high[0]);
                    continue;
                }
                if here[0] >= shell {
                    cells(here[0] - shell, here[0] - shell);
                }
                if here[0] + shell < self.counts[0] {
                    cells(here[0] + shell, here[0] + shell);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn all_pairs(positions_m: &[V3], drone: usize, most: usize) -> Vec<u16> {
        let mut others: Vec<(f64, u16)> = positions_m
            .iter()
            .enumerate()
            .filter(|&(other, _)| other != drone)
            .map(|(other, p)| ((p - positions_m[drone]).norm_squared(), other as u16))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        others.into_iter().take(most).map(|(_, other)| other).collect()
    }

    proptest! {
        /// Lattice points make equal distances the rule; one buffer serves fleets of any size.
        #[test]
        fn truth_neighbours_match_all_pairs(
            fleets in prop::collection::vec(
                prop::collection::vec((-9i32..9, -9i32..9, 0i32..3), 0..120), 1..4),
            stretch in (0.1f64..1000.0, 0.1f64..1000.0),
            most in 0usize..40,
        ) {
            let mut relay = Relay::new(most);
            for fleet in fleets {
                let positions_m: Vec<V3> = fleet.iter().map(|&(x, y, z)| {
                    V3::new(f64::from(x) * stretch.0, f64::from(y) * stretch.1, f64::from(z) * 10.0)
                }).collect();
                relay.update(&positions_m);
                for drone in 0..positions_m.len() {
                    prop_assert_eq!(relay.neighbours(drone), all_pairs(&positions_m, drone, most));
                }
                prop_assert!(relay.neighbours(positions_m.len()).is_empty());
            }
        }
    }

    #[test]
    fn a_stray_drone_changes_nothing_for_the_others() {
        let mut positions_m: Vec<V3> =
            (0..200).map(|i| V3::new(f64::from(i % 20) * 50.0, f64::from(i / 20) * 50.0, 300.0)).collect();
        positions_m.push(V3::new(1e7, -1e7, 0.0));
        let mut relay = Relay::new(8);
        relay.update(&positions_m);
        for drone in 0..positions_m.len() {
            assert_eq!(relay.neighbours(drone), all_pairs(&positions_m, drone, 8));
        }
    }

    #[test]
    fn repeated_updates_keep_their_buffers() {
        let positions_m: Vec<V3> =
            (0..600).map(|i| V3::new(f64::from(i * 37 % 601), f64::from(i * 71 % 599), 300.0)).collect();
        let mut relay = Relay::new(32);
        relay.update(&positions_m);
        let buffers = |r: &Relay| {
            let grid = &r.grid;
            (r.nearest.as_ptr(), r.found.capacity(), grid.start.as_ptr(), grid.members.as_ptr())
        };
        let before = buffers(&relay);
        for _ in 0..10 {
            relay.update(&positions_m);
        }
        assert_eq!(buffers(&relay), before);
    }
}
