//! Whole missions of fleets that stand anywhere: they assemble, fly in formation in gusts, and serve; a lost drone is
//! known at once and the others go on.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use serde_json::Value;
use skyroost_tests::mission::{Flown, fly, run};
use std::{fs, ops::RangeInclusive, path::PathBuf};

/// Separation, both error radii and what avoidance plans beyond them, metres.
const PASSING_M: f64 = 17.0;

struct Draw(ChaCha8Rng);

impl Draw {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u32() as f64 / f64::from(u32::MAX))
    }
}

/// A mission drawn from a seed: 3 to 30 drones that stand anywhere about an area that grows with their number, or all
/// in a part of it; mean wind up to 5 m/s, gusts of up to 8 m/s at twice their deviation.
fn drawn(seed: u64) -> String {
    let mut draw = Draw(ChaCha8Rng::seed_from_u64(seed));
    let drones = 3 + (draw.uniform(0.0, 28.0) as usize).min(27);
    let side_m = 2_000.0 * (drones as f64 / 6.0).sqrt().max(1.0);
    let within_m = draw.uniform(0.1, 1.0) * side_m;
    let corner_m = [0, 1].map(|_| draw.uniform(-200.0, side_m + 200.0 - within_m));
    let mut pads_m: Vec<[f64; 2]> = Vec::new();
    while pads_m.len() < drones {
        let pad_m = corner_m.map(|least_m| (least_m + draw.uniform(0.0, within_m)).round());
        let apart_m = |other: &[f64; 2]| (other[0] - pad_m[0]).hypot(other[1] - pad_m[1]);
        if pads_m.iter().all(|other| apart_m(other) >= PASSING_M) {
            pads_m.push(pad_m);
        }
    }
    let (mean_mps, direction_deg) = (draw.uniform(0.0, 5.0), draw.uniform(0.0, 360.0));
    let gust_mps = draw.uniform(0.0, 4.0);
    format!(
        "name = 'formation'\nseed = {seed}\n[area]\nwidth_m = {side_m:.0}\nheight_m = {side_m:.0}\n[fleet]\n\
         drones = {drones}\naltitude_m = 100\npads_m = {pads_m:?}\n[wind]\nmean_mps = {mean_mps:.2}\n\
         direction_deg = {direction_deg:.0}\ngust_sigma_mps = {gust_mps:.2}\n"
    )
}

/// Writes a scenario where it stays, so that it can be flown again.
fn written(name: &str, text: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::write(&path, text).unwrap();
    path
}

