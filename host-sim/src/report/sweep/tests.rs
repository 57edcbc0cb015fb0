//! What a report says of plans that are hard to come by from outside: with zones, and with gaps.

use super::*;
use crate::control::sweep;
use crate::geometry::frame::LocalFrame;
use crate::geometry::polygon::Polygon;
use crate::geometry::region::Region;
use crate::runner::formation;

fn rectangle(west: f64, south: f64, east: f64, north: f64) -> Polygon {
    let corners = [[west, south], [east, south], [east, north], [west, north]];
    Polygon::new(&corners.map(V2::from)).unwrap()
}

/// The lanes of a square, with a gap declared and a zone put down after they were laid.
fn example(zone: Polygon) -> SweepReport {
    let square = rectangle(0.0, 0.0, 5000.0, 5000.0);
    let open = Region::from(square.clone());
    let pads = Pads::new(Some(V2::new(-300.0, 100.0)), 150.0, &open);
    let request = SweepRequest {
        fleets: 2,
        proportions: vec![0.5; 2],
        split: SplitMode::Area,
        radius_m: 500.0,
        spacing_m: 50.0,
        speed_mps: 10.0,
        corner: formation::corners(10.0),
        margin_m: 0.0,
        entry_m: Some((0..2).map(|fleet| pads.centre_m(fleet)).collect()),
    };
    let mut plan = sweep::plan(&open, &request).unwrap();
    plan.covered_fraction = 0.999;
    plan.residue_m = vec![rectangle(2000.0, 4500.0, 2100.0, 4750.0).vertices_m().to_vec()];
    let modes = vec![
        ModeTried { split: SplitMode::Area, figures: Ok((&plan).into()) },
        ModeTried { split: SplitMode::Length, figures: Err("there is a zone in the way".to_owned()) },
    ];
    let area = Area {
        region: Region::new(vec![square], vec![zone]).unwrap(),
        frame: Some(LocalFrame::new(13.7, 51.0)),
        left_out: vec!["a point".to_owned()],
    };
    SweepReport {
        area_name: "a<b>&c\u{7}.geojson".to_owned(),
        area,
        request,
        pads,
        altitude_m: 300.0,
        link: None,
        mission_time_s: 1500.0,
        plan,
        modes,
    }
}

/// Between two lanes of either fleet, beside the ways home.
fn harmless() -> Polygon {
    rectangle(2400.0, 750.0, 2500.0, 850.0)
}

#[test]
fn text_tells_what_is_missing() {
    insta::assert_snapshot!(example(harmless()));
}

#[test]
fn a_map_shows_zones_and_gaps_and_reads_no_name_as_markup() {
    let svg = example(harmless()).to_svg();
    let document = roxmltree::Document::parse(&svg).unwrap();
    let count = |class: &str| {
        document
            .descendants()
            .filter(|n| n.attribute("class").is_some_and(|c| c.split(' ').any(|c| c == class)))
            .count()
    };
    assert_eq!((count("zone"), count("uncovered"), count("tint")), (2, 2, 2), "one each is the legend's");
    assert_eq!(
        document.descendants().find(|n| n.has_tag_name("title")).unwrap().text(),
        Some("Sweep of a<b>&c.geojson")
    );
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
}

#[test]
fn json_and_geojson_name_zones_and_gaps() {
    let report = example(harmless());
    let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
    assert_eq!(json["no_fly_m"].as_array().unwrap().len(), 1);
    assert_eq!(json["residue_m"][0].as_array().unwrap().len(), 4);
    assert_eq!(json["modes"][1]["refused"], "there is a zone in the way");
    let geojson: serde_json::Value = serde_json::from_str(&report.to_geojson().unwrap()).unwrap();
    let kinds: Vec<_> =
        geojson["features"].as_array().unwrap().iter().map(|f| &f["properties"]["kind"]).collect();
    assert_eq!(kinds[kinds.len() - 2..], ["no_fly", "uncovered"]);
}

#[test]
fn a_sub_area_that_is_not_one_ring_has_its_rings() {
    let mut report = example(harmless());
    let hole = rectangle(100.0, 100.0, 200.0, 200.0);
    report.plan.sub_areas[0].region =
        Some(Region::new(vec![rectangle(0.0, 0.0, 900.0, 900.0)], vec![hole]).unwrap());
    let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
    assert!(json["sub_areas"][0]["polygon_m"].is_null());
    let rings: Vec<Vec<Vec<[f64; 2]>>> =
        serde_json::from_value(json["sub_areas"][0]["polygons_m"].clone()).unwrap();
    assert_eq!(rings.iter().map(Vec::len).collect::<Vec<_>>(), [2]);
}

#[test]
fn no_plan_leads_through_a_zone() {
    let plans = example(harmless()).flight_plans().unwrap().unwrap();
    assert_eq!(plans.len(), 6);
    let plan: serde_json::Value = serde_json::from_str(&plans[0].1).unwrap();
    let inclusions: Vec<_> = plan["geoFence"]["polygons"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| p["inclusion"].as_bool().unwrap())
        .collect();
    assert_eq!(inclusions, [true, false]);
    // A wall across the lanes, one around the base, one on the way home.
    let report = example(rectangle(1000.0, -100.0, 1010.0, 5100.0));
    assert_eq!(report.flight_plans().unwrap_err().leg, "on its lanes");
    let report = example(rectangle(-400.0, 0.0, 0.0, 200.0));
    assert_eq!(report.flight_plans().unwrap_err().leg, "on its way to the first lane");
    let report = example(rectangle(2440.0, 1120.0, 2450.0, 1180.0));
    assert_eq!(report.flight_plans().unwrap_err().leg, "on its way home");
}
