//! What comes over a link from outside, for a while and to all frames alike.

use crate::rng;
use crate::world::{ConfigError, Range, require};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp1};

/// What comes over one direction of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct AdversityConfig {
    /// Mean time from the end of a burst of loss to the beginning of the next, microseconds; 0 for no bursts.
    pub burst_every_us: f64,
    /// Mean length of a burst, microseconds.
    pub burst_us: f64,
    /// Probability that a frame sent within a burst is lost.
    pub burst_loss: f64,
    /// Bits that leave the transmitter in a second at most; 0 for any number.
    pub bits_per_s: f64,
    /// A frame that would wait for the transmitter for longer is dropped, microseconds.
    pub queue_us: u64,
    /// From when until when nothing that is sent arrives, microseconds; in any order.
    pub partitions_us: Vec<(u64, u64)>,
}

impl Default for AdversityConfig {
    fn default() -> Self {
        Self {
            burst_every_us: 0.0,
            burst_us: 0.0,
            burst_loss: 1.0,
            bits_per_s: 0.0,
            queue_us: 500_000,
            partitions_us: Vec::new(),
        }
    }
}

impl AdversityConfig {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("burst_every_us", self.burst_every_us, Range::NotNegative)?;
        require("burst_us", self.burst_us, Range::NotNegative)?;
        require("burst_loss", self.burst_loss, Range::Probability)?;
        require("bits_per_s", self.bits_per_s, Range::NotNegative)
    }
}

/// What becomes of a frame before chance has its say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Strike {
    /// It leaves the transmitter.
    Sent {
        /// When its last bit does.
        at_us: u64,
    },
    /// It would wait too long for the transmitter.
    Full,
    /// A burst took it.
    Burst,
    /// There is nobody to hear it.
    Partition,
}

/// The state of it.
#[derive(Clone, Debug)]
pub struct Adversity {
    config: AdversityConfig,
    /// Lengths of bursts and of the pauses between, and what becomes of frames within them.
    chance: ChaCha8Rng,
    /// The burst that is, or the next one.
    burst_us: (f64, f64),
    /// When the transmitter has sent all that it was given.
    free_us: u64,
}

impl Adversity {
    /// None where nothing comes over the link.
    ///
    /// # Panics
    /// On a config that [`AdversityConfig::check`] refuses.
    pub(super) fn new(config: &AdversityConfig, chance: ChaCha8Rng) -> Option<Self> {
        assert!(config.check().is_ok(), "link parameters are checked where they are read");
        let idle =
            config.burst_every_us == 0.0 && config.bits_per_s == 0.0 && config.partitions_us.is_empty();
        if idle {
            return None;
        }
        let mut adversity =
            Self { config: config.clone(), chance, burst_us: (f64::INFINITY, f64::INFINITY), free_us: 0 };
        if config.burst_every_us > 0.0 {
            adversity.next_burst(0.0);
        }
        Some(adversity)
    }

    /// What becomes of a frame that is given to the transmitter at `now_us` and takes so many bytes on the air.
    pub(super) fn strike(&mut self, now_us: u64, bytes: usize) -> Strike {
        let mut at_us = now_us;
        if self.config.bits_per_s > 0.0 {
            let begun_us = self.free_us.max(now_us);
            if begun_us - now_us > self.config.queue_us {
                return Strike::Full;
            }
            at_us = begun_us + (8e6 * bytes as f64 / self.config.bits_per_s).ceil() as u64;
            self.free_us = at_us;
        }
        // Whatever is lost on the way has still been sent, and draws its chance.
        let in_burst = self.in_burst(at_us as f64) && rng::unit(&mut self.chance) < self.config.burst_loss;
        if self.config.partitions_us.iter().any(|(from_us, until_us)| (*from_us..*until_us).contains(&at_us))
        {
            Strike::Partition
        } else if in_burst {
            Strike::Burst
        } else {
            Strike::Sent { at_us }
        }
    }

    fn in_burst(&mut self, at_us: f64) -> bool {
        while at_us >= self.burst_us.1 {
            self.next_burst(self.burst_us.1);
        }
        at_us >= self.burst_us.0
    }

