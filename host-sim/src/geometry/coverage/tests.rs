//! Truth tests of the coverage: closed forms, and a fine scan that shares no code with it.

use std::f64::consts::PI;

use proptest::prelude::*;

use super::slab::Kernel;
use super::*;

fn rectangle(width_m: f64, height_m: f64) -> Polygon {
    let corners = [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]];
    Polygon::new(&corners.map(|[x, y]| V2::new(x, y))).unwrap()
}

fn track(points: &[V2], radius_m: f64) -> Vec<Stadium> {
    points.windows(2).map(|w| Stadium { a: w[0], b: w[1], radius_m }).collect()
}

/// Lanes from end to end of a rectangle, one spacing apart, turned by an angle with everything else.
fn lanes(width_m: f64, spacing_m: f64, count: usize) -> Vec<V2> {
    (0..2 * count)
        .map(|i| {
            V2::new(if i.div_ceil(2) % 2 == 0 { 0.0 } else { width_m }, (0.5 + (i / 2) as f64) * spacing_m)
        })
        .collect()
}

fn turned(p: V2, angle: f64) -> V2 {
    nalgebra::Rotation2::new(angle) * p
}

/// Cuts each leg into n short ones.
fn chopped(points: &[V2], n: usize) -> Vec<V2> {
    let mut short: Vec<V2> = points
        .windows(2)
        .flat_map(|w| (0..n).map(|k| w[0] + (w[1] - w[0]) * (k as f64 / n as f64)))
        .collect();
    short.extend(points.last());
    short
}

/// Uncovered area by many scan lines, each covered interval found by bisection on the distance.
fn scanned_m2(polygon: &Polygon, stadiums: &[Stadium], lines: usize) -> f64 {
    let [min, max] = polygon.bbox_m();
    let step_m = (max.y - min.y) / lines as f64;
    let mut sum_m2 = 0.0;
    for k in 0..lines {
        let y = min.y + (k as f64 + 0.5) * step_m;
        let mut spans: Vec<[f64; 2]> = stadiums.iter().filter_map(|s| chord(s, y)).collect();
        spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut borders: Vec<f64> = polygon
            .edges_m()
            .filter(|(a, b)| (a.y > y) != (b.y > y))
            .map(|(a, b)| a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y))
            .collect();
        borders.sort_by(f64::total_cmp);
        for inside in borders.chunks(2) {
            let mut at = inside[0];
            for s in &spans {
                if s[0] > at {
                    sum_m2 += (s[0].min(inside[1]) - at).max(0.0) * step_m;
                }
                at = at.max(s[1]).min(inside[1]);
            }
            sum_m2 += (inside[1] - at).max(0.0) * step_m;
        }
    }
    sum_m2
}

fn chord(s: &Stadium, y: f64) -> Option<[f64; 2]> {
    let depth = |x: f64| s.axis_distance_m(V2::new(x, y)) - s.radius_m;
    let (mut west, mut east) = (s.a.x.min(s.b.x) - s.radius_m, s.a.x.max(s.b.x) + s.radius_m);
    let ends = [west, east];
    for _ in 0..100 {
        let (p, q) = (west + (east - west) / 3.0, east - (east - west) / 3.0);
        if depth(p) < depth(q) { east = q } else { west = p }
    }
    let deepest = (west + east) / 2.0;
    (depth(deepest) < 0.0).then(|| {
        ends.map(|end| {
            let (mut out, mut within) = (end, deepest);
            for _ in 0..60 {
                let middle = (out + within) / 2.0;
                if depth(middle) > 0.0 { out = middle } else { within = middle }
            }
            within
        })
    })
}

fn residue_m2(coverage: &Coverage) -> f64 {
    coverage.residue.iter().map(|ring| crate::geometry::polygon::signed_area_m2(ring)).sum()
}

#[test]
fn truth_one_stadium_and_a_lens() {
    let polygon = rectangle(1000.0, 1000.0);
    for angle in [0.0, 0.3, 1.0, PI / 2.0, 2.5] {
        let middle = V2::new(500.0, 500.0);
        let half = turned(V2::new(150.0, 0.0), angle);
        let one = Stadium { a: middle - half, b: middle + half, radius_m: 100.0 };
        let found = covered(&polygon, &[one]);
        assert!((1e6 - found.uncovered_area_m2 - (300.0 * 200.0 + PI * 1e4)).abs() < 1e-4);
        assert!((residue_m2(&found) - found.uncovered_area_m2).abs() < 40.0);
        let disk = |c: V2| Stadium { a: c, b: c, radius_m: 200.0 };
        let two = covered(&polygon, &[disk(middle - half), disk(middle + half)]);
        let lens_m2 = 2.0 * 4e4 * 0.75f64.acos() - 150.0 * (16e4 - 9e4_f64).sqrt();
        assert!((1e6 - two.uncovered_area_m2 - (2.0 * PI * 4e4 - lens_m2)).abs() < 1e-4);
    }
}

