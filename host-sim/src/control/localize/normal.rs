//! Normal equations of a group: users as small blocks, clocks by Schur complement, marginal covariances.
//!
//! With user block `A`, coupling `E` and clock block `H` the system is
//!
//! ```text
//! | A  E | | dp |   | g_p |       S  = H - E' A^-1 E
//! | E' H | | dc | = | g_c |       dc = S^-1 (g_c - E' A^-1 g_p),   dp = A^-1 (g_p - E dc)
//! ```
//!
//! and the covariance of a user is `A^-1 + F S^-1 F'` with `F = A^-1 E`: its own noise plus what the clocks add.

use std::ops::Range;

use super::cholesky::Skyline;
use super::clock::Grid;
use super::model::MAX_CAPTURES;
use super::problem::{Heard, Problem, UserSpan};
use super::robust::{Loss, Row, linearise};
use super::small::{Mat, dot, inverse, mul};
use super::solve::State;

/// What is known of every user beforehand: it lies about where the drones were when they heard it, which keeps its
/// block definite, and about as high as assumed.
#[derive(Clone, Copy, Debug)]
pub(super) struct PositionPrior {
    /// Inverse variance of east and of north about the centroid, 1/m^2.
    pub(super) horizontal_info: f64,
    /// Inverse variance of the altitude about the one assumed, 1/m^2; read where it is unknown.
    pub(super) up_info: f64,
}

impl PositionPrior {
    /// Inverse variance of a coordinate: east, north, up.
    fn info(self, axis: usize) -> f64 {
        if axis < 2 { self.horizontal_info } else { self.up_info }
    }
}

/// How well one user's captures fit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fit {
    /// Robust cost, in half squared standard deviations.
    pub(super) cost: f64,
    /// Weighted sum of squares of the captures with weight.
    pub(super) chi2: f64,
    /// Captures with weight, in occasions with at least two of them.
    pub(super) accepted: u32,
    /// Captures in all.
    pub(super) captures: u32,
    /// TDOAs left: accepted captures less one per occasion.
    pub(super) tdoas: u32,
}

/// Normal equations of one user alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct UserBlock<const D: usize> {
    pub(super) info: Mat<D>,
    /// Downhill.
    pub(super) gradient: [f64; D],
    pub(super) fit: Fit,
}

impl<const D: usize> UserBlock<D> {
    /// Only the prior, at `p`.
    pub(super) fn new(user: &UserSpan, p: [f64; D], prior: PositionPrior) -> Self {
        let mut block = Self { info: [[0.0; D]; D], gradient: [0.0; D], fit: Fit::default() };
        for (axis, p) in p.iter().enumerate() {
            let d = p - user.centroid_m.get(axis).copied().unwrap_or(0.0);
            let info = prior.info(axis);
            block.info[axis][axis] = info;
            block.gradient[axis] = -info * d;
            block.fit.cost += 0.5 * info * d * d;
        }
        block
    }

    /// Adds one occasion. Returns its slopes with the emission time projected out: `u_i - sum w u / sum w`.
    #[inline(always)]
    pub(super) fn add(&mut self, heard: &Heard, row: &Row<D>) -> [[f64; D]; MAX_CAPTURES] {
        self.fit.cost += row.cost;
        self.fit.captures += u32::from(heard.count);
        if row.total <= 0.0 {
            return [[0.0; D]; MAX_CAPTURES];
        }
        let accepted = row.weight.iter().map(|w| u32::from(*w > 0.0)).sum::<u32>();
        if accepted >= 2 {
            self.fit.accepted += accepted;
            self.fit.tdoas += accepted - 1;
        }
        let mean: [f64; D] =
            std::array::from_fn(|axis| dot(row.weight, row.slope.map(|u| u[axis])) * row.inverse_total);
        let slope = row.slope.map(|u| -> [f64; D] { std::array::from_fn(|axis| u[axis] - mean[axis]) });
        let pull: [f64; MAX_CAPTURES] = std::array::from_fn(|i| row.weight[i] * row.deviation_ns[i]);
        self.fit.chi2 += dot(pull, row.deviation_ns);
        for a in 0..D {
            let along = slope.map(|u| u[a]);
            self.gradient[a] += dot(pull, along);
            let weighted: [f64; MAX_CAPTURES] = std::array::from_fn(|i| row.weight[i] * along[i]);
            for b in 0..=a {
                self.info[a][b] += dot(weighted, slope.map(|u| u[b]));
                self.info[b][a] = self.info[a][b];
            }
        }
        slope
    }
}

