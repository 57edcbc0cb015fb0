//! The one-disk problem (6): the centre within `radius_m` of the greatest weight of users, exactly.
//!
//! The users that a centre covers change only where it crosses one of their circles. The centres that cover
//! a given set form an intersection of disks, which has a corner, where two circles cross, or is one whole
//! disk (Chazelle and Lee 1986 find the deepest such region by sweeps along all circles). So the crossings and
//! one point of every circle are all that need be tried, and of these only the few inside the small nodes
//! of the branch and bound of `super::search`, which has thrown out everything else before.

use std::time::Instant;

use super::cells::Cells;
use super::greedy::Step;
use super::joint::Column;
use super::search::{self, Best, Bracket, Gain, Goal, Node, Tie, user_name};
use super::{KeepOut, PlaceUser, Site, TOLERANCE_M, centre};
use crate::geometry::V2;

/// Radii are widened by this in the search, so that disks that just touch have an inside; the other
/// half of the tolerance is left for rounding.
const WIDENING_M: f64 = 0.5 * TOLERANCE_M;

/// A centre may lie on a circle, and must not lose that user to rounding.
const ON_CIRCLE_M: f64 = 0.5 * WIDENING_M;

/// Nodes with at most this many open circles are settled, larger ones are split: measured optimum. Users at one
/// place count once; others are parted by nodes that are small enough.
const SETTLED_CIRCLES: usize = 6;

/// Seen from the middle of a node with a half side of this or less, every open circle is within [`ON_CIRCLE_M`].
const SMALLEST_HALF_M: f64 = 0.5 * ON_CIRCLE_M;

/// A centre for one drone.
#[derive(Clone, Debug, PartialEq)]
pub struct Disk {
    /// Where the drone hovers.
    pub pos_m: V2,
    /// Users within their radius of it, ascending.
    pub covered: Vec<usize>,
    /// Their total weight: the greatest of any centre.
    pub weight: f64,
    /// Least `radius - distance` over `covered`: the greatest among the centres that cover them.
    pub margin_m: f64,
}

/// The best disk over `users`, or `None` where no user with a weight can be covered.
///
/// Of equal weights the larger margin is taken, then the smaller east, then the smaller north
/// coordinate (margins and coordinates within 1 um are equal).
///
/// # Example
/// ```
/// use skyroost_host_sim::control::place::{PlaceUser, disk::best_disk};
/// use skyroost_host_sim::geometry::V2;
/// let user = |x, y| PlaceUser { pos_m: V2::new(x, y), radius_m: 500.0, weight: 1.0 };
/// let disk = best_disk(&[user(0.0, 0.0), user(1000.0, 0.0), user(0.0, 5000.0)]).unwrap();
/// assert_eq!(disk.covered, [0, 1]); // closed disks: 2 R apart is close enough
/// ```
#[must_use]
pub fn best_disk(users: &[PlaceUser]) -> Option<Disk> {
    Some(Counting::new(users)?.best_disk(&KeepOut::default())?.0)
}

/// The one-disk problem over users that are struck off as they are served.
#[derive(Debug)]
pub(crate) struct Counting<'a> {
    cells: Cells,
    users: &'a [PlaceUser],
    circles: Circles,
    until: Option<Instant>,
}

/// What the search sees of the users.
#[derive(Debug)]
struct Circles {
    positions_m: Vec<V2>,
    /// Widened radius; negative where the user cannot be covered.
    radii_m: Vec<f64>,
    /// Zero once served.
    weights: Vec<f64>,
}

