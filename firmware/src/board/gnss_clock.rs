//! GNSS time of a board: its free-running timer, disciplined by the pulse per second.
//!
//! The receiver's pulse says when a second began, its navigation message says which. A [`line`] through
//! the pulses ([`Line`]) turns ticks into seconds and their parts, a vote ([`SecondLabel`]) numbers them.
//! Everything is integers: times in picoseconds, ticks with eight bits of fraction.
//!
//! [`line`]: super::pulse_line

use super::pulse_line::{Line, Oscillator};
use super::second_label::SecondLabel;
use crate::counters::Counters;
use skyroost_protocol::units::TimePs;

/// Pulses in a row that make a line worth believing.
const LOCK_EDGES: u8 = 4;
/// Pulses in a row, all refused by the line in use, that make another line replace it.
const RIVAL_EDGES: u8 = 8;

/// What the pulses were worth. Every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ClockCounters {
    /// Edges that joined the line in use.
    pub accepted: u32,
    /// Edges off that line: spurious, or more jitter than the receiver should have.
    pub rejected: u32,
    /// Seconds without an edge on the line.
    pub missed: u32,
    /// Times that the line was given up for another, which the edges agreed on.
    pub replaced: u32,
    /// Labels that disagreed with the second counted so far.
    pub labels_rejected: u32,
    /// Times that the count of seconds was set, the first included.
    pub labels_set: u32,
}

/// A time and how wrong it may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// GNSS time since the mission's epoch.
    pub time: TimePs,
    /// Bound of its error, nanoseconds: what the receiver and the oscillator are stated to do wrong at worst
    /// ([`Oscillator`]), grown over the time since the last pulse. Saturates.
    pub uncertainty_ns: u32,
}

/// Turns ticks of a free-running timer into GNSS time.
///
/// The clock has a time once four pulses lie on a line and three messages agree on the number of their
/// seconds. Without pulses it holds over for [`MAX_GAP_S`](super::pulse_line::MAX_GAP_S), ever less
/// certain, and then says that it does not know.
#[derive(Clone, Debug)]
pub struct GnssClock {
    oscillator: Oscillator,
    line: Option<Line>,
    /// A line through edges that `line` refused.
    rival: Option<Line>,
    locked: bool,
    label: SecondLabel,
    counters: ClockCounters,
}

impl GnssClock {
    /// A clock that has seen no pulse.
    #[must_use]
    pub const fn new(oscillator: Oscillator) -> Self {
        Self {
            oscillator,
            line: None,
            rival: None,
            locked: false,
            label: SecondLabel::new(),
            counters: ClockCounters {
                accepted: 0,
                rejected: 0,
                missed: 0,
                replaced: 0,
                labels_rejected: 0,
                labels_set: 0,
            },
        }
    }

    /// What the pulses were worth so far.
    #[must_use]
    pub const fn counters(&self) -> &ClockCounters {
        &self.counters
    }

    /// An edge of the pulse, captured at `ticks`. Edges come in their order.
    pub fn edge(&mut self, ticks: i64) {
        if let Some(line) = &mut self.line
            && let Some(seconds) = line.join(ticks, &self.oscillator)
        {
            self.locked |= line.edges() >= LOCK_EDGES;
            self.rival = None;
            Counters::count(&mut self.counters.accepted);
            self.counters.missed = self.counters.missed.saturating_add(seconds - 1);
            return;
        }
        let fresh = Line::through(ticks, &self.oscillator);
        // A first edge that nothing has joined was no pulse.
        let hopeless = !self.locked && self.line.as_ref().is_none_or(|line| line.seconds_since(ticks) > 2);
        if hopeless {
            self.line = Some(fresh);
            return;
        }
        Counters::count(&mut self.counters.rejected);
        let Some(rival) = &mut self.rival else {
            self.rival = Some(fresh);
            return;
        };
        if rival.join(ticks, &self.oscillator).is_none() {
            *rival = fresh;
        } else if rival.edges() >= if self.locked { RIVAL_EDGES } else { LOCK_EDGES } {
            self.replace_line();
        }
    }

    /// The rival takes the line's place, and with it the number of the second.
    fn replace_line(&mut self) {
        let Some(mut rival) = self.rival.take() else { return };
        match self.line.as_ref().and_then(|line| line.nearest_second(&rival)) {
            Some(second) => rival.renumber(second),
            None => self.label = SecondLabel::new(),
        }
        self.line = Some(rival);
        self.locked = true;
        Counters::count(&mut self.counters.replaced);
    }

    /// The receiver says that the last second before `ticks`, the timer's present value, was number
    /// `second` since the mission's epoch.
    ///
    /// A label that comes too late, after the next pulse, names the wrong one; so only several in
    /// agreement count, many of them against a count that stands.
    pub fn label(&mut self, second: i64, ticks: i64) {
        let Some(counted) = self.line.as_ref().filter(|_| self.locked).and_then(|line| line.second_at(ticks))
        else {
            return;
        };
        if self.label.vote(second.saturating_sub(counted)) {
            Counters::count(&mut self.counters.labels_set);
        } else if self.label.offset_s().is_some_and(|offset| counted.saturating_add(offset) != second) {
            Counters::count(&mut self.counters.labels_rejected);
        }
    }

    /// GNSS time when the timer read `ticks`; none as long as it is not known.
    #[must_use]
    pub fn time_at(&self, ticks: i64) -> Option<Reading> {
        let (line, offset_s) = self.known()?;
        let since = line.time_since_epoch(ticks)?;
        let time = TimePs(offset_s.checked_mul(PS_PER_S)?.checked_add(since.0)?);
        Some(Reading { time, uncertainty_ns: line.uncertainty_ns(ticks, &self.oscillator) })
    }

    /// What the timer reads at a GNSS time, rounded to the nearest tick; none as long as it is not known.
    #[must_use]
    pub fn ticks_at(&self, time: TimePs) -> Option<i64> {
        let (line, offset_s) = self.known()?;
        line.ticks_at(TimePs(time.0.checked_sub(offset_s.checked_mul(PS_PER_S)?)?))
    }

    fn known(&self) -> Option<(&Line, i64)> {
        Some((self.line.as_ref().filter(|_| self.locked)?, self.label.offset_s()?))
    }
}

/// Picoseconds in a second.
pub(super) const PS_PER_S: i64 = 1_000_000_000_000;
