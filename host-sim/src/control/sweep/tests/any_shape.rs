//! Laws that hold for areas of any shape with no-fly zones, and what cannot be swept.

use proptest::prelude::*;

use super::{rectangle, request};
use crate::control::sweep::{SplitMode, SweepError, SweepPlan, plan};
use crate::geometry::V2;
use crate::geometry::coverage::Stadium;
use crate::geometry::polygon::Polygon;
use crate::geometry::region::Region;

fn box_between(west: f64, south: f64, east: f64, north: f64) -> Polygon {
    let corners = [[west, south], [east, south], [east, north], [west, north]];
    Polygon::new(&corners.map(V2::from)).unwrap()
}

fn ring(points: &[[f64; 2]]) -> Polygon {
    Polygon::new(&points.iter().map(|&p| V2::from(p)).collect::<Vec<_>>()).unwrap()
}

/// Least distance of all ways from a zone.
fn least_clearance_m(found: &SweepPlan, zones: &[Polygon]) -> f64 {
    let legs = found.sub_areas.iter().flat_map(|s| {
        let ends = if s.path_m.len() == 1 { vec![s.path_m[0]; 2] } else { s.path_m.clone() };
        ends.windows(2).map(|w| [w[0], w[1]]).collect::<Vec<_>>()
    });
    legs.flat_map(|leg| zones.iter().map(move |zone| distance_m(leg, zone))).fold(f64::INFINITY, f64::min)
}

/// Distance of a leg from a polygon, zero where they meet: some end of the leg or of an edge is nearest.
fn distance_m([a, b]: [V2; 2], polygon: &Polygon) -> f64 {
    let leg = Stadium { a, b, radius_m: 0.0 };
    if polygon.contains(a) {
        return 0.0;
    }
    let from_edges = polygon.edges_m().flat_map(|(p, q)| {
        let edge = Stadium { a: p, b: q, radius_m: 0.0 };
        let side = |u: V2, v: V2, w: V2| crate::geometry::cross(v - u, w - u);
        let crosses = side(a, b, p) * side(a, b, q) < 0.0 && side(p, q, a) * side(p, q, b) < 0.0;
        [
            if crosses { 0.0 } else { f64::INFINITY },
            edge.axis_distance_m(a),
            edge.axis_distance_m(b),
            leg.axis_distance_m(p),
        ]
    });
    from_edges.fold(f64::INFINITY, f64::min)
}

/// Clearance that a fleet of 50 m keeps for certain: the radius of its triangle.
const TRIANGLE_M: f64 = 28.87;

fn assert_swept(region: &Region, found: &SweepPlan) {
    assert!(found.covered_fraction >= 1.0 - 1e-6, "{}", found.covered_fraction);
    for s in &found.sub_areas {
        assert!(s.covered_fraction >= 1.0 - 1e-6, "{} of fleet {}", s.covered_fraction, s.fleet);
    }
    let clearance_m = least_clearance_m(found, region.no_fly());
    assert!(clearance_m >= TRIANGLE_M, "{clearance_m} m");
}

#[test]
fn shapes_that_are_not_convex_are_swept() {
    let l = ring(&[[0.0, 0.0], [9e3, 0.0], [9e3, 3e3], [3e3, 3e3], [3e3, 9e3], [0.0, 9e3]]);
    let u = ring(&[
        [0.0, 0.0],
        [9e3, 0.0],
        [9e3, 8e3],
        [6e3, 8e3],
        [6e3, 3e3],
        [3e3, 3e3],
        [3e3, 8e3],
        [0.0, 8e3],
    ]);
    let comb: Vec<[f64; 2]> = (0..6)
        .flat_map(|k| {
            let x = f64::from(k) * 1500.0;
            [[x, 5000.0], [x + 700.0, 5000.0], [x + 750.0, 600.0], [x + 1450.0, 600.0]]
        })
        .chain([[9000.0, 5000.0], [9600.0, 5000.0], [9600.0, 0.0], [0.0, 0.0]])
        .collect();
    for shape in [l, u, ring(&comb)] {
        let region = Region::from(shape);
        for split in [SplitMode::Area, SplitMode::Length, SplitMode::Auto] {
            for fleets in [1, 2, 3] {
                let found = plan(&region, &request(fleets, split)).unwrap();
                assert_swept(&region, &found);
                // Area over swath, and a half more for what borders and changes cost.
                let bound_m = 1.5 * region.area_m2() / found.swath_m + 6e3 * fleets as f64;
                assert!(found.length_m() < bound_m, "{} {bound_m} {fleets} {split:?}", found.length_m());
            }
        }
    }
}

#[test]
fn zones_are_flown_around() {
    let zones = vec![
        box_between(2e3, 2e3, 5e3, 4e3),
        ring(&[[7e3, 5e3], [8e3, 7e3], [6.5e3, 8e3]]),
        box_between(4e3, 7e3, 4.05e3, 7.05e3),
        box_between(-1e3, 5.9e3, 2e3, 6e3),
    ];
    let region = Region::new(vec![rectangle(10e3, 10e3)], zones).unwrap();
    for split in [SplitMode::Area, SplitMode::Length] {
        for fleets in [1, 2, 4] {
            let found = plan(&region, &request(fleets, split)).unwrap();
            assert_swept(&region, &found);
            for s in found.sub_areas.iter().filter(|_| split == SplitMode::Area) {
                assert!((s.area_m2 * fleets as f64 / region.area_m2() - 1.0).abs() < 1e-9, "{}", s.area_m2);
            }
        }
    }
}

