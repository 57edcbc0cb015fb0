//! The line through the pulses per second: which tick a second began on, and how many ticks it has.
//!
//! A recursive least-squares line (Brookner, *Tracking and Kalman Filtering Made Easy*, 1998, section
//! 1.2.10: the growing-memory g-h filter, g = 2(2n-1)/(n(n+1)), h = 6/(n(n+1))) over the first [`WINDOW`]
//! pulses, which then goes on with the gains it has reached, so that old pulses fade.

use crate::srs::clock::TickRate;
use skyroost_protocol::units::TimePs;

/// Pulses that the line remembers, about: more would average more noise away, and see less of the
/// oscillator's wander.
pub const WINDOW: u8 = 16;
/// Longest time without a pulse that a line is drawn over, seconds.
pub const MAX_GAP_S: i64 = 1_000;

/// What an oscillator and the receiver's pulse may do wrong, at worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Oscillator {
    /// Nominal rate of the timer.
    pub rate: TickRate,
    /// Bound of the oscillator's error: initial, over temperature and by age; at most 500 ppm.
    pub tolerance_ppb: u32,
    /// Bound of the speed at which that error changes, as temperature does.
    pub wander_ppb_per_s: u32,
    /// Bound of the error of a pulse, from the receiver's data sheet.
    pub pulse_error_ns: u32,
}

impl Oscillator {
    /// Bound of the error of a captured pulse: the receiver's, and the tick it falls into.
    const fn edge_error_ns(&self) -> u64 {
        self.pulse_error_ns as u64 + self.rate.tick_ps().div_ceil(1000)
    }

    /// Whole ticks a second.
    fn hz(&self) -> i64 {
        self.rate.ticks_in(TimePs(PS_PER_S))
    }

    const fn tolerance_ppb(&self) -> u64 {
        if self.tolerance_ppb < 500_000 { self.tolerance_ppb as u64 } else { 500_000 }
    }
}

/// Picoseconds in a second.
pub(super) const PS_PER_S: i64 = 1_000_000_000_000;
/// Ticks carry eight bits of fraction (46 ps at 84 MHz), so that 64 bits last for years;
const PHASE_BITS: u32 = 8;
/// ticks a second carry twenty, so that what is learnt of them is not lost in rounding.
const RATE_BITS: u32 = 20;
/// Ticks beyond this (six years at 84 MHz) saturate.
const MAX_TICKS: i64 = 1 << 54;

/// Ticks with their fraction.
const fn phase(ticks: i64) -> i64 {
    let ticks = if ticks > MAX_TICKS {
        MAX_TICKS
    } else if ticks < -MAX_TICKS {
        -MAX_TICKS
    } else {
        ticks
    };
    ticks << PHASE_BITS
}

/// A line of ticks over seconds, counted from its first pulse.
#[derive(Clone, Debug)]
pub struct Line {
    /// Where the line has the second of the last pulse, [`PHASE_BITS`] of fraction.
    phase: i64,
    /// Ticks a second, [`RATE_BITS`] of fraction.
    rate: i64,
    /// Number of that second.
    second: i64,
    /// Pulses remembered, 1 to [`WINDOW`].
    edges: u8,
    /// Seconds without a pulse among those remembered.
    gap_s: u16,
    /// Bound of the rate's error where a single pulse is remembered.
    rate_error_ppb: u64,
}

impl Line {
    /// The line of the nominal rate through a first pulse.
    #[must_use]
    pub fn through(ticks: i64, oscillator: &Oscillator) -> Self {
        Self {
            phase: phase(ticks),
            rate: oscillator.hz() << RATE_BITS,
            second: 0,
            edges: 1,
            gap_s: 0,
            rate_error_ppb: oscillator.tolerance_ppb(),
        }
    }

    /// Pulses remembered.
    #[must_use]
    pub const fn edges(&self) -> u8 {
        self.edges
    }

    /// Gives the last pulse's second another number.
    pub const fn renumber(&mut self, second: i64) {
        self.second = second;
    }

