//! One direction of a radio link: frames go in, and come out later, twice, damaged, or never.
//!
//! A frame's fate depends on nothing but the seed and its number: every frame takes the same draws from
//! one stream, whatever the probabilities are, so raising the loss leaves the delays of the surviving frames as
//! they were. Frames wait in a slab of fixed-size slots under a heap of due times; both grow to the
//! most that was ever in flight and then never allocate again.
//!
//! What comes over a link from outside, for a while and to all frames alike, is [`Adversity`]: bursts of loss,
//! partitions, and a rate that no transmitter exceeds.

mod adversity;
mod carried;

pub use carried::Carried;

pub use adversity::{Adversity, AdversityConfig};

use crate::rng::{self, Stream};
use crate::world::{ConfigError, Range, require};
use adversity::Strike;
use rand_chacha::ChaCha8Rng;
use rand_core::Rng;
use serde::{Deserialize, Serialize};
use skyroost_protocol::stream::FRAMING;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Parameters of one direction.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LinkConfig {
    /// Least time from sending to delivery; a runner may look this far ahead.
    pub min_delay_us: u64,
    /// Extra delay, uniform from 0 to this.
    pub jitter_us: u64,
    /// Probability that a frame is lost.
    pub loss: f64,
    /// Probability that a frame arrives twice, each copy with its own jitter.
    pub duplication: f64,
    /// Probability that a frame is held up further.
    pub reordering: f64,
    /// How long then, uniform from 0 to this.
    pub reordering_delay_us: u64,
    /// Probability that one to three bits of a frame are flipped.
    pub corruption: f64,
    /// Most frames in flight; further ones are dropped.
    pub capacity: usize,
}

impl Default for LinkConfig {
    fn default() -> Self {
        Self {
            min_delay_us: 80_000,
            jitter_us: 40_000,
            loss: 0.0,
            duplication: 0.0,
            reordering: 0.0,
            reordering_delay_us: 200_000,
            corruption: 0.0,
            capacity: 4096,
        }
    }
}

impl LinkConfig {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        // An hour of delay is a mistake in the unit, and keeps sums of times far from overflow.
        const MAX_DELAY_US: u64 = 3_600_000_000;
        for (field, delay_us) in [
            ("min_delay_us", self.min_delay_us),
            ("jitter_us", self.jitter_us),
            ("reordering_delay_us", self.reordering_delay_us),
        ] {
            if delay_us > MAX_DELAY_US {
                return Err(ConfigError { field, found: delay_us as f64, expected: "at most an hour" });
            }
        }
        if u32::try_from(self.capacity).is_err() || self.capacity == 0 {
            let found = self.capacity as f64;
            return Err(ConfigError { field: "capacity", found, expected: "from 1 to 2^32 - 1 frames" });
        }
        require("loss", self.loss, Range::Probability)?;
        require("duplication", self.duplication, Range::Probability)?;
        require("reordering", self.reordering, Range::Probability)?;
        require("corruption", self.corruption, Range::Probability)
    }
}

/// What has happened on a link so far. At all times
/// `sent + duplicated = lost + dropped_overflow + delivered + in flight`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounters {
    /// Frames given to the link.
    pub sent: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Frames lost by chance, in bursts and in partitions.
    pub lost: u64,
    /// Second copies made.
    pub duplicated: u64,
    /// Deliveries after a frame that was sent later, whether by jitter or by reordering.
    pub reordered: u64,
    /// Frames with flipped bits put on their way.
    pub corrupted: u64,
    /// Deliveries, copies included.
    pub delivered: u64,
    /// Frames and copies dropped because the link was full.
    pub dropped_overflow: u64,
    /// Of the lost, those of bursts.
    pub lost_in_bursts: u64,
    /// Of the lost, those of partitions.
    pub lost_in_partitions: u64,
}

impl LinkCounters {
    /// Adds another link's counts.
    pub fn add(&mut self, other: &Self) {
        self.sent += other.sent;
        self.bytes += other.bytes;
        self.lost += other.lost;
        self.duplicated += other.duplicated;
        self.reordered += other.reordered;
        self.corrupted += other.corrupted;
        self.delivered += other.delivered;
        self.dropped_overflow += other.dropped_overflow;
        self.lost_in_bursts += other.lost_in_bursts;
        self.lost_in_partitions += other.lost_in_partitions;
    }
}

/// A waiting frame; ordered by due time, then by number, so that ties leave in the order sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Waiting {
    due_us: u64,
    number: u64,
    slot: u32,
}

