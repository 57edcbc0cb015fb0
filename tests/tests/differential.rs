//! The same bits: flight code in this process and on an emulated board take in the same and are held against each
//! other after every step, bit for bit.
//!
//! A random flight that differs is kept in `differential.proptest-regressions`, to be committed: every later run
//! begins with it. `cargo test --package skyroost-tests --test differential` is all it takes to replay it.

#[path = "differential/pair.rs"]
mod pair;
#[path = "differential/random.rs"]
mod random;
#[path = "differential/recorded.rs"]
mod recorded;

use pair::Pair;
use proptest::test_runner::{Config, FileFailurePersistence, TestCaseError, TestRunner};
use skyroost_firmware::counters::Counters;
use skyroost_protocol::message::FlightPhase;
use std::{cell::RefCell, collections::BTreeSet, fs};

const REPLAY: &str = "replay: cargo test --package skyroost-tests --test differential";

#[test]
fn a_recorded_mission() {
    let area = tempfile::NamedTempFile::with_suffix(".csv").expect("a file");
    fs::write(area.path(), "x_m,y_m\n0,0\n1200,0\n1200,1000\n0,1000\n").expect("an input file");
    let area = area.path().to_str().expect("a path in UTF-8");
    let words = ["--area", area, "--drones", "3", "--loss-fraction", "0.05", "--density-per-km2", "40"];
    for recording in recorded::record(&words, 3) {
        let mut pair = Pair::new(recording.config, recording.key);
        for (now, inputs) in &recording.steps {
            pair.step(*now, inputs).unwrap_or_else(|what| panic!("{what}\n{REPLAY}"));
        }
        pair.end().unwrap_or_else(|what| panic!("{what}\n{REPLAY}"));
        use FlightPhase::{GoTo, Grounded, Hold, Serve, Sweep, TakeOff};
        assert_eq!(pair.phases, [Grounded, TakeOff, Hold, Sweep, Hold, GoTo, Serve], "a whole mission");
    }
}

#[test]
fn random_flights() {
    let kept = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/differential.proptest-regressions");
    let config = Config {
        cases: 48,
        failure_persistence: Some(Box::new(FileFailurePersistence::Direct(kept))),
        source_file: Some(file!()),
        test_name: Some("random_flights"),
        max_shrink_time: 120_000, // ms
        ..Config::default()
    };
    let seen = RefCell::new((BTreeSet::new(), [0_u64; Counters::COUNT]));
    let outcome = TestRunner::new(config).run(&random::script(), |script| {
        let (counters, pair) = script.fly().map_err(TestCaseError::fail)?;
        let (phases, counts) = &mut *seen.borrow_mut();
        phases.extend(pair.phases.iter().map(|phase| *phase as u32));
        for (sum, count) in counts.iter_mut().zip(counters.to_array()) {
            *sum += u64::from(count);
        }
        Ok(())
    });
    outcome.unwrap_or_else(|failure| panic!("{failure}\n{REPLAY}"));
    let (phases, counts) = seen.into_inner();
    assert!(phases.len() >= 6, "most phases were flown: {phases:?}");
    assert!(counts.iter().filter(|count| **count > 0).count() >= 6, "much was dropped: {counts:?}");
}

#[test]
fn floods() {
    let counters = random::flood().unwrap_or_else(|what| panic!("{what}\n{REPLAY}"));
    for (what, count) in [
        ("frames without room", counters.frames_overflowed),
        ("SRS occasions without room", counters.srs_overflowed),
        ("neighbours without room", counters.peers_evicted),
        ("unknown captures", counters.captures_unknown),
    ] {
        assert!(count > 0, "no {what}: {counters:?}");
    }
}
