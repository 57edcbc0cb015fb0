//! The clocks of a group: knots in time, what is known of them beforehand, and a first robust line.
//!
//! Only differences can be observed, so every clock is counted against the group's first drone. With D drones
//! whose clocks are independent and alike, the differences have covariance `s^2 (I + 11')`, whose inverse is
//! `(I - 11'/D) / s^2`: the reference projected out, just as an emission time is from an occasion.

use super::cholesky::Skyline;
use super::model::{C_M_PER_NS, ClockModel, LocalizeConfig, MAX_CAPTURES};
use super::problem::{Heard, Problem};

/// Prior standard deviations below this are taken as this: "none" without a special case.
const TIGHTEST_NS: f64 = 1e-3;
/// Steps of the walk below this likewise; a fixed clock loses nothing by 0.01 ns (4 cm).
const TIGHTEST_STEP_NS: f64 = 1e-2;
/// Prior standard deviations of offsets above this are taken as this: a tenth of a millisecond says nothing, and
/// a matrix that only the prior keeps definite needs its digits.
const WIDEST_NS: f64 = 1e5;
/// Most intervals of a coarse and of a fine grid; 12,000 s at 20 s each are 600. Nor are there ever more than two
/// per occasion, however far apart these are in time.
const MOST_INTERVALS: [usize; 2] = [100, 4000];

/// Equally spaced knots over the time of a group; offsets are linear between neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    start_s: f64,
    step_s: f64,
    per_second: f64,
    pub(super) intervals: usize,
    /// Drones of the group.
    pub(super) drones: usize,
    /// Whether clocks are declared to agree: then none is unknown.
    known: bool,
    offset_sigma_ns: f64,
    /// Drift over the whole time of the group.
    drift_sigma_ns: f64,
    walk_sigma_ns: f64,
}

/// How finely a grid follows the walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Resolution {
    /// To four times the capture noise: for the first iterations.
    Coarse,
    /// To a sixteenth of it, so that interpolation costs no accuracy: 20 s at the defaults.
    Fine,
}

impl Grid {
    /// Knots over `problem`.
    pub(super) fn new(problem: &Problem, cfg: &LocalizeConfig, resolution: Resolution) -> Self {
        let (offset, drift, walk) = match cfg.clock {
            ClockModel::Synchronised => (0.0, 0.0, 0.0),
            ClockModel::SharedConstant => (f64::INFINITY, 0.0, 0.0),
            ClockModel::SharedWander { offset_sigma_ns, drift_sigma_ns_per_s, walk_ns_per_sqrt_s } => {
                (offset_sigma_ns, drift_sigma_ns_per_s, walk_ns_per_sqrt_s)
            }
        };
        let [start_s, end_s] = problem.time_s;
        let span_s = (end_s - start_s).max(1e-3);
        // A walk between two knots strays from the straight line by walk * sqrt(step) / 2 in the middle, twice
        // as much in variance for a difference of two clocks.
        let (stray_sigmas, most_intervals) = match resolution {
            Resolution::Coarse => (4.0, MOST_INTERVALS[0]),
            Resolution::Fine => (0.063, MOST_INTERVALS[1]),
        };
        let wanted_s = 2.0 * (stray_sigmas * cfg.sigma_toa_ns / walk).powi(2);
        let most = most_intervals.min(2 * problem.heard.len()).max(1);
        let intervals = (span_s / wanted_s).ceil().clamp(1.0, most as f64) as usize;
        let step_s = span_s / intervals as f64;
        Self {
            start_s,
            step_s,
            per_second: 1.0 / step_s,
            intervals,
            drones: problem.drones.len(),
            known: cfg.clock == ClockModel::Synchronised,
            // What is known holds at time 0; drift has widened it since.
            offset_sigma_ns: offset.hypot(drift * start_s).clamp(TIGHTEST_NS, WIDEST_NS),
            drift_sigma_ns: (drift * span_s).clamp(TIGHTEST_NS, 100.0 * WIDEST_NS),
            walk_sigma_ns: (walk * step_s.sqrt()).clamp(TIGHTEST_STEP_NS, WIDEST_NS),
        }
    }

    /// Clocks that are unknown: all but the reference, or none.
    pub(super) fn clocks(&self) -> usize {
        if self.known { 0 } else { self.drones.saturating_sub(1) }
    }

    pub(super) fn knots(&self) -> usize {
        self.intervals + 1
    }

    /// Unknowns: every clock at every knot, then every drift.
    pub(super) fn unknowns(&self) -> usize {
        (self.knots() + 1) * self.clocks()
    }

    pub(super) fn knot_time_s(&self, knot: usize) -> f64 {
        self.start_s + knot as f64 * self.step_s
    }

    /// Interval that holds `time_s`, and how far into it (0 to 1).
    #[inline]
    pub(super) fn locate(&self, time_s: f64) -> (usize, f64) {
        let at = (time_s - self.start_s) * self.per_second;
        let interval = (at as usize).min(self.intervals - 1);
        (interval, (at - interval as f64).clamp(0.0, 1.0))
    }

