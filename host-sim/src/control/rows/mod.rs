//! Files of rows: lines, fields and what can be wrong with them, told by line and column.

mod lines;

use std::fmt;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::quoted::quoted;
pub(super) use lines::{Field, LineError, Lines, split};

const MOST_LABEL_BYTES: usize = 200;

/// Why a file is not read.
#[derive(Debug, Error)]
pub enum RowsError {
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

impl RowsError {
    /// Why there is no next line of `file`.
    pub(super) fn new(file: &Path, error: LineError) -> Self {
        let file = file.to_path_buf();
        match error {
            LineError::Fault(fault) => Self::Content { file, fault },
            LineError::Io(source) => Self::Read { file, source },
        }
    }
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
    pub(in crate::control) fn line(line: u32, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { line, column: None, found: found.into(), expected: expected.into() }
    }

    /// Of one field.
    pub(in crate::control) fn field(
        line: u32,
        column: &'static str,
        found: &[u8],
        expected: impl Into<String>,
    ) -> Self {
        let found = quoted(&String::from_utf8_lossy(found));
        Self { line, column: Some(column), found, expected: expected.into() }
    }
}

/// A name: text of some length without control characters.
pub(super) fn name(line: u32, column: &'static str, field: Field<'_>) -> Result<String, Fault> {
    let bytes = field.unescaped();
    let refuse = |expected: &str| Fault::field(line, column, &bytes, expected);
    let Ok(name) = std::str::from_utf8(&bytes) else {
        return Err(Fault { found: "bytes that are no UTF-8".to_owned(), ..refuse("text in UTF-8") });
    };
    let name = name.trim();
    if name.is_empty() {
        return Err(refuse("a name"));
    }
    if name.len() > MOST_LABEL_BYTES {
        return Err(refuse(&format!("a name of at most {MOST_LABEL_BYTES} bytes")));
    }
    if name.chars().any(char::is_control) {
        return Err(refuse("a name without control characters"));
    }
    Ok(name.to_owned())
}

/// A number; none where the field is something else.
pub(super) fn float(field: Field<'_>) -> Option<f64> {
    std::str::from_utf8(field.raw.trim_ascii()).ok()?.parse().ok()
}

/// A number of metres.
pub(super) fn metres(line: u32, column: &'static str, field: Field<'_>, most: f64) -> Result<f64, Fault> {
    float(field)
        .filter(|value| value.abs() <= most)
        // Zero has one sign, so that equal rows are equal in every bit.
        .map(|value| value + 0.0)
        .ok_or_else(|| Fault::field(line, column, field.raw, format!("a number of metres within ±{most:e}")))
}
