//! Sounding reference signals, from the capture timer to differences of arrival time.
//!
//! [`occasions`] knows when to listen; [`capture`] extends the timer's captures to 64 bits; [`discipline`] makes
//! GNSS time of them where there is a pulse per second, and [`clock`] the timer's own where there is none;
//! [`burst`] averages the symbols of one SRS; [`tdoa`] pairs the captures of the fleet at the serving drone (paper
//! section 2, steps ii and iii), and [`gate`] says which differences cannot be.

pub mod burst;
pub mod capture;
pub mod clock;
pub mod discipline;
pub mod gate;
pub mod occasions;
pub mod slots;
pub mod tdoa;
mod words;

use crate::{
    config::AgentConfig,
    counters::Counters,
    io::{Inputs, MAX_CAPTURES_PER_STEP, NavFix, Outputs},
    scalar::root,
};
use burst::{Arrival, Bursts, Heard, Symbol};
use capture::TickExtender;
use discipline::GnssClock;
use heapless::Vec;
use occasions::Occasions;
use skyroost_protocol::{
    message::{CaptureEntry, ClockState, SrsRequest, TdoaCounts, TdoaEntry},
    units::{DroneId, PosEnuMm, TimePs, ToaSigma, mm_from_m},
};
use tdoa::{OwnCapture, Pairing};

/// A fleet mate's capture is waited for this long: several ways of the direct link.
const MATES_WITHIN: TimePs = TimePs::from_ms(500);

/// The timer is read this often at least, whatever its rate: within half a wrap of ticks of 184 ps, 395 ms.
const EXTEND_EVERY: TimePs = TimePs::from_ms(300);

/// SRS side of the flight agent.
#[derive(Clone, Debug)]
pub struct Srs {
    /// Standard deviation of where in its tick an arrival lies.
    tick_sigma_ps: u32,
    extender: TickExtender,
    clock: GnssClock,
    occasions: Occasions,
    bursts: Bursts,
    pairing: Pairing,
    for_mates: Vec<CaptureEntry, MAX_CAPTURES_PER_STEP>,
    extend_due: TimePs,
}

impl Srs {
    /// Nothing announced yet.
    #[must_use]
    pub const fn new(config: &AgentConfig) -> Self {
        let oscillator = config.oscillator;
        Self {
            tick_sigma_ps: oscillator.rate.tick_sigma_ps(),
            extender: TickExtender::new(oscillator.rate),
            clock: GnssClock::new(oscillator),
            occasions: Occasions::new(),
            bursts: Bursts::new(config.srs_symbols),
            pairing: Pairing::new(MATES_WITHIN),
            for_mates: Vec::new(),
            extend_due: TimePs(0),
        }
    }

    /// Forgets everything.
    pub fn restart(&mut self, config: &AgentConfig) {
        let Self { tick_sigma_ps, extender, clock, occasions, bursts, pairing, for_mates, extend_due } = self;
        let oscillator = config.oscillator;
        *tick_sigma_ps = oscillator.rate.tick_sigma_ps();
        *extender = TickExtender::new(oscillator.rate);
        *clock = GnssClock::new(oscillator);
        occasions.clear();
        bursts.restart(config.srs_symbols);
        pairing.clear();
        for_mates.clear();
        *extend_due = TimePs(0);
    }

    /// The control center announces occasions.
    pub fn announce(&mut self, now: TimePs, request: &SrsRequest, counters: &mut Counters) {
        self.occasions.announce(now, request, counters);
    }

    /// A fleet mate's capture; it concerns the serving drone only.
    pub fn mate(&mut self, now: TimePs, me: DroneId, mate: DroneId, capture: &CaptureEntry) {
        if self.occasions.get(capture.occasion).is_some_and(|a| a.serving == me) {
            self.pairing.mate(now, mate, capture);
        }
    }

    /// The clock that arrivals are read off, as of the timer's last reading.
    #[must_use]
    pub fn clock_state(&self) -> ClockState {
        self.clock.state(self.extender.ticks())
    }

    /// What became of the captures of users that this drone serves.
    #[must_use]
    pub const fn tdoa_counts(&self) -> &TdoaCounts {
        self.pairing.counts()
    }