#[test]
fn lanes_with_overlap_cover_exactly_all() {
    let polygon = rectangle(10_000.0, 10_000.0);
    let spacing_m = 10_000.0 / 11.0;
    for n in [1, 7, 500] {
        let found = covered(&polygon, &track(&chopped(&lanes(10_000.0, spacing_m, 11), n), 471.13));
        assert_eq!(found.covered_fraction.to_bits(), 1.0f64.to_bits());
        assert!(found.residue.is_empty());
    }
}

#[test]
fn lanes_that_only_touch_cover_all() {
    for angle in [0.0, 1e-4, 0.3, PI / 2.0, 2.0] {
        let polygon = rectangle(10_000.0, 10_000.0).moved(|p| turned(p, angle));
        let way: Vec<V2> = lanes(10_000.0, 1000.0, 10).into_iter().map(|p| turned(p, angle)).collect();
        for n in [1, 300] {
            let found = covered(&polygon, &track(&chopped(&way, n), 500.0));
            assert!(found.covered_fraction > 1.0 - 1e-9, "{angle} {n}: {}", found.uncovered_area_m2);
        }
    }
}

#[test]
fn truth_a_gap_of_known_width() {
    let polygon = rectangle(10_000.0, 10_000.0);
    // Two centimetres are missing between neighbours, and one at either border: 0.2 m of 10 km.
    for n in [1, 300] {
        let found = covered(&polygon, &track(&chopped(&lanes(10_000.0, 1000.0, 10), n), 499.99));
        let connectors_m2 = 9.0 * 0.02 * 500.0;
        assert!(
            (found.uncovered_area_m2 - 2000.0 + connectors_m2).abs() < 1.0,
            "{}",
            found.uncovered_area_m2
        );
    }
}

#[test]
fn nothing_flown_covers_nothing() {
    let polygon = rectangle(300.0, 200.0);
    let found = covered(&polygon, &[]);
    assert!((found.uncovered_area_m2 - 6e4).abs() < 1e-9 && found.covered_fraction.abs() < 1e-12);
    assert!((residue_m2(&found) - 6e4).abs() < 1e-9);
    let dead = Stadium { a: V2::new(100.0, 100.0), b: V2::new(200.0, 100.0), radius_m: -5.0 };
    assert_eq!(covered(&polygon, &[dead]), found);
}

#[test]
fn truth_a_polygon_that_is_not_convex() {
    let l = [[0.0, 0.0], [900.0, 0.0], [900.0, 300.0], [300.0, 300.0], [300.0, 900.0], [0.0, 900.0]];
    let polygon = Polygon::new(&l.map(|[x, y]| V2::new(x, y))).unwrap();
    let way = [V2::new(100.0, 850.0), V2::new(200.0, 200.0), V2::new(700.0, 100.0)];
    let stadiums = track(&chopped(&way, 40), 130.0);
    let found = covered(&polygon, &stadiums);
    assert!((found.uncovered_area_m2 - scanned_m2(&polygon, &stadiums, 9000)).abs() < 5.0);
}

/// Legs, sway (metres), uncovered area (square metres): printed by `truth_coverage.py`.
const GEOS: [(u32, f64, f64); 5] = [
    (20, 0.0, 5514812.3495),
    (60, 0.0, 5173087.3810),
    (120, 0.0, 4277483.2959),
    (120, 7.0, 4276894.4396),
    (240, 15.0, 1172867.1266),
];

/// The track of `truth_coverage.py`.
fn spiral(legs: u32, sway_m: f64) -> Vec<Stadium> {
    let point = |i: u32| {
        let t = f64::from(i);
        let (r, a) = (80.0 + 5.0 * t, 0.21 * t);
        V2::new(
            1400.0 + r * a.cos() + sway_m * (2.7 * t).sin(),
            1200.0 + 0.8 * r * a.sin() + sway_m * (1.9 * t).cos(),
        )
    };
    (0..legs)
        .map(|i| Stadium {
            a: point(i),
            b: point(i + 1),
            radius_m: 120.0 + 20.0 * (0.7 * f64::from(i)).sin(),
        })
        .collect()
}

