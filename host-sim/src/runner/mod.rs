//! Flies a mission: the world, the flight code and the control center in step.

use crate::recording::Recording;
use crate::report::limits::judge;
use crate::report::summary::Summary;
use crate::scenario::{Scenario, ScenarioError};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

/// Everything a mission needs, read and checked before anything flies.
#[derive(Clone, Debug)]
pub struct MissionInput {
    /// The scenario, checked.
    pub scenario: Scenario,
    /// The area to sweep.
    pub area: MissionArea,
    /// The users' true positions; none where they are to be strewn at the scenario's density.
    pub users: Option<Vec<MissionUser>>,
}

/// The area to sweep, in metres from its local origin.
#[derive(Clone, Debug, PartialEq)]
pub struct MissionArea {
    /// Corners in order.
    pub polygon_m: Vec<[f64; 2]>,
    /// Longitude and latitude of the local origin, when the area came in WGS84.
    pub origin_lon_lat_deg: Option<[f64; 2]>,
}

/// A user as the simulated world knows it.
#[derive(Clone, Debug, PartialEq)]
pub struct MissionUser {
    /// Name in the results.
    pub id: String,
    /// True position: east, north.
    pub pos_m: [f64; 2],
}

/// How to fly, apart from what.
pub struct RunOptions<'a> {
    /// Threads to use; the results do not depend on them.
    pub threads: usize,
    /// Polled at least once a simulated second: when set, the run ends with
    /// [`RunError::Interrupted`].
    pub cancel: &'a AtomicBool,
    /// Told how far the mission is, about once a simulated second.
    pub progress: &'a dyn Fn(Progress),
}

/// How far a mission is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// What is going on.
    pub phase: &'static str,
    /// Simulated time, seconds.
    pub simulated_s: f64,
    /// Fraction of the whole mission, 0 to 1.
    pub fraction: f64,
}

/// A flown mission.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Its figures, limits judged.
    pub summary: Summary,
    /// Its tracks, users and events.
    pub recording: Recording,
}

/// Why a mission was not flown to its end.
#[derive(Debug, Error)]
pub enum RunError {
    /// The input cannot be flown as it stands.
    #[error(transparent)]
    BadInput(#[from] InputError),
    /// The input is valid and has no solution.
    #[error("infeasible: {0}")]
    Infeasible(String),
    /// A board or the link to it failed.
    #[error("link: {0}")]
    Link(String),
    /// The user interrupted the run.
    #[error("interrupted")]
    Interrupted,
}

/// What is wrong with the input of a mission.
#[derive(Debug, Error)]
pub enum InputError {
    /// In the scenario.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// In a file that the scenario or the command line names.
    #[error("{place}: found {found}, expected {expected}")]
    File {
        /// The file, with the line where one is known.
        place: String,
        /// What was found.
        found: String,
        /// What would be right.
        expected: &'static str,
    },
}

impl InputError {
    /// A file that cannot be read.
    #[must_use]
    pub fn unreadable(file: &Path, error: &std::io::Error, expected: &'static str) -> Self {
        Self::File { place: file.display().to_string(), found: error.to_string(), expected }
    }
}

/// Flies the mission.
///
/// # Errors
/// As [`RunError`] says; nothing is written in any case.
pub fn fly(input: &MissionInput, options: &RunOptions<'_>) -> Result<Outcome, RunError> {
    let scenario = &input.scenario;
    (options.progress)(Progress { phase: "prepare", simulated_s: 0.0, fraction: 0.0 });
    if options.cancel.load(Ordering::Relaxed) {
        return Err(RunError::Interrupted);
    }
    let mut summary = Summary {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        backend: "inproc".to_owned(),
        drones: scenario.fleet.drones,
        fleets: scenario.fleets(),
        ..Summary::default()
    };
    summary.limits = judge(&scenario.limits, &summary);
    let recording = Recording {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        radius_m: scenario.fleet.radius_m,
        area_m: input.area.polygon_m.clone(),
        origin_lon_lat_deg: input.area.origin_lon_lat_deg,
        ..Recording::default()
    };
    Ok(Outcome { summary, recording })
}
