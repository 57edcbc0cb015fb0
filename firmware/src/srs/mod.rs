//! Sounding reference signals, from the capture timer to differences of arrival time.
//!
//! [`occasions`] knows when to listen; [`capture`] extends the timer's captures to 64 bits; [`clock`]
//! turns ticks into picoseconds; [`tdoa`] pairs the captures of the fleet at the serving drone (paper
//! section 2, steps ii and iii).

pub mod capture;
pub mod clock;
pub mod discipline;
pub mod occasions;
pub mod slots;
pub mod tdoa;

use crate::{
    counters::Counters,
    io::{Inputs, MAX_CAPTURES_PER_STEP, NavFix, Outputs},
};
use capture::TickExtender;
use clock::TickRate;
use heapless::Vec;
use occasions::Occasions;
use skyroost_protocol::{
    message::{CaptureEntry, SrsRequest, TdoaEntry},
    units::{DroneId, PosEnuMm, TimePs, mm_from_m},
};
use tdoa::{OwnCapture, Pairing};

/// A fleet mate's capture is waited for this long: several ways of the direct link.
const MATES_WITHIN: TimePs = TimePs::from_ms(500);

/// The timer is read this often at least, whatever its rate: within half a wrap of ticks of 184 ps, 395 ms.
const EXTEND_EVERY: TimePs = TimePs::from_ms(300);

/// SRS side of the flight agent.
#[derive(Clone, Debug)]
pub struct Srs {
    rate: TickRate,
    extender: TickExtender,
    occasions: Occasions,
    pairing: Pairing,
    for_mates: Vec<CaptureEntry, MAX_CAPTURES_PER_STEP>,
    extend_due: TimePs,
}

impl Srs {
    /// Nothing announced yet; `rate` is that of the capture timer.
    #[must_use]
    pub const fn new(rate: TickRate) -> Self {
        Self {
            rate,
            extender: TickExtender::new(rate),
            occasions: Occasions::new(),
            pairing: Pairing::new(MATES_WITHIN),
            for_mates: Vec::new(),
            extend_due: TimePs(0),
        }
    }

    /// Forgets everything; `rate` is that of the capture timer.
    pub fn restart(&mut self, rate: TickRate) {
        let Self { rate: own, extender, occasions, pairing, for_mates, extend_due } = self;
        *own = rate;
        *extender = TickExtender::new(rate);
        occasions.clear();
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

    /// Takes in the captures of this step and opens the gates that are due.
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
        if !inputs.captures.is_empty() || now >= self.extend_due {
            self.extender.step(inputs.timer_ticks, now);
            self.extend_due = now.after(EXTEND_EVERY);
        }
        for capture in &inputs.captures {
            let (Some(announced), Some(nav)) = (self.occasions.get(capture.occasion), fix) else {
                Counters::count(&mut counters.captures_unknown);
                continue;
            };
            let toa = self.rate.time_of(self.extender.extend(capture.ticks));
            // Back to the transmission: at 10 m/s the microseconds in between do not matter.
            let moved = nav.vel_enu_mps * now.since(announced.at).as_secs_f32();
            let pos = PosEnuMm((nav.pos_enu_m - moved).map(mm_from_m).into());
            let occasion = capture.occasion;
            if announced.serving == me {
                self.pairing.own(now, OwnCapture { occasion, user: announced.user, time: toa, pos });
            } else if self.for_mates.push(CaptureEntry { occasion, toa, pos }).is_err() {
                Counters::count(&mut counters.captures_overflowed);
            }
        }
        self.occasions.step(now, me, |gate| outputs.srs_gates.push(gate).is_ok());
    }

    /// Captures of occasions that a fleet mate serves, handed over once, in slices of at most `size`.
    pub fn drain_for_mates(&mut self, size: usize, mut emit: impl FnMut(&[CaptureEntry])) {
        self.for_mates.chunks(size).for_each(&mut emit);
        self.for_mates.clear();
    }

    /// Differences that are complete, or as complete as they will be.
    pub fn drain_tdoa(&mut self, now: TimePs, emit: impl FnMut(TdoaEntry)) {
        self.pairing.drain(now, emit);
    }
}
