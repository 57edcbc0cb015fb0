//! How a mistake in a scenario is told.

use std::fmt;
use thiserror::Error;

/// Why a scenario cannot be flown: always bad input, never a hard instance.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("{file}: cannot be read: {source}; expected a scenario in TOML")]
    Unreadable {
        /// The file.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{place}: not valid TOML: {message}")]
    Syntax {
        /// Where.
        place: Place,
        /// What the parser says.
        message: String,
    },
    /// A key that is unknown, or a value of the wrong type or out of range.
    #[error("{place}: {field}: found {found}, expected {expected}")]
    Value {
        /// Where the value was stated.
        place: Place,
        /// The key with its table, as `fleet.drones`.
        field: String,
        /// What was found.
        found: String,
        /// What would be right.
        expected: String,
    },
}

impl ScenarioError {
    /// Sorts a complaint of the TOML deserializer about `field` into found and expected.
    pub(super) fn from_toml(place: Place, field: &str, message: &str) -> Self {
        // The three forms of `serde::de::Error`: "unknown field `x`, expected one of ...",
        // "unknown variant `x`, expected ..." and "invalid type: x, expected y" (or "invalid value").
        let first_line = message.lines().next().unwrap_or_default();
        let (complaint, expected) =
            first_line.split_once(", expected ").unwrap_or((first_line, "what the documentation states"));
        let found = if complaint.starts_with("unknown field") {
            "an unknown key".to_owned()
        } else if let Some(variant) = complaint.strip_prefix("unknown variant ") {
            variant.to_owned()
        } else {
            ["invalid type: ", "invalid value: ", "invalid "]
                .iter()
                .find_map(|prefix| complaint.strip_prefix(prefix))
                .unwrap_or(complaint)
                .to_owned()
        };
        let expected = match expected {
            "f64" => "a number",
            "u32" | "u64" => "a whole number, 0 or greater",
            "path string" => "the name of a file",
            table if table.starts_with("struct ") => "a table",
            other => other,
        };
        Self::Value { place, field: field.to_owned(), found, expected: expected.to_owned() }
    }
}

/// Where a value was stated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line of a file, counted from 1.
    Line {
        /// The file.
        file: String,
        /// The line.
        line: usize,
    },
    /// Nowhere in this file: a default.
    Default {
        /// The file.
        file: String,
    },
    /// An option of the command line.
    Option(&'static str),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { file, line } => write!(f, "{file}:{line}"),
            Self::Default { file } => write!(f, "{file} (default)"),
            Self::Option(option) => f.write_str(option),
        }
    }
}
