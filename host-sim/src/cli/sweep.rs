//! `skyroost sweep`: plans how fleets sweep an area, and writes it for scripts, maps and autopilots.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use thiserror::Error;

use super::console::Console;
use super::exit::{Exit, Failure};
use super::output::{OutputDir, staged};
use super::values::{lon_lat, not_negative, pair, positive};
use crate::control::air_to_ground::{AirToGround, Environment, ServedDisk};
use crate::control::area::{Area, AreaError};
use crate::control::sweep::{self, SplitMode, SweepError, SweepPlan, SweepRequest};
use crate::geometry::V2;
use crate::report::sweep::{ModeFigures, ModeTried, SweepReport, WayBlocked};
use crate::runner::formation::{self, Pads};

const JSON_FILE: &str = "sweep.json";
const MAP_FILE: &str = "sweep.svg";
const GEOJSON_FILE: &str = "sweep.geojson";

const EXAMPLES: &str = "\
Examples:
  skyroost sweep --area town.geojson --fleets 2 --out sweep
      Plans the sweep, says whether it fits 100 minutes, and draws it: sweep/sweep.svg.
  skyroost sweep --area town.kml --fleets 3 --plan missions --base-lon-lat 13.74,51.05
      Nine missions for QGroundControl, from a base of one's own.
  skyroost sweep --area field.csv --fleets 2 --proportions 0.7,0.3 --json | jq .duration_s
      Unequal shares of an area in local metres, results for a script.
  skyroost sweep --area town.geojson --fleets 2 --environment urban --max-path-loss-db 100
      Radius and altitude from the link that the users need.

Outputs: a summary, or with --json one object. Its sub_areas have polygon_m, path_m, length_m,
turns, duration_s and covered_fraction of each fleet; covered_fraction, residue_m and separation_m
are those of the whole; modes has the times of both ways of sharing. Lengths are metres east and
north of origin (null for .csv, whose own metres they are), angles radians from east. Times count
the lanes and their turns, not the ways there and back. Files appear together at the end; files of
the same names are replaced.

Exit status: 0 planned, 2 wrong usage or bad input (nothing is written), 3 infeasible: with --plan
a drone's straight way from or to the base would cross a no-fly zone (nothing is written).";

/// Plan the sweep of an area: sub-areas, lanes, times, and what is covered
///
/// Shares an area among fleets of three drones and lays the lanes on which their common coverage sweeps all of
/// it. The part that is covered is computed exactly, not sampled.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct SweepArgs {
    /// File with the area: .geojson or .kml (WGS84), .plan (QGroundControl) or .csv (x_m,y_m)
    ///
    /// One area, which may have parts and holes; no drone enters holes and exclusion fences. Of a .plan it
    /// is the survey's polygon, or else the inclusion fence.
    #[arg(long, value_name = "FILE")]
    area: PathBuf,

    /// Number of fleets, of three drones each
    #[arg(long, value_name = "F", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1365))]
    fleets: u16,

    /// Share of each fleet, of the area or of the flying time: positive, summing to 1 [default: equal]
    #[arg(long, value_name = "P,P,...", allow_negative_numbers = true, value_delimiter = ',', value_parser = positive)]
    proportions: Option<Vec<f64>>,

    /// How the fleets share the work
    #[arg(long, value_name = "MODE", default_value = "auto")]
    split: Split,

    /// Radius on the ground that one drone covers
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "500", value_parser = positive)]
    radius_m: f64,

    /// Side of a fleet's triangle
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "50", value_parser = not_negative)]
    spacing_m: f64,

    /// Cruise speed
    #[arg(long, value_name = "V", allow_negative_numbers = true, default_value = "10", value_parser = positive)]
    speed_mps: f64,

    /// How far a fleet may stray from its lane without leaving a gap; makes the swath narrower on both sides
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "0", value_parser = not_negative)]
    margin_m: f64,

    /// Where the fleets take off, in local metres [default: the area's corner furthest to the south-west]
    ///
    /// The first fleet stands there, the others eastwards of it, three spacings apart.
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, value_parser = pair)]
    base_m: Option<[f64; 2]>,

    /// The same in degrees, for an area in WGS84
    #[arg(long, value_name = "LON,LAT", allow_hyphen_values = true, value_parser = lon_lat, conflicts_with = "base_m")]
    base_lon_lat: Option<[f64; 2]>,

    /// Time that the lanes may take; the paper's 100 minutes unless it says otherwise
    #[arg(long, value_name = "S", allow_negative_numbers = true, default_value = "6000", value_parser = positive)]
    mission_time_s: f64,

    /// Take radius and altitude from the link: over what the drones fly
    ///
    /// Al-Hourani's mean path loss at 2 GHz: the altitude of largest radius, or the radius from --altitude-m.
    #[arg(long, value_name = "ENV", conflicts_with = "radius_m", requires = "max_path_loss_db")]
    environment: Option<Surroundings>,

    /// Greatest mean path loss at which a user is served
    #[arg(long, value_name = "DB", allow_negative_numbers = true, requires = "environment", value_parser = positive)]
    max_path_loss_db: Option<f64>,

    /// Carrier frequency, for the loss in free space
    #[arg(long, value_name = "F", allow_negative_numbers = true, requires = "environment", default_value = "2000", value_parser = positive)]
    frequency_mhz: f64,

    /// Altitude above the base [default: 300, or that of the largest radius]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = positive)]
    altitude_m: Option<f64>,

    /// Directory for one plan file of QGroundControl for each drone, fleet1-drone1.plan and so on
    ///
    /// Take-off, speed, every corner of the lanes, return; a fence around it all, and no-fly zones as exclusions.
    #[arg(long, value_name = "DIR")]
    plan: Option<PathBuf>,

    /// Directory for sweep.json, sweep.svg (a map) and sweep.geojson
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Print the plan as one JSON object, the same as sweep.json
    #[arg(long)]
    json: bool,

    /// No logs, only results and errors
    #[arg(long, short)]
    quiet: bool,
}

