//! GNSS time of a board: its free-running timer, disciplined by the pulse per second.
//!
//! The receiver's pulse says when a second began, its navigation message says which. A line through
//! the pulses ([`Line`]) turns ticks into seconds and their parts, a vote ([`SecondLabel`]) numbers them.
//! Everything is integers: times in picoseconds, ticks with eight bits of fraction.

use super::pulse_line::{Line, Oscillator, PS_PER_S};
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
        let Some(line) = self.line.as_ref().filter(|_| self.locked) else { return };
        let Some(counted) = line.second_at(ticks, &self.oscillator) else { return };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::ticks::TickCounter;
    use crate::srs::clock::TickRate;
    use proptest::{collection::vec, prelude::*};

    const HZ: u64 = 84_000_000;

    fn oscillator() -> Oscillator {
        Oscillator {
            rate: TickRate::new(HZ).expect("not zero"),
            tolerance_ppb: 50_000,
            wander_ppb_per_s: 5,
            pulse_error_ns: 100,
        }
    }

    /// A timer on an oscillator whose error changes linearly, in exact integers.
    #[derive(Clone, Copy, Debug)]
    struct TrueTimer {
        start_ticks: i64,
        ppb: i64,
        ppb_per_s: i64,
    }

    impl TrueTimer {
        /// Ticks at a time since the start: the integral of the rate, rounded down.
        fn ticks(&self, ns: i64) -> i64 {
            let ns = i128::from(ns);
            let e9 = 1_000_000_000_i128;
            // ns (1 + ppb 1e-9) + ppb_per_s 1e-9 t^2 / 2, in units of 1e-18 s.
            let scaled = ns * e9 + ns * i128::from(self.ppb) + ns * ns / e9 * i128::from(self.ppb_per_s) / 2;
            self.start_ticks + (scaled * i128::from(HZ)).div_euclid(e9 * e9) as i64
        }
    }

    fn timer() -> impl Strategy<Value = TrueTimer> {
        (any::<u32>(), -20_000..20_000_i64, -5..=5_i64).prop_map(|(start, ppb, ppb_per_s)| TrueTimer {
            start_ticks: i64::from(start),
            ppb,
            ppb_per_s,
        })
    }

    /// What happens in one second of a test.
    #[derive(Clone, Copy, Debug)]
    struct Second {
        pulse: bool,
        jitter_ns: i64,
        spurious_ns: Option<i64>,
    }

    fn second(lost_in_100: u32, spurious_in_100: u32) -> impl Strategy<Value = Second> {
        let pulse = (0..100_u32).prop_map(move |draw| draw >= lost_in_100);
        let spurious = (0..100_u32, 1_000_000..999_000_000_i64)
            .prop_map(move |(draw, ns)| (draw < spurious_in_100).then_some(ns))
            .no_shrink(); // edges shrunk to the same place in every second are a pulse
        (pulse, -100..=100_i64, spurious).prop_map(|(pulse, jitter_ns, spurious_ns)| Second {
            pulse,
            jitter_ns,
            spurious_ns,
        })
    }

    const S: i64 = 1_000_000_000;
    /// Number of the first second.
    const FIRST: i64 = 1_234;

    /// Plays a second to the clock: its pulse, what is not a pulse, its label; then holds the clock against
    /// the truth, right after the pulse and before the next.
    fn play(clock: &mut GnssClock, timer: &TrueTimer, index: i64, what: Second) -> Result<(), TestCaseError> {
        if what.pulse {
            clock.edge(timer.ticks(index * S + what.jitter_ns));
        }
        if let Some(ns) = what.spurious_ns {
            clock.edge(timer.ticks(index * S + ns));
        }
        clock.label(FIRST + index, timer.ticks(index * S + 999_500_000));
        for ns in [index * S + 500, index * S + 999_999_000] {
            let Some(reading) = clock.time_at(timer.ticks(ns)) else { continue };
            let error_ps = reading.time.0 - (FIRST * S + ns) * 1000;
            prop_assert!(
                error_ps.abs() <= i64::from(reading.uncertainty_ns) * 1000,
                "{} ns off, {} stated, in second {index}",
                error_ps / 1000,
                reading.uncertainty_ns
            );
            let back = clock.ticks_at(reading.time).expect("a time it has just told");
            prop_assert!((back - timer.ticks(ns)).abs() <= 1, "{back}, not {}", timer.ticks(ns));
        }
        Ok(())
    }

    const GOOD: Second = Second { pulse: true, jitter_ns: 0, spurious_ns: None };
    const LOST: Second = Second { pulse: false, ..GOOD };

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        /// Over any oscillator and jitter within the bounds, the stated uncertainty holds and is small.
        #[test]
        fn truth_is_within_the_uncertainty(timer in timer(), seconds in vec(second(0, 0), 40)) {
            let mut clock = GnssClock::new(oscillator());
            for (index, what) in (0..).zip(seconds) {
                play(&mut clock, &timer, index, what)?;
                prop_assert_eq!(clock.time_at(timer.ticks(index * S)).is_some(), index >= 5);
            }
            let reading = clock.time_at(timer.ticks(39 * S)).expect("locked");
            prop_assert!(reading.uncertainty_ns < 550, "{} ns", reading.uncertainty_ns);
            prop_assert_eq!(clock.counters().accepted, 39);
            prop_assert_eq!(clock.counters().rejected, 0);
        }

        /// Pulses that fail and edges that are none neither move the time nor make it seem surer than it is.
        #[test]
        fn truth_survives_losses_and_spurious_edges(
            timer in timer(), seconds in vec(second(20, 40), 120),
        ) {
            let mut clock = GnssClock::new(oscillator());
            for index in 0..16 {
                play(&mut clock, &timer, index, GOOD)?;
            }
            for (index, what) in (16..).zip(seconds) {
                play(&mut clock, &timer, index, what)?;
                prop_assert!(clock.time_at(timer.ticks(index * S)).is_some());
            }
            prop_assert_eq!(clock.counters().replaced, 0);
        }

        /// Minutes without a pulse: less and less sure, never wrong, and sure again soon after.
        #[test]
        fn truth_holds_over(timer in timer(), before in 6..60_i64, gap in 1..600_i64, jitter in vec(-100..=100_i64, 24)) {
            let mut clock = GnssClock::new(oscillator());
            for index in 0..before {
                play(&mut clock, &timer, index, GOOD)?;
            }
            let mut uncertainty_ns = 0;
            for index in before..before + gap {
                play(&mut clock, &timer, index, LOST)?;
                let reading = clock.time_at(timer.ticks(index * S)).expect("holds over");
                prop_assert!(reading.uncertainty_ns >= uncertainty_ns);
                uncertainty_ns = reading.uncertainty_ns;
            }
            for (index, jitter_ns) in (before + gap..).zip(jitter) {
                play(&mut clock, &timer, index, Second { jitter_ns, ..GOOD })?;
            }
            prop_assert_eq!(i64::from(clock.counters().missed), gap);
            prop_assert_eq!(clock.counters().rejected, 0);
            let end = clock.time_at(timer.ticks((before + gap + 23) * S)).expect("locked").uncertainty_ns;
            prop_assert!(end < 900, "{end} ns");
        }

        /// A start among edges that are no pulses ends in a lock all the same.
        #[test]
        fn locks_in_spite_of_spurious_edges(timer in timer(), seconds in vec(second(5, 60), 60)) {
            let mut clock = GnssClock::new(oscillator());
            for (index, what) in (0..).zip(seconds) {
                play(&mut clock, &timer, index, what)?;
            }
            for index in 60..90 {
                play(&mut clock, &timer, index, GOOD)?;
            }
            prop_assert!(clock.time_at(timer.ticks(90 * S)).is_some());
        }

        /// No edge, label or question, however wrong, overflows.
        #[test]
        fn survives_anything(
            hz in 1..u64::from(u32::MAX), tolerance_ppb: u32, wander_ppb_per_s in 0..1_000_000_u32, pulse_error_ns: u32,
            events in vec((0..3_u8, prop_oneof![any::<i64>(), 0..10 * HZ as i64], any::<i64>()), 0..200),
        ) {
            let rate = TickRate::new(hz).expect("not zero");
            let mut clock =
                GnssClock::new(Oscillator { rate, tolerance_ppb, wander_ppb_per_s, pulse_error_ns });
            for (what, ticks, value) in events {
                match what {
                    0 => clock.edge(ticks),
                    1 => clock.label(value, ticks),
                    _ => {
                        let _ = clock.time_at(ticks);
                        let _ = clock.ticks_at(TimePs(value));
                    }
                }
            }
        }
    }

    fn locked(timer: &TrueTimer, seconds: i64) -> GnssClock {
        let mut clock = GnssClock::new(oscillator());
        for index in 0..seconds {
            play(&mut clock, timer, index, GOOD).expect("right");
        }
        clock
    }

    const TIMER: TrueTimer = TrueTimer { start_ticks: 4_000_000_000, ppb: 17_000, ppb_per_s: 0 };

    /// The 32-bit timer wraps every 51 s; what the board sees of it is read at 50 Hz.
    #[test]
    fn wraps_of_the_timer_do_not_show() {
        let mut clock = GnssClock::new(oscillator());
        let mut counter = TickCounter::starting_at(TIMER.ticks(0) as u32);
        for step in 0..50 * 400_i64 {
            let ns = step * (S / 50);
            let ticks = counter.read(TIMER.ticks(ns) as u32);
            if step % 50 == 1 {
                // Handled a step late, as by a slow task.
                clock.edge(counter.extend(TIMER.ticks(ns - S / 50) as u32));
                clock.label(FIRST + step / 50, ticks);
            }
            if step > 50 * 10 {
                let reading = clock.time_at(ticks).expect("locked");
                let error_ps = reading.time.0 - (FIRST * S + ns) * 1000;
                assert!(error_ps.abs() < 30_000, "{error_ps} ps off with ideal pulses, at step {step}");
            }
        }
        assert_eq!(clock.counters().rejected, 0);
    }

    #[test]
    fn a_label_one_second_off_for_a_while_changes_nothing() {
        let mut clock = locked(&TIMER, 20);
        for index in 20..40 {
            clock.edge(TIMER.ticks(index * S));
            clock.label(FIRST + index - 1, TIMER.ticks(index * S + S / 10));
            let reading = clock.time_at(TIMER.ticks(index * S + 500)).expect("locked");
            assert_eq!(reading.time.as_us().div_euclid(100), (FIRST + index) * 10_000);
        }
        assert_eq!(clock.counters().labels_rejected, 20);
        assert_eq!(clock.counters().labels_set, 1);
    }

    #[test]
    fn another_pulse_takes_over_only_when_it_lasts() {
        let mut clock = locked(&TIMER, 20);
        let moved = |index: i64| TIMER.ticks(index * S + 3_000_000); // a receiver restarted 3 ms off
        for index in 20..27 {
            clock.edge(moved(index));
        }
        assert_eq!(clock.counters().replaced, 0);
        clock.edge(moved(27));
        assert_eq!(clock.counters().replaced, 1);
        let reading = clock.time_at(moved(27)).expect("locked");
        assert!(
            (reading.time.0 - (FIRST + 27) * PS_PER_S).abs() < 1_000_000,
            "the number of the second stays"
        );
    }

    /// The figures of firmware/README.md.
    #[test]
    fn uncertainty_is_as_documented() {
        let clock = locked(&TIMER, 20);
        let bound_ns =
            |after_s: i64| clock.time_at(TIMER.ticks((19 + after_s) * S)).map(|now| now.uncertainty_ns);
        for (after_s, documented_ns) in [(0, 500), (1, 580), (60, 14_500), (600, 955_000)] {
            let bound_ns = bound_ns(after_s).expect("locked");
            assert!(
                (documented_ns * 97 / 100..=documented_ns).contains(&bound_ns),
                "{bound_ns} ns after {after_s} s"
            );
        }
    }

    #[test]
    fn says_nothing_after_too_long_without_pulses() {
        let clock = locked(&TIMER, 20);
        assert!(clock.time_at(TIMER.ticks(1_000 * S)).is_some());
        assert!(clock.time_at(TIMER.ticks(1_021 * S)).is_none());
    }

    #[test]
    fn a_second_edge_in_a_second_is_none() {
        let mut clock = locked(&TIMER, 20);
        clock.edge(TIMER.ticks(19 * S + 40));
        assert_eq!(clock.counters().rejected, 1);
    }
}
