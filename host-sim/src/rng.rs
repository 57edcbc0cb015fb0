//! The one source of chance: ChaCha8, keyed by (seed, purpose, index).
//!
//! Every random part of the simulation owns a generator of its own, so that a draw more in one part
//! never moves the draws of another, and results do not depend on the order in which parts run.
//! Independence holds by construction: the triple is written *injectively* into the 256-bit key, no
//! hashing, no mixing, and under different keys ChaCha is a family of independent streams (Bernstein,
//! "ChaCha, a variant of Salsa20", 2008; eight rounds are beyond any statistical test). The 64-bit
//! nonce stays zero here; a part that needs a fresh stream per event (see `world::channel`) counts in it.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// What a stream of chance is for. The numbers are part of the reproducibility contract: they may be
/// added to, never reused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u64)]
pub enum Stream {
    /// Positions of the users.
    Users = 1,
    /// Gusts; index = vehicle.
    Wind = 2,
    /// Navigation errors; index = vehicle.
    Gnss = 3,
    /// Oscillators; index = drone.
    Clock = 4,
    /// Propagation of the SRS, per occasion and drone.
    Channel = 5,
    /// When users truly transmit, per occasion.
    Emission = 6,
    /// Control center to drone; index = drone.
    LinkUp = 7,
    /// Drone to control center; index = drone.
    LinkDown = 8,
    /// Drone to drone; index chosen by the caller, one per ordered pair.
    LinkPeer = 9,
    /// Spread of the batteries; index = drone.
    Battery = 10,
    /// When and where faults strike.
    Faults = 11,
    /// Anything a scenario generator decides.
    Scenario = 12,
    /// Random search and other planners that gamble.
    Search = 13,
    /// Pulses per second of the navigation receivers; index = drone.
    Pps = 14,
    /// Errors of users who are located with an error that is declared, not flown for; index = run of a campaign.
    Declared = 15,
    /// Errors of users who are located as well as a formation can; index = run of a campaign.
    Modelled = 16,
    /// What intervals of means and crossovers are drawn from.
    Bootstrap = 17,
    /// Keys of simulated links; index = drone, 0 for those that the control center makes on the way.
    Keys = 18,
    /// Ways of users on foot; index = user.
    Walk = 19,
}

/// The last quarter of every key: keeps these streams apart from any other use of ChaCha with the seed.
const DOMAIN: [u8; 8] = *b"skyroost";

/// The generator for `purpose` and `index` under `seed`: key = seed | purpose | index | domain, each
/// eight bytes, little endian.
#[must_use]
pub fn stream(seed: u64, purpose: Stream, index: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&(purpose as u64).to_le_bytes());
    key[16..24].copy_from_slice(&index.to_le_bytes());
    key[24..].copy_from_slice(&DOMAIN);
    ChaCha8Rng::from_seed(key)
}

/// Uniform in [0, 1), 53 random bits.
#[inline]
pub fn unit<R: Rng>(rng: &mut R) -> f64 {
    const ULP: f64 = 1.0 / (1_u64 << 53) as f64;
    (rng.next_u64() >> 11) as f64 * ULP
}

/// Uniform in [`low`, `high`).
#[inline]
pub fn uniform<R: Rng>(rng: &mut R, low: f64, high: f64) -> f64 {
    low + (high - low) * unit(rng)
}

/// True with probability `p`; always one draw, never true at 0, always at 1.
#[inline]
pub fn chance<R: Rng>(rng: &mut R, p: f64) -> bool {
    unit(rng) < p
}

