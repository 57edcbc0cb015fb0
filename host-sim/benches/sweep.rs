//! Planning a sweep, and measuring what two fleets covered on their flown tracks.
#![allow(missing_docs)] // criterion's macros

use criterion::{Criterion, criterion_group, criterion_main};
use skyroost_host_sim::control::sweep::{CornerModel, SplitMode, SweepPlan, SweepRequest, plan};
use skyroost_host_sim::geometry::V2;
use skyroost_host_sim::geometry::coverage::{Stadium, covered, stadiums_from_track};
use skyroost_host_sim::geometry::polygon::Polygon;
use skyroost_host_sim::geometry::region::Region;

fn square() -> Polygon {
    let corners = [[0.0, 0.0], [10_000.0, 0.0], [10_000.0, 10_000.0], [0.0, 10_000.0]];
    match Polygon::new(&corners.map(|[x, y]| V2::new(x, y))) {
        Ok(square) => square,
        Err(error) => panic!("{error}"),
    }
}

fn request() -> SweepRequest {
    SweepRequest {
        fleets: 2,
        proportions: vec![0.5, 0.5],
        split: SplitMode::Auto,
        radius_m: 500.0,
        spacing_m: 50.0,
        speed_mps: 10.0,
        corner: CornerModel { max_accel_mps2: 3.0, corner_speed_mps: 2.0 },
        margin_m: 0.0,
        entry_m: None,
    }
}

/// A track as flown: samples every `step_m` that sway around the planned lanes, and so does the radius.
fn flown(plan: &SweepPlan, step_m: f64, sway_m: f64, radius_m: f64) -> Vec<Vec<(V2, f64)>> {
    let fly = |path: &[V2]| {
        let mut track = Vec::new();
        for leg in path.windows(2) {
            let length_m = (leg[1] - leg[0]).norm();
            let along = (leg[1] - leg[0]) / length_m;
            let mut at_m = 0.0;
            while at_m < length_m {
                let phase = track.len() as f64 * step_m;
                let sway = (phase / 35.0).sin() + 0.3 * (phase / 4.0).cos();
                let across = V2::new(-along.y, along.x) * (sway * sway_m);
                track.push((leg[0] + along * at_m + across, radius_m + 0.2 * sway_m * (phase / 9.0).sin()));
                at_m += step_m;
            }
        }
        track
    };
    plan.sub_areas.iter().map(|s| fly(&s.path_m)).collect()
}

fn legs(tracks: &[Vec<(V2, f64)>]) -> Vec<Stadium> {
    let leg = |w: &[(V2, f64)]| Stadium { a: w[0].0, b: w[1].0, radius_m: w[0].1.min(w[1].1) };
    tracks.iter().flat_map(|t| t.windows(2).map(leg)).collect()
}

fn sweep(c: &mut Criterion) {
    let square = square();
    let region = Region::from(square.clone());
    let Ok(paper) = plan(&region, &request()) else { panic!("the paper's square has a plan") };
    c.bench_function("plan/paper square, 2 fleets, auto", |b| b.iter(|| plan(&region, &request())));
    let radius_m = paper.swath_m / 2.0;
    for (name, step_m, sway_m, radius_m) in [
        ("12k legs, sway 1 m, all covered", 10.0, 1.0, radius_m),
        ("58k legs, sway 1 m, all covered", 2.0, 1.0, radius_m),
        ("12k legs, sway 1 m, gaps between all lanes", 10.0, 1.0, 454.6),
        ("58k legs, sway 1 m, gaps between all lanes", 2.0, 1.0, 454.6),
    ] {
        let tracks = flown(&paper, step_m, sway_m, radius_m);
        let stadiums = legs(&tracks);
        let found = covered(&square, &stadiums);
        println!(
            "{name}: {} legs, uncovered {} m2, {} rings",
            stadiums.len(),
            found.uncovered_area_m2,
            found.residue.len()
        );
        c.bench_function(&format!("covered/{name}"), |b| b.iter(|| covered(&square, &stadiums)));
        c.bench_function(&format!("simplified and covered/{name}"), |b| {
            b.iter(|| {
                let merged: Vec<Stadium> = tracks.iter().flat_map(|t| stadiums_from_track(t, 0.5)).collect();
                covered(&square, &merged)
            });
        });
    }
}

/// Areas of `vertices` corners, 20 km wide: on an ellipse, or in and out like a star.
fn ring(vertices: usize, star: bool) -> Region {
    let corner = |k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / vertices as f64;
        let radius_m = if star && k % 2 == 1 {
            7_000.0
        } else {
            10_000.0 + 50.0 * (0.7 * k as f64).sin() * f64::from(u8::from(star))
        };
        V2::new(angle.cos(), 0.8 * angle.sin()) * radius_m
    };
    match Polygon::new(&(0..vertices).map(corner).collect::<Vec<_>>()) {
        Ok(polygon) => Region::from(polygon),
        Err(error) => panic!("{error}"),
    }
}

/// Planning time against the number of vertices, with 30 fleets.
fn vertices(c: &mut Criterion) {
    let request = SweepRequest { fleets: 30, proportions: vec![1.0 / 30.0; 30], ..request() };
    let mut group = c.benchmark_group("plan, 30 fleets, by number of vertices");
    group.sample_size(10);
    for vertices in [12, 50, 200, 800] {
        for (shape, star) in [("convex", false), ("star", true)] {
            let region = ring(vertices, star);
            group.bench_function(format!("{shape}/{vertices}"), |b| b.iter(|| plan(&region, &request)));
        }
    }
    group.finish();
}

criterion_group!(benches, sweep, vertices);
criterion_main!(benches);
