//! The symbols of one SRS, captured one by one, as one arrival.
//!
//! An SRS may be repeated over 2 or 4 symbols of its slot (TS 38.214, 6.2.1; TS 38.211, 6.4.1.4.3). Each symbol is
//! captured with noise of its own, by the same path: referred to the first symbol they all say the same, and
//! their mean says it better.

use super::{slots::Slots, words::Words};
use crate::scalar::root;
use skyroost_protocol::units::{DroneId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId};

/// Most symbols of one SRS.
pub const MAX_SYMBOLS: u8 = 4;
/// Occasions whose symbols are waited for: as many as a step can have captured in full.
const MAX_WAITING: usize = 4;
/// A symbol this many standard deviations off the median is left out: of its noise and the median's, four.
const AGREES_SIGMAS: u32 = 6;

/// Nominal time from the first symbol to another at 30 kHz subcarriers: (2048 + 144) κ / 2 T_c = 35.677 µs
/// each, none of them the longer one that begins every half subframe, as an SRS lies in the last six symbols of
/// a slot (TS 38.211, 5.3.1 and 6.4.1.4.3).
#[must_use]
pub const fn symbol_time(symbol: u8) -> TimePs {
    // 70,144 T_c are 35,677,083 1/3 ps.
    TimePs((symbol as i64 * 107_031_250 + 1) / 3)
}

/// What all captures of an occasion have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// The occasion.
    pub occasion: OccasionId,
    /// The user that transmitted.
    pub user: UserId,
    /// Who forms the differences.
    pub serving: DroneId,
    /// Where this drone was.
    pub pos: PosEnuMm,
}

/// One symbol's capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Symbol {
    /// Which of the symbols, from 0.
    pub number: u8,
    /// Its arrival.
    pub toa: TimePs,
    /// Standard deviation of it.
    pub sigma: ToaSigma,
}

/// The arrival of a whole SRS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Whose, where.
    pub heard: Heard,
    /// Arrival of the first symbol.
    pub toa: TimePs,
    /// Standard deviation of it.
    pub sigma: ToaSigma,
    /// Symbols that did not agree with the others and were left out.
    pub excluded: u8,
}

/// Collects symbols to arrivals.
///
/// An arrival is complete with its last symbol; what lacks some is handed over a step after its first one, as
/// the symbols of an SRS are captured within two steps at most.
#[derive(Clone, Debug)]
pub struct Bursts {
    symbols: u8,
    waiting: Slots<Burst, MAX_WAITING>,
}

/// The symbols of one occasion so far.
#[derive(Clone, Copy, Debug)]
struct Burst {
    heard: Heard,
    /// The first that came, referred to the first symbol.
    reference: Words,
    /// Each symbol, referred to the first, less the reference, picoseconds.
    offsets_ps: [i32; MAX_SYMBOLS as usize],
    /// A bit for each symbol that came.
    came: u8,
    /// A step has passed.
    waited: bool,
    /// The greatest of all symbols.
    sigma: ToaSigma,
}

impl Bursts {
    /// Nothing captured yet; an SRS has so many `symbols`, at most [`MAX_SYMBOLS`].
    #[must_use]
    pub const fn new(symbols: u8) -> Self {
        const NOTHING: Burst = Burst {
            heard: Heard {
                occasion: OccasionId(0),
                user: UserId(0),
                serving: DroneId(0),
                pos: PosEnuMm([0; 3]),
            },
            reference: Words::new(TimePs(0)),
            offsets_ps: [0; MAX_SYMBOLS as usize],
            came: 0,
            waited: false,
            sigma: ToaSigma(0),
        };
        Self { symbols, waiting: Slots::new(NOTHING) }
    }

    /// Forgets everything; an SRS has so many `symbols`.
    pub const fn restart(&mut self, symbols: u8) {
        self.symbols = symbols;
        self.waiting.clear();
    }

    /// Whether no symbols are waited for.
    #[must_use]
    pub const fn are_none(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Takes a symbol; false when there is no such symbol or it has come before. Whatever is complete by it, or
    /// must make room for it, arrives.
    pub fn take(&mut self, heard: Heard, symbol: Symbol, mut arrive: impl FnMut(Arrival)) -> bool {
        let bit = 1_u8.checked_shl(symbol.number.into()).unwrap_or(0);
        let all = self.all();
        if bit & all == 0 {
            return false;
        }
        let age = match self.waiting.position(|burst| burst.heard.occasion == heard.occasion) {
            Some(age) => age,
            None => {
                if self.waiting.is_full() {
                    if let Some(oldest) = self.waiting.get_mut(0) {
                        arrive(oldest.arrival());
                    }
                    self.waiting.remove(0);
                }
                self.waiting.push(Burst::begun_by(heard, symbol));
                self.waiting.len().saturating_sub(1)
            }
        };
        let Some(burst) = self.waiting.get_mut(age) else { return false };
        if burst.came & bit != 0 {
            return false;
        }
        burst.add(symbol, bit);
        if burst.came == all {
            arrive(burst.arrival());
            self.waiting.remove(age);
        }
        true
    }

    /// A step is over: what lacks symbols since the step before arrives without.
    pub fn settle(&mut self, mut arrive: impl FnMut(Arrival)) {
        self.waiting.retain_mut(|burst| {
            if burst.waited {
                arrive(burst.arrival());
            }
            !core::mem::replace(&mut burst.waited, true)
        });
    }

    /// A bit for each symbol that there is.
    const fn all(&self) -> u8 {
        let symbols = if self.symbols < MAX_SYMBOLS { self.symbols } else { MAX_SYMBOLS };
        (1 << symbols) - 1
    }
}

impl Burst {
    const fn begun_by(heard: Heard, symbol: Symbol) -> Self {
        let reference = Words::new(symbol.toa.since(symbol_time(symbol.number)));
        let offsets_ps = [0; MAX_SYMBOLS as usize];
        Self { heard, reference, offsets_ps, came: 0, waited: false, sigma: ToaSigma(0) }
    }