    /// Adds what is known beforehand at `clocks`: to the gradient (downhill) and, where asked for, to the matrix.
    /// `row_of` maps a knot to its first row. Returns the cost.
    pub(super) fn add_prior(
        &self,
        clocks: &Clocks,
        gradient: &mut [f64],
        mut matrix: Option<&mut Skyline>,
    ) -> f64 {
        let m = self.clocks();
        if m == 0 {
            return 0.0;
        }
        let drift_row = self.knots() * m;
        let mut cost = 0.0;
        let mut project = Vec::with_capacity(m);
        let mut residual = vec![0.0; m];
        // A residual sum of `factor * x[row + j]` with standard deviation sigma.
        let mut add = |terms: &[(usize, f64)], sigma_ns: f64, residual: &[f64]| {
            let weight = sigma_ns.powi(-2);
            let mean = residual.iter().sum::<f64>() / self.drones as f64;
            project.clear();
            project.extend(residual.iter().map(|r| weight * (r - mean)));
            cost += 0.5 * residual.iter().zip(&project).map(|(r, p)| r * p).sum::<f64>();
            for &(row, factor) in terms {
                for j in 0..m {
                    gradient[row + j] -= factor * project[j];
                }
            }
            let Some(matrix) = matrix.as_deref_mut() else { return };
            for (t, &(row_a, factor_a)) in terms.iter().enumerate() {
                for &(row_b, factor_b) in &terms[..=t] {
                    for i in 0..m {
                        for j in 0..m {
                            if row_a == row_b && j > i {
                                continue;
                            }
                            let projection = f64::from(u8::from(i == j)) - 1.0 / self.drones as f64;
                            matrix.add(row_a + i, row_b + j, weight * factor_a * factor_b * projection);
                        }
                    }
                }
            }
        };
        residual.iter_mut().enumerate().for_each(|(j, r)| *r = clocks.offset_ns(0, j + 1));
        add(&[(0, 1.0)], self.offset_sigma_ns, &residual);
        residual.copy_from_slice(&clocks.drift_ns);
        add(&[(drift_row, 1.0)], self.drift_sigma_ns, &residual);
        let share = 1.0 / self.intervals as f64;
        for k in 0..self.intervals {
            for (j, (r, drift_ns)) in residual.iter_mut().zip(&clocks.drift_ns).enumerate() {
                *r = clocks.offset_ns(k + 1, j + 1) - clocks.offset_ns(k, j + 1) - share * drift_ns;
            }
            add(&[(k * m, -1.0), ((k + 1) * m, 1.0), (drift_row, -share)], self.walk_sigma_ns, &residual);
        }
        cost
    }
}

/// Offsets of all drones at all knots, and drifts.
#[derive(Clone, Debug)]
pub(super) struct Clocks {
    drones: usize,
    /// Knot by knot, the reference's zero included so that captures need no case.
    offset_ns: Vec<f64>,
    /// Drift over the whole time of the group, without the reference's.
    pub(super) drift_ns: Vec<f64>,
}

impl Clocks {
    /// Lines through `(offset at the first knot, drift over the whole time)`, one per drone.
    pub(super) fn from_lines(grid: &Grid, lines: &[(f64, f64)]) -> Self {
        let offset_ns = (0..grid.knots())
            .flat_map(|k| {
                lines.iter().map(move |(offset, drift)| offset + drift * k as f64 / grid.intervals as f64)
            })
            .collect();
        Self { drones: grid.drones, offset_ns, drift_ns: lines.iter().skip(1).map(|line| line.1).collect() }
    }

    /// The same clocks on another grid over the same time.
    pub(super) fn resample(&self, from: &Grid, to: &Grid) -> Self {
        let mut offset_ns = Vec::with_capacity(to.knots() * self.drones);
        for k in 0..to.knots() {
            let (interval, fraction) = from.locate(to.knot_time_s(k));
            offset_ns.extend((0..self.drones).map(|slot| self.at(interval, fraction, slot)));
        }
        Self { drones: self.drones, offset_ns, drift_ns: self.drift_ns.clone() }
    }

    #[inline]
    pub(super) fn offset_ns(&self, knot: usize, slot: usize) -> f64 {
        self.offset_ns[knot * self.drones + slot]
    }

    /// The constant part of a clock's drift.
    pub(super) fn drift_ns_per_s(&self, grid: &Grid, slot: usize) -> f64 {
        let over_all_ns = slot.checked_sub(1).map_or(0.0, |clock| self.drift_ns[clock]);
        over_all_ns * grid.per_second / grid.intervals as f64
    }

    #[inline]
    fn at(&self, interval: usize, fraction: f64, slot: usize) -> f64 {
        let before = self.offset_ns[interval * self.drones + slot];
        let after = self.offset_ns[(interval + 1) * self.drones + slot];
        before + fraction * (after - before)
    }

