//! `skyroost mission`: flies the whole two-stage mission and leaves its results in a directory.

use super::console::Console;
use super::exit::{Exit, Failure, UsageError};
use super::keys::KeysFailure;
use super::output::OutputDir;
use super::{inputs, interrupt};
use crate::control::keys::file::KeyFile;
use crate::fleet::{Backend, qemu::QemuOptions};
use crate::recording::Recording;
use crate::report::summary::Summary;
use crate::report::{html, tables};
use crate::runner::{self, JournalOptions, MissionKeys, Outcome, RunError, RunOptions};
use crate::scenario::Overrides;
use clap::Args;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

const REPORT_FILE: &str = "report.html";
const SUMMARY_FILE: &str = "summary.json";
const USERS_FILE: &str = "users.csv";
const TRAJECTORY_FILE: &str = "trajectory.csv";
const RECORDING_FILE: &str = "recording.json";

const EXAMPLES: &str = "\
Examples:
  skyroost mission
      The paper's scenario: 6 drones, 10 km x 10 km, 5 users/km2.
  skyroost mission --density-per-km2 20 --seed 7 --out night-run
      The same with more users and other random choices.
  skyroost mission --area town.geojson --users people.csv --drones 9
      A real area and known users.
  skyroost mission dresden-elbe.toml --json | jq .localization
      A scenario file, results for a script.
  skyroost mission --backend qemu --board-log logs
      The flight code on six emulated flight controllers: the same results, to the bit.

Result files: report.html (map and replay), summary.json (the figures), users.csv, trajectory.csv
and recording.json. They appear together at the end; files of these names are replaced.

Exit status: 0 done, 1 an acceptance limit failed, 2 wrong usage or bad input (nothing is written),
3 infeasible, 4 link or board failure, 130 interrupted (nothing is written).";

/// Fly a whole mission: sweep, locate, place
///
/// Fleets of three drones sweep the area and locate its users by UTDOA; then all drones are placed
/// where they serve the most users. Every drone runs the flight code of the real boards. The same
/// build, scenario and seed give the same results whatever the number of threads.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct MissionArgs {
    /// Scenario file; without it the built-in scenario of the paper is flown
    ///
    /// TOML; every key has a default, so a file states only what differs. scenarios/paper.toml in the
    /// sources lists all of them.
    #[arg(value_name = "SCENARIO.toml")]
    scenario: Option<PathBuf>,

    /// Seed of every random choice [default: the scenario's, which is 1 unless it says otherwise]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u64>,

    /// Mean number of users per square kilometre, strewn at random over the area
    #[arg(long, value_name = "D", allow_negative_numbers = true, conflicts_with = "users")]
    density_per_km2: Option<f64>,

    /// File with the area: .geojson or .kml (WGS84), .plan (QGroundControl) or .csv (x_m,y_m)
    ///
    /// One area, which may have parts and holes; no drone enters holes and exclusion fences. Of a .plan it
    /// is the survey's polygon, or else the inclusion fence.
    #[arg(long, value_name = "FILE")]
    area: Option<PathBuf>,

    /// File with the users' true positions: .csv (x_m,y_m, optionally id)
    #[arg(long, value_name = "FILE")]
    users: Option<PathBuf>,

    /// Number of drones: fleets of three, the rest join in the second stage
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    drones: Option<u32>,

    /// Fraction of the frames between drones and control center that are lost
    #[arg(long, value_name = "P", allow_negative_numbers = true)]
    loss_fraction: Option<f64>,

    /// Cut the mission off at this simulated time
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    duration_s: Option<f64>,

    /// Where the flight code runs: inproc, qemu or serial:PORT,...
    ///
    /// inproc: in this program. qemu: as the board's image on STM32F405s that QEMU emulates, one for each
    /// drone, in lockstep with the simulated world. serial: on real boards, in real time, one port for each
    /// drone. The results are the same, to the bit.
    #[arg(long, value_name = "BACKEND", default_value = "inproc", value_parser = backend)]
    backend: BackendKind,

    /// Image for the emulated boards [default: the workspace's own, built where it is missing or old]
    #[arg(long, value_name = "FILE")]
    board_image: Option<PathBuf>,

    /// Directory for the boards' logs, one readable file for each drone
    #[arg(long, value_name = "DIR")]
    board_log: Option<PathBuf>,

    /// Seal the links with the keys of this file (`skyroost keys new`) instead of keys of the seed
    #[arg(long, value_name = "FILE", conflicts_with = "unauthenticated")]
    keys: Option<PathBuf>,

    /// Do without keys: whoever can send can command the drones
    ///
    /// Otherwise every frame is sealed. The summary says so where it is not.
    #[arg(long)]
    unauthenticated: bool,

    /// Keep the control center's journal in this file: all that it was told, before it says anything
    ///
    /// A mission that is killed goes on with --resume as if its control center alone had been killed.
    #[arg(long, value_name = "FILE")]
    journal: Option<PathBuf>,

    /// Go on where the journal of the same mission ends, five simulated seconds later
    ///
    /// The world is flown there again; what the control center knows comes from the journal alone.
    #[arg(long, requires = "journal")]
    resume: bool,

    /// Directory for the result files
    #[arg(long, value_name = "DIR", default_value = "skyroost-out")]
    out: PathBuf,

    /// Threads to use; results do not depend on them [default: one for each core]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,

    /// Print the results as one JSON object, the same as summary.json
    #[arg(long)]
    json: bool,

    /// No progress and no logs, only results and errors
    #[arg(long, short)]
    quiet: bool,
}

