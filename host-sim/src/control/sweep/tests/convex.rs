//! Truth tests against the paper's square, and laws that hold for any convex area.

use std::f64::consts::PI;

use proptest::prelude::*;

use super::{plan, rectangle, request};
use crate::control::sweep::timing::length_m;
use crate::control::sweep::{SplitMode, SweepPlan, SweepRequest};
use crate::geometry::V2;
use crate::geometry::polygon::{Polygon, clip, extent};

#[test]
fn truth_paper_square_by_area() {
    let plan = plan(&rectangle(10_000.0, 10_000.0), &request(2, SplitMode::Area)).unwrap();
    assert!((plan.swath_m - 942.26).abs() < 0.01);
    assert!((plan.width_m - 10_000.0).abs() < 1e-9 && plan.direction_rad.abs() < 1e-12);
    for s in &plan.sub_areas {
        // Six lanes along the sub-area take 61,528 m; eleven across it 61,365.
        assert!((s.length_m - 61_365.0).abs() < 1.0, "{} m", s.length_m);
        assert!((s.duration_s / 60.0 - 102.27).abs() < 0.01);
        assert_eq!((s.turns, s.path_m.len()), (10, 22));
        assert!((s.region.as_ref().unwrap().area_m2() / 5e7 - 1.0).abs() < 1e-9);
        assert!(s.covered_fraction > 1.0 - 1e-9);
    }
    assert!(plan.covered_fraction > 1.0 - 1e-9);
}

#[test]
fn truth_paper_square_by_length_takes_less_than_100_minutes() {
    let plan = plan(&rectangle(10_000.0, 10_000.0), &request(2, SplitMode::Auto)).unwrap();
    assert_eq!(plan.split, SplitMode::Length);
    for s in &plan.sub_areas {
        assert!((s.length_m - 58_182.0).abs() < 1.0, "{} m", s.length_m);
        assert!((s.duration_s / 60.0 - 96.97).abs() < 0.01);
        assert_eq!((s.turns, s.path_m.len()), (5, 12));
        assert!(s.covered_fraction > 1.0 - 1e-9, "{}", s.covered_fraction);
    }
    // The cut in the middle of the sixth lane is where the one ends and the other begins.
    let cut = *plan.sub_areas[0].path_m.last().unwrap();
    assert!((cut - V2::new(5000.0, 5000.0)).norm() < 1e-3, "{cut}");
    assert!((cut - plan.sub_areas[1].path_m[0]).norm() < 1e-9);
    assert!(plan.covered_fraction > 1.0 - 1e-9);
}

#[test]
fn truth_corners_cost_time() {
    let mut slow = request(1, SplitMode::Area);
    slow.corner.corner_speed_mps = 2.0;
    let square = rectangle(10_000.0, 10_000.0);
    let lost_s = plan(&square, &slow).unwrap().duration_s()
        - plan(&square, &request(1, SplitMode::Area)).unwrap().duration_s();
    // 11 lanes, 20 corners, 8^2 / (3 * 10) s each.
    assert!((lost_s - 20.0 * 64.0 / 30.0).abs() < 1e-6);
}

#[test]
fn a_margin_narrows_the_lanes_and_not_the_disk() {
    let mut wide = request(1, SplitMode::Area);
    wide.margin_m = 20.0;
    let plan = plan(&rectangle(10_000.0, 10_000.0), &wide).unwrap();
    // 10 km / (942.26 m - 40 m) = 11.08: one lane more.
    assert_eq!(plan.sub_areas[0].turns, 11);
    assert!((plan.swath_m - 942.26).abs() < 0.01);
    assert_eq!(plan.covered_fraction.to_bits(), 1.0f64.to_bits());
}

#[test]
fn a_fleet_begins_where_it_comes_from() {
    let square = rectangle(10_000.0, 10_000.0);
    for split in [SplitMode::Area, SplitMode::Length] {
        let mut from_south_west = request(2, split);
        from_south_west.entry_m = Some(vec![V2::new(-100.0, -100.0), V2::new(-100.0, 5000.0)]);
        let first = plan(&square, &from_south_west).unwrap().sub_areas[0].path_m[0];
        assert!(first.x < 500.0 && first.y < 500.0, "{first}");
        from_south_west.entry_m = Some(vec![V2::new(10_100.0, 5000.0), V2::new(10_100.0, 10_100.0)]);
        let last = plan(&square, &from_south_west).unwrap().sub_areas[1].path_m[0];
        assert!(last.x > 9500.0 && last.y > 9500.0, "{last}");
    }
}

#[test]
fn a_long_area_narrower_than_a_swath_is_one_lane() {
    let plan = plan(&rectangle(5000.0, 300.0), &request(2, SplitMode::Length)).unwrap();
    assert!(plan.sub_areas.iter().all(|s| s.turns == 0 && s.path_m.len() == 2));
    assert!(plan.covered_fraction > 1.0 - 1e-9);
}

