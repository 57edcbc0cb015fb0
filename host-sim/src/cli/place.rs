//! `skyroost place`: where drones serve the most of some located users.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use thiserror::Error;

use super::answer::Delivery;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::values::{lon_lat, not_negative, probability};
use crate::control::located::{Located, LocatedError, LocatedUsers};
use crate::control::place::{
    Fleet, Objective, PlaceError, PlaceUser, Placement, Wanted, place, place_confident, place_joint,
    place_minlp,
};
use crate::geometry::frame::LocalFrame;
use crate::report::place::PlaceReport;

const JSON_FILE: &str = "place.json";
const SITES_FILE: &str = "sites.csv";
const MAP_FILE: &str = "place.svg";
const GEOJSON_FILE: &str = "place.geojson";
/// More drones than any operator flies.
const MOST_DRONES: u32 = 1000;

const EXAMPLES: &str = "\
Examples:
  skyroost place --users located.csv --drones 6 --radius-m 500
      The most users that six drones can serve, and the proof that no more can be served.
  skyroost place --users located.csv --drones 12 --radius-m 500 --time-limit-s 10 --json
      The best placement found in ten seconds and a bound on all others, for a script.
  skyroost place --users users.geojson --drones 6 --radius-m 500 --out placed
      Sites, a map (placed/place.svg) and a GeoJSON for other maps.
  skyroost place --users found/users.csv --drones 6 --radius-m 500 --confidence 0.95
      Users count who are in range with 95 %, by the covariances that `skyroost locate` gives.

Input: CSV with the columns id,x_m,y_m and, if known, r_e_m (how far a user may be from there in
metres; otherwise 0), weight (what it is worth; otherwise 1) and cov_xx_m2,cov_xy_m2,cov_yy_m2, in
any order; located.csv and users.csv of `skyroost locate` are such files. Or GeoJSON of points with
these as properties. A drone covers a user at a distance of at most radius - r_e_m; with
--confidence, whoever is in range with that probability, positions being normal with their
covariance or, without one, with r_e_m as the 95 % radius of a round error.

Outputs: a summary, or with --json one object: drones (x_m, y_m and the ids covered, each once),
covered (users), value (their weight), upper_bound (no placement is worth more), proved_optimal,
never_coverable (users with r_e_m above the radius), expected_served (users expected to be truly in
range), margin_m (how far a drone may drift before it loses a user). Files appear together at the
end; files of the same names are replaced.

Exit status: 0 done, 2 wrong usage or bad input (the line is named, nothing is written).";

/// Place drones so that they serve the most users
///
/// Finds the placement of all drones together that covers the most users, and proves it; or places one drone after the
/// other.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct PlaceArgs {
    /// File with the users: .csv (id,x_m,y_m,r_e_m,weight) or .geojson
    #[arg(long, value_name = "FILE")]
    users: PathBuf,

    /// Drones to place
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_DRONES)))]
    drones: u32,

    /// Radius on the ground that a drone covers
    #[arg(long, value_name = "R", allow_negative_numbers = true, value_parser = not_negative)]
    radius_m: f64,

    /// How drones are placed
    #[arg(long, value_name = "METHOD", default_value = "joint")]
    method: Method,

    /// Count users who are in range with this probability, by their covariances
    #[arg(long, value_name = "P", allow_negative_numbers = true, value_parser = probability)]
    confidence: Option<f64>,

    /// Time after which the best placement so far is the answer
    #[arg(long, value_name = "S", allow_negative_numbers = true, default_value = "60", value_parser = not_negative)]
    time_limit_s: f64,

    /// Threads to use; results do not depend on them [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,

    /// Where the local origin lies, in degrees; for place.geojson of users in a CSV
    #[arg(long, value_name = "LON,LAT", allow_hyphen_values = true, value_parser = lon_lat)]
    origin_lon_lat: Option<[f64; 2]>,

    /// Directory for place.json, sites.csv, place.svg (a map) and place.geojson
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Print the answer as one JSON object, the same as place.json
    #[arg(long)]
    json: bool,

    /// No logs, only results and errors
    #[arg(long, short)]
    quiet: bool,
}