impl<'a> Counting<'a> {
    /// `None` where no user can be covered.
    pub(crate) fn new(users: &'a [PlaceUser]) -> Option<Self> {
        let coverable = |u: &&PlaceUser| u.radius_m >= 0.0 && u.weight > 0.0;
        let longest_m = users.iter().filter(coverable).map(|u| u.radius_m).reduce(f64::max)? + WIDENING_M;
        let positions_m: Vec<V2> = users.iter().map(|u| u.pos_m).collect();
        let mut cells = Cells::new(&positions_m, longest_m);
        let mut circles = Circles {
            positions_m,
            radii_m: users.iter().map(|u| u.radius_m + WIDENING_M).collect(),
            weights: vec![0.0; users.len()],
        };
        for (user, u) in users.iter().enumerate().filter(|(_, u)| coverable(u)) {
            circles.weights[user] = u.weight;
            cells.add_weight(u.pos_m, u.radius_m + WIDENING_M, u.weight);
        }
        Some(Self { cells, users, circles, until: None })
    }

    /// With an end to every search, which then has the best that it met and a bound on all others.
    pub(super) fn until(self, until: Option<Instant>) -> Self {
        Self { until, ..self }
    }

    /// A disk over the users left that no other one outweighs by more than `gap`; which of several, and how well
    /// centred, is left open.
    pub(super) fn deepest(&self, gap: f64) -> Option<Deepest> {
        let goal = Goal { gap, ..Goal::best(self.until) };
        let found = search::search(&self.cells, &self.circles, &KeepOut::default(), goal);
        let at = found.at?;
        let column = Column { at, users: self.users_at(at) };
        Some(Deepest { column, weight: found.value, ceiling: found.ceiling.max(found.value) })
    }

    /// The disks of at least this weight that no other of them outdoes; none if there are more than `most` in all.
    pub(super) fn all_above(&self, least: f64, most: usize) -> Option<Vec<Column>> {
        let goal = Goal { above: least, collect_from: least, ..Goal::best(self.until) };
        let found = search::search(&self.cells, &self.circles, &KeepOut::default(), goal);
        if found.ended_early || found.collected.len() > most {
            return None;
        }
        let column = |&at: &V2| Column { at, users: self.users_at(at) };
        Some(undominated(found.collected.values().map(column).collect()))
    }

    /// The users left that a centre covers.
    fn users_at(&self, at: V2) -> Vec<u32> {
        let Circles { positions_m, radii_m, weights, .. } = &self.circles;
        let covers = |&user: &u32| {
            let u = user as usize;
            weights[u] > 0.0 && (positions_m[u] - at).norm() <= radii_m[u] + ON_CIRCLE_M
        };
        let mut users: Vec<u32> = self.cells.within_reach(self.cells.square_of(at)).filter(covers).collect();
        users.sort_unstable();
        users
    }

    /// The column of a centre with all users that it covers, struck off or not, and these.
    pub(super) fn all_at(&self, at: V2, and: &[u32]) -> Column {
        let covers = |&user: &u32| {
            let u = &self.users[user as usize];
            u.radius_m >= 0.0 && u.weight > 0.0 && (u.pos_m - at).norm() <= u.radius_m
        };
        let mut users: Vec<u32> = self
            .cells
            .within_reach(self.cells.square_of(at))
            .filter(covers)
            .chain(and.iter().copied())
            .collect();
        users.sort_unstable();
        users.dedup();
        Column { at, users }
    }

    /// Strikes users off.
    pub(super) fn strike(&mut self, users: &[u32]) {
        for &user in users {
            let (user, circles) = (user as usize, &self.circles);
            let (at, reach_m) = (circles.positions_m[user], circles.radii_m[user]);
            self.cells.add_weight(at, reach_m, -circles.weights[user]);
            self.circles.weights[user] = 0.0;
        }
    }

    /// The best disk over the users left, and a weight that no disk exceeds, kept out or not.
    fn best_disk(&self, keep_out: &KeepOut) -> Option<(Disk, f64)> {
        let goal = Goal { collect_ties: true, ..Goal::best(self.until) };
        let found = search::search(&self.cells, &self.circles, keep_out, goal);
        let mut best: Option<Disk> = None;
        for tie in found.ties.values() {
            let Some(disk) = self.centred(tie, keep_out) else { continue };
            if best.as_ref().is_none_or(|b| preferred(&disk, b)) {
                best = Some(disk);
            }
        }
        Some((best?, found.ceiling))
    }

