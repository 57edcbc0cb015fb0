//! Ticks of the capture timer as time, exactly.

use core::{fmt, num::NonZeroU64};
use skyroost_protocol::units::TimePs;

const PS_PER_S: u64 = 1_000_000_000_000;
/// The shortest tick. The finest of today's timers have 184 ps (STM32G4, HRTIM).
const LEAST_PERIOD_PS: u64 = 100;
/// The fastest timer.
const MAX_HZ: u64 = PS_PER_S / LEAST_PERIOD_PS;
/// Products are formed from pieces of so many bits, so that all of them fit 64.
const PIECE: u32 = 20;

/// Rate of the capture timer: so many ticks in so many picoseconds, in lowest terms. A ratio, because the
/// usual rates are no whole picoseconds a tick and the finest no whole hertz; as one, every rate converts
/// exactly (983.04 MHz: 384 ticks in 390,625 ps).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickRate {
    ticks: NonZeroU64,
    ps: NonZeroU64,
}

/// A rate that no capture timer has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadTickRate;

impl fmt::Display for BadTickRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the capture timer must tick from once a second to {MAX_HZ} times")
    }
}

impl core::error::Error for BadTickRate {}

impl TickRate {
    /// A rate in hertz.
    ///
    /// # Errors
    /// [`BadTickRate`] for 0 and above 10 GHz.
    pub const fn new(hz: u64) -> Result<Self, BadTickRate> {
        Self::of_ticks(hz, PS_PER_S)
    }

    /// The rate of ticks of so many picoseconds.
    ///
    /// # Errors
    /// [`BadTickRate`] below 100 and above 10^12.
    pub const fn of_period(ps: u64) -> Result<Self, BadTickRate> {
        Self::of_ticks(1, ps)
    }

    /// So many `ticks` in `ps` picoseconds.
    ///
    /// # Errors
    /// [`BadTickRate`] for more than 10^10 ticks a second, and for a ratio that takes more than 10^12 ps in its
    /// lowest terms.
    pub const fn of_ticks(ticks: u64, ps: u64) -> Result<Self, BadTickRate> {
        let (Some(ticks), Some(ps)) = (NonZeroU64::new(ticks), NonZeroU64::new(ps)) else {
            return Err(BadTickRate);
        };
        let common = gcd(ticks, ps);
        let (Some(ticks), Some(ps)) =
            (NonZeroU64::new(ticks.get() / common.get()), NonZeroU64::new(ps.get() / common.get()))
        else {
            return Err(BadTickRate);
        };
        // The second says that there are 10^10 of them at most.
        if ps.get() <= PS_PER_S && ps.get() / LEAST_PERIOD_PS >= ticks.get() {
            Ok(Self { ticks, ps })
        } else {
            Err(BadTickRate)
        }
    }

    /// The ratio, in lowest terms: ticks, and the picoseconds they take.
    #[must_use]
    pub const fn ratio(self) -> (u64, u64) {
        (self.ticks.get(), self.ps.get())
    }

    /// Picoseconds of a tick, rounded up.
    #[must_use]
    pub const fn tick_ps(self) -> u64 {
        self.ps.get().div_ceil(self.ticks.get())
    }

    /// Standard deviation of where in its tick an edge lies: a tick over sqrt(12). Saturates.
    #[must_use]
    pub const fn tick_sigma_ps(self) -> u32 {
        // No tick is longer than a second; 0.2887 of one fits 64 bits with room, and 32 up to 14 ms.
        let sigma = self.tick_ps() * 2887 / 10_000;
        if sigma > u32::MAX as u64 { u32::MAX } else { sigma as u32 }
    }

    /// Time of so many ticks, rounded down to the picosecond; saturates beyond ±106 days.
    ///
    /// Each call rounds once and none builds on another, so that nothing drifts.
    #[must_use]
    pub fn time_of(self, ticks: i64) -> TimePs {
        TimePs(scale(ticks, self.ps, self.ticks))
    }

    /// Whole ticks in a time, rounded down; saturates.
    #[must_use]
    pub fn ticks_in(self, time: TimePs) -> i64 {
        scale(time.0, self.ticks, self.ps)
    }
}

/// floor(`value` · `times` / `over`) for factors of a rate, saturating.
fn scale(value: i64, times: NonZeroU64, over: NonZeroU64) -> i64 {
    let times = times.get();
    // Never beyond 10^12: nothing below overflows, nor does anything change sign.
    let whole = value.wrapping_div_euclid(over.get() as i64);
    let rest = value.wrapping_rem_euclid(over.get() as i64) as u64;
    // Long division, the factor's upper bits first: rounding down twice is rounding down once.
    let (high, low) = (times >> PIECE, times & ((1 << PIECE) - 1));
    let upper = rest * high;
    let lower = ((upper % over) << PIECE) + rest * low;
    let part = ((upper / over) << PIECE) + lower / over;
    // Only the sum is clamped: a part can bring it back into range.
    let sum = i128::from(whole) * i128::from(times) + i128::from(part);
    i64::try_from(sum).unwrap_or(if sum < 0 { i64::MIN } else { i64::MAX })
}

