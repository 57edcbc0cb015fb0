//! The line through the pulses per second: what time it was when the timer read so and so.
//!
//! Time over the timer's nominal time is a straight line but for the oscillator's noise, and its offset and
//! slope are the two states of a Kalman filter (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications
//! to Tracking and Navigation*, 2001, 5.2). Its memory grows with every pulse, as a least-squares line's does,
//! up to what the noise stated lets pulses be remembered: with white frequency noise of `walk` alone the gain
//! of the offset settles at walk / pulse noise, the alpha of the steady state (6.5.1).
//!
//! The noise of oscillators is stated as in Riley, *Handbook of Frequency Stability Analysis* (NIST SP 1065):
//! - white frequency noise, a random walk of the time with the variance walk² t, Allan deviation
//!   walk / sqrt(t) (table 3);
//! - a wander of the rate, whose change is taken as steady from one pulse to the next, however long that is
//!   (discrete white noise acceleration, 6.3.2): a crystal that warms does so for minutes.
//!
//! Everything is integers: times in picoseconds, rates in units of 2^-50, variances in ps² and ps²/s and (ps/s)²
//! with twenty bits of fraction, spans of time that variances grow over in seconds with sixteen.

use crate::{scalar::root, srs::clock::TickRate};
use core::num::NonZeroU64;
use skyroost_protocol::units::TimePs;

/// Longest time without a pulse that a line is drawn over, seconds.
pub const MAX_GAP_S: i64 = 1_000;
/// A pulse this many standard deviations off the line is none: one in two million.
const GATE_SIGMAS: u64 = 5;

/// What an oscillator and the receiver's pulse are stated to do wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Oscillator {
    /// Nominal rate of the timer.
    pub rate: TickRate,
    /// Bound of the oscillator's error: initial, over temperature and by age; at most 500 ppm.
    pub tolerance_ppb: u32,
    /// Random walk of its time over a second, standard deviation.
    pub walk_ps: u32,
    /// Change of its rate over a second, as temperature changes it, standard deviation, fs/s².
    pub wander_fs_per_s2: u32,
    /// Error of a pulse, from the receiver's data sheet, standard deviation.
    pub pulse_ps: u32,
}

impl Oscillator {
    /// Bound of the oscillator's error, parts per billion.
    fn tolerance_ppb(&self) -> u32 {
        self.tolerance_ppb.min(500_000)
    }

    /// Variance of a captured pulse: the receiver's, and the tick's that it falls into.
    fn pulse_variance(&self) -> i128 {
        square(self.pulse_ps) + self.tick_variance()
    }

    /// Variance of where in its tick an edge lies.
    fn tick_variance(&self) -> i128 {
        square(self.rate.tick_sigma_ps().max(1))
    }
}

/// Picoseconds in a second.
pub(super) const PS_PER_S: i64 = 1_000_000_000_000;
/// Fraction of spans of time, and the picoseconds of its last bit, rounded.
const SPAN_BITS: u32 = 16;
const PS_PER_SPAN: u64 = PS_PER_S as u64 >> SPAN_BITS;
/// Longest span that variances grow over: 18 hours. Beyond, nobody knows anything anyway.
const MAX_SPAN: u64 = 1 << 32;
/// Fraction of variances.
const VARIANCE_BITS: u32 = 20;
/// Variances of offsets, of both and of slopes end here, at 9 ms, beyond anything that is still known, so that no
/// product overflows.
const MAX_VARIANCES: [i128; 3] = [1 << 86, 1 << 80, 1 << 77];
/// Fraction of gains.
const GAIN_BITS: u32 = 40;
/// Fraction of rates: 0.9 fs a second.
const RATE_BITS: u32 = 50;
/// A wander beyond 100 ppb a second is no oscillator's.
const MAX_WANDER_FS_PER_S2: u32 = 100_000_000;

/// A variance from a standard deviation in picoseconds.
const fn square(ps: u32) -> i128 {
    (ps as i128 * ps as i128) << VARIANCE_BITS
}

/// A product without the last `bits`. One function: a board's processor takes a page of code for it.
#[inline(never)]
fn product(a: i128, b: i128, bits: u32) -> i128 {
    (a * b) >> (bits & 127)
}

