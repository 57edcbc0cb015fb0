//! What campaigns cost: runs an hour in both fidelities, and how that grows with users and with drones.
//!
//! Not criterion's kind of bench: one run takes up to seconds and says more than a sample of microseconds. On one thread
//! unless it says otherwise; a campaign uses all cores, and loses nothing by it, as runs share nothing.

use std::hint::black_box;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use skyroost_host_sim::campaign::plan::{Method, Plan, PlanOverrides};
use skyroost_host_sim::campaign::{Closed, Flown, Timed};
use skyroost_host_sim::fleet::Backend;
use skyroost_host_sim::runner::{MissionInput, RunOptions, fly};
use skyroost_host_sim::scenario::LoadedScenario;

/// Runs to average over in the closed model.
const RUNS: u64 = 5;
/// Mission time of the paper, seconds: what random search searches for.
const MISSION_S: f64 = 6000.0;

fn main() {
    let quick = std::env::args().any(|arg| arg == "--quick");
    closed_by_users();
    closed_by_drones(quick);
    flown();
    swept(quick);
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

/// Whole missions as a campaign flies them, on one thread each.
fn flown() {
    println!("\nflown, 5 users/km², six drones");
    let plan = plan("fidelity = \"flight\"\ndensities_per_km2 = [5]", "");
    let (flown, cores) = (Flown::new(&plan), std::thread::available_parallelism().map_or(1, usize::from));
    let began = Instant::now();
    let missions: Vec<f64> = (0..plan.runs())
        .filter_map(|number| plan.run(number))
        .map(|run| {
            let began = Instant::now();
            black_box(flown.rows(&run, &AtomicBool::new(false))).expect("the mission flies");
            began.elapsed().as_secs_f64()
        })
        .collect();
    let mean_s = began.elapsed().as_secs_f64() / missions.len() as f64;
    let worst_s = missions.iter().copied().fold(0.0, f64::max);
    println!(
        "{mean_s:.2} s a mission with all methods, {worst_s:.2} s at most; {:.0} missions an hour on {cores} cores",
        cores as f64 * 3600.0 / mean_s
    );
}

/// The sweep alone, on all cores: fleets start where their lanes are, the area grows with them.
fn swept(quick: bool) {
    const SIMULATED_S: f64 = 1_000.0;
    println!("\nswept for {SIMULATED_S} s, the area grown with the drones, all cores");
    println!("{:>10} {:>12} {:>24} {:>16}", "drones", "s", "us a drone-second", "x real time");
    for fleets in if quick { &[2, 20][..] } else { &[2, 20, 200] } {
        let (drones, side_m) = (3 * fleets, 10_000.0 * (f64::from(*fleets) / 2.0).sqrt());
        let rows = f64::from(*fleets).sqrt().ceil();
        let pitch_m = side_m / rows;
        let corner_m = |fleet: i32| {
            let (row, column) = ((f64::from(fleet) / rows).floor(), f64::from(fleet) % rows);
            [(column + 0.5) * pitch_m, (row + 0.5) * pitch_m]
        };
        let pad = |[x, y]: [f64; 2], [east, north]: [f64; 2]| format!("[{:.0}, {:.0}]", x + east, y + north);
        let triangle = [[0.0, 0.0], [50.0, 0.0], [25.0, 43.0]];
        let pads: Vec<String> =
            (0..*fleets).flat_map(|fleet| triangle.map(|at| pad(corner_m(fleet), at))).collect();
        let toml = format!(
            "[area]\nwidth_m = {side_m}\nheight_m = {side_m}\n[fleet]\ndrones = {drones}\npads_m = [{}]\n\
             [battery]\nendurance_s = 100000\n[mission]\nduration_s = {SIMULATED_S}\n",
            pads.join(", ")
        );
        let loaded = LoadedScenario::from_toml(&toml, "bench", Path::new(".")).expect("the scenario is good");
        let input = MissionInput::of_rectangle(loaded.scenario).expect("a rectangle");
        let cancel = AtomicBool::new(false);
        let options = RunOptions::new(0, Backend::InProc, &cancel, &|_| {});
        let timing = black_box(fly(&input, &options)).expect("the mission flies").summary.timing;
        let drone_s = f64::from(drones) * timing.simulated_s;
        println!(
            "{drones:>10} {:>12.2} {:>24.1} {:>16.0}",
            timing.wall_s,
            1e6 * timing.wall_s / drone_s,
            timing.realtime_factor
        );
    }
}
