//! Whole missions, flown by the optimised command: what the paper's scenario promises holds for other
//! seeds, densities, fleets, areas and links as well.

use serde_json::Value;
use skyroost_tests::{
    mission::{Flown, fly},
    report_check::check_report,
};
use std::{fs, path::Path};

#[test]
fn the_paper_scenario() {
    let flown = fly(&[]);
    flown.assert_accepted();
    assert_eq!(flown.code, 0, "{}", flown.json["limits"]);
    // Table 3: 100 minutes of mission time for the sweep.
    assert!(flown.number("/sweep/duration_s") <= 6_000.0);
    for name in ["report.html", "summary.json", "users.csv", "trajectory.csv", "recording.json"] {
        let path = flown.out.path().join("out").join(name);
        assert!(fs::metadata(&path).is_ok_and(|m| m.len() > 1_000), "{name} is missing or empty");
    }
    let summary = fs::read(flown.out.path().join("out").join("summary.json")).unwrap();
    assert_eq!(summary, flown.bytes, "summary.json is what --json prints");
    let report = flown.out.path().join("out").join("report.html");
    check_report(&report, &flown.out.path().join("report.png"));
}

#[test]
fn another_run_is_the_same_run_for_any_number_of_threads() {
    let timeless = |flown: &Flown| {
        let mut json = flown.json.clone();
        json["timing"] = Value::Null;
        json
    };
    // Short of the whole mission, as a difference shows at once; with losses, as they draw on chance.
    let words = ["--duration-s", "900", "--loss-fraction", "0.1", "--drones", "27"];
    let with = |more: &[&str]| fly(&[&words[..], more].concat());
    let first = with(&["--threads", "1"]);
    for again in [with(&["--threads", "1"]), with(&["--threads", "2"]), with(&["--threads", "5"])] {
        assert_eq!(timeless(&first), timeless(&again));
        let track = |flown: &Flown| fs::read(flown.out.path().join("out/trajectory.csv")).unwrap();
        assert_eq!(track(&first), track(&again));
    }
    let other = with(&["--seed", "2"]);
    assert_ne!(first.json["digest"], other.json["digest"], "another seed is another flight");
}

#[test]
fn other_seeds() {
    let (mut served, mut most) = (0.0, 0.0);
    for seed in ["2", "3", "4", "5", "6"] {
        let flown = fly(&["--seed", seed]);
        flown.assert_accepted();
        served += flown.number("/placement/served_actual");
        most += flown.number("/placement/optimum_on_truth");
    }
    // What the joint optimum that knew every position would serve is out of reach by little.
    assert!(served >= 0.98 * most, "{served} of {most}");
}

#[test]
fn sparse_users() {
    fly(&["--density-per-km2", "1"]).assert_accepted();
}

#[test]
fn dense_users() {
    let flown = fly(&["--density-per-km2", "50"]);
    flown.assert_accepted();
    assert!(flown.number("/placement/served_ratio") >= 0.98, "{}", flown.json["placement"]);
}

#[test]
fn one_fleet() {
    fly(&["--drones", "3"]).assert_accepted();
}

#[test]
fn a_reserve_joins_in_stage_two() {
    let flown = fly(&["--drones", "7"]);
    flown.assert_accepted();
    assert_eq!(flown.json["fleets"], 2);
    assert_eq!(flown.json["placement"]["drones"].as_array().map(Vec::len), Some(7));
}

#[test]
fn four_fleets() {
    fly(&["--drones", "12"]).assert_accepted();
}

#[test]
fn a_link_that_loses_a_tenth_of_its_frames() {
    let flown = fly(&["--loss-fraction", "0.1"]);
    flown.assert_accepted();
    let lost = flown.number("/link/lost") / flown.number("/link/frames");
    assert!((lost - 0.1).abs() < 0.01, "{lost} of the frames were lost");
}

/// Late and incomplete: occasions are announced earlier and twice, and the same users are located.
#[test]
fn a_link_that_loses_three_frames_of_ten_and_holds_others_up_for_half_a_second() {
    let good = fly(&[]);
    let flown = fly_scenario("[link]\nloss_fraction = 0.3\njitter_s = 0.5\n");
    flown.assert_accepted();
    for figure in ["/localization/users", "/localization/located", "/safety/violations", "/link/forged"] {
        assert!((flown.number(figure) - good.number(figure)).abs() < 0.5, "{figure}: {}", flown.json);
    }
    assert!(flown.number("/placement/served_ratio") >= 0.98, "{}", flown.json["placement"]);
}

