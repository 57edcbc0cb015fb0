//! What went wrong and the exit status it has.

use super::accuracy::AccuracyFailure;
use super::encounter::EncounterFailure;
use super::keys::KeysFailure;
use super::locate::LocateFailure;
use super::output::OutputError;
use super::place::PlaceFailure;
use super::sweep::SweepFailure;
use crate::campaign::{CampaignError, RunFailure};
use crate::runner::{InputError, RunError};
use std::io;
use thiserror::Error;

/// Exit status of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Exit {
    /// Done.
    Ok,
    /// Done, but an acceptance limit of the scenario failed.
    LimitFailed,
    /// Wrong usage or bad input.
    BadInput,
    /// Valid input without a solution.
    Infeasible,
    /// A link or a board failed.
    Link,
    /// Part of a campaign is missing.
    Partial,
    /// The user interrupted.
    Interrupted,
}

impl Exit {
    /// The number that the shell sees.
    pub(super) const fn code(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::LimitFailed => 1,
            Self::BadInput => 2,
            Self::Infeasible => 3,
            Self::Link => 4,
            Self::Partial => 5,
            Self::Interrupted => 130, // 128 + SIGINT, as shells count
        }
    }
}

/// Options that do not go together.
#[derive(Debug, Error)]
#[error("{option}: has no meaning with --backend {backend}; expected --backend {expected} beside it")]
pub(super) struct UsageError {
    /// The option that is too much.
    pub(super) option: &'static str,
    /// The backend it does not go with.
    pub(super) backend: &'static str,
    /// The backend it goes with.
    pub(super) expected: &'static str,
}

/// Why a subcommand has no result.
#[derive(Debug, Error)]
pub(super) enum Failure {
    /// The mission was not flown to its end.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The command line contradicts itself.
    #[error(transparent)]
    Usage(#[from] UsageError),
    /// There is no plan of the sweep.
    #[error(transparent)]
    Sweep(#[from] SweepFailure),
    /// Nothing can be located.
    #[error(transparent)]
    Locate(#[from] LocateFailure),
    /// Nobody can be placed.
    #[error(transparent)]
    Place(#[from] PlaceFailure),
    /// No accuracy can be told.
    #[error(transparent)]
    Accuracy(#[from] AccuracyFailure),
    /// Nobody can meet.
    #[error(transparent)]
    Encounter(#[from] EncounterFailure),
    /// Keys cannot be read or made.
    #[error(transparent)]
    Keys(#[from] KeysFailure),
    /// A campaign does not go on.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    /// The result files cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The results cannot be printed.
    #[error("stdout: cannot be written: {0}")]
    Stdout(#[source] io::Error),
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Self::Run(error.into())
    }
}

impl Failure {
    /// The exit status it has.
    pub(super) const fn exit(&self) -> Exit {
        match self {
            Self::Usage(_)
            | Self::Locate(_)
            | Self::Place(_)
            | Self::Accuracy(_)
            | Self::Encounter(_)
            | Self::Keys(_)
            | Self::Output(_)
            | Self::Stdout(_) => Exit::BadInput,
            Self::Sweep(failure) => failure.exit(),
            Self::Campaign(failure) => of_campaign(failure),
            Self::Run(failure) => of_run(failure),
        }
    }
}

const fn of_run(failure: &RunError) -> Exit {
    match failure {
        RunError::BadInput(_) => Exit::BadInput,
        RunError::Infeasible(_) => Exit::Infeasible,
        RunError::Link(_) | RunError::Ended(_) | RunError::Broken { .. } => Exit::Link,
        RunError::Interrupted => Exit::Interrupted,
    }
}

const fn of_campaign(failure: &CampaignError) -> Exit {
    match failure {
        CampaignError::Partial { .. } => Exit::Partial,
        CampaignError::Interrupted => Exit::Interrupted,
        CampaignError::Run { source: RunFailure::Mission(failure), .. } => of_run(failure),
        _ => Exit::BadInput,
    }
}