#[test]
fn truth_agrees_with_geos() {
    let corners = [[100.0, 0.0], [2700.0, 150.0], [2950.0, 1700.0], [1500.0, 2450.0], [50.0, 1900.0]];
    let polygon = Polygon::new(&corners.map(|[x, y]| V2::new(x, y))).unwrap();
    for (legs, sway_m, truth_m2) in GEOS {
        let found = covered(&polygon, &spiral(legs, sway_m));
        assert!((found.uncovered_area_m2 - truth_m2).abs() < 1e-7 * polygon.area_m2(), "{legs} {sway_m}");
    }
}

/// A wandering track with a radius that varies.
fn wandering() -> impl Strategy<Value = Vec<(V2, f64)>> {
    let point = (0.0..3000.0f64, 0.0..2500.0f64, 150.0..400.0f64);
    prop::collection::vec(point, 1..14)
        .prop_map(|v| v.into_iter().map(|(x, y, r)| (V2::new(x, y), r)).collect())
}

fn legs(points: &[(V2, f64)]) -> Vec<Stadium> {
    points.windows(2).map(|w| Stadium { a: w[0].0, b: w[1].0, radius_m: w[0].1.min(w[1].1) }).collect()
}

/// Short legs that sway around a coarse track, as flown ones do.
fn swaying(points: &[(V2, f64)], sway_m: f64) -> Vec<(V2, f64)> {
    let mut fine = Vec::new();
    for w in points.windows(2) {
        for k in 0..40 {
            let t = f64::from(k) / 40.0;
            let phase = (fine.len() as f64) * 0.37;
            let sway = V2::new(phase.sin(), (1.3 * phase).cos()) * sway_m;
            fine.push((
                w[0].0.lerp(&w[1].0, t) + sway,
                w[0].1 + (w[1].1 - w[0].1) * t + sway_m * phase.cos(),
            ));
        }
    }
    fine
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(30))]

    #[test]
    fn truth_agrees_with_a_fine_scan(points in wandering()) {
        let polygon = rectangle(3000.0, 2500.0).moved(|p| turned(p - V2::new(1500.0, 1250.0), 0.4) + V2::new(1500.0, 1250.0));
        let stadiums = legs(&points);
        let found = covered(&polygon, &stadiums);
        let truth_m2 = scanned_m2(&polygon, &stadiums, 1500);
        // A side along the scan lines may be missed by half a step (2.3 m) over its length.
        prop_assert!((found.uncovered_area_m2 - truth_m2).abs() < 4000.0, "{} {}", found.uncovered_area_m2, truth_m2);
        prop_assert!((residue_m2(&found) - found.uncovered_area_m2).abs() < 1e-4 * polygon.area_m2());
    }

    /// The search (cells, tree, dropping of dominated legs) against the kernel alone on the whole polygon.
    #[test]
    fn the_search_changes_nothing(points in wandering(), sway_m in 0.0..20.0f64) {
        let polygon = rectangle(3000.0, 2500.0);
        let stadiums = legs(&swaying(&points[..points.len().min(5)], sway_m));
        let found = covered(&polygon, &stadiums).uncovered_area_m2;
        let alone = Kernel::default().uncovered(polygon.vertices_m(), stadiums.iter().copied(), &mut Vec::new());
        prop_assert!((found - alone).abs() < 0.05, "{found} {alone}");
    }

    #[test]
    fn a_simplified_track_never_covers_more(points in wandering(), tolerance_m in 0.1..30.0f64) {
        let polygon = rectangle(3000.0, 2500.0);
        let fine = swaying(&points, 5.0);
        let merged = stadiums_from_track(&fine, tolerance_m);
        prop_assert!(merged.len() <= fine.len().max(1));
        let exact = covered(&polygon, &legs(&fine)).uncovered_area_m2;
        let simplified = covered(&polygon, &merged).uncovered_area_m2;
        prop_assert!(simplified >= exact - 0.01, "{simplified} {exact}");
    }

    #[test]
    fn a_straight_track_becomes_one_stadium(n in 2usize..2000) {
        let fine: Vec<(V2, f64)> = (0..n).map(|i| (V2::new(3.0, 4.0) * i as f64, 471.0)).collect();
        let merged = stadiums_from_track(&fine, 0.01);
        prop_assert_eq!(merged.len(), 1);
        prop_assert!((merged[0].b - fine[n - 1].0).norm() < 1e-12 && (merged[0].radius_m - 471.0).abs() < 1e-6);
    }
}
