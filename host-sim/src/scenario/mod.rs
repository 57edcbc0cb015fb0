//! What a mission is flown with: the area, the fleet, the users and how imperfect the world is.
//!
//! A [`Scenario`] is read from TOML. Every key has a default, and the defaults are the paper's
//! scenario (its Table 3, with the simulator's own figures where the paper is silent), so a file
//! states only what differs. Every key carries its unit, unknown keys are refused, and whatever is
//! wrong is named with file, line and field ([`ScenarioError`]) before anything flies.
//!
//! - `tables`: the keys and their defaults,
//! - `check`: what the values must satisfy,
//! - `source`: which line, or which option of the command line, a value came from,
//! - `error`: how a mistake is told.

mod check;
mod error;
mod source;
mod tables;

pub use error::{Place, ScenarioError};
pub use source::Source;
pub use tables::{
    AreaTable, BatteryTable, ClockTable, FaultKind, FaultTable, FenceTable, FleetTable, GnssMode, GnssTable,
    LimitsTable, LinkTable, LossTable, MissionTable, ObstaclesTable, Orientation, PartitionTable, Scenario,
    SplitMode, SrsTable, UsersTable, WindTable,
};

use serde::{Deserialize as _, de::DeserializeOwned};
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, Deserializer, ValueDeserializer};

/// The scenario that is flown when no file is given, as a file would state it.
const PAPER_TOML: &str = include_str!("../../scenarios/paper.toml");

/// A scenario together with where each of its values was stated, so that a mistake found late
/// (after an option replaced a value, or against another file) still names the line to mend.
#[derive(Clone, Debug)]
pub struct LoadedScenario {
    /// The values.
    pub scenario: Scenario,
    /// Where they were stated.
    pub source: Source,
}

impl LoadedScenario {
    /// The built-in scenario of the paper.
    ///
    /// # Panics
    /// Never: the text is part of the program, and a test reads it.
    #[must_use]
    pub fn paper() -> Self {
        match Self::from_toml(PAPER_TOML, "built-in scenario `paper`", Path::new("")) {
            Ok(loaded) => loaded,
            Err(error) => panic!("the built-in scenario is broken: {error}"),
        }
    }

    /// Reads a scenario file. Relative paths in it are taken from the file's own directory.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, or holds an unknown key or a value of the wrong
    /// type. Ranges are checked by [`LoadedScenario::check`], after the command line had its say.
    pub fn read(path: &Path) -> Result<Self, ScenarioError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|source| ScenarioError::Unreadable { file: name.clone(), source })?;
        let directory = path.parent().unwrap_or(Path::new(""));
        Self::from_toml(&text, &name, directory)
    }

    /// Reads a scenario from text; `name` stands for the file in messages, and relative paths are
    /// taken from `directory`.
    ///
    /// # Errors
    /// As [`LoadedScenario::read`].
    pub fn from_toml(text: &str, name: &str, directory: &Path) -> Result<Self, ScenarioError> {
        let source = Source::parse(text, name)?;
        let scenario =
            toml::from_str(text).map_err(|error| source.explain(&error, ScenarioError::from_toml))?;
        Self::found(scenario, source, directory)
    }

    /// Reads a scenario from a text that holds a table of another kind beside it, and that table; none where the text
    /// has none.
    ///
    /// # Errors
    /// As [`LoadedScenario::read`], for the table as well.
    pub fn from_toml_beside<T: DeserializeOwned>(
        table: &str,
        text: &str,
        name: &str,
        directory: &Path,
    ) -> Result<(Option<T>, Self), ScenarioError> {
        let source = Source::parse(text, name)?;
        let explain = |error: &toml::de::Error| source.explain(error, ScenarioError::from_toml);
        let document = DeTable::parse(text).map_err(|error| explain(&error))?;
        let span = document.span();
        let mut keys = document.into_inner();
        let other = keys.remove(table).map(|value| T::deserialize(ValueDeserializer::from(value)));
        let other = other.transpose().map_err(|error| explain(&error))?;
        let scenario = Scenario::deserialize(Deserializer::from(Spanned::new(span, keys)));
        let scenario = scenario.map_err(|error| explain(&error))?;
        Ok((other, Self::found(scenario, source, directory)?))
    }

    /// A scenario as deserialized, with the files it names taken from `directory`.
    fn found(mut scenario: Scenario, source: Source, directory: &Path) -> Result<Self, ScenarioError> {
        source.refuse_pair("area.file", &["area.width_m", "area.height_m"])?;
        source.refuse_pair("fleet.pads_m", &["fleet.base_m", "fleet.pad_spacing_m"])?;
        source.refuse_pair("fence.file", &["fence.margin_m"])?;
        source.refuse_pair("users.file", &["users.density_per_km2"])?;
        let Scenario { area, obstacles, fence, users, .. } = &mut scenario;
        let files = [&mut area.file, &mut obstacles.file, &mut fence.file, &mut users.file];
        for file in files.into_iter().flatten() {
            *file = directory.join(&*file);
        }
        Ok(Self { scenario, source })
    }

    /// Lets the command line replace values.
    pub fn apply(&mut self, overrides: &Overrides) {
        let Overrides { seed, density_per_km2, area, users, drones, loss_fraction, duration_s } = overrides;
        let (scenario, source) = (&mut self.scenario, &mut self.source);
        if let Some(seed) = *seed {
            scenario.seed = seed;
            source.replaced_by("seed", "--seed");
        }
        if let Some(density) = *density_per_km2 {
            scenario.users.density_per_km2 = density;
            scenario.users.file = None;
            source.replaced_by("users.density_per_km2", "--density-per-km2");
        }
        if let Some(file) = area {
            scenario.area.file = Some(file.clone());
            source.replaced_by("area.file", "--area");
        }
        if let Some(file) = users {
            scenario.users.file = Some(file.clone());
            source.replaced_by("users.file", "--users");
        }
        if let Some(drones) = *drones {
            scenario.fleet.drones = drones;
            source.replaced_by("fleet.drones", "--drones");
        }
        if let Some(loss) = *loss_fraction {
            scenario.link.loss_fraction = loss;
            source.replaced_by("link.loss_fraction", "--loss-fraction");
        }
        if let Some(duration) = *duration_s {
            scenario.mission.duration_s = Some(duration);
            source.replaced_by("mission.duration_s", "--duration-s");
        }
    }

    /// Checks every value: finite, in its range, and in keeping with the others.
    ///
    /// # Errors
    /// The first mistake, with the place it was stated.
    pub fn check(&self) -> Result<(), ScenarioError> {
        check::check(&self.scenario, &self.source)
    }
}

/// What the command line may replace in a scenario.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Seed of every random choice.
    pub seed: Option<u64>,
    /// Density of the users; drops a users' file.
    pub density_per_km2: Option<f64>,
    /// File with the area.
    pub area: Option<PathBuf>,
    /// File with the users.
    pub users: Option<PathBuf>,
    /// Number of drones.
    pub drones: Option<u32>,
    /// Fraction of frames that the link loses.
    pub loss_fraction: Option<f64>,
    /// Longest simulated time.
    pub duration_s: Option<f64>,
}

#[cfg(test)]
mod tests;