/// The normal equations at one state.
#[derive(Clone, Debug, Default)]
pub(super) struct Normal<const D: usize> {
    /// Per user: information, gradient (downhill), fit.
    info: Vec<Mat<D>>,
    gradient: Vec<[f64; D]>,
    pub(super) fits: Vec<Fit>,
    /// Knots that a user's occasions touch, ascending, all users in a row; `touched_by` has the ranges.
    touched: Vec<u32>,
    touched_by: Vec<Range<usize>>,
    /// `E`: per touched knot a row of each coordinate, one entry per clock each.
    coupling: Vec<f64>,
    /// `H` without priors: per interval the lower triangles of the blocks (k, k), (k+1, k), (k+1, k+1), all symmetric.
    clock_info: Vec<f64>,
    clock_gradient: Vec<f64>,
    /// Cost of the captures and of all priors.
    pub(super) cost: f64,
}

/// A step of all unknowns.
#[derive(Clone, Debug, Default)]
pub(super) struct Step<const D: usize> {
    pub(super) users_m: Vec<[f64; D]>,
    pub(super) clocks: Vec<f64>,
    /// By how much the linearised cost falls.
    pub(super) predicted: f64,
}

impl<const D: usize> Normal<D> {
    /// Linearises every `thin(user)`-th occasion of every user at `state`.
    pub(super) fn evaluate(
        &mut self,
        problem: &Problem,
        state: &State<D>,
        loss: &Loss,
        prior: PositionPrior,
        thin: impl Fn(&UserSpan) -> usize,
    ) {
        let m = state.grid.clocks();
        self.info.clear();
        self.gradient.clear();
        self.fits.clear();
        self.touched.clear();
        self.touched_by.clear();
        self.coupling.clear();
        self.clock_info.clear();
        self.clock_info.resize(state.grid.intervals * 3 * m * m, 0.0);
        self.clock_gradient.clear();
        self.clock_gradient.resize(state.grid.unknowns(), 0.0);
        self.cost = 0.0;
        for (user, &p) in problem.users.iter().zip(&state.pos_m) {
            let first_touched = self.touched.len();
            let mut block = UserBlock::new(user, p, prior);
            let mut last_interval = usize::MAX;
            for i in user.span.clone().step_by(thin(user)) {
                let heard = &problem.heard[i];
                if m == 0 {
                    // Clocks are known, and agree.
                    block.add(heard, &linearise(heard, p, [0.0; MAX_CAPTURES], loss));
                    continue;
                }
                let (interval, fraction) = state.grid.locate(heard.time_s);
                if interval != last_interval {
                    self.touch(interval, first_touched, m);
                    last_interval = interval;
                }
                let row = linearise(heard, p, state.clocks.of_captures(heard, interval, fraction), loss);
                let slope = block.add(heard, &row);
                if row.total > 0.0 {
                    self.add_clocks(heard, &row, &slope, interval, fraction, m);
                }
            }
            self.cost += block.fit.cost;
            self.info.push(block.info);
            self.gradient.push(block.gradient);
            self.fits.push(block.fit);
            self.touched_by.push(first_touched..self.touched.len());
        }
        self.cost += state.grid.add_prior(&state.clocks, &mut self.clock_gradient, None);
    }

    /// What one occasion says of the clocks of its captures at the two knots around it, the last two touched.
    #[inline]
    fn add_clocks(
        &mut self,
        heard: &Heard,
        row: &Row<D>,
        slope: &[[f64; D]; MAX_CAPTURES],
        interval: usize,
        fraction: f64,
        m: usize,
    ) {
        let share = [1.0 - fraction, fraction];
        let coupling_start = self.coupling.len() - 2 * D * m;
        let (before, after) = self.coupling[coupling_start..].split_at_mut(D * m);
        let coupling = [before, after];
        let (before, after) = self.clock_gradient[interval * m..(interval + 2) * m].split_at_mut(m);
        let gradient = [before, after];
        let info = &mut self.clock_info[interval * 3 * m * m..(interval + 1) * 3 * m * m];
        let (before, rest) = info.split_at_mut(m * m);
        let (across, after) = rest.split_at_mut(m * m);
        for (i, u) in slope.iter().enumerate() {
            // None for the reference clock, and where there is no capture.
            let Some(clock) = usize::from(heard.slot[i]).checked_sub(1) else { continue };
            let w = row.weight[i];
            for side in 0..2 {
                let shared = share[side] * w;
                for (axis, u) in u.iter().enumerate() {
                    coupling[side][axis * m + clock] += shared * u;
                }
                gradient[side][clock] += shared * row.deviation_ns[i];
            }
            // Of a symmetric matrix the lower triangle: slots ascend with the captures.
            for j in 0..=i {
                let Some(other) = usize::from(heard.slot[j]).checked_sub(1) else { continue };
                // W - W 1 1' W / (1' W 1), see `linearise`.
                let own = if i == j { w } else { 0.0 };
                let value = own - w * row.weight[j] * row.inverse_total;
                let at = clock * m + other;
                before[at] += value * share[0] * share[0];
                across[at] += value * share[0] * share[1];
                after[at] += value * share[1] * share[1];
            }
        }
    }