    fn add(&mut self, symbol: Symbol, bit: u8) {
        let toa = symbol.toa.since(symbol_time(symbol.number));
        let offset_ps = toa.since(self.reference.time()).0;
        if let Some(place) = self.offsets_ps.get_mut(usize::from(symbol.number)) {
            // Clamped at 2 ms, far beyond agreement.
            *place = offset_ps.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        }
        self.came |= bit;
        self.sigma = self.sigma.max(symbol.sigma);
    }

    /// The mean of the symbols that agree with their median; with the lower one of two, so that of two that
    /// disagree the earlier is believed: reflections are late.
    fn arrival(&self) -> Arrival {
        let came = || (self.offsets_ps.iter().zip(0..)).filter(|(_, bit)| self.came >> bit & 1 == 1);
        let count = self.came.count_ones() as usize;
        let rank = |one: (&i32, u8)| came().filter(|other| *other < one).count();
        let median_ps = came().find(|one| rank(*one) == count.saturating_sub(1) / 2).map_or(0, |(ps, _)| *ps);
        let limit_ps = self.sigma.ps() * AGREES_SIGMAS;
        let agreeing = || came().filter(|(ps, _)| ps.abs_diff(median_ps) <= limit_ps);
        let used = agreeing().count().max(1) as i64;
        let sum_ps: i64 = agreeing().map(|(ps, _)| i64::from(*ps)).sum();
        let mean_ps = sum_ps.div_euclid(used);
        let variance = u64::from(self.sigma.ps()).pow(2) / used as u64;
        Arrival {
            heard: self.heard,
            toa: self.reference.time().after(TimePs(mean_ps)),
            sigma: ToaSigma::from_ps(root(variance)),
            excluded: count.saturating_sub(used as usize) as u8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection::vec, prelude::*};

    const SIGMA: ToaSigma = ToaSigma(625); // 5 ns

    fn heard(occasion: u32) -> Heard {
        Heard {
            occasion: OccasionId(occasion),
            user: UserId(occasion),
            serving: DroneId(1),
            pos: PosEnuMm([1, 2, 3]),
        }
    }

    fn symbol(number: u8, off_ps: i64) -> Symbol {
        Symbol { number, toa: symbol_time(number).after(TimePs(1_000_000 + off_ps)), sigma: SIGMA }
    }

    /// Takes symbols of one occasion and returns what arrives with them and, after it, with the step's end.
    fn arrivals(bursts: &mut Bursts, symbols: &[Symbol]) -> Vec<Arrival> {
        let mut found = Vec::new();
        for symbol in symbols {
            assert!(bursts.take(heard(1), *symbol, |arrival| found.push(arrival)));
        }
        bursts.settle(|arrival| found.push(arrival));
        found
    }

    #[test]
    fn a_single_symbol_arrives_as_it_came() {
        let found = arrivals(&mut Bursts::new(1), &[symbol(0, 7)]);
        let expected = Arrival { heard: heard(1), toa: TimePs(1_000_007), sigma: SIGMA, excluded: 0 };
        assert_eq!(found, [expected]);
    }

    #[test]
    fn the_mean_of_four_is_twice_as_good() {
        let mut bursts = Bursts::new(4);
        let symbols = [symbol(2, 3_000), symbol(0, 1_000), symbol(3, -2_000), symbol(1, 4_000)];
        let found = arrivals(&mut bursts, &symbols);
        assert_eq!(found.len(), 1, "with the last one");
        assert_eq!(found[0].toa, TimePs(1_001_500));
        assert_eq!(found[0].sigma, ToaSigma::from_ps(2_500));
    }

    #[test]
    fn what_lacks_symbols_waits_for_a_step() {
        let mut bursts = Bursts::new(4);
        assert!(arrivals(&mut bursts, &[symbol(3, 2_000), symbol(1, 0)]).is_empty());
        let found = arrivals(&mut bursts, &[symbol(0, 1_000)]);
        assert_eq!(
            (found[0].toa, found[0].sigma.ps()),
            (TimePs(1_001_000), 2_888),
            "over the square root of three"
        );
        assert!(bursts.are_none());
    }

    #[test]
    fn symbols_come_once_and_as_many_as_there_are() {
        let mut bursts = Bursts::new(2);
        let mut nothing = |arrival| panic!("{arrival:?}");
        assert!(bursts.take(heard(1), symbol(1, 0), &mut nothing));
        for number in [1, 2, 7, 8, u8::MAX] {
            assert!(!bursts.take(heard(1), Symbol { number, ..symbol(0, 0) }, &mut nothing), "{number}");
        }
    }

    #[test]
    fn a_stray_symbol_is_left_out_and_of_two_that_disagree_the_earlier_is_believed() {
        let strays = [symbol(0, 0), symbol(1, 400_000), symbol(2, 2_000), symbol(3, 1_000)];
        let found = arrivals(&mut Bursts::new(4), &strays);
        assert_eq!((found[0].toa, found[0].excluded), (TimePs(1_001_000), 1));
        let found = arrivals(&mut Bursts::new(2), &[symbol(0, 200_000), symbol(1, 300)]);
        assert_eq!((found[0].toa, found[0].sigma, found[0].excluded), (TimePs(1_000_300), SIGMA, 1));
    }

    #[test]
    fn the_oldest_makes_room_and_loses_nothing_but_its_missing_symbols() {
        let mut bursts = Bursts::new(2);
        let mut found = Vec::new();
        for occasion in 0..6 {
            assert!(
                bursts.take(heard(occasion), symbol(0, 0), |arrival| found.push(arrival.heard.occasion.0))
            );
        }
        assert_eq!(found, [0, 1]);
        bursts.settle(|_| panic!("they came in this step"));
        bursts.settle(|arrival| found.push(arrival.heard.occasion.0));
        assert_eq!(found, [0, 1, 2, 3, 4, 5]);
    }

    /// The rule in wide integers and its own words.
    fn reference(toas_ps: &[i128], sigma_ps: i128) -> (i128, usize) {
        let mut sorted = toas_ps.to_vec();
        sorted.sort_unstable();
        let median = sorted[(sorted.len() - 1) / 2];
        sorted.retain(|toa| (toa - median).abs() <= 6 * sigma_ps);
        (sorted.iter().sum::<i128>().div_euclid(sorted.len() as i128), toas_ps.len() - sorted.len())
    }

    proptest! {
        /// In any order, with any symbols missing and any of them stray: the mean of what agrees, to the
        /// rounding of two divisions.
        #[test]
        fn truth_is_the_mean_of_what_agrees(
            base_ps in -1_000_000_000_000_000_000..1_000_000_000_000_000_000_i64,
            off_ps in vec(prop_oneof![3 => -15_000..15_000_i64, 1 => -3_000_000_000..3_000_000_000_i64], 4),
            order in Just([0_u8, 1, 2, 3]).prop_shuffle(),
            count in 1..=4_usize,
        ) {
            let mut bursts = Bursts::new(4);
            let came = &order[..count];
            let at = |number: u8| symbol_time(number).after(TimePs(base_ps + off_ps[usize::from(number)]));
            let symbols: Vec<_> =
                came.iter().map(|&number| Symbol { number, toa: at(number), sigma: SIGMA }).collect();
            let mut found = arrivals(&mut bursts, &symbols);
            found.extend(arrivals(&mut bursts, &[]));
            let clamp = |ps: i64| {
                // Offsets of milliseconds saturate: from the symbol that came first.
                let first = off_ps[usize::from(came[0])];
                i128::from(first + (ps - first).clamp(i32::MIN.into(), i32::MAX.into()))
            };
            let toas: Vec<_> =
                came.iter().map(|&number| i128::from(base_ps) + clamp(off_ps[usize::from(number)])).collect();
            let (mean, excluded) = reference(&toas, SIGMA.ps().into());
            prop_assert_eq!(found.len(), 1);
            prop_assert!((i128::from(found[0].toa.0) - mean).abs() <= 1, "{:?} {mean}", found[0]);
            prop_assert_eq!(usize::from(found[0].excluded), excluded);
            let sigma_ps = f64::from(SIGMA.ps()) / libm::sqrt((count - excluded) as f64);
            prop_assert!((0.0..=9.0).contains(&(f64::from(found[0].sigma.ps()) - sigma_ps + 1.0)));
        }

        /// Nothing is too much, times that jump included.
        #[test]
        fn survives_anything(
            symbols: u8,
            steps in vec((0..8_u32, any::<u8>(), any::<i64>(), any::<u16>(), any::<bool>()), 0..200),
        ) {
            let mut bursts = Bursts::new(symbols);
            for (occasion, number, ps, sigma, settle) in steps {
                let symbol = Symbol { number: number % 6, toa: TimePs(ps), sigma: ToaSigma(sigma) };
                let _ = bursts.take(heard(occasion), symbol, |_| ());
                if settle {
                    bursts.settle(|_| ());
                }
            }
        }
    }
}
