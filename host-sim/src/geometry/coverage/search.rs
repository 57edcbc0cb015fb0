//! Divides the polygon into cells until each is decided by one stadium, by none, or by the exact kernel.

use super::super::V2;
use super::super::polygon::{bbox, clip, signed_area_m2};
use super::Stadium;
use super::chain::Chain;
use super::slab::Kernel;

/// A run of legs counts as one straight stadium when its two bounds agree to this share of the polygon's
/// extent (10 um in 10 km).
const STRAIGHT_TOLERANCE: f64 = 1e-9;

/// A node of the track is opened up once its two bounds differ by more than this share of the cell.
const OPEN_AT: f64 = 0.125;

/// Straight runs that the kernel takes on at once in a cell that might still be divided: its cost grows
/// with the square of their number.
const KERNEL_STADIUMS: usize = 12;

/// Runs that a cell opened up to single legs may hold before it is divided instead.
const OPENED_NODES: usize = 48;

/// How many of the deepest candidates the others are compared with.
const DOMINATORS: usize = 16;

/// Cells smaller than this share of the largest radius are opened up to single legs ...
const FINE_CELL: f64 = 1.0 / 64.0;

/// ... and cells smaller than this go to the kernel, however many legs meet there.
const LAST_CELL: f64 = 1.0 / 65_536.0;

/// A rectangle and the polygon's part in it.
struct Cell {
    min: V2,
    max: V2,
    piece: Vec<V2>,
    /// The piece is the whole rectangle.
    whole: bool,
}

impl Cell {
    fn centre(&self) -> V2 {
        (self.min + self.max) / 2.0
    }

    fn half_diagonal_m(&self) -> f64 {
        (self.max - self.min).norm() / 2.0
    }

    /// The two halves across the longer side that hold part of the polygon.
    fn halves(&self) -> impl Iterator<Item = Self> {
        let (size, centre) = (self.max - self.min, self.centre());
        let axis = if size.x >= size.y { V2::x() } else { V2::y() };
        let cut = axis.dot(&centre);
        [1.0, -1.0].into_iter().filter_map(move |side| {
            let (mut min, mut max) = (self.min, self.max);
            let moved = if side > 0.0 { &mut max } else { &mut min };
            *moved += axis * (cut - axis.dot(moved));
            let corners = || vec![min, V2::new(max.x, min.y), max, V2::new(min.x, max.y)];
            if self.whole {
                return Some(Self { min, max, piece: corners(), whole: true });
            }
            let piece = clip(&self.piece, axis * side, cut * side);
            let (area_m2, full_m2) = (signed_area_m2(&piece), signed_area_m2(&corners()));
            if area_m2 <= 0.0 {
                return None;
            }
            let whole = area_m2 >= full_m2 * (1.0 - 1e-14);
            Some(Self { min, max, piece: if whole { corners() } else { piece }, whole })
        })
    }
}

/// The search through the cells, and what it found.
pub(super) struct Search {
    chain: Chain,
    straight_m: f64,
    reach_m: f64,
    kernel: Kernel,
    /// Stack of node indices: each cell's candidates lie above those of the cell around it.
    candidates: Vec<usize>,
    pub(super) uncovered_area_m2: f64,
    pub(super) residue: Vec<Vec<V2>>,
}

/// What a node means to a cell.
enum Verdict {
    Covers,
    Misses,
    Meets,
}

impl Search {
    /// A search over rings that extend over `extent_m`.
    pub(super) fn new(extent_m: f64, stadiums: &[Stadium]) -> Self {
        let chain = Chain::new(stadiums);
        Self {
            candidates: chain.root().into_iter().collect(),
            chain,
            straight_m: STRAIGHT_TOLERANCE * extent_m,
            reach_m: stadiums.iter().map(|s| s.radius_m).fold(0.0, f64::max),
            kernel: Kernel::default(),
            uncovered_area_m2: 0.0,
            residue: Vec::new(),
        }
    }

    pub(super) fn run(&mut self, ring_m: &[V2]) {
        let Some([min, max]) = bbox(ring_m) else { return };
        self.cell(&Cell { min, max, piece: ring_m.to_vec(), whole: false }, 0);
    }

    /// Decides a cell, given the nodes from `inherited` to the top of the stack; leaves the stack as it is.
    fn cell(&mut self, cell: &Cell, inherited: usize) {
        let size_m = (cell.max - cell.min).amax();
        let own = self.candidates.len();
        if !self.filter(cell, inherited, own, OPEN_AT * size_m) {
            let fine = size_m <= FINE_CELL * self.reach_m;
            let last = size_m <= LAST_CELL * self.reach_m;
            if self.candidates.len() == own {
                self.leave(cell);
            } else if self.few_straight_runs(own) || last {
                self.run_kernel(cell, own);
            } else if !(fine && self.try_opened(cell, own)) {
                for half in cell.halves() {
                    self.cell(&half, own);
                }
            }
        }
        self.candidates.truncate(own);
    }

