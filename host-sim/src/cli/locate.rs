//! `skyroost locate`: locates users from recorded captures.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use thiserror::Error;

use super::answer::Delivery;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::values::{finite, lon_lat, not_negative, positive};
use crate::control::captures::{Captures, RowsError};
use crate::control::localize::{ClockModel, LocalizeConfig, LocalizeError, Robust, localize};
use crate::geometry::frame::LocalFrame;
use crate::report::locate::LocateReport;

const JSON_FILE: &str = "locate.json";
const USERS_FILE: &str = "users.csv";
const LOCATED_FILE: &str = "located.csv";
const MAP_FILE: &str = "locate.svg";
const GEOJSON_FILE: &str = "users.geojson";

const EXAMPLES: &str = "\
Examples:
  skyroost locate --captures captures.csv
      Clocks synchronised, users at height 0.
  skyroost locate --captures captures.csv --clock shared-linear --user-altitude-m 112 --json
      Offset and drift of every clock estimated with the users, results for a script.
  skyroost locate --captures captures.csv --out found --origin-lon-lat 13.74,51.05
      Tables, a map (found/locate.svg) and a GeoJSON for other maps.

Input: CSV with the columns user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns, in any order, and a row
for each capture: who was heard, when (seconds), by which drone, where that drone was (metres east,
north and up of a local origin), when the signal arrived by that drone's clock, and the standard
deviation of that (nanoseconds). Rows of one user and epoch are one transmission. What epochs and
arrivals count from does not matter; all their digits do.

Outputs: a summary, or with --json one object. Its users have id, x_m, y_m, cov_m2, r95_m (the
circle that holds 95 %), status, occasions and rejected captures; clock has offset_ns and
drift_ns_per_s of each drone against reference_drone at reference_epoch_s; warnings names what was
left out. Only the status ok claims a position: ambiguous, poor_geometry and inconsistent come with
a best guess, not_located with none. users.csv has all users, located.csv those that are ok
(id,x_m,y_m,r_e_m). Files appear together at the end; files of the same names are replaced.

Exit status: 0 done, 2 wrong usage or bad input (the line is named, nothing is written).";

/// Locate users from recorded captures: positions, 95 % radii, clocks
///
/// Estimates all users of a file of arrival times together, and the drones' clocks with them, by the method that
/// missions use.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct LocateArgs {
    /// File with the captures: .csv (user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns)
    #[arg(long, value_name = "FILE")]
    captures: PathBuf,

    /// What is unknown about the drones' clocks
    #[arg(long, value_name = "MODEL", default_value = "none")]
    clock: Clock,

    /// Height of all users above the origin
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "0", value_parser = finite)]
    user_altitude_m: f64,

    /// Standard deviation of the users' heights about that; above 0 they are estimated too
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "0", value_parser = not_negative)]
    user_altitude_sigma_m: f64,

    /// How late captures, around corners, are kept from spoiling a position
    #[arg(long, value_name = "METHOD", default_value = "tukey")]
    robust: Robustness,

    /// Standard deviation of the drones' positions along the line of sight, anew for every capture (RTK: 0.02)
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "0", value_parser = not_negative)]
    drone_pos_sigma_m: f64,

    /// The same of each coordinate, for as long as a user is heard (standalone GNSS: 1.5)
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "0", value_parser = not_negative)]
    drone_bias_sigma_m: f64,

    /// A user with a wider 95 % circle is poor_geometry, not ok
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "300", value_parser = positive)]
    max_r95_m: f64,

    /// Where the local origin lies, in degrees; for users.geojson
    #[arg(long, value_name = "LON,LAT", allow_hyphen_values = true, value_parser = lon_lat)]
    origin_lon_lat: Option<[f64; 2]>,

    /// Directory for locate.json, users.csv, located.csv, locate.svg (a map) and users.geojson
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Print the answer as one JSON object, the same as locate.json
    #[arg(long)]
    json: bool,

    /// No logs, only results and errors
    #[arg(long, short)]
    quiet: bool,
}

/// `--clock`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Clock {
    /// Nothing: all drones have the same time
    None,
    /// An offset of each drone, which stays
    SharedConstant,
    /// An offset and a drift of each drone, which stay
    SharedLinear,
}

/// `--robust`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Robustness {
    /// Tukey's biweight: a capture more than 6 standard deviations off counts nothing
    Tukey,
    /// Least squares: every capture counts
    None,
}

/// Why nobody is located.
#[derive(Debug, Error)]
pub(crate) enum LocateFailure {
    /// The captures cannot be read.
    #[error(transparent)]
    Captures(#[from] RowsError),
    /// An option is out of the estimator's range.
    #[error("{0}")]
    Config(String),
}

impl From<LocalizeError> for LocateFailure {
    fn from(error: LocalizeError) -> Self {
        Self::Config(match error {
            LocalizeError::Config { field, found, expected } => {
                format!("--{}: found {found:?}, expected {expected}", field.replace('_', "-"))
            }
            other @ LocalizeError::LateLength { .. } => other.to_string(),
        })
    }
}

impl From<Clock> for ClockModel {
    fn from(clock: Clock) -> Self {
        /// Wider than any clock: the estimator takes it for no knowledge.
        const ANYTHING: f64 = 1e9;
        match clock {
            Clock::None => Self::Synchronised,
            Clock::SharedConstant => Self::SharedConstant,
            Clock::SharedLinear => Self::SharedWander {
                offset_sigma_ns: ANYTHING,
                drift_sigma_ns_per_s: ANYTHING,
                walk_ns_per_sqrt_s: 0.0,
            },
        }
    }
}

impl LocateArgs {
    fn config(&self) -> LocalizeConfig {
        let default = LocalizeConfig::default();
        LocalizeConfig {
            clock: self.clock.into(),
            user_altitude_m: self.user_altitude_m,
            user_altitude_sigma_m: self.user_altitude_sigma_m,
            drone_pos_sigma_m: self.drone_pos_sigma_m,
            drone_bias_sigma_m: self.drone_bias_sigma_m,
            robust: match self.robust {
                Robustness::Tukey => default.robust,
                Robustness::None => Robust::None,
            },
            max_r95_m: self.max_r95_m,
            ..default
        }
    }

    /// Reads the captures and locates everybody in them.
    fn report(&self) -> Result<LocateReport, LocateFailure> {
        let config = self.config();
        config.check()?;
        let captures = Captures::read(&self.captures)?;
        let prepared = captures.prepare(self.clock != Clock::None);
        let localization = localize(&prepared.occasions, &config)?;
        let frame = self.origin_lon_lat.map(|[lon_deg, lat_deg]| LocalFrame::new(lon_deg, lat_deg));
        let source = self.captures.display().to_string();
        Ok(LocateReport::new(source, &captures, &prepared, config, &localization, frame))
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &LocateArgs) -> Result<Exit, Failure> {
    let console = Console::new(args.quiet);
    let report = args.report()?;
    let json = report.to_json();
    let to = Delivery { out: args.out.as_deref(), json: args.json, picture: ("Map", MAP_FILE) };
    to.deliver(&console, &report, &json, || {
        vec![
            (JSON_FILE, Some(json.clone())),
            (USERS_FILE, Some(report.to_users_csv())),
            (LOCATED_FILE, Some(report.to_located_csv())),
            (MAP_FILE, Some(report.to_svg())),
            (GEOJSON_FILE, report.to_geojson()),
        ]
    })?;
    Ok(Exit::Ok)
}
