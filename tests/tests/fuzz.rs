//! Every fuzz target, for some seconds and always with the same inputs; `cargo xtask fuzz` goes on for as long as one likes.
#![allow(missing_docs)]

use skyroost_tests::fuzz::{
    Outcome, TARGETS,
    drive::{Until, drive, hex, replay, unhex},
    target,
};

/// Of every run of the checks.
const SEED: u64 = 1;

#[track_caller]
fn holds(name: &str) {
    let target = target(name).expect("a target");
    match drive(target, SEED, Until::Rounds(u64::from(target.rounds))) {
        Ok(driven) => {
            // A target that takes nothing looks at nothing.
            assert!(driven.accepted > 0, "{name}: nothing was accepted of {} inputs", driven.rounds);
        }
        Err(broken) => panic!("{broken}"),
    }
}

/// A test for each target, by its name.
macro_rules! each {
    ($($test:ident $name:literal,)*) => {
        $(#[test] fn $test() { holds($name); })*
        const TESTED: &[&str] = &[$($name),*];
    };
}

each! {
    frame "frame",
    body "body",
    sealed "sealed",
    stream "stream",
    management "management",
    bus "bus",
    lockstep "lockstep",
    autopilot "autopilot",
    inflight "inflight",
    provision "provision",
    agent "agent",
    area_geojson "area-geojson",
    area_kml "area-kml",
    area_plan "area-plan",
    area_csv "area-csv",
    obstacles "obstacles",
    fence "fence",
    scenario "scenario",
    users "users",
    captures "captures",
    located "located",
    located_geojson "located-geojson",
    keys "keys",
    campaign "campaign",
    manifest "manifest",
    block "block",
    encounter "encounter",
}

#[test]
fn every_target_is_tested_and_has_its_file_for_cargo_fuzz() {
    let names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
    assert_eq!(names, TESTED);
    let manifest = include_str!("../fuzz/Cargo.toml");
    for name in names {
        let file = format!("{}/fuzz/fuzz_targets/{name}.rs", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&file).expect("its file");
        assert!(text.contains(&format!("given(\"{name}\", bytes)")), "{file}");
        assert!(
            manifest.contains(&format!("name = \"{name}\"\npath = \"fuzz_targets/{name}.rs\"\n")),
            "{name}"
        );
    }
}

#[test]
fn every_seed_is_accepted() {
    // What nobody sealed is refused, and sealed management frames without the key.
    let mut refused = Vec::new();
    for target in TARGETS.iter().filter(|target| !["sealed", "management"].contains(&target.name)) {
        let target = crate::target(target.name).expect("a target");
        for (number, seed) in (target.seeds)().iter().enumerate() {
            if replay(target, seed) != Ok(Outcome::Accepted) {
                refused.push((target.name, number));
            }
        }
    }
    assert_eq!(refused, []);
}

#[test]
fn inputs_come_again_and_go_through_hexadecimal_digits() {
    let target = target("management").expect("a target");
    let driven = || drive(target, 7, Until::Rounds(3_000));
    assert_eq!(driven(), driven());
    let bytes: Vec<u8> = (0..=255).collect();
    assert_eq!(unhex(&hex(&bytes)), Some(bytes));
    assert_eq!((unhex("0"), unhex("0g")), (None, None));
}

#[test]
fn what_breaks_is_made_small_and_told_with_the_command_that_replays_it() {
    use skyroost_tests::fuzz::Target;
    static BRITTLE: Target = Target {
        name: "brittle",
        run: |bytes| {
            assert!(!bytes.contains(&b'!'), "a shout");
            Outcome::Accepted
        },
        seeds: || vec![b"quiet".to_vec()],
        words: &["!"],
        rounds: 0,
    };
    let broken = drive(&BRITTLE, 1, Until::Rounds(10_000)).expect_err("it shouts sooner or later");
    assert_eq!(broken.input, b"!");
    let told = broken.to_string();
    assert!(
        told.contains("a shout") && told.ends_with("cargo xtask fuzz --target brittle --hex 21"),
        "{told}"
    );
}
