//! What no place of the user explains.
//!
//! Wherever the user is, its signal reaches two drones within their distance over the speed of light of each
//! other. A greater difference says that one of the captures came by a detour: the mate's where it is
//! positive, the serving drone's where it is negative.

use crate::scalar::root;
use skyroost_protocol::{
    message::{ClockState, TdoaFlags},
    units::{PosEnuMm, ToaSigma},
};

/// Clocks and captures may be off by so many of their standard deviations.
const SIGMAS: u64 = 4;
/// Light takes 3.335641 ps for a millimetre; rounded up, femtoseconds.
const FS_PER_MM: u64 = 3_336;
/// Distances end here, at three times the 640 km that a difference can carry, so that squares fit.
const MAX_MM: u64 = 1 << 30;

/// One of the two drones as it captured an occasion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// Where it was.
    pub pos: PosEnuMm,
    /// How well it captured the arrival.
    pub sigma: ToaSigma,
    /// Its clock.
    pub clock: ClockState,
}

/// What to know about a difference of `tdoa_ps` between two drones, each within `error_mm` of where it says:
/// whether it can be, or whether clocks that run free forbid to say so.
#[must_use]
pub fn judge(tdoa_ps: i64, serving: &End, mate: &End, error_mm: u16) -> TdoaFlags {
    let held = |end: &End| matches!(end.clock, ClockState::Held { .. });
    let flags = if held(serving) || held(mate) { TdoaFlags::HELD } else { TdoaFlags::default() };
    let (Some(serving_ns), Some(mate_ns)) = (serving.clock.sigma_ns(), mate.clock.sigma_ns()) else {
        return flags | TdoaFlags::UNJUDGED;
    };
    let square = |ps: u32| u64::from(ps) * u64::from(ps);
    let clocks = square(u32::from(serving_ns) * 1000) + square(u32::from(mate_ns) * 1000);
    let captures = square(serving.sigma.ps()) + square(mate.sigma.ps());
    let way_mm = distance_mm(serving.pos, mate.pos) + 2 * u64::from(error_mm);
    let limit_ps = (way_mm * FS_PER_MM).div_ceil(1000) + SIGMAS * u64::from(root(clocks + captures));
    if tdoa_ps.unsigned_abs() > limit_ps { flags | TdoaFlags::GATED } else { flags }
}

