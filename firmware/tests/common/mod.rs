//! A control center in a few lines: frames for one drone, and a drone that does what it is told.

#![allow(dead_code)] // each test uses its part of it

use skyroost_firmware::{
    STEP_S, STEP_US, Vec3,
    agent::FlightAgent,
    config::AgentConfig,
    io::{Inputs, NavFix, Outputs},
};
use skyroost_protocol::{
    codec::{Message, Sender, decode},
    message::{
        AckStatus, Command, Down, Heading, LanePiece, MAX_LANE_PIECE, MissionHeader, Up, Vertical, lanes_crc,
    },
    units::{CommandId, DroneId, FleetId, MissionId, PosEnuMm, TimePs},
};

/// The drone under test.
pub(crate) const ME: DroneId = DroneId(1);
/// Its fleet.
pub(crate) const FLEET: [DroneId; 3] = [ME, DroneId(2), DroneId(3)];

/// Control center and surroundings of one drone.
pub(crate) struct Bench {
    pub(crate) agent: FlightAgent,
    pub(crate) inputs: Inputs,
    pub(crate) outputs: Outputs,
    pub(crate) step: i64,
    pub(crate) control: Sender,
    pub(crate) pos_enu_m: Vec3,
    commands: u16,
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self::of(AgentConfig::new(ME))
    }

    /// A drone that is born with this.
    pub(crate) fn of(config: AgentConfig) -> Self {
        Self {
            agent: FlightAgent::new(config, None),
            inputs: Inputs::new(),
            outputs: Outputs::new(),
            step: 0,
            control: Sender::new(DroneId::CONTROL, 1),
            pos_enu_m: Vec3::zeros(),
            commands: 0,
        }
    }

    pub(crate) fn now(&self) -> TimePs {
        TimePs::from_us(self.step * STEP_US)
    }

    /// What the drone hears in the next step; in one step no more than fits.
    pub(crate) fn tell(&mut self, message: &Down) {
        let frame = self.control.down(message).expect("a frame holds every message");
        self.inputs.frames.push(frame).expect("there is room");
    }

    /// Gives a command, flies one step and returns the answer.
    pub(crate) fn command(&mut self, command: Command) -> AckStatus {
        self.commands += 1;
        let id = CommandId(self.commands);
        self.tell(&Down::Command { id, command });
        self.fly();
        let answers = self.outputs.uplink.iter().filter_map(|frame| match decode(frame) {
            Ok((_, Message::Up(Up::CommandAck { command, status }))) if command == id => Some(status),
            _ => None,
        });
        let answers: Vec<_> = answers.collect();
        assert_eq!(answers.len(), 1, "every command is answered once");
        answers[0]
    }

    /// One step of a drone that goes where it is told to.
    pub(crate) fn fly(&mut self) {
        self.fly_sensing(|_| {});
    }

    /// The same, with `sense` to change what the drone is to know.
    pub(crate) fn fly_sensing(&mut self, sense: impl FnOnce(&mut Inputs)) {
        self.inputs.battery_permille = 900;
        self.inputs.nav = Some(NavFix {
            pos_enu_m: self.pos_enu_m,
            vel_enu_mps: self.outputs.setpoint.vel_enu_mps,
            error_radius_m: 1.0,
        });
        sense(&mut self.inputs);
        self.outputs.clear();
        let now = self.now();
        self.agent.step(now, &self.inputs, &mut self.outputs);
        self.inputs.clear();
        self.pos_enu_m += self.outputs.setpoint.vel_enu_mps * STEP_S;
        self.step += 1;
    }

    /// Sends all pieces of `lanes_mm`.
    pub(crate) fn send_lanes(&mut self, mission: MissionId, lanes_mm: &[[i32; 2]]) {
        for (index, piece) in lanes_mm.chunks(MAX_LANE_PIECE).enumerate() {
            let first = (index * MAX_LANE_PIECE) as u16;
            let waypoints_mm = piece.iter().copied().collect();
            self.tell(&Down::LanePiece(LanePiece { mission, first, waypoints_mm }));
            self.fly();
        }
    }

    /// Announces, sends and commits a mission.
    pub(crate) fn upload(&mut self, mission: MissionId, lanes_mm: &[[i32; 2]]) -> AckStatus {
        assert_eq!(self.command(Command::UploadBegin(header(mission, lanes_mm))), AckStatus::Accepted);
        self.send_lanes(mission, lanes_mm);
        self.command(Command::UploadCommit { mission, lanes_crc: lanes_crc(lanes_mm) })
    }

    /// Takes off and holds at the mission's altitude.
    pub(crate) fn take_off(&mut self) {
        assert_eq!(self.command(Command::TakeOff), AckStatus::Accepted);
        for _ in 0..3_000 {
            self.tell(&Down::Heartbeat);
            self.fly();
        }
    }
}

/// A mission of the fleet, the drone in slot 0.
pub(crate) fn header(mission: MissionId, lanes_mm: &[[i32; 2]]) -> MissionHeader {
    MissionHeader {
        mission,
        fleet: Some(FleetId(0)),
        mates: FLEET,
        slot: 0,
        spacing_mm: 50_000,
        heading: Heading::Fixed,
        orientation_mrad: 0,
        speed_mmps: 10_000,
        altitude_mm: 50_000,
        home: PosEnuMm([0, 0, 0]),
        waypoints: lanes_mm.len() as u16,
        d_safe_mm: 10_000,
        walls: 0,
        vertical: Vertical::Preferred,
    }
}