    /// Pushes those of the nodes `from..to` (or of their halves, where a node's bounds differ by more
    /// than `gap_m`) that meet the cell. True when one covers the cell.
    fn filter(&mut self, cell: &Cell, from: usize, to: usize, gap_m: f64) -> bool {
        let gap_m = gap_m.max(self.straight_m);
        let mut pending = [0; 64];
        for k in from..to {
            pending[0] = self.candidates[k];
            let mut depth = 1;
            // Depth first; a tree over 2^60 legs would not overflow the stack.
            while depth > 0 {
                depth -= 1;
                let index = pending[depth];
                match self.verdict(cell, index) {
                    Verdict::Covers => return true,
                    Verdict::Misses => {}
                    Verdict::Meets => match self.chain.halves(index) {
                        Some([first, second]) if self.chain.node(index).gap_m() > gap_m => {
                            (pending[depth], pending[depth + 1]) = (second, first);
                            depth += 2;
                        }
                        _ => self.candidates.push(index),
                    },
                }
            }
        }
        false
    }

    fn verdict(&self, cell: &Cell, index: usize) -> Verdict {
        let node = self.chain.node(index);
        let (distance_m, half_m) = (node.inner.axis_distance_m(cell.centre()), cell.half_diagonal_m());
        if distance_m >= node.outer_radius_m + half_m {
            Verdict::Misses
        } else if distance_m + half_m <= node.inner.radius_m
            || (distance_m <= node.inner.radius_m && node.inner.contains_all(&cell.piece))
        {
            Verdict::Covers
        } else {
            Verdict::Meets
        }
    }

    fn few_straight_runs(&self, own: usize) -> bool {
        let mine = &self.candidates[own..];
        mine.len() <= KERNEL_STADIUMS && mine.iter().all(|&i| self.is_straight(i))
    }

    fn is_straight(&self, index: usize) -> bool {
        self.chain.node(index).gap_m() <= self.straight_m || self.chain.halves(index).is_none()
    }

    /// Opens the candidates level by level down to straight runs, dropping at each level those that others
    /// make needless. Decides the cell if few enough are left in the end; else nothing has happened.
    fn try_opened(&mut self, cell: &Cell, own: usize) -> bool {
        let given = self.candidates.len();
        let mut gap_m = OPEN_AT * (cell.max - cell.min).amax();
        let mut from = own;
        loop {
            gap_m /= 4.0;
            let to = self.candidates.len();
            if self.filter(cell, from, to, gap_m) {
                return true;
            }
            from = to;
            self.drop_dominated(cell, from);
            if self.candidates.len() == from {
                self.leave(cell);
                return true;
            }
            if self.few_straight_runs(from) {
                self.run_kernel(cell, from);
                return true;
            }
            let crowded = self.candidates.len() - from > OPENED_NODES;
            if crowded || self.candidates[from..].iter().all(|&i| self.is_straight(i)) {
                self.candidates.truncate(given);
                return false;
            }
        }
    }

    /// Drops candidates whose part of the cell lies within another's, found by a bound that holds for all
    /// of the cell.
    ///
    /// The depth `f = distance from the axis - radius` is convex. Around the cell's centre c it is never
    /// below its tangent, `f(c) + g.(x - c)` with g the unit vector away from the axis, and above it by
    /// at most `h^2 / (2 (distance - h))` within h of c, since its curvature is at most one over the distance.
    fn drop_dominated(&mut self, cell: &Cell, from: usize) {
        let (centre, half_m) = (cell.centre(), cell.half_diagonal_m());
        let tangent = |chain: &Chain, index: usize, radius_m: f64| {
            let away = centre - chain.node(index).inner.foot(centre);
            let distance_m = away.norm();
            (distance_m - radius_m, away / distance_m, distance_m)
        };
        for rank in from..from + DOMINATORS {
            // The deepest of those not yet compared; it stays.
            let deepest = (rank..self.candidates.len())
                .map(|k| {
                    (
                        k,
                        tangent(
                            &self.chain,
                            self.candidates[k],
                            self.chain.node(self.candidates[k]).inner.radius_m,
                        ),
                    )
                })
                .min_by(|a, b| a.1.0.total_cmp(&b.1.0));
            let Some((k, (depth_m, away, distance_m))) = deepest else { return };
            self.candidates.swap(rank, k);
            if distance_m <= half_m {
                continue;
            }
            let bend_m = half_m * half_m / (2.0 * (distance_m - half_m));
            let mut keep = rank + 1;
            for k in rank + 1..self.candidates.len() {
                let index = self.candidates[k];
                let (other_m, other_away, _) =
                    tangent(&self.chain, index, self.chain.node(index).outer_radius_m);
                // A NaN (a cell centred on an axis has no direction away from it) dominates nothing.
                let dominated = other_m - depth_m >= (other_away - away).norm() * half_m + bend_m;
                if !dominated {
                    self.candidates[keep] = index;
                    keep += 1;
                }
            }
            self.candidates.truncate(keep);
        }
    }

    fn leave(&mut self, cell: &Cell) {
        self.uncovered_area_m2 += signed_area_m2(&cell.piece).max(0.0);
        self.residue.push(cell.piece.clone());
    }

    fn run_kernel(&mut self, cell: &Cell, from: usize) {
        let runs = self.candidates[from..].iter().map(|&i| self.chain.node(i).inner);
        self.uncovered_area_m2 +=
            self.kernel.uncovered(&cell.piece, runs.filter(|s| s.radius_m > 0.0), &mut self.residue);
    }
}