/// How many times `whole` goes into `part`, GAIN_BITS of fraction; four times at most. Neither is negative.
#[inline(never)]
fn ratio(part: i128, whole: i128) -> i128 {
    const HALF: u32 = GAIN_BITS / 2;
    // To 42 bits: for those two divisions of 64 bits do, where one of 128 is pages of code.
    let excess = (128 - whole.leading_zeros()).saturating_sub(42);
    let part = (part >> excess).clamp(0, (1 << 44) - 1) as u64;
    let Ok(whole) = NonZeroU64::try_from((whole >> excess) as u64) else { return 0 };
    let (high, rest) = ((part << HALF) / whole, (part << HALF) % whole);
    i128::from((high << HALF) + (rest << HALF) / whole)
}

/// What grows by so much a second over a span.
fn over(per_s: i128, span: i128) -> i128 {
    product(per_s, span, SPAN_BITS)
}

/// What is known of a line's errors: covariance of offset and slope.
#[derive(Clone, Copy, Debug)]
struct Covariance {
    /// Of the offset, ps².
    offset: i128,
    /// Of both, ps²/s.
    cross: i128,
    /// Of the slope, (ps/s)².
    slope: i128,
}

impl Covariance {
    /// A span later.
    fn after(&self, span: u64, oscillator: &Oscillator) -> Self {
        let span = span.min(MAX_SPAN) as i128;
        let wander = u64::from(oscillator.wander_fs_per_s2.min(MAX_WANDER_FS_PER_S2));
        // The rate's change over the span if it goes on steadily, ps/s, and the offset that this comes to, ps.
        let bend = over(((wander << VARIANCE_BITS) / 1000).into(), span);
        let bent = over(bend, span) / 2;
        let of = |a: i128, b: i128| product(a, b, VARIANCE_BITS);
        let Self { offset, cross, slope } = *self;
        let offset = offset + over(2 * cross + over(slope, span), span);
        let offset = offset + over(square(oscillator.walk_ps), span) + of(bent, bent);
        let [most_offset, most_cross, most_slope] = MAX_VARIANCES;
        Self {
            offset: offset.min(most_offset),
            cross: (cross + over(slope, span) + of(bent, bend)).min(most_cross),
            slope: (slope + of(bend, bend)).min(most_slope),
        }
    }
}

/// A line of time over the timer's nominal time, counted from its first pulse.
#[derive(Clone, Debug)]
pub(super) struct Line {
    /// Nominal time of the last pulse.
    local: i64,
    /// What time the line has for it.
    time: i64,
    /// How much faster than nominal time goes, RATE_BITS of fraction.
    rate: i64,
    covariance: Covariance,
    /// Pulses so far, saturating.
    pulses: u8,
}

impl Line {
    /// The line of the nominal rate through a first pulse, which begins second 0.
    pub(super) fn through(local: TimePs, oscillator: &Oscillator) -> Self {
        // A bound is four standard deviations. The first pulses forget it.
        let slope = square(oscillator.tolerance_ppb() * (1000 / 4));
        let covariance = Covariance { offset: oscillator.pulse_variance(), cross: 0, slope };
        Self { local: local.0, time: 0, rate: 0, covariance, pulses: 1 }
    }

    /// Pulses that made the line, saturating.
    pub(super) const fn pulses(&self) -> u8 {
        self.pulses
    }

    /// Numbers the seconds as `other` does, if that one reaches here.
    pub(super) fn renumber_like(&mut self, other: &Self) -> bool {
        let local = TimePs(self.local);
        let reached = other.gap_s(local) <= MAX_GAP_S;
        if reached {
            let apart = nearest_second(other.time_at(local).0.saturating_sub(self.time));
            self.time = self.time.saturating_add(apart.saturating_mul(PS_PER_S));
        }
        reached
    }

