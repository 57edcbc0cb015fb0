//! One occasion linearised at a position: its emission time, estimated robustly, and the weights of its captures.

use super::model::{C_M_PER_NS, MAX_CAPTURES, Robust};
use super::problem::Heard;
use super::small::dot;

/// What light takes for a metre.
const NS_PER_M: f64 = 1.0 / C_M_PER_NS;

/// How residuals turn into cost and weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loss {
    /// Inverse square of the factor by which the noise is taken larger than it is.
    inverse_scale2: f64,
    scale2: f64,
    /// Square of the cut-off in standard deviations, and its inverse; infinite and 0 for least squares.
    cutoff2: f64,
    inverse_cutoff2: f64,
    /// Whether captures inside the cut-off count fully.
    hard: bool,
}

impl Loss {
    /// The configured loss with the noise `scale` times as large.
    pub(super) fn new(robust: Robust, scale: f64) -> Self {
        let cutoff2 = match robust {
            Robust::Tukey { c } => c * c,
            Robust::None => f64::INFINITY,
        };
        let scale2 = scale * scale;
        Self { inverse_scale2: 1.0 / scale2, scale2, cutoff2, inverse_cutoff2: cutoff2.recip(), hard: false }
    }

    /// Every capture inside the cut-off at full weight: the information in the captures believed. The biweight's
    /// own weights average 0.94 on clean captures and would call every covariance 6 % too large.
    pub(super) fn accepting(robust: Robust) -> Self {
        Self { hard: true, ..Self::new(robust, 1.0) }
    }

    /// Tukey's biweight (Beaton & Tukey 1974) of a squared normalised residual.
    #[inline]
    fn weight(&self, z2: f64) -> f64 {
        let left = larger(1.0 - z2 * self.inverse_cutoff2, 0.0);
        if self.hard { f64::from(u8::from(left > 0.0)) } else { left * left }
    }

    /// Whether this is least squares: weights do not depend on residuals.
    #[inline]
    fn is_plain(&self) -> bool {
        self.inverse_cutoff2 == 0.0
    }

    /// Its cost: half the squared residual near zero, a sixth of the squared cut-off far away.
    #[inline]
    fn cost(&self, z2: f64) -> f64 {
        if self.is_plain() {
            return 0.5 * z2;
        }
        let z2 = smaller(z2, self.cutoff2);
        let t = z2 * self.inverse_cutoff2;
        // c^2/6 (1 - (1-t)^3)
        0.5 * z2 * (1.0 - t + t * t / 3.0)
    }
}

/// One occasion at one position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row<const D: usize> {
    /// Weight of every capture, 1/ns^2.
    pub(super) weight: [f64; MAX_CAPTURES],
    /// Their sum; 0 where the occasion says nothing.
    pub(super) total: f64,
    /// Its inverse, or 0.
    pub(super) inverse_total: f64,
    /// Residual after subtraction of the emission time, in nanoseconds.
    pub(super) deviation_ns: [f64; MAX_CAPTURES],
    /// Derivatives of the delay by the user's coordinates, ns/m.
    pub(super) slope: [[f64; D]; MAX_CAPTURES],
    /// Robust cost, in half squared standard deviations.
    pub(super) cost: f64,
}