    /// Draws the line on to a pulse, where it is one: on the grid of seconds as well as it is known.
    /// Returns the seconds since the pulse before.
    pub fn join(&mut self, ticks: i64, oscillator: &Oscillator) -> Option<u32> {
        let measured = phase(ticks);
        let seconds = self.nearest(measured)?;
        if seconds < 1 {
            return None; // the same second again
        }
        let predicted = self.phase_after(seconds);
        let residual = measured.saturating_sub(predicted);
        let gate_ns = self.error_ns(seconds as u64 * 1000, oscillator) + oscillator.edge_error_ns();
        if residual.unsigned_abs() > self.phase_of_ns(gate_ns) {
            return None;
        }
        let missed = seconds - 1;
        let remembered = i64::from(self.edges) - missed;
        if missed > 0 && remembered < 2 {
            // Too long ago to say more than about the rate, and that only as far as it can have stayed.
            let rate_error = self.rate_error_ppb(oscillator)
                + u64::from(oscillator.wander_ppb_per_s)
                    * (seconds as u64 + u64::from(self.gap_s) + HALF_WINDOW);
            let next = Self { rate_error_ppb: rate_error.min(2 * oscillator.tolerance_ppb()), ..*self };
            *self = Self { phase: measured, second: self.second + seconds, edges: 1, gap_s: 0, ..next };
            return Some(seconds as u32);
        }
        let n = (remembered + 1).min(i64::from(WINDOW));
        self.phase = predicted + residual * (2 * (2 * n - 1)) / (n * (n + 1));
        let rate = self.rate + (residual << (RATE_BITS - PHASE_BITS)) * 6 / (n * (n + 1) * seconds);
        let nominal = oscillator.hz() << RATE_BITS;
        let most = nominal / 1_000_000_000 * 2 * oscillator.tolerance_ppb() as i64;
        self.rate = rate.clamp(nominal - most, nominal + most);
        self.second += seconds;
        self.edges = n as u8;
        self.gap_s = (self.gap_s + missed as u16).saturating_sub(u16::from(missed == 0));
        Some(seconds as u32)
    }

    /// The nearest second, counted from the last pulse; none beyond [`MAX_GAP_S`].
    fn nearest(&self, phase: i64) -> Option<i64> {
        let rate = self.rate_in_phase();
        let ahead = phase.saturating_sub(self.phase).saturating_add(rate / 2);
        Some(ahead.div_euclid(rate)).filter(|s| s.abs() <= MAX_GAP_S)
    }

    /// The number of the second nearest to another line's last pulse, if this one reaches there.
    #[must_use]
    pub fn nearest_second(&self, other: &Self) -> Option<i64> {
        self.nearest(other.phase).map(|seconds| self.second + seconds)
    }

    /// The number of the second during which the timer reads `ticks`; none beyond [`MAX_GAP_S`], and none
    /// so near to where a second begins that it may be either.
    #[must_use]
    pub fn second_at(&self, ticks: i64, oscillator: &Oscillator) -> Option<i64> {
        let (seconds, part) = self.split(ticks)?;
        let margin = self.phase_of_ns(u64::from(self.uncertainty_ns(ticks, oscillator)));
        let rest = self.rate_in_phase() as u64 - part;
        (part > margin && rest > margin).then_some(self.second + seconds)
    }

    /// Whole seconds since the last pulse, saturating at zero.
    #[must_use]
    pub fn seconds_since(&self, ticks: i64) -> i64 {
        phase(ticks).saturating_sub(self.phase).max(0) / self.rate_in_phase()
    }

    /// Time since this line's second 0, rounded down to the picosecond; none beyond [`MAX_GAP_S`] from the
    /// last pulse.
    #[must_use]
    pub fn time_since_epoch(&self, ticks: i64) -> Option<TimePs> {
        let (seconds, part) = self.split(ticks)?;
        // Long division in two steps of 10^6: below 2^41 each, times 10^6.
        let rate = self.rate_in_phase() as u64;
        let us = part * 1_000_000;
        let ps = us % rate * 1_000_000 / rate;
        let part_ps = (us / rate * 1_000_000 + ps) as i64;
        self.second.checked_add(seconds)?.checked_mul(PS_PER_S)?.checked_add(part_ps).map(TimePs)
    }