    /// Draws the line on to a pulse, where it is one: on the grid of seconds as well as it is known. Returns the
    /// seconds since the pulse before.
    pub(super) fn join(&mut self, local: TimePs, oscillator: &Oscillator) -> Option<u32> {
        let predicted = self.time_at(local).0;
        let second = nearest_second(predicted);
        let seconds = second.saturating_sub(nearest_second(self.time));
        if !(1..=MAX_GAP_S).contains(&seconds) {
            return None; // the same second again, or one that nobody can count
        }
        let span = self.span(local);
        let Covariance { offset, cross, slope } = self.covariance.after(span, oscillator);
        let innovation = offset + oscillator.pulse_variance();
        let residual = second.saturating_mul(PS_PER_S).saturating_sub(predicted);
        if residual.unsigned_abs() > u64::from(deviation_ps(innovation)) * GATE_SIGMAS {
            return None;
        }
        let (to_offset, to_slope) = (ratio(offset, innovation), ratio(cross, innovation));
        self.covariance = Covariance {
            offset: offset - product(to_offset, offset, GAIN_BITS),
            cross: cross - product(to_offset, cross, GAIN_BITS),
            // Rounding must not make the slope seem known.
            slope: (slope - product(to_slope, cross, GAIN_BITS)).max(1),
        };
        let step = product(to_offset, i128::from(residual) * 2 + 1, GAIN_BITS + 1);
        // What part of the residual the slope has made over this span, over the span to the picosecond: rounding the
        // span would leave its share of the whole slope in the first estimate.
        let by_slope = ratio(over(cross, span.into()), innovation);
        let made = product(by_slope, residual.unsigned_abs().into(), 2 * GAIN_BITS - RATE_BITS);
        let turn = ratio(made, local.0.saturating_sub(self.local).into()) as i64 * residual.signum();
        let most = i64::from(oscillator.tolerance_ppb()) * (2 * (1 << RATE_BITS) / 1_000_000_000);
        self.local = local.0;
        self.time = predicted.saturating_add(step as i64);
        self.rate = (self.rate + turn).clamp(-most, most);
        self.pulses = self.pulses.saturating_add(1);
        Some(seconds as u32)
    }

    /// Time since this line's second 0. Saturates; what it is worth says [`sigma_ps`](Self::sigma_ps).
    pub(super) fn time_at(&self, local: TimePs) -> TimePs {
        let since = local.0.saturating_sub(self.local);
        let faster = product(since.into(), self.rate.into(), RATE_BITS) as i64;
        TimePs(self.time.saturating_add(since).saturating_add(faster))
    }

    /// The timer's nominal time at a time since this line's second 0; saturates.
    pub(super) fn local_at(&self, time: TimePs) -> TimePs {
        let since = time.0.saturating_sub(self.time);
        // since = local + faster(local), solved by iteration: each makes the error 1000 times smaller at least.
        let mut local = since;
        for _ in 0..6 {
            local = since.saturating_sub(product(local.into(), self.rate.into(), RATE_BITS) as i64);
        }
        TimePs(self.local.saturating_add(local))
    }

    /// Standard deviation of the line's error at a nominal time, picoseconds; saturates.
    pub(super) fn sigma_ps(&self, local: TimePs, oscillator: &Oscillator) -> u32 {
        let after = self.covariance.after(self.span(local), oscillator);
        // Where in their ticks edges lie may be the same in every second.
        deviation_ps(after.offset + oscillator.tick_variance())
    }

    /// Whole seconds between a nominal time and the last pulse.
    pub(super) const fn gap_s(&self, local: TimePs) -> i64 {
        (local.0.abs_diff(self.local) / PS_PER_S as u64) as i64
    }

    /// Time between a nominal time and the last pulse, seconds with SPAN_BITS of fraction.
    const fn span(&self, local: TimePs) -> u64 {
        local.0.abs_diff(self.local) / PS_PER_SPAN
    }
}

/// Number of the second nearest to a time.
const fn nearest_second(time: i64) -> i64 {
    time.saturating_add(PS_PER_S / 2).div_euclid(PS_PER_S)
}

/// Standard deviation of a variance, picoseconds; saturates.
fn deviation_ps(variance: i128) -> u32 {
    root(u64::try_from(variance >> VARIANCE_BITS).unwrap_or(u64::MAX))
}
