//! The fault campaign: whole missions to which random things happen, watched second by second.

use skyroost_tests::faults::{self, End};

/// Missions of every check; `cargo xtask faults --missions 5000` flies more.
const MISSIONS: u64 = 500;
const SEED: u64 = 1;

#[test]
fn five_hundred_missions_keep_every_invariant() {
    let flown = faults::campaign(MISSIONS, SEED, &|ended, _| {
        if ended.is_multiple_of(50) {
            eprintln!("{ended} of {MISSIONS} missions");
        }
    });
    let mut completed = 0;
    let mut failures = String::new();
    for one in &flown {
        match &one.end {
            End::Completed => completed += 1,
            End::EndedSafe(_) => {}
            End::Failed { invariant, at_s } => {
                let replay = faults::replay(one.seed);
                failures.push_str(&format!(
                    "seed {} at {at_s:.1} s: {invariant}\n  replay: {replay}\n",
                    one.seed
                ));
            }
        }
    }
    assert!(failures.is_empty(), "{failures}");
    // What happens must not be so much that all there is to see is its end.
    assert!(completed >= MISSIONS * 3 / 4, "{completed} of {MISSIONS} missions were completed");
}

#[test]
fn a_mission_of_a_seed_is_the_same_again() {
    let seed = faults::seed_of(SEED, 3);
    assert_eq!(faults::scenario(seed), faults::scenario(seed));
    let (one, again) = (faults::fly(seed), faults::fly(seed));
    assert!(one.digest.is_some() && one.digest == again.digest && one.end == again.end, "{one:?} {again:?}");
    assert_ne!(faults::scenario(seed), faults::scenario(faults::seed_of(SEED, 4)));
}

/// Missions in which drones came too near to each other once, while the control center was dead: two on ways that crossed, and one that came
/// back to the place it had left to let another pass.
#[test]
fn missions_that_failed_once() {
    for seed in [3_603_048_106_526_059, 862_620_598_252_155, 994_375_879_259_768] {
        let flown = faults::fly(seed);
        assert_eq!(flown.end, End::Completed, "{}", faults::replay(seed));
    }
}
