//! Whole missions over a town with towers and no-fly zones between bases, lanes and sites: nobody comes near them or
//! leaves the fence, and everybody arrives.

use skyroost_tests::mission::{Flown, fly, run};
use std::fs;
use tempfile::TempDir;

/// Half a degree from the equator a thousandth of a degree is some 111 m either way.
fn ring(west: u32, south: u32, east: u32, north: u32) -> String {
    let corner = |x: u32, y: u32| format!("[10.{x:04},0.5{y:03}]");
    let corners = [(west, south), (east, south), (east, north), (west, north), (west, south)];
    corners.map(|(x, y)| corner(x, y)).join(",")
}

fn feature(geometry: &str, coordinates: &str, properties: &str) -> String {
    format!(
        r#"{{"type":"Feature","geometry":{{"type":"{geometry}","coordinates":{coordinates}}},"properties":{{{properties}}}}}"#
    )
}

/// An area of 5 km by 4 km; a no-fly zone of 800 m by 1 km and a tower in the middle, a block of 120 m near the base, and
/// one that drones at 100 m fly over.
fn town(more: &str) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| fs::write(dir.path().join(name), text).unwrap();
    write("area.geojson", feature("Polygon", &format!("[[{}]]", ring(0, 0, 450, 360)), ""));
    let obstacles = [
        feature("Polygon", &format!("[[{}]]", ring(150, 120, 220, 210)), r#""name":"airfield""#),
        feature("Point", "[10.0300,0.515]", r#""radius_m":20,"height_m":180,"name":"tower""#),
        feature("Polygon", &format!("[[{}]]", ring(60, 40, 80, 60)), r#""height_m":120"#),
        feature("Polygon", &format!("[[{}]]", ring(350, 250, 380, 280)), r#""height_m":60"#),
    ];
    let collection = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, obstacles.join(","));
    write("obstacles.geojson", collection);
    let scenario = format!(
        "name = 'town'\n[area]\nfile = 'area.geojson'\n[obstacles]\nfile = 'obstacles.geojson'\n[fleet]\ndrones = 7\n\
         altitude_m = 100\n[users]\ndensity_per_km2 = 15\n[wind]\nmean_mps = 5\ngust_sigma_mps = 2\n{more}"
    );
    write("town.toml", scenario);
    dir
}

fn fly_over(town: &TempDir, words: &[&str]) -> Flown {
    let scenario = town.path().join("town.toml");
    fly(&[&[scenario.to_str().unwrap()], words].concat())
}

#[test]
fn nobody_meets_a_tower_or_enters_a_zone() {
    let town = town("");
    for seed in ["1", "2", "3"] {
        let flown = fly_over(&town, &["--seed", seed]);
        let least_m = flown.number("/safety/min_obstacle_distance_m");
        // A clearance of 10 m, less what gusts and avoidance take.
        assert!(least_m >= 6.0, "{least_m} m\nreplay: {}", flown.replay);
        assert!(flown.number("/safety/min_fence_distance_m") >= 10.0, "{}", flown.json["safety"]);
        assert_eq!(flown.json["safety"]["violations"], 0, "{}", flown.json["safety"]);
        assert!(flown.number("/sweep/coverage_fraction") > 1.0 - 1e-9, "{}", flown.json["sweep"]);
        assert_eq!(flown.json["placement"]["drones"].as_array().map(Vec::len), Some(7), "everybody arrives");
        assert!(flown.number("/placement/served_ratio") > 0.95, "{}", flown.json["placement"]);
    }
}

/// What is wrong, by its name.
fn refusal(town: &TempDir) -> (Option<i32>, String) {
    let scenario = town.path().join("town.toml");
    let (output, out) = run(&[scenario.to_str().unwrap()]);
    assert!(!out.path().join("out").exists(), "nothing is written");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn what_cannot_be_flown_is_refused_by_name() {
    let (code, said) = refusal(&town("[fence]\nfile = 'obstacles.geojson'\n"));
    assert!(code == Some(2) && said.contains("found 4 features") && said.contains("the fence"), "{said}");

    let narrow = town("[fence]\nfile = 'area.geojson'\n");
    let (code, said) = refusal(&narrow);
    assert!(code == Some(3) && said.contains("leaves the fence") && said.contains("drone 1"), "{said}");

    let on_top = town("");
    let scenario = on_top.path().join("town.toml");
    let text = fs::read_to_string(&scenario).unwrap();
    fs::write(&scenario, text.replace("drones = 7", "drones = 7\nbase_m = [-1_100, -100]")).unwrap();
    let (code, said) = refusal(&on_top);
    assert!(code == Some(3) && said.contains("airfield") && said.contains("the pad of drone"), "{said}");

    let local = town("");
    let scenario = local.path().join("town.toml");
    let text = fs::read_to_string(&scenario).unwrap();
    fs::write(&scenario, text.replace("file = 'area.geojson'", "width_m = 4000")).unwrap();
    let (code, said) = refusal(&local);
    assert!(code == Some(2) && said.contains("obstacles.file") && said.contains("WGS84"), "{said}");
}
