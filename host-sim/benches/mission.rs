//! How fast the default mission flies on one thread, and where the time goes.
//!
//! Not criterion's kind of bench: one run takes seconds and says more than a sample of microseconds. The best
//! of a few runs counts, as everything else that a machine does only ever makes a run slower.

use skyroost_host_sim::{
    fleet::Backend,
    runner::{MissionInput, Outcome, RunOptions, fly},
    scenario::LoadedScenario,
};
use std::sync::atomic::AtomicBool;

const RUNS: u32 = 5;

fn main() {
    let input = MissionInput::of_rectangle(LoadedScenario::paper().scenario).expect("a square has an area");
    let cancel = AtomicBool::new(false);
    let options = RunOptions::new(1, Backend::InProc, &cancel, &|_| {});
    let mut best: Option<Outcome> = None;
    for run in 1..=RUNS {
        let outcome = fly(&input, &options).expect("the default mission flies");
        let timing = &outcome.summary.timing;
        println!("run {run}: {:.2} s, {:.0} x real time", timing.wall_s, timing.realtime_factor);
        if best.as_ref().is_none_or(|best| timing.wall_s < best.summary.timing.wall_s) {
            best = Some(outcome);
        }
    }
    let Outcome { summary, shares, .. } = best.expect("there were runs");
    let (factor, wall_s) = (summary.timing.realtime_factor, summary.timing.wall_s);
    println!(
        "\ndefault mission, 6 drones, one thread: {factor:.0} x real time ({wall_s:.2} s), best of {RUNS}"
    );
    println!("of the stepping loop:");
    for (part, share) in shares {
        println!("  {part:<15}{:5.1} %", 100.0 * share);
    }
}
