//! The best combination of a few disks: branch and bound with prices.
//!
//! A node has disks that are in, and disks that may still be. For any prices of the users not yet covered, what the disks
//! that are in cover, plus what prices leave of the weights, plus the dearest disks that may still join, is a bound
//! (the Lagrangian of the cover rows). Subgradient steps (Held, Wolfe and Crowder 1974, with Polyak's step towards a
//! better value) lower it at every node; disks that cannot be in anything better drop out.

use std::time::Instant;

use super::super::PlaceUser;
use super::super::search::SAME_VALUE;
use super::prices::worth;
use super::{Column, ROUNDING};

/// Steps of the prices at the root and at any other node.
const ROOT_STEPS: usize = 300;
const NODE_STEPS: usize = 12;
/// Nodes between two looks at the time.
const NODES_A_LOOK: u64 = 64;
/// What is searched for.
pub(super) struct Combination {
    pub(super) drones: usize,
    /// Only combinations better than this by `grain` are of interest.
    pub(super) above: f64,
    pub(super) grain: f64,
    /// Nodes after which the search gives up.
    pub(super) nodes: u64,
    /// Users of disks looked at after which it does: nodes of many disks take their time.
    pub(super) work: u64,
    pub(super) until: Option<Instant>,
}

/// What was found.
pub(super) struct Outcome {
    /// Indices of the best disks, if they are better than asked for.
    pub(super) chosen: Option<Vec<usize>>,
    /// No combination is better than this, or than what was asked for.
    pub(super) bound: f64,
}

/// The best combination of `columns`, starting from these prices of the users.
pub(super) fn best_combination(
    users: &[PlaceUser],
    columns: &[Column],
    prices: &[f64],
    asked: Combination,
) -> Outcome {
    let mut search = Search {
        weights: users.iter().map(worth).collect(),
        columns,
        covered: vec![0; users.len()],
        best: asked.above,
        chosen: None,
        stack: Vec::new(),
        nodes: 0,
        work: 0,
        stopped: false,
        asked,
    };
    let all = (0..columns.len() as u32).collect();
    let root = search.visit(all, prices.to_vec(), ROOT_STEPS);
    let bound = if search.stopped { root.max(search.best) } else { search.best };
    Outcome { chosen: search.chosen, bound }
}

struct Search<'a> {
    weights: Vec<f64>,
    columns: &'a [Column],
    /// By how many of the disks that are in a user is covered.
    covered: Vec<u16>,
    best: f64,
    chosen: Option<Vec<usize>>,
    /// Disks that are in.
    stack: Vec<u32>,
    nodes: u64,
    work: u64,
    stopped: bool,
    asked: Combination,
}

/// A bound, and what it comes from.
struct Priced {
    bound: f64,
    /// Covered weight and unpriced rest.
    base: f64,
    /// Disks that may still join, the dearest first, with their prices.
    order: Vec<(f64, u32)>,
    prices: Vec<f64>,
}

