//! `skyroost campaign`: the same methods on many random users, in blocks that any machine may run.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;

use super::console::Console;
use super::exit::{Exit, Failure};
use super::interrupt;
use super::output::staged;
use crate::campaign::figures::figures;
use crate::campaign::plan::{Fidelity, PlanOverrides};
use crate::campaign::{Campaign, Left, Manifest, RESULTS_CSV, RESULTS_PARQUET, TIMES_CSV};
use crate::report::campaign::CampaignReport;

const EXAMPLES: &str = "\
Examples:
  skyroost campaign plan figure6.toml --out figure6
  skyroost campaign run --dir figure6
      Runs all blocks that are missing, on all cores; after an interrupt or a crash, goes on.
  skyroost campaign merge --dir figure6
      figure6/results.csv and figure6/results.parquet, and figure6/times.csv.
  skyroost campaign plot --dir figure6
      The figures as SVG, and their numbers as figures.md and figures.json.
  skyroost campaign missing --dir figure6 | xargs -P 4 -n 1 skyroost campaign run --dir figure6 --block
      Any engine may run the blocks: in any order, twice, on any machine that sees the directory.

The plan is a table [campaign] with the keys fidelity (paper or flight), base_seed, seeds,
densities_per_km2, r_e_m, drones, methods (proposed, random, full), random_search (simultaneous or
greedy) and block_runs; the tables of a scenario may stand beside it.

Exit status: 0 done, 2 wrong usage or bad input (nothing is written), 5 blocks are missing,
130 interrupted (blocks that are done stay).";

/// Compare methods on many random users: plan, run in blocks, merge, plot
///
/// Each run draws users and lets every method of the plan serve them. The merged results depend on the plan and the
/// program alone, not on which machine ran which block when.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct CampaignArgs {
    #[command(subcommand)]
    step: Step,
}

#[derive(Debug, Subcommand)]
enum Step {
    Plan(PlanArgs),
    Run(RunArgs),
    /// Print the blocks still to be done, one number a line; 5 is the exit status while there are any
    Missing(DirArgs),
    /// Put all blocks together: results.csv, results.parquet and times.csv
    Merge(DirArgs),
    Plot(PlotArgs),
}

/// Read a plan and write the manifest of its campaign
#[derive(Debug, Args)]
struct PlanArgs {
    /// The plan
    #[arg(value_name = "FILE.toml")]
    plan: PathBuf,

    /// Directory for the campaign; it holds one campaign only
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// How runs come about, in place of what the plan says
    #[arg(long, value_name = "HOW")]
    fidelity: Option<Choice>,

    /// Seed of every random choice, in place of the plan's base_seed
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u64>,

    #[command(flatten)]
    voice: Voice,
}

/// Run what is missing of a campaign, or one block of it
#[derive(Debug, Args)]
struct RunArgs {
    /// Directory of the campaign
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,

    /// Only this block, if it is missing
    #[arg(long, value_name = "I", allow_negative_numbers = true)]
    block: Option<u64>,

    /// Threads to use; results do not depend on them [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,

    #[command(flatten)]
    voice: Voice,
}

/// Which campaign.
#[derive(Debug, Args)]
struct DirArgs {
    /// Directory of the campaign
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,

    #[command(flatten)]
    voice: Voice,
}

/// Draw the figures of a campaign whose blocks are all done
#[derive(Debug, Args)]
struct PlotArgs {
    /// Directory of the campaign
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,

    /// Directory for the figures [default: that of the campaign]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    voice: Voice,
}

/// How the answer is given.
#[derive(Debug, Args)]
struct Voice {
    /// Print the answer as one JSON object
    #[arg(long)]
    json: bool,

    /// No progress and no logs, only results and errors
    #[arg(long, short)]
    quiet: bool,
}

/// `--fidelity`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// The paper's closed model: users located with error r_e, nothing flown but random search
    Paper,
    /// Every run flown by the flight code
    Flight,
}

/// Runs the subcommand.
pub(super) fn run(args: &CampaignArgs) -> Result<Exit, Failure> {
    match &args.step {
        Step::Plan(args) => plan(args),
        Step::Run(args) => run_blocks(args),
        Step::Missing(args) => missing(args),
        Step::Merge(args) => merge(args),
        Step::Plot(args) => plot(args),
    }
}

#[derive(Serialize)]
struct Planned<'a> {
    dir: String,
    name: &'a str,
    fidelity: Fidelity,
    base_seed: u64,
    runs: u64,
    rows: u64,
    blocks: usize,
    scenario_hash: &'a str,
    program_hash: &'a str,
}

