//! Missions that lose drones: whoever is left finds the same users, covers the same area and serves whom it can.

use serde_json::Value;
use skyroost_tests::mission::{Flown, binary, fly, run};
use std::{
    fs,
    process::{Command, Stdio},
    time::Duration,
};

/// A mission over 4 km by 4 km with these lines at the top of its scenario.
fn fly_with(lines: &str, drones: u32) -> Flown {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("survival.toml");
    let text = format!(
        "name = 'survival'\n{lines}\n[area]\nwidth_m = 4_000\nheight_m = 4_000\n[fleet]\ndrones = {drones}\n"
    );
    fs::write(&file, text).unwrap();
    fly(&[file.to_str().unwrap()])
}

fn losses(lost: &[(u32, f64)]) -> String {
    let row = |(drone, at_s): &(u32, f64)| format!("{{ drone = {drone}, at_s = {at_s} }}");
    format!("losses = [{}]", lost.iter().map(row).collect::<Vec<_>>().join(", "))
}

fn is(flown: &Flown, figure: &str, expected: f64) {
    let found = flown.number(figure);
    assert!((found - expected).abs() < 1e-9, "{figure}: {found}, expected {expected}\n{}", flown.json);
}

/// All is covered and everybody found, as if nobody had been lost, and nobody came too near to anybody.
fn assert_whole(flown: &Flown) {
    is(flown, "/sweep/coverage_fraction", 1.0);
    is(flown, "/safety/violations", 0.0);
    is(flown, "/localization/located", flown.number("/localization/users"));
}

fn replans(flown: &Flown) -> &Vec<Value> {
    flown.json["sweep"]["replans"].as_array().unwrap()
}

fn placed(flown: &Flown) -> Vec<u64> {
    let drones = flown.json["placement"]["drones"].as_array().unwrap();
    let mut ids: Vec<u64> = drones.iter().filter_map(|drone| drone["id"].as_u64()).collect();
    ids.sort_unstable();
    ids
}

/// The survivors of two broken fleets make up one, and the fourth serves in the end.
#[test]
fn one_drone_of_each_fleet_lost_at_half_time() {
    let flown = fly_with(&losses(&[(2, 650.0), (5, 650.0)]), 6);
    assert_whole(&flown);
    let [replan] = &replans(&flown)[..] else { panic!("{}", flown.json["sweep"]) };
    assert_eq!(replan["broken_by"], serde_json::json!([2, 5]));
    assert_eq!(replan["fleets"], 1);
    // Half of two fleets' lanes for one fleet: the other half's time once more, and what it takes to get there.
    let delay_s = replan["delay_s"].as_f64().unwrap();
    let swept_s = flown.number("/sweep/duration_s");
    assert!(delay_s > 300.0 && delay_s < swept_s, "{delay_s} s of {swept_s} s");
    assert_eq!(placed(&flown), [1, 3, 4, 6]);
}

#[test]
fn a_whole_fleet_lost() {
    let flown = fly_with(&losses(&[(1, 500.0), (2, 500.1), (3, 500.2)]), 6);
    assert_whole(&flown);
    assert_eq!(replans(&flown)[0]["broken_by"], serde_json::json!([1, 2, 3]));
    assert_eq!(placed(&flown), [4, 5, 6]);
}

/// One after the other, in every phase: in the climb, on the lanes, while the rest assembles, and on the way to its place.
#[test]
fn one_after_the_other() {
    let flown = fly_with(&losses(&[(4, 20.0), (9, 400.0), (1, 435.0), (6, 2_500.0)]), 12);
    assert_whole(&flown);
    assert!(replans(&flown).len() >= 2, "{}", flown.json["sweep"]);
    assert!(flown.number("/placement/served_actual") > 0.0);
}

/// Two are no fleet: what is known is used, the rest is not covered, and it is said.
#[test]
fn too_few_for_a_fleet_serve_whom_they_know() {
    let flown = fly_with(&losses(&[(1, 500.0)]), 3);
    assert!(flown.number("/sweep/coverage_fraction") < 0.9);
    is(&flown, "/safety/violations", 0.0);
    assert_eq!(replans(&flown)[0]["fleets"], 0);
    assert_eq!(placed(&flown), [2, 3]);
}

