//! Where the flight code runs: behind one trait, so that the runner neither knows nor cares.
//!
//! [`FlightAgent`] runs in this process; an [`Emulator`](qemu::Emulator) runs the board's image, a
//! [`SerialBoard`](serial::SerialBoard) is one. The latter two are reached over the bus
//! ([`skyroost_firmware::board::bus`]), whose host's end is `bus`.

mod bus;
mod image;
mod panic_guard;
pub mod qemu;
pub mod serial;

pub use image::ImageError;

use skyroost_firmware::{
    agent::FlightAgent,
    board::bus::LinkCounters,
    config::AgentConfig,
    counters::Counters,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{key::Key, units::TimePs};
use std::path::PathBuf;
use thiserror::Error;

/// Where the flight code of a mission runs.
#[derive(Clone, Debug, Default)]
pub enum Backend {
    /// In this process.
    #[default]
    InProc,
    /// On emulated boards, one for each drone.
    Qemu(qemu::QemuOptions),
    /// On real boards, in real time: the serial port of each drone's, in order of their ids.
    Serial(Vec<PathBuf>),
}

impl Backend {
    /// As results name it.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::InProc => "inproc",
            Self::Qemu(_) => "qemu",
            Self::Serial(_) => "serial",
        }
    }

    /// Whether steps are waited for: then fleets are worth a thread each, however small.
    pub(crate) const fn is_remote(&self) -> bool {
        !matches!(self, Self::InProc)
    }

    /// Makes ready to start the boards of so many drones.
    pub(crate) fn open(&self, drones: usize) -> Result<Hangar, BackendError> {
        Ok(match self {
            Self::InProc => Hangar::InProc,
            Self::Qemu(options) => Hangar::Qemu(qemu::Launcher::new(options)?),
            Self::Serial(ports) if ports.len() != drones => {
                return Err(BackendError::Ports { ports: ports.len(), drones });
            }
            Self::Serial(ports) => {
                if let Some(port) = serial::first_repeated(ports) {
                    return Err(BackendError::PortTwice(port.clone()));
                }
                Hangar::Serial(serial::Ports::new(ports))
            }
        })
    }
}

/// Boards ready to be started.
pub(crate) enum Hangar {
    InProc,
    Qemu(qemu::Launcher),
    Serial(serial::Ports),
}

impl Hangar {
    /// Starts the board of a drone, with the root key of its link.
    pub(crate) fn start(&self, config: AgentConfig, key: Option<Key>) -> Result<Box<dyn Board>, BoardError> {
        Ok(match self {
            Self::InProc => Box::new(FlightAgent::new(config, key)),
            Self::Qemu(launcher) => Box::new(launcher.start(config, key)?),
            Self::Serial(ports) => Box::new(ports.start(config, key)?),
        })
    }
}

/// A backend cannot start any board.
#[derive(Debug, Error)]
pub enum BackendError {
    /// There is no image to run.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Ports and drones do not match.
    #[error("--backend: found {ports} serial port(s) for {drones} drones; expected one port for each drone")]
    Ports {
        /// Ports given.
        ports: usize,
        /// Drones of the mission.
        drones: usize,
    },
    /// Two drones cannot share a board.
    #[error("--backend: found the port {} twice; expected another port for each drone", .0.display())]
    PortTwice(PathBuf),
}

/// A board failed.
#[derive(Debug, Error)]
#[error("board of drone {drone}{}: {fault}{}", place_of(port), tail_of(log))]
pub struct BoardError {
    /// Whose.
    pub drone: u16,
    /// The port it is at, where it is at one.
    pub port: Option<PathBuf>,
    /// What happened.
    pub fault: BoardFault,
    /// The last lines of its log, oldest first.
    pub log: Vec<String>,
}

fn place_of(port: &Option<PathBuf>) -> String {
    port.as_ref().map_or_else(String::new, |port| format!(" at {}", port.display()))
}

fn tail_of(log: &[String]) -> String {
    if log.is_empty() {
        return String::new();
    }
    format!("\nlast words in its log:\n  {}", log.join("\n  "))
}