/// Altitude without a link to say better: the mission's.
const ALTITUDE_M: f64 = 300.0;
/// From pad to pad, in spacings: the mission's.
const PAD_PITCH_SPACINGS: f64 = 3.0;

/// `--split`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Split {
    /// Each fleet has a sub-area of its own, cut parallel to the sweep
    Area,
    /// All share one way over the whole area, cut by flying time
    Length,
    /// Whichever ends first
    Auto,
}

/// `--environment`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Surroundings {
    Suburban,
    Urban,
    DenseUrban,
    Highrise,
}

impl From<Surroundings> for Environment {
    fn from(surroundings: Surroundings) -> Self {
        match surroundings {
            Surroundings::Suburban => Self::Suburban,
            Surroundings::Urban => Self::Urban,
            Surroundings::DenseUrban => Self::DenseUrban,
            Surroundings::Highrise => Self::Highrise,
        }
    }
}

/// Why there is no plan.
#[derive(Debug, Error)]
pub(crate) enum SweepFailure {
    /// The area cannot be read.
    #[error(transparent)]
    Area(#[from] AreaError),
    /// It cannot be swept as asked.
    #[error("{place}: {source}")]
    Plan {
        /// The option, or the area's file.
        place: String,
        source: SweepError,
    },
    /// Something asks for a place on Earth.
    #[error("{option}: {} is in local metres, which have no place on Earth; expected an area in WGS84 (.geojson, .kml or .plan)", area.display())]
    NoPlaceOnEarth {
        /// The option.
        option: &'static str,
        area: PathBuf,
    },
    /// No drone may fly there.
    #[error("--plan: {0}")]
    Blocked(#[from] WayBlocked),
    /// The link is too weak.
    #[error(
        "--max-path-loss-db: found {max_path_loss_db} dB, expected at least {least_db:.2} dB, the loss from --altitude-m {altitude_m} straight down"
    )]
    OutOfReach { max_path_loss_db: f64, least_db: f64, altitude_m: f64 },
}

impl SweepFailure {
    pub(super) const fn exit(&self) -> Exit {
        match self {
            Self::Blocked(_) => Exit::Infeasible,
            _ => Exit::BadInput,
        }
    }
}

impl SweepArgs {
    /// The link and the disk it serves, where one is described.
    fn link(&self) -> Result<Option<(AirToGround, ServedDisk)>, SweepFailure> {
        let (Some(environment), Some(max_path_loss_db)) = (self.environment, self.max_path_loss_db) else {
            return Ok(None);
        };
        let link = AirToGround {
            environment: environment.into(),
            frequency_hz: self.frequency_mhz * 1e6,
            max_path_loss_db,
        };
        let Some(altitude_m) = self.altitude_m else { return Ok(Some((link, link.largest()))) };
        let least_db = link.path_loss_db(altitude_m, 0.0);
        let disk = link.from_altitude(altitude_m);
        disk.map(|disk| Some((link, disk))).ok_or(SweepFailure::OutOfReach {
            max_path_loss_db,
            least_db,
            altitude_m,
        })
    }

    /// Where the fleets take off, where that is said.
    fn base_m(&self, area: &Area) -> Result<Option<V2>, SweepFailure> {
        let Some([lon_deg, lat_deg]) = self.base_lon_lat else { return Ok(self.base_m.map(V2::from)) };
        let Some(frame) = area.frame else { return Err(self.no_place("--base-lon-lat")) };
        Ok(Some(frame.to_local_m(lon_deg, lat_deg)))
    }

    fn no_place(&self, option: &'static str) -> SweepFailure {
        SweepFailure::NoPlaceOnEarth { option, area: self.area.clone() }
    }

