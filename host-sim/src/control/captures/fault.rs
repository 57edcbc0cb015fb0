//! What can be wrong with a file of captures.

use std::path::PathBuf;

use thiserror::Error;

use crate::control::rows::Fault;

/// Why a file is no list of captures.
#[derive(Debug, Error)]
pub enum CapturesError {
    /// The file cannot be read.
    #[error("{}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A line is not what it should be.
    #[error("{}: {fault}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// The line, what was found there and what is expected.
        fault: Fault,
    },
}
