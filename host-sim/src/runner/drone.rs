//! One simulated drone: its board with the flight code, its body in the air, and its links.

use super::{
    digest::Digest,
    faults::{DOWN, DroneFaults, Forgery, Now, UP},
};
use crate::{
    fleet::{Board, BoardError},
    geometry::V3,
    world::{
        battery::{Battery, Load},
        clock::Clock,
        gnss::Gnss,
        grid::PointGrid,
        link::{Carried, Link},
        pps::Pps,
        vehicle::{Command, Motion, Vehicle},
        wind::Wind,
    },
};
use skyroost_firmware::{
    STEP_S, STEP_US, Vec3,
    config::AgentConfig,
    counters::Counters,
    io::{Capture, Inputs, NavFix, Outputs, Pulse, Setpoint, SrsGate},
};
use skyroost_protocol::{
    codec::{Frame, MAX_FRAME},
    key::Key,
    message::{AttachedUser, MAX_ATTACHED_PER_FRAME},
    units::{DroneId, TimePs, ToaSigma, UserId},
};

/// Steps from one report of the users heard to the next: a second.
const ATTACH_STEPS: u64 = 50;
/// One-way distance of one step of the timing advance at 30 kHz subcarriers, 16 x 64 T_c / 2 (TS 38.213
/// 4.2), metres.
const TIMING_ADVANCE_M: f64 = 39.036;
/// A gate stays open this long after its transmission.
const GATE_OPEN: TimePs = TimePs::from_ms(20);

/// What passes between a drone's board and the world in a step. Nothing of it outlives the step, so that whoever flies islands
/// needs no more of them than the largest has drones, and keeps those in the cache.
#[derive(Default)]
pub(super) struct Desk {
    pub(super) inputs: Inputs,
    pub(super) outputs: Outputs,
}

/// One drone.
pub(super) struct Drone {
    pub(super) id: DroneId,
    pub(super) board: Box<dyn Board>,
    pub(super) vehicle: Vehicle,
    pub(super) uplink: Link<MAX_FRAME>,
    pub(super) downlink: Link<MAX_FRAME>,
    /// What it says to its fleet mates, once for both.
    pub(super) to_mates: Carried,
    pub(super) clock: Clock,
    pps: Pps,
    pub(super) digest: Digest,
    pub(super) wind: Wind,
    pub(super) gnss: Gnss,
    pub(super) battery: Battery,
    pub(super) tick_hz: u64,
    /// What the receiver says of its captures.
    toa_sigma: ToaSigma,
    pub(super) error_radius_m: f32,
    pub(super) radius_m: f64,
    /// Gates open or about to be.
    gates: Vec<SrsGate>,
    /// Captures for the next step.
    captured: Vec<Capture>,
    /// Users heard and not yet reported.
    attached: Vec<AttachedUser>,
    /// Captures that no step had room for.
    pub(super) captures_dropped: u64,
    /// Step from which on its board is dead.
    lost_from: Option<u64>,
    /// Whether it is.
    lost: bool,
    faults: DroneFaults,
    /// What goes wrong in this step.
    wrong: Now,
    /// What its board is started with, and the key of its link.
    born: (AgentConfig, Option<Key>),
    /// Forgeries among the frames of this step, and frames refused before it.
    forged: (u64, u64),
    /// Forgeries that its board did not refuse.
    believed: u64,
}

/// Parts of a drone.
pub(super) struct Parts {
    pub(super) board: Box<dyn Board>,
    pub(super) vehicle: Vehicle,
    pub(super) uplink: Link<MAX_FRAME>,
    pub(super) downlink: Link<MAX_FRAME>,
    pub(super) clock: Clock,
    pub(super) pps: Pps,
    pub(super) wind: Wind,
    pub(super) gnss: Gnss,
    pub(super) battery: Battery,
    pub(super) tick_hz: u64,
    pub(super) toa_sigma_ns: f64,
    pub(super) error_radius_m: f64,
    pub(super) radius_m: f64,
    /// When its board goes dead, if ever; simulated seconds.
    pub(super) lost_at_s: Option<f64>,
    pub(super) faults: DroneFaults,
    pub(super) born: (AgentConfig, Option<Key>),
}

impl Drone {
    pub(super) fn new(id: DroneId, parts: Parts) -> Self {
        Self {
            id,
            board: parts.board,
            vehicle: parts.vehicle,
            uplink: parts.uplink,
            downlink: parts.downlink,
            to_mates: Carried::default(),
            clock: parts.clock,
            pps: parts.pps,
            digest: Digest::new(id),
            wind: parts.wind,
            gnss: parts.gnss,
            battery: parts.battery,
            tick_hz: parts.tick_hz,
            toa_sigma: ToaSigma::from_ps((1e3 * parts.toa_sigma_ns) as u32),
            error_radius_m: parts.error_radius_m as f32,
            radius_m: parts.radius_m,
            gates: Vec::new(),
            captured: Vec::new(),
            attached: Vec::new(),
            captures_dropped: 0,
            lost_from: parts.lost_at_s.map(|at_s| (at_s / f64::from(STEP_S)).ceil() as u64),
            lost: false,
            faults: parts.faults,
            wrong: Now::default(),
            born: parts.born,
            forged: (0, 0),
            believed: 0,
        }
    }

