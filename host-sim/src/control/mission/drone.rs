//! The control center's end of one drone's link: who may be believed, and commands that are repeated until they are
//! acknowledged.

mod failure;
mod pace;
#[cfg(test)]
mod tests;

use super::{pos_m, quality::Quality};
use crate::{
    control::keys::LinkKeys,
    geometry::{V2, V3},
};
use failure::name;
pub use failure::{DroneFailure, Refusals};
use pace::Pace;
pub use pace::{HeldBack, Traffic};
use skyroost_protocol::{
    DecodeError, LinkEnd, LinkFault, MIN_PROTOCOL_VERSION, PROTOCOL_VERSION, SCHEMA_HASH,
    codec::{MAX_FRAME, decode_body},
    header::MANAGEMENT_VERSION,
    key::{Key, ROOM},
    manage::{Identity, MAX_MANAGEMENT, Management},
    message::{
        AckStatus, Command, Down, EventCode, FlightPhase, LanePiece, MAX_LANE_PIECE, MissionHeader,
        SharedState, Telemetry, Up, lanes_crc,
    },
    units::{CommandId, DroneId, PosEnuMm, TimePs, VelEnuMmps},
};
use std::{collections::VecDeque, ops::Range};

/// A command without an answer is repeated after this time: two ways of the radio and some.
const REPEAT_AFTER: TimePs = TimePs::from_ms(600);
/// A drone that does not speak to this boot of the control center is asked who it is so often.
const IDENTIFY_EVERY: TimePs = TimePs::from_ms(1_000);
/// Telemetry comes once a second; one may be lost.
const TELEMETRY_FRESH: TimePs = TimePs::from_ms(2_500);
/// Slower than this a drone stands still, millimetres a second in each direction.
const STANDING_MMPS: u16 = 300;
/// A drone that has stayed for so long where it is, on its way, does not get where it was sent;
const SHORT_FOR: TimePs = TimePs::from_ms(60_000);
/// nor does one that wavers there by no more than this, metres: two in each other's way do.
const STAYS_WITHIN_M: f64 = 5.0;
/// Repetitions before the drone counts as unreachable.
const MOST_REPEATS: u32 = 50;
/// A drone in the air that says nothing for this long is lost: fifteen shared states, and the radio's delay on top
/// still leaves it within two seconds.
const SILENT_FOR: TimePs = TimePs::from_ms(1_500);
/// On the ground it tells once a second that it is there.
const SILENT_ON_GROUND: TimePs = TimePs::from_ms(15_000);
/// Where states are shared more seldom, silence is as many of their periods; telemetry comes once a second.
const SILENT_PERIODS: i64 = 3;
/// No drone in the air is silent for longer than between two of its telemetries, three of which may be lost.
const MOST_SILENT_FOR: TimePs = TimePs::from_ms(3_500);

/// A command under way.
#[derive(Clone, Debug)]
struct UnderWay {
    id: CommandId,
    command: Command,
    sent: TimePs,
    repeats: u32,
}

/// One drone as the control center sees it.
#[derive(Debug)]
pub struct DroneLink {
    /// Who.
    pub id: DroneId,
    /// Whether it speaks this protocol, and to this boot of the control center.
    pub connected: bool,
    /// What came on its link and was not taken in.
    pub refusals: Refusals,
    /// Its last shared state.
    pub state: Option<SharedState>,
    /// Its last telemetry.
    pub telemetry: Option<Telemetry>,
    /// Its supervisor's conditions as far as they are noted, one bit each, and as of when.
    pub(super) noted: (TimePs, u32),
    /// Since when it counts as lost.
    pub lost: Option<TimePs>,
    /// When its last frame came.
    heard: TimePs,
    /// Whether it is in the air, and when it said so.
    in_the_air: (TimePs, bool),
    /// What it does, by its last word on that: telemetry, or an event that was faster.
    pub(super) said_phase: Option<FlightPhase>,
    /// When that was.
    phase_said: TimePs,
    /// Whether what it measures was found to be worth nothing; no drone is asked twice.
    pub(super) deaf: bool,
    /// Since when.
    pub(super) deaf_since: Option<TimePs>,
    /// Where it was sent last.
    goal_m: Option<V2>,
    /// Where it has stayed on the way there, and since when.
    stays: Option<(TimePs, V3)>,
    /// How well frames get through.
    pub quality: Quality,
    end: LinkEnd,
    /// Whether this control center goes on where one before it ended, and has not been answered yet.
    resumes: bool,
    identify_due: TimePs,
    queue: VecDeque<Command>,
    under_way: Option<UnderWay>,
    next_command: u16,
    /// When the last acceptance came: telemetry from before may not know of the command.
    accepted: TimePs,
    upload: Option<(MissionHeader, Vec<[i32; 2]>)>,
    /// The pieces of the upload that are to be said, by number.
    pieces: Range<usize>,
    /// What may be said when.
    pub(super) pace: Pace,
}

