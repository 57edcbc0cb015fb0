//! Missions that lose drones: whoever is left finds the same users, covers the same area and serves whom it can.

use serde_json::Value;
use skyroost_tests::mission::{Flown, binary, fly, run};
use std::{
    fs,
    path::Path,
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
    assert!(flown.number("/placement/served_ratio") >= 0.98, "{}", flown.json["placement"]);
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

/// The whole command is killed time and again, and goes on from its journal: as if the control center had been killed there.
#[test]
fn a_mission_killed_goes_on_from_its_journal() {
    let dir = tempfile::tempdir().unwrap();
    let [journal, whole, keys, out] =
        ["mission.journal", "whole.journal", "fleet.keys", "killed"].map(|name| dir.path().join(name));
    let scenario = dir.path().join("survival.toml");
    fs::write(&scenario, "name = 'killed'\n[area]\nwidth_m = 3_000\nheight_m = 3_000\n[fleet]\ndrones = 6\n")
        .unwrap();
    let made =
        Command::new(binary()).args(["keys", "new", "--drones", "6", "--out"]).arg(&keys).output().unwrap();
    assert!(made.status.success());
    let [scenario, journal_word, whole_word, keys_word, out] =
        [&scenario, &journal, &whole, &keys, &out].map(|path| path.to_str().unwrap());
    let length = |path: &Path| fs::metadata(path).map_or(0, |file| file.len());

    let undisturbed = fly(&[scenario, "--journal", whole_word]);
    let words = [scenario, "--journal", journal_word, "--keys", keys_word];
    let resume = [&words[..], &["--resume"]].concat();
    // Of the whole journal's length; the first has hardly begun, the last has next to nothing left to do.
    let kills = [0.0002, 0.15, 0.4, 0.4, 0.7, 0.97];
    for (round, share) in kills.into_iter().enumerate() {
        let begun = length(&journal);
        let enough = ((length(&whole) as f64 * share) as u64).max(begun + 1);
        let mut child = Command::new(binary())
            .args(["mission", "--json", "--quiet", "--out", out])
            .args(if round == 0 { &words[..] } else { &resume })
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        while length(&journal) < enough {
            assert_eq!(child.try_wait().unwrap(), None, "it ended in round {round}, before it was killed");
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let results = fs::read_dir(out).map_or(0, Iterator::count);
        assert_eq!(results, 0, "nothing is written but the journal");
    }
    let flown = fly(&resume);
    assert_whole(&flown);
    is(&flown, "/localization/located", undisturbed.number("/localization/located"));
    assert_eq!(placed(&flown), placed(&undisturbed));

    let refused = |words: &[&str], why: &str| {
        let (output, _) = run(words);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(why), "{message}");
    };
    // A journal may be all that is known of a mission: it is not written over.
    refused(&[scenario, "--journal", whole_word], "is there already");
    refused(&[scenario, "--seed", "2", "--resume", "--journal", whole_word], "journal of another mission");
}

/// Keys that change every five seconds on a link that loses a third of all frames, repeats and reorders: both ends always have one in
/// common, and nobody is lost over it.
#[test]
fn keys_change_on_a_bad_link() {
    let link = "loss_fraction = 0.3, jitter_s = 0.5, duplicate_fraction = 0.1, reorder_fraction = 0.1";
    let flown = fly_with(&format!("link = {{ {link}, rekey_s = 5 }}"), 6);
    assert_whole(&flown);
    assert!(replans(&flown).is_empty(), "nobody was lost\n{}", flown.json["sweep"]);
    // Of 1,800 changes: what was held up for longer than a key was good for.
    assert!(flown.number("/link/forged") < 20.0, "{}", flown.json["link"]);
    assert!(flown.number("/placement/served_ratio") >= 0.98, "{}", flown.json["placement"]);
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