    /// Whether nobody claims that it keeps its distance: it is dead, or does not know where it is.
    pub(super) fn is_excused(&self) -> bool {
        self.lost || self.wrong.excused
    }

    /// Frames that an attacker put in on the way to the drone and from it, and those of the former that the drone believed.
    pub(super) fn attacked(&self) -> ([u64; 2], u64) {
        (self.faults.attacker.injected, self.believed)
    }

    /// Whether an attacker is near.
    pub(super) fn is_attacked(&self) -> bool {
        self.wrong.attack
    }

    /// The attacker hears what the drone said.
    pub(super) fn overheard(&mut self, frame: &[u8]) {
        self.faults.attacker.hears(UP, frame);
    }

    /// What the attacker says in the drone's name in so many seconds.
    pub(super) fn forgery(&mut self, seconds: f64) -> Option<Forgery> {
        self.faults.attacker.frame(UP, seconds)
    }

    /// Whether its board is dead.
    pub(super) fn is_lost(&self) -> bool {
        self.lost
    }

    /// Everything the board learns at `step` but for frames.
    pub(super) fn sense(&mut self, step: u64, users: &PointGrid, user_pos_m: &[V3], inputs: &mut Inputs) {
        let now_us = step * STEP_US as u64;
        let now_ps = TimePs::from_us(now_us as i64).0;
        if !self.lost && self.lost_from.is_some_and(|from| step >= from) {
            self.lost = true;
            self.gates.clear();
        }
        inputs.clear();
        self.wrong = self.faults.at(step);
        if self.lost {
            return;
        }
        if self.wrong.jump_ps != 0.0 {
            self.clock.jump(self.wrong.jump_ps);
        }
        if self.wrong.booting {
            self.gates.clear();
            self.captured.clear();
        }
        let fix = self.gnss.step(self.vehicle.pos_enu_m(), self.vehicle.vel_enu_mps());
        inputs.nav = Some(NavFix {
            pos_enu_m: Vec3::from(fix.pos_enu_m.map(|m| m as f32)),
            vel_enu_mps: Vec3::from(fix.vel_enu_mps.map(|v| v as f32)),
            error_radius_m: self.error_radius_m,
        });
        let pulse = self.pps.pulse(now_ps);
        inputs.pulse = pulse.map(|pulse| Pulse {
            ticks: self.clock.ticks(pulse.true_ps, self.tick_hz) as u32,
            second: pulse.second as i32,
        });
        if let Some(nav) = inputs.nav.as_mut().filter(|_| self.wrong.navigation_nan) {
            nav.pos_enu_m = Vec3::repeat(f32::NAN);
        }
        inputs.timer_ticks = self.clock.ticks(now_ps, self.tick_hz) as u32;
        inputs.in_air = self.vehicle.motion() != Motion::Grounded;
        inputs.battery_permille = self.battery.charge_permille();
        if self.wrong.captures_stuck {
            self.captured.clear();
        }
        for capture in self.captured.drain(..) {
            if inputs.captures.push(capture).is_err() {
                self.captures_dropped += 1;
            }
        }
        // Drones report at different moments of the second.
        if (step + 7 * u64::from(self.id.0)).is_multiple_of(ATTACH_STEPS)
            && self.vehicle.motion() == Motion::Flying
        {
            self.hear_users(users, user_pos_m);
        }
        let page = self.attached.len().min(MAX_ATTACHED_PER_FRAME);
        inputs.attached.extend(self.attached.drain(..page));
    }

    /// Frames of the control center that are due.
    pub(super) fn receive(&mut self, now_us: u64, inputs: &mut Inputs) {
        take_frames(&mut self.downlink, now_us, inputs);
        if self.wrong.attack && !self.wrong.booting && !self.lost {
            inputs.frames.iter().for_each(|frame| self.faults.attacker.hears(DOWN, frame));
            if !inputs.frames.is_full()
                && let Some(forgery) = self.faults.attacker.frame(DOWN, f64::from(STEP_S))
            {
                inputs.frames.push(forgery.frame).expect("there was room");
                self.forged.0 = u64::from(!forgery.is_harmless);
            }
        }
    }