/// A draw from N(0, 1), by the ziggurat (Marsaglia and Tsang 2000, as refined by Doornik 2005).
#[inline]
pub fn normal<R: Rng>(rng: &mut R) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;

    /// ChaCha8 block function written from Bernstein's description, as the independent truth.
    fn chacha8_block(key: &[u8; 32], counter: u64, nonce: u64) -> [u32; 16] {
        fn quarter(s: &mut [u32; 16], [a, b, c, d]: [usize; 4]) {
            for (x, y, z, by) in [(a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)] {
                s[x] = s[x].wrapping_add(s[y]);
                s[z] = (s[z] ^ s[x]).rotate_left(by);
            }
        }
        let mut start = [0; 16];
        let words = |bytes: &[u8]| -> Vec<u32> {
            bytes.chunks_exact(4).map(|w| u32::from_le_bytes(w.try_into().unwrap())).collect()
        };
        start[..4].copy_from_slice(&words(b"expand 32-byte k"));
        start[4..12].copy_from_slice(&words(key));
        (start[12], start[13]) = (counter as u32, (counter >> 32) as u32);
        (start[14], start[15]) = (nonce as u32, (nonce >> 32) as u32);
        let mut s = start;
        for _ in 0..4 {
            for column in 0..4 {
                quarter(&mut s, [column, column + 4, column + 8, column + 12]);
            }
            for diagonal in 0..4 {
                let at = |row: usize| 4 * row + (diagonal + row) % 4;
                quarter(&mut s, [at(0), at(1), at(2), at(3)]);
            }
        }
        std::array::from_fn(|i| s[i].wrapping_add(start[i]))
    }

    #[test]
    fn truth_streams_are_chacha8_of_the_documented_key() {
        // The block function itself: test vector TC1 (256-bit key, 8 rounds) of draft-strombergson-chacha.
        assert_eq!(chacha8_block(&[0; 32], 0, 0)[..2], [0x2fef_003e, 0xd640_5f89]);
        for (seed, purpose, index) in [(1, Stream::Users, 0), (u64::MAX, Stream::LinkPeer, 1 << 40)] {
            let mut key = [0; 32];
            for (place, word) in
                key.chunks_mut(8).zip([seed, purpose as u64, index, u64::from_le_bytes(DOMAIN)])
            {
                place.copy_from_slice(&word.to_le_bytes());
            }
            let mut rng = stream(seed, purpose, index);
            for counter in 0..9 {
                let found: [u32; 16] = std::array::from_fn(|_| rng.next_u32());
                assert_eq!(found, chacha8_block(&key, counter, 0));
            }
        }
    }

    #[test]
    fn golden_first_draws() {
        let mut rng = stream(1, Stream::Wind, 2);
        assert_eq!([rng.next_u64(), rng.next_u64()], GOLDEN_WORDS);
        let drawn = [unit(&mut rng), uniform(&mut rng, -1.0, 1.0), normal(&mut rng)];
        assert_eq!(drawn.map(f64::to_bits), GOLDEN_DRAWS.map(f64::to_bits), "{drawn:?}");
    }
    const GOLDEN_WORDS: [u64; 2] = [15573843484606515675, 14463672072801693954];
    const GOLDEN_DRAWS: [f64; 3] = [0.5345967731687913, -0.6952696257164646, 0.008999280279982702];

    #[test]
    fn neighbouring_streams_are_uncorrelated() {
        let n = 100_000;
        let pairs = [
            (stream(1, Stream::Wind, 0), stream(1, Stream::Wind, 1)),
            (stream(1, Stream::Wind, 0), stream(2, Stream::Wind, 0)),
            (stream(1, Stream::Wind, 2), stream(1, Stream::Gnss, 2)),
        ];
        for (mut a, mut b) in pairs {
            let r = (0..n).map(|_| normal(&mut a) * normal(&mut b)).sum::<f64>() / f64::from(n);
            assert!(r.abs() < 4.0 / f64::from(n).sqrt(), "correlation {r}");
        }
    }

    #[test]
    fn truth_normal_moments_and_tails() {
        let mut rng = stream(7, Stream::Scenario, 0);
        let draws: Vec<f64> = (0..1_000_000).map(|_| normal(&mut rng)).collect();
        let (mean, variance) = moments(draws.iter().copied());
        // Four standard errors: 1/sqrt(n) of the mean, sqrt(2/n) of the variance, sqrt(24/n) of kurtosis.
        assert!(mean.abs() < 4e-3, "mean {mean}");
        assert!((variance - 1.0).abs() < 5.7e-3, "variance {variance}");
        let kurtosis = draws.iter().map(|x| x.powi(4)).sum::<f64>() / 1e6;
        assert!((kurtosis - 3.0).abs() < 0.04, "kurtosis {kurtosis}");
        let beyond = |z: f64| draws.iter().filter(|x| x.abs() > z).count() as f64;
        // P(|x| > 2) = 4.5500 %, P(|x| > 4) = 6.334e-5, against binomial deviations.
        assert!((beyond(2.0) - 45_500.0).abs() < 4.0 * 45_500_f64.sqrt());
        assert!((beyond(4.0) - 63.3).abs() < 4.0 * 63.3_f64.sqrt());
    }

    #[test]
    fn chance_keeps_its_ends_and_its_rate() {
        let mut rng = stream(3, Stream::Scenario, 1);
        assert!((0..10_000).all(|_| !chance(&mut rng, 0.0) && chance(&mut rng, 1.0)));
        let hits = (0..100_000).filter(|_| chance(&mut rng, 0.05)).count() as f64;
        assert!((hits - 5000.0).abs() < 4.0 * (100_000.0 * 0.05 * 0.95_f64).sqrt(), "{hits}");
    }
}