    /// Makes the last two touched knots those of `interval`.
    fn touch(&mut self, interval: usize, first_touched: usize, m: usize) {
        let known = self.touched[first_touched..].last().map(|&knot| knot as usize);
        for knot in [interval, interval + 1] {
            if known.is_none_or(|last| knot > last) {
                self.touched.push(knot as u32);
                self.coupling.resize(self.coupling.len() + D * m, 0.0);
            }
        }
    }

    /// Holds user `u` where it is: it neither moves nor makes room for the clocks to move.
    pub(super) fn pin(&mut self, u: usize, grid: &Grid) {
        let stride = D * grid.clocks();
        let range = self.touched_by[u].clone();
        self.coupling[range.start * stride..range.end * stride].fill(0.0);
        self.gradient[u] = [0.0; D];
    }

    /// An empty clock matrix with the envelope that these users need. Knots stay in time order: users seen in two
    /// lanes join knots mirrored about the turn, which the envelope follows row by row.
    pub(super) fn envelope(&self, grid: &Grid) -> Skyline {
        let m = grid.clocks();
        let mut first: Vec<usize> = (0..grid.knots()).map(|k| k.saturating_sub(1)).collect();
        for range in &self.touched_by {
            let touched = &self.touched[range.clone()];
            for &knot in touched {
                first[knot as usize] = first[knot as usize].min(touched[0] as usize);
            }
        }
        let knots = first.iter().flat_map(|&f| std::iter::repeat_n(f * m, m));
        Skyline::new(knots.chain(std::iter::repeat_n(0, m)).collect())
    }

    /// Eliminates the users, with the diagonal of their blocks raised by the fraction `damping`, and factors the
    /// clocks' matrix. `None` where it is not positive definite.
    pub(super) fn eliminate(&self, state: &State<D>, damping: f64, mut s: Skyline) -> Option<Eliminated<D>> {
        let (grid, m) = (&state.grid, state.grid.clocks());
        s.clear();
        // Nothing where no clock is unknown.
        for (k, blocks) in self.clock_info.chunks_exact((3 * m * m).max(1)).enumerate() {
            for i in 0..m {
                for j in 0..=i {
                    let at = i * m + j;
                    s.add(k * m + i, k * m + j, blocks[at]);
                    s.add((k + 1) * m + i, (k + 1) * m + j, blocks[at + 2 * m * m]);
                    s.add((k + 1) * m + i, k * m + j, blocks[at + m * m]);
                    if j < i {
                        s.add((k + 1) * m + j, k * m + i, blocks[at + m * m]);
                    }
                }
            }
        }
        let mut ignored = vec![0.0; grid.unknowns()];
        grid.add_prior(&state.clocks, &mut ignored, Some(&mut s));
        let inverses: Vec<Mat<D>> = (self.info.iter())
            .map(|info| {
                let mut damped = *info;
                (0..D).for_each(|axis| damped[axis][axis] *= 1.0 + damping);
                inverse(damped)
            })
            .collect();
        // F = A^-1 E, in the layout of E.
        let mut gain = self.coupling.clone();
        let mut column: Vec<usize> = Vec::new();
        let mut e_rows: [Vec<f64>; D] = std::array::from_fn(|_| Vec::new());
        let mut f_rows = e_rows.clone();
        for (range, a) in self.touched_by.iter().zip(&inverses) {
            column.clear();
            e_rows.iter_mut().chain(&mut f_rows).for_each(Vec::clear);
            for at in range.clone() {
                let block = &mut gain[at * D * m..(at + 1) * D * m];
                for j in 0..m {
                    let e: [f64; D] = std::array::from_fn(|axis| block[axis * m + j]);
                    let f = mul(a, e);
                    column.push(self.touched[at] as usize * m + j);
                    for axis in 0..D {
                        block[axis * m + j] = f[axis];
                        e_rows[axis].push(e[axis]);
                        f_rows[axis].push(f[axis]);
                    }
                }
            }
            for (i, &row) in column.iter().enumerate() {
                let e: [f64; D] = std::array::from_fn(|axis| e_rows[axis][i]);
                let line = s.row_mut(row, column[0], row + 1);
                for (j, &col) in column[..=i].iter().enumerate() {
                    line[col - column[0]] -= dot(e, std::array::from_fn(|axis| f_rows[axis][j]));
                }
            }
        }
        s.factor().then_some(Eliminated { factor: s, inverses, gain })
    }

