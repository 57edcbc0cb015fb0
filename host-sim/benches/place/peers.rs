//! Our joint placement and general solvers on the same instances, in one run.

use std::io::Write as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use serde_json::{Value, json};
use skyroost_host_sim::control::place::{Fleet, PlaceUser, candidate_disks, place_joint};
use skyroost_host_sim::geometry::V2;

/// Time that a general solver has.
const LIMIT_S: u64 = 60;
const SIDE_M: f64 = 10_000.0;
const RADIUS_M: f64 = 470.0;

/// How users lie.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Anywhere.
    Poisson,
    /// Around twenty centres, 300 m in each coordinate (Thomas 1949).
    Thomas,
    /// In a hexagonal pattern of which one disk covers seven, a little out of place: most disks are as good as the next.
    Packing,
}

struct Dice(ChaCha8Rng);

impl Dice {
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn anywhere(&mut self) -> V2 {
        V2::new(self.unit(), self.unit()) * SIDE_M
    }

    /// Two standard normal variates (Box and Muller).
    fn normal(&mut self) -> V2 {
        let radius = (-2.0 * self.unit().max(f64::MIN_POSITIVE).ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * self.unit()).sin_cos();
        V2::new(cos, sin) * radius
    }
}

fn draw(kind: Kind, users: usize, seed: u64) -> Vec<PlaceUser> {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed));
    let centres: Vec<V2> = (0..20).map(|_| dice.anywhere()).collect();
    let pitch_m = 0.9 * RADIUS_M;
    let columns = (SIDE_M / pitch_m) as usize;
    let place = |i: usize| match kind {
        Kind::Poisson => dice.anywhere(),
        Kind::Thomas => centres[i % centres.len()] + dice.normal() * 300.0,
        Kind::Packing => {
            let (column, row) = (i % columns, i / columns % columns);
            let at = V2::new(column as f64 + 0.5 * (row % 2) as f64, row as f64 * 0.75f64.sqrt());
            at * pitch_m + dice.normal() * 20.0
        }
    };
    (0..users).map(place).map(|pos_m| PlaceUser { pos_m, radius_m: RADIUS_M, weight: 1.0 }).collect()
}

/// Prints a table: seconds of each solver, and how many times ours.
pub(crate) fn compare() {
    let python = ["python3", "/usr/bin/python3"].into_iter().find(|python| {
        let run = Command::new(python).args(["-c", "import highspy, ortools"]).output();
        run.is_ok_and(|run| run.status.success())
    });
    if python.is_none() {
        println!("\npeers: left out, no python3 with highspy and ortools here");
    }
    println!(
        "\n{:<8} {:>5} {:>3} {:>4}  {:>6} {:>6} {:>9}  {:>7}  {:>19}  {:>19}",
        "users", "n", "m", "seed", "value", "proved", "ours, s", "disks", "HiGHS, CPU s", "CP-SAT, CPU s"
    );
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let mut runs = Vec::new();
    for (kind, users, drones) in [
        (Kind::Poisson, 200, 3),
        (Kind::Poisson, 500, 6),
        (Kind::Poisson, 500, 12),
        (Kind::Poisson, 1000, 6),
        (Kind::Poisson, 1000, 12),
        (Kind::Poisson, 2000, 6),
        (Kind::Poisson, 2000, 12),
        (Kind::Thomas, 200, 6),
        (Kind::Thomas, 500, 6),
        (Kind::Thomas, 1000, 6),
        (Kind::Thomas, 1000, 12),
        (Kind::Thomas, 5000, 12),
        (Kind::Packing, 300, 6),
        (Kind::Packing, 500, 12),
    ] {
        for seed in 1..=2 {
            runs.push((kind, one_thread.install(|| row(kind, users, drones, seed, python))));
        }
    }
    for kind in [Kind::Poisson, Kind::Thomas, Kind::Packing] {
        let of_kind: Vec<&Run> = runs.iter().filter(|(k, _)| *k == kind).map(|(_, run)| run).collect();
        summary(kind, &of_kind);
    }
}