fn recording(flown: &Flown) -> Value {
    let path = flown.out.path().join("out").join("recording.json");
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// The last phase of a mission that came to its end is "serve": everybody is placed, or has returned.
fn last_phase(recording: &Value) -> Option<&str> {
    recording["phases"].as_array()?.last()?["name"].as_str()
}

/// Flies the missions of these seeds and says of each what it fails to keep.
fn fly_seeds(seeds: RangeInclusive<u64>) {
    let mut failed = Vec::new();
    for seed in seeds {
        let path = written(&format!("formation-{seed}.toml"), &drawn(seed));
        let flown = fly(&[path.to_str().unwrap()]);
        let phase = recording(&flown);
        let phase = last_phase(&phase).unwrap_or_default();
        let figures = [
            ("violations", flown.number("/safety/violations"), 0.0, 0.0),
            ("min_separation_m", flown.number("/safety/min_separation_m"), 10.0, f64::INFINITY),
            ("formation_error_rms_m", flown.number("/safety/formation_error_rms_m"), 0.0, 1.0),
            ("formation_error_max_m", flown.number("/safety/formation_error_max_m"), 0.0, 5.0),
            // What the formation error leaves out, of all fleets together: two of them may have to pass each other.
            ("manoeuvres_s", flown.number("/safety/manoeuvres_s"), 0.0, 60.0),
            ("coverage_fraction", flown.number("/sweep/coverage_fraction"), 1.0 - 1e-9, 1.0),
            ("lost", flown.json["lost"].as_array().map_or(f64::NAN, |lost| lost.len() as f64), 0.0, 0.0),
        ];
        let told: Vec<String> =
            figures.iter().map(|(name, found, ..)| format!("{name} {found:.3}")).collect();
        println!("seed {seed}, {} drones: {}, ended in '{phase}'", flown.json["drones"], told.join(", "));
        for (name, found, least, most) in figures {
            if !(least <= found && found <= most) {
                failed.push(format!(
                    "seed {seed}: {name} {found}, expected {least} to {most}; {}",
                    flown.replay
                ));
            }
        }
        if phase != "serve" {
            failed.push(format!("seed {seed}: ended in '{phase}', expected 'serve'; {}", flown.replay));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn random_missions_1_to_5() {
    fly_seeds(1..=5);
}

#[test]
fn random_missions_6_to_10() {
    fly_seeds(6..=10);
}

#[test]
fn random_missions_11_to_15() {
    fly_seeds(11..=15);
}

#[test]
fn random_missions_16_to_20() {
    fly_seeds(16..=20);
}

#[test]
fn a_drone_lost_in_the_sweep_is_known_at_once_and_the_others_go_on() {
    let lost_at_s = 350.0;
    let text = format!(
        "name = 'loss'\n[[losses]]\ndrone = 2\nat_s = {lost_at_s}\n[area]\nwidth_m = 3_000\nheight_m = 3_000\n\
         [fleet]\ndrones = 7\naltitude_m = 100\n"
    );
    let flown = fly(&[written("loss.toml", &text).to_str().unwrap()]);
    let recording = recording(&flown);
    let began_s = |name: &str| {
        let phases = recording["phases"].as_array().unwrap();
        let phase = phases.iter().find(|phase| phase["name"] == name);
        phase.and_then(|phase| phase["t_s"].as_f64()).unwrap_or(f64::NAN)
    };
    assert!(
        began_s("sweep") < lost_at_s && lost_at_s < began_s("locate and place"),
        "{}",
        recording["phases"]
    );

    let [lost] = &flown.json["lost"].as_array().unwrap()[..] else { panic!("{}", flown.json["lost"]) };
    let known_s = lost["at_s"].as_f64().unwrap();
    assert!(lost["drone"] == 2 && (lost_at_s..=lost_at_s + 2.0).contains(&known_s), "{lost}");
    let events = recording["events"].as_array().unwrap();
    let told = |text: &str| {
        let tells = move |event: &&Value| event["text"].as_str().is_some_and(|it| it.starts_with(text));
        events
            .iter()
            .filter(tells)
            .map(|event| (event["drone"].as_u64(), event["t_s"].as_f64()))
            .collect::<Vec<_>>()
    };
    assert_eq!(told("lost"), [(Some(2), Some(known_s))], "the control center tells");
    let mates = told("fleet mate lost: raised");
    let in_time = |at_s: Option<f64>| at_s.is_some_and(|at_s| (lost_at_s..=lost_at_s + 2.0).contains(&at_s));
    let who: Vec<Option<u64>> = mates.iter().map(|(drone, _)| *drone).collect();
    assert!(who == [Some(1), Some(3)] && mates.iter().all(|(_, at_s)| in_time(*at_s)), "{mates:?}");

    assert_eq!(last_phase(&recording), Some("serve"), "{}", recording["phases"]);
    assert_eq!(flown.json["safety"]["violations"], 0, "{}", flown.json["safety"]);
    let swept = |drone: u64| {
        let said = |event: &&Value| {
            event["drone"] == drone
                && event["text"].as_str().is_some_and(|text| text.starts_with("lanes flown"))
        };
        events.iter().any(|event| said(&event))
    };
    for drone in [1, 3, 4, 5, 6] {
        assert!(swept(drone), "drone {drone} flies its lanes to the end\nreplay: {}", flown.replay);
    }
    let placed = flown.json["placement"]["drones"].as_array().unwrap();
    assert!(placed.len() == 6 && placed.iter().all(|drone| drone["id"] != 2), "{placed:?}");
}

#[test]
fn pads_too_near_to_each_other_are_refused_by_name() {
    let text = "[fleet]\ndrones = 4\npads_m = [[0, 0], [500, 0], [500, 400], [510, 410]]\n";
    let (output, out) = run(&[written("near.toml", text).to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(!out.path().join("out").exists(), "nothing is written");
    for part in ["near.toml:3", "fleet.pads_m", "drones 3 and 4", "14.142 m", "17"] {
        assert!(said.contains(part), "'{part}' in: {said}");
    }
}
