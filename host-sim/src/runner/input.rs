//! What a run takes and what it gives.

use crate::{
    control::{
        area::{AreaError, Obstacle},
        journal::JournalError,
        keys::LinkKeys,
        mission::{ControlCenter, MissionError},
        sweep::SweepError,
    },
    fleet::{Backend, BackendError, BoardError, BoardReport, ImageError},
    geometry::{
        V2, V3,
        polygon::{Polygon, PolygonError},
        region::Region,
    },
    recording::Recording,
    report::{
        limits::judge,
        summary::{AttackSummary, Summary, Timing},
    },
    scenario::{Scenario, ScenarioError},
    world::users::{User, UsersError},
};
use std::{path::PathBuf, sync::atomic::AtomicBool, time::Duration};
use thiserror::Error;

/// Everything a mission needs, read and checked before anything flies.
#[derive(Clone, Debug)]
pub struct MissionInput {
    /// The scenario, checked.
    pub scenario: Scenario,
    /// The area to sweep.
    pub area: MissionArea,
    /// What drones must not hit, beside the area's no-fly zones.
    pub obstacles: Vec<Obstacle>,
    /// What no drone may leave; none for a fence around everything planned.
    pub fence: Option<Polygon>,
    /// The users' true positions; none where they are to be strewn at the scenario's density.
    pub users: Option<Vec<User>>,
    /// What seals the links.
    pub keys: MissionKeys,
}

/// What seals the links of a mission.
#[derive(Clone, Debug, Default)]
pub enum MissionKeys {
    /// Keys of the scenario's seed: good for a simulation and for nothing else.
    #[default]
    Simulated,
    /// These.
    Given(Box<LinkKeys>),
    /// Nothing: whoever can send can command the drones.
    Unauthenticated,
}

impl MissionInput {
    /// A scenario whose area is its rectangle, and which names no other file.
    ///
    /// # Errors
    /// [`InputError::Polygon`] for a rectangle without an area.
    pub fn of_rectangle(scenario: Scenario) -> Result<Self, InputError> {
        let area = MissionArea::rectangle(&scenario)?;
        Ok(Self {
            scenario,
            area,
            obstacles: Vec::new(),
            fence: None,
            users: None,
            keys: MissionKeys::default(),
        })
    }
}

/// The area to sweep.
#[derive(Clone, Debug)]
pub struct MissionArea {
    /// Where it comes from: its file, or the scenario's keys.
    pub name: String,
    /// What to sweep and where not to fly, in metres from the local origin.
    pub region: Region,
    /// Longitude and latitude of the local origin, when the area came in WGS84.
    pub origin_lon_lat_deg: Option<[f64; 2]>,
    /// What its file holds beside it and is not used, for people.
    pub left_out: Vec<String>,
}

impl MissionArea {
    /// The scenario's rectangle, with its south-west corner at the origin.
    ///
    /// # Errors
    /// [`InputError::Polygon`] for a rectangle without an area.
    pub fn rectangle(scenario: &Scenario) -> Result<Self, InputError> {
        let (width_m, height_m) = (scenario.area.width_m, scenario.area.height_m);
        let corners = [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]].map(V2::from);
        let name = "area.width_m and area.height_m".to_owned();
        let region = Polygon::new(&corners)?.into();
        Ok(Self { name, region, origin_lon_lat_deg: None, left_out: Vec::new() })
    }
}

/// Where the control center keeps its journal.
#[derive(Clone, Debug, Default)]
pub struct JournalOptions {
    /// Its file; none to keep none.
    pub path: Option<PathBuf>,
    /// The file is that of a control center that was killed: the mission goes on where it ends, after so many seconds without a control
    /// center.
    pub resume_after_s: Option<f64>,
}

/// How to fly, apart from what.
pub struct RunOptions<'a> {
    /// Threads to use; the results do not depend on them.
    pub threads: usize,
    /// Where the flight code runs; the results do not depend on it.
    pub backend: Backend,
    /// Polled at least once a simulated second: when set, the run ends with
    /// [`RunError::Interrupted`].
    pub cancel: &'a AtomicBool,
    /// Told how far the mission is, about once a simulated second.
    pub progress: &'a (dyn Fn(Progress) + Sync),
    /// What the control center writes down, and whether it goes on from there.
    pub journal: JournalOptions,
    /// Asked once a simulated second whether all is as it should be, where somebody wants to know.
    pub witness: Option<&'a Witness<'a>>,
}

