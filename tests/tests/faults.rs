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
    assert_eq!(faults::fly(seed).end, faults::fly(seed).end);
    assert_ne!(faults::scenario(seed), faults::scenario(faults::seed_of(SEED, 4)));
}