fn plan(args: &PlanArgs) -> Result<Exit, Failure> {
    let fidelity = args.fidelity.map(|choice| match choice {
        Choice::Paper => Fidelity::Paper,
        Choice::Flight => Fidelity::Flight,
    });
    let campaign = Campaign::plan(&args.plan, &args.out, PlanOverrides { fidelity, base_seed: args.seed })?;
    let Manifest { name, fidelity, base_seed, runs, blocks, scenario_hash, program_hash, methods, .. } =
        campaign.manifest();
    let answer = Planned {
        dir: args.out.display().to_string(),
        name,
        fidelity: *fidelity,
        base_seed: *base_seed,
        runs: *runs,
        rows: runs * methods.len() as u64,
        blocks: blocks.len(),
        scenario_hash,
        program_hash,
    };
    let text = format!(
        "{name}: {runs} runs of {} methods in {} blocks, planned in {}\n",
        methods.len(),
        blocks.len(),
        answer.dir
    );
    print(&args.voice, &answer, &text)?;
    Ok(Exit::Ok)
}

#[derive(Serialize)]
struct Ran<'a> {
    blocks: u64,
    ran: &'a [u64],
    corrupted: Vec<u64>,
    wall_s: f64,
}

fn run_blocks(args: &RunArgs) -> Result<Exit, Failure> {
    let console = Console::new(args.voice.quiet);
    if let Some(threads) = args.threads {
        // Only the first pool of a process can be set; there is no other.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    let campaign = Campaign::open(&args.dir)?;
    let cancel = interrupt::flag(&console);
    let begun = Instant::now();
    let progress = console.campaign();
    let ran = campaign.run(args.block, cancel, &|now| progress.show(now))?;
    drop(progress);
    for (block, what) in &ran.corrupted {
        console.log(&format!("block {block} was damaged and has been run again: {what}"));
    }
    let wall_s = begun.elapsed().as_secs_f64();
    let text = format!("{} blocks run in {wall_s:.1} s\n", ran.missing.len());
    let answer = Ran { blocks: ran.blocks, ran: &ran.missing, corrupted: numbers(&ran), wall_s };
    print(&args.voice, &answer, &text)?;
    Ok(Exit::Ok)
}

fn numbers(left: &Left) -> Vec<u64> {
    left.corrupted.iter().map(|(block, _)| *block).collect()
}

#[derive(Serialize)]
struct StillMissing<'a> {
    blocks: u64,
    missing: &'a [u64],
    corrupted: Vec<u64>,
}

fn missing(args: &DirArgs) -> Result<Exit, Failure> {
    let console = Console::new(args.voice.quiet);
    let left = Campaign::open(&args.dir)?.left()?;
    for (block, what) in &left.corrupted {
        console.log(&format!("block {block} is damaged: {what}"));
    }
    let answer = StillMissing { blocks: left.blocks, missing: &left.missing, corrupted: numbers(&left) };
    let text: String = left.missing.iter().map(|block| format!("{block}\n")).collect();
    print(&args.voice, &answer, &text)?;
    Ok(if left.missing.is_empty() { Exit::Ok } else { Exit::Partial })
}

#[derive(Serialize)]
struct MergedAnswer {
    runs: u64,
    rows: u64,
    results_csv: String,
    results_csv_hash: String,
    results_parquet: String,
    results_parquet_hash: String,
    times_csv: String,
}

fn merge(args: &DirArgs) -> Result<Exit, Failure> {
    let merged = Campaign::open(&args.dir)?.merge()?;
    let path = |name: &str| args.dir.join(name).display().to_string();
    let answer = MergedAnswer {
        runs: merged.runs,
        rows: merged.rows,
        results_csv: path(RESULTS_CSV),
        results_csv_hash: merged.csv_hash,
        results_parquet: path(RESULTS_PARQUET),
        results_parquet_hash: merged.parquet_hash,
        times_csv: path(TIMES_CSV),
    };
    let MergedAnswer { runs, rows, results_csv, results_csv_hash, results_parquet, .. } = &answer;
    let text =
        format!("{rows} rows of {runs} runs: {results_csv} (xxh3 {results_csv_hash}), {results_parquet}\n");
    print(&args.voice, &answer, &text)?;
    Ok(Exit::Ok)
}

fn plot(args: &PlotArgs) -> Result<Exit, Failure> {
    let campaign = Campaign::open(&args.dir)?;
    let rows = campaign.rows()?;
    let report =
        CampaignReport { plan: campaign.plan_of().clone(), figures: figures(campaign.plan_of(), &rows) };
    let (option, out) = args.out.as_deref().map_or(("--dir", args.dir.as_path()), |out| ("--out", out));
    let files = report.files();
    staged(option, out, &files)?.commit()?;
    let mut text = report.to_text() + "\n";
    for (name, _) in &files {
        text += &format!("{}\n", out.join(name).display());
    }
    Console::print(if args.voice.json { report.to_json() } else { text }.as_str())?;
    Ok(Exit::Ok)
}

/// The answer as one object, or as text.
fn print(voice: &Voice, answer: &impl Serialize, text: &str) -> Result<(), Failure> {
    if !voice.json {
        return Console::print(text);
    }
    // Plain data with names for keys: there is nothing in it that JSON could not say.
    Console::print(&serde_json::to_string(answer).map_or_else(|_| String::new(), |json| json + "\n"))
}