    /// The Gauss-Newton (damped: Levenberg-Marquardt) step.
    pub(super) fn step(&self, grid: &Grid, damping: f64, eliminated: &Eliminated<D>) -> Step<D> {
        let m = grid.clocks();
        let mut clocks = self.clock_gradient.clone();
        for (range, g) in self.touched_by.iter().zip(&self.gradient) {
            for at in range.clone() {
                let knot = self.touched[at] as usize;
                for j in 0..m {
                    clocks[knot * m + j] -= dot(eliminated.gain(at, j, m), *g);
                }
            }
        }
        eliminated.factor.solve(&mut clocks);
        let mut predicted: f64 = clocks.iter().zip(&self.clock_gradient).map(|(d, g)| 0.5 * d * g).sum();
        let mut users_m = Vec::with_capacity(self.info.len());
        for (u, range) in self.touched_by.iter().enumerate() {
            let mut d = mul(&eliminated.inverses[u], self.gradient[u]);
            for at in range.clone() {
                let knot = self.touched[at] as usize;
                for j in 0..m {
                    let f = eliminated.gain(at, j, m);
                    (0..D).for_each(|axis| d[axis] -= f[axis] * clocks[knot * m + j]);
                }
            }
            predicted += 0.5 * dot(d, self.gradient[u]);
            for (axis, d) in d.iter().enumerate() {
                predicted += 0.5 * damping * self.info[u][axis][axis] * d * d;
            }
            users_m.push(d);
        }
        Step { users_m, clocks, predicted }
    }

    /// Marginal covariance of every user: `A^-1 + F S^-1 F'`.
    pub(super) fn covariances(&self, grid: &Grid, eliminated: &Eliminated<D>) -> Vec<Mat<D>> {
        let m = grid.clocks();
        let z = eliminated.factor.inverse_in_envelope();
        let mut column: Vec<usize> = Vec::new();
        let mut f_rows: Vec<[f64; D]> = Vec::new();
        (self.touched_by.iter().zip(&eliminated.inverses))
            .map(|(range, known_clocks)| {
                let mut cov = *known_clocks;
                column.clear();
                f_rows.clear();
                for at in range.clone() {
                    for j in 0..m {
                        column.push(self.touched[at] as usize * m + j);
                        f_rows.push(eliminated.gain(at, j, m));
                    }
                }
                for (i, &row) in column.iter().enumerate() {
                    let line = z.row(row, column[0], row + 1);
                    // Z F' by its lower triangle: off-diagonal entries count for both sides.
                    let mut zf = [0.0; D];
                    for (f, &col) in f_rows[..i].iter().zip(&column) {
                        let value = line[col - column[0]];
                        (0..D).for_each(|axis| zf[axis] += value * f[axis]);
                    }
                    let (diagonal, f) = (line[row - column[0]], f_rows[i]);
                    for a in 0..D {
                        for b in 0..D {
                            cov[a][b] += f[a] * zf[b] + f[b] * zf[a] + diagonal * f[a] * f[b];
                        }
                    }
                }
                cov
            })
            .collect()
    }
}

/// Users eliminated, clocks factored.
#[derive(Clone, Debug)]
pub(super) struct Eliminated<const D: usize> {
    factor: Skyline,
    /// `A^-1` per user: the covariance if the clocks were known.
    pub(super) inverses: Vec<Mat<D>>,
    /// `A^-1 E`, in the layout of `E`.
    gain: Vec<f64>,
}

impl<const D: usize> Eliminated<D> {
    /// The matrix back, to be filled anew.
    pub(super) fn into_matrix(self) -> Skyline {
        self.factor
    }

    /// Column of `A^-1 E` of clock `j` of `m` at a touched knot.
    #[inline]
    fn gain(&self, at: usize, j: usize, m: usize) -> [f64; D] {
        let block = &self.gain[at * D * m..(at + 1) * D * m];
        std::array::from_fn(|axis| block[axis * m + j])
    }
}
