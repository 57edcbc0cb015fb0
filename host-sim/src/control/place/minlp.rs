//! The one-disk problem (6) as the paper prints it, a mixed-integer program with cones, for a reference:
//!
//! ```text
//! maximise sum w_i u_i    |c - p_i| <= R_i + M_i (1 - u_i)    u_i in {0, 1}
//! ```
//!
//! Branch and bound over the relaxations `0 <= u_i <= 1`, which Clarabel solves. `M_i` is as small as the centres left allow: the
//! best centre lies in the hull of the users, and in the disk of every user that is in. A user whose disk misses that of
//! one that is in is out. Meant for some dozens of users; `disk` answers the same question for all.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};

use super::greedy::Step;
use super::queue::Queue;
use super::{KeepOut, PlaceUser, Site, TOLERANCE_M, centre};
use crate::geometry::V2;

/// Disks are widened by this in the program, so that those that touch have a point in common in spite of rounding.
const WIDENING_M: f64 = 0.5 * TOLERANCE_M;
/// What the solver's value may be off by, in weights.
const ACCURACY: f64 = 1e-5;
/// A search ends after so many relaxations, with the bound reached.
const MOST_NODES: usize = 20_000;

/// The program over users that are struck off as they are served.
pub(super) struct Minlp<'a> {
    users: &'a [PlaceUser],
    served: Vec<bool>,
    /// By how much a better value is better at least.
    grain: f64,
}

/// A part of the search: who is in, who is open; all others are out.
#[derive(Clone, Debug)]
struct Node {
    inside: Vec<usize>,
    open: Vec<usize>,
}

impl<'a> Minlp<'a> {
    pub(super) fn new(users: &'a [PlaceUser]) -> Self {
        let whole = users.iter().all(|u| u.weight.fract() == 0.0);
        Self { users, served: vec![false; users.len()], grain: if whole { 1.0 } else { 2.0 * ACCURACY } }
    }

    fn weight(&self, of: &[usize]) -> f64 {
        of.iter().map(|&user| self.users[user].weight).sum()
    }

    /// The best centre that was met, whom it covers, and a bound on all centres.
    fn solve(&self) -> (Vec<usize>, f64) {
        let coverable = |&user: &usize| {
            let u = &self.users[user];
            !self.served[user] && u.radius_m >= 0.0 && u.weight > 0.0
        };
        let open: Vec<usize> = (0..self.users.len()).filter(coverable).collect();
        let hull_m = |from: usize| {
            open.iter().map(|&to| (self.users[to].pos_m - self.users[from].pos_m).norm()).fold(0.0, f64::max)
        };
        let reach_m: Vec<f64> =
            (0..self.users.len()).map(|user| if open.contains(&user) { hull_m(user) } else { 0.0 }).collect();
        let (mut best, mut value) = (Vec::new(), 0.0);
        let mut queue = Queue::default();
        queue.push(self.weight(&open), Node { inside: Vec::new(), open });
        let mut nodes = 0;
        while let Some((most, node)) = queue.pop() {
            if most < value + self.grain - ACCURACY {
                break;
            }
            nodes += 1;
            if nodes > MOST_NODES {
                return (best, most);
            }
            let Some((at, shares, bound)) = self.relax(&node, &reach_m) else { continue };
            let bound = bound.min(most);
            let within = |user: &usize| {
                let user = &self.users[*user];
                (user.pos_m - at).norm() <= user.radius_m + WIDENING_M
            };
            // The program's rows hold to its accuracy, not to ours: where the geometry says that all who are in fit, they do.
            let met = node.open.iter().copied().filter(within);
            let mut covered: Vec<usize> = node.inside.iter().copied().chain(met).collect();
            if self.common_m(&covered).is_none() {
                covered.retain(within);
            }
            if self.weight(&covered) > value {
                value = self.weight(&covered);
                best = covered;
            }
            // The open user that is most in without being covered.
            let worth = |k: usize| self.users[node.open[k]].weight * shares[k];
            let torn = (0..node.open.len())
                .filter(|&k| !within(&node.open[k]))
                .max_by(|&a, &b| worth(a).total_cmp(&worth(b)).then(b.cmp(&a)));
            let Some(torn) = torn else { continue };
            let chosen = node.open[torn];
            let mut without = node.clone();
            without.open.remove(torn);
            let mut with = without.clone();
            with.inside.push(chosen);
            with.open.retain(|&other| self.meet(chosen, other));
            for child in [with, without] {
                let most = self.weight(&child.inside) + self.weight(&child.open);
                queue.push(bound.min(most), child);
            }
        }
        let bound = queue.ceiling().max(value);
        (best, if bound < value + self.grain { value } else { bound })
    }

