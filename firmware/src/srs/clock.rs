//! Ticks of the capture timer as time, exactly.

use core::{fmt, num::NonZeroU32};
use skyroost_protocol::units::TimePs;

const PS_PER_S: i64 = 1_000_000_000_000;
/// Picoseconds in a microsecond, and microseconds in a second.
const MEGA: u64 = 1_000_000;

/// Ticks a second of the capture timer; never zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickRate(NonZeroU32);

/// A tick rate of zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ZeroTickRate;

impl fmt::Display for ZeroTickRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the capture timer must tick: found a rate of 0 Hz")
    }
}

impl core::error::Error for ZeroTickRate {}

impl TickRate {
    /// A rate in hertz.
    ///
    /// # Errors
    /// [`ZeroTickRate`] for 0.
    pub const fn new(hz: u32) -> Result<Self, ZeroTickRate> {
        match NonZeroU32::new(hz) {
            Some(hz) => Ok(Self(hz)),
            None => Err(ZeroTickRate),
        }
    }

    /// In hertz.
    #[must_use]
    pub const fn hz(self) -> u32 {
        self.0.get()
    }

    /// Time of so many ticks, rounded down to the picosecond; saturates beyond ±106 days.
    ///
    /// Each call rounds once and none builds on another, so that nothing drifts.
    #[must_use]
    pub fn time_of(self, ticks: i64) -> TimePs {
        let hz = i64::from(self.hz());
        let whole_s = ticks.div_euclid(hz);
        // Long division by the rate in two steps of 10^6: ticks of less than a second, below 2^32, times
        // 10^12 would not fit 64 bits.
        let us = ticks.rem_euclid(hz) as u64 * MEGA;
        let ps = us % hz as u64 * MEGA;
        let part_ps = us / hz as u64 * MEGA + ps / hz as u64;
        // Only the sum is clamped: a part of a second can bring it back into range.
        let sum = i128::from(whole_s) * i128::from(PS_PER_S) + i128::from(part_ps);
        TimePs(i64::try_from(sum).unwrap_or(if sum < 0 { i64::MIN } else { i64::MAX }))
    }

    /// Whole ticks in a time, rounded down.
    #[must_use]
    pub const fn ticks_in(self, time: TimePs) -> i64 {
        let hz = self.hz() as u64;
        let whole_s = time.0.div_euclid(PS_PER_S);
        let part_ps = time.0.rem_euclid(PS_PER_S) as u64;
        // The same two steps the other way; rounding down twice is rounding down once.
        let part = (part_ps / MEGA * hz + part_ps % MEGA * hz / MEGA) / MEGA;
        // At most 2^24 s times 2^32 Hz: no overflow.
        whole_s * hz as i64 + part as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The rates of the two boards, the extremes, and any other.
    fn rate() -> impl Strategy<Value = TickRate> {
        prop_oneof![Just(983_040_000), Just(84_000_000), Just(1), Just(u32::MAX), 1..u32::MAX]
            .prop_map(|hz| TickRate::new(hz).expect("not zero"))
    }

    fn time_reference(rate: TickRate, ticks: i64) -> i64 {
        let ps = (i128::from(ticks) * 1_000_000_000_000).div_euclid(i128::from(rate.hz()));
        ps.clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64
    }

    proptest! {
        #[test]
        fn truth_time_of_ticks(rate in rate(), ticks: i64, shift in 0..63) {
            for ticks in [ticks >> shift, 0, i64::MAX, i64::MIN] {
                prop_assert_eq!(rate.time_of(ticks).0, time_reference(rate, ticks));
            }
        }

        #[test]
        fn truth_ticks_in_time(rate in rate(), ps: i64, shift in 0..63) {
            for ps in [ps >> shift, 0, i64::MAX, i64::MIN] {
                let ticks = (i128::from(ps) * i128::from(rate.hz())).div_euclid(1_000_000_000_000);
                prop_assert_eq!(i128::from(rate.ticks_in(TimePs(ps))), ticks);
            }
        }
    }

    #[test]
    fn zero_is_no_rate() {
        assert_eq!(TickRate::new(0), Err(ZeroTickRate));
    }

    /// Two hundred years of ticks at the fastest board; the time itself ends at 106 days.
    #[test]
    fn saturates_for_centuries() {
        let rate = TickRate::new(983_040_000).expect("not zero");
        let ticks = 200 * 366 * 86_400 * i64::from(rate.hz());
        assert_eq!(rate.time_of(ticks), TimePs(i64::MAX));
        assert_eq!(rate.time_of(100 * 86_400 * i64::from(rate.hz())), TimePs(100 * 86_400 * PS_PER_S));
    }
}
