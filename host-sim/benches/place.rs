//! How long it takes to place, to assign and to find neighbours, and how general solvers compare.
//!
//! `cargo bench -p skyroost-host-sim --bench place`; with the word `peers` behind `--` only the comparison.

#[path = "place/peers.rs"]
mod peers;

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group};
use nalgebra::Matrix2;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use skyroost_host_sim::control::assign::assign;
use skyroost_host_sim::control::place::{
    Fleet, Objective, PlaceUser, UserBelief, disk::best_disk, place, place_joint,
};
use skyroost_host_sim::control::relay::Relay;
use skyroost_host_sim::geometry::{V2, V3};

/// Uniform points in a square.
fn scatter(count: usize, side_m: f64, seed: u64) -> Vec<V2> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    (0..count).map(|_| V2::new(unit() * side_m, unit() * side_m)).collect()
}

/// The paper's 10 km square with error radii of 8.6 m (3.5 m per axis).
fn placement(c: &mut Criterion) {
    let mut group = c.benchmark_group("place");
    group.sample_size(10);
    for (users, drones) in [(100, 6), (500, 12), (5000, 12)] {
        let positions_m = scatter(users, 10_000.0, 1);
        let fleet = Fleet { drones, min_separation_m: 15.0 };
        let disks: Vec<PlaceUser> =
            positions_m.iter().map(|&pos_m| PlaceUser { pos_m, radius_m: 491.4, weight: 1.0 }).collect();
        let beliefs: Vec<UserBelief> = positions_m
            .iter()
            .map(|&pos_m| UserBelief { pos_m, cov_m2: Matrix2::identity() * 12.25 })
            .collect();
        let name = format!("{users}_users_{drones}_drones");
        group.bench_function(BenchmarkId::new("guaranteed", &name), |b| {
            b.iter(|| place(Objective::Guaranteed(black_box(&disks)), fleet));
        });
        group.bench_function(BenchmarkId::new("joint", &name), |b| {
            b.iter(|| place_joint(black_box(&disks), fleet, None));
        });
        group.bench_function(BenchmarkId::new("expected", &name), |b| {
            b.iter(|| place(Objective::Expected { users: black_box(&beliefs), radius_m: 500.0 }, fleet));
        });
    }
    // One disk: a plain sweep takes over a second for the first and over four minutes for the second.
    for users in [20_000, 200_000] {
        let disks: Vec<PlaceUser> = scatter(users, 10_000.0, 1)
            .into_iter()
            .map(|pos_m| PlaceUser { pos_m, radius_m: 491.4, weight: 1.0 })
            .collect();
        group
            .bench_function(BenchmarkId::new("one_disk", users), |b| b.iter(|| best_disk(black_box(&disks))));
    }
    group.finish();
}

fn assignment(c: &mut Criterion) {
    let mut group = c.benchmark_group("assign");
    for drones in [6, 60, 600] {
        let (from_m, to_m) = (scatter(drones, 10_000.0, 2), scatter(drones, 10_000.0, 3));
        group.sample_size(if drones > 100 { 10 } else { 50 });
        group.bench_function(BenchmarkId::from_parameter(drones), |b| {
            b.iter(|| assign(black_box(&from_m), &to_m));
        });
    }
    group.finish();
}

/// Fleets of three at 300 m, as dense as six drones over 100 km2, and the k of the control center.
fn relay(c: &mut Criterion) {
    let mut group = c.benchmark_group("relay");
    for drones in [6, 60, 600] {
        let side_m = 10_000.0 * (f64::from(drones) / 6.0).sqrt();
        let positions_m: Vec<V3> =
            scatter(drones as usize, side_m, 4).iter().map(|p| V3::new(p.x, p.y, 300.0)).collect();
        let mut relay = Relay::new(32);
        group.bench_function(BenchmarkId::from_parameter(drones), |b| {
            b.iter(|| relay.update(black_box(&positions_m)));
        });
    }
    group.finish();
}

criterion_group!(benches, placement, assignment, relay);

fn main() {
    let asked = |word: &str| std::env::args().any(|arg| arg == word);
    if !asked("peers") {
        benches();
        Criterion::default().configure_from_args().final_summary();
    }
    // `cargo test` runs benches once, without `--bench`: the peers are for measuring only.
    if asked("--bench") {
        peers::compare();
    }
}