    /// A centre that covers all of these users, and by how much at least; none if there is none.
    fn common_m(&self, users: &[usize]) -> Option<(V2, f64)> {
        let disks: Vec<(V2, f64)> =
            users.iter().map(|&user| (self.users[user].pos_m, self.users[user].radius_m)).collect();
        centre::most_margin(&disks, &KeepOut::default(), None)
            .filter(|(_, margin_m)| *margin_m >= -TOLERANCE_M)
    }

    /// Whether the disks of two users have a point in common.
    fn meet(&self, a: usize, b: usize) -> bool {
        let [a, b] = [a, b].map(|user| &self.users[user]);
        (a.pos_m - b.pos_m).norm() <= a.radius_m + b.radius_m + 2.0 * WIDENING_M
    }

    /// The relaxation of a node: its centre, how far every open user is in, and its value. None where it has no point.
    fn relax(&self, node: &Node, reach_m: &[f64]) -> Option<(V2, Vec<f64>, f64)> {
        let (open, inside) = (node.open.len(), node.inside.len());
        // In units of the largest reach, from the middle, so that the solver sees numbers about 1.
        let all = || node.inside.iter().chain(&node.open);
        let origin = all().map(|&user| self.users[user].pos_m).sum::<V2>() / (open + inside).max(1) as f64;
        let unit = all().map(|&user| reach_m[user] + self.users[user].radius_m).fold(1e-9, f64::max);
        let slack = |user: usize| {
            let (p, r) = (self.users[user].pos_m, self.users[user].radius_m);
            // No centre left is farther from this user.
            let farthest = (node.inside.iter())
                .map(|&other| (self.users[other].pos_m - p).norm() + self.users[other].radius_m + WIDENING_M)
                .fold(reach_m[user], f64::min);
            (farthest - r).max(0.0) / unit
        };
        // Columns: east, north, then the open users. Rows: u <= 1, u >= 0, then three of every disk.
        let disks: Vec<(usize, Option<usize>)> =
            (node.open.iter().enumerate().map(|(k, &user)| (user, Some(k))))
                .chain(node.inside.iter().map(|&user| (user, None)))
                .collect();
        let rows = 2 * open + 3 * disks.len();
        let mut right = vec![0.0; rows];
        right[..open].fill(1.0);
        let (mut start, mut row, mut entry) = (vec![0], Vec::new(), Vec::new());
        for axis in 0..2 {
            for (d, &(user, k)) in disks.iter().enumerate() {
                let first = 2 * open + 3 * d;
                let radius = (self.users[user].radius_m + WIDENING_M) / unit;
                right[first] = radius + k.map_or(0.0, |_| slack(user));
                right[first + 1 + axis] = -(self.users[user].pos_m - origin)[axis] / unit;
                row.push(first + 1 + axis);
                entry.push(-1.0);
            }
            start.push(row.len());
        }
        for (k, &user) in node.open.iter().enumerate() {
            row.extend([k, open + k, 2 * open + 3 * k]);
            entry.extend([1.0, -1.0, slack(user)]);
            start.push(row.len());
        }
        let cost: Vec<f64> =
            [0.0; 2].into_iter().chain(node.open.iter().map(|&user| -self.users[user].weight)).collect();
        let matrix = CscMatrix::new(rows, 2 + open, start, row, entry);
        let none = CscMatrix::zeros((2 + open, 2 + open));
        let mut cones: Vec<SupportedConeT<f64>> = vec![NonnegativeConeT(2 * open)];
        cones.extend(disks.iter().map(|_| SecondOrderConeT(3)));
        let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
        let mut solver = DefaultSolver::new(&none, &cost, &matrix, &right, &cones, settings).ok()?;
        solver.solve();
        let solution = &solver.solution;
        match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => {
                let at = origin + V2::new(solution.x[0], solution.x[1]) * unit;
                // The dual's value is a bound also where the primal is not quite there.
                let value =
                    -solution.obj_val.min(solution.obj_val_dual) + self.weight(&node.inside) + ACCURACY;
                Some((at, solution.x[2..].to_vec(), value))
            }
            // No point, or no number to trust. Disks that just touch look to the solver like those that miss each other:
            // the geometry decides on those that are in, and the branches on the others.
            _ => {
                let at = if inside > 0 { self.common_m(&node.inside)?.0 } else { origin };
                Some((at, vec![0.5; open], self.weight(&node.inside) + self.weight(&node.open)))
            }
        }
    }
}