/// CPU seconds of an instance: ours, and of the peers that proved the optimum.
struct Run {
    ours_s: f64,
    highs_s: Option<f64>,
    cp_sat_s: Option<f64>,
}

fn summary(kind: Kind, runs: &[&Run]) {
    for (name, peer_s) in
        [("HiGHS", (|run| run.highs_s) as fn(&Run) -> Option<f64>), ("CP-SAT", |run| run.cp_sat_s)]
    {
        let both: Vec<(f64, f64)> = runs.iter().filter_map(|run| Some((run.ours_s, peer_s(run)?))).collect();
        let (ours_s, theirs_s) = both.iter().fold((0.0, 0.0), |sum, run| (sum.0 + run.0, sum.1 + run.1));
        println!(
            "{kind:?}, {} instances that {name} proves: {ours_s:.3} s, {name} {theirs_s:.3} s, {:.1} times",
            both.len(),
            theirs_s / ours_s
        );
    }
    let better = |run: &&&Run| {
        let peers_s = run.highs_s.into_iter().chain(run.cp_sat_s).reduce(f64::min)?;
        Some(peers_s / run.ours_s)
    };
    let ratios: Vec<f64> = runs.iter().filter_map(|run| better(&run)).collect();
    let mean = (ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / ratios.len() as f64).exp();
    let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    println!("{kind:?}, the better of both: {mean:.1} times by geometric mean, {least:.1} at least");
}

fn row(kind: Kind, count: usize, drones: usize, seed: u64, python: Option<&str>) -> Run {
    let users = draw(kind, count, seed);
    let fleet = Fleet { drones, min_separation_m: 0.0 };
    let begin = Instant::now();
    let limit = begin + Duration::from_secs(LIMIT_S);
    let ours = place_joint(&users, fleet, Some(limit)).expect("good instances");
    let ours_s = begin.elapsed().as_secs_f64();
    let told = python.zip(candidate_disks(&users)).and_then(|(python, disks)| peer(python, drones, &disks));
    let number = |value: &Value| value.as_f64();
    let solver = |name: &str| {
        let Some(told) = told.as_ref().and_then(|told| told.get(name)) else { return "-".to_owned() };
        let cpu_s = number(&told["cpu_s"]).unwrap_or(f64::NAN);
        if told["proved"] == true {
            let same = number(&told["value"]).is_some_and(|value| (value - ours.value).abs() < 0.5);
            assert!(same || !ours.proved_optimal, "{name} has {told}, we have {}", ours.value);
            format!("{cpu_s:8.3} {:>5.0} times", cpu_s / ours_s)
        } else {
            format!("{cpu_s:8.3}  not proved")
        }
    };
    let disks = told.as_ref().map_or("-".to_owned(), |told| told["disks"].to_string());
    println!(
        "{:<8} {count:>5} {drones:>3} {seed:>4}  {:>6} {:>6} {ours_s:>9.3}  {disks:>7}  {:>19}  {:>19}",
        format!("{kind:?}"),
        ours.value,
        ours.proved_optimal,
        solver("highs"),
        solver("cp_sat"),
    );
    let proved_s = |name: &str| {
        let solver = told.as_ref()?.get(name)?;
        if solver["proved"] == true { solver["cpu_s"].as_f64() } else { None }
    };
    Run { ours_s, highs_s: proved_s("highs"), cp_sat_s: proved_s("cp_sat") }
}

fn peer(python: &str, drones: usize, disks: &[Vec<u32>]) -> Option<Value> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/place_peer.py");
    let mut command = Command::new(python);
    command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().ok()?;
    let asked = json!({ "drones": drones, "disks": disks, "limit_s": LIMIT_S }).to_string();
    child.stdin.take()?.write_all(asked.as_bytes()).ok()?;
    serde_json::from_slice(&child.wait_with_output().ok()?.stdout).ok()
}