/// What can happen to a board.
#[derive(Debug, Error)]
pub enum BoardFault {
    /// It could not be started.
    #[error("cannot be started: {0}")]
    NotStarted(String),
    /// It ended in the middle of the flight.
    #[error("ended: {0}")]
    Ended(String),
    /// It did not answer: it hangs, or is no board of skyroost.
    #[error("has not answered for {seconds} s {doing}; a board answers within milliseconds")]
    Silent {
        /// For how long.
        seconds: u64,
        /// In the middle of what.
        doing: String,
    },
    /// It answered nonsense.
    #[error("answered nonsense: {0}")]
    Nonsense(String),
    /// What was sent to it arrived damaged on a link that damages nothing.
    #[error("received damaged bytes over a link that should not damage any")]
    Damaged,
    /// Its image is of another version.
    #[error(
        "runs an image of another version (bus {bus}, messages {schema:#010x}); build it anew with `cargo xtask firmware`"
    )]
    Version {
        /// The image's version of the bus.
        bus: u16,
        /// The image's hash over the shapes of all messages.
        schema: u32,
    },
    /// The link to it failed.
    #[error("link: {0}")]
    Link(#[from] std::io::Error),
}

/// Something that runs one drone's flight code.
pub trait Board: Send {
    /// Begins a step of the flight code; [`end_step`](Self::end_step) must follow. `outputs` are cleared by the
    /// caller and the same for both.
    ///
    /// # Errors
    /// When the board crashed, hangs or answers nonsense.
    fn begin_step(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) -> Result<(), BoardError>;

    /// Ends the step that was begun: what it wants done is then in `outputs`.
    ///
    /// # Errors
    /// When the board crashed, hangs or answers nonsense.
    fn end_step(&mut self, outputs: &mut Outputs) -> Result<(), BoardError>;

    /// The board starts anew, as after a reset: its memory is gone. Not within a step.
    ///
    /// # Errors
    /// When the board crashed, hangs or answers nonsense, or is one that nobody here can reset.
    fn restart(&mut self, config: AgentConfig, key: Option<Key>) -> Result<(), BoardError>;

    /// How the board fared so far.
    ///
    /// # Errors
    /// When the board crashed, hangs or answers nonsense.
    fn report(&mut self) -> Result<BoardReport, BoardError>;
}

/// How a board fared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoardReport {
    /// What the flight code dropped, refused or clamped.
    pub counters: Counters,
    /// What the board's links dropped, and what the steps cost; none in this process, which has neither.
    pub board: Option<BoardFigures>,
}

/// Figures of a board of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoardFigures {
    /// What its links dropped.
    pub link: LinkCounters,
    /// Steps done.
    pub steps: u32,
    /// Mean instructions of a step, where they are counted.
    pub step_instructions_mean: Option<f64>,
    /// Most instructions of a step, where they are counted.
    pub step_instructions_worst: Option<u64>,
    /// Instructions of all steps together, where they are counted.
    pub step_instructions_sum: Option<u64>,
    /// Most bytes of stack ever in use, where that is measured.
    pub stack_used: Option<u32>,
    /// How punctual it was, where that matters.
    pub punctuality: Option<serial::Punctuality>,
}

/// In this process: nothing between the runner and the flight code.
impl Board for FlightAgent {
    fn begin_step(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) -> Result<(), BoardError> {
        self.step(now, inputs, outputs);
        Ok(())
    }

    fn end_step(&mut self, _outputs: &mut Outputs) -> Result<(), BoardError> {
        Ok(())
    }

    fn restart(&mut self, config: AgentConfig, key: Option<Key>) -> Result<(), BoardError> {
        Self::restart(self, config, key);
        Ok(())
    }

    fn report(&mut self) -> Result<BoardReport, BoardError> {
        Ok(BoardReport { counters: *self.counters(), board: None })
    }
}

/// The workspace that this program was built from, if it is still there.
pub(crate) fn workspace() -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).parent()?.to_owned();
    root.join("xtask").is_dir().then_some(root)
}
