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

/// Remembers the last [`WINDOW`] sequence numbers of one sender on one link.
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

    /// Judges a frame by its header and remembers it.
    pub fn accept(&mut self, header: &Header) -> Verdict {
        let verdict = match &mut self.epoch {
            Some(epoch) if epoch.boot_epoch == header.boot_epoch => {
                epoch.accept(header.sequence, &mut self.counters)
            }
            Some(epoch) if (header.boot_epoch.wrapping_sub(epoch.boot_epoch) as i16) < 0 => Verdict::Stale,
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
