//! Which frames of a sender are new, and how many were lost.

use crate::header::Header;

/// How far a frame may arrive behind the newest one.
const WINDOW: u32 = u64::BITS;

/// What a receiver should do with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Use it: not seen before.
    Fresh,
    /// Drop it: seen before.
    Duplicate,
    /// Drop it: too far behind the newest frame to know, or from before the sender's last boot.
    Stale,
    /// Use it, and forget what the sender said before: the first frame heard since it booted.
    NewEpoch,
}

impl Verdict {
    /// Whether the frame is to be used.
    #[must_use]
    pub const fn is_accepted(self) -> bool {
        matches!(self, Self::Fresh | Self::NewEpoch)
    }
}

/// What happened on a link so far; every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiverCounters {
    /// Frames accepted.
    pub received: u32,
    /// Frames dropped because they had been seen.
    pub duplicates: u32,
    /// Frames dropped because they were too old.
    pub stale: u32,
    /// Frames accepted after a later one.
    pub reordered: u32,
    /// Numbers skipped within an epoch since its first frame heard, less those that still arrived in
    /// time.
    pub lost: u32,
    /// Boots of the sender heard, the first included.
    pub epochs: u32,
}

/// Remembers the last 64 sequence numbers of one sender on one link.
///
/// Numbers and epochs compare modulo their width (RFC 1982), so that both may wrap.
#[derive(Clone, Debug, Default)]
pub struct Receiver {
    epoch: Option<Epoch>,
    counters: ReceiverCounters,
}

/// The sequence numbers heard since a boot of the sender.
#[derive(Clone, Debug)]
struct Epoch {
    boot_epoch: u16,
    /// Highest number heard.
    newest: u32,
    /// Bit `i`: `newest - i` was heard.
    heard: u64,
    /// Numbers before the first one heard were never counted as lost: how many of the window's
    /// numbers, counted back from `newest`, were.
    known: u32,
}

impl Receiver {
    /// Nothing heard yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            epoch: None,
            counters: ReceiverCounters {
                received: 0,
                duplicates: 0,
                stale: 0,
                reordered: 0,
                lost: 0,
                epochs: 0,
            },
        }
    }

    /// What happened so far.
    #[must_use]
    pub const fn counters(&self) -> &ReceiverCounters {
        &self.counters
    }

    /// Forgets the epoch but not the counts, so that whatever comes next is a new one: for a sender
    /// that was silent for long and may have lost its boot counter.
    pub const fn forget(&mut self) {
        self.epoch = None;
    }

    /// Whether `boot_epoch` is from before the boot of the sender that was heard last.
    #[must_use]
    pub fn is_over(&self, boot_epoch: u16) -> bool {
        self.epoch.as_ref().is_some_and(|known| (boot_epoch.wrapping_sub(known.boot_epoch) as i16) < 0)
    }

    /// Judges a frame by its header and remembers it.
    pub fn accept(&mut self, header: &Header) -> Verdict {
        let is_over = self.is_over(header.boot_epoch);
        let verdict = match &mut self.epoch {
            Some(epoch) if epoch.boot_epoch == header.boot_epoch => {
                epoch.accept(header.sequence, &mut self.counters)
            }
            Some(_) if is_over => Verdict::Stale,
            _ => {
                self.epoch = Some(Epoch {
                    boot_epoch: header.boot_epoch,
                    newest: header.sequence,
                    heard: 1,
                    known: 1,
                });
                Verdict::NewEpoch
            }
        };
        let counters = &mut self.counters;
        match verdict {
            Verdict::Fresh => count(&mut counters.received, 1),
            Verdict::Duplicate => count(&mut counters.duplicates, 1),
            Verdict::Stale => count(&mut counters.stale, 1),
            Verdict::NewEpoch => {
                count(&mut counters.received, 1);
                count(&mut counters.epochs, 1);
            }
        }
        verdict
    }
}

impl Epoch {
    fn accept(&mut self, sequence: u32, counters: &mut ReceiverCounters) -> Verdict {
        let ahead = sequence.wrapping_sub(self.newest);
        if (ahead as i32) > 0 {
            self.newest = sequence;
            self.heard = self.heard.checked_shl(ahead).unwrap_or(0) | 1;
            self.known = self.known.saturating_add(ahead);
            count(&mut counters.lost, ahead - 1);
            return Verdict::Fresh;
        }
        let behind = self.newest.wrapping_sub(sequence);
        if behind >= WINDOW {
            return Verdict::Stale;
        }
        let bit = 1 << behind;
        if self.heard & bit != 0 {
            return Verdict::Duplicate;
        }
        self.heard |= bit;
        count(&mut counters.reordered, 1);
        if behind < self.known {
            counters.lost = counters.lost.saturating_sub(1);
        }
        Verdict::Fresh
    }
}

