//! From the timer's captures to differences of arrival time, all of it at once, against a model in 128-bit integers:
//! over wraps, with oscillators of any error, pulses lost, symbols lost and stray, and captures of mates that
//! come late, twice, in any order or not at all.
#![allow(missing_docs)]

use proptest::{collection::vec, prelude::*, sample::select};
use skyroost_firmware::{
    STEP_US, Vec3,
    config::AgentConfig,
    counters::Counters,
    io::{Capture, Inputs, NavFix, Outputs, Pulse},
    srs::{Srs, burst::symbol_time, clock::TickRate},
};
use skyroost_protocol::{
    message::{CaptureEntry, ClockState, SrsRequest, SrsRequestEntry, TdoaCounts, TdoaEntry, TdoaFlags},
    units::{DroneId, OccasionId, TimePs, ToaSigma, UserId},
};
use std::collections::BTreeMap;

const S: i128 = 1_000_000_000_000;
const STEP_PS: i128 = STEP_US as i128 * 1_000_000;
/// The first is the serving drone.
const DRONES: [DroneId; 3] = [DroneId(4), DroneId(9), DroneId(6)];
const POS_M: [[f32; 3]; 3] = [[0.0, 0.0, 300.0], [50.0, 0.0, 300.0], [25.0, 43.25, 301.5]];
const ERROR_M: f32 = 0.5;
/// Before this second clocks lock and nobody is asked.
const FIRST: i128 = 10;

/// One drone's oscillator.
#[derive(Clone, Copy, Debug)]
struct Timer {
    rate: TickRate,
    ppb: i64,
    offset_ps: i64,
}

impl Timer {
    /// Its count at a true time.
    fn count(&self, true_ps: i128) -> i128 {
        let (ticks, ps) = self.rate.ratio();
        let e9 = 1_000_000_000;
        let local_e9 = true_ps * (e9 + i128::from(self.ppb)) + i128::from(self.offset_ps) * e9;
        (local_e9 * i128::from(ticks)).div_euclid(i128::from(ps) * e9)
    }

    /// What it says by itself at a true time, picoseconds.
    fn free_ps(&self, true_ps: i128) -> i128 {
        let (ticks, ps) = self.rate.ratio();
        (self.count(true_ps) * i128::from(ps)).div_euclid(i128::from(ticks))
    }
}

/// What happens to one drone in one second.
#[derive(Clone, Copy, Debug)]
struct Fortune {
    pulse: bool,
    pulse_off_ps: i64,
    /// Way from the user, and a detour.
    way_ps: i64,
    /// Noise of each symbol, none where it is not captured.
    symbols_ps: [Option<i64>; 4],
    /// Steps until the capture reaches the serving drone, if it does, and until it does so again.
    delivered: Option<(u8, Option<u8>)>,
}

/// One second.
#[derive(Clone, Debug)]
struct Second {
    /// When the user transmits.
    at_ps: i64,
    drones: [Fortune; 3],
}

fn fortune() -> impl Strategy<Value = Fortune> + Clone {
    let symbol = prop_oneof![
        12 => (-10_000..10_000_i64).prop_map(Some),
        // Late by whole microseconds, so that strays agree or do not.
        1 => (1..9_i64, -5_000..5_000_i64).prop_map(|(us, off_ps)| Some(us * 1_000_000 + off_ps)),
        2 => Just(None),
    ];
    let way = prop_oneof![4 => 1_000_000..1_100_000_i64, 1 => 1_100_000..2_000_000_i64];
    let again = proptest::option::weighted(0.2, 1..10_u8);
    let delivered = proptest::option::weighted(0.9, (1..10_u8, again));
    (
        proptest::bool::weighted(0.7),
        -60_000..60_000_i64,
        way,
        [symbol.clone(), symbol.clone(), symbol.clone(), symbol],
        delivered,
    )
        .prop_map(|(pulse, pulse_off_ps, way_ps, symbols_ps, delivered)| Fortune {
            pulse,
            pulse_off_ps,
            way_ps,
            symbols_ps,
            delivered,
        })
}

fn second() -> impl Strategy<Value = Second> {
    // Mostly anywhere, sometimes so that a step ends among the symbols.
    let at = prop_oneof![
        2 => 0..900_000_000_000_i64,
        1 => (1..45_i64, -110_000_000..10_000_000_i64).prop_map(|(step, off)| step * STEP_PS as i64 + off),
    ];
    (at, [fortune(), fortune(), fortune()]).prop_map(|(at_ps, drones)| Second { at_ps, drones })
}