/// Room for one frame.
#[derive(Clone, Debug)]
struct Slot<const N: usize> {
    length: usize,
    bytes: [u8; N],
}

/// One direction of a link for frames of up to `N` bytes.
#[derive(Clone, Debug)]
pub struct Link<const N: usize> {
    /// When the next frame is due; beyond all times with none. Beside the heap, as nearly every poll ends here.
    next_due_us: u64,
    config: LinkConfig,
    waiting: BinaryHeap<Reverse<Waiting>>,
    slots: Vec<Slot<N>>,
    free: Vec<u32>,
    /// One frame's draws after the other: see [`Fate`].
    fates: ChaCha8Rng,
    /// Which bits are flipped: the only draws whose number varies.
    flips: ChaCha8Rng,
    /// What comes over it from outside; apart, as most links have none.
    adversity: Option<Box<Adversity>>,
    /// One more than the number of the latest frame, in sending order, that was delivered.
    delivered_up_to: u64,
    counters: LinkCounters,
    carried: Carried,
}

/// The chance in one frame's life, always drawn whole.
struct Fate {
    jitter: u32,
    copy_jitter: u32,
    held_up: u32,
    loss: u32,
    duplication: u32,
    reordering: u32,
    corruption: u32,
}

impl Fate {
    fn draw(rng: &mut ChaCha8Rng) -> Self {
        let [a, b, c, d] = std::array::from_fn(|_| rng.next_u64());
        let (low, high) = (|x| x as u32, |x: u64| (x >> 32) as u32);
        Self {
            jitter: low(a),
            copy_jitter: high(a),
            held_up: low(b),
            loss: high(b),
            duplication: low(c),
            reordering: high(c),
            corruption: low(d),
        }
    }
}

/// Whether a draw falls below a probability: never at 0, always at 1.
#[inline]
fn hits(draw: u32, probability: f64) -> bool {
    f64::from(draw) < probability * (1_u64 << 32) as f64
}

/// A draw scaled to 0..=`most`.
fn scaled(draw: u32, most: u64) -> u64 {
    // Delays are at most an hour in microseconds (32 bits), so the product fits.
    (u64::from(draw) * (most + 1)) >> 32
}

impl<const N: usize> Link<N> {
    /// A link of the given direction (`Stream::LinkUp`, `LinkDown` or `LinkPeer`) and index.
    ///
    /// # Panics
    /// On a config that [`LinkConfig::check`] refuses.
    #[must_use]
    pub fn new(config: LinkConfig, seed: u64, direction: Stream, index: u64) -> Self {
        assert!(config.check().is_ok(), "link parameters are checked where they are read");
        let fates = rng::stream(seed, direction, index);
        let mut flips = fates.clone();
        flips.set_stream(1);
        Self {
            next_due_us: u64::MAX,
            config,
            waiting: BinaryHeap::new(),
            slots: Vec::new(),
            free: Vec::new(),
            fates,
            flips,
            adversity: None,
            delivered_up_to: 0,
            counters: LinkCounters::default(),
            carried: Carried::default(),
        }
    }

    /// The same link with what comes over it from outside.
    ///
    /// # Panics
    /// On a config that [`AdversityConfig::check`] refuses.
    #[must_use]
    pub fn with(mut self, adversity: &AdversityConfig) -> Self {
        // A third stream of the link's own: no frame's draws are others for it.
        let mut chance = self.fates.clone();
        chance.set_stream(2);
        self.adversity = Adversity::new(adversity, chance).map(Box::new);
        self
    }