const fn count(counter: &mut u32, by: u32) {
    *counter = counter.saturating_add(by);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::header::Kind;
    use crate::units::DroneId;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn header(boot_epoch: u16, sequence: u32) -> Header {
        Header { version: 1, kind: Kind::Up, flags: 0, sender: DroneId(1), boot_epoch, sequence, body_len: 1 }
    }

    /// The same rules over the set of everything heard, in numbers that do not wrap.
    #[derive(Default)]
    struct Model {
        heard: BTreeSet<i64>,
        counters: ReceiverCounters,
    }

    impl Model {
        fn accept(&mut self, sequence: i64) -> Verdict {
            let Some(&newest) = self.heard.last() else {
                self.heard.insert(sequence);
                return Verdict::NewEpoch;
            };
            if newest - sequence >= i64::from(WINDOW) {
                Verdict::Stale
            } else if !self.heard.insert(sequence) {
                Verdict::Duplicate
            } else {
                self.counters.reordered += u32::from(sequence < newest);
                Verdict::Fresh
            }
        }

        /// Numbers from the first one heard to the newest, less those heard.
        fn lost(&self, first: i64) -> u32 {
            let newest = self.heard.last().copied().unwrap_or(first);
            (newest - first + 1 - self.heard.range(first..).count() as i64) as u32
        }
    }

    proptest! {
        /// Verdicts and counts agree with the model, also where the numbers wrap.
        #[test]
        fn agrees_with_the_model(
            first in prop_oneof![Just(0), Just(u32::MAX - 20), any::<u32>()],
            steps in vec(prop_oneof![Just(1_i64), -3..6_i64, -80..80_i64], 0..300),
        ) {
            let mut receiver = Receiver::new();
            let mut model = Model::default();
            let mut at = 0_i64;
            for step in core::iter::once(0).chain(steps) {
                at += step;
                let verdict = receiver.accept(&header(7, first.wrapping_add(at as u32)));
                prop_assert_eq!(verdict, model.accept(at));
            }
            let counters = receiver.counters();
            prop_assert_eq!(counters.lost, model.lost(0));
            prop_assert_eq!(counters.reordered, model.counters.reordered);
            prop_assert_eq!(counters.received as usize, model.heard.len());
        }
    }

    #[test]
    fn a_reboot_starts_anew() {
        let mut receiver = Receiver::new();
        assert_eq!(receiver.accept(&header(u16::MAX, 500)), Verdict::NewEpoch);
        assert_eq!(receiver.accept(&header(0, 2)), Verdict::NewEpoch, "boot counts wrap");
        assert_eq!(receiver.accept(&header(u16::MAX, 501)), Verdict::Stale, "from before the boot");
        assert_eq!(receiver.accept(&header(0, 2)), Verdict::Duplicate);
        assert_eq!(receiver.accept(&header(0, 0)), Verdict::Fresh, "late, and never counted as lost");
        assert_eq!(receiver.accept(&header(0, 4)), Verdict::Fresh);
        let expected =
            ReceiverCounters { received: 4, duplicates: 1, stale: 1, reordered: 1, lost: 1, epochs: 2 };
        assert_eq!(*receiver.counters(), expected);
    }

    #[test]
    fn a_lost_boot_counter_can_be_forgiven() {
        let mut receiver = Receiver::new();
        assert_eq!(receiver.accept(&header(9, 500)), Verdict::NewEpoch);
        assert_eq!(receiver.accept(&header(0, 0)), Verdict::Stale);
        receiver.forget();
        assert_eq!(receiver.accept(&header(0, 1)), Verdict::NewEpoch);
    }

    #[test]
    fn a_jump_of_any_size_is_counted() {
        let mut receiver = Receiver::new();
        assert!(receiver.accept(&header(1, 0)).is_accepted());
        assert_eq!(receiver.accept(&header(1, i32::MAX as u32)), Verdict::Fresh);
        assert_eq!(receiver.counters().lost, i32::MAX as u32 - 1);
        assert_eq!(receiver.accept(&header(1, 1)), Verdict::Stale, "lost for good");
        assert_eq!(receiver.counters().lost, i32::MAX as u32 - 1);
    }
}
