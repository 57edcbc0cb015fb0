//! Best-first branch and bound over squares of centres: where can one drone gain the most?
//!
//! A square is handled as its circumscribed disk, so that one distance per user tells all: users whose
//! disk contains it are gained anywhere in it, users whose disk misses it nowhere, and only the others
//! are looked at again in its four quarters. Squares that cannot beat the best centre known are never
//! opened. The method is that of max-depth searches on arrangements of disks; exactness comes from the
//! leaf of the objective (for counts all crossings of circles, for probabilities a stated gap).

use std::collections::BTreeMap;
use std::time::Instant;

use super::KeepOut;
use super::cells::Cells;
use super::queue::Queue;
use crate::geometry::V2;

/// Sums of weights closer than this are equal.
pub(super) const SAME_VALUE: f64 = 1e-9;

/// A search that collects more sets than this ends.
pub(super) const MOST_COLLECTED: usize = 200_000;

/// Squares and nodes looked at between two looks at the time.
const ROUNDS_A_LOOK: u64 = 256;

/// What a user contributes over the disk of centres of a node.
#[derive(Clone, Copy)]
pub(super) enum Bracket {
    /// Nothing, wherever the centre.
    Never,
    /// The same, wherever the centre.
    Always(f64),
    /// At most `greatest`.
    Varying { at_middle: f64, greatest: f64 },
}

/// What is summed over the users.
pub(super) trait Gain {
    /// Range of the gain of `user` over the closed disk (`at`, `rho_m`) of centres.
    fn bracket(&self, user: u32, at: V2, rho_m: f64) -> Bracket;

    /// Settles a small node by offering the best centres in it, and bounds what it may hold beyond the
    /// offers (minus infinity: nothing); `None` asks for its quarters.
    fn settle(&self, node: &Node, keep_out: &KeepOut, best: &mut Best) -> Option<f64>;
}

/// A square of centres with what is known about it.
pub(super) struct Node {
    pub(super) at: V2,
    pub(super) half_m: f64,
    /// Gain of the users that are certain in the whole node.
    pub(super) certain: f64,
    /// Name of the set of certain users, see [`user_name`].
    pub(super) certain_name: u64,
    /// Users whose gain varies within the node.
    pub(super) open: Vec<u32>,
    /// Upper bound of the gain of any centre in the node.
    pub(super) ceiling: f64,
    /// Name of the set of all users within reach of the node.
    pub(super) full_name: u64,
}

impl Node {
    /// Radius of the circumscribed disk.
    pub(super) fn rho_m(&self) -> f64 {
        self.half_m * std::f64::consts::SQRT_2
    }
}

/// A set of users is named by the wrapping sum of its members' names: 64 well-mixed bits, so that two
/// different sets share a name once in 2^64.
pub(super) fn user_name(user: u32) -> u64 {
    // The finaliser of SplitMix64 (Steele, Lea and Flood 2014).
    let mut z = u64::from(user).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A set of users that may reach the best value: those gained by some centre within `rho_m` of `at`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tie {
    pub(super) at: V2,
    pub(super) rho_m: f64,
}

/// The best value found so far, where, and the sets of users that reach it.
#[derive(Debug)]
pub(super) struct Best {
    pub(super) value: f64,
    /// The first centre that reached `value`.
    pub(super) at: Option<V2>,
    /// No centre is worth more than this, not even one that is kept out.
    pub(super) ceiling: f64,
    /// By name, the centres of all sets worth at least what [`Goal::collect_from`] asks for.
    pub(super) collected: BTreeMap<u64, V2>,
    collect_from: f64,
    /// Whether there was no time or room for all: `ceiling` holds, but better centres and further sets may be left.
    pub(super) ended_early: bool,
    /// By name. Those with a radius are rivals that may turn out not to be coverable.
    pub(super) ties: BTreeMap<u64, Tie>,
}

impl Best {
    /// Whether a centre of this value would change anything.
    pub(super) fn wants(&self, value: f64) -> bool {
        value >= self.collect_from.min(self.value - SAME_VALUE)
    }

    /// Offers a centre with its value and the name of the users it gains.
    pub(super) fn offer(&mut self, value: f64, name: u64, at: V2) {
        if value >= self.collect_from {
            self.collected.entry(name).or_insert(at);
        }
        if value > self.value + SAME_VALUE {
            self.value = value;
            self.at = Some(at);
            self.ties.clear();
        } else if value < self.value - SAME_VALUE || self.at.is_none() {
            return;
        }
        self.ties.entry(name).or_insert(Tie { at, rho_m: 0.0 });
    }
}

/// How far a search goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    /// Only centres above this are of interest.
    pub(super) above: f64,
    /// Stop when no centre can be better than the best by more than this.
    pub(super) gap: f64,
    /// Also collect every other set of users that may reach the best value.
    pub(super) collect_ties: bool,
    /// Collect every set of users worth at least this that is not part of another one, and more; infinite for none.
    pub(super) collect_from: f64,
    /// When to end with what is known by then.
    pub(super) until: Option<Instant>,
}

impl Goal {
    /// The best centre of all, exactly.
    pub(super) fn best(until: Option<Instant>) -> Self {
        Self { above: 0.0, gap: 0.0, collect_ties: false, collect_from: f64::INFINITY, until }
    }
}