impl DroneLink {
    /// A drone not heard of yet, to which so many bytes a second can be said; 0 for any number.
    #[must_use]
    pub fn new(id: DroneId, keys: &LinkKeys, bytes_per_s: u32) -> Self {
        Self {
            id,
            connected: false,
            refusals: Refusals::default(),
            state: None,
            telemetry: None,
            noted: (TimePs(0), 0),
            lost: None,
            heard: TimePs(0),
            in_the_air: (TimePs(0), false),
            said_phase: None,
            phase_said: TimePs(0),
            deaf: false,
            deaf_since: None,
            goal_m: None,
            stays: None,
            quality: Quality::default(),
            end: LinkEnd::new(DroneId::CONTROL, keys.boot_epoch(), id, keys.root(id).cloned()),
            resumes: false,
            identify_due: TimePs(0),
            queue: VecDeque::new(),
            under_way: None,
            next_command: 1,
            accepted: TimePs(0),
            upload: None,
            pieces: 0..0,
            pace: Pace::new(bytes_per_s),
        }
    }

    /// Takes in a frame that came at `now`: what the drone says of itself is kept, its hello answered; what it measured is
    /// left to the caller. None of a frame that is not to be believed, or says nothing but who the drone is.
    ///
    /// # Errors
    /// When the drone refuses a command or speaks another protocol.
    pub fn hear(
        &mut self,
        now: TimePs,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<Option<Up>, DroneFailure> {
        match self.open(bytes) {
            Ok((message, bound)) => {
                self.pace.traffic.heard(&message, bytes.len());
                // Of what may have been recorded not even that it was said now is believed.
                if bound {
                    self.hears(now, &message);
                }
                self.takes(now, &message, send).map(|()| Some(message))
            }
            Err(LinkFault::Decode(DecodeError::Version { found: MANAGEMENT_VERSION })) => {
                self.managed(now, bytes, send)?;
                Ok(None)
            }
            Err(fault) => {
                self.refuse(fault);
                if matches!(fault, LinkFault::Decode(DecodeError::Version { .. } | DecodeError::Forged)) {
                    self.identify(now, send);
                }
                Ok(None)
            }
        }
    }

    /// The message of a frame that is to be believed, and whether it was said to this boot of the control center.
    fn open(&mut self, bytes: &[u8]) -> Result<(Up, bool), LinkFault> {
        let (mut room, boot_before) = (ROOM, self.end.other_epoch());
        let opened = self.end.open(bytes, &mut room)?;
        let message = decode_body(opened.body)?;
        if !opened.bound {
            // It may have been recorded: no more is believed than that the drone once booted so often.
            if !matches!(message, Up::Hello { .. }) {
                return Err(LinkFault::Unexpected);
            }
            self.end.meet(opened.header.boot_epoch);
        }
        let bound = opened.bound;
        self.connected = self.end.is_bound() && (self.end.is_sealed() || self.connected);
        if boot_before.is_some() && boot_before != self.end.other_epoch() {
            // Its board has started anew: what it said before it does not know any more.
            (self.telemetry, self.said_phase) = (None, None);
        }
        Ok((message, bound))
    }

    fn refuse(&mut self, fault: LinkFault) {
        let count = match fault {
            LinkFault::Decode(DecodeError::Forged | DecodeError::Sealed | DecodeError::Unsealed) => {
                &mut self.refusals.forged
            }
            LinkFault::Decode(_) | LinkFault::Unexpected => &mut self.refusals.rejected,
            LinkFault::Repeated => &mut self.refusals.repeated,
        };
        *count += 1;
    }

    /// Asks a drone that this control center cannot read who it is, in the words of every version.
    fn identify(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) {
        if self.end.is_bound() || now < self.identify_due {
            return;
        }
        self.identify_due = now.after(IDENTIFY_EVERY);
        let mut frame = [0; MAX_MANAGEMENT];
        let length = self.end.manage(&Management::Identify, &mut frame).expect("the frame holds it");
        self.pace.pay(now, length);
        send(self.id, &frame[..length]);
    }

    /// A drone says who it is: one that understands is told that this control center is there.
    fn managed(
        &mut self,
        now: TimePs,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), DroneFailure> {
        match self.end.managed(bytes) {
            Ok((boot_epoch, Management::Identity(identity))) => {
                let Identity { version_min, version_max, schema_hash, .. } = identity;
                let version = self.common_version(version_min, version_max, schema_hash)?;
                self.end.meet(boot_epoch);
                if !self.end.is_bound() && self.end.other_epoch().is_some() {
                    self.welcome(now, version, send);
                }
            }
            Ok((_, Management::Identify)) => self.refuse(LinkFault::Unexpected),
            Err(fault) => self.refuse(fault),
        }
        Ok(())
    }

    /// The newest version that both speak.
    fn common_version(&self, version_min: u8, version_max: u8, schema_hash: u32) -> Result<u8, DroneFailure> {
        let version = PROTOCOL_VERSION.min(version_max);
        if schema_hash != SCHEMA_HASH || version < version_min.max(MIN_PROTOCOL_VERSION) {
            let drone = self.id;
            return Err(DroneFailure::Incompatible { drone, version_min, version_max, schema_hash });
        }
        Ok(version)
    }

    fn welcome(&mut self, now: TimePs, version: u8, send: &mut impl FnMut(DroneId, &[u8])) {
        self.say(now, &Down::Welcome { version, schema_hash: SCHEMA_HASH, resumes: self.resumes }, send);
    }

    fn takes(
        &mut self,
        now: TimePs,
        message: &Up,
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), DroneFailure> {
        match *message {
            Up::Hello { version_min, version_max, schema_hash, .. } => {
                let version = self.common_version(version_min, version_max, schema_hash)?;
                self.connected |= !self.end.is_sealed();
                self.welcome(now, version, send);
            }
            Up::CommandAck { command, status } => self.acknowledged(now, command, status, send)?,
            Up::SharedState(state) if self.state.is_none_or(|known| known.time < state.time) => {
                self.state = Some(state);
            }
            Up::Telemetry(telemetry) if self.telemetry.is_none_or(|known| known.time < telemetry.time) => {
                self.telemetry = Some(telemetry);
            }
            _ => {}
        }
        Ok(())
    }

    /// Notes whether it is lost at `now`; says so where that changed.
    pub fn watched(&mut self, now: TimePs, relay_period: TimePs) -> Option<bool> {
        let periods = TimePs(relay_period.0.saturating_mul(SILENT_PERIODS));
        let silent_for = periods.max(SILENT_FOR).min(MOST_SILENT_FOR);
        let silence = self.silence(now);
        let silent = match (self.lost, self.in_the_air()) {
            (Some(_), false) => silence >= SILENT_FOR,
            (_, true) => silence >= silent_for,
            // On the ground nobody minds for a while.
            (None, false) => self.connected && silence >= SILENT_ON_GROUND,
        };
        if silent == self.lost.is_some() {
            return None;
        }
        self.lost = silent.then_some(now);
        Some(silent)
    }

    /// Goes on at `now`, in a new boot of the control center that was killed: whoever it was spoke to the boot before. What was under
    /// way is said again, and done once: its number is the same.
    pub fn resume(&mut self, now: TimePs, keys: &LinkKeys) {
        self.end = LinkEnd::new(DroneId::CONTROL, keys.boot_epoch(), self.id, keys.root(self.id).cloned());
        (self.resumes, self.identify_due, self.quality) = (true, now, Quality::default());
        (self.heard, self.in_the_air.0) = (now, now);
        self.accepted = now;
        // Keys of the session that is over.
        self.queue.retain(|command| !matches!(command, Command::Rekey(_)));
        let _ = self.under_way.take_if(|it| matches!(it.command, Command::Rekey(_)));
        if let Some(under_way) = &mut self.under_way {
            (under_way.sent, under_way.repeats) = (now, 0);
        }
    }

    /// It does not answer: it counts as lost until it is heard again, and is told nothing of what it missed.
    pub fn give_up(&mut self, now: TimePs) {
        self.lost = Some(now);
        self.forget_commands();
        if let Some(under_way) = &mut self.under_way {
            under_way.repeats = 0;
        }
    }

    /// What it was to do and has not acknowledged is not said any more; what it is doing it does.
    pub fn forget_commands(&mut self) {
        // A key that the drone may have already is not taken back.
        let is_rekey = |it: &mut UnderWay| !matches!(it.command, Command::Rekey(_));
        self.queue.clear();
        let _ = self.under_way.take_if(is_rekey);
        (self.upload, self.pieces) = (None, 0..0);
    }

    /// For how long it has been silent.
    pub(super) fn silence(&self, now: TimePs) -> TimePs {
        now.since(self.heard)
    }

    /// When the last acceptance came.
    pub(super) fn accepted(&self) -> TimePs {
        self.accepted
    }

    /// Its supervisor's conditions by its last telemetry, one bit each.
    pub(super) fn conditions(&self) -> u32 {
        self.telemetry.map_or(0, |telemetry| telemetry.conditions)
    }

    /// A frame came at `now`.
    fn hears(&mut self, now: TimePs, message: &Up) {
        self.heard = now;
        match message {
            Up::SharedState(state) => self.quality.took(now.since(state.time)),
            Up::Telemetry(telemetry) => self.quality.lost(self.end.sent(), telemetry.frames_lost),
            _ => {}
        }
        let phase = match message {
            Up::Telemetry(telemetry) => Some((telemetry.time, telemetry.phase)),
            Up::Event { code: EventCode::PhaseEntered, time, value } => {
                FlightPhase::numbered(*value).map(|phase| (*time, phase))
            }
            _ => None,
        };
        if let Some((time, phase)) = phase.filter(|it| it.0 >= self.phase_said) {
            (self.phase_said, self.said_phase) = (time, Some(phase));
        }
        let said = match message {
            // States are shared in the air only.
            Up::SharedState(state) => Some((state.time, true)),
            Up::Telemetry(telemetry) => Some((telemetry.time, telemetry.phase != FlightPhase::Grounded)),
            Up::Event { code: EventCode::PhaseEntered, time, value } => {
                Some((*time, *value != FlightPhase::Grounded as u32))
            }
            _ => None,
        };
        let Some((time, in_the_air)) = said.filter(|said| said.0 >= self.in_the_air.0) else { return };
        self.in_the_air = (time, in_the_air);
        // On the ground nothing is shared, but where it stands is known: else others would keep out of the way of a
        // silent neighbour that may be anywhere, and never land beside it.
        if let Some(state) = self.state.as_mut().filter(|state| !in_the_air && state.time < time) {
            state.time = time;
            state.vel = VelEnuMmps([0; 3]);
        }
    }

    /// Whether it is in the air by its own last word.
    #[must_use]
    pub fn in_the_air(&self) -> bool {
        self.in_the_air.1
    }

    /// Phase of flight by telemetry that knows of every command given and is not stale; none while a
    /// command is under way or nothing fresh was heard.
    #[must_use]
    pub fn phase(&self, now: TimePs) -> Option<FlightPhase> {
        let fresh = |t: &Telemetry| t.time > self.accepted && now.since(t.time) < TELEMETRY_FRESH;
        self.telemetry.filter(|t| self.idle() && fresh(t)).map(|t| t.phase)
    }

    /// Whether it says that it stands still.
    #[must_use]
    pub fn stands(&self) -> bool {
        let slow = |mmps: &i16| mmps.unsigned_abs() < STANDING_MMPS;
        self.state.is_some_and(|state| state.vel.0.iter().all(slow))
    }

    /// Where it was to fly and does not get to: it has stayed in the air for a minute on the way there.
    #[must_use]
    pub fn stays_short(&mut self, now: TimePs) -> Option<V2> {
        // Until it is heard again it may be where it was.
        let phase = self.phase(now)?;
        let (Some(goal), Some(state), FlightPhase::GoTo) = (self.goal_m, self.state, phase) else {
            self.stays = None;
            return None;
        };
        let at_m = pos_m(&state.pos);
        let (since, _) = match self.stays {
            Some((since, stayed_m)) if (at_m - stayed_m).norm() <= STAYS_WITHIN_M => (since, stayed_m),
            _ => *self.stays.insert((now, at_m)),
        };
        (now.since(since) >= SHORT_FOR).then_some(goal)
    }

    /// Sends a message in the next frame, whatever it costs.
    ///
    /// # Panics
    /// Never: a frame holds every message.
    pub fn say(&mut self, now: TimePs, message: &Down, send: &mut impl FnMut(DroneId, &[u8])) {
        let mut frame = [0; MAX_FRAME];
        // A link is done long before 2^32 frames.
        let length = self.end.encode_into(message, &mut frame).expect("a frame holds every message");
        self.pace.says(now, message, length);
        send(self.id, &frame[..length]);
    }

    /// Whether there is anybody to speak to: on a sealed link, a boot of the drone that is known.
    fn is_met(&self) -> bool {
        !self.end.is_sealed() || self.end.other_epoch().is_some()
    }

    /// Gives a command; commands are carried out in order.
    pub fn command(&mut self, command: Command) {
        if let Command::Place { target } = &command {
            let [x, y, _] = target.0.map(|mm| f64::from(mm) * 1e-3);
            (self.goal_m, self.stays) = (Some(V2::new(x, y)), None);
        }
        self.queue.push_back(command);
    }

    /// Gives the mission: announcement, lanes, commit.
    ///
    /// # Panics
    /// When the header does not count the lanes: a caller's mistake.
    pub fn upload(&mut self, header: MissionHeader, waypoints_mm: Vec<[i32; 2]>) {
        assert_eq!(usize::from(header.waypoints), waypoints_mm.len(), "the header counts the lanes");
        let lanes_crc = lanes_crc(&waypoints_mm);
        self.command(Command::UploadBegin(header));
        self.command(Command::UploadCommit { mission: header.mission, lanes_crc });
        (self.upload, self.pieces) = (Some((header, waypoints_mm)), 0..0);
    }

    /// Changes the key of the link, unless a change is still under way: the drone may have the key of that one, or not.
    pub fn rekey(&mut self, key: Key) {
        let given = self.queue.iter().chain(self.under_way.iter().map(|it| &it.command));
        let is_changing =
            self.end.is_changing() || given.into_iter().any(|it| matches!(it, Command::Rekey(_)));
        if self.end.is_sealed() && !is_changing {
            self.command(Command::Rekey(key));
        }
    }

    /// Whether every command given was accepted.
    #[must_use]
    pub fn idle(&self) -> bool {
        self.queue.is_empty() && self.under_way.is_none()
    }

    /// An acknowledgement came.
    ///
    /// # Errors
    /// When the drone refuses for good.
    pub fn acknowledged(
        &mut self,
        now: TimePs,
        id: CommandId,
        status: AckStatus,
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), DroneFailure> {
        let Some(under_way) = self.under_way.take_if(|u| u.id == id) else { return Ok(()) };
        (self.accepted, self.resumes) = (now, false);
        match (status, under_way.command) {
            (AckStatus::Accepted, Command::Rekey(_)) => self.end.confirmed(),
            (AckStatus::Accepted, Command::UploadBegin(_)) => self.lay_out(0),
            (AckStatus::Accepted, _) => {}
            (AckStatus::Incomplete { first_missing }, commit @ Command::UploadCommit { .. }) => {
                self.lay_out(first_missing);
                // A new number: the drone answers a known one without looking again.
                self.queue.push_front(commit);
            }
            (status, command) => {
                return Err(DroneFailure::Refused { drone: self.id, command: name(&command), status });
            }
        }
        self.say_lanes(now, send);
        Ok(())
    }

    /// Sends the next command, or repeats the one under way when its answer is overdue.
    ///
    /// # Errors
    /// When the drone has not answered for too long.
    pub fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), DroneFailure> {
        if !self.is_met() {
            return Ok(());
        }
        // A commitment is said after the pieces that it commits.
        let waits =
            !self.pieces.is_empty() && matches!(self.queue.front(), Some(Command::UploadCommit { .. }));
        if self.under_way.is_none()
            && !waits
            && let Some(command) = self.queue.pop_front()
        {
            if let Command::Rekey(key) = &command {
                self.end.offer(key.clone());
            }
            let id = CommandId(self.next_command);
            self.next_command = self.next_command.wrapping_add(1);
            let message = Down::Command { id, command: command.clone() };
            self.under_way = Some(UnderWay { id, command, sent: now, repeats: 0 });
            self.say_that_it_resumes(now, send);
            self.say(now, &message, send);
        } else if let Some(under_way) = &mut self.under_way
            && now.since(under_way.sent) >= REPEAT_AFTER
        {
            under_way.sent = now;
            // A drone in the air that is silent is lost, which does not end the mission.
            under_way.repeats += u32::from(self.lost.is_none());
            if under_way.repeats > MOST_REPEATS {
                return Err(DroneFailure::Unreachable { drone: self.id, command: name(&under_way.command) });
            }
            let message = Down::Command { id: under_way.id, command: under_way.command.clone() };
            self.say_that_it_resumes(now, send);
            self.say(now, &message, send);
        }
        Ok(())
    }

