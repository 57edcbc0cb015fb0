//! `skyroost sweep` as an operator and a script see it: exit status, stdout, stderr and files.

mod support;

use std::fs;
use std::process::Command;

use serde_json::Value;
use support::Bench;

const SQUARE: &str = "x_m,y_m\n0,0\n10000,0\n10000,10000\n0,10000\n";
/// At the Elbe, some 55 km2.
const TOWN: &str = r#"{"type":"Polygon","coordinates":[[[13.70,51.05],[13.80,51.04],[13.85,51.09],[13.75,51.12],[13.70,51.05]]]}"#;
/// The 180th meridian runs through it.
const DATE_LINE: &str = r#"{"type":"Polygon","coordinates":[[[179.93,-16.55],[-179.93,-16.52],[-179.95,-16.41],[179.95,-16.44],[179.93,-16.55]]]}"#;
/// An L with two holes.
const HOLES: &str = r#"{"type":"Polygon","coordinates":[
    [[13.70,51.00],[13.78,51.00],[13.78,51.025],[13.735,51.025],[13.735,51.05],[13.70,51.05],[13.70,51.00]],
    [[13.715,51.010],[13.715,51.015],[13.725,51.015],[13.725,51.010],[13.715,51.010]],
    [[13.701,51.003],[13.701,51.004],[13.712,51.004],[13.712,51.003],[13.701,51.003]]]}"#;

fn bench() -> Bench {
    let bench = Bench::of("sweep").file("square.csv", SQUARE).file("town.geojson", TOWN);
    bench.file("line.geojson", DATE_LINE).file("holes.geojson", HOLES)
}

fn json(bench: &Bench, args: &[&str]) -> Value {
    let ran = bench.run(&[&["sweep", "--json"], args].concat());
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""), "{args:?}");
    serde_json::from_str(&ran.stdout).expect("one JSON object and nothing else")
}