impl<'a> RunOptions<'a> {
    /// Without a journal or a witness.
    #[must_use]
    pub fn new(
        threads: usize,
        backend: Backend,
        cancel: &'a AtomicBool,
        progress: &'a (dyn Fn(Progress) + Sync),
    ) -> Self {
        Self { threads, backend, cancel, progress, journal: JournalOptions::default(), witness: None }
    }
}

/// Says what is not as it should be.
pub type Witness<'a> = dyn Fn(&Sight<'_>) -> Result<(), String> + Sync + 'a;

/// What a [`Witness`] sees.
pub struct Sight<'a> {
    /// Simulated time, seconds.
    pub t_s: f64,
    /// What the control center knows.
    pub control: &'a ControlCenter,
    /// Whether it is running.
    pub control_is_alive: bool,
    /// Times so far that a pair came nearer than `d_safe`, of drones whose separation is claimed.
    pub violations: u32,
    /// Least distance of such pairs so far, metres.
    pub least_separation_m: Option<f64>,
    /// Least distance within the fence so far, of the same drones, metres.
    pub within_fence_m: Option<f64>,
    /// What became of an attacker's frames so far.
    pub attack: Option<AttackSummary>,
    /// True places of all drones, by id, metres.
    pub positions_m: &'a [V3],
    /// Drones whose boards are dead, by id.
    pub dead: &'a [bool],
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
    /// Where the wall-clock time of the flight went: parts and their shares, summing to 1. Not part of the
    /// results, as it differs from run to run.
    pub shares: Vec<(&'static str, f64)>,
    /// How the boards fared, by id. Not part of the results, as it differs from backend to backend.
    pub boards: Vec<BoardReport>,
}

impl Outcome {
    /// Sets the clock times and judges the limits, last of all.
    pub(super) fn finish(&mut self, scenario: &Scenario, simulated_s: f64, wall: Duration) {
        self.summary.timing = Timing::new(simulated_s, wall.as_secs_f64());
        self.summary.limits = judge(&scenario.limits, &self.summary);
    }
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
    /// A witness saw what must not be.
    #[error("at {at_s:.2} s: {invariant}")]
    Broken {
        /// What.
        invariant: String,
        /// Simulated seconds.
        at_s: f64,
    },
    /// The mission came to an end of its own.
    #[error("link: {0}")]
    Ended(MissionError),
    /// The user interrupted the run.
    #[error("interrupted")]
    Interrupted,
}

impl From<BoardError> for RunError {
    fn from(error: BoardError) -> Self {
        Self::Link(error.to_string())
    }
}

impl From<BackendError> for RunError {
    fn from(error: BackendError) -> Self {
        match error {
            // A file that the user named and that is not there is the user's to mend.
            BackendError::Image(error @ ImageError::Unreadable { .. }) => {
                Self::BadInput(InputError::Image(error))
            }
            BackendError::Ports { .. } | BackendError::PortTwice(_) => {
                Self::BadInput(InputError::Ports(error))
            }
            other => Self::Link(other.to_string()),
        }
    }
}

impl From<MissionError> for RunError {
    fn from(error: MissionError) -> Self {
        match error {
            MissionError::Goals(conflict) => Self::Infeasible(conflict.to_string()),
            other => Self::Ended(other),
        }
    }
}

/// What is wrong with the input of a mission.
#[derive(Debug, Error)]
pub enum InputError {
    /// In the image for the boards.
    #[error(transparent)]
    Image(ImageError),
    /// In the number of serial ports.
    #[error(transparent)]
    Ports(BackendError),
    /// In the control center's journal.
    #[error(transparent)]
    Journal(JournalError),
    /// In the scenario.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// In the file with the area.
    #[error(transparent)]
    Area(#[from] AreaError),
    /// A file in WGS84 beside an area that is not.
    #[error(
        "{key}: found an area in local metres, expected one in WGS84 (.geojson, .kml or .plan) to place the file in"
    )]
    Frameless {
        /// The scenario's key with the file.
        key: &'static str,
    },
    /// In the corners of the area.
    #[error("area: {0}")]
    Polygon(#[from] PolygonError),
    /// In the file with the users, or in their density.
    #[error(transparent)]
    Users(#[from] UsersError),
    /// The area cannot be swept as asked.
    #[error("{area}: {source}")]
    Sweep {
        /// Where the area comes from.
        area: String,
        /// What is wrong with it.
        source: SweepError,
    },
}