    /// The users of a tie, seen from their best centre; `None` where no centre has them all.
    fn centred(&self, tie: &Tie, keep_out: &KeepOut) -> Option<Disk> {
        let Circles { positions_m, radii_m, weights, .. } = &self.circles;
        let slack_m = tie.rho_m + ON_CIRCLE_M;
        let mut covered: Vec<usize> = self
            .cells
            .within_reach(self.cells.square_of(tie.at))
            .map(|user| user as usize)
            .filter(|&u| weights[u] > 0.0 && (positions_m[u] - tie.at).norm() <= radii_m[u] + slack_m)
            .collect();
        covered.sort_unstable();
        let disks: Vec<(V2, f64)> =
            covered.iter().map(|&u| (self.users[u].pos_m, self.users[u].radius_m)).collect();
        // A tie of radius 0 is a centre that has them all already: the way out if centring fails.
        let witness = (tie.rho_m <= 0.0).then_some(tie.at);
        let (pos_m, margin_m) = centre::most_margin(&disks, keep_out, witness)?;
        let weight = covered.iter().map(|&u| weights[u]).sum();
        (margin_m >= -TOLERANCE_M).then_some(Disk { pos_m, covered, weight, margin_m })
    }
}

impl Step for Counting<'_> {
    fn best(&self, keep_out: &KeepOut) -> Option<(Site, f64)> {
        let (Disk { pos_m, covered, weight, margin_m }, ceiling) = self.best_disk(keep_out)?;
        Some((Site { pos_m, covered, margin_m, expected: weight }, ceiling.max(weight)))
    }

    fn ceiling(&self) -> f64 {
        let goal = Goal::best(self.until);
        let found = search::search(&self.cells, &self.circles, &KeepOut::default(), goal);
        found.value.max(found.ceiling)
    }

    fn serve(&mut self, site: &Site) {
        let covered: Vec<u32> = site.covered.iter().map(|&user| user as u32).collect();
        self.strike(&covered);
    }
}

/// A disk of the greatest weight.
#[derive(Clone, Debug)]
pub(super) struct Deepest {
    pub(super) column: Column,
    /// Weight of its users.
    pub(super) weight: f64,
    /// No disk weighs more.
    pub(super) ceiling: f64,
}

/// Leaves out every column all of whose users another one has too.
fn undominated(mut columns: Vec<Column>) -> Vec<Column> {
    columns.sort_by(|a, b| b.users.len().cmp(&a.users.len()).then_with(|| a.users.cmp(&b.users)));
    columns.dedup_by(|a, b| a.users == b.users);
    // Larger ones that have a column's rarest user are all that can outdo it.
    let mut holders: std::collections::BTreeMap<u32, Vec<usize>> = std::collections::BTreeMap::new();
    let mut kept: Vec<Column> = Vec::new();
    for column in columns {
        let fewest = column
            .users
            .iter()
            .map(|user| holders.get(user).map_or(&[][..], Vec::as_slice))
            .min_by_key(|h| h.len());
        let outdone = fewest
            .is_some_and(|holders| holders.iter().any(|&other| has_all(&kept[other].users, &column.users)));
        if !outdone {
            for &user in &column.users {
                holders.entry(user).or_default().push(kept.len());
            }
            kept.push(column);
        }
    }
    kept
}

/// Whether sorted `all` has every one of sorted `some`.
fn has_all(all: &[u32], some: &[u32]) -> bool {
    let mut rest = all.iter();
    some.iter().all(|user| rest.by_ref().any(|other| other == user))
}

/// The stated rule: more weight, larger margin, smaller east, smaller north.
fn preferred(a: &Disk, b: &Disk) -> bool {
    let [a_keys, b_keys] = [a, b].map(|d| [-d.weight, -d.margin_m, d.pos_m.x, d.pos_m.y]);
    let mut keys = a_keys.into_iter().zip(b_keys);
    keys.find(|(a, b)| (a - b).abs() > TOLERANCE_M).is_some_and(|(a, b)| a < b)
}

