//! The capture timer in 64 bits.

use super::clock::TickRate;
use skyroost_protocol::units::TimePs;

/// Extends values of a 32-bit timer, which wraps every 2^32 ticks (51 s at 84 MHz, 4.4 s at 983.04 MHz, 0.8 s
/// with ticks of 184 ps), to 64 bits (53 years of these).
///
/// The timer is read at every step of the flight code together with GNSS time. From one step to the
/// next the reading moves on by its difference and by as many whole wraps as bring it nearest to the
/// time gone by, so that a gap between steps does no harm as long as oscillator and GNSS time agree to
/// half a wrap over it: at 20 ppm and 983.04 MHz, for 30 hours. The first reading is placed likewise, on
/// the assumption that the timer stood at a multiple of 2^32 ticks at the mission's epoch.
#[derive(Clone, Debug)]
pub struct TickExtender {
    rate: TickRate,
    /// The last reading, extended.
    ticks: i64,
    /// GNSS time of the last reading.
    time: TimePs,
    gaps: u32,
}

/// Half a wrap.
const HALF_WRAP: i64 = 1 << 31;

impl TickExtender {
    /// An extender before its first step.
    #[must_use]
    pub const fn new(rate: TickRate) -> Self {
        Self { rate, ticks: 0, time: TimePs(0), gaps: 0 }
    }

    /// The timer reads `counter` at GNSS time `time`. Returns the reading in 64 bits.
    pub fn step(&mut self, counter: u32, time: TimePs) -> i64 {
        let elapsed = self.rate.ticks_in(time.since(self.time));
        let ahead = counter.wrapping_sub(self.ticks as u32) as i64;
        if elapsed.unsigned_abs() >= HALF_WRAP as u64 {
            self.gaps = self.gaps.saturating_add(1);
        }
        // Whole wraps, to the nearest. An arithmetic shift rounds down, for negative numbers too.
        let wraps = elapsed.saturating_sub(ahead).saturating_add(HALF_WRAP) >> 32;
        self.ticks = self.ticks.saturating_add(wraps << 32).saturating_add(ahead);
        self.time = time;
        self.ticks
    }

    /// The last reading in 64 bits.
    #[must_use]
    pub const fn ticks(&self) -> i64 {
        self.ticks
    }

    /// A captured value in 64 bits, captured within half a wrap before or after the last step.
    #[must_use]
    pub const fn extend(&self, capture: u32) -> i64 {
        let from_step = capture.wrapping_sub(self.ticks as u32) as i32;
        self.ticks.saturating_add(from_step as i64)
    }

    /// Steps that came more than half a wrap after the step before (the first may be one of them):
    /// captures in between cannot be placed.
    #[must_use]
    pub const fn gaps(&self) -> u32 {
        self.gaps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;

    const FAST: u64 = 983_040_000;

    fn rate() -> impl Strategy<Value = TickRate> {
        let in_range = "in range";
        prop_oneof![
            prop_oneof![Just(FAST), Just(168_000_000), Just(84_000_000), Just(1_000_000)]
                .prop_map(move |hz| TickRate::new(hz).expect(in_range)),
            Just(TickRate::of_period(184).expect(in_range)),
        ]
    }

    /// The true count at a time, of a timer that is `offset_ticks` off and runs `ppb` fast.
    fn count(rate: TickRate, time: TimePs, ppb: i64, offset_ticks: i64) -> i64 {
        let (ticks, ps) = rate.ratio();
        let count = i128::from(time.0) * i128::from(ticks) * i128::from(1_000_000_000 + ppb);
        (count.div_euclid(i128::from(ps) * 1_000_000_000) + i128::from(offset_ticks)) as i64
    }

    proptest! {
        /// Over wraps, gaps of up to an hour and any start, readings and captures are placed where they
        /// were.
        #[test]
        fn truth_follows_the_count(
            rate in rate(),
            start_ms in -10_000_000..10_000_000_i64,
            ppb in -20_000..20_000_i64,
            offset_ticks in -1_000_000..1_000_000_i64,
            steps in vec((prop_oneof![Just(20_i64), 0..5_000_i64, 0..3_600_000_i64], -0.99..0.99_f64), 1..60),
        ) {
            let mut extender = TickExtender::new(rate);
            let mut ms = start_ms;
            for (step_ms, capture_at) in steps {
                ms += step_ms;
                let ticks = count(rate, TimePs::from_ms(ms), ppb, offset_ticks);
                prop_assert_eq!(extender.step(ticks as u32, TimePs::from_ms(ms)), ticks);
                let capture = ticks + (capture_at * HALF_WRAP as f64) as i64;
                prop_assert_eq!(extender.extend(capture as u32), capture);
            }
        }

        /// A timer that was never aligned keeps counting evenly at 50 Hz.
        #[test]
        fn is_even_without_alignment(rate in rate(), offset_ticks: i32, jitter_ticks in vec(0..1000_i64, 1..500)) {
            let mut extender = TickExtender::new(rate);
            let first = extender.step(offset_ticks as u32, TimePs(0));
            for (i, jitter) in jitter_ticks.into_iter().enumerate() {
                let time = TimePs::from_ms(20 * (i as i64 + 1));
                let ticks = rate.ticks_in(time) + jitter;
                let read = extender.step((i64::from(offset_ticks) + ticks) as u32, time);
                prop_assert_eq!(read - first, ticks);
            }
        }

        /// No reading and no time, however wrong, overflows.
        #[test]
        fn survives_anything(steps in vec((any::<u32>(), any::<i64>(), any::<u32>()), 0..100)) {
            let mut extender = TickExtender::new(TickRate::new(10_000_000_000).expect("not zero"));
            for (counter, ps, capture) in steps {
                let ticks = extender.step(counter, TimePs(ps));
                prop_assert_eq!(ticks as u32, counter);
                prop_assert!((extender.extend(capture) - ticks).abs() <= HALF_WRAP);
            }
        }
    }

    #[test]
    fn a_gap_is_counted() {
        let rate = TickRate::new(FAST).expect("not zero");
        let mut extender = TickExtender::new(rate);
        for second in [0, 2, 4, 7, 9] {
            let ticks = FAST as i64 * second;
            assert_eq!(extender.step(ticks as u32, TimePs::from_ms(1000 * second)), ticks);
        }
        assert_eq!(extender.gaps(), 1);
    }

    /// The last tick before and after half a wrap.
    #[test]
    fn captures_reach_half_a_wrap() {
        let mut extender = TickExtender::new(TickRate::new(FAST).expect("not zero"));
        let now = extender.step(5, TimePs(0));
        assert_eq!(extender.extend(5 + (HALF_WRAP as u32 - 1)), now + HALF_WRAP - 1);
        assert_eq!(extender.extend(5_u32.wrapping_sub(HALF_WRAP as u32)), now - HALF_WRAP);
    }
}