/// Best centre for one drone. The value is `goal.above` and there is no centre when nothing is better.
pub(super) fn search<G: Gain>(cells: &Cells, gain: &G, keep_out: &KeepOut, goal: Goal) -> Best {
    let best = Best {
        value: goal.above,
        at: None,
        ceiling: goal.above,
        collected: BTreeMap::new(),
        collect_from: goal.collect_from,
        ended_early: false,
        ties: BTreeMap::new(),
    };
    let mut search = Search { gain, keep_out, goal, best, nodes: Queue::default(), open: Vec::new() };
    // A first centre spares most squares the queue.
    let first = cells.highest();
    search.open_square(cells, first);
    let mut squares = cells.by_ceiling(search.open_above().min(search.best.value - SAME_VALUE));
    for round in 1u64.. {
        let (opened, fresh) = (search.nodes.ceiling(), squares.ceiling());
        if opened.max(fresh) <= search.open_above() {
            break;
        }
        let late =
            round.is_multiple_of(ROUNDS_A_LOOK) && goal.until.is_some_and(|until| Instant::now() >= until);
        if late || search.best.collected.len() > MOST_COLLECTED {
            search.best.ceiling = search.best.ceiling.max(opened).max(fresh);
            search.best.ended_early = true;
            return search.best;
        }
        if fresh >= opened {
            squares.pop().into_iter().for_each(|(_, square)| search.open_square(cells, square));
        } else {
            search.settle_or_split();
        }
    }
    search.best.ceiling = search.best.ceiling.max(search.best.value + goal.gap);
    if goal.collect_ties && search.best.at.is_some() {
        search.collect_ties(cells, squares);
    }
    search.best
}

/// The state of one search.
struct Search<'a, G> {
    gain: &'a G,
    keep_out: &'a KeepOut,
    goal: Goal,
    best: Best,
    nodes: Queue<Node>,
    /// Scratch: most nodes are not kept, and then their list need not be.
    open: Vec<u32>,
}

impl<G: Gain> Search<'_, G> {
    /// Nodes up to this hold nothing of interest.
    fn open_above(&self) -> f64 {
        (self.best.value + self.goal.gap.max(SAME_VALUE)).min(self.goal.collect_from - SAME_VALUE)
    }

    fn open_square(&mut self, cells: &Cells, square: usize) {
        let (at, half_m) = cells.square(square);
        self.open(at, half_m, (0.0, 0), cells.within_reach(square));
    }

    fn settle_or_split(&mut self) {
        let Some((_, node)) = self.nodes.pop() else { return };
        if let Some(ceiling) = self.gain.settle(&node, self.keep_out, &mut self.best) {
            self.best.ceiling = self.best.ceiling.max(ceiling);
            return;
        }
        let quarter_m = 0.5 * node.half_m;
        for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            let at = node.at + V2::new(sx, sy) * quarter_m;
            self.open(at, quarter_m, (node.certain, node.certain_name), node.open.iter().copied());
        }
    }

    /// The best value is final here, and a node whose ceiling equals it can reach it in one way only:
    /// with all its users. So such a node is one set of users, and needs no further search.
    fn collect_ties(&mut self, cells: &Cells, mut squares: Queue<usize>) {
        let least = self.best.value - SAME_VALUE;
        while squares.ceiling() >= least {
            squares.pop().into_iter().for_each(|(_, square)| self.open_square(cells, square));
        }
        // The disk of a square is wider than the square, and may have a higher ceiling: search it.
        while self.nodes.ceiling() > self.open_above() {
            self.settle_or_split();
        }
        while self.nodes.ceiling() >= least {
            let Some((_, node)) = self.nodes.pop() else { return };
            let tie = Tie { at: node.at, rho_m: node.rho_m() };
            self.best.ties.entry(node.full_name).or_insert(tie);
        }
    }

    /// Bounds one square, offers its middle, and keeps it if it can still hold something better.
    fn open(
        &mut self,
        at: V2,
        half_m: f64,
        (mut certain, mut certain_name): (f64, u64),
        users: impl Iterator<Item = u32>,
    ) {
        let rho_m = half_m * std::f64::consts::SQRT_2;
        self.open.clear();
        let (mut varying, mut middle, mut open_name, mut middle_name) = (0.0, 0.0, 0u64, 0u64);
        for user in users {
            match self.gain.bracket(user, at, rho_m) {
                Bracket::Never => {}
                Bracket::Always(value) => {
                    certain += value;
                    certain_name = certain_name.wrapping_add(user_name(user));
                }
                Bracket::Varying { at_middle, greatest } => {
                    self.open.push(user);
                    varying += greatest;
                    let name = user_name(user);
                    open_name = open_name.wrapping_add(name);
                    if at_middle > 0.0 {
                        middle += at_middle;
                        middle_name = middle_name.wrapping_add(name);
                    }
                }
            }
        }
        let ceiling = certain + varying;
        if self.keep_out.swallows(at, rho_m) {
            // No centre here, but the bound on all centres must know.
            self.best.ceiling = self.best.ceiling.max(ceiling);
            return;
        }
        if certain + middle > 0.0 && self.best.wants(certain + middle) && self.keep_out.allows(at) {
            self.best.offer(certain + middle, certain_name.wrapping_add(middle_name), at);
        }
        let worth = if self.goal.collect_ties {
            ceiling >= self.best.value - SAME_VALUE
        } else {
            ceiling > self.open_above()
        };
        if worth && ceiling > 0.0 {
            let full_name = open_name.wrapping_add(certain_name);
            let open = self.open.clone();
            let node = Node { at, half_m, certain, certain_name, open, ceiling, full_name };
            self.nodes.push(ceiling, node);
        }
    }
}
