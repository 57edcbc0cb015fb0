//! Users on foot: where everybody is, second by second.

use super::gauss_markov::GaussMarkov3;
use crate::{
    geometry::{V2, V3},
    rng::{self, Stream},
};
use rand_chacha::ChaCha8Rng;

/// Time between two draws of everybody's velocity, seconds; in between all go straight on.
pub const STRIDE_S: f64 = 1.0;

/// People who walk about: each coordinate of the velocity is a first-order Gauss-Markov process of its own.
#[derive(Clone, Debug)]
pub struct Walkers {
    walkers: Vec<Walker>,
    pos_m: Vec<V2>,
    /// Where each goes in the stride that begins.
    stride_m: Vec<V2>,
}

#[derive(Clone, Debug)]
struct Walker {
    velocity: GaussMarkov3,
    chance: ChaCha8Rng,
}

impl Walkers {
    /// Begins at `pos_m`, with a root mean square speed of `speed_mps` metres a second over ground that is forgotten in `turn_s` seconds.
    #[must_use]
    pub fn new(pos_m: Vec<V2>, speed_mps: f64, turn_s: f64, seed: u64) -> Self {
        let sigma_mps = speed_mps / 2f64.sqrt();
        let walker = |index: usize| {
            let mut chance = rng::stream(seed, Stream::Walk, index as u64);
            let sigma = V3::new(sigma_mps, sigma_mps, 0.0);
            Walker { velocity: GaussMarkov3::new(sigma, turn_s, STRIDE_S, &mut chance), chance }
        };
        let walkers = (0..pos_m.len()).map(walker).collect();
        let mut walkers = Self { walkers, stride_m: Vec::new(), pos_m };
        walkers.set_out();
        walkers
    }

    /// Where everybody is.
    #[must_use]
    pub fn pos_m(&self) -> &[V2] {
        &self.pos_m
    }

    /// Where everybody goes from there within [`STRIDE_S`].
    #[must_use]
    pub fn stride_m(&self) -> &[V2] {
        &self.stride_m
    }

    /// One stride on.
    pub fn advance(&mut self) {
        self.pos_m.iter_mut().zip(&self.stride_m).for_each(|(at, stride)| *at += stride);
        self.set_out();
    }

    /// The next stride, by the trapezoidal rule.
    fn set_out(&mut self) {
        let stride = |walker: &mut Walker| {
            let before = walker.velocity.value();
            let after = walker.velocity.advance(&mut walker.chance);
            0.5 * STRIDE_S * (before + after).xy()
        };
        self.stride_m = self.walkers.iter_mut().map(stride).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;

    #[test]
    fn truth_speeds_and_ways_are_those_asked_for() {
        let (speed_mps, turn_s, after_s) = (0.7, 30.0, 300.0);
        let mut walkers = Walkers::new(vec![V2::zeros(); 4_000], speed_mps, turn_s, 5);
        let squared = walkers.stride_m().iter().map(nalgebra::Matrix::norm_squared);
        let (mean, _) = moments(squared.collect::<Vec<_>>().into_iter());
        assert!((mean.sqrt() / speed_mps - 1.0).abs() < 0.04, "{}", mean.sqrt());
        (0..after_s as usize).for_each(|_| walkers.advance());
        // 2 s^2 T^2 (x - 1 + exp(-x)) with x = 10 and s^2 = 0.7^2 / 2, four deviations of a variance of 4,000.
        let expected_m2 = speed_mps * speed_mps * turn_s * turn_s * (10.0 - 1.0 + (-10.0f64).exp());
        for axis in 0..2 {
            let (mean, variance) = moments(walkers.pos_m().iter().map(|at| at[axis]));
            assert!(mean.abs() < 4.0 * (expected_m2 / 4_000.0).sqrt(), "{mean}");
            assert!((variance / expected_m2 - 1.0).abs() < 0.09, "{variance} of {expected_m2}");
        }
    }

    #[test]
    fn nobody_walks_as_others_do_and_all_walk_alike_again() {
        let walk = |count: usize| {
            let mut walkers = Walkers::new(vec![V2::zeros(); count], 1.0, 60.0, 9);
            (0..50).for_each(|_| walkers.advance());
            walkers.pos_m().to_vec()
        };
        assert_eq!(walk(3), walk(5)[..3]);
        assert_ne!(walk(2)[0], walk(2)[1]);
    }
}
