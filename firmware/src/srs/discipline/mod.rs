//! GNSS time of a free-running timer, disciplined by the pulse per second.
//!
//! The receiver's pulse says when a second began, its navigation message says which. A line through the
//! pulses (`Line`) turns the timer's nominal time into seconds and their parts, a vote (`SecondLabel`)
//! numbers them. The capture timer of the flight code and the timer that a board steps by are disciplined by
//! the same code.

mod label;
mod line;

pub use line::{MAX_GAP_S, Oscillator};

use crate::counters::Counters;
use label::SecondLabel;
use line::{Line, PS_PER_S};
use skyroost_protocol::{message::ClockState, units::TimePs};

/// Pulses in a row that make a line worth believing.
const LOCK_PULSES: u8 = 4;
/// Pulses in a row, all refused by the line in use, that make another line replace it.
const RIVAL_PULSES: u8 = 8;
/// Without a pulse for this long, a clock is held over.
const HELD_AFTER_S: i64 = 2;
/// What is called the bound of an error that has a standard deviation.
const BOUND_SIGMAS: u64 = 5;

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

impl ClockCounters {
    const fn new() -> Self {
        Self { accepted: 0, rejected: 0, missed: 0, replaced: 0, labels_rejected: 0, labels_set: 0 }
    }
}

/// A time and how wrong it may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// GNSS time since the mission's epoch.
    pub time: TimePs,
    /// Standard deviation of its error, picoseconds: what the receiver and the oscillator are stated to do
    /// wrong ([`Oscillator`]), as the pulses have averaged it, grown over the time since the last one.
    /// Saturates at 4.3 ms.
    pub sigma_ps: u32,
}

impl Reading {
    /// Bound of the error, nanoseconds: five standard deviations.
    #[must_use]
    pub const fn bound_ns(&self) -> u32 {
        (self.sigma_ps as u64 * BOUND_SIGMAS).div_ceil(1000) as u32
    }
}