fn timer(rate: TickRate) -> impl Strategy<Value = Timer> + Clone {
    let offset = prop_oneof![-1_000_000..1_000_000_i64, -200_000_000_000..200_000_000_000_i64];
    (-20_000..=20_000_i64, offset).prop_map(move |(ppb, offset_ps)| Timer { rate, ppb, offset_ps })
}

#[derive(Clone, Debug)]
struct Flight {
    timers: [Timer; 3],
    symbols: u8,
    pulses: bool,
    seconds: Vec<Second>,
}

fn flight() -> impl Strategy<Value = Flight> {
    let rates = [TickRate::new(84_000_000), TickRate::new(168_000_000), TickRate::of_period(184)];
    let rate = select(rates.map(|rate| rate.expect("in range")).to_vec());
    rate.prop_flat_map(|rate| {
        let timers = [timer(rate), timer(rate), timer(rate)];
        (timers, select(vec![1_u8, 2, 4]), any::<bool>(), vec(second(), 4..25))
    })
    .prop_map(|(timers, symbols, pulses, seconds)| Flight { timers, symbols, pulses, seconds })
}

/// What came of it.
struct Flown {
    entries: Vec<TdoaEntry>,
    counts: TdoaCounts,
    counters: Vec<Counters>,
    /// What mates said, by occasion and mate, and the serving drone's clock while it captured each.
    said: BTreeMap<(u32, usize), CaptureEntry>,
    own_clock: BTreeMap<u32, ClockState>,
}

impl Flight {
    /// Times, as true ones, at which a drone's symbols are captured in a second.
    fn captured_ps(&self, index: usize, drone: usize) -> impl Iterator<Item = (u8, i128)> {
        let second = &self.seconds[index];
        let sent = (FIRST + index as i128) * S + i128::from(second.at_ps);
        let fortune = second.drones[drone];
        (0..self.symbols).filter_map(move |symbol| {
            let noise = fortune.symbols_ps[usize::from(symbol)]?;
            let at = sent + i128::from(fortune.way_ps + noise + symbol_time(symbol).0);
            Some((symbol, at))
        })
    }

