//! Where the flight code runs: behind one trait, so that the runner neither knows nor cares.

use skyroost_firmware::{
    agent::FlightAgent,
    io::{Inputs, Outputs},
};
use skyroost_protocol::units::TimePs;
use thiserror::Error;

/// A board failed.
#[derive(Debug, Error)]
#[error("board of drone {drone}: {what}")]
pub struct BoardError {
    /// Whose.
    pub drone: u16,
    /// What happened.
    pub what: String,
}

/// Something that runs one drone's flight code.
pub trait Board: Send {
    /// One step of the flight code; `outputs` are cleared by the caller.
    ///
    /// # Errors
    /// When the board crashed, hangs or answers nonsense.
    fn step(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) -> Result<(), BoardError>;
}

/// In this process: nothing between the runner and the flight code.
impl Board for FlightAgent {
    fn step(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) -> Result<(), BoardError> {
        FlightAgent::step(self, now, inputs, outputs);
        Ok(())
    }
}