    /// Until a command is acknowledged the drone may not know that numbers go on, and then leaves commands aside.
    fn say_that_it_resumes(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) {
        if self.resumes {
            self.welcome(now, PROTOCOL_VERSION, send);
        }
    }

    /// The pieces of the upload from this waypoint on are to be said.
    fn lay_out(&mut self, from: u16) {
        let count = self.upload.as_ref().map_or(0, |(_, lanes)| lanes.len().div_ceil(MAX_LANE_PIECE));
        self.pieces = usize::from(from) / MAX_LANE_PIECE..count;
    }

    /// Says as many pieces of the upload as there is room for; the others wait.
    ///
    /// # Panics
    /// Never: a piece is cut to fit.
    pub fn say_lanes(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) {
        if self.pieces.is_empty() {
            return;
        }
        let Some((header, lanes)) = self.upload.take() else { return };
        while !self.pieces.is_empty() {
            if !self.pace.has_room(now) {
                self.pace.held_back.pieces += 1;
                break;
            }
            let first = self.pieces.start * MAX_LANE_PIECE;
            self.pieces.start += 1;
            let piece = &lanes[first..lanes.len().min(first + MAX_LANE_PIECE)];
            let waypoints_mm = heapless::Vec::from_slice(piece).expect("a chunk fits a piece");
            let piece = LanePiece { mission: header.mission, first: first as u16, waypoints_mm };
            self.say(now, &Down::LanePiece(piece), send);
        }
        self.upload = Some((header, lanes));
    }
}

/// The command to fly there and serve.
#[must_use]
pub fn place_at(pos_m: V2, altitude_m: f64) -> Command {
    let [x, y, z] = [pos_m.x, pos_m.y, altitude_m].map(|m| (m * 1e3).round() as i32);
    Command::Place { target: PosEnuMm([x, y, z]) }
}
