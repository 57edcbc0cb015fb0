//! What can be wrong with a file that should hold an area.

use std::path::{Path, PathBuf};

use thiserror::Error;

pub(super) use crate::control::quoted::quoted;
use crate::geometry::polygon::PolygonError;
use crate::geometry::region::RegionError;

/// Why a file is no area.
#[derive(Debug, Error)]
pub enum AreaError {
    /// The file cannot be read.
    #[error("{}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The name does not tell the format.
    #[error("{}: found the ending {found:?}, expected .geojson, .json, .kml, .plan or .csv", file.display())]
    UnknownFormat {
        /// The file.
        file: PathBuf,
        /// Its ending.
        found: String,
    },
    /// Something in the file is not what it should be.
    #[error("{}: {place}: found {found}, expected {expected}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// Line, or feature and vertex.
        place: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// A border is no simple polygon.
    #[error("{}: {place}: {source}", file.display())]
    Polygon {
        /// The file.
        file: PathBuf,
        /// The feature and its ring, or the rows; vertices are counted from 1 in the order of the file.
        place: String,
        /// What is wrong with it.
        source: PolygonError,
    },
    /// The polygons together leave nothing to sweep.
    #[error("{}: {source}", file.display())]
    Region {
        /// The file.
        file: PathBuf,
        /// What is wrong with them.
        source: RegionError,
    },
}

/// A fault without the file's name.
#[derive(Debug)]
pub(super) enum Fault {
    Content { place: String, found: String, expected: String },
    Polygon { place: String, source: PolygonError },
    Region(RegionError),
}

impl Fault {
    pub(super) fn content(
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Content { place: place.into(), found: found.into(), expected: expected.into() }
    }

    /// A fault of the file as a whole.
    pub(super) fn file(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::content("the whole file", found, expected)
    }

    pub(super) fn in_file(self, file: &Path) -> AreaError {
        let file = file.to_path_buf();
        match self {
            Self::Content { place, found, expected } => AreaError::Content { file, place, found, expected },
            Self::Polygon { place, source } => AreaError::Polygon { file, place, source },
            Self::Region(source) => AreaError::Region { file, source },
        }
    }
}

/// Several things by their names, the first few of them.
pub(super) fn listed(names: &[String]) -> String {
    const SHOWN: usize = 4;
    let shown = names.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown} and {} more", names.len() - SHOWN) } else { shown }
}