/// Where the flight code runs.
#[derive(Clone, Debug, PartialEq, Eq)]
enum BackendKind {
    /// In this process.
    InProc,
    /// On emulated boards.
    Qemu,
    /// On boards at these ports.
    Serial(Vec<PathBuf>),
}

fn backend(text: &str) -> Result<BackendKind, &'static str> {
    match text {
        "inproc" => Ok(BackendKind::InProc),
        "qemu" => Ok(BackendKind::Qemu),
        _ => match text.strip_prefix("serial:") {
            Some(ports) if ports.split(',').all(|port| !port.is_empty()) => {
                Ok(BackendKind::Serial(ports.split(',').map(PathBuf::from).collect()))
            }
            _ => Err("expected inproc, qemu or serial:PORT,..."),
        },
    }
}

impl MissionArgs {
    fn overrides(&self) -> Overrides {
        Overrides {
            seed: self.seed,
            density_per_km2: self.density_per_km2,
            area: self.area.clone(),
            users: self.users.clone(),
            drones: self.drones,
            loss_fraction: self.loss_fraction,
            duration_s: self.duration_s,
        }
    }

    /// Where the flight code runs, once what is said about boards fits together.
    fn backend(&self) -> Result<Backend, UsageError> {
        let named = match &self.backend {
            BackendKind::InProc => "inproc",
            BackendKind::Serial(_) => "serial",
            BackendKind::Qemu => {
                return Ok(Backend::Qemu(QemuOptions {
                    image: self.board_image.clone(),
                    log_dir: self.board_log.clone(),
                }));
            }
        };
        for (option, given) in [("--board-image", &self.board_image), ("--board-log", &self.board_log)] {
            if given.is_some() {
                return Err(UsageError { option, backend: named, expected: "qemu" });
            }
        }
        Ok(match &self.backend {
            BackendKind::Serial(ports) => Backend::Serial(ports.clone()),
            _ => Backend::InProc,
        })
    }

    /// What seals the links of the mission; of a file of keys a boot is spent.
    fn keys(&self, drones: u32) -> Result<MissionKeys, KeysFailure> {
        Ok(match &self.keys {
            _ if self.unauthenticated => MissionKeys::Unauthenticated,
            Some(file) => MissionKeys::Given(Box::new(KeyFile::read(file)?.open_links(drones as usize)?)),
            None => MissionKeys::Simulated,
        })
    }

    fn threads(&self) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        self.threads.map_or_else(cores, usize::from)
    }
}

/// For so long a mission that goes on from a journal has had no control center, simulated seconds.
const RESUME_AFTER_S: f64 = 5.0;

/// Runs the subcommand.
pub(super) fn run(args: &MissionArgs) -> Result<Exit, Failure> {
    let backend = args.backend()?;
    let console = Console::new(args.quiet);
    let mut input = inputs::load(args.scenario.as_deref(), &args.overrides())?;
    input.keys = args.keys(input.scenario.fleet.drones)?;
    let cancel = interrupt::flag(&console);
    let output = OutputDir::prepare("--out", &args.out)?;
    // Boards write their logs when they end, well or not; one that stays empty goes as it came.
    let _logs = args.board_log.as_ref().map(|dir| OutputDir::prepare("--board-log", dir)).transpose()?;

    let progress = console.progress();
    let show = |now| progress.show(now);
    let journal =
        JournalOptions { path: args.journal.clone(), resume_after_s: args.resume.then_some(RESUME_AFTER_S) };
    let options = RunOptions { journal, ..RunOptions::new(args.threads(), backend, cancel, &show) };
    let outcome = runner::fly(&input, &options)?;
    drop(progress);

    let summary = &outcome.summary;
    let json = summary.to_json();
    write_results(output, &outcome, &json, cancel)?;
    Console::print(&if args.json { json } else { text_for_people(summary, &args.out) })?;
    Ok(if summary.accepted() { Exit::Ok } else { Exit::LimitFailed })
}

/// Writes all result files, or none when one fails or the user interrupts.
fn write_results(
    mut output: OutputDir,
    outcome: &Outcome,
    json: &str,
    cancel: &AtomicBool,
) -> Result<(), Failure> {
    let Outcome { summary, recording, .. } = outcome;
    let files: [(&str, &WriteFile<'_>); 5] = [
        (SUMMARY_FILE, &|file| file.write_all(json.as_bytes())),
        (USERS_FILE, &|file| Ok(tables::write_users(recording, file)?)),
        (TRAJECTORY_FILE, &|file| Ok(tables::write_trajectory(recording, file)?)),
        (RECORDING_FILE, &|file| Ok(serde_json::to_writer(file, recording)?)),
        (REPORT_FILE, &|file| file.write_all(report_html(summary, recording)?.as_bytes())),
    ];
    for (name, write) in files {
        if cancel.load(Ordering::Relaxed) {
            return Err(RunError::Interrupted.into());
        }
        output.stage(name, write)?;
    }
    Ok(output.commit()?)
}

/// Writes the content of one file.
type WriteFile<'a> = dyn Fn(&mut BufWriter<File>) -> io::Result<()> + 'a;

/// The report as one HTML file.
fn report_html(summary: &Summary, recording: &Recording) -> serde_json::Result<String> {
    Ok(html::render(recording, &serde_json::to_value(summary)?))
}

/// The figures, the verdict, and where the files lie.
fn text_for_people(summary: &Summary, out: &Path) -> String {
    let report = out.join(REPORT_FILE);
    format!("{summary}\nReport: {}\n", report.display())
}
