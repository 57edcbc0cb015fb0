//! Truth tests against the paper's square, and laws that hold for any convex area.

use std::f64::consts::PI;

use proptest::prelude::*;

use super::*;

fn plan(polygon: &Polygon, request: &SweepRequest) -> Result<SweepPlan, SweepError> {
    super::plan(&Region::from(polygon.clone()), request)
}

fn request(fleets: usize, split: SplitMode) -> SweepRequest {
    SweepRequest {
        fleets,
        proportions: vec![1.0 / fleets as f64; fleets],
        split,
        radius_m: 500.0,
        spacing_m: 50.0,
        speed_mps: 10.0,
        corner: CornerModel { max_accel_mps2: 3.0, corner_speed_mps: 10.0 },
        margin_m: 0.0,
        entry_m: None,
    }
}

fn rectangle(width_m: f64, height_m: f64) -> Polygon {
    let corners = [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]];
    Polygon::new(&corners.map(|[x, y]| V2::new(x, y))).unwrap()
}

#[test]
fn truth_paper_square_by_area() {
    let plan = plan(&rectangle(10_000.0, 10_000.0), &request(2, SplitMode::Area)).unwrap();
    assert!((plan.swath_m - 942.26).abs() < 0.01);
    assert!((plan.width_m - 10_000.0).abs() < 1e-9 && plan.direction_rad.abs() < 1e-12);
    for s in &plan.sub_areas {
        assert!((s.length_m - 61_528.0).abs() < 1.0, "{} m", s.length_m);
        assert!((s.duration_s / 60.0 - 102.55).abs() < 0.01);
        assert_eq!((s.turns, s.path_m.len()), (5, 12));
        assert!((s.polygon.as_ref().unwrap().area_m2() / 5e7 - 1.0).abs() < 1e-9);
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
    let small = plan(&rectangle(900.0, 800.0), &request(1, SplitMode::Auto)).unwrap_err().to_string();
    assert_eq!(
        small,
        "the area measures 900.0 m by 800.0 m, expected more than one swath of 942.3 m in at least one direction"
    );
    let l = [[0.0, 0.0], [9e3, 0.0], [9e3, 3e3], [3e3, 3e3], [3e3, 9e3], [0.0, 9e3]];
    let l = Polygon::new(&l.map(|[x, y]| V2::new(x, y))).unwrap();
    let found = plan(&l, &request(1, SplitMode::Auto)).unwrap_err();
    assert_eq!(found, SweepError::NotConvex { x_m: 3e3, y_m: 3e3 });
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
        let found = match plan(&polygon, &request) {
            Ok(found) => found,
            Err(SweepError::AreaTooSmall { length_m, width_m, swath_m }) => {
                prop_assert!(length_m < swath_m && width_m < swath_m);
                return Ok(());
            }
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        prop_assert!(found.covered_fraction >= 1.0 - 1e-6, "{}", found.covered_fraction);
        let axis = V2::new(found.direction_rad.cos(), found.direction_rad.sin());
        for s in &found.sub_areas {
            prop_assert!(s.covered_fraction >= 1.0 - 1e-6, "{} of fleet {}", s.covered_fraction, s.fleet);
            for axis in [axis, V2::new(-axis.y, axis.x)] {
                let [low, high] = extent(polygon.vertices_m(), axis);
                let [from, to] = extent(&s.path_m, axis);
                prop_assert!(low - 1e-6 <= from && to <= high + 1e-6);
            }
            prop_assert!((s.length_m - length_m(&s.path_m)).abs() < 1e-6);
            prop_assert!(s.duration_s >= s.length_m / request.speed_mps - 1e-6);
            if let Some(part) = &s.polygon {
                let share = part.area_m2() / polygon.area_m2();
                prop_assert!((share / s.proportion - 1.0).abs() < 1e-9, "{} {}", share, s.proportion);
            }
        }
    }

    #[test]
    fn auto_is_never_slower(polygon in convex(), fleets in 1usize..4) {
        let times = [SplitMode::Auto, SplitMode::Area, SplitMode::Length]
            .map(|split| plan(&polygon, &request(fleets, split)).map(|p| p.duration_s()));
        if let [Ok(auto), Ok(area), Ok(length)] = times {
            prop_assert!(auto <= area.min(length) * (1.0 + 1e-9));
        }
    }
}
