//! Missions whose users walk about while they are looked for.

use skyroost_tests::mission::{Flown, fly};
use std::fs;

/// Over so many kilometres by as many, with these lines in the table of users.
fn fly_among(side_km: u32, users: &str) -> Flown {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("walking.toml");
    let area = format!("[area]\nwidth_m = {side_km}_000\nheight_m = {side_km}_000\n");
    fs::write(&file, format!("name = 'walking'\n{area}[users]\n{users}\n")).unwrap();
    let flown = fly(&[file.to_str().unwrap()]);
    assert!(flown.number("/sweep/coverage_fraction") > 1.0 - 1e-9);
    assert!(flown.number("/safety/violations") < 0.5);
    flown
}

/// Where a user on foot is, is known to the radius that is said; the faster it walks, the wider that is.
#[test]
fn what_is_said_of_users_on_foot_is_true() {
    let users = "density_per_km2 = 8\nrevisits = 0";
    let still = fly_among(4, users);
    let mut r95_m = still.number("/localization/r95_median_m");
    for speed_mps in [0.1, 0.3] {
        let flown = fly_among(4, &format!("{users}\nspeed_mps = {speed_mps}"));
        let inside = flown.number("/localization/in_r95_fraction");
        // 95 % of 119, three deviations.
        assert!((0.89..=1.0).contains(&inside), "{speed_mps} m/s: {inside}\n{}", flown.json["localization"]);
        let wider_m = flown.number("/localization/r95_median_m");
        assert!(wider_m > 1.5 * r95_m, "{speed_mps} m/s: {wider_m} m after {r95_m} m");
        r95_m = wider_m;
        assert!(flown.json["sweep"]["replans"].as_array().unwrap().is_empty());
        assert!(flown.json["localization"]["crlb_ratio"].is_null(), "the bound is one of users that stay");
    }
}

/// Where drones are to serve, users that have walked on since they were heard are looked for again, and more are served for it.
#[test]
fn users_that_have_gone_are_looked_for_again_where_it_matters() {
    let users = "density_per_km2 = 5\nspeed_mps = 0.25\nrevisit_r95_m = 100";
    let left = fly_among(8, &format!("{users}\nrevisits = 0"));
    let found = fly_among(8, users);
    assert!(left.json["sweep"]["replans"].as_array().unwrap().is_empty());
    let replans = found.json["sweep"]["replans"].as_array().unwrap();
    assert_eq!(replans.len(), 1, "once: {replans:?}");
    assert!(replans[0]["users_gone"].as_u64().unwrap() > 20, "{replans:?}");
    assert!(replans[0]["left_m2"].as_f64().unwrap() < 6e6, "of 64 km2: {replans:?}");
    let [before, after] = [&left, &found].map(|it| it.number("/placement/served_guaranteed"));
    assert!(after > 1.3 * before, "{before} users certain, {after}");
    let [before, after] = [&left, &found].map(|it| it.number("/placement/served_actual"));
    assert!(after > before, "{before} users served, {after}");
    assert!((0.91..=1.0).contains(&found.number("/localization/in_r95_fraction")));
}
