//! `skyroost accuracy` as an operator and a script see it, and the page in `docs/` that it writes.

mod support;

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use support::Bench;

/// What the hand-written part of the page ends with.
const MARK: &str = "<!-- From here on: `skyroost accuracy --out DIR`, accuracy.md. -->\n";
/// Set, the page is written instead of compared.
const UPDATE: &str = "SKYROOST_UPDATE_DOCS";

fn docs(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name)
}

#[test]
fn the_page_in_docs_is_what_the_command_writes() {
    let bench = Bench::of("accuracy");
    let ran = bench.run(&["accuracy", "--out", "out", "--quiet"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    assert_eq!(bench.names("out"), ["accuracy.json", "accuracy.md", "accuracy.svg"]);
    let written = |name| fs::read_to_string(bench.path("out").join(name)).unwrap();
    let page = fs::read_to_string(docs("localization.md")).unwrap();
    let (by_hand, tables) =
        page.split_once(MARK).expect("the mark between what is written by hand and what is not");
    if std::env::var_os(UPDATE).is_some() {
        fs::write(docs("localization.md"), [by_hand, MARK, "\n", &written("accuracy.md")].concat()).unwrap();
        fs::write(docs("localization.svg"), written("accuracy.svg")).unwrap();
        return;
    }
    let plot = fs::read_to_string(docs("localization.svg")).unwrap();
    let told =
        format!("docs/localization.* are stale: `{UPDATE}=1 cargo test --test accuracy` writes them anew");
    assert!(tables.trim_start() == written("accuracy.md"), "{told}");
    assert!(plot == written("accuracy.svg"), "{told}");
}

#[test]
fn help_shows_every_option_and_examples() {
    let ran = Bench::of("accuracy").run(&["accuracy", "--help"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn the_tables_for_people() {
    let ran = Bench::of("accuracy").run(&["accuracy", "--spacing-m", "100", "--srs-period-s", "2"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn json_has_the_keys_that_scripts_rely_on() {
    let bench = Bench::of("accuracy");
    let ran = bench.run(&["accuracy", "--json", "--sigma-ns", "1", "--out", "out"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    assert_eq!(fs::read_to_string(bench.path("out/accuracy.json")).unwrap(), ran.stdout);
    let study: Value = serde_json::from_str(&ran.stdout).expect("one JSON object and nothing else");
    assert_eq!((&study["spacing_m"], &study["sigma_ns"]), (&50.0.into(), &1.0.into()));
    let offsets = study["offset_m"].as_array().unwrap().len();
    assert_eq!((offsets, &study["srs"][0]), (10, &95.into()));
    for rows in ["sigma", "sync", "drone_bias", "terrain"] {
        for row in study[rows].as_array().unwrap() {
            let r95_m = row["r95_m"].as_array().unwrap();
            assert!(r95_m.len() == offsets && r95_m.iter().all(Value::is_f64), "{rows}: {row}");
        }
    }
    // Figures known independently, for a nanosecond.
    assert!((study["one_srs"]["r95_m"][0].as_f64().unwrap() - 6.3).abs() < 0.05);
    assert!((study["pass"]["r95_m"][0].as_f64().unwrap() - 0.95).abs() < 0.005);
    for cell in study["trade_off"].as_array().unwrap() {
        assert!(cell["r95_median_m"].as_f64().unwrap() <= cell["r95_worst_m"].as_f64().unwrap(), "{cell}");
    }
}

#[test]
fn threads_change_no_byte() {
    let bench = Bench::of("accuracy");
    let json = |threads| {
        let ran = bench.command(&["accuracy", "--json"]).env("RAYON_NUM_THREADS", threads).output().unwrap();
        String::from_utf8(ran.stdout).unwrap()
    };
    assert_eq!(json("1"), json("3"));
}

#[test]
fn options_out_of_range_are_refused() {
    let bench = Bench::of("accuracy");
    for (args, told) in [
        (&["--spacing-m", "0"][..], "--spacing-m"),
        (&["--altitude-m", "nan"], "--altitude-m"),
        (&["--sigma-ns", "-5"], "--sigma-ns"),
        (&["--sigma-ns", "1e9"], "--sigma-ns: found 1000000000.0, expected a time"),
        (&["--radius-m", "1e-3"], "--radius-m: found 0.001, expected a length"),
        (&["--spacing-m", "900"], "--spacing-m: found 900.0, expected at most 865.9"),
        (&["--speed-mps", "0.01"], "--speed-mps, --srs-period-s: found 0.01 m from one SRS to the next"),
    ] {
        bench.refused(&[args, &["--out", "out"]].concat(), &[told, "expected"]);
    }
    let bench = bench.file("file", "");
    bench.refused(&["--out", "file/out"], &["--out: file: cannot be written"]);
}