    fn next_burst(&mut self, after_us: f64) {
        let mut long = |mean_us: f64| -> f64 {
            let drawn: f64 = Exp1.sample(&mut self.chance);
            mean_us * drawn
        };
        let from_us = after_us + long(self.config.burst_every_us);
        // A burst of no length is over at once; the next microsecond is another time.
        self.burst_us = (from_us, from_us + long(self.config.burst_us).max(1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Stream;
    use crate::world::link::{Link, LinkConfig};

    fn link(adversity: &AdversityConfig) -> Link<32> {
        let config = LinkConfig { jitter_us: 0, capacity: 1_000_000, ..LinkConfig::default() };
        Link::new(config, 7, Stream::LinkUp, 1).with(adversity)
    }

    /// When each of the frames arrives that are sent every `every_us`, in the order sent; none of those that do not.
    fn sent(link: &mut Link<32>, count: u32, every_us: u64) -> Vec<Option<u64>> {
        let mut arrived = vec![None; count as usize];
        for number in 0..count {
            link.send(u64::from(number) * every_us, &number.to_le_bytes());
        }
        while let Some(due_us) = link.next_due_us() {
            let number = u32::from_le_bytes(link.poll(due_us).expect("due").try_into().expect("four bytes"));
            arrived[number as usize] = Some(due_us);
        }
        arrived
    }

    #[test]
    fn truth_bursts_are_as_long_and_as_rare_as_declared() {
        let config = AdversityConfig {
            burst_every_us: 9e6,
            burst_us: 1e6,
            burst_loss: 1.0,
            ..AdversityConfig::default()
        };
        let mut link = link(&config);
        let arrived = sent(&mut link, 1_000_000, 10_000);
        // A tenth of the time, in some thousand bursts of a hundred frames: within four deviations of a mean of so many.
        let lost = arrived.iter().filter(|at| at.is_none()).count() as f64 / 1e6;
        assert!((lost - 0.1).abs() < 4.0 * 0.1 / 1_000_f64.sqrt(), "{lost}");
        let bursts = arrived.windows(2).filter(|pair| pair[0].is_some() && pair[1].is_none()).count() as f64;
        assert!((bursts - 1_000.0).abs() < 4.0 * 1_000_f64.sqrt(), "{bursts}");
        assert_eq!(link.counters().lost_in_bursts, link.counters().lost);
    }

    #[test]
    fn a_partition_takes_what_is_sent_within_it_and_nothing_else() {
        let config = AdversityConfig {
            partitions_us: vec![(500_000, 700_000), (100_000, 200_000)],
            ..AdversityConfig::default()
        };
        let arrived = sent(&mut link(&config), 100, 10_000);
        let lost: Vec<usize> = (0..100).filter(|frame| arrived[*frame].is_none()).collect();
        let expected: Vec<usize> = (10..20).chain(50..70).collect();
        assert_eq!(lost, expected);
    }

    #[test]
    fn a_rate_makes_frames_wait_and_drops_those_that_would_wait_too_long() {
        // Four bytes and seven of framing in 10 ms: as much again as comes.
        let config = AdversityConfig { bits_per_s: 8_800.0, queue_us: 50_000, ..AdversityConfig::default() };
        let mut even = link(&config);
        let arrived = sent(&mut even, 100, 10_000);
        assert!(arrived.iter().zip(0..).all(|(at, number)| *at == Some(10_000 * (number + 1) + 80_000)));
        let mut crowded = link(&config);
        let arrived = sent(&mut crowded, 100, 5_000);
        let waits: Vec<u64> = arrived
            .iter()
            .zip(0..)
            .filter_map(|(at, number)| Some((*at)? - 80_000 - 5_000 * number))
            .collect();
        assert!(waits.iter().all(|wait| *wait <= 60_000));
        let counters = crowded.counters();
        assert_eq!(counters.dropped_overflow + counters.delivered, 100);
        assert!((40..=50).contains(&counters.dropped_overflow), "{counters:?}");
    }

    #[test]
    fn what_comes_from_outside_leaves_the_chances_of_frames_alone() {
        let config = LinkConfig { loss: 0.3, capacity: 100_000, ..LinkConfig::default() };
        let plain = sent(&mut Link::new(config.clone(), 7, Stream::LinkUp, 1), 5_000, 10_000);
        let struck = AdversityConfig { burst_every_us: 1e6, burst_us: 1e5, ..AdversityConfig::default() };
        let struck = sent(&mut Link::new(config, 7, Stream::LinkUp, 1).with(&struck), 5_000, 10_000);
        assert!(struck.iter().zip(&plain).all(|(with, without)| with.is_none() || with == without));
        assert_ne!(struck, plain);
    }

    #[test]
    fn a_link_that_nothing_comes_over_keeps_no_state_for_it() {
        let chance = rng::stream(1, Stream::LinkUp, 1);
        assert!(Adversity::new(&AdversityConfig::default(), chance).is_none());
        let bad = AdversityConfig { burst_loss: 1.5, ..AdversityConfig::default() };
        assert_eq!(bad.check().unwrap_err().field, "burst_loss");
    }
}