/// Turns ticks of a free-running timer into GNSS time.
///
/// The clock has a time once four pulses lie on a line and three messages agree on the number of their
/// seconds. Without pulses it holds over, ever less certain.
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
            counters: ClockCounters::new(),
        }
    }

    /// What the pulses were worth so far.
    #[must_use]
    pub const fn counters(&self) -> &ClockCounters {
        &self.counters
    }

    /// An edge of the pulse, captured at `ticks`. Edges come in their order. Says whether it was on the line in
    /// use.
    pub fn edge(&mut self, ticks: i64) -> bool {
        let local = self.oscillator.rate.time_of(ticks);
        if let Some(line) = &mut self.line
            && let Some(seconds) = line.join(local, &self.oscillator)
        {
            self.locked |= line.pulses() >= LOCK_PULSES;
            self.rival = None;
            Counters::count(&mut self.counters.accepted);
            self.counters.missed = self.counters.missed.saturating_add(seconds - 1);
            return true;
        }
        let fresh = Line::through(local, &self.oscillator);
        // A first edge that nothing has joined was no pulse.
        let hopeless = !self.locked && self.line.as_ref().is_none_or(|line| line.gap_s(local) > 2);
        if hopeless {
            self.line = Some(fresh);
            return false;
        }
        Counters::count(&mut self.counters.rejected);
        let Some(rival) = &mut self.rival else {
            self.rival = Some(fresh);
            return false;
        };
        if rival.join(local, &self.oscillator).is_none() {
            *rival = fresh;
        } else if rival.pulses() >= if self.locked { RIVAL_PULSES } else { LOCK_PULSES } {
            self.replace_line();
        }
        false
    }

    /// The rival takes the line's place, and with it the number of the second.
    fn replace_line(&mut self) {
        let Some(mut rival) = self.rival.take() else { return };
        if !self.line.as_ref().is_some_and(|line| rival.renumber_like(line)) {
            self.label = SecondLabel::new();
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
        self.vote(second, self.oscillator.rate.time_of(ticks));
    }

    /// An edge of the pulse that began second number `second`.
    pub fn pulse(&mut self, ticks: i64, second: i64) -> bool {
        let joined = self.edge(ticks);
        // In the middle of its second there is no doubt which one it is.
        self.vote(second, self.oscillator.rate.time_of(ticks).after(TimePs(PS_PER_S / 2)));
        joined
    }

    fn vote(&mut self, second: i64, local: TimePs) {
        let Some(counted) = self.second_at(local) else { return };
        if self.label.vote(second.saturating_sub(counted)) {
            Counters::count(&mut self.counters.labels_set);
        } else if self.label.offset_s().is_some_and(|offset| counted.saturating_add(offset) != second) {
            Counters::count(&mut self.counters.labels_rejected);
        }
    }

    /// The number, by the line's own count, of the second during which it is `local`; none so near to where a
    /// second begins that it may be either.
    fn second_at(&self, local: TimePs) -> Option<i64> {
        let line =
            self.line.as_ref().filter(|_| self.locked).filter(|line| line.gap_s(local) <= MAX_GAP_S)?;
        let reading = Reading { time: line.time_at(local), sigma_ps: line.sigma_ps(local, &self.oscillator) };
        let (second, part) = (reading.time.0.div_euclid(PS_PER_S), reading.time.0.rem_euclid(PS_PER_S));
        let margin = 1000 * i64::from(reading.bound_ns());
        (margin..PS_PER_S - margin).contains(&part).then_some(second)
    }

    /// GNSS time when the timer read `ticks`; none as long as it is not known, and again [`MAX_GAP_S`] after the last
    /// pulse.
    #[must_use]
    pub fn time_at(&self, ticks: i64) -> Option<Reading> {
        let (line, _) = self.known()?;
        let gap_s = line.gap_s(self.oscillator.rate.time_of(ticks));
        self.held_at(ticks).filter(|_| gap_s <= MAX_GAP_S)
    }

    /// GNSS time when the timer read `ticks`, however long ago the last pulse was; none as long as it was never
    /// known.
    #[must_use]
    pub fn held_at(&self, ticks: i64) -> Option<Reading> {
        let (line, offset_s) = self.known()?;
        let local = self.oscillator.rate.time_of(ticks);
        let time = TimePs(offset_s.checked_mul(PS_PER_S)?.checked_add(line.time_at(local).0)?);
        Some(Reading { time, sigma_ps: line.sigma_ps(local, &self.oscillator) })
    }

    /// The time to give something captured at `ticks`: GNSS time once it was ever known, and until then what the
    /// timer by itself says.
    #[must_use]
    pub fn local_or_gnss(&self, ticks: i64) -> TimePs {
        let local = self.oscillator.rate.time_of(ticks);
        let gnss = self
            .known()
            .map(|(line, offset_s)| line.time_at(local).after(TimePs(offset_s.saturating_mul(PS_PER_S))));
        gnss.unwrap_or(local)
    }

    /// What that time is worth when the timer reads `ticks`.
    #[must_use]
    pub fn state(&self, ticks: i64) -> ClockState {
        let Some((line, _)) = self.known() else { return ClockState::Free };
        let local = self.oscillator.rate.time_of(ticks);
        let sigma_ns = line.sigma_ps(local, &self.oscillator).div_ceil(1000).min(u16::MAX.into()) as u16;
        if line.gap_s(local) < HELD_AFTER_S {
            ClockState::Locked { sigma_ns }
        } else {
            ClockState::Held { sigma_ns }
        }
    }

    /// What the timer reads at a GNSS time, rounded to the nearest tick; none as long as it is not known, and beyond
    /// [`MAX_GAP_S`] from the last pulse.
    #[must_use]
    pub fn ticks_at(&self, time: TimePs) -> Option<i64> {
        let (line, offset_s) = self.known()?;
        let local = line.local_at(TimePs(time.0.checked_sub(offset_s.checked_mul(PS_PER_S)?)?));
        let rate = self.oscillator.rate;
        let half_tick = TimePs(rate.tick_ps() as i64 / 2);
        (line.gap_s(local) <= MAX_GAP_S).then(|| rate.ticks_in(local.after(half_tick)))
    }

    fn known(&self) -> Option<(&Line, i64)> {
        Some((self.line.as_ref().filter(|_| self.locked)?, self.label.offset_s()?))
    }
}

#[cfg(test)]
mod tests;
