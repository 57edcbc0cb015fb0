//! Missions on links of limited rate: whoever knows the rate of its link keeps to it, and says first what keeps drones apart.

use skyroost_tests::mission::{Flown, fly};
use std::io::Write;

/// Six drones, two fleets, over a small area with many users; and what else the scenario says.
fn flown(more: &str) -> Flown {
    let mut file = tempfile::NamedTempFile::with_suffix(".toml").unwrap();
    write!(
        file,
        "name = 'bandwidth'\n[area]\nwidth_m = 2400\nheight_m = 2400\n[fleet]\naltitude_m = 100\n[users]\n\
         density_per_km2 = 40\n{more}"
    )
    .unwrap();
    fly(&[file.path().to_str().unwrap()])
}

/// How often something found no room.
fn held_back(flown: &Flown, what: &str) -> f64 {
    flown.number(&format!("/link/held_back/{what}"))
}

const ALL: [&str; 7] = [
    "frames_put_off",
    "pages_dropped",
    "relays_put_off",
    "relays_cut",
    "lanes_put_off",
    "requests_dropped",
    "copies_dropped",
];

/// The mission comes to its end without a violation and with nothing lost for a transmitter that was busy.
fn assert_safe(flown: &Flown) {
    for (what, pointer) in [("violations", "/safety/violations"), ("overflowed", "/link/overflowed")] {
        assert!(flown.number(pointer) < 0.5, "{what}\nreplay: {}", flown.replay);
    }
    assert_eq!(flown.json["lost"], serde_json::json!([]), "nobody is taken for lost");
    assert_eq!(flown.json["sweep"]["replans"], serde_json::json!([]), "nor is anything planned anew");
    assert!(
        flown.number("/placement/served_actual") > 0.0 && flown.number("/sweep/coverage_fraction") > 0.999
    );
}

#[test]
fn a_rate_that_is_ample_changes_nothing_but_the_time_that_bits_take() {
    let free = flown("");
    for bits_per_s in ["1_000_000_000", "64_000"] {
        let ample = flown(&format!("[link]\nbits_per_s = {bits_per_s}\n"));
        assert_safe(&ample);
        for what in ALL {
            assert!(held_back(&ample, what) < 0.5, "{what}");
        }
        for pointer in ["/srs/hits", "/localization/located", "/placement/served_actual"] {
            let ratio = ample.number(pointer) / free.number(pointer);
            assert!((ratio - 1.0).abs() < 0.02, "{pointer}: {ratio}");
        }
    }
}

#[test]
fn a_tight_link_carries_states_first_and_loses_nothing_to_its_queue() {
    let free = flown("");
    let tight = flown("[link]\nbits_per_s = 13_000\n");
    assert_safe(&tight);
    assert!(held_back(&tight, "frames_put_off") > 100.0, "{}", tight.json["link"]);
    // States are shared as often as ever.
    let states =
        |flown: &Flown| flown.number("/link/bytes_for/up_states") / flown.number("/timing/simulated_s");
    assert!(states(&tight) > 0.97 * states(&free), "{} {}", states(&tight), states(&free));
    // Users are located as before, if from fewer occasions.
    let located = |flown: &Flown| flown.number("/localization/located") / flown.number("/localization/users");
    assert!(located(&tight) > 0.95 * located(&free), "{} {}", located(&tight), located(&free));
    // No transmitter is given more than it has.
    for way in ["up", "down"] {
        let mean = tight.number(&format!("/link/{way}/mean_bits_per_s"));
        assert!(mean <= 13_000.0, "{way}: {mean}");
    }
}

/// Less than this a scenario cannot ask for: states are fewer, and the mission is flown nevertheless.
#[test]
fn the_least_link_flies_safely() {
    let least = flown("[link]\nbits_per_s = 4_000\n");
    assert!(least.number("/safety/violations") < 0.5);
    assert_eq!(least.json["lost"], serde_json::json!([]));
    assert!(least.number("/sweep/coverage_fraction") > 0.999);
    let overflowed = least.number("/link/overflowed") / least.number("/link/frames");
    assert!(overflowed < 1e-3, "{overflowed}");
}