/// Distance of two places, rounded up; saturates beyond a thousand kilometres.
fn distance_mm(a: PosEnuMm, b: PosEnuMm) -> u64 {
    let squares = a.0.iter().zip(b.0).map(|(a, b)| u64::from(a.abs_diff(b)).min(MAX_MM).pow(2));
    u64::from(root(squares.sum())) + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn end(east_mm: i32, sigma_ps: u32, clock: ClockState) -> End {
        End { pos: PosEnuMm([east_mm, 0, 0]), sigma: ToaSigma::from_ps(sigma_ps), clock }
    }

    /// Fifty metres apart, 166.8 ns; captures of 5 ns and clocks of 3 add 4 · 8.2, half a metre of error each 3.3.
    #[test]
    fn the_margin_is_what_clocks_captures_and_positions_are_stated_to_be_off() {
        let clock = ClockState::Locked { sigma_ns: 3 };
        let (serving, mate) = (end(0, 5_000, clock), end(50_000, 5_000, clock));
        for (tdoa_ps, gated) in
            [(0, false), (202_900, false), (-202_900, false), (203_200, true), (-203_200, true)]
        {
            let expected = if gated { TdoaFlags::GATED } else { TdoaFlags::default() };
            assert_eq!(judge(tdoa_ps, &serving, &mate, 500), expected, "{tdoa_ps} ps");
        }
    }

    #[test]
    fn clocks_that_run_free_are_not_judged_by() {
        let locked = ClockState::Locked { sigma_ns: 3 };
        for free in [ClockState::Free, ClockState::Locked { sigma_ns: u16::MAX }] {
            for (one, other) in [(free, locked), (locked, free), (free, free)] {
                let flags = judge(i64::MAX, &end(0, 5_000, one), &end(50_000, 5_000, other), 0);
                assert_eq!(flags, TdoaFlags::UNJUDGED);
            }
        }
        let held = ClockState::Held { sigma_ns: 500 };
        let flags = judge(10_000_000, &end(0, 5_000, locked), &end(50_000, 5_000, held), 0);
        assert_eq!(flags, TdoaFlags::HELD | TdoaFlags::GATED);
        let flags = judge(10_000_000, &end(0, 5_000, ClockState::Free), &end(50_000, 5_000, held), 0);
        assert_eq!(flags, TdoaFlags::HELD | TdoaFlags::UNJUDGED);
    }

    proptest! {
        /// What the user's place and errors within three deviations make of a difference is never gated; what
        /// is beyond by more than rounding is.
        #[test]
        fn truth_a_difference_that_can_be_passes(
            a_m in prop::array::uniform3(-60.0..60.0_f64), b_m in prop::array::uniform3(-60.0..60.0_f64),
            user_m in prop::array::uniform3(-800.0..800.0_f64),
            sigmas_ps in prop::array::uniform4(300..60_000_u32),
            errors in prop::array::uniform4(-1.5..1.5_f64),
            beyond_ps in 0.0..1e9_f64,
        ) {
            let distance_m = |a: &[f64; 3], b: &[f64; 3]| {
                libm::sqrt(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>())
            };
            let ps_per_m = 1e12 / 299_792_458.0;
            let clock = |ps: u32| ClockState::Locked { sigma_ns: ps.div_ceil(1000) as u16 };
            let of = |at_m: &[f64; 3], sigma, clock_ps| End {
                pos: PosEnuMm(at_m.map(|m| libm::round(1e3 * m) as i32)),
                sigma: ToaSigma::from_ps(sigma),
                clock: clock(clock_ps),
            };
            let [serving_ps, mate_ps, serving_clock_ps, mate_clock_ps] = sigmas_ps;
            let serving = of(&a_m, serving_ps, serving_clock_ps);
            let mate = of(&b_m, mate_ps, mate_clock_ps);
            let off_ps: f64 = sigmas_ps.iter().zip(errors).map(|(sigma, error)| f64::from(*sigma) * error).sum();
            let true_ps = (distance_m(&b_m, &user_m) - distance_m(&a_m, &user_m)) * ps_per_m;
            // Errors of 1.5 deviations in the same direction are three of the four together at most.
            let flags = judge((true_ps + off_ps) as i64, &serving, &mate, 0);
            prop_assert_eq!(flags, TdoaFlags::default());
            let variance: f64 = sigmas_ps.iter().map(|sigma| (f64::from(*sigma) + 1_008.0) * (f64::from(*sigma) + 1_008.0)).sum();
            let limit_ps = (distance_m(&a_m, &b_m) + 0.005) * ps_per_m + 4.0 * libm::sqrt(variance);
            prop_assert_eq!(judge((limit_ps + beyond_ps) as i64 + 10, &serving, &mate, 0), TdoaFlags::GATED);
        }

        /// No two drones are too far apart to be judged.
        #[test]
        fn survives_anything(tdoa_ps: i64, a: [i32; 3], b: [i32; 3], sigmas: [u16; 4], error_mm: u16) {
            let clock = |sigma_ns| ClockState::Held { sigma_ns };
            let serving = End { pos: PosEnuMm(a), sigma: ToaSigma(sigmas[0]), clock: clock(sigmas[1]) };
            let mate = End { pos: PosEnuMm(b), sigma: ToaSigma(sigmas[2]), clock: clock(sigmas[3]) };
            let _ = judge(tdoa_ps, &serving, &mate, error_mm);
        }
    }
}