/// Greatest common divisor by Euclid: at most 93 divisions for 64 bits.
const fn gcd(mut a: NonZeroU64, mut b: NonZeroU64) -> NonZeroU64 {
    while let Some(rest) = NonZeroU64::new(a.get() % b.get()) {
        (a, b) = (b, rest);
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The rates of the boards, those of fast timers, the extremes, and any other.
    fn rate() -> impl Strategy<Value = TickRate> {
        let hz = prop_oneof![
            Just(983_040_000),
            Just(84_000_000),
            Just(168_000_000),
            Just(5_440_000_000),
            Just(1),
            Just(MAX_HZ - 1),
            Just(MAX_HZ),
            1..=MAX_HZ
        ];
        let period = prop_oneof![Just(184), Just(100), Just(PS_PER_S), 100..=PS_PER_S];
        prop_oneof![
            4 => hz.prop_map(|hz| TickRate::new(hz).expect("in range")),
            1 => period.prop_map(|ps| TickRate::of_period(ps).expect("in range")),
        ]
    }

    fn reference(value: i64, times: u64, over: u64) -> i64 {
        let exact = (i128::from(value) * i128::from(times)).div_euclid(i128::from(over));
        exact.clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64
    }

    proptest! {
        #[test]
        fn truth_time_of_ticks(rate in rate(), ticks: i64, shift in 0..63) {
            let (per, ps) = rate.ratio();
            for ticks in [ticks >> shift, 0, i64::MAX, i64::MIN] {
                prop_assert_eq!(rate.time_of(ticks).0, reference(ticks, ps, per));
            }
        }

        #[test]
        fn truth_ticks_in_time(rate in rate(), ps: i64, shift in 0..63) {
            let (ticks, per) = rate.ratio();
            for ps in [ps >> shift, 0, i64::MAX, i64::MIN] {
                prop_assert_eq!(rate.ticks_in(TimePs(ps)), reference(ps, ticks, per));
            }
        }

        /// A rate in hertz has that many ticks a second, and nothing else is made of a ratio.
        #[test]
        fn truth_of_the_ratio(hz in 1..=MAX_HZ, of in 1..1_000_u64) {
            let rate = TickRate::new(hz).expect("in range");
            prop_assert_eq!(rate.ticks_in(TimePs(PS_PER_S as i64)), hz as i64);
            prop_assert_eq!(rate.time_of(hz as i64), TimePs(PS_PER_S as i64));
            prop_assert_eq!(TickRate::of_ticks(hz * of, PS_PER_S * of), Ok(rate));
        }

        /// Any ratio is a rate or refused; none overflows.
        #[test]
        fn survives_anything(ticks: u64, ps: u64, value: i64) {
            if let Ok(rate) = TickRate::of_ticks(ticks, ps) {
                let _ = (rate.time_of(value), rate.ticks_in(TimePs(value)), rate.tick_ps());
            }
        }
    }

    #[test]
    fn no_timer_stands_still_or_runs_away() {
        for bad in [TickRate::new(0), TickRate::new(MAX_HZ + 1), TickRate::of_period(0)] {
            assert_eq!(bad, Err(BadTickRate));
        }
        assert_eq!(TickRate::of_period(99), Err(BadTickRate));
        assert_eq!(TickRate::of_period(PS_PER_S + 1), Err(BadTickRate));
        assert_eq!(TickRate::of_ticks(1, 0), Err(BadTickRate));
    }

    #[test]
    fn ratios_are_in_lowest_terms() {
        let ratio = |rate: Result<TickRate, BadTickRate>| rate.expect("in range").ratio();
        assert_eq!(ratio(TickRate::new(983_040_000)), (384, 390_625));
        assert_eq!(ratio(TickRate::new(84_000_000)), (21, 250_000));
        assert_eq!(ratio(TickRate::of_period(184)), (1, 184));
    }

    /// Two hundred years of ticks at the fastest board; the time itself ends at 106 days.
    #[test]
    fn saturates_for_centuries() {
        const HZ: i64 = 983_040_000;
        let rate = TickRate::new(HZ as u64).expect("in range");
        assert_eq!(rate.time_of(200 * 366 * 86_400 * HZ), TimePs(i64::MAX));
        assert_eq!(rate.time_of(100 * 86_400 * HZ), TimePs(100 * 86_400 * PS_PER_S as i64));
    }
}