/// Now and then nobody hears anybody, and once a fleet and the control center do not for eight seconds: it flies on as it was told.
#[test]
fn bursts_and_a_partition() {
    let flown = fly_scenario(
        "partitions = [{ drones = [1, 2, 3], from_s = 1500, until_s = 1508 }]\n\
         [link]\nburst_every_s = 120\nburst_s = 0.5\n",
    );
    // Mates that are not heard of are kept away from: a formation bends for seconds, and that is all.
    assert!(flown.number("/safety/violations") < 0.5, "{}", flown.json["safety"]);
    assert!(flown.number("/safety/formation_error_max_m") < 15.0, "{}", flown.json["safety"]);
    assert!(flown.number("/sweep/coverage_fraction") > 0.999_999, "{}", flown.json["sweep"]);
    assert!(flown.number("/placement/served_ratio") >= 0.98, "{}", flown.json["placement"]);
    assert!(flown.number("/link/lost") > 1_000.0, "{}", flown.json["link"]);
}

/// Writes a scenario.
fn scenario(text: &str) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::with_suffix(".toml").unwrap();
    fs::write(file.path(), text).unwrap();
    file
}

fn fly_scenario(text: &str) -> Flown {
    let file = scenario(text);
    fly(&[file.path().to_str().unwrap()])
}

/// Oscillators of any quality locate where a pulse per second disciplines them, pulses lost and stray included.
#[test]
fn oscillators_of_20_ppm_with_a_pulse_per_second() {
    let flown = fly_scenario(
        "[clock]\ndrift_ns_per_s = 20_000\npps_sigma_ns = 20\npps_loss_fraction = 0.1\npps_outlier_fraction = 0.01\n",
    );
    flown.assert_accepted();
    assert!(flown.number("/localization/r95_median_m") < 11.0, "{}", flown.json["localization"]);
    // Clocks that are known judge differences: one in twenty captures is late by 100 ns to 1000.
    let gated = flown.number("/srs/gated") / flown.number("/srs/hits");
    assert!((0.06..0.1).contains(&gated), "{gated}");
    assert!(flown.number("/srs/pulses_rejected") > 100.0, "{}", flown.json["srs"]);
}

/// Without pulses they drift beyond what a difference can say: told, and no position claimed that is not held.
#[test]
fn oscillators_of_20_ppm_alone() {
    let flown = fly_scenario("[clock]\ndrift_ns_per_s = 20_000\n");
    assert!(flown.number("/srs/saturated") > 1_000.0, "{}", flown.json["srs"]);
    assert!(flown.json["warnings"][0].as_str().is_some_and(|told| told.contains("32 bits")));
    assert!(flown.number("/localization/located") < 0.5 * flown.number("/localization/users"));
    assert!(flown.number("/localization/in_r95_fraction") > 0.9, "{}", flown.json["localization"]);
}

/// The mean of four symbols halves the noise, and nearly halves the errors.
#[test]
fn four_symbols_of_every_srs() {
    let flown = fly_scenario("[srs]\nsymbols = 4\n");
    flown.assert_accepted();
    assert!(flown.number("/localization/r95_median_m") < 5.5, "{}", flown.json["localization"]);
    assert!(flown.number("/srs/refused") < 20.0, "{}", flown.json["srs"]);
}

/// Writes the corners of a local area.
fn area(name: &str, corners_m: impl IntoIterator<Item = (f64, f64)>) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let rows: Vec<String> = corners_m.into_iter().map(|(x, y)| format!("{x},{y}")).collect();
    fs::write(dir.path().join(name), format!("x_m,y_m\n{}\n", rows.join("\n"))).unwrap();
    dir
}

fn fly_over(dir: &Path, name: &str) -> Flown {
    let flown = fly(&["--area", dir.join(name).to_str().unwrap()]);
    flown.assert_accepted();
    flown
}

#[test]
fn a_triangle() {
    let dir = area("triangle.csv", [(0.0, 0.0), (9_000.0, 1_500.0), (3_000.0, 8_000.0)]);
    fly_over(dir.path(), "triangle.csv");
}

#[test]
fn a_twelve_sided_area() {
    let corner = |k: u32| {
        let angle = f64::from(k) * std::f64::consts::TAU / 12.0;
        (5_000.0 + 4_500.0 * angle.cos(), 5_000.0 + 4_500.0 * angle.sin())
    };
    let dir = area("twelve.csv", (0..12).map(corner));
    fly_over(dir.path(), "twelve.csv");
}

#[test]
fn fewer_than_three_drones_cannot_sweep() {
    let (output, out) = skyroost_tests::mission::run(&["--drones", "2"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(!out.path().join("out").exists(), "nothing is written");
}

#[test]
fn a_real_town_from_a_scenario_file() {
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/../host-sim/scenarios/dresden-elbe.toml");
    let flown = fly(&[scenario]);
    assert_eq!(flown.code, 0, "{}\nreplay: {}", flown.json["limits"], flown.replay);
    flown.assert_accepted();
}