    fn hear_users(&mut self, users: &PointGrid, user_pos_m: &[V3]) {
        let pos_m = self.vehicle.pos_enu_m();
        self.attached.clear();
        self.attached.extend(users.within(pos_m.xy(), self.radius_m).map(|index| AttachedUser {
            user: UserId(index as u32),
            timing_advance: ((pos_m - user_pos_m[index]).norm() / TIMING_ADVANCE_M) as u16,
        }));
    }

    /// Whether its board does nothing.
    fn is_down(&self) -> bool {
        self.lost || self.wrong.booting
    }

    /// The board begins its step.
    pub(super) fn begin_step(&mut self, step: u64, desk: &mut Desk) -> Result<(), BoardError> {
        desk.outputs.clear();
        if self.is_down() {
            return Ok(());
        }
        if self.wrong.boots {
            let (config, key) = &mut self.born;
            config.boot_epoch += 1;
            self.board.restart(*config, key.clone())?;
        }
        if self.forged.0 > 0 {
            self.forged.1 = refused(&self.board.report()?.counters);
        }
        self.board.begin_step(TimePs::from_us(step as i64 * STEP_US), &desk.inputs, &mut desk.outputs)
    }

    /// The board ends its step.
    pub(super) fn end_step(&mut self, outputs: &mut Outputs) -> Result<(), BoardError> {
        if self.is_down() {
            return Ok(());
        }
        self.board.end_step(outputs)?;
        // Chance damages and repeats frames as well, so that a step may refuse more than were forged.
        let (forged, before) = std::mem::take(&mut self.forged);
        if forged > 0 {
            let refused = refused(&self.board.report()?.counters) - before;
            self.believed += forged.saturating_sub(refused);
        }
        Ok(())
    }

    /// The board's outputs go where they belong, but for frames to fleet mates.
    pub(super) fn send(&mut self, now_us: u64, outputs: &Outputs) {
        if self.is_down() {
            return;
        }
        self.digest.add(outputs);
        for frame in &outputs.uplink {
            self.uplink.send(now_us, frame);
        }
        outputs.peer.iter().for_each(|frame| self.to_mates.add(now_us, frame.len()));
        if !self.gates.is_empty() || !outputs.srs_gates.is_empty() {
            let now = TimePs::from_us(now_us as i64);
            self.gates.retain(|gate| now.since(gate.at) <= GATE_OPEN);
            self.gates.extend(outputs.srs_gates.iter().copied());
        }
    }

    /// One step of the body.
    pub(super) fn fly(&mut self, setpoint: &Setpoint) {
        // While nobody commands it, the autopilot holds what flies.
        let held = Setpoint { motors: self.vehicle.motion() == Motion::Flying, ..Setpoint::REST };
        let setpoint = if self.wrong.booting { &held } else { setpoint };
        let (command, load) = if setpoint.motors && !self.lost && !self.battery.is_empty() {
            let command = Command::Velocity {
                vel_enu_mps: V3::from(setpoint.vel_enu_mps.map(f64::from)),
                accel_ff_enu_mps2: V3::from(setpoint.accel_enu_mps2.map(f64::from)),
            };
            (command, Load::Flying { air_speed_mps: self.vehicle.vel_enu_mps().norm() })
        } else {
            (Command::MotorsOff, Load::Idle)
        };
        let wind_enu_mps = self.wind.step();
        self.vehicle.step(command, wind_enu_mps);
        self.battery.step(load, f64::from(STEP_S));
    }

    /// The gate that is open for this occasion, if any.
    pub(super) fn gate(&self, gate: &SrsGate) -> Option<&SrsGate> {
        self.gates.iter().find(|g| g.occasion == gate.occasion)
    }

    /// The timer captured a symbol's arrival; the board learns of it at its next step.
    pub(super) fn capture(&mut self, gate: &SrsGate, symbol: u8, arrival_ps: i64) {
        let ticks = self.clock.ticks(arrival_ps, self.tick_hz) as u32;
        let sigma = self.toa_sigma;
        self.captured.push(Capture { occasion: gate.occasion, ticks, symbol, sigma });
    }
}

/// Frames that the flight code did not act upon.
fn refused(counters: &Counters) -> u64 {
    let kinds = [
        counters.frames_forged,
        counters.frames_rejected,
        counters.frames_repeated,
        counters.frames_unexpected,
        counters.frames_unbound,
    ];
    kinds.into_iter().map(u64::from).sum()
}

/// Takes the frames that are due off a link, as many as the step has room for; the others wait.
pub(super) fn take_frames(link: &mut Link<MAX_FRAME>, now_us: u64, inputs: &mut Inputs) {
    while !inputs.frames.is_full()
        && let Some(bytes) = link.poll(now_us)
    {
        let frame = Frame::from_slice(bytes).expect("a link carries frames");
        inputs.frames.push(frame).expect("there was room");
    }
}
