//! The bound holds, whatever happens to pulses and labels.

mod honesty;

use super::*;
use crate::{board::ticks::TickCounter, srs::clock::TickRate};
use proptest::{collection::vec, prelude::*};

const HZ: u64 = 84_000_000;

fn oscillator() -> Oscillator {
    Oscillator {
        rate: TickRate::new(HZ).expect("not zero"),
        tolerance_ppb: 50_000,
        walk_ps: 1_000,
        wander_fs_per_s2: 5_000_000,
        pulse_ps: 60_000,
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
            error_ps.abs() <= i64::from(reading.bound_ns()) * 1000,
            "{} ns off, {} stated, in second {index}",
            error_ps / 1000,
            reading.bound_ns()
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
        prop_assert!(reading.bound_ns() < 550, "{} ns", reading.bound_ns());
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
            prop_assert!(reading.bound_ns() >= uncertainty_ns);
            uncertainty_ns = reading.bound_ns();
        }
        for (index, jitter_ns) in (before + gap..).zip(jitter) {
            play(&mut clock, &timer, index, Second { jitter_ns, ..GOOD })?;
        }
        prop_assert_eq!(i64::from(clock.counters().missed), gap);
        prop_assert_eq!(clock.counters().rejected, 0);
        let end = clock.time_at(timer.ticks((before + gap + 23) * S)).expect("locked").bound_ns();
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
        hz in 1..=10_000_000_000_u64, tolerance_ppb: u32, walk_ps: u32, wander_fs_per_s2: u32, pulse_ps: u32,
        events in vec((0..3_u8, prop_oneof![any::<i64>(), 0..10 * HZ as i64], any::<i64>()), 0..200),
    ) {
        let rate = TickRate::new(hz).expect("not zero");
        let mut clock =
            GnssClock::new(Oscillator { rate, tolerance_ppb, walk_ps, wander_fs_per_s2, pulse_ps });
        for (what, ticks, value) in events {
            match what {
                0 => _ = clock.edge(ticks),
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
    assert!((reading.time.0 - (FIRST + 27) * PS_PER_S).abs() < 1_000_000, "the number of the second stays");
}

/// The figures of firmware/README.md.
#[test]
fn uncertainty_is_as_documented() {
    let clock = locked(&TIMER, 20);
    let bound_ns = |after_s: i64| clock.time_at(TIMER.ticks((19 + after_s) * S)).map(|now| now.bound_ns());
    for (after_s, documented_ns) in [(0, 180), (1, 220), (60, 46_000), (600, 4_600_000)] {
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
