//! What a report says of users and clocks that are hard to come by from outside.

use std::path::Path;

use serde_json::Value;

use super::*;
use crate::world::users::parse_users;

fn user(id: &str, status: FixStatus, position: Option<Position>) -> LocatedUser {
    LocatedUser { id: id.to_owned(), status, position, occasions: 60, captures: 170, rejected: 9 }
}

fn position(x_m: f64, y_m: f64, [xx, xy, yy]: [f64; 3]) -> Option<Position> {
    let cov_m2 = [[xx, xy], [xy, yy]];
    Some(Position { pos_m: [x_m, y_m], cov_m2, r95_m: crate::control::localize::r95(cov_m2) })
}

fn example() -> LocateReport {
    let users = vec![
        user("a<b>&\"c\"", FixStatus::Ok, position(100.0, -20.0, [9.0, 2.0, 16.0])),
        user("u2", FixStatus::Ok, position(-900.0, 400.0, [4.0, 0.0, 4.0])),
        user("u10", FixStatus::Ambiguous, position(300.0, 10.0, [9.0, 0.0, 900.0])),
        user("u11", FixStatus::PoorGeometry, position(310.0, 10.0, [9e4, 0.0, 9e4])),
        user("u12", FixStatus::Inconsistent, position(0.0, 0.0, [1.0, 0.0, 1.0])),
        user("u13", FixStatus::NotLocated, None),
    ];
    LocateReport {
        source: "field/day 1.csv".to_owned(),
        config: LocalizeConfig {
            clock: ClockModel::SharedWander {
                offset_sigma_ns: 1e5,
                drift_sigma_ns_per_s: 1e5,
                walk_ns_per_sqrt_s: 0.0,
            },
            ..LocalizeConfig::default()
        },
        frame: Some(LocalFrame::new(179.99, -16.5)),
        users,
        drones: vec![
            DroneClock { id: "north".to_owned(), line: Some([0.0; 2]) },
            DroneClock { id: "2".to_owned(), line: Some([-1.7e18, 0.25]) },
            DroneClock { id: "3".to_owned(), line: None },
        ],
        reference_epoch_s: 1_700_000_000.25,
        epochs_s: [1_700_000_000.0, 1_700_000_100.0],
        occasions: 300,
        captures: 850,
        track_m: vec![V2::new(-950.0, 300.0), V2::new(950.0, 300.0)],
        warnings: vec!["3 rows repeat".to_owned()],
    }
}

#[test]
fn text_shows_all_of_a_few_and_the_worst_of_many() {
    let mut report = example();
    insta::assert_snapshot!("few_users", report);
    report.users.extend((0..30).map(|k| {
        let variance_m2 = f64::from(k + 1);
        user(&format!("v{k}"), FixStatus::Ok, position(0.0, 0.0, [variance_m2, 0.0, variance_m2]))
    }));
    report.config.clock = ClockModel::Synchronised;
    insta::assert_snapshot!("many_users", report);
}

#[test]
fn json_is_one_object_with_a_line_for_each_user() {
    let text = example().to_json();
    assert_eq!(text.lines().filter(|line| line.starts_with("{\"id\":")).count(), 6);
    let json: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["users"][0]["id"], "a<b>&\"c\"");
    assert_eq!(json["users"][5]["x_m"], Value::Null);
    assert_eq!(json["clock"]["offset_ns"], serde_json::json!({ "north": 0.0, "2": -1.7e18, "3": null }));
    assert_eq!(json["summary"]["statuses"]["poor_geometry"], 1);
    assert!(text.find("\"north\":") < text.find("\"2\":"), "drones stand in order");
}

#[test]
fn tables_are_read_again_and_only_the_located_go_on() {
    let report = example();
    insta::assert_snapshot!(report.to_users_csv());
    let located = report.to_located_csv();
    insta::assert_snapshot!(located);
    let users = parse_users(located.as_bytes(), Path::new("located.csv")).unwrap();
    let ids: Vec<&str> = users.iter().map(|user| user.id.as_str()).collect();
    assert_eq!(ids, ["a<b>&\"c\"", "u2"]);
    // Radii round up.
    let r95_m = report.users[0].position.unwrap().r95_m;
    let written: f64 = located.lines().nth(1).unwrap().rsplit(',').next().unwrap().parse().unwrap();
    assert!(r95_m <= written && written < r95_m + 1e-3);
}

#[test]
fn geojson_has_points_ellipses_and_no_place_for_the_lost() {
    let text = example().to_geojson().unwrap();
    let collection: Value = serde_json::from_str(&text).unwrap();
    let features = collection["features"].as_array().unwrap();
    let kinds: Vec<(&str, &str)> = features
        .iter()
        .map(|f| {
            (f["properties"]["kind"].as_str().unwrap(), f["geometry"]["type"].as_str().unwrap_or("none"))
        })
        .collect();
    assert_eq!(
        kinds,
        [
            ("user", "Point"),
            ("ellipse", "Polygon"),
            ("user", "Point"),
            ("ellipse", "Polygon"),
            ("user", "Point"),
            ("user", "Point"),
            ("user", "Point"),
            ("user", "none")
        ]
    );
    // The date line is 1,067 m east of the origin.
    let lon = |feature: usize| features[feature]["geometry"]["coordinates"][0].as_f64().unwrap();
    assert!(lon(0) > 179.99 && lon(0) <= 180.0 && lon(2) < 179.99);
    let mut beyond = example();
    beyond.users[0].position = position(1066.0, 0.0, [100.0, 0.0, 100.0]);
    let collection: Value = serde_json::from_str(&beyond.to_geojson().unwrap()).unwrap();
    assert_eq!(collection["features"][1]["geometry"]["type"], "MultiPolygon");
    assert!(LocateReport { frame: None, ..example() }.to_geojson().is_none());
}

#[test]
fn truth_ellipses_hold_95_percent() {
    for [xx, xy, yy] in [[9.0, 2.0, 16.0], [4.0, 0.0, 4.0], [25.0, -24.9, 25.0], [1.0, 0.0, 1e-9]] {
        let at = position(5.0, -7.0, [xx, xy, yy]).unwrap();
        let det = xx * yy - xy * xy;
        for corner_m in at.ellipse_m(36) {
            let e = corner_m - V2::from(at.pos_m);
            let distance2 = (yy * e.x * e.x - 2.0 * xy * e.x * e.y + xx * e.y * e.y) / det;
            // -2 ln 0.05
            assert!((distance2 - 5.991_464_547).abs() < 1e-6, "{distance2}");
        }
    }
}

#[test]
fn a_map_shows_everyone_and_reads_no_name_as_markup() {
    let svg = example().to_svg();
    let document = roxmltree::Document::parse(&svg).unwrap();
    let count = |class: &str| {
        document
            .descendants()
            .filter(|n| n.attribute("class").is_some_and(|c| c.split(' ').any(|c| c == class)))
            .count()
    };
    // One of each is the legend's; the user who is not located is only there.
    assert_eq!((count("ellipse"), count("track"), count("name")), (3, 2, 5));
    let statuses = ["ok", "ambiguous", "poor_geometry", "inconsistent", "not_located"];
    assert_eq!(statuses.map(count), [2, 2, 2, 2, 1]);
    let title = document.descendants().find(|n| n.has_tag_name("title")).unwrap();
    assert_eq!(title.text(), Some("Users located from day 1.csv"));
    assert!(!svg.contains("NaN") && !svg.contains("inf "), "{svg}");
    let nobody = LocateReport { users: Vec::new(), track_m: Vec::new(), ..example() };
    assert!(roxmltree::Document::parse(&nobody.to_svg()).is_ok());
}
