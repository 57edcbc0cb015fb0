//! `skyroost encounter`: vehicles past each other, by the flight code's avoidance.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use thiserror::Error;

use super::console::Console;
use super::exit::{Exit, Failure};
use super::output::staged;
use crate::encounter::{Avoidance, Encounter, EncounterError, Family, draw, fly};
use crate::report::encounter::EncounterReport;

const EXAMPLES: &str = "\
Examples:
  skyroost encounter --scenario crossing.json
      Who comes how close to whom, and when everybody is there.
  skyroost encounter --scenario crossing.json --avoidance off --json
      The same without avoidance, for a script.
  skyroost encounter --generate circle --vehicles 20 --seed 3 --trajectory circle.csv
      Twenty on a circle, each with its goal opposite; where everybody was at every step.

Input: JSON with d_safe_m, dt_s, duration_s, max_accel_mps2, max_speed_mps, share_delay_s,
share_period_s, share_loss, r_s_m, noise, seed (each has a default) and vehicles, each with id,
pos_m, vel_mps, goal_m (metres, ENU) and cooperative. A vehicle that begins with a speed keeps it
as its cruise speed. noise says how positions err: uniform; adversarial, by the whole of r_s_m,
away from the nearest neighbour; adversarial-shared, so only in what others are told.

Outputs: a summary, or with --json one object: min_separation_m (true centres, continuous time,
pairs of which one cooperates), violations (such pairs below d_safe_m), vehicles, arrived,
arrival_s, overhead_fraction (how much longer than alone, on average).

Exit status: 0 done, also with violations; 2 wrong usage or bad input (nothing is written).";

/// Fly vehicles past each other with the flight code's collision avoidance
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct EncounterArgs {
    /// File with the encounter (JSON)
    #[arg(long, value_name = "FILE", required_unless_present = "generate", conflicts_with = "generate")]
    scenario: Option<PathBuf>,

    /// Draw an encounter instead
    #[arg(long, value_name = "FAMILY")]
    generate: Option<Kind>,

    /// How many of a family that has no number of its own
    #[arg(long, value_name = "N", requires = "generate", value_parser = clap::value_parser!(u16).range(1..=1000))]
    vehicles: Option<u16>,

    /// Seed of everything random [default: that of the file, or 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// What a vehicle does about others
    #[arg(long, value_name = "RULE", default_value = "on")]
    avoidance: Choice,

    /// File for where everybody is at every step, t_s,id,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,

    /// Print the answer as one JSON object
    #[arg(long)]
    json: bool,

    /// No logs, only results and errors
    #[arg(long, short)]
    quiet: bool,
}

/// `--avoidance`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// The flight code's avoidance
    On,
    /// Straight on
    Off,
    /// The paper's pairwise rule with its signs mended, for comparison
    LiteralPca,
}

/// `--generate`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Two that pass near one point at about one time
    Crossing,
    /// All on a circle, each with its goal opposite
    Circle,
    /// Anywhere in a box, to anywhere in it
    Box,
    /// Two fleets of three through each other
    Fleets,
    /// Fleets that end their lanes and leave for sites
    SweepEnd,
    /// A fast one behind a slow one
    Overtake,
    /// One past another that hovers
    Hover,
    /// A crossing where the second does not avoid
    Intruder,
    /// Two towards each other on one line
    HeadOn,
    /// Two whose ways meet at a small angle
    Shallow,
}

/// Why nobody meets.
#[derive(Debug, Error)]
pub(crate) enum EncounterFailure {
    /// The file cannot be read.
    #[error("{}: {error}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// It is no encounter.
    #[error("{}: {error}; expected an encounter as `skyroost encounter --help` describes it", file.display())]
    Json {
        /// The file.
        file: PathBuf,
        /// What is wrong, with line and column.
        error: serde_json::Error,
    },
    /// A value is out of range.
    #[error("{from}: {error}")]
    Value {
        /// File or family.
        from: String,
        /// What is wrong.
        error: EncounterError,
    },
}

impl EncounterArgs {
    fn encounter(&self) -> Result<(String, Encounter), EncounterFailure> {
        let (from, mut encounter) = match (&self.scenario, self.generate) {
            (Some(file), _) => (file.display().to_string(), read(file)?),
            (None, kind) => {
                let family = kind.map_or(Family::Crossing, Kind::family);
                let count = self.vehicles.map_or(family.usual_count(), usize::from);
                let drawn = draw(family, count, self.seed.unwrap_or(1));
                (format!("the family {}", kind.map_or_else(String::new, Kind::name)), drawn)
            }
        };
        if let Some(seed) = self.seed {
            encounter.seed = seed;
        }
        encounter.check().map_err(|error| EncounterFailure::Value { from: from.clone(), error })?;
        Ok((from, encounter))
    }
}

fn read(file: &Path) -> Result<Encounter, EncounterFailure> {
    let text = fs::read(file).map_err(|error| EncounterFailure::Read { file: file.to_path_buf(), error })?;
    serde_json::from_slice(&text).map_err(|error| EncounterFailure::Json { file: file.to_path_buf(), error })
}

impl Kind {
    const fn family(self) -> Family {
        match self {
            Self::Crossing => Family::Crossing,
            Self::Circle => Family::Circle,
            Self::Box => Family::Box,
            Self::Fleets => Family::Fleets,
            Self::SweepEnd => Family::SweepEnd,
            Self::Overtake => Family::Overtake,
            Self::Hover => Family::Hover,
            Self::Intruder => Family::Intruder,
            Self::HeadOn => Family::HeadOn,
            Self::Shallow => Family::Shallow,
        }
    }

    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &EncounterArgs) -> Result<Exit, Failure> {
    let (source, encounter) = args.encounter().map_err(Failure::Encounter)?;
    let (avoidance, name) = match args.avoidance {
        Choice::On => (Avoidance::On, "on"),
        Choice::Off => (Avoidance::Off, "off"),
        Choice::LiteralPca => (Avoidance::LiteralPca, "literal-pca"),
    };
    let mut table = "t_s,id,x_m,y_m,z_m\n".to_owned();
    let mut watch = |t_s: f64, places: &[(u16, crate::geometry::V3)]| {
        if args.trajectory.is_some() {
            for (id, at) in places {
                let _ = writeln!(table, "{t_s:.3},{id},{:.4},{:.4},{:.4}", at.x, at.y, at.z);
            }
        }
    };
    let outcome = fly(&encounter, &avoidance, &mut watch)
        .map_err(|error| Failure::Encounter(EncounterFailure::Value { from: source.clone(), error }))?;
    if let Some(file) = &args.trajectory {
        let dir = file.parent().filter(|dir| !dir.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        staged("--trajectory", dir, &[(name, table)])?.commit()?;
    }
    let report = EncounterReport { source, d_safe_m: encounter.d_safe_m, avoidance: name, outcome };
    Console::print(&if args.json { report.to_json() } else { report.to_string() })?;
    Ok(Exit::Ok)
}
