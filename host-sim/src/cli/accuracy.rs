//! `skyroost accuracy`: tells how well a formation locates, before it flies.

use std::path::PathBuf;

use clap::Args;
use thiserror::Error;

use super::answer::Delivery;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::values::positive;
use crate::control::accuracy::{Accuracy, AccuracyError, Formation};
use crate::report::accuracy::AccuracyReport;
use crate::runner::formation::{fixed_orientation_rad, slot_m};

const PAGE_FILE: &str = "accuracy.md";
const PLOT_FILE: &str = "accuracy.svg";
const JSON_FILE: &str = "accuracy.json";

const EXAMPLES: &str = "\
Examples:
  skyroost accuracy
      The formation that missions fly unless told otherwise.
  skyroost accuracy --spacing-m 100 --altitude-m 200 --sigma-ns 10 --out accuracy
      Another one, with a page of tables and a plot: accuracy/accuracy.md, accuracy/accuracy.svg.
  skyroost accuracy --json | jq .trade_off
      Results for a script.

Outputs: tables of r95, the radius in metres of the circle around an estimate that holds 95 % of the
errors; or with --json one object, where r95_m has a number for each of offset_m, the distances from
the lane, and null where captures do not determine a position. All are Cramer-Rao bounds: no method
does better on average, and the one of missions comes close. Files appear together at the end; files
of the same names are replaced.

Exit status: 0 done, 2 wrong usage or bad input (nothing is written).";

/// Tell how well a formation locates: 95 % radii by noise, clocks, side and altitude
///
/// Three drones fly a straight lane; the Cramer-Rao bound says how well the users beside it can be located.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct AccuracyArgs {
    /// Side of the fleet's triangle
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "50", value_parser = positive)]
    spacing_m: f64,

    /// Altitude above the users
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "300", value_parser = positive)]
    altitude_m: f64,

    /// Standard deviation of the arrival time of an SRS at a drone
    #[arg(long, value_name = "NS", allow_negative_numbers = true, default_value = "5", value_parser = positive)]
    sigma_ns: f64,

    /// Speed along the lane
    #[arg(long, value_name = "V", allow_negative_numbers = true, default_value = "10", value_parser = positive)]
    speed_mps: f64,

    /// Radius on the ground that one drone covers
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value = "500", value_parser = positive)]
    radius_m: f64,

    /// From one SRS of a user to its next
    #[arg(long, value_name = "S", allow_negative_numbers = true, default_value = "1", value_parser = positive)]
    srs_period_s: f64,

    /// Directory for accuracy.md (the tables), accuracy.svg (a plot) and accuracy.json
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Print all figures as one JSON object, the same as accuracy.json
    #[arg(long)]
    json: bool,

    /// No logs, only results and errors
    #[arg(long, short)]
    quiet: bool,
}

/// Why no accuracy can be told: options, as the command line spells them.
#[derive(Debug, Error)]
#[error("{0}")]
pub(crate) struct AccuracyFailure(String);

impl From<AccuracyError> for AccuracyFailure {
    fn from(error: AccuracyError) -> Self {
        let text = error.to_string();
        Self(match text.split_once(": ") {
            Some((fields, told)) if !matches!(error, AccuracyError::Localize(_)) => {
                let options: Vec<String> =
                    fields.split(", ").map(|field| format!("--{}", field.replace('_', "-"))).collect();
                format!("{}: {told}", options.join(", "))
            }
            _ => text,
        })
    }
}

impl AccuracyArgs {
    fn report(&self) -> Result<AccuracyReport, AccuracyFailure> {
        let orientation_rad = fixed_orientation_rad(0.0);
        let formation = Formation {
            corners: [0, 1, 2].map(|slot| slot_m(orientation_rad, slot, 1.0)),
            spacing_m: self.spacing_m,
            altitude_m: self.altitude_m,
            speed_mps: self.speed_mps,
            radius_m: self.radius_m,
            srs_period_s: self.srs_period_s,
            sigma_toa_ns: self.sigma_ns,
        };
        Ok(AccuracyReport { accuracy: Accuracy::of(formation)? })
    }
}

/// Runs the subcommand.
pub(super) fn run(args: &AccuracyArgs) -> Result<Exit, Failure> {
    let report = args.report()?;
    let json = report.to_json();
    let to = Delivery { out: args.out.as_deref(), json: args.json, picture: ("Plot", PLOT_FILE) };
    to.deliver(&Console::new(args.quiet), &report, &json, || {
        vec![
            (PAGE_FILE, Some(report.to_markdown())),
            (PLOT_FILE, Some(report.to_svg())),
            (JSON_FILE, Some(json.clone())),
        ]
    })?;
    Ok(Exit::Ok)
}