    /// Takes in pulse and captures of this step and opens the gates that are due.
    pub fn step(
        &mut self,
        now: TimePs,
        inputs: &Inputs,
        fix: Option<&NavFix>,
        me: DroneId,
        outputs: &mut Outputs,
        counters: &mut Counters,
    ) {
        // The extension costs divisions, and nobody asks for it between captures.
        if !inputs.captures.is_empty() || inputs.pulse.is_some() || now >= self.extend_due {
            self.extender.step(inputs.timer_ticks, now);
            self.extend_due = now.after(EXTEND_EVERY);
            counters.timer_gaps = self.extender.gaps();
        }
        if let Some(pulse) = inputs.pulse {
            self.clock.pulse(self.extender.extend(pulse.ticks), pulse.second.into());
            counters.pulses_rejected = self.clock.counters().rejected;
            counters.pulses_replaced = self.clock.counters().replaced;
        }
        self.take_captures(now, inputs, fix, me, counters);
        self.occasions.step(now, me, |gate| outputs.srs_gates.push(gate).is_ok());
    }

    fn take_captures(
        &mut self,
        now: TimePs,
        inputs: &Inputs,
        fix: Option<&NavFix>,
        me: DroneId,
        counters: &mut Counters,
    ) {
        let Self { tick_sigma_ps, extender, clock, occasions, bursts, pairing, for_mates, .. } = self;
        if inputs.captures.is_empty() && bursts.are_none() {
            return;
        }
        let state = clock.state(extender.ticks());
        let error_mm = fix.map_or(0, |nav| mm_from_m(nav.error_radius_m).clamp(0, u16::MAX.into())) as u16;
        let mut refused = 0_u32;
        let mut unknown = 0_u32;
        let mut arrive = |arrival: Arrival| {
            let Arrival { heard: Heard { occasion, user, serving, pos }, toa, sigma, excluded } = arrival;
            counters.symbols_excluded = counters.symbols_excluded.saturating_add(excluded.into());
            if serving == me {
                let own = OwnCapture { occasion, user, time: toa, pos, sigma, clock: state, error_mm };
                pairing.own(now, own);
            } else if for_mates.push(CaptureEntry { occasion, toa, pos, sigma, clock: state }).is_err() {
                Counters::count(&mut counters.captures_overflowed);
            }
        };
        for capture in &inputs.captures {
            let (Some(announced), Some(nav)) = (occasions.get(capture.occasion), fix) else {
                Counters::count(&mut unknown);
                continue;
            };
            // Back to the transmission: at 10 m/s the microseconds in between do not matter.
            let moved = nav.vel_enu_mps * now.since(announced.at).as_secs_f32();
            let heard = Heard {
                occasion: capture.occasion,
                user: announced.user,
                serving: announced.serving,
                pos: PosEnuMm((nav.pos_enu_m - moved).map(mm_from_m).into()),
            };
            let symbol = Symbol {
                number: capture.symbol,
                toa: clock.local_or_gnss(extender.extend(capture.ticks)),
                sigma: with_tick(capture.sigma, *tick_sigma_ps),
            };
            if !bursts.take(heard, symbol, &mut arrive) {
                Counters::count(&mut refused);
            }
        }
        bursts.settle(&mut arrive);
        counters.captures_unknown = counters.captures_unknown.saturating_add(unknown);
        counters.symbols_refused = counters.symbols_refused.saturating_add(refused);
    }

    /// Captures of occasions that a fleet mate serves, handed over once, in slices of at most `size`.
    pub fn drain_for_mates(&mut self, size: usize, mut emit: impl FnMut(&[CaptureEntry])) {
        self.for_mates.chunks(size).for_each(&mut emit);
        self.for_mates.clear();
    }

    /// The oldest differences that are complete, or as complete as they will be; those that are not asked for wait.
    pub fn pop_tdoa(&mut self, now: TimePs) -> Option<TdoaEntry> {
        self.pairing.pop(now)
    }

    /// Whether differences wait to be reported.
    #[must_use]
    pub fn has_tdoa(&self, now: TimePs) -> bool {
        self.pairing.has_due(now)
    }
}

/// A receiver's deviation with that of its counter.
fn with_tick(sigma: ToaSigma, tick_sigma_ps: u32) -> ToaSigma {
    let variance = u64::from(sigma.ps()).pow(2).saturating_add(u64::from(tick_sigma_ps).pow(2));
    ToaSigma::from_ps(root(variance))
}
