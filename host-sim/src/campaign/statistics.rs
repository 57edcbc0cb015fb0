//! What a campaign's rows say: means with their 95 % intervals, and where one curve falls below another.

use rand_core::Rng;

use crate::rng;

/// Resamples that an interval of a crossover is taken from.
const RESAMPLES: usize = 2000;
/// Two-sided confidence of all intervals.
const CONFIDENCE: f64 = 0.95;

/// A mean and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// The true mean is within this of it with 95 %, by Student's t; infinite for a single value.
    pub half_width: f64,
    /// Values.
    pub count: usize,
}

impl Estimate {
    /// Of independent values; none without any.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len();
        if count == 0 {
            return None;
        }
        let mean = mean(values);
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let half_width = if count > 1 {
            let deviation = (squares / (count - 1) as f64 / count as f64).sqrt();
            student_t(count - 1) * deviation
        } else {
            f64::INFINITY
        };
        Some(Self { mean, half_width, count })
    }

    /// Ends of the interval.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        [self.mean - self.half_width, self.mean + self.half_width]
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Where a difference falls from above zero to zero or below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossover {
    /// Abscissa, linearly between the two means around zero.
    pub at: f64,
    /// 95 % interval of it, by the bootstrap (percentiles); infinite above where it may lie beyond the last abscissa.
    pub interval: [f64; 2],
}

/// The first crossover of some differences by abscissa (ascending, each with independent values); none where the means do
/// not fall below zero. `rng` draws the resamples.
#[must_use]
pub fn crossover(differences: &[(f64, Vec<f64>)], rng: &mut impl Rng) -> Option<Crossover> {
    let at = first_fall(differences.iter().map(|(x, values)| (*x, mean(values))))?;
    let mut resampled: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let drawn = differences.iter().map(|(x, values)| {
                let count = values.len();
                let sum: f64 = (0..count).map(|_| values[(rng::unit(rng) * count as f64) as usize]).sum();
                (*x, sum / count as f64)
            });
            // Collected first: every resample takes the same number of draws, wherever it falls.
            let drawn: Vec<(f64, f64)> = drawn.collect();
            first_fall(drawn.into_iter()).unwrap_or(f64::INFINITY)
        })
        .collect();
    resampled.sort_by(f64::total_cmp);
    let quantile = |share: f64| resampled[((RESAMPLES - 1) as f64 * share).round() as usize];
    let outside = 0.5 * (1.0 - CONFIDENCE);
    Some(Crossover { at, interval: [quantile(outside), quantile(1.0 - outside)] })
}

/// Where a polyline first falls from above zero to zero.
fn first_fall(points: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let mut above: Option<(f64, f64)> = None;
    for (x, y) in points {
        match above {
            Some((from_x, from_y)) if y <= 0.0 => return Some(from_x + (x - from_x) * from_y / (from_y - y)),
            _ => above = (y > 0.0).then_some((x, y)),
        }
    }
    None
}

