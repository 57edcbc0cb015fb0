//! The same flight code twice, in this process and on an emulated board, held against each other.

use skyroost_firmware::{
    STEP_US, Vec3,
    agent::FlightAgent,
    config::AgentConfig,
    counters::Counters,
    io::{Inputs, Outputs, Setpoint},
};
use skyroost_host_sim::fleet::{
    Board, BoardReport,
    qemu::{Emulator, Launcher, QemuOptions},
};
use skyroost_protocol::{key::Key, message::FlightPhase, units::TimePs};
use skyroost_tests::boards::image;
use std::sync::OnceLock;

/// A flight agent here and one on a board, born alike.
pub(crate) struct Pair {
    host: FlightAgent,
    board: Emulator,
    outputs: Outputs,
    from_board: Outputs,
    steps: u32,
    /// Phases that they were in.
    pub(crate) phases: Vec<FlightPhase>,
}

impl Pair {
    pub(crate) fn new(config: AgentConfig, key: Option<Key>) -> Self {
        static LAUNCHER: OnceLock<Launcher> = OnceLock::new();
        let options = || QemuOptions { image: Some(image().to_owned()), log_dir: None };
        let launcher = LAUNCHER.get_or_init(|| Launcher::new(&options()).expect("the image of the board"));
        Self {
            host: FlightAgent::new(config, key.clone()),
            board: launcher.start(config, key).expect("an emulated board"),
            outputs: Outputs::default(),
            from_board: Outputs::default(),
            steps: 0,
            phases: Vec::new(),
        }
    }

    /// Has both do a step and says what differs, if anything does.
    pub(crate) fn step(&mut self, now: TimePs, inputs: &Inputs) -> Result<&Outputs, String> {
        self.steps += 1;
        self.outputs.clear();
        self.from_board.clear();
        let began = self.board.begin_step(now, inputs, &mut self.from_board);
        self.host.step(now, inputs, &mut self.outputs);
        let told = began.and_then(|()| self.board.end_step(&mut self.from_board));
        told.map_err(|error| format!("step {} at {now:?}: {error}\n{inputs:?}", self.steps))?;
        if self.phases.last() != Some(&self.host.phase()) {
            self.phases.push(self.host.phase());
        }
        match difference(&self.outputs, &self.from_board) {
            None => Ok(&self.outputs),
            Some(what) => Err(format!("step {} at {now:?}: {what}\n{inputs:?}", self.steps)),
        }
    }

    /// What both want done since the last step.
    pub(crate) fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// Holds what both counted against each other, and returns it.
    pub(crate) fn end(&mut self) -> Result<Counters, String> {
        let BoardReport { counters, board } = self.board.report().map_err(|error| error.to_string())?;
        let figures = board.expect("an emulated board has figures");
        if counters != *self.host.counters() {
            return Err(format!("counts: here {:?}\non the board {counters:?}", self.host.counters()));
        }
        if figures.link != skyroost_firmware::board::bus::LinkCounters::default()
            || figures.steps != self.steps
        {
            return Err(format!("after {} steps the board's links say {figures:?}", self.steps));
        }
        Ok(counters)
    }
}

/// Time of so many steps.
pub(crate) const fn steps_long(steps: i64) -> TimePs {
    TimePs::from_us(steps * STEP_US)
}

/// What differs between the outputs of both, if anything does.
fn difference(host: &Outputs, board: &Outputs) -> Option<String> {
    // Named in full, so that a new output cannot be forgotten.
    let Outputs { setpoint, uplink, peer, srs_gates } = host;
    let differ = |what: &str, host: &dyn std::fmt::Debug, board: &dyn std::fmt::Debug| {
        Some(format!("{what}: here {host:?}\non the board {board:?}"))
    };
    if bits(setpoint) != bits(&board.setpoint) {
        return differ("setpoint", setpoint, &board.setpoint);
    }
    if *uplink != board.uplink {
        return differ("frames for the control center", uplink, &board.uplink);
    }
    if *peer != board.peer {
        return differ("frames for the mates", peer, &board.peer);
    }
    if *srs_gates != board.srs_gates {
        return differ("gates", srs_gates, &board.srs_gates);
    }
    None
}

/// All bits of a setpoint; every NaN is the same one, as processors differ in which they produce.
fn bits(setpoint: &Setpoint) -> (bool, [[u32; 3]; 2]) {
    let Setpoint { motors, vel_enu_mps, accel_enu_mps2 } = *setpoint;
    let of = |v: Vec3| <[f32; 3]>::from(v).map(|x| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() });
    (motors, [of(vel_enu_mps), of(accel_enu_mps2)])
}