/// Who was not heard for a while and turned home comes back: the area is covered by two fleets in the end.
#[test]
fn who_comes_back_is_taken_back() {
    let flown = fly_with("partitions = [{ drones = [4, 5], from_s = 400, until_s = 520 }]", 6);
    assert_whole(&flown);
    let fleets: Vec<&Value> = replans(&flown).iter().map(|it| &it["fleets"]).collect();
    assert_eq!(fleets, [1, 2]);
    assert_eq!(placed(&flown), [1, 2, 3, 4, 5, 6]);
    is(&flown, "/placement/served_ratio", flown.number("/placement/served_ratio").max(0.98));
}

/// Where the control center is killed ten times, each time made again of its journal, the mission ends as if it had not been, but for
/// the time in which nobody was asked anything.
#[test]
fn ten_kills_of_the_control_center() {
    let undisturbed = fly_with("", 6);
    let kills = [12.0, 47.3, 101.1, 140.0, 333.3, 512.7, 700.0, 901.4, 1_180.0, 1_500.0];
    let row = |at_s: &f64| format!("{{ kind = 'control_killed', at_s = {at_s}, for_s = 4 }}");
    let flown = fly_with(&format!("faults = [{}]", kills.iter().map(row).collect::<Vec<_>>().join(", ")), 6);
    assert_whole(&flown);
    assert!(replans(&flown).is_empty(), "nobody was lost\n{}", flown.json["sweep"]);
    is(&flown, "/localization/located", undisturbed.number("/localization/located"));
    assert_eq!(placed(&flown), placed(&undisturbed));
    assert!(flown.number("/placement/served_ratio") >= 0.98, "{}", flown.json["placement"]);
    let late_s = flown.number("/timing/simulated_s") - undisturbed.number("/timing/simulated_s");
    assert!(late_s < 10.0 * (4.0 + 10.0), "{late_s} s later");
}

/// The whole command is killed at a random moment, and goes on from its journal: as if the control center had been killed there.
#[test]
fn a_mission_killed_goes_on_from_its_journal() {
    let dir = tempfile::tempdir().unwrap();
    let journal = dir.path().join("mission.journal");
    let scenario = dir.path().join("survival.toml");
    fs::write(&scenario, "name = 'killed'\n[area]\nwidth_m = 3_000\nheight_m = 3_000\n[fleet]\ndrones = 6\n")
        .unwrap();
    let keys = dir.path().join("fleet.keys");
    let made =
        Command::new(binary()).args(["keys", "new", "--drones", "6", "--out"]).arg(&keys).output().unwrap();
    assert!(made.status.success());
    let [journal_word, keys_word] = [&journal, &keys].map(|path| path.to_str().unwrap());
    let words = [scenario.to_str().unwrap(), "--journal", journal_word, "--keys", keys_word];
    let undisturbed = fly(&words[..1]);
    for wait_ms in [150, 400, 900] {
        let out = dir.path().join("killed");
        let mut child = Command::new(binary())
            .args(["mission", "--json", "--quiet", "--out", out.to_str().unwrap()])
            .args(words)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(wait_ms));
        child.kill().unwrap(); // SIGKILL, unless it was faster
        child.wait().unwrap();
        assert!(
            fs::metadata(&journal).is_ok_and(|file| file.len() > 100),
            "nothing was written in {wait_ms} ms"
        );
        let flown = fly(&[&words[..], &["--resume"]].concat());
        assert_whole(&flown);
        is(&flown, "/localization/located", undisturbed.number("/localization/located"));
        assert_eq!(placed(&flown), placed(&undisturbed));
    }
    // Whose world was flown there as if nobody had been killed cannot be flown there once more.
    let (output, _) = run(&[&words[..], &["--resume"]].concat());
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("went on from it already"));
    // Another mission's journal is refused.
    let (output, _) = run(&[words[0], "--journal", journal_word]);
    assert_eq!(output.status.code(), Some(0));
    let (output, _) = run(&[words[0], "--seed", "2", "--resume", "--journal", journal_word]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("journal of another mission"));
}

/// The paper's p_i: a fleet with a battery that is half empty sweeps as much less as its charge allows.
#[test]
fn fleets_sweep_by_their_endurance() {
    let flown = fly_with("battery = { charges = [1, 1, 0.5, 1, 1, 1] }", 6);
    assert_whole(&flown);
    let lengths = flown.json["sweep"]["length_m"].as_array().unwrap();
    let share = lengths[0].as_f64().unwrap() / (lengths[0].as_f64().unwrap() + lengths[1].as_f64().unwrap());
    let expected = (0.5 - 0.15) / (0.5 - 0.15 + 1.0 - 0.15);
    assert!((share - expected).abs() < 0.05, "{share} of the lanes, expected {expected}");
}