    fn failure(&self, source: SweepError) -> SweepFailure {
        let radius = if self.environment.is_some() { "--max-path-loss-db" } else { "--radius-m" };
        let place = match source {
            SweepError::Count { .. } | SweepError::ProportionSum { .. } => "--proportions".to_owned(),
            SweepError::ShareTooSmall { .. } if self.proportions.is_some() => "--proportions".to_owned(),
            SweepError::ShareTooSmall { .. } => "--fleets".to_owned(),
            SweepError::NoSwath { .. } => format!("{radius}, --spacing-m, --margin-m"),
            SweepError::TooManyLanes { .. } => radius.to_owned(),
            _ => self.area.display().to_string(),
        };
        SweepFailure::Plan { place, source }
    }

    /// Reads the area and plans its sweep.
    fn report(&self) -> Result<SweepReport, SweepFailure> {
        let area = Area::read(&self.area)?;
        let link = self.link()?;
        let fleets = usize::from(self.fleets);
        let pads = Pads::new(self.base_m(&area)?, PAD_PITCH_SPACINGS * self.spacing_m, &area.region);
        let request = SweepRequest {
            fleets,
            proportions: self.proportions.clone().unwrap_or_else(|| vec![1.0 / fleets as f64; fleets]),
            split: match self.split {
                Split::Area => SplitMode::Area,
                Split::Length => SplitMode::Length,
                Split::Auto => SplitMode::Auto,
            },
            radius_m: link.map_or(self.radius_m, |(_, disk)| disk.radius_m),
            spacing_m: self.spacing_m,
            speed_mps: self.speed_mps,
            corner: formation::corners(self.speed_mps),
            margin_m: self.margin_m,
            entry_m: Some((0..fleets).map(|fleet| pads.centre_m(fleet)).collect()),
        };
        let plan = sweep::plan(&area.region, &request).map_err(|source| self.failure(source))?;
        let modes = modes(&area, &request, &plan);
        let altitude_m = link.map(|(_, disk)| disk.altitude_m).or(self.altitude_m).unwrap_or(ALTITUDE_M);
        let (area_name, mission_time_s) = (self.area.display().to_string(), self.mission_time_s);
        Ok(SweepReport { area_name, area, request, pads, altitude_m, link, mission_time_s, plan, modes })
    }
}

/// What was asked for; of a choice, what was not taken as well.
fn modes(area: &Area, request: &SweepRequest, plan: &SweepPlan) -> Vec<ModeTried> {
    let try_it = |split: SplitMode| {
        if split == plan.split {
            return ModeTried { split, figures: Ok(plan.into()) };
        }
        let other = sweep::plan(&area.region, &SweepRequest { split, ..request.clone() });
        let figures = other.map(|other| ModeFigures::from(&other)).map_err(|why| why.to_string());
        ModeTried { split, figures }
    };
    match request.split {
        SplitMode::Auto => vec![try_it(SplitMode::Area), try_it(SplitMode::Length)],
        split => vec![try_it(split)],
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &SweepArgs) -> Result<Exit, Failure> {
    let console = Console::new(args.quiet);
    let report = args.report()?;
    let mut outputs = Vec::new();
    if let Some(dir) = &args.plan {
        let plans = report.flight_plans().map_err(SweepFailure::from)?;
        let plans = plans.ok_or_else(|| args.no_place("--plan"))?;
        outputs.push(staged("--plan", dir, &plans)?);
    }
    if let Some(dir) = &args.out {
        let geojson = report.to_geojson();
        if geojson.is_none() {
            console.log(&format!("no {GEOJSON_FILE}: {} is in local metres", report.area_name));
        }
        let names = [JSON_FILE, MAP_FILE, GEOJSON_FILE].map(str::to_owned);
        let contents = [Some(report.to_json()), Some(report.to_svg()), geojson];
        let files: Vec<_> =
            names.into_iter().zip(contents).filter_map(|(name, text)| Some((name, text?))).collect();
        outputs.push(staged("--out", dir, &files)?);
    }
    outputs.into_iter().try_for_each(OutputDir::commit)?;
    Console::print(&if args.json { report.to_json() } else { text_for_people(&report, args) })?;
    Ok(Exit::Ok)
}

/// The figures, and where the files lie.
fn text_for_people(report: &SweepReport, args: &SweepArgs) -> String {
    let mut text = report.to_string();
    if let Some(dir) = &args.out {
        text += &format!("\nMap: {}\n", dir.join(MAP_FILE).display());
    }
    if let Some(dir) = &args.plan {
        let drones = report.plan.sub_areas.len() * usize::from(formation::FLEET_DRONES);
        text += &format!("\nPlans for QGroundControl: {drones} in {}\n", dir.display());
    }
    text
}