impl Step for Minlp<'_> {
    /// Sites may come as close together as they like: the program has no rows that keep them apart.
    fn best(&self, _: &KeepOut) -> Option<(Site, f64)> {
        let (mut covered, bound) = self.solve();
        covered.sort_unstable();
        let (pos_m, margin_m) = self.common_m(&covered)?;
        let expected = self.weight(&covered);
        Some((Site { pos_m, covered, margin_m, expected }, bound.max(expected)))
    }

    fn ceiling(&self) -> f64 {
        self.solve().1
    }

    fn serve(&mut self, site: &Site) {
        site.covered.iter().for_each(|&user| self.served[user] = true);
    }
}

#[cfg(test)]
mod tests {
    use super::super::disk::best_disk;
    use super::super::truth::user;
    use super::super::{Fleet, place_minlp};
    use super::*;
    use proptest::prelude::*;

    fn check(users: &[PlaceUser]) {
        let expected = best_disk(users).map_or(0.0, |disk| disk.weight);
        let found = place_minlp(users, Fleet { drones: 1, min_separation_m: 0.0 }).unwrap();
        assert!((found.value - expected).abs() < 1e-6, "program {found:?}, geometry {expected}");
        assert!(found.proved_optimal && found.upper_bound >= found.value - 1e-9, "{found:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        #[test]
        fn truth_the_papers_program_and_the_geometry_agree(
            spec in prop::collection::vec((0.0f64..2500.0, 0.0f64..2500.0, 300.0f64..500.0), 0..20),
        ) {
            let users: Vec<PlaceUser> = spec.iter().map(|&(x, y, r)| user(x, y, r)).collect();
            check(&users);
        }

        #[test]
        fn truth_lattices_agree(spec in prop::collection::vec((0i32..8, 0i32..8, -1i32..4), 0..12)) {
            let users: Vec<PlaceUser> =
                spec.iter().map(|&(x, y, r)| user(f64::from(x), f64::from(y), f64::from(r))).collect();
            check(&users);
        }
    }

    #[test]
    fn truth_degenerate_cases_agree() {
        check(&[]);
        check(&vec![user(1.0, 2.0, 500.0); 40]);
        check(&(0..40).map(|i| user(60.0 * f64::from(i), 0.0, 500.0)).collect::<Vec<_>>());
        check(&[user(0.0, 0.0, 500.0), user(1000.0, 0.0, 500.0)]);
        check(&[user(0.0, 0.0, 0.0), user(0.0, 0.0, 0.0), user(1.0, 0.0, 0.0)]);
        // Three circles through nearly one point.
        let near = [(1, 5, 2), (5, 2, 3), (7, 2, 0), (4, 0, 0), (2, 5, 2)];
        check(&near.map(|(x, y, r)| user(f64::from(x), f64::from(y), f64::from(r))));
        check(&[user(0.0, 0.0, -1.0)]);
    }
}
