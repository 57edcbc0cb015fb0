//! First-order Gauss-Markov process, the workhorse for gusts and slow navigation errors.
//!
//! dx = -(x / tau) dt + sigma sqrt(2 / tau) dW has the autocorrelation sigma^2 exp(-|t| / tau). Sampled
//! every `dt` it is *exactly* x' = phi x + sigma sqrt(1 - phi^2) n with phi = exp(-dt / tau) and n from
//! N(0, 1) (Gelb, *Applied Optimal Estimation*, 1974, 3.8), so its statistics do not depend on `dt`.

use crate::geometry::V3;
use crate::rng;
use rand_core::Rng;

/// Three independent axes with one correlation time, started in the stationary distribution.
#[derive(Clone, Debug)]
pub struct GaussMarkov3 {
    state: V3,
    decay: f64,
    innovation: V3,
}

impl GaussMarkov3 {
    /// Standard deviations per axis, correlation time and sampling period.
    pub fn new<R: Rng>(sigma: V3, tau_s: f64, dt_s: f64, rng: &mut R) -> Self {
        let decay = (-dt_s / tau_s).exp();
        // 1 - phi^2 without cancellation where dt is small against tau.
        let innovation = sigma * (-(-2.0 * dt_s / tau_s).exp_m1()).sqrt();
        Self { state: sigma.component_mul(&normal3(rng)), decay, innovation }
    }

    /// The present value.
    #[must_use]
    pub fn value(&self) -> V3 {
        self.state
    }

    /// One sampling period on; returns the new value.
    pub fn advance<R: Rng>(&mut self, rng: &mut R) -> V3 {
        self.state = self.state * self.decay + self.innovation.component_mul(&normal3(rng));
        self.state
    }
}

/// Three draws from N(0, 1).
#[inline]
pub(super) fn normal3<R: Rng>(rng: &mut R) -> V3 {
    V3::new(rng::normal(rng), rng::normal(rng), rng::normal(rng))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Stream;
    use crate::world::moments;

    #[test]
    fn truth_variance_and_correlation_do_not_depend_on_the_sampling() {
        let sigma = V3::new(1.0, 2.0, 0.5);
        for dt_s in [0.02, 0.1, 1.0] {
            let mut rng = rng::stream(1, Stream::Scenario, 2);
            let lag = (4.0 / dt_s) as usize;
            let mut process = GaussMarkov3::new(sigma, 4.0, dt_s, &mut rng);
            let samples: Vec<V3> =
                (0..(80_000.0 / dt_s) as usize).map(|_| process.advance(&mut rng)).collect();
            for axis in 0..3 {
                let (mean, variance) = moments(samples.iter().map(|x| x[axis]));
                let expected = sigma[axis].powi(2);
                // 80,000 s hold about 10,000 independent samples (2 tau apart): 1 % of sigma, 2 % of variance.
                assert!(mean.abs() < 0.04 * sigma[axis], "mean {mean}");
                assert!((variance / expected - 1.0).abs() < 0.06, "variance {variance} of {expected}");
                let products = samples.iter().zip(&samples[lag..]).map(|(a, b)| a[axis] * b[axis]);
                let correlation = products.sum::<f64>() / (samples.len() - lag) as f64 / expected;
                assert!((correlation - (-1.0_f64).exp()).abs() < 0.05, "at one tau {correlation}");
            }
        }
    }
}
