//! What can be wrong with a file of captures.

use std::fmt;
use std::path::PathBuf;

use thiserror::Error;

use crate::control::quoted::quoted;

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

/// A fault in a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The line, from 1.
    pub line: u32,
    /// The column's name, where one field is at fault.
    pub column: Option<&'static str>,
    /// What is there.
    pub found: String,
    /// What should be there.
    pub expected: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}", self.line)?;
        if let Some(column) = self.column {
            write!(f, ", {column}")?;
        }
        write!(f, ": found {}, expected {}", self.found, self.expected)
    }
}

impl Fault {
    /// Of a whole line.
    pub(super) fn line(line: u32, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { line, column: None, found: found.into(), expected: expected.into() }
    }

    /// Of one field.
    pub(super) fn field(line: u32, column: &'static str, found: &[u8], expected: impl Into<String>) -> Self {
        let found = quoted(&String::from_utf8_lossy(found));
        Self { line, column: Some(column), found, expected: expected.into() }
    }
}
