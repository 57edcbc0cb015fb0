//! Localization of whole missions, one thread: captures to fixes, the bound, and a peer on the same data.
#![allow(missing_docs)]

use std::fmt::Write as _;
use std::process::Command;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group};
use rayon::ThreadPool;
use skyroost_host_sim::control::localize::{
    C_M_PER_NS, Capture, ClockModel, Localization, LocalizeConfig, Motion, Occasion, Robust, Running, crlb,
    localize,
};

#[path = "../src/control/localize/sim.rs"]
mod sim;

fn one_thread() -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread")
}

fn missions(c: &mut Criterion) {
    let pool = one_thread();
    let cfg = LocalizeConfig::default();
    for (users_per_km2, samples) in [(1.0, 50), (5.0, 20), (10.0, 10), (50.0, 10)] {
        let flown = sim::World { users_per_km2, ..sim::World::default() }.fly();
        let name = format!("{}_users_{}_occasions", flown.truth.len(), flown.occasions.len());
        let mut group = c.benchmark_group(name);
        group.sample_size(samples);
        group.bench_function("localize", |b| {
            b.iter(|| pool.install(|| localize(&flown.occasions, &cfg)));
        });
        group.bench_function("crlb", |b| {
            b.iter(|| pool.install(|| crlb(&flown.occasions, &flown.late, &flown.truth, &cfg)));
        });
        group.bench_function("running", |b| {
            b.iter(|| {
                let groups = (0..2u16)
                    .map(|g| (g, (1..=3).map(|d| skyroost_protocol::units::DroneId(3 * g + d)).collect()));
                let mut running = Running::new(cfg, groups);
                flown.occasions.iter().for_each(|occasion| running.add(occasion));
                running.len()
            });
        });
        group.finish();
    }
}

/// A thousand users of one fleet, heard 78 times each.
fn peer_world() -> sim::World {
    let still = sim::World { drift_ns_per_s: 0.0, walk_ns_per_sqrt_s: 0.0, ..sim::World::default() };
    sim::World { users_per_km2: 10.0, fleets: 1, drone_pos_sigma_m: 0.0, ..still }
}

/// The same data for this estimator and for SciPy: what a fleet hears, its clocks off by constants and some captures late;
/// and the easiest case for SciPy, with clocks known and nothing late or lost, so that every user can be solved by itself.
fn peers() {
    let constant = ClockModel::SharedConstant;
    let real = LocalizeConfig { clock: constant, drone_pos_sigma_m: 0.0, ..LocalizeConfig::default() };
    peer(
        "clocks unknown, 5 % of the captures late",
        &peer_world(),
        &real,
        "joint",
        &[("cpu_s", "all at once, sparse Jacobian, soft_l1")],
    );
    let easy_world = sim::World { late_fraction: 0.0, lost_fraction: 0.0, offset_ns: 0.0, ..peer_world() };
    let easy = LocalizeConfig { clock: ClockModel::Synchronised, robust: Robust::None, ..real };
    peer(
        "clocks known, nothing late or lost",
        &easy_world,
        &easy,
        "each",
        &[("default_cpu_s", "as called by default"), ("best_cpu_s", "lm, analytic Jacobian")],
    );
}

/// One comparison; `keys` are the times that the script tells, and how it came by them.
fn peer(what: &str, world: &sim::World, cfg: &LocalizeConfig, how: &str, keys: &[(&str, &str)]) {
    let flown = world.fly();
    let pool = one_thread();
    let mut best = Duration::MAX;
    let mut found = Localization::default();
    for _ in 0..5 {
        let begin = Instant::now();
        found = pool.install(|| localize(&flown.occasions, cfg)).expect("a good configuration");
        best = best.min(begin.elapsed());
    }
    let (users, occasions) = (found.users.len() as f64, flown.occasions.len());
    let ours_s = best.as_secs_f64();
    let mut off_m: Vec<f64> = (found.users.iter())
        .map(|fix| {
            let [x, y] = flown.truth[&fix.user];
            (fix.pos_m[0] - x).hypot(fix.pos_m[1] - y)
        })
        .collect();
    off_m.sort_unstable_by(f64::total_cmp);
    println!("\npeer: {users} users, {occasions} occasions, one thread; {what}");
    let line = |name: &str, cpu_s: f64, off_median_m: f64, how: &str| {
        let (each_us, ratio) = (1e6 * cpu_s / users, cpu_s / ours_s);
        println!(
            "  {name:20}{cpu_s:8.3} s{each_us:9.1} us a user, {ratio:5.1} times ours, off by {off_median_m:.2} m in the median{how}"
        );
    };
    line("skyroost", ours_s, off_m[off_m.len() / 2], "");
    match scipy(how, &flown) {
        Ok(told) => {
            for (key, manner) in keys {
                let number = |key: &str| told[key].as_f64().unwrap_or(f64::NAN);
                line("SciPy least_squares", number(key), number("off_median_m"), &format!(": {manner}"));
            }
        }
        Err(why) => println!("  SciPy: left out, {why}"),
    }
}

/// What `scripts/localize_peer.py` tells.
fn scipy(how: &str, flown: &sim::Flown) -> Result<serde_json::Value, String> {
    let mut captures = String::from("user,epoch_s,drone,x_m,y_m,z_m,toa_ns\n");
    for o in flown.occasions.iter().filter(|o| o.captures.len() >= 2) {
        for Capture { drone, pos_enu_m: [x, y, z], toa_ns, .. } in &o.captures {
            let (user, time_s, drone) = (o.user.0, o.time_s, drone.0);
            writeln!(captures, "{user},{time_s},{drone},{x},{y},{z},{toa_ns}").expect("into memory");
        }
    }
    let mut truth = String::from("id,x_m,y_m\n");
    for (user, [x, y]) in &flown.truth {
        writeln!(truth, "{},{x},{y}", user.0).expect("into memory");
    }
    let dir = tempfile::tempdir().map_err(|e| e.to_string())?;
    let file = |name: &str, text: &str| -> Result<_, String> {
        let path = dir.path().join(name);
        std::fs::write(&path, text).map_err(|e| e.to_string())?;
        Ok(path)
    };
    let (captures, truth) = (file("captures.csv", &captures)?, file("truth.csv", &truth)?);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/localize_peer.py");
    let has_scipy = |python: &&&str| {
        Command::new(python).args(["-c", "import scipy"]).output().is_ok_and(|o| o.status.success())
    };
    let python = ["python3", "/usr/bin/python3"]
        .iter()
        .find(has_scipy)
        .ok_or("no python3 with numpy and scipy here")?;
    let mut command = Command::new(python);
    command.arg(script).arg(how).arg(captures).arg(truth).env("OMP_NUM_THREADS", "1");
    let output = command.output().map_err(|e| e.to_string())?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    serde_json::from_slice(&output.stdout).map_err(|e| e.to_string())
}

criterion_group!(benches, missions);

fn main() {
    benches();
    Criterion::default().configure_from_args().final_summary();
    // `cargo test` runs benches once, without `--bench`: the peer is for measuring only.
    if std::env::args().any(|arg| arg == "--bench") {
        peers();
    }
}
