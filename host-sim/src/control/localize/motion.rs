//! How users walk, and how fast what is known of them is lost.

use super::r95::r95;

/// Users on foot: the velocity is a first-order Gauss-Markov process in each coordinate, so that who goes somewhere goes on
/// for about as long as it takes to turn, and nobody gets faster (the Singer model with velocity in place of acceleration;
/// Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, 6.2 and 8.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Root mean square speed over ground, metres a second; 0 for users that stay where they are.
    pub speed_mps: f64,
    /// Time over which a velocity is forgotten, seconds.
    pub turn_s: f64,
}

/// Nothing is known for longer, seconds: a year.
const LONGEST_S: f64 = 3e7;

impl Motion {
    /// Nobody moves.
    pub const STILL: Self = Self { speed_mps: 0.0, turn_s: 60.0 };

    /// Whether nobody moves.
    #[must_use]
    pub fn is_still(&self) -> bool {
        self.speed_mps <= 0.0
    }

    /// Variance of each coordinate of the velocity, (m/s)^2.
    #[must_use]
    pub fn velocity_m2ps2(&self) -> f64 {
        0.5 * self.speed_mps * self.speed_mps
    }

    /// Variance of each coordinate of the way that a user goes in `for_s` seconds, m^2:
    /// `2 s^2 T^2 (x - 1 + exp(-x))` with `x = t / T`, the square of time at first and proportional to it later.
    #[must_use]
    pub fn spread_m2(&self, for_s: f64) -> f64 {
        let x = for_s.max(0.0) / self.turn_s;
        // The difference of nearly equal numbers where little time has passed.
        let shape = if x < 1e-3 { 0.5 * x * x * (1.0 - x / 3.0) } else { x + (-x).exp_m1() };
        2.0 * self.velocity_m2ps2() * self.turn_s * self.turn_s * shape
    }

    /// How long after it was known exactly where a user is its 95 % radius is `r95_m`, seconds; infinite where nobody moves.
    #[must_use]
    pub fn known_for_s(&self, r95_m: f64) -> f64 {
        if self.is_still() {
            return f64::INFINITY;
        }
        // No faster than by the square root of time in the end, no slower than straight on at first.
        let (mut low_s, mut high_s) = (0.0, self.turn_s);
        while self.grown_r95_m(0.0, high_s) < r95_m && high_s < LONGEST_S {
            high_s *= 2.0;
        }
        for _ in 0..60 {
            let middle_s = 0.5 * (low_s + high_s);
            if self.grown_r95_m(0.0, middle_s) < r95_m {
                low_s = middle_s;
            } else {
                high_s = middle_s;
            }
        }
        high_s
    }

    /// The covariance of where a user is, so many seconds after it was `cov_m2`.
    #[must_use]
    pub fn grown(&self, cov_m2: [[f64; 2]; 2], for_s: f64) -> [[f64; 2]; 2] {
        if self.is_still() {
            return cov_m2;
        }
        let spread_m2 = self.spread_m2(for_s);
        let [[xx, xy], [yx, yy]] = cov_m2;
        [[xx + spread_m2, xy], [yx, yy + spread_m2]]
    }

    /// The 95 % radius so many seconds after it was `r95_m`, as if its covariance were round: no less than it is.
    #[must_use]
    pub fn grown_r95_m(&self, r95_m: f64, for_s: f64) -> f64 {
        if self.is_still() {
            return r95_m;
        }
        let spread_m2 = self.spread_m2(for_s);
        r95_m.hypot(r95([[spread_m2, 0.0], [0.0, spread_m2]]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Stream};

    /// Against walks drawn step by step, each velocity from the one before (Gelb 1974, 3.8).
    #[test]
    fn truth_spread_is_that_of_many_walks() {
        const WALKS: u32 = 4_000;
        const DT_S: f64 = 0.25;
        let motion = Motion { speed_mps: 0.8, turn_s: 20.0 };
        let mut rng = rng::stream(3, Stream::Scenario, 1);
        let mut squares_m2 = [0.0; 4];
        let after_s = [1.0, 10.0, 40.0, 160.0];
        let sigma_mps = motion.velocity_m2ps2().sqrt();
        let kept = (-DT_S / motion.turn_s).exp();
        let fresh_mps = sigma_mps * (1.0 - kept * kept).sqrt();
        for _ in 0..WALKS {
            let (mut at_m, mut before) = (0.0, sigma_mps * rng::normal(&mut rng));
            for step in 1..=640 {
                let now = kept * before + fresh_mps * rng::normal(&mut rng);
                at_m += 0.5 * DT_S * (before + now);
                before = now;
                for (sum, after_s) in squares_m2.iter_mut().zip(after_s) {
                    if (f64::from(step) * DT_S - after_s).abs() < 0.5 * DT_S {
                        *sum += at_m * at_m / f64::from(WALKS);
                    }
                }
            }
        }
        for (found_m2, after_s) in squares_m2.into_iter().zip(after_s) {
            // Four deviations of a mean of squares: 4 sqrt(2 / 4000).
            let expected_m2 = motion.spread_m2(after_s);
            assert!(
                (found_m2 / expected_m2 - 1.0).abs() < 0.09,
                "{found_m2} of {expected_m2} at {after_s} s"
            );
        }
    }

    #[test]
    fn spread_begins_with_the_square_of_time_and_is_smooth_where_the_series_ends() {
        let motion = Motion { speed_mps: 1.0, turn_s: 60.0 };
        assert!(motion.spread_m2(0.0) <= 0.0);
        assert!(motion.spread_m2(-5.0) <= 0.0, "nothing is known better for having been heard later");
        assert!((motion.spread_m2(0.01) / (0.5 * 1e-4) - 1.0).abs() < 1e-4);
        let [below, above] = [0.999_999, 1.000_001].map(|x| motion.spread_m2(1e-3 * 60.0 * x));
        assert!((above / below - 1.0).abs() < 5e-6, "{below} {above}");
        assert!(Motion::STILL.spread_m2(1e6) <= 0.0);
        let cov_m2 = [[2.0, 0.5], [0.5, 1.0]];
        assert_eq!(Motion::STILL.grown(cov_m2, 1e6), cov_m2);
        let grown = motion.grown(cov_m2, 600.0);
        assert!(r95(grown) <= motion.grown_r95_m(r95(cov_m2), 600.0));
        for r95_m in [0.1, 30.0, 200.0, 3_000.0] {
            let known_for_s = motion.known_for_s(r95_m);
            assert!((motion.grown_r95_m(0.0, known_for_s) / r95_m - 1.0).abs() < 1e-6, "{r95_m}");
        }
        assert!(Motion::STILL.known_for_s(1.0).is_infinite());
    }
}
