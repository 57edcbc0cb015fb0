//! What campaigns cost: runs an hour in both fidelities, and how that grows with users and with drones.
//!
//! Not criterion's kind of bench: one run takes up to seconds and says more than a sample of microseconds. On one thread
//! unless it says otherwise; a campaign uses all cores, and loses nothing by it, as runs share nothing.

use std::hint::black_box;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use skyroost_host_sim::campaign::plan::{Method, Plan, PlanOverrides};
use skyroost_host_sim::campaign::{Closed, Flown, Timed};

/// Runs to average over in the closed model.
const RUNS: u64 = 5;
/// Mission time of the paper, seconds: what random search searches for.
const MISSION_S: f64 = 6000.0;

fn main() {
    let quick = std::env::args().any(|arg| arg == "--quick");
    closed_by_users();
    closed_by_drones(quick);
    flown(quick);
}

fn plan(campaign: &str, rest: &str) -> Plan {
    let toml = format!("[campaign]\nseeds = {RUNS}\n{campaign}\n{rest}");
    Plan::from_toml(&toml, "bench", PlanOverrides::default()).expect("the plan is good")
}

/// Mean seconds of each method over the runs of a plan with one combination.
fn seconds(plan: &Plan) -> Vec<(Method, f64)> {
    let closed = Closed::new(plan).expect("the formation locates");
    let rows: Vec<Timed> = (0..plan.runs())
        .filter_map(|number| plan.run(number))
        .flat_map(|run| black_box(closed.rows(&run)).expect("a run has rows"))
        .collect();
    let of = |&method: &Method| {
        let own = rows.iter().filter(|timed| timed.row.method == method);
        (method, own.map(|timed| timed.wall_s).sum::<f64>() / plan.runs() as f64)
    };
    plan.campaign.methods.iter().map(of).collect()
}

fn closed_by_users() {
    println!("closed model, 6 drones, milliseconds a run on one thread");
    println!("{:>10} {:>10} {:>10} {:>10} {:>16}", "users", "proposed", "random", "full", "runs an hour");
    for density in ["1", "10", "100", "1000"] {
        let took = seconds(&plan(&format!("densities_per_km2 = [{density}]"), ""));
        let all: f64 = took.iter().map(|(_, s)| s).sum();
        let users = 100.0 * density.parse::<f64>().unwrap_or_default();
        let ms: Vec<String> = took.iter().map(|(_, s)| format!("{:10.1}", 1e3 * s)).collect();
        println!("{users:>10} {} {:>16.0}", ms.join(" "), 3600.0 / all);
    }
}

/// The area grows with the drones, and 5 users/km² with it.
fn closed_by_drones(quick: bool) {
    println!("\nclosed model, 5 users/km², random search, the area grown with the drones");
    println!("{:>10} {:>12} {:>24}", "drones", "ms a run", "ns a drone-second");
    for drones in if quick { &[6, 60][..] } else { &[6, 60, 600] } {
        let side_m = 10_000.0 * (f64::from(*drones) / 6.0).sqrt();
        let campaign = format!("densities_per_km2 = [5]\ndrones = [{drones}]\nmethods = [\"random\"]");
        let took = seconds(&plan(&campaign, &format!("[area]\nwidth_m = {side_m}\nheight_m = {side_m}")));
        let s = took[0].1;
        println!("{drones:>10} {:>12.1} {:>24.0}", 1e3 * s, 1e9 * s / (f64::from(*drones) * MISSION_S));
    }
}

fn flown(quick: bool) {
    println!("\nflown, 5 users/km², one mission on one thread");
    println!("{:>10} {:>12} {:>24} {:>16}", "drones", "s a mission", "ns a drone-second", "missions an hour");
    for drones in if quick { &[6][..] } else { &[6, 12, 24] } {
        let side_m = 10_000.0 * (f64::from(*drones) / 6.0).sqrt();
        let campaign = format!(
            "fidelity = \"flight\"\ndensities_per_km2 = [5]\ndrones = [{drones}]\nmethods = [\"full\"]"
        );
        let plan = plan(&campaign, &format!("[area]\nwidth_m = {side_m}\nheight_m = {side_m}"));
        let (flown, run) = (Flown::new(&plan), plan.run(0).expect("a run"));
        let begun = Instant::now();
        black_box(flown.rows(&run, &AtomicBool::new(false))).expect("the mission flies");
        let s = begun.elapsed().as_secs_f64();
        // Climb, transit and refinement aside, a mission lasts as long as its sweep.
        println!(
            "{drones:>10} {s:>12.2} {:>24.0} {:>16.0}",
            1e9 * s / (f64::from(*drones) * MISSION_S),
            3600.0 / s
        );
    }
}
