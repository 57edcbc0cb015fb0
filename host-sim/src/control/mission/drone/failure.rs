//! What goes wrong with a drone's link: why a drone does not do what it is told, and frames that are not taken in.

use skyroost_protocol::{
    PROTOCOL_VERSION, SCHEMA_HASH,
    message::{AckStatus, Command},
    units::DroneId,
};

/// Why a drone does not do what it is told.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DroneFailure {
    /// It speaks another protocol.
    #[error(
        "drone {drone} speaks protocol {version_min} to {version_max} with schema {schema_hash:08x}, \
         expected {PROTOCOL_VERSION} with {SCHEMA_HASH:08x}", drone = .drone.0
    )]
    Incompatible {
        /// Which drone.
        drone: DroneId,
        /// Its oldest version.
        version_min: u8,
        /// Its newest version.
        version_max: u8,
        /// Its schema.
        schema_hash: u32,
    },
    /// It never answered.
    #[error("drone {drone} did not answer {command}", drone = .drone.0)]
    Unreachable {
        /// Which drone.
        drone: DroneId,
        /// What it was told.
        command: &'static str,
    },
    /// It refused.
    #[error("drone {drone} refused {command}: {status:?}", drone = .drone.0)]
    Refused {
        /// Which drone.
        drone: DroneId,
        /// What it was told.
        command: &'static str,
        /// Its answer.
        status: AckStatus,
    },
}

/// Frames of a drone that were not taken in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refusals {
    /// No frame of this protocol, or nothing that a drone says.
    pub rejected: u64,
    /// Not sealed with the drone's key: forged, damaged, or of a boot that is over.
    pub forged: u64,
    /// Seen before, or too old.
    pub repeated: u64,
}

impl Refusals {
    /// Adds those of another link.
    pub fn add(&mut self, other: Self) {
        self.rejected += other.rejected;
        self.forged += other.forged;
        self.repeated += other.repeated;
    }
}

/// A command's name, for people.
pub(super) fn name(command: &Command) -> &'static str {
    match command {
        Command::UploadBegin(_) => "the mission upload",
        Command::UploadCommit { .. } => "the end of the mission upload",
        Command::TakeOff => "take-off",
        Command::StartSweep { .. } => "the start of the sweep",
        Command::Place { .. } => "the placement",
        Command::Hold => "hold",
        Command::ReturnHome => "return home",
        Command::Rekey(_) => "a change of its key",
        Command::PeerKey(_) => "the key of its fleet",
    }
}