    fn fly(&self) -> Flown {
        let mut config = AgentConfig::new(DRONES[0]);
        config.srs_symbols = self.symbols;
        (config.oscillator.rate, config.oscillator.pulse_ps) = (self.timers[0].rate, 35_000);
        let mut srs = [0, 1, 2].map(|_| Srs::new(&config));
        let mut counters = vec![Counters::new(); 3];
        let mut on_the_way: Vec<(i128, usize, CaptureEntry)> = Vec::new();
        let mut flown = Flown {
            entries: Vec::new(),
            counts: TdoaCounts::NONE,
            counters: Vec::new(),
            said: BTreeMap::new(),
            own_clock: BTreeMap::new(),
        };
        let end = FIRST + self.seconds.len() as i128 + 2;
        for step in 0..end * 50 {
            let (then, now) = ((step - 1) * STEP_PS, step * STEP_PS);
            let now_ps = TimePs(now as i64);
            let index = |at: i128| usize::try_from(at.div_euclid(S) - FIRST).ok();
            let this = index(now).filter(|index| *index < self.seconds.len());
            for drone in 0..3 {
                let timer = &self.timers[drone];
                if step % 50 == 0
                    && let Some(this) = this
                {
                    let start = TimePs(now_ps.0 + self.seconds[this].at_ps);
                    let entry = SrsRequestEntry { user: UserId(7), serving: DRONES[0] };
                    let first_occasion = OccasionId(this as u32);
                    let entries = [entry].into_iter().collect();
                    let request = SrsRequest { start, spacing: TimePs(0), first_occasion, entries };
                    srs[drone].announce(now_ps, &request, &mut counters[drone]);
                }
                let mut inputs = Inputs::new();
                inputs.timer_ticks = timer.count(now) as u32;
                // The pulse of this second reaches the drone a step after it.
                let second = then.div_euclid(S);
                if self.pulses && step % 50 == 1 && second > 0 {
                    let fortune =
                        index(then).and_then(|index| self.seconds.get(index)).map(|s| s.drones[drone]);
                    if fortune.is_none_or(|fortune| fortune.pulse) {
                        let off_ps = fortune.map_or(0, |fortune| fortune.pulse_off_ps);
                        let ticks = timer.count(second * S + i128::from(off_ps)) as u32;
                        inputs.pulse = Some(Pulse { ticks, second: second as i32 });
                    }
                }
                // Symbols of the last second may be captured in this one.
                for index in [this, this.and_then(|this| this.checked_sub(1))].into_iter().flatten() {
                    for (symbol, at) in self.captured_ps(index, drone) {
                        if (then + 1..=now).contains(&at) {
                            let occasion = OccasionId(index as u32);
                            let ticks = timer.count(at) as u32;
                            let sigma = ToaSigma::from_ps(5_000);
                            inputs.captures.push(Capture { occasion, ticks, symbol, sigma }).expect("four");
                            if drone == 0 {
                                flown.own_clock.insert(index as u32, ClockState::Free);
                            }
                        }
                    }
                }
                if drone == 0 {
                    on_the_way.retain(|(due, mate, entry)| {
                        if *due <= step {
                            srs[0].mate(now_ps, DRONES[0], DRONES[*mate], entry);
                        }
                        *due > step
                    });
                }
                let fix = NavFix {
                    pos_enu_m: Vec3::from(POS_M[drone]),
                    vel_enu_mps: Vec3::zeros(),
                    error_radius_m: ERROR_M,
                };
                let mut outputs = Outputs::new();
                srs[drone].step(
                    now_ps,
                    &inputs,
                    Some(&fix),
                    DRONES[drone],
                    &mut outputs,
                    &mut counters[drone],
                );
                if drone == 0 {
                    let state = srs[0].clock_state();
                    for capture in &inputs.captures {
                        flown.own_clock.insert(capture.occasion.0, state);
                    }
                    flown.entries.extend(std::iter::from_fn(|| srs[0].pop_tdoa(now_ps)));
                } else {
                    srs[drone].drain_for_mates(5, |page| {
                        for entry in page {
                            let index = entry.occasion.0 as usize;
                            flown.said.insert((entry.occasion.0, drone), *entry);
                            if let Some((delay, again)) = self.seconds[index].drones[drone].delivered {
                                let due = step + i128::from(delay);
                                on_the_way.push((due, drone, *entry));
                                on_the_way.extend(again.map(|more| (due + i128::from(more), drone, *entry)));
                            }
                        }
                    });
                }
            }
        }
        flown.counts = *srs[0].tdoa_counts();
        flown.counters = counters;
        flown
    }

    /// Arrival of a drone's symbols as `clock` reads true times: the mean of those that agree with the median.
    fn arrival_ps(&self, index: usize, drone: usize, clock: impl Fn(i128) -> i128) -> Option<i128> {
        let mut toas: Vec<i128> = self
            .captured_ps(index, drone)
            .map(|(symbol, at)| clock(at) - i128::from(symbol_time(symbol).0))
            .collect();
        toas.sort_unstable();
        let median = *toas.get(toas.len().checked_sub(1)? / 2)?;
        // Noise is within 20 ns, strays are a microsecond off and more, from each other as well.
        toas.retain(|toa| (toa - median).abs() < 100_000);
        Some(toas.iter().sum::<i128>().div_euclid(toas.len() as i128))
    }

