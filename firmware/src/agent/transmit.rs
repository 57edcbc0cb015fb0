//! Frames out: what is sent when, numbered and counted.

use super::FlightAgent;
use crate::{counters::Counters, io::Outputs, supervisor::Condition};
use heapless::Vec;
use skyroost_protocol::{
    EncodeError, LinkEnd, MIN_PROTOCOL_VERSION, PROTOCOL_VERSION, SCHEMA_HASH,
    codec::{Frame, MAX_FRAME, Sender},
    key::{Key, Purpose},
    manage::{Identity, Management},
    message::{
        Attached, AttachedUser, EventCode, FlightPhase, MAX_CAPTURES_PER_FRAME, MAX_TDOA_PER_FRAME, Peer,
        SharedState, TdoaEntry, Telemetry, Up,
    },
    units::{DroneId, PosEnuMm, TimePs, VelEnuMmps, mm_from_m},
};

/// Every so often fleet mates hear the sweep phase: it mends differences, which grow slowly, and tells that the drone is
/// there, so that silence means something even where frames are lost.
const PHASE_EVERY: TimePs = TimePs::from_ms(250);
/// Every so often telemetry goes out, and a hello until it is answered.
const TELEMETRY_EVERY: TimePs = TimePs::from_ms(1_000);

/// Least time between two answers of who this is: whoever asks more often asks to keep the link busy.
const IDENTITY_EVERY: TimePs = TimePs::from_ms(1_000);

/// Links out and what is due on them.
#[derive(Clone, Debug)]
pub(super) struct Transmitter {
    /// This end of the link to the control center, what comes in on it as well.
    pub(super) control: LinkEnd,
    peer: Sender,
    share_due: TimePs,
    phase_due: TimePs,
    telemetry_due: TimePs,
    identity_due: TimePs,
}

impl Transmitter {
    pub(super) const fn new(id: DroneId, boot_epoch: u16, key: Option<Key>) -> Self {
        Self {
            control: LinkEnd::new(id, boot_epoch, DroneId::CONTROL, key),
            peer: Sender::new(id, boot_epoch),
            share_due: TimePs(0),
            phase_due: TimePs(0),
            telemetry_due: TimePs(0),
            identity_due: TimePs(0),
        }
    }

    /// Sends `message` to the control center. As long as nobody has answered, only a hello has somebody to go to.
    pub(super) fn up(&mut self, message: &Up, outputs: &mut Outputs, counters: &mut Counters) {
        if self.control.is_sealed() && !self.control.is_bound() && !matches!(message, Up::Hello { .. }) {
            Counters::count(&mut counters.frames_unbound);
            return;
        }
        push(&mut outputs.uplink, counters, |out| self.control.encode_into(message, out));
    }

    fn tell_mates(&mut self, message: &Peer, outputs: &mut Outputs, counters: &mut Counters) {
        push(&mut outputs.peer, counters, |out| self.peer.encode_into(message, out));
    }

    /// Seals what fleet mates are told.
    pub(super) fn seal_peer(&mut self, key: &Key) {
        let (own, epoch) = (self.peer.id(), self.peer.boot_epoch());
        self.peer.seal_with(key.session(Purpose::Peer, own, epoch, 0), 0);
    }

    /// The control center knows of this boot: telemetry follows at once, which tells it that the drone knows.
    pub(super) fn welcomed(&mut self, now: TimePs) {
        self.telemetry_due = now;
    }

    /// Says who this is, in the words of every version.
    pub(super) fn identify(&mut self, now: TimePs, outputs: &mut Outputs, counters: &mut Counters) {
        if now < self.identity_due {
            return;
        }
        self.identity_due = now.after(IDENTITY_EVERY);
        let identity = Management::Identity(Identity::OWN);
        push(&mut outputs.uplink, counters, |out| self.control.manage(&identity, out));
    }

    pub(super) fn event(
        &mut self,
        time: TimePs,
        code: EventCode,
        value: u32,
        outputs: &mut Outputs,
        counters: &mut Counters,
    ) {
        self.up(&Up::Event { code, time, value }, outputs, counters);
    }

    pub(super) fn condition(
        &mut self,
        time: TimePs,
        condition: Condition,
        raised: bool,
        outputs: &mut Outputs,
        counters: &mut Counters,
    ) {
        let code = if raised { EventCode::ConditionRaised } else { EventCode::ConditionCleared };
        self.event(time, code, condition as u32, outputs, counters);
    }