impl Gain for Circles {
    fn bracket(&self, user: u32, at: V2, rho_m: f64) -> Bracket {
        let user = user as usize;
        let (weight, radius_m) = (self.weights[user], self.radii_m[user]);
        let distance_m = (self.positions_m[user] - at).norm();
        if weight <= 0.0 || distance_m > radius_m + rho_m {
            Bracket::Never
        } else if distance_m + rho_m <= radius_m {
            Bracket::Always(weight)
        } else {
            Bracket::Varying {
                at_middle: if distance_m <= radius_m { weight } else { 0.0 },
                greatest: weight,
            }
        }
    }

    fn settle(&self, node: &Node, keep_out: &KeepOut, best: &mut Best) -> Option<f64> {
        let tiny = node.half_m <= SMALLEST_HALF_M;
        let mut circles = if tiny { Vec::new() } else { self.few_circles(&node.open)? };
        let rho_m = node.rho_m();
        let shores: Vec<V2> = keep_out.near(node.at, rho_m).collect();
        circles.extend(shores.iter().map(|&shore| (shore, keep_out.shore_m())));
        let mut offer = |at: V2| {
            if (at - node.at).norm() <= rho_m && keep_out.allows(at) {
                self.offer(at, node, best);
            }
        };
        if tiny {
            offer(node.at);
        }
        for (i, &circle) in circles.iter().enumerate() {
            offer(nearest(circle, node.at));
            for &other in &circles[i + 1..] {
                crossings(circle, other).into_iter().flatten().for_each(&mut offer);
            }
        }
        // Where some centres are kept out, not all has been tried.
        Some(if shores.is_empty() { f64::NEG_INFINITY } else { node.ceiling })
    }
}

impl Circles {
    /// The circles of these users, equal ones once; none if there are too many to settle.
    fn few_circles(&self, users: &[u32]) -> Option<Vec<(V2, f64)>> {
        let mut circles: Vec<(V2, f64)> = Vec::with_capacity(users.len().min(SETTLED_CIRCLES));
        for &user in users {
            let circle = (self.positions_m[user as usize], self.radii_m[user as usize]);
            if !circles.contains(&circle) {
                if circles.len() == SETTLED_CIRCLES {
                    return None;
                }
                circles.push(circle);
            }
        }
        Some(circles)
    }

    /// Offers a centre within a node.
    fn offer(&self, at: V2, node: &Node, best: &mut Best) {
        let covers = |&&user: &&u32| {
            let user = user as usize;
            let reach_m = self.radii_m[user] + ON_CIRCLE_M;
            (self.positions_m[user] - at).norm_squared() <= reach_m * reach_m
        };
        let covered = || node.open.iter().filter(covers);
        let value = node.certain + covered().map(|&user| self.weights[user as usize]).sum::<f64>();
        if value > 0.0 && best.wants(value) {
            let name = covered().fold(node.certain_name, |name, &user| name.wrapping_add(user_name(user)));
            best.offer(value, name, at);
        }
    }
}

/// The point of a circle that is nearest to `at`.
fn nearest((hub, radius_m): (V2, f64), at: V2) -> V2 {
    let towards = at - hub;
    let distance_m = towards.norm();
    if distance_m > 0.0 { hub + towards * (radius_m / distance_m) } else { hub + V2::new(radius_m, 0.0) }
}

/// Where two circles cross, if they do.
fn crossings((p, r): (V2, f64), (q, s): (V2, f64)) -> [Option<V2>; 2] {
    let towards = q - p;
    let squared_m2 = towards.norm_squared();
    if squared_m2 > (r + s) * (r + s) || squared_m2 < (r - s) * (r - s) || squared_m2 <= 0.0 {
        return [None; 2];
    }
    // Law of cosines: in units of the distance, how far along it and how far beside it.
    let along = 0.5 * (1.0 + (r - s) * (r + s) / squared_m2);
    let beside = (r * r / squared_m2 - along * along).max(0.0).sqrt();
    let (foot, across) = (p + towards * along, V2::new(-towards.y, towards.x) * beside);
    [Some(foot + across), Some(foot - across)]
}