#[test]
fn the_way_to_the_lanes_keeps_out_of_zones() {
    let wall = box_between(-5e3, -600.0, 9e3, -400.0);
    let region = Region::new(vec![rectangle(10e3, 10e3)], vec![wall]).unwrap();
    let mut request = request(1, SplitMode::Area);
    let entry_m = V2::new(0.0, -2e3);
    request.entry_m = Some(vec![entry_m]);
    let found = plan(&region, &request).unwrap();
    let sub = &found.sub_areas[0];
    let ways = [vec![entry_m], sub.approach_m.clone(), sub.path_m.clone()].concat();
    let legs = ways.windows(2).map(|w| distance_m([w[0], w[1]], &region.no_fly()[0]));
    assert!(!sub.approach_m.is_empty() && legs.fold(f64::INFINITY, f64::min) >= TRIANGLE_M);
    request.entry_m = Some(vec![V2::new(0.0, -500.0)]);
    assert_eq!(plan(&region, &request), Err(SweepError::NoApproach { fleet: 0 }));
}

#[test]
fn parts_far_from_each_other_are_all_swept() {
    let parts = vec![
        box_between(0.0, 0.0, 3e3, 2e3),
        box_between(6e3, 5e3, 8e3, 9e3),
        box_between(0.0, 9e3, 500.0, 9.4e3),
    ];
    let region = Region::new(parts, vec![]).unwrap();
    for split in [SplitMode::Area, SplitMode::Length] {
        assert_swept(&region, &plan(&region, &request(2, split)).unwrap());
    }
}

#[test]
fn a_piece_behind_a_wall_is_covered_from_outside_or_refused() {
    let walled = |size: f64| {
        let (from, to) = (5e3 - size / 2.0, 5e3 + size / 2.0);
        let walls = vec![
            box_between(from, from, to, from + 20.0),
            box_between(from, to - 20.0, to, to),
            box_between(from, from, from + 20.0, to),
            box_between(to - 20.0, from, to, to),
        ];
        Region::new(vec![rectangle(10e3, 10e3)], walls).unwrap()
    };
    let small = walled(600.0);
    assert_swept(&small, &plan(&small, &request(1, SplitMode::Length)).unwrap());
    let found = plan(&walled(2000.0), &request(1, SplitMode::Length)).unwrap_err();
    let SweepError::Unreachable { x_m, y_m, .. } = found else { panic!("{found}") };
    assert!((4e3..6e3).contains(&x_m) && (4e3..6e3).contains(&y_m), "({x_m}, {y_m})");
}

#[test]
fn more_pieces_than_can_be_ordered_are_refused() {
    let region = Region::new(vec![rectangle(200e3, 200e3)], vec![box_between(1e3, 1e3, 2e3, 2e3)]).unwrap();
    let mut narrow = request(1, SplitMode::Auto);
    narrow.radius_m = 130.0;
    let found = plan(&region, &narrow).unwrap_err();
    assert!(matches!(found, SweepError::TooManyPieces { .. }), "{found}");
}

/// Star-shaped areas of 4 to 30 vertices with boxes as zones.
fn any_region() -> impl Strategy<Value = Region> {
    let radii = prop::collection::vec(0.25..1.0f64, 4..30);
    let zones = prop::collection::vec((-0.9..0.9f64, -0.9..0.9f64, 0.01..0.3f64, 0.01..0.3f64), 0..4);
    (radii, zones, 1_000.0..8_000.0f64).prop_filter_map("no area", |(radii, zones, size_m)| {
        let step = std::f64::consts::TAU / radii.len() as f64;
        let corners: Vec<V2> = radii
            .iter()
            .enumerate()
            .map(|(k, r)| V2::new((k as f64 * step).cos(), (k as f64 * step).sin()) * (r * size_m))
            .collect();
        let zones = zones
            .iter()
            .map(|&(x, y, w, h)| box_between(x * size_m, y * size_m, (x + w) * size_m, (y + h) * size_m));
        Region::new(vec![Polygon::new(&corners).ok()?], zones.collect()).ok()
    })
}

proptest! {
    // No more areas may be refused than are swept.
    #![proptest_config(ProptestConfig { cases: 60, max_global_rejects: 60, ..ProptestConfig::default() })]

    #[test]
    fn any_area_is_covered_and_no_zone_entered(
        region in any_region(), weights in prop::collection::vec(0.3..1.0f64, 1..4),
        split in prop_oneof![Just(SplitMode::Area), Just(SplitMode::Length)],
        margin_m in prop_oneof![Just(0.0), 0.0..30.0f64],
    ) {
        let total: f64 = weights.iter().sum();
        let mut request = request(weights.len(), split);
        request.proportions = weights.iter().map(|w| w / total).collect();
        request.margin_m = margin_m;
        let found = match plan(&region, &request) {
            Ok(found) => found,
            // Zones of up to 2.4 km that overlap may enclose a piece.
            Err(why @ SweepError::Unreachable { .. }) => return Err(TestCaseError::reject(why.to_string())),
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        prop_assert!(found.covered_fraction >= 1.0 - 1e-6, "{}", found.covered_fraction);
        let clearance_m = least_clearance_m(&found, region.no_fly());
        prop_assert!(clearance_m >= TRIANGLE_M + margin_m, "{} m", clearance_m);
        for s in &found.sub_areas {
            prop_assert!(s.covered_fraction >= 1.0 - 1e-6, "{} of fleet {}", s.covered_fraction, s.fleet);
            if let Some(part) = &s.region {
                let share = part.area_m2() / region.area_m2();
                prop_assert!((share / s.proportion - 1.0).abs() < 1e-9, "{} {}", share, s.proportion);
            }
        }
    }
}