#[test]
fn one_position_covers_a_small_area() {
    let found = plan(&rectangle(600.0, 500.0), &request(1, SplitMode::Auto)).unwrap();
    assert_eq!(found.sub_areas[0].path_m.len(), 1);
    assert_eq!(found.length_m().to_bits(), 0.0f64.to_bits());
    assert!(found.covered_fraction > 1.0 - 1e-9);
    let two = plan(&rectangle(600.0, 500.0), &request(2, SplitMode::Auto)).unwrap();
    assert!(two.covered_fraction > 1.0 - 1e-9 && two.sub_areas.len() == 2);
}

#[test]
fn bad_requests_are_named() {
    let square = rectangle(10_000.0, 10_000.0);
    let fault = |change: &dyn Fn(&mut SweepRequest)| {
        let mut changed = request(2, SplitMode::Auto);
        change(&mut changed);
        plan(&square, &changed).unwrap_err().to_string()
    };
    for (found, part) in [
        (fault(&|r| r.fleets = 0), "found 0 fleets"),
        (fault(&|r| r.fleets = 3), "found 2 proportions for 3 fleets"),
        (fault(&|r| r.proportions = vec![0.5, 0.4]), "the proportions sum to 0.9, expected 1"),
        (fault(&|r| r.proportions = vec![1.5, -0.5]), "proportion 2 is -0.5"),
        (fault(&|r| r.proportions = vec![f64::NAN, 0.5]), "proportion 1 is NaN"),
        (fault(&|r| r.proportions = vec![1.0 - 1e-15, 1e-15]), "leaves it no area"),
        (fault(&|r| r.radius_m = -500.0), "radius_m is -500"),
        (fault(&|r| r.speed_mps = f64::INFINITY), "speed_mps is inf"),
        (fault(&|r| r.spacing_m = 900.0), "leave no swath"),
        (fault(&|r| r.margin_m = 480.0), "leave no swath"),
        (fault(&|r| r.radius_m = 29.0), "lanes"),
        (fault(&|r| r.entry_m = Some(vec![V2::zeros()])), "found 1 entry points for 2 fleets"),
        (
            fault(&|r| r.entry_m = Some(vec![V2::zeros(), V2::new(0.0, f64::NAN)])),
            "y_m of entry point 2 is NaN",
        ),
    ] {
        assert!(found.contains(part), "{found:?} lacks {part:?}");
    }
}

