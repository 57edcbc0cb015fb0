//! Campaigns: the same methods on many random users, in blocks that any machine may run (docs/campaigns.md).
//!
//! - `plan`: what is varied, from TOML,
//! - `runs`: the runs by number, and their chance,
//! - `closed`: a run in the paper's closed model, `search` its random search,
//! - `flown`: a run flown,
//! - `manifest`: what is to be done by which program,
//! - `block`: the text of a block, and what may be wrong with it,
//! - `store`: the directory of a campaign: blocks done, missing and to be done,
//! - `merge`: all rows together; `parquet` is one of their files,
//! - `statistics`, `figures`: means, intervals and crossovers.
//!
//! A block is pure: its bytes are a function of manifest and number, whatever machine, order or number of threads. It
//! appears by a rename, so that it is there whole or not at all, and bears a checksum, so that damage is seen and the
//! block run again. So blocks may be run by anything that starts commands: killed, started twice, in any order.

pub mod block;
mod closed;
pub mod figures;
mod files;
mod flown;
mod manifest;
mod merge;
mod parquet;
pub mod plan;
mod runs;
pub mod search;
pub mod statistics;
mod store;

use crate::control::accuracy::AccuracyError;
use crate::control::place::PlaceError;
use crate::runner::RunError;
use crate::scenario::ScenarioError;
use crate::world::users::UsersError;

pub use closed::{Closed, MOST_TOGETHER};
pub use files::FileError;
pub use flown::Flown;
pub use manifest::{Manifest, ManifestError};
pub use merge::{Merged, RESULTS_CSV, RESULTS_PARQUET, TIMES_CSV};
pub use runs::{Row, Run};
pub use store::{Campaign, Left, Progress};

/// A row and how long it took.
#[derive(Clone, Copy, Debug)]
pub struct Timed {
    /// The row.
    pub row: Row,
    /// Time of the method alone, seconds. Never part of results.
    pub wall_s: f64,
}

/// Why a run has no rows.
#[derive(Debug, thiserror::Error)]
pub enum RunFailure {
    /// Its users cannot be drawn.
    #[error(transparent)]
    Users(#[from] UsersError),
    /// Its drones cannot be placed.
    #[error(transparent)]
    Place(#[from] PlaceError),
    /// Its mission was not flown to the end.
    #[error(transparent)]
    Mission(#[from] RunError),
}

/// Why a campaign does not go on.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// The plan is wrong.
    #[error(transparent)]
    Plan(#[from] ScenarioError),
    /// The plan's formation cannot tell how well it locates.
    #[error("{file}: fleet: {source}")]
    Formation {
        /// The plan.
        file: String,
        /// Why.
        source: AccuracyError,
    },
    /// The manifest is wrong, or another one's.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// There is no such block.
    #[error("--block: found {found}, expected 0 to {last}")]
    NoBlock {
        /// The number asked for.
        found: u64,
        /// The last block.
        last: u64,
    },
    /// Blocks are still to be done.
    #[error("{left}")]
    Partial {
        /// Which.
        left: Left,
    },
    /// A run failed.
    #[error("run {run}: {source}")]
    Run {
        /// Its number.
        run: u64,
        /// Why.
        source: RunFailure,
    },
    /// The user interrupted; blocks that are done stay.
    #[error("interrupted")]
    Interrupted,
}