    /// Whether a difference is beyond what the drones' distance explains; none where it is too close to tell.
    fn is_gated(
        &self,
        tdoa_ps: i128,
        mate: usize,
        clocks: [ClockState; 2],
        sigmas: [ToaSigma; 2],
    ) -> Option<bool> {
        let clocks = clocks.map(ClockState::sigma_ns);
        let [Some(a_ns), Some(b_ns)] = clocks else { return Some(false) };
        let square = |ps: i128| ps * ps;
        let variance = square(1000 * i128::from(a_ns))
            + square(1000 * i128::from(b_ns))
            + square(sigmas[0].ps().into())
            + square(sigmas[1].ps().into());
        let mm = |drone: usize| POS_M[drone].map(|m| (f64::from(m) * 1e3) as i128);
        let squares: i128 = mm(0).iter().zip(mm(mate)).map(|(a, b)| square(a - b)).sum();
        // Square roots of integers, to a thousandth.
        let root = |of: i128| (of as u128 * 1_000_000).isqrt() as i128;
        let way_um = root(squares) + 2 * (f64::from(ERROR_M) * 1e6) as i128;
        // A micrometre takes 3.33564 fs.
        let limit_fs = way_um * 333_564 / 100_000 + 4 * root(variance);
        let beyond_ps = tdoa_ps.abs() - limit_fs / 1000;
        (beyond_ps.abs() > 30).then_some(beyond_ps > 0)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn truth_from_captures_to_differences(flight in flight()) {
        let flown = flight.fly();
        for counters in &flown.counters {
            prop_assert_eq!((counters.captures_unknown, counters.symbols_refused, counters.timer_gaps), (0, 0, 0));
        }

        // Captures of the mates and of the serving drone, as each reads its clock.
        let bound_ps = |clock: ClockState| {
            let sigma_ns = clock.sigma_ns().expect("there are pulses, and nanoseconds");
            5_000 * i128::from(sigma_ns) + i128::from(flight.timers[0].rate.tick_ps()) + 1_000
        };
        let holds = |index: usize, drone: usize, toa: TimePs, clock: ClockState| {
            let toa = i128::from(toa.0);
            if flight.pulses {
                let expected = flight.arrival_ps(index, drone, |at| at).expect("it was captured");
                let off = toa - expected;
                prop_assert!(off.abs() <= bound_ps(clock), "{off} ps off, {clock:?}");
            } else {
                prop_assert_eq!(clock, ClockState::Free);
                let timer = &flight.timers[drone];
                prop_assert_eq!(Some(toa), flight.arrival_ps(index, drone, |at| timer.free_ps(at)));
            }
            Ok(())
        };
        for ((occasion, mate), entry) in &flown.said {
            holds(*occasion as usize, *mate, entry.toa, entry.clock)?;
        }

        // Differences: formed of what came, exactly.
        let mut entries: BTreeMap<u32, &TdoaEntry> = BTreeMap::new();
        for entry in &flown.entries {
            prop_assert!(entries.insert(entry.occasion.0, entry).is_none(), "reported twice: {entry:?}");
        }
        let mut expected = TdoaCounts::NONE;
        for (index, second) in flight.seconds.iter().enumerate() {
            let occasion = index as u32;
            let own = flown.own_clock.get(&occasion).copied();
            let mut came: Vec<(DroneId, usize)> = Vec::new();
            for mate in [1, 2] {
                if let (Some(_), Some((_, again))) = (flown.said.get(&(occasion, mate)), second.drones[mate].delivered) {
                    came.push((DRONES[mate], mate));
                    expected.duplicates += u32::from(again.is_some());
                }
            }
            came.sort_unstable();
            let Some(own_clock) = own else {
                expected.stale += came.len() as u32;
                prop_assert!(!entries.contains_key(&occasion));
                continue;
            };
            expected.hits += came.len() as u32;
            expected.misses += 2 - came.len() as u32;
            let Some(entry) = entries.get(&occasion) else {
                prop_assert!(came.is_empty());
                continue;
            };
            holds(index, 0, entry.time, own_clock)?;
            prop_assert_eq!(entry.mates.len(), came.len());
            for (found, (id, mate)) in entry.mates.iter().zip(came) {
                let said = flown.said[&(occasion, mate)];
                let wide = i128::from(said.toa.0) - i128::from(entry.time.0);
                let clamped = wide.clamp(i32::MIN.into(), i32::MAX.into());
                prop_assert_eq!((found.drone, i128::from(found.tdoa.0)), (id, clamped));
                prop_assert_eq!(found.flags.contains(TdoaFlags::SATURATED), clamped != wide);
                prop_assert_eq!(found.flags.contains(TdoaFlags::UNJUDGED), !flight.pulses);
                if let Some(gated) = flight.is_gated(wide, mate, [own_clock, said.clock], [entry.sigma, found.sigma]) {
                    prop_assert_eq!(found.flags.contains(TdoaFlags::GATED), gated, "{:?}", found);
                }
                expected.saturated += u32::from(clamped != wide);
                expected.gated += u32::from(found.flags.contains(TdoaFlags::GATED));
            }
        }
        prop_assert_eq!(flown.counts, expected);
    }
}
