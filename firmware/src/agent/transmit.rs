//! Frames out: what is sent when, numbered and counted.
//!
//! Where the uplink takes less than there is to say ([`AgentConfig::uplink_bytes_per_s`]), what keeps drones apart and what the control
//! center waits for is said whatever it costs: states, hellos, acknowledgements, events. Pages of users heard may run a little into debt, as
//! nobody is measured who is not heard of, and are dropped beyond: the cell tells them again. Differences wait in their
//! table for credit, and telemetry waits as well, but not for long.

use super::FlightAgent;
use crate::{config::AgentConfig, counters::Counters, io::Outputs, supervisor::Condition};
use heapless::Vec;
use skyroost_protocol::{
    EncodeError, LinkEnd, MIN_PROTOCOL_VERSION, PROTOCOL_VERSION, SCHEMA_HASH,
    budget::Budget,
    codec::{Frame, MAX_FRAME, MAX_STATE_FRAME, Sender},
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

/// Telemetry that has waited for so long is sent whatever it costs: two seconds after the last, so that the control center has it fresh.
const TELEMETRY_WAITS: TimePs = TimePs::from_ms(1_000);
/// A page of users heard is sent in so much debt, and dropped in more.
const PAGE_DEBT: TimePs = TimePs::from_ms(150);
/// Where states would take more than half of the uplink they are shared less often, but at least this often: three of them are lost
/// before anybody counts as silent.
const SHARE_AT_LEAST_EVERY: TimePs = TimePs::from_ms(500);

/// Links out and what is due on them.
#[derive(Clone, Debug)]
pub(super) struct Transmitter {
    /// This end of the link to the control center, what comes in on it as well.
    pub(super) control: LinkEnd,
    uplink: Budget,
    peer: Sender,
    share_due: TimePs,
    phase_due: TimePs,
    telemetry_due: TimePs,
    identity_due: TimePs,
    /// Whether differences wait for room on the uplink, and whether telemetry does.
    tdoa_waits: bool,
    telemetry_waits: bool,
}

impl Transmitter {
    pub(super) const fn new(config: &AgentConfig, key: Option<Key>) -> Self {
        let (id, boot_epoch) = (config.id, config.boot_epoch);
        Self {
            control: LinkEnd::new(id, boot_epoch, DroneId::CONTROL, key),
            uplink: Budget::new(config.uplink_bytes_per_s),
            peer: Sender::new(id, boot_epoch),
            share_due: TimePs(0),
            phase_due: TimePs(0),
            telemetry_due: TimePs(0),
            identity_due: TimePs(0),
            tdoa_waits: false,
            telemetry_waits: false,
        }
    }

    /// Sends `message` to the control center, whatever it costs. As long as nobody has answered, only a hello has somebody to go to.
    pub(super) fn up(&mut self, now: TimePs, message: &Up, outputs: &mut Outputs, counters: &mut Counters) {
        if self.control.is_sealed() && !self.control.is_bound() && !matches!(message, Up::Hello { .. }) {
            Counters::count(&mut counters.frames_unbound);
            return;
        }
        let length = push(&mut outputs.uplink, counters, |out| self.control.encode_into(message, out));
        self.uplink.pay(now, length);
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
        let length = push(&mut outputs.uplink, counters, |out| self.control.manage(&identity, out));
        self.uplink.pay(now, length);
    }

    pub(super) fn event(
        &mut self,
        time: TimePs,
        code: EventCode,
        value: u32,
        outputs: &mut Outputs,
        counters: &mut Counters,
    ) {
        self.up(time, &Up::Event { code, time, value }, outputs, counters);
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
        if !self.uplink.allows(time, PAGE_DEBT) {
            Counters::count(&mut counters.pages_dropped);
        } else if let Ok(users) = Vec::from_slice(users) {
            self.up(time, &Up::Attached(Attached { time, users }), outputs, counters);
        }
    }

    /// Whether there is credit for what can wait.
    fn has_room(&self, now: TimePs) -> bool {
        self.uplink.allows(now, TimePs(0))
    }
}

/// Notes whether something waits for room on the uplink, and counts that it begins to.
fn note(waits: bool, waited: &mut bool, counters: &mut Counters) {
    if waits && !*waited {
        Counters::count(&mut counters.frames_put_off);
    }
    *waited = waits;
}

/// Encodes the next frame in its place among the outputs, as frames are long to move, and returns its length.
fn push<const N: usize>(
    out: &mut Vec<Frame, N>,
    counters: &mut Counters,
    encode: impl FnOnce(&mut [u8]) -> Result<usize, EncodeError>,
) -> usize {
    let mut length = None;
    if out.push(Frame::new()).is_ok()
        && let Some(frame) = out.last_mut()
    {
        length = frame.resize_default(MAX_FRAME).ok().and_then(|()| encode(frame).ok());
        frame.truncate(length.unwrap_or_default());
    }
    if length.is_none() {
        Counters::count(&mut counters.frames_overflowed);
    }
    length.unwrap_or_default()
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
                links.up(now, &Up::SharedState(state), outputs, counters);
            }
            let half_busy = TimePs(2 * links.uplink.time_of(MAX_STATE_FRAME).0);
            links.share_due = now.after(self.config.share_period.max(half_busy.min(SHARE_AT_LEAST_EVERY)));
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
        let (links, counters) = (&mut self.transmitter, &mut self.counters);
        let late = now.since(links.telemetry_due);
        let waits =
            late >= TimePs(0) && !links.has_room(now) && self.links.welcomed && late < TELEMETRY_WAITS;
        note(waits, &mut links.telemetry_waits, counters);
        if late >= TimePs(0) && !waits {
            let message = if self.links.welcomed { self.telemetry(now) } else { self.hello() };
            self.transmitter.up(now, &message, outputs, &mut self.counters);
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
        let mut more = true;
        while more && links.has_room(now) {
            let mut batch: Vec<TdoaEntry, MAX_TDOA_PER_FRAME> = Vec::new();
            while !batch.is_full()
                && let Some(entry) = self.srs.pop_tdoa(now)
            {
                let _ = batch.push(entry); // it is not full
            }
            more = batch.is_full();
            if !batch.is_empty() {
                links.up(now, &Up::Tdoa(batch), outputs, counters);
            }
        }
        let waits = more && self.srs.has_tdoa(now);
        note(waits, &mut links.tdoa_waits, counters);
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