#[test]
fn help_shows_every_option_and_examples() {
    let ran = bench().run(&["sweep", "--help"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn the_summary_says_which_way_of_sharing_meets_the_time() {
    let ran = bench().run(&["sweep", "--area", "square.csv", "--fleets", "2"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn json_has_the_keys_that_scripts_rely_on() {
    let bench = bench();
    let length = json(&bench, &["--area", "square.csv", "--fleets", "2"]);
    assert_eq!(length["origin"], Value::Null);
    assert_eq!(length["split"], "length");
    assert_eq!((length["sweep_direction_rad"].as_f64(), length["width_m"].as_f64()), (Some(0.0), Some(1e4)));
    assert!((length["swath_m"].as_f64().unwrap() - 942.265).abs() < 1e-3);
    let area = json(&bench, &["--area", "square.csv", "--fleets", "2", "--split", "area"]);
    for (plan, most_m) in [(&length, 58_200.0), (&area, 61_530.0)] {
        let fleets = plan["sub_areas"].as_array().unwrap();
        assert_eq!(fleets.len(), 2);
        for (index, fleet) in fleets.iter().enumerate() {
            assert_eq!(fleet["fleet"], index);
            assert_eq!(fleet["proportion"], 0.5);
            assert_eq!(fleet["covered_fraction"], 1.0);
            assert!(fleet["length_m"].as_f64().unwrap() <= most_m);
            let path_m: Vec<[f64; 2]> = serde_json::from_value(fleet["path_m"].clone()).unwrap();
            assert!(path_m.len() as u64 > 2 * fleet["turns"].as_u64().unwrap());
            let polygon_m: Option<Vec<[f64; 2]>> =
                serde_json::from_value(fleet["polygon_m"].clone()).unwrap();
            assert_eq!(polygon_m.map(|ring| ring.len()), (plan["split"] == "area").then_some(4));
            assert!(fleet.get("polygons_m").is_none());
        }
    }
    let modes = length["modes"].as_array().unwrap();
    let verdicts: Vec<_> = modes.iter().map(|mode| (&mode["split"], &mode["meets_mission_time"])).collect();
    assert_eq!(verdicts, [(&"area".into(), &false.into()), (&"length".into(), &true.into())]);
    assert_eq!((&length["meets_mission_time"], &area["meets_mission_time"]), (&true.into(), &false.into()));
    let town = json(&bench, &["--area", "town.geojson", "--fleets", "1"]);
    for (key, middle_deg) in [("lon_deg", 13.775), ("lat_deg", 51.08)] {
        assert!((town["origin"][key].as_f64().unwrap() - middle_deg).abs() < 1e-9, "{key}");
    }
}

#[test]
fn proportions_base_and_margin_do_what_they_say() {
    let bench = bench();
    let town = ["--area", "town.geojson", "--fleets", "2", "--split", "area"];
    let uneven = json(&bench, &[&town[..], &["--proportions", "0.7,0.3"]].concat());
    let share = |fleet: usize| uneven["sub_areas"][fleet]["area_m2"].as_f64().unwrap();
    assert!((share(0) / (share(0) + share(1)) - 0.7).abs() < 1e-9);
    let here = json(&bench, &[&town[..], &["--base-m", "-500,250.5"]].concat());
    assert_eq!(here["sub_areas"][0]["pad_m"], serde_json::json!([-500.0, 250.5]));
    let origin = json(&bench, &[&town[..], &["--base-lon-lat", "13.775,51.08"]].concat());
    assert!(
        origin["sub_areas"][0]["pad_m"].as_array().unwrap().iter().all(|x| x.as_f64().unwrap().abs() < 1e-6)
    );
    let narrow = json(&bench, &[&town[..], &["--margin-m", "150"]].concat());
    assert!(narrow["length_m"].as_f64() > origin["length_m"].as_f64());
    assert_eq!(narrow["swath_m"], origin["swath_m"]);
}

#[test]
fn an_area_smaller_than_a_swath_is_covered_from_one_place() {
    let bench = bench().file("yard.csv", "x_m,y_m\n0,0\n100,0\n100,100\n0,100\n");
    let yard = json(&bench, &["--area", "yard.csv", "--fleets", "1"]);
    assert_eq!((&yard["covered_fraction"], &yard["sub_areas"][0]["turns"]), (&1.0.into(), &0.into()));
    assert!(yard["length_m"].as_f64().unwrap() < 100.0);
}

#[test]
fn a_link_gives_radius_and_altitude() {
    let bench = bench();
    let link =
        ["--area", "square.csv", "--fleets", "2", "--environment", "dense-urban", "--max-path-loss-db"];
    let best = json(&bench, &[&link[..], &["101"]].concat());
    let (radius_m, altitude_m) = (best["radius_m"].as_f64().unwrap(), best["altitude_m"].as_f64().unwrap());
    assert!(((altitude_m / radius_m).atan().to_degrees() - 54.62).abs() < 0.01);
    let lower = json(&bench, &[&link[..], &["101", "--altitude-m", "300"]].concat());
    assert_eq!(lower["altitude_m"], 300.0);
    assert!(lower["radius_m"].as_f64().unwrap() < radius_m);
    let higher_band = json(&bench, &[&link[..], &["101", "--frequency-mhz", "3000"]].concat());
    assert!((higher_band["radius_m"].as_f64().unwrap() * 1.5 / radius_m - 1.0).abs() < 1e-9);
}

#[test]
fn bad_input_is_refused_by_name_and_leaves_nothing() {
    let bench = bench()
        .file("bow.csv", "x_m,y_m\n0,0\n5000,5000\n5000,0\n0,5000\n")
        .file("two.csv", "x_m,y_m\n0,0\n5000,5000\n");
    let square = ["--area", "square.csv", "--fleets", "2", "--out", "out"];
    for (more, told) in [
        (&["--radius-m", "-1"][..], &["--radius-m", "-1", "above 0"][..]),
        (&["--radius-m", "nan"], &["--radius-m", "nan"]),
        (&["--radius-m", "25"], &["--radius-m", "--spacing-m", "swath"]),
        (&["--radius-m", "29"], &["--radius-m", "lanes"]),
        (&["--spacing-m", "-3"], &["--spacing-m", "0 or more"]),
        (&["--speed-mps", "0"], &["--speed-mps", "above 0"]),
        (&["--margin-m", "inf"], &["--margin-m", "inf"]),
        (&["--mission-time-s", "soon"], &["--mission-time-s", "soon"]),
        (&["--altitude-m", "0"], &["--altitude-m", "above 0"]),
        (&["--proportions", "0.5,0.6"], &["--proportions", "1.1"]),
        (&["--proportions", "1"], &["--proportions", "2 fleets"]),
        (&["--proportions", "1.5,-0.5"], &["--proportions", "-0.5"]),
        (&["--base-m", "3"], &["--base-m", "comma"]),
        (&["--base-lon-lat", "13,91"], &["--base-lon-lat", "13,91", "degrees"]),
        (&["--base-lon-lat", "13,51"], &["--base-lon-lat", "square.csv", "WGS84"]),
        (&["--plan", "plans"], &["--plan", "square.csv", "WGS84"]),
        (&["--split", "fairly"], &["--split", "fairly", "length"]),
        (&["--environment", "urban"], &["--max-path-loss-db"]),
        (&["--max-path-loss-db", "100"], &["--environment"]),
        (&["--environment", "sea", "--max-path-loss-db", "100"], &["--environment", "sea", "highrise"]),
        (&["--environment", "urban", "--max-path-loss-db", "100", "--radius-m", "9"], &["--radius-m"]),
        (
            &["--environment", "urban", "--max-path-loss-db", "70", "--altitude-m", "900"],
            &["--max-path-loss-db", "found 70 dB", "--altitude-m 900"],
        ),
        (&["--environment", "urban", "--max-path-loss-db", "20"], &["--max-path-loss-db", "swath"]),
    ] {
        bench.refused(&[&square[..], more].concat(), told);
    }
    bench.refused(&["--fleets", "2"], &["--area"]);
    bench.refused(&["--area", "square.csv"], &["--fleets"]);
    bench.refused(&["--area", "square.csv", "--fleets", "0"], &["--fleets", "1..=1365"]);
    bench.refused(&["--area", "none.kml", "--fleets", "2"], &["none.kml", "No such file"]);
    bench.refused(&["--area", "bow.csv", "--fleets", "2"], &["bow.csv"]);
    bench.refused(&["--area", "two.csv", "--fleets", "2"], &["two.csv"]);
}

#[test]
fn files_appear_together_or_not_at_all() {
    let bench = bench().file("file", "");
    let ran = bench.run(&[
        "sweep",
        "--area",
        "town.geojson",
        "--fleets",
        "2",
        "--json",
        "--out",
        "a/b",
        "--plan",
        "c",
    ]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    assert_eq!(bench.names("a/b"), ["sweep.geojson", "sweep.json", "sweep.svg"]);
    assert_eq!(fs::read_to_string(bench.path("a/b/sweep.json")).unwrap(), ran.stdout);
    let plans: Vec<String> =
        (1..=2).flat_map(|f| (1..=3).map(move |d| format!("fleet{f}-drone{d}.plan"))).collect();
    assert_eq!(bench.names("c"), plans);
    let town = ["--area", "town.geojson", "--fleets", "2"];
    bench.refused(
        &[&town[..], &["--plan", "d", "--out", "file/e"]].concat(),
        &["--out: file: cannot be written"],
    );

    let ran = bench.run(&["sweep", "--area", "square.csv", "--fleets", "1", "--json", "--out", "local"]);
    assert_eq!(ran.code, Some(0));
    assert_eq!(ran.stderr, "no sweep.geojson: square.csv is in local metres\n");
    assert_eq!(bench.names("local"), ["sweep.json", "sweep.svg"]);
}

/// Everything that a plan promises is read back by a program that shares nothing with this one.
#[test]
fn truth_an_independent_reader_finds_the_same_way_in_every_plan() {
    let bench = bench();
    for (area, fleets, more) in [
        ("town.geojson", "2", &["--split", "area"][..]),
        ("town.geojson", "3", &["--split", "length", "--base-lon-lat", "13.9,51.0", "--altitude-m", "120"]),
        ("line.geojson", "2", &["--spacing-m", "80", "--speed-mps", "12.5"]),
        // The second hole lies between the base in the south-west and everything else.
        ("holes.geojson", "2", &["--split", "area"]),
        ("holes.geojson", "1", &["--split", "length", "--margin-m", "15"]),
    ] {
        let args = ["sweep", "--area", area, "--fleets", fleets, "--plan", "plans", "--out", "out"];
        let ran = bench.run(&[&args[..], more].concat());
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        let reader = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/read_plan.py");
        let read = Command::new("python3")
            .args([reader, "plans", "out/sweep.json", area])
            .current_dir(bench.path("."))
            .output()
            .expect("python3 reads the plans; `cargo xtask setup` or `apt-get install python3` installs it");
        let (found, error) = (String::from_utf8_lossy(&read.stdout), String::from_utf8_lossy(&read.stderr));
        assert!(read.status.success(), "{area}: {error}");
        let count: usize = fleets.parse().unwrap();
        assert!(found.starts_with(&format!("{} plans", 3 * count)), "{found}");
        fs::remove_dir_all(bench.path("plans")).unwrap();
    }
}

/// What a plan says is an area that this program reads again.
#[test]
fn a_plan_is_an_area_again() {
    let bench = bench();
    assert_eq!(bench.run(&["sweep", "--area", "town.geojson", "--fleets", "1", "--plan", "p"]).code, Some(0));
    let again = json(&bench, &["--area", "p/fleet1-drone1.plan", "--fleets", "1"]);
    let town = json(&bench, &["--area", "town.geojson", "--fleets", "1"]);
    assert!(again["area_m2"].as_f64() > town["area_m2"].as_f64());
}

#[test]
fn geojson_holds_areas_and_lanes_and_crosses_no_date_line() {
    let bench = bench();
    for (area, crossed) in [("town.geojson", false), ("line.geojson", true)] {
        let args = ["sweep", "--area", area, "--fleets", "2", "--split", "area", "--out", "out"];
        assert_eq!(bench.run(&args).code, Some(0));
        let text = fs::read_to_string(bench.path("out/sweep.geojson")).unwrap();
        let collection: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(collection["type"], "FeatureCollection");
        let mut kinds = Vec::new();
        let mut several = false;
        for feature in collection["features"].as_array().unwrap() {
            assert_eq!(feature["type"], "Feature");
            kinds.push(feature["properties"]["kind"].as_str().unwrap().to_owned());
            let shape = feature["geometry"]["type"].as_str().unwrap();
            let coordinates = &feature["geometry"]["coordinates"];
            if shape == "Point" {
                continue;
            }
            let lines = lines_of(coordinates);
            // Longitude first: between longitude 13 and latitude 51 there is no doubt.
            let west = if crossed { -180.0 } else { 13.0 };
            for line in &lines {
                assert!(line.windows(2).all(|w| (w[0][0] - w[1][0]).abs() < 1.0), "{line:?}");
                assert!(line.iter().all(|p| west <= p[0] && p[0] <= if crossed { 180.0 } else { 14.0 }));
            }
            if shape.ends_with("Polygon") {
                assert!(
                    lines.iter().all(|ring| ring.first() == ring.last() && twice_area(ring) > 0.0),
                    "{lines:?}"
                );
                let depth = if shape == "Polygon" { &coordinates[0][0][0] } else { &coordinates[0][0][0][0] };
                assert!(depth.is_number(), "{shape}: {coordinates}");
            }
            several |= shape == "MultiPolygon";
        }
        assert_eq!(kinds, ["sub_area", "lanes", "pad", "sub_area", "lanes", "pad"]);
        assert_eq!(several, crossed);
    }
}

/// All lines and rings of a geometry's coordinates.
fn lines_of(coordinates: &Value) -> Vec<Vec<Vec<f64>>> {
    serde_json::from_value(coordinates.clone()).map_or_else(
        |_| coordinates.as_array().unwrap().iter().flat_map(lines_of).collect(),
        |line: Vec<Vec<f64>>| vec![line],
    )
}

fn twice_area(ring: &[Vec<f64>]) -> f64 {
    ring.windows(2).map(|w| w[0][0] * w[1][1] - w[1][0] * w[0][1]).sum()
}