    pub(super) fn attached(
        &mut self,
        time: TimePs,
        users: &[AttachedUser],
        outputs: &mut Outputs,
        counters: &mut Counters,
    ) {
        if let Ok(users) = Vec::from_slice(users) {
            self.up(&Up::Attached(Attached { time, users }), outputs, counters);
        }
    }
}

/// Encodes the next frame in its place among the outputs: frames are long to move.
fn push<const N: usize>(
    out: &mut Vec<Frame, N>,
    counters: &mut Counters,
    encode: impl FnOnce(&mut [u8]) -> Result<usize, EncodeError>,
) {
    let encoded = out.push(Frame::new()).is_ok()
        && out.last_mut().is_some_and(|frame| {
            let length = frame.resize_default(MAX_FRAME).ok().and_then(|()| encode(frame).ok());
            frame.truncate(length.unwrap_or_default());
            length.is_some()
        });
    if !encoded {
        Counters::count(&mut counters.frames_overflowed);
    }
}

impl FlightAgent {
    /// Sends everything that is due.
    pub(super) fn transmit(&mut self, now: TimePs, outputs: &mut Outputs) {
        self.send_measurements(now, outputs);
        let manner = self.manner();
        let (links, counters) = (&mut self.transmitter, &mut self.counters);
        if now >= links.share_due && self.flight.airborne() {
            if let Some((time, nav)) = self.nav {
                let state = SharedState {
                    time,
                    pos: PosEnuMm(nav.pos_enu_m.map(mm_from_m).into()),
                    vel: VelEnuMmps::from_mps(nav.vel_enu_mps.into()),
                    error_radius_mm: mm_from_m(nav.error_radius_m).clamp(0, i32::from(u16::MAX)) as u16,
                    manner,
                };
                links.up(&Up::SharedState(state), outputs, counters);
            }
            links.share_due = now.after(self.config.share_period);
        }
        if now >= links.phase_due && self.flight.phase() == FlightPhase::Sweep {
            let message = Peer::SweepPhase {
                time: now,
                phase_um: self.flight.zigzag.phase_um(),
                rate_mmps: mm_from_m(self.flight.zigzag.speed_mps()).clamp(0, i32::from(u16::MAX)) as u16,
                track_error_mm: mm_from_m(self.flight.lag_m).max(0) as u32,
            };
            links.tell_mates(&message, outputs, counters);
            links.phase_due = now.after(PHASE_EVERY);
        }
        if now >= self.transmitter.telemetry_due {
            let message = if self.links.welcomed { self.telemetry(now) } else { self.hello() };
            self.transmitter.up(&message, outputs, &mut self.counters);
            self.transmitter.telemetry_due = now.after(TELEMETRY_EVERY);
        }
    }

    /// Captures for the fleet mates that serve, and differences for the control center.
    fn send_measurements(&mut self, now: TimePs, outputs: &mut Outputs) {
        let (links, counters) = (&mut self.transmitter, &mut self.counters);
        self.srs.drain_for_mates(MAX_CAPTURES_PER_FRAME, |captures| {
            if let Ok(captures) = Vec::from_slice(captures) {
                links.tell_mates(&Peer::Captures(captures), outputs, counters);
            }
        });
        let mut batch: Vec<TdoaEntry, MAX_TDOA_PER_FRAME> = Vec::new();
        self.srs.drain_tdoa(now, |entry| {
            let _ = batch.push(entry); // never full: sent as soon as it is
            if batch.is_full() {
                links.up(&Up::Tdoa(core::mem::take(&mut batch)), outputs, counters);
            }
        });
        if !batch.is_empty() {
            links.up(&Up::Tdoa(batch), outputs, counters);
        }
    }

    fn hello(&self) -> Up {
        let (capture_ticks, capture_ps) = self.config.oscillator.rate.ratio();
        Up::Hello {
            version_min: MIN_PROTOCOL_VERSION,
            version_max: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            capture_ticks,
            capture_ps,
        }
    }

    fn telemetry(&self, now: TimePs) -> Up {
        Up::Telemetry(Telemetry {
            time: now,
            phase: self.flight.phase(),
            mission: self.mission.as_ref().map(|m| m.header.mission),
            sweep_phase_mm: (self.flight.zigzag.phase_um() / 1000).clamp(0, i64::from(u32::MAX)) as u32,
            track_error_mm: mm_from_m(self.flight.track_error_m).max(0) as u32,
            battery_permille: self.battery_permille,
            conditions: self.supervisor.conditions(),
            frames_lost: self.transmitter.control.receiver().counters().lost,
            frames_rejected: self.counters.unreadable(),
            dropped: self.counters.dropped(),
            clock: self.srs.clock_state(),
            tdoa: *self.srs.tdoa_counts(),
        })
    }
}