    /// Puts a frame on its way. Times may come in any order; due times count from each frame's own.
    ///
    /// # Panics
    /// On a frame longer than `N`: the sender's buffers are of that size.
    pub fn send(&mut self, now_us: u64, frame: &[u8]) {
        assert!(frame.len() <= N, "a frame of {} bytes on a link for {N}", frame.len());
        let number = self.counters.sent;
        self.counters.sent += 1;
        self.counters.bytes += frame.len() as u64;
        self.carried.add(now_us, frame.len());
        let fate = Fate::draw(&mut self.fates);
        let c = &self.config;
        let mut now_us = now_us;
        if let Some(adversity) = &mut self.adversity {
            match adversity.strike(now_us, frame.len() + FRAMING) {
                Strike::Sent { at_us } => now_us = at_us,
                Strike::Full => {
                    self.counters.dropped_overflow += 1;
                    return;
                }
                Strike::Burst => {
                    self.counters.lost += 1;
                    self.counters.lost_in_bursts += 1;
                    return;
                }
                Strike::Partition => {
                    self.counters.lost += 1;
                    self.counters.lost_in_partitions += 1;
                    return;
                }
            }
        }
        if hits(fate.loss, c.loss) {
            self.counters.lost += 1;
            return;
        }
        let held_up = hits(fate.reordering, c.reordering);
        let is_doubled = hits(fate.duplication, c.duplication);
        let is_corrupted = hits(fate.corruption, c.corruption);
        let earliest_us = now_us + c.min_delay_us;
        let due_us = earliest_us
            + scaled(fate.jitter, c.jitter_us)
            + if held_up { scaled(fate.held_up, c.reordering_delay_us) } else { 0 };
        let copy_due_us = earliest_us + scaled(fate.copy_jitter, c.jitter_us);

        if let Some(slot) = self.store(due_us, number, frame)
            && is_corrupted
        {
            self.flip_bits(slot);
        }
        if is_doubled {
            self.counters.duplicated += 1;
            self.store(copy_due_us, number, frame);
        }
    }

    /// The next frame that is due by `now_us`, oldest due time first. Call until there is none.
    #[inline]
    pub fn poll(&mut self, now_us: u64) -> Option<&[u8]> {
        if self.next_due_us > now_us {
            return None;
        }
        let Reverse(Waiting { number, slot, .. }) = self.waiting.pop()?;
        self.next_due_us = self.waiting.peek().map_or(u64::MAX, |Reverse(next)| next.due_us);
        self.free.push(slot);
        self.counters.delivered += 1;
        if number + 1 < self.delivered_up_to {
            self.counters.reordered += 1;
        }
        self.delivered_up_to = self.delivered_up_to.max(number + 1);
        let Slot { length, bytes } = &self.slots[slot as usize];
        Some(&bytes[..*length])
    }

    /// When the next frame is due.
    #[must_use]
    pub fn next_due_us(&self) -> Option<u64> {
        Some(self.next_due_us).filter(|_| !self.waiting.is_empty())
    }

    /// Frames on their way.
    #[must_use]
    pub fn in_flight(&self) -> usize {
        self.waiting.len()
    }

    /// What has happened so far.
    #[must_use]
    pub fn counters(&self) -> &LinkCounters {
        &self.counters
    }

    /// What it was given to carry.
    #[must_use]
    pub fn carried(&self) -> &Carried {
        &self.carried
    }

    /// The present parameters.
    #[must_use]
    pub fn config(&self) -> &LinkConfig {
        &self.config
    }

    /// Changes the parameters for the frames sent from now on: how a fault campaign makes a link go
    /// bad and well again.
    ///
    /// # Panics
    /// On a config that [`LinkConfig::check`] refuses.
    pub fn set_config(&mut self, config: LinkConfig) {
        assert!(config.check().is_ok(), "link parameters are checked where they are read");
        self.config = config;
    }

    /// Stores a frame until it is due, if there is room.
    fn store(&mut self, due_us: u64, number: u64, frame: &[u8]) -> Option<u32> {
        if self.waiting.len() >= self.config.capacity {
            self.counters.dropped_overflow += 1;
            return None;
        }
        let slot = self.free.pop().unwrap_or_else(|| {
            self.slots.push(Slot { length: 0, bytes: [0; N] });
            (self.slots.len() - 1) as u32 // fits: `capacity` does
        });
        let place = &mut self.slots[slot as usize];
        place.length = frame.len();
        place.bytes[..frame.len()].copy_from_slice(frame);
        self.waiting.push(Reverse(Waiting { due_us, number, slot }));
        self.next_due_us = self.next_due_us.min(due_us);
        Some(slot)
    }

    /// Flips one to three different bits of a stored frame; an empty frame has none.
    fn flip_bits(&mut self, slot: u32) {
        let Slot { length, bytes } = &mut self.slots[slot as usize];
        let bits = (8 * *length) as u64;
        if bits == 0 {
            return;
        }
        self.counters.corrupted += 1;
        let flips = 1 + scaled(self.flips.next_u32(), 2);
        let first = scaled(self.flips.next_u32(), bits - 1);
        // A burst of neighbouring bits, as noise on a demodulator makes it.
        for bit in (first..bits).take(flips as usize) {
            bytes[(bit / 8) as usize] ^= 1 << (bit % 8);
        }
    }
}

#[cfg(test)]
mod tests;