    /// Offsets of the captures of one occasion.
    #[inline]
    pub(super) fn of_captures(&self, heard: &Heard, interval: usize, fraction: f64) -> [f64; MAX_CAPTURES] {
        std::array::from_fn(|i| self.at(interval, fraction, usize::from(heard.slot[i])))
    }

    /// Adds a step, in the order of unknowns.
    pub(super) fn step(&mut self, step: &[f64]) {
        if step.is_empty() {
            return; // known
        }
        let m = self.drones - 1;
        let (knots, drifts) = step.split_at(step.len() - m);
        for (offsets, steps) in self.offset_ns.chunks_exact_mut(self.drones).zip(knots.chunks_exact(m)) {
            for (offset, step) in offsets[1..].iter_mut().zip(steps) {
                *offset += step;
            }
        }
        for (drift, step) in self.drift_ns.iter_mut().zip(drifts) {
            *drift += step;
        }
    }
}

/// A first line for every clock, from users at `pos_m`: for a start the centroids of the drones that heard them.
///
/// That placement is wrong by up to the coverage radius, 100 ns in a TDOA, but to either side: fore and aft it
/// cancels within a pass, left and right over users. Medians in time bins and the median of the slopes between
/// bins (Theil 1950, Sen 1968) are not moved by late captures. A drone that never heard together with the
/// reference is tied to one that did.
pub(super) fn first_lines<const D: usize>(
    problem: &Problem,
    cfg: &LocalizeConfig,
    pos_m: &[[f64; D]],
) -> Vec<(f64, f64)> {
    let n = problem.drones.len();
    let mut lines = vec![(0.0, 0.0); n];
    if cfg.clock == ClockModel::Synchronised {
        return lines;
    }
    let drifting = matches!(cfg.clock, ClockModel::SharedWander { drift_sigma_ns_per_s, .. } if drift_sigma_ns_per_s > 0.0);
    // All differences between drones i < j of one occasion, as (time, ns), by pair.
    let mut differences: Vec<Vec<(f64, f64)>> = vec![Vec::new(); n * n];
    let stride = problem.heard.len() / 20_000 + 1;
    for (user, p) in problem.users.iter().zip(pos_m) {
        for heard in problem.heard[user.span.clone()].iter().step_by(stride) {
            let residual: [f64; MAX_CAPTURES] = std::array::from_fn(|i| {
                let (dx, dy) = (p[0] - heard.east_m[i], p[1] - heard.north_m[i]);
                heard.toa_ns[i] - (dx * dx + dy * dy + heard.up_m[i].powi(2)).sqrt() / C_M_PER_NS
            });
            for b in 1..usize::from(heard.count) {
                for a in 0..b {
                    let pair = usize::from(heard.slot[a]) * n + usize::from(heard.slot[b]);
                    differences[pair].push((heard.time_s, residual[b] - residual[a]));
                }
            }
        }
    }
    let mut solved = vec![false; n];
    solved[0] = true;
    for _ in 1..n {
        // The tie with most occasions between a solved and an unsolved drone; ties go to the lowest ids.
        let mut best: Option<(usize, usize, usize)> = None;
        for a in 0..n {
            for b in a + 1..n {
                let count = differences[a * n + b].len();
                if solved[a] != solved[b] && count > best.map_or(0, |(most, ..)| most) {
                    best = Some((count, a, b));
                }
            }
        }
        let Some((_, a, b)) = best else { break };
        let (offset, drift) = robust_line(&mut differences[a * n + b], problem.time_s, drifting);
        if solved[a] {
            lines[b] = (lines[a].0 + offset, lines[a].1 + drift);
        } else {
            lines[a] = (lines[b].0 - offset, lines[b].1 - drift);
        }
        solved[a] = true;
        solved[b] = true;
    }
    lines
}

/// Offset at the start and rise over the whole of `time_s`.
fn robust_line(points: &mut [(f64, f64)], time_s: [f64; 2], drifting: bool) -> (f64, f64) {
    const MOST_BINS: usize = 64;
    let span_s = time_s[1] - time_s[0];
    let at = |time_s_of_point: f64| if span_s > 0.0 { (time_s_of_point - time_s[0]) / span_s } else { 0.0 };
    points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let bins = if drifting { (points.len() / 5).clamp(1, MOST_BINS) } else { 1 };
    let medians: Vec<(f64, f64)> = points
        .chunks(points.len().div_ceil(bins).max(1))
        .map(|bin| (median(bin.iter().map(|p| at(p.0)).collect()), median(bin.iter().map(|p| p.1).collect())))
        .collect();
    let mut slopes = Vec::new();
    for (i, a) in medians.iter().enumerate() {
        slopes.extend(medians[..i].iter().filter(|b| a.0 > b.0).map(|b| (a.1 - b.1) / (a.0 - b.0)));
    }
    let slope = if drifting { median(slopes) } else { 0.0 };
    (median(medians.iter().map(|(t, value)| value - slope * t).collect()), slope)
}

/// Median; 0 of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