/// Linearises `toa = emission + |p - d| / c + clock + noise` (paper section 2; Foy 1976, Torrieri 1984) at
/// `pos_m` (east, north and, with three unknowns, up from the altitude assumed), with the emission time estimated
/// from the occasion itself.
///
/// Eliminating the emission time t turns the weights W into `W - W 1 1' W / (1' W 1)`, which is what the
/// covariance of differences against a common reference amounts to, without choosing a reference. t starts at
/// the median, which one late capture of three cannot move, and is refined by two reweightings.
#[inline(always)]
pub(super) fn linearise<const D: usize>(
    heard: &Heard,
    pos_m: [f64; D],
    clock_ns: [f64; MAX_CAPTURES],
    loss: &Loss,
) -> Row<D> {
    let mut residual = [0.0; MAX_CAPTURES];
    let mut slope = [[0.0; D]; MAX_CAPTURES];
    let up_m = if D == 3 { pos_m[2] } else { 0.0 };
    for i in 0..MAX_CAPTURES {
        let way_m = [pos_m[0] - heard.east_m[i], pos_m[1] - heard.north_m[i], up_m - heard.up_m[i]];
        // A millimetre floor keeps the direction finite for a user at a drone.
        let distance_m = larger(dot(way_m, way_m).sqrt(), 1e-3);
        residual[i] = heard.toa_ns[i] - distance_m * NS_PER_M - clock_ns[i];
        let per_metre = NS_PER_M / distance_m;
        slope[i] = std::array::from_fn(|k| way_m[k] * per_metre);
    }
    let info = heard.info;
    let mut weight = info;
    let mut total = info[0] + info[1] + info[2];
    let mut inverse_total = 1.0 / total;
    let mut emission_ns;
    if loss.is_plain() {
        emission_ns = dot(weight, residual) * inverse_total;
    } else {
        let [a, b, c] = residual;
        emission_ns =
            if heard.count == 3 { larger(smaller(a, b), smaller(larger(a, b), c)) } else { 0.5 * (a + b) };
        for _ in 0..2 {
            for i in 0..MAX_CAPTURES {
                let d = residual[i] - emission_ns;
                weight[i] = info[i] * loss.weight(d * d * info[i] * loss.inverse_scale2);
            }
            total = weight[0] + weight[1] + weight[2];
            if total <= 0.0 {
                inverse_total = 0.0;
                break;
            }
            inverse_total = 1.0 / total;
            emission_ns = dot(weight, residual) * inverse_total;
        }
    }
    let deviation_ns = residual.map(|r| r - emission_ns);
    let mut cost = 0.0;
    for i in 0..MAX_CAPTURES {
        cost += loss.cost(deviation_ns[i] * deviation_ns[i] * info[i] * loss.inverse_scale2);
        weight[i] *= loss.inverse_scale2;
    }
    total *= loss.inverse_scale2;
    inverse_total *= loss.scale2;
    Row { weight, total, inverse_total, deviation_ns, slope, cost }
}

/// The larger of two numbers, for numbers that are some: one instruction, where `f64::max` looks for NaN too.
#[inline]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The smaller of two numbers, likewise.
#[inline]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(count: u8, toa_ns: [f64; 3]) -> Heard {
        Heard {
            time_s: 0.0,
            count,
            slot: [0, 1, 2],
            east_m: [0.0; 3],
            north_m: [0.0; 3],
            up_m: [300.0; 3],
            toa_ns,
            info: if count == 3 { [0.04; 3] } else { [0.04, 0.04, 0.0] },
        }
    }

    #[test]
    fn one_late_capture_of_three_counts_nothing() {
        let loss = Loss::new(Robust::Tukey { c: 6.0 }, 1.0);
        for late in 0..3 {
            let mut toa_ns = [0.0, 3.0, -2.0];
            toa_ns[late] += 150.0;
            let row = linearise(&heard(3, toa_ns), [0.0; 2], [0.0; 3], &loss);
            for i in 0..3 {
                assert_eq!(row.weight[i] > 0.0, i != late);
            }
        }
    }

    #[test]
    fn of_two_contradicting_captures_neither_counts() {
        let loss = Loss::new(Robust::Tukey { c: 6.0 }, 1.0);
        let row = linearise(&heard(2, [0.0, 100.0, 0.0]), [0.0; 2], [0.0; 3], &loss);
        assert!(row.total <= 0.0 && row.cost.is_finite());
    }

    #[test]
    fn weighted_deviations_sum_to_zero() {
        for robust in [Robust::None, Robust::Tukey { c: 6.0 }] {
            let row = linearise(
                &heard(3, [0.0, 7.0, -9.0]),
                [40.0, 90.0],
                [1.0, 2.0, -3.0],
                &Loss::new(robust, 1.0),
            );
            let sum: f64 = (0..3).map(|i| row.weight[i] * row.deviation_ns[i]).sum();
            assert!(sum.abs() < 1e-12, "{sum}");
        }
    }
}