/// `--method`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Method {
    /// All drones together: the optimum, with a proof
    Joint,
    /// One drone after the other, each where it adds the most (Algorithm 2 of the paper)
    Greedy,
    /// As greedy, each step as the paper's mixed-integer program: a reference for some dozens of users
    Minlp,
}

/// Why nobody is placed.
#[derive(Debug, Error)]
pub(crate) enum PlaceFailure {
    /// The users cannot be read.
    #[error(transparent)]
    Users(#[from] LocatedError),
    /// They cannot be placed for.
    #[error(transparent)]
    Place(#[from] PlaceError),
}

impl PlaceArgs {
    fn place(&self, users: &[PlaceUser], until: Option<Instant>) -> Result<Placement, PlaceError> {
        let fleet = self.fleet();
        match self.method {
            Method::Joint => place_joint(users, fleet, until),
            Method::Minlp => place_minlp(users, fleet),
            Method::Greedy => place(Objective::Guaranteed(users), fleet),
        }
    }

    fn place_for(&self, users: &[Located]) -> Result<Placement, PlaceError> {
        // A limit beyond what a clock can tell is none.
        let limit = Duration::try_from_secs_f64(self.time_limit_s).ok();
        let until = limit.and_then(|limit| Instant::now().checked_add(limit));
        if let Some(confidence) = self.confidence {
            let wanted: Vec<Wanted> =
                users.iter().map(|user| Wanted { belief: user.belief(), weight: user.weight }).collect();
            let solve = |disks: &[PlaceUser]| self.place(disks, until);
            return place_confident(&wanted, self.radius_m, confidence, self.fleet(), solve);
        }
        let disk = |user: &Located| PlaceUser {
            pos_m: user.pos_m,
            radius_m: self.radius_m - user.error_radius_m,
            weight: user.weight,
        };
        self.place(&users.iter().map(disk).collect::<Vec<_>>(), until)
    }

    fn fleet(&self) -> Fleet {
        Fleet { drones: self.drones as usize, min_separation_m: 0.0 }
    }

    fn report(&self) -> Result<PlaceReport, PlaceFailure> {
        let read = LocatedUsers::read(&self.users)?;
        let begun = Instant::now();
        let placement = self.place_for(&read.users)?;
        let origin = self.origin_lon_lat.map(|[lon_deg, lat_deg]| LocalFrame::new(lon_deg, lat_deg));
        Ok(PlaceReport {
            source: self.users.display().to_string(),
            method: match self.method {
                Method::Joint => "joint",
                Method::Greedy => "greedy",
                Method::Minlp => "minlp",
            },
            radius_m: self.radius_m,
            frame: read.frame.or(origin),
            left_out: read.left_out,
            users: read.users,
            placement,
            confidence: self.confidence,
            wall_s: begun.elapsed().as_secs_f64(),
        })
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &PlaceArgs) -> Result<Exit, Failure> {
    let console = Console::new(args.quiet);
    if let Some(threads) = args.threads {
        // Only the first pool of a process can be set; there is no other.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    let report = args.report().map_err(Failure::Place)?;
    if report.left_out > 0 {
        console.log(&format!("{} rows or features are no users with a position, left out", report.left_out));
    }
    let json = report.to_json();
    let to = Delivery { out: args.out.as_deref(), json: args.json, picture: ("Map", MAP_FILE) };
    to.deliver(&console, &report, &json, || {
        vec![
            (JSON_FILE, Some(json.clone())),
            (SITES_FILE, Some(report.to_sites_csv())),
            (MAP_FILE, Some(report.to_svg())),
            (GEOJSON_FILE, report.to_geojson()),
        ]
    })?;
    Ok(Exit::Ok)
}