    /// What the timer reads at a time since this line's second 0, to the nearest tick; none beyond
    /// [`MAX_GAP_S`] from the last pulse.
    #[must_use]
    pub fn ticks_at(&self, time: TimePs) -> Option<i64> {
        let seconds = time.0.div_euclid(PS_PER_S).checked_sub(self.second)?;
        if seconds.abs() > MAX_GAP_S {
            return None;
        }
        let (rate, part_ps) = (self.rate_in_phase(), time.0.rem_euclid(PS_PER_S));
        let part = (part_ps / 1_000_000 * rate + part_ps % 1_000_000 * rate / 1_000_000) / 1_000_000;
        let phase = self.phase_after(seconds).saturating_add(part);
        Some(phase.saturating_add(1 << (PHASE_BITS - 1)) >> PHASE_BITS)
    }

    /// Bound of the line's error at `ticks`, nanoseconds.
    #[must_use]
    pub fn uncertainty_ns(&self, ticks: i64, oscillator: &Oscillator) -> u32 {
        let away = phase(ticks).saturating_sub(self.phase).unsigned_abs();
        // Milliseconds, rounded up; a thousand seconds of phase, times 1000, are below 2^60.
        let rate = self.rate_in_phase() as u64;
        let away_ms = away.min(rate.saturating_mul(MAX_GAP_S as u64)).saturating_mul(1000).div_ceil(rate);
        u32::try_from(self.error_ns(away_ms, oscillator)).unwrap_or(u32::MAX)
    }

    /// Bound of the line's error so long after or before its last pulse.
    ///
    /// With e the bound of an edge's error and n edges: the least-squares line errs at its end by less than
    /// 5/3 e (the weights of its edges, between 4/n and -2/n, sum up to that in absolute value) and in its
    /// slope by less than 4 e/n a second. An oscillator whose rate changes by w a second is away from a line
    /// that knows it as it was M seconds ago by w (t + M)^2 / 2. The filter's lag under a steady change,
    /// w (1-g)/h (Brookner, 1.2.6), gives M = 0.54 n, its slope's 0.62 n; lost pulses make it older.
    fn error_ns(&self, away_ms: u64, oscillator: &Oscillator) -> u64 {
        let edge = oscillator.edge_error_ns();
        let drift = self.rate_error_ppb(oscillator) * away_ms / 1000;
        let memory_ms = u64::from(self.edges) * 650 + u64::from(self.gap_s) * 1500;
        let bent_ms = away_ms + memory_ms;
        let wander = u64::from(oscillator.wander_ppb_per_s) * bent_ms / 1000 * bent_ms / 2000;
        2 * edge + drift + wander
    }

    /// Bound of the error of the rate.
    const fn rate_error_ppb(&self, oscillator: &Oscillator) -> u64 {
        if self.edges < 2 { self.rate_error_ppb } else { 4 * oscillator.edge_error_ns() / self.edges as u64 }
    }

    /// Whole seconds from the last pulse to `ticks`, and the rest; none beyond [`MAX_GAP_S`].
    fn split(&self, ticks: i64) -> Option<(i64, u64)> {
        let (rate, ahead) = (self.rate_in_phase(), phase(ticks).saturating_sub(self.phase));
        let seconds = ahead.div_euclid(rate);
        (seconds.abs() <= MAX_GAP_S).then_some((seconds, ahead.rem_euclid(rate) as u64))
    }

    /// Ticks a second with the fraction of a phase, rounded.
    fn rate_in_phase(&self) -> i64 {
        const BITS: u32 = RATE_BITS - PHASE_BITS;
        // Never below 1, as the compiler cannot know: nothing is divided by zero.
        ((self.rate + (1 << (BITS - 1))) >> BITS).max(1)
    }

    /// Where the line has the second so many after the last pulse: at most 2^10 of them at 2^52 each.
    const fn phase_after(&self, seconds: i64) -> i64 {
        self.phase.saturating_add((self.rate * seconds) >> (RATE_BITS - PHASE_BITS))
    }

    /// Nanoseconds as a phase; half a second or more is more than any residual.
    fn phase_of_ns(&self, ns: u64) -> u64 {
        if ns >= 500_000_000 {
            return u64::MAX;
        }
        let rate = self.rate_in_phase() as u64;
        // Microseconds below 2^19 and rates below 2^41.
        ns / 1000 * rate / 1_000_000 + ns % 1000 * rate / 1_000_000_000
    }
}

/// Half of [`WINDOW`], in seconds.
const HALF_WINDOW: u64 = WINDOW as u64 / 2;
