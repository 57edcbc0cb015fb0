//! Localization of whole missions, one thread: captures to fixes, the bound, and a peer on the same data.
#![allow(missing_docs)]

use std::fmt::Write as _;
use std::process::Command;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group};
use rayon::ThreadPool;
use skyroost_host_sim::control::localize::{
    C_M_PER_NS, Capture, ClockModel, Localization, LocalizeConfig, Occasion, Robust, Running, crlb, localize,
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

/// The same data for this estimator and for SciPy: clocks known, nothing late or lost, every user by itself.
fn peer() {
    let flown = sim::World {
        users_per_km2: 10.0,
        late_fraction: 0.0,
        lost_fraction: 0.0,
        offset_ns: 0.0,
        drift_ns_per_s: 0.0,
        walk_ns_per_sqrt_s: 0.0,
        fleets: 1,
        ..sim::World::default()
    }
    .fly();
    let cfg = LocalizeConfig {
        clock: ClockModel::Synchronised,
        robust: Robust::None,
        drone_pos_sigma_m: 0.0,
        ..LocalizeConfig::default()
    };
    let pool = one_thread();
    let mut best = Duration::MAX;
    let mut found = Localization::default();
    for _ in 0..5 {
        let begin = Instant::now();
        found = pool.install(|| localize(&flown.occasions, &cfg)).expect("a good configuration");
        best = best.min(begin.elapsed());
    }
    let users = found.users.len() as f64;
    let ours_s = best.as_secs_f64();
    let occasions = flown.occasions.len();
    let steps = found.iterations;
    println!("\npeer: {users} users, {occasions} occasions, one thread, {steps} steps");
    println!("  skyroost            {ours_s:8.3} s  {:9.1} us a user", 1e6 * ours_s / users);
    match scipy(&flown.occasions, &found) {
        Ok(Peer { default_cpu_s, best_cpu_s, apart_median_m }) => {
            for (how, cpu_s) in
                [("as called by default", default_cpu_s), ("lm, analytic Jacobian", best_cpu_s)]
            {
                let (each_us, ratio) = (1e6 * cpu_s / users, cpu_s / ours_s);
                println!(
                    "  SciPy least_squares {cpu_s:8.3} s  {each_us:9.1} us a user, {ratio:.0} times ours: {how}"
                );
            }
            println!("  answers differ by {apart_median_m:.4} m in the median");
        }
        Err(why) => println!("  SciPy: left out, {why}"),
    }
}

/// What SciPy takes, and how far its answers are from ours.
struct Peer {
    default_cpu_s: f64,
    best_cpu_s: f64,
    apart_median_m: f64,
}

fn scipy(occasions: &[Occasion], found: &Localization) -> Result<Peer, String> {
    let mut captures = String::from("user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns\n");
    for o in occasions {
        for Capture { drone, pos_enu_m: [x, y, z], toa_ns, .. } in &o.captures {
            let (user, time_s, drone) = (o.user.0, o.time_s, drone.0);
            writeln!(captures, "{user},{time_s},{drone},{x},{y},{z},{toa_ns},5").expect("into memory");
        }
    }
    let mut ours = String::from("id,x_m,y_m\n");
    for fix in &found.users {
        writeln!(ours, "{},{},{}", fix.user.0, fix.pos_m[0], fix.pos_m[1]).expect("into memory");
    }
    let dir = tempfile::tempdir().map_err(|e| e.to_string())?;
    let file = |name: &str, text: &str| -> Result<_, String> {
        let path = dir.path().join(name);
        std::fs::write(&path, text).map_err(|e| e.to_string())?;
        Ok(path)
    };
    let (captures, ours) = (file("captures.csv", &captures)?, file("ours.csv", &ours)?);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/localize_peer.py");
    let has_scipy = |python: &&&str| {
        Command::new(python).args(["-c", "import scipy"]).output().is_ok_and(|o| o.status.success())
    };
    let python = ["python3", "/usr/bin/python3"]
        .iter()
        .find(has_scipy)
        .ok_or("no python3 with numpy and scipy here")?;
    let output =
        Command::new(python).arg(script).arg(captures).arg(ours).output().map_err(|e| e.to_string())?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).map_err(|e| e.to_string())?;
    let number = |key: &str| told[key].as_f64().ok_or_else(|| format!("{key} is missing"));
    Ok(Peer {
        default_cpu_s: number("default_cpu_s")?,
        best_cpu_s: number("best_cpu_s")?,
        apart_median_m: number("apart_median_m")?,
    })
}

criterion_group!(benches, missions);

fn main() {
    benches();
    Criterion::default().configure_from_args().final_summary();
    // `cargo test` runs benches once, without `--bench`: the peer is for measuring only.
    if std::env::args().any(|arg| arg == "--bench") {
        peer();
    }
}