impl Search<'_> {
    /// The least value of interest.
    fn wanted(&self) -> f64 {
        self.best + self.asked.grain - ROUNDING.min(0.5 * self.asked.grain)
    }

    fn is_over(&mut self) -> bool {
        self.nodes += 1;
        self.stopped |= self.work >= self.asked.work;
        if self.nodes.is_multiple_of(NODES_A_LOOK) {
            let late = self.asked.until.is_some_and(|until| Instant::now() >= until);
            self.stopped |= late || self.nodes >= self.asked.nodes;
        }
        self.stopped
    }

    /// Searches all ways to add disks of `candidates` to those that are in. Returns a bound on them.
    fn visit(&mut self, candidates: Vec<u32>, prices: Vec<f64>, steps: usize) -> f64 {
        let room = self.asked.drones - self.stack.len();
        let Some(node) = self.price(candidates, prices, room, steps) else { return self.best };
        if self.is_over() || room <= 1 {
            return node.bound; // of one disk more the dearest was the best, and was offered
        }
        let Priced { bound, base, order, prices } = node;
        let sums: Vec<f64> = std::iter::once(0.0)
            .chain(order.iter().scan(0.0, |sum, (price, _)| {
                *sum += price;
                Some(*sum)
            }))
            .collect();
        for (first, &(_, column)) in order.iter().enumerate() {
            // This one and any after it, but none before it.
            let rest = sums[(first + room).min(order.len())] - sums[first];
            if base + rest < self.wanted() || self.stopped {
                break;
            }
            self.enter(column);
            let after = order[first + 1..].iter().map(|&(_, column)| column).collect();
            self.visit(after, prices.clone(), NODE_STEPS);
            self.leave(column);
        }
        bound
    }

    /// Lowers the bound of a node by better prices, and drops disks that nothing better can have. None where nothing better
    /// is left.
    fn price(
        &mut self,
        mut candidates: Vec<u32>,
        mut prices: Vec<f64>,
        room: usize,
        steps: usize,
    ) -> Option<Priced> {
        let free: Vec<u32> = {
            let mut free: Vec<u32> = (candidates.iter())
                .flat_map(|&column| &self.columns[column as usize].users)
                .copied()
                .filter(|&user| self.covered[user as usize] == 0)
                .collect();
            free.sort_unstable();
            free.dedup();
            free
        };
        let inside: f64 = (self.stack.iter())
            .flat_map(|&column| &self.columns[column as usize].users)
            .map(|&user| self.weights[user as usize] / f64::from(self.covered[user as usize]))
            .sum();
        if room <= 1 {
            // The last disk adds all that is free.
            free.iter().for_each(|&user| prices[user as usize] = self.weights[user as usize]);
        }
        let steps = if room <= 1 { 0 } else { steps };
        let users_of_all: usize =
            candidates.iter().map(|&column| self.columns[column as usize].users.len()).sum();
        let mut best: Option<Priced> = None;
        let mut pace = 1.0;
        let mut idle = 0;
        for step in 0..=steps {
            self.work += (users_of_all + candidates.len()) as u64;
            let mut order: Vec<(f64, u32)> = (candidates.iter())
                .map(|&column| {
                    let users = &self.columns[column as usize].users;
                    let open = users.iter().filter(|&&user| self.covered[user as usize] == 0);
                    (open.map(|&user| prices[user as usize]).sum(), column)
                })
                .collect();
            if order.len() > room && step < steps && room > 0 {
                order.select_nth_unstable_by(room - 1, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            } else {
                order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            }
            let unpriced: f64 =
                free.iter().map(|&user| self.weights[user as usize] - prices[user as usize]).sum();
            let base = inside + if room > 0 { unpriced } else { 0.0 };
            let taken = order.len().min(room);
            let bound = base + order[..taken].iter().map(|(price, _)| price).sum::<f64>();
            self.offer(&order[..taken], inside);
            if bound < self.wanted() {
                return None;
            }
            let dearest: Vec<u32> = order[..taken].iter().map(|&(_, column)| column).collect();
            if best.as_ref().is_none_or(|best| bound < best.bound - SAME_VALUE) {
                best = Some(Priced { bound, base, order, prices: prices.clone() });
                idle = 0;
            } else {
                idle += 1;
                if idle > 8 {
                    (pace, idle) = (0.5 * pace, 0);
                }
            }
            if step == steps || taken == 0 {
                break;
            }
            // Downhill: a user that the dearest disks cover more than once is too dear, one that they do not cover too cheap.
            let mut times: Vec<(u32, f64)> = free.iter().map(|&user| (user, -1.0)).collect();
            for &column in &dearest {
                for user in &self.columns[column as usize].users {
                    if let Ok(at) = free.binary_search(user) {
                        times[at].1 += 1.0;
                    }
                }
            }
            let moves = |user: u32, way: f64| {
                let (price, weight) = (prices[user as usize], self.weights[user as usize]);
                !(way < 0.0 && price >= weight || way > 0.0 && price <= 0.0)
            };
            times.retain(|&(user, way)| way != 0.0 && moves(user, way));
            let square: f64 = times.iter().map(|(_, way)| way * way).sum();
            if square <= 0.0 {
                break; // the bound is reached by these disks
            }
            let stride = pace * (bound - self.best).max(0.1 * self.asked.grain) / square;
            for (user, way) in times {
                let user = user as usize;
                prices[user] = (prices[user] - stride * way).clamp(0.0, self.weights[user]);
            }
        }
        let mut node = best?;
        node.order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        // One that joins takes the place of the last of the dearest.
        if node.order.len() > room && room > 0 {
            let last = node.order[room - 1].0;
            let least = self.wanted() - (node.bound - last);
            node.order.retain(|&(price, _)| price >= least);
        }
        candidates.clear();
        Some(node)
    }

    /// Holds the disks that are in and these against the best.
    fn offer(&mut self, joining: &[(f64, u32)], inside: f64) {
        let mut gained = inside;
        for &(_, column) in joining {
            for &user in &self.columns[column as usize].users {
                let covered = &mut self.covered[user as usize];
                if *covered == 0 {
                    gained += self.weights[user as usize];
                }
                *covered += 1;
            }
        }
        for &(_, column) in joining {
            for &user in &self.columns[column as usize].users {
                self.covered[user as usize] -= 1;
            }
        }
        if gained >= self.wanted() {
            self.best = gained;
            let all = self.stack.iter().copied().chain(joining.iter().map(|&(_, column)| column));
            self.chosen = Some(all.map(|column| column as usize).collect());
        }
    }

    fn enter(&mut self, column: u32) {
        self.stack.push(column);
        for &user in &self.columns[column as usize].users {
            self.covered[user as usize] += 1;
        }
    }

    fn leave(&mut self, column: u32) {
        self.stack.pop();
        for &user in &self.columns[column as usize].users {
            self.covered[user as usize] -= 1;
        }
    }
}