/// Quantile of Student's distribution with so many degrees of freedom: two-sided 95 %.
fn student_t(freedom: usize) -> f64 {
    /// Two-sided 95 % of the normal distribution.
    const Z: f64 = 1.959_963_984_540_054;
    if freedom > 1000 {
        // Cornish and Fisher's first term; the next is below 1e-5 here.
        return Z + (Z.powi(3) + Z) / (4.0 * freedom as f64);
    }
    let (mut low, mut high) = (0.0, 20.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if within(middle, freedom) < CONFIDENCE { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that |t| stays below `t`: Abramowitz and Stegun 26.7.3 and 26.7.4, exact for whole degrees of freedom.
fn within(t: f64, freedom: usize) -> f64 {
    let angle = (t / (freedom as f64).sqrt()).atan();
    let (sin, cos) = angle.sin_cos();
    let is_odd = freedom % 2 == 1;
    // 1 + 1/2 cos^2 + 1*3/(2*4) cos^4 + ... for even, cos + 2/3 cos^3 + 2*4/(3*5) cos^5 + ... for odd numbers.
    let mut term = if is_odd { cos } else { 1.0 };
    let mut sum = 0.0;
    let mut order = if is_odd { 1 } else { 0 };
    while order + 2 <= freedom {
        sum += term;
        order += 2;
        term *= cos * cos * (order - 1) as f64 / order as f64;
    }
    if is_odd { (angle + sin * sum) * std::f64::consts::FRAC_2_PI } else { sin * sum }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use proptest::prelude::*;

    #[test]
    fn truth_student_quantiles() {
        // Tables, e.g. NIST/SEMATECH e-Handbook 1.3.6.7.2.
        for (freedom, expected) in [
            (1, 12.706),
            (2, 4.303),
            (3, 3.182),
            (4, 2.776),
            (9, 2.262),
            (10, 2.228),
            (29, 2.045),
            (99, 1.984),
        ] {
            assert!((student_t(freedom) - expected).abs() < 6e-4, "{freedom}: {}", student_t(freedom));
        }
        assert!((student_t(1000) - student_t(1001)).abs() < 1e-4);
    }

    /// The interval holds the true mean in 95 % of the samples, small ones as well.
    #[test]
    fn truth_intervals_hold_the_mean() {
        let mut rng = stream(1, Stream::Bootstrap, 0);
        for count in [3, 12] {
            let holds = |_| {
                let values: Vec<f64> = (0..count).map(|_| 7.0 + 2.0 * rng::normal(&mut rng)).collect();
                let [low, high] = Estimate::of(&values).unwrap().interval();
                low <= 7.0 && 7.0 <= high
            };
            let share = (0..20_000).map(holds).filter(|holds| *holds).count() as f64 / 20_000.0;
            assert!((share - 0.95).abs() < 0.007, "{count}: {share}");
        }
    }

    #[test]
    fn few_values() {
        assert_eq!(Estimate::of(&[]), None);
        assert_eq!(Estimate::of(&[3.0]), Some(Estimate { mean: 3.0, half_width: f64::INFINITY, count: 1 }));
        assert_eq!(Estimate::of(&[3.0, 3.0]), Some(Estimate { mean: 3.0, half_width: 0.0, count: 2 }));
    }

    #[test]
    fn a_crossover_is_where_the_line_falls_through_zero() {
        let at = |y: &[f64]| first_fall((0..).map(f64::from).zip(y.iter().copied()));
        assert_eq!(at(&[3.0, 1.0, -1.0, -2.0]), Some(1.5));
        assert_eq!(at(&[-1.0, 1.0, 2.0]), None);
        assert_eq!(at(&[-1.0, 1.0, 0.0]), Some(2.0));
        assert_eq!(at(&[]), None);
    }

    /// Of a line with noise, whose crossover is known: the interval holds it about as often as it says.
    #[test]
    fn truth_the_interval_holds_the_crossover() {
        let mut noise = stream(2, Stream::Bootstrap, 0);
        let mut held = 0;
        for trial in 0..200 {
            let differences: Vec<(f64, Vec<f64>)> = [300.0, 400.0, 500.0, 600.0]
                .map(|x| (x, (0..40).map(|_| 0.3 * (443.0 - x) + 30.0 * rng::normal(&mut noise)).collect()))
                .to_vec();
            let found = crossover(&differences, &mut stream(3, Stream::Bootstrap, trial)).unwrap();
            assert!(found.interval[0] <= found.at && found.at <= found.interval[1]);
            held += i32::from(found.interval[0] <= 443.0 && 443.0 <= found.interval[1]);
        }
        assert!((180..=199).contains(&held), "{held}");
    }

    #[test]
    fn a_crossover_near_the_end_may_lie_beyond() {
        let values = |mean: f64| (0..20).map(|k| mean + f64::from(k % 5) - 2.0).collect::<Vec<f64>>();
        let differences = [(1.0, values(5.0)), (2.0, values(-0.1))];
        let found = crossover(&differences, &mut stream(1, Stream::Bootstrap, 0)).unwrap();
        assert!(found.at < 2.0 && found.interval[1].is_infinite(), "{found:?}");
    }

    proptest! {
        #[test]
        fn a_mean_lies_within_its_values(values in prop::collection::vec(-1e6..1e6_f64, 1..30)) {
            let found = Estimate::of(&values).unwrap();
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            prop_assert!(found.mean >= least - 1e-6 && found.mean <= most + 1e-6 && found.half_width >= 0.0);
        }
    }
}