/// Convex areas of 3 to 10 vertices on an ellipse, 1 to 20 km wide, anywhere.
fn convex() -> impl Strategy<Value = Polygon> {
    let angles = prop::collection::vec(0.0..2.0 * PI, 3..10);
    (angles, 700.0..10_000.0f64, 700.0..10_000.0f64, -1e5..1e5f64, 0.0..PI).prop_filter_map(
        "no area",
        |(mut angles, a_m, b_m, shift_m, turn)| {
            angles.sort_by(f64::total_cmp);
            let point = |t: &f64| {
                nalgebra::Rotation2::new(turn) * V2::new(a_m * t.cos(), b_m * t.sin())
                    + V2::new(shift_m, -shift_m)
            };
            Polygon::new(&angles.iter().map(point).collect::<Vec<_>>()).ok()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn any_convex_area_is_covered(
        polygon in convex(), weights in prop::collection::vec(0.2..1.0f64, 1..5),
        split in prop_oneof![Just(SplitMode::Area), Just(SplitMode::Length), Just(SplitMode::Auto)],
        margin_m in prop_oneof![Just(0.0), 0.0..50.0f64], corner_mps in 0.0..12.0f64,
    ) {
        let total: f64 = weights.iter().sum();
        let mut request = request(weights.len(), split);
        request.proportions = weights.iter().map(|w| w / total).collect();
        request.margin_m = margin_m;
        request.corner.corner_speed_mps = corner_mps;
        let found = plan(&polygon, &request).map_err(|e| TestCaseError::fail(e.to_string()))?;
        prop_assert!(found.covered_fraction >= 1.0 - 1e-6, "{}", found.covered_fraction);
        if found.sub_areas[0].region.is_some() {
            // Sub-areas lie one after the other across the sweep, and nothing is left between them.
            let across = V2::new(-found.direction_rad.sin(), found.direction_rad.cos());
            let mut spans: Vec<[f64; 2]> = found
                .sub_areas
                .iter()
                .filter_map(|s| s.region.as_ref()?.as_polygon())
                .map(|part| extent(part.vertices_m(), across))
                .collect();
            spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
            prop_assert_eq!(spans.len(), weights.len());
            prop_assert!(spans.windows(2).all(|w| (w[1][0] - w[0][1]).abs() < 1e-4), "{:?}", spans);
            let sum_m2: f64 = found.sub_areas.iter().map(|s| s.area_m2).sum();
            prop_assert!((sum_m2 / polygon.area_m2() - 1.0).abs() < 1e-9);
        }
        for s in &found.sub_areas {
            prop_assert!(s.covered_fraction >= 1.0 - 1e-6, "{} of fleet {}", s.covered_fraction, s.fleet);
            let axis = V2::new(s.direction_rad.cos(), s.direction_rad.sin());
            for axis in [axis, V2::new(-axis.y, axis.x)] {
                let [low, high] = extent(polygon.vertices_m(), axis);
                let [from, to] = extent(&s.path_m, axis);
                prop_assert!(low - 1e-6 <= from && to <= high + 1e-6);
            }
            prop_assert!((s.length_m - length_m(&s.path_m)).abs() < 1e-6);
            prop_assert!(s.duration_s >= s.length_m / request.speed_mps - 1e-6);
            if let Some(part) = &s.region {
                let share = part.area_m2() / polygon.area_m2();
                prop_assert!((share / s.proportion - 1.0).abs() < 1e-9, "{} {}", share, s.proportion);
            }
        }
    }

    #[test]
    fn no_way_is_longer_than_plain_lanes(
        polygon in convex(), weights in prop::collection::vec(0.2..1.0f64, 1..6), turn in 0.0..6.3f64,
    ) {
        let total: f64 = weights.iter().sum();
        let mut request = request(weights.len(), SplitMode::Auto);
        request.proportions = weights.iter().map(|w| w / total).collect();
        let plain_m = plain_length_m(&polygon, &request);
        for split in [SplitMode::Auto, SplitMode::Area] {
            request.split = split;
            let found = plan(&polygon, &request).unwrap();
            prop_assert!(found.length_m() <= plain_m + 1e-3, "{} {}", found.length_m(), plain_m);
        }
        // Turned and moved, the same area takes as long, but for how far the search for strips gets.
        let map = |p: V2| nalgebra::Rotation2::new(turn) * p + V2::new(3e4, -2e4);
        let moved = plan(&polygon.moved(map), &request).unwrap();
        let found = plan(&polygon, &request).unwrap();
        let ends_s = [&moved, &found].map(SweepPlan::duration_s);
        prop_assert!((ends_s[0] - ends_s[1]).abs() < 0.02 * ends_s[1] + 1e-3, "{:?}", ends_s);
    }
}

/// Fleets whose sub-areas are a swath high or more stay two triangles and a spacing apart, in either way of sharing.
#[test]
fn fleets_stay_apart() {
    let mut random = uniform();
    let mut least_m = f64::INFINITY;
    for case in 0..200 {
        let polygon = of_kind(case % 5, &mut random);
        let fleets = 2 + case / 5 % 3;
        if polygon.min_width().width_m < 950.0 * fleets as f64 {
            continue;
        }
        for split in [SplitMode::Area, SplitMode::Length] {
            let found = plan(&polygon, &request(fleets, split)).unwrap();
            let apart_m = found.separation_m.unwrap();
            assert!(apart_m >= 107.0, "case {case}, {fleets} fleets, {split:?}: {apart_m} m");
            least_m = least_m.min(apart_m);
        }
    }
    assert!(least_m.is_finite(), "some cases count");
}

/// Length of plain lanes, computed another way: sub-areas by bisection, strips clipped one by one, equal
/// strips along the sweep direction or along the sub-area's own narrowest direction, whichever is shorter.
fn plain_length_m(polygon: &Polygon, request: &SweepRequest) -> f64 {
    let radius_m = request.radius_m - request.spacing_m / 3f64.sqrt();
    let sweep_rad = polygon.min_width().direction_rad;
    let normal = V2::new(-sweep_rad.sin(), sweep_rad.cos());
    let [mut from, top] = extent(polygon.vertices_m(), normal);
    let below_m2 = |h: f64| crate::geometry::polygon::signed_area_m2(&clip(polygon.vertices_m(), normal, h));
    let mut share = 0.0;
    let mut total_m = 0.0;
    for (i, p) in request.proportions.iter().enumerate() {
        share += p;
        let (mut low, mut high) = (from, top);
        for _ in 0..100 {
            let middle = f64::midpoint(low, high);
            if below_m2(middle) < share * polygon.area_m2() { low = middle } else { high = middle }
        }
        let to = if i + 1 == request.proportions.len() { top } else { high };
        let ring = clip(&clip(polygon.vertices_m(), -normal, -from), normal, to);
        let part = Polygon::new(&ring).unwrap();
        let directions = [sweep_rad, part.min_width().direction_rad];
        total_m += directions.map(|d| zigzag_m(&part, d, radius_m)).into_iter().fold(f64::INFINITY, f64::min);
        from = to;
    }
    total_m
}

fn zigzag_m(part: &Polygon, direction_rad: f64, radius_m: f64) -> f64 {
    let along = V2::new(direction_rad.cos(), direction_rad.sin());
    let across = V2::new(-along.y, along.x);
    let [low, high] = extent(part.vertices_m(), across);
    let count = ((high - low) / (2.0 * radius_m) - 1e-9).ceil().max(1.0);
    let height = (high - low) / count;
    let lanes: Vec<[V2; 2]> = (0..count as usize)
        .map(|i| {
            let bottom = low + i as f64 * height;
            let strip = clip(&clip(part.vertices_m(), -across, -bottom), across, bottom + height);
            let y = bottom + height / 2.0;
            let half = |p: &V2| (radius_m.powi(2) - (p.dot(&across) - y).powi(2)).max(0.0).sqrt();
            let west = strip.iter().map(|p| p.dot(&along) + half(p)).fold(f64::INFINITY, f64::min);
            let east = strip.iter().map(|p| p.dot(&along) - half(p)).fold(f64::NEG_INFINITY, f64::max);
            let ends = if west > east {
                let [a, b] = extent(&strip, along);
                let x = f64::midpoint(east.max(a), west.min(b));
                [x, x]
            } else {
                [west, east]
            };
            ends.map(|x| along * x + across * y)
        })
        .collect();
    let way = |odd: usize| -> Vec<V2> {
        lanes
            .iter()
            .enumerate()
            .flat_map(|(i, [w, e])| if i % 2 == odd { [*w, *e] } else { [*e, *w] })
            .collect()
    };
    length_m(&way(0)).min(length_m(&way(1)))
}

/// Numbers in [0, 1), the same in every run.
fn uniform() -> impl FnMut() -> f64 {
    let mut state = 1_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A convex area of a kind: 0 triangle, 1 sliver, 2 12-gon, 3 parallelogram, 4 rectangle.
fn of_kind(kind: usize, random: &mut impl FnMut() -> f64) -> Polygon {
    let size_m = 1000.0 * 20f64.powf(random());
    let turn = nalgebra::Rotation2::new(random() * PI);
    let points: Vec<V2> = match kind {
        0 => (0..3).map(|_| V2::new(random(), random()) * size_m).collect(),
        1 => {
            let height = 0.02 + 0.08 * random();
            [[0.0, 0.0], [1.0, 0.1 * height], [0.9, height], [0.2, 0.8 * height]]
                .map(|p| V2::from(p) * size_m)
                .to_vec()
        }
        2 => (0..12)
            .map(|k| {
                let t = (f64::from(k) + 0.8 * random()) * PI / 6.0;
                V2::new(t.cos(), (0.4 + 0.6 * random().powi(0)) * t.sin()) * (size_m / 2.0)
            })
            .collect(),
        3 => {
            let (lean, height) = (random() - 0.5, 0.2 + 0.8 * random());
            [[0.0, 0.0], [1.0, 0.0], [1.0 + lean, height], [lean, height]]
                .map(|p| V2::from(p) * size_m)
                .to_vec()
        }
        _ => {
            let height = 0.1 + 0.9 * random();
            [[0.0, 0.0], [1.0, 0.0], [1.0, height], [0.0, height]].map(|p| V2::from(p) * size_m).to_vec()
        }
    };
    Polygon::new(&points.into_iter().map(|p| turn * p).collect::<Vec<_>>()).unwrap()
}

#[test]
fn ways_are_shorter_than_plain_lanes_on_average() {
    let mut random = uniform();
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for case in 0..500 {
        let polygon = of_kind(case % 5, &mut random);
        let fleets = 1 + case / 5 % 5;
        let weights: Vec<f64> =
            (0..fleets).map(|_| if case % 2 == 0 { 1.0 } else { 0.3 + random() }).collect();
        let total: f64 = weights.iter().sum();
        let mut request = request(fleets, SplitMode::Auto);
        request.proportions = weights.iter().map(|w| w / total).collect();
        let plain_m = plain_length_m(&polygon, &request);
        if plain_m < 1.0 {
            continue; // one position covers it
        }
        for (sum, split) in sums.iter_mut().zip([SplitMode::Auto, SplitMode::Area]) {
            request.split = split;
            let found = plan(&polygon, &request).unwrap();
            assert!(
                found.length_m() <= plain_m * (1.0 + 1e-9),
                "case {case}: {} {plain_m}",
                found.length_m()
            );
            *sum += found.length_m() / plain_m;
        }
        count += 1.0;
    }
    let [auto, area] = sums.map(|sum| sum / count);
    println!("mean length over plain lanes': auto {auto:.4}, by area {area:.4}, {count} cases");
    assert!(auto < 0.96, "{auto}");
}
