//! `skyroost locate` as an operator and a script see it: exit status, stdout, stderr and files.

mod support;

use std::fs;
use std::process::Command;

use serde_json::Value;
use support::Bench;

const SAMPLE: &str = include_str!("../scenarios/captures.csv");
const HEADER: &str = "user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns\n";
const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/captures.py");

fn bench() -> Bench {
    Bench::of("locate").file("captures.csv", SAMPLE)
}

fn json(bench: &Bench, args: &[&str]) -> Value {
    let ran = bench.run(&[&["locate", "--json", "--captures"], args].concat());
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""), "{args:?}");
    serde_json::from_str(&ran.stdout).expect("one JSON object and nothing else")
}

fn python(bench: &Bench, args: &[&str]) -> (bool, String) {
    let ran = Command::new("python3").arg(SCRIPT).args(args).current_dir(bench.path("")).output();
    let ran = ran
        .expect("python3 checks the answers; `cargo xtask setup` or `apt-get install python3` installs it");
    let told = [ran.stdout, ran.stderr].concat();
    (ran.status.success(), String::from_utf8_lossy(&told).into_owned())
}

#[test]
fn help_shows_every_option_and_examples() {
    let ran = bench().run(&["locate", "--help"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn the_summary_says_who_is_where_and_how_sure_that_is() {
    let ran = bench().run(&["locate", "--captures", "captures.csv", "--clock", "shared-constant"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn json_has_the_keys_that_scripts_rely_on() {
    let answer = json(&bench(), &["captures.csv", "--clock", "shared-constant"]);
    let users = answer["users"].as_array().unwrap();
    let ids: Vec<_> = users.iter().map(|user| user["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["u1", "u2", "u3", "u4", "u5", "u6", "u7", "u8", "u9"]);
    for user in users {
        assert_eq!(user["status"], "ok");
        for key in ["x_m", "y_m", "r95_m"] {
            assert!(user[key].as_f64().is_some_and(f64::is_finite), "{key}: {user}");
        }
        let cov_m2: [[f64; 2]; 2] = serde_json::from_value(user["cov_m2"].clone()).unwrap();
        assert!(cov_m2[0][0] > 0.0 && (cov_m2[0][1] - cov_m2[1][0]).abs() < 1e-9, "{user}");
        assert!(user["occasions"].as_u64().unwrap() > 10 && user["rejected"].is_u64(), "{user}");
    }
    let clock = &answer["clock"];
    assert_eq!((&clock["model"], &clock["reference_drone"]), (&"shared-constant".into(), &"1".into()));
    assert_eq!((&clock["offset_ns"]["1"], &clock["drift_ns_per_s"]["1"]), (&0.0.into(), &0.0.into()));
    assert_eq!(clock["offset_ns"].as_object().unwrap().len(), 3);
    assert!(answer["warnings"].as_array().unwrap().iter().all(Value::is_string));
    assert_eq!(answer["origin"], Value::Null);
}

/// What a program that shares nothing with this one flies, it finds again, and solves for the same positions where
/// the question has a closed answer.
#[test]
fn truth_an_independent_flight_is_found_again() {
    for (case, questions) in [
        ("plain", &[&["--robust", "none"][..], &[]][..]),
        ("late", &[&[]]),
        ("constant", &[&["--clock", "shared-constant"], &["--clock", "shared-linear"]]),
        ("linear", &[&["--clock", "shared-linear"]]),
        ("five", &[&["--robust", "none"], &["--clock", "shared-constant"]]),
    ] {
        let bench = bench();
        let written = python(&bench, &["write", case, "1", "flown.csv", "truth.json"]);
        assert!(written.0, "{case}: {}", written.1);
        for options in questions {
            let ran = bench.run(&[&["locate", "--captures", "flown.csv", "--json"], *options].concat());
            assert_eq!(ran.code, Some(0), "{case}: {}", ran.stderr);
            fs::write(bench.path("answer.json"), ran.stdout).unwrap();
            let checked = python(&bench, &["check", "flown.csv", "truth.json", "answer.json"]);
            assert!(checked.0, "{case} {options:?}: {}", checked.1);
        }
    }
}

#[test]
fn the_sample_is_what_the_script_writes() {
    let bench = bench();
    assert_eq!(python(&bench, &["write", "sample", "1", "again.csv", "truth.json"]), (true, String::new()));
    assert_eq!(fs::read_to_string(bench.path("again.csv")).unwrap(), SAMPLE);
}

#[test]
fn neither_the_order_of_rows_nor_threads_change_a_byte() {
    let (header, rows) = SAMPLE.split_once('\n').unwrap();
    let mut rows: Vec<&str> = rows.lines().collect();
    rows.reverse();
    rows.rotate_left(100);
    let bench = bench().file("turned.csv", &format!("{header}\r\n{}\r\n", rows.join("\r\n")));
    let args = |file| ["locate", "--json", "--clock", "shared-linear", "--captures", file];
    let straight = bench.run(&args("captures.csv"));
    assert_eq!((straight.code, bench.run(&args("turned.csv")).stdout), (Some(0), straight.stdout.clone()));
    for threads in ["1", "3"] {
        let ran = bench.command(&args("captures.csv")).env("RAYON_NUM_THREADS", threads).output().unwrap();
        assert_eq!(String::from_utf8(ran.stdout).unwrap(), straight.stdout);
    }
}

#[test]
fn bad_rows_are_refused_with_their_line_and_leave_nothing() {
    let good = "u1,10,1,0,0,300,0,5\n";
    for (text, told) in [
        (String::new(), "line 1: found nothing, expected the header \"user,epoch_s,drone"),
        (HEADER.to_owned(), "line 1: found nothing after the header"),
        (format!("{good}{good}"), "line 1, the header: found \"u1\""),
        (HEADER.replace(",sigma_ns", ""), "line 1: found no column sigma_ns"),
        (format!("{HEADER}{good}u1,10,2,0,0,300,NaN,5\n"), "line 3, toa_ns: found \"NaN\""),
        (format!("{HEADER}{good}u1,10,2,0,0,300,inf,5\n"), "line 3, toa_ns: found \"inf\""),
        (format!("{HEADER}{good}u1,10,2,0,0,300,0,0\n"), "line 3, sigma_ns: found \"0\""),
        (format!("{HEADER}{good}u1,10,2,0,0,300,0,-1\n"), "line 3, sigma_ns: found \"-1\""),
        (format!("{HEADER}{good}u1,10,2,east,0,300,0,5\n"), "line 3, x_m: found \"east\""),
        (format!("{HEADER}{good}u1,10,2,0,0,300,0\n"), "line 3: found 7 fields"),
        (
            format!("{HEADER}{good}\r\n\r\nu1,10,1,0,0,300,1,5\n"),
            "line 5, toa_ns: found another value than in line 2",
        ),
        (format!("{HEADER}{good}u1,10,2,1e99,0,300,0,5\n"), "line 3, x_m: found \"1e99\""),
    ] {
        let bench = bench().file("bad.csv", &text);
        bench.refused(&["--captures", "bad.csv", "--out", "out"], &["error: bad.csv: ", told, "expected"]);
    }
    let bench = bench();
    fs::write(bench.path("photo.csv"), b"\xff\xd8\xff\xe0\0\n").unwrap();
    bench.refused(&["--captures", "photo.csv"], &["photo.csv: line 1, the header"]);
    bench.refused(&["--captures", "none.csv"], &["none.csv: No such file"]);
    bench.refused(&["--captures", "."], &[".: ", "directory"]);
}

#[test]
fn options_out_of_range_are_refused() {
    let bench = bench();
    bench.refused(&[], &["--captures"]);
    for (more, told) in [
        (["--clock", "perfect"], ["--clock", "shared-constant"]),
        (["--robust", "huber"], ["--robust", "tukey"]),
        (["--user-altitude-m", "nan"], ["--user-altitude-m", "finite"]),
        (["--user-altitude-m", "1e9"], ["--user-altitude-m: found 1000000000.0", "expected a number from"]),
        (["--drone-pos-sigma-m", "-1"], ["--drone-pos-sigma-m", "0 or more"]),
        (["--max-r95-m", "0"], ["--max-r95-m", "above 0"]),
        (["--max-r95-m", "1e300"], ["--max-r95-m: found 1e300", "expected a number from"]),
        (["--origin-lon-lat", "13"], ["--origin-lon-lat", "comma"]),
        (["--origin-lon-lat", "13,91"], ["--origin-lon-lat", "degrees"]),
    ] {
        bench.refused(&[&["--captures", "captures.csv", "--out", "out"], &more[..]].concat(), &told);
    }
    let bench = bench.file("file", "");
    bench.refused(&["--captures", "captures.csv", "--out", "file/out"], &["--out: file: cannot be written"]);
}

#[test]
fn files_appear_together() {
    let bench = bench();
    let locate = ["locate", "--captures", "captures.csv", "--clock", "shared-constant", "--json", "--out"];
    let ran = bench.run(&[&locate[..], &["a/b", "--origin-lon-lat", "13.74,51.05"]].concat());
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    assert_eq!(
        bench.names("a/b"),
        ["locate.json", "locate.svg", "located.csv", "users.csv", "users.geojson"]
    );
    assert_eq!(fs::read_to_string(bench.path("a/b/locate.json")).unwrap(), ran.stdout);
    let answer: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(answer["origin"], serde_json::json!({ "lon_deg": 13.74, "lat_deg": 51.05 }));
    let local = bench.run(&[&locate[..], &["local"]].concat());
    assert_eq!(
        (local.code, local.stderr.as_str()),
        (Some(0), "no users.geojson: it needs --origin-lon-lat\n")
    );
    assert_eq!(bench.names("local"), ["locate.json", "locate.svg", "located.csv", "users.csv"]);
    let quiet = bench.run(&[&locate[..], &["local", "--quiet"]].concat());
    assert_eq!((quiet.code, quiet.stderr.as_str()), (Some(0), ""));
}

#[test]
fn clocks_that_are_not_what_was_said_are_noticed() {
    let answer = json(&bench(), &["captures.csv"]);
    let warnings = answer["warnings"].to_string();
    assert!(warnings.contains("--clock shared-constant"), "{warnings}");
    let answer = json(&bench(), &["captures.csv", "--clock", "shared-constant"]);
    assert!(!answer["warnings"].to_string().contains("--clock"));
}

#[test]
fn nothing_is_lost_silently() {
    let rows = "lone,5,1,0,0,300,0,5\nlone,6,1,10,0,300,0,5\n\
                far,5,8,0,0,300,0,5\nfar,5,9,50,0,300,0,5\n\
                many,5,1,0,0,300,0,5\nmany,5,2,9,0,300,0,5\nmany,5,3,0,9,300,0,5\nmany,5,4,9,9,300,0,5\n\
                lone,5,1,0,0,300,0.0,5\n";
    let bench = bench().file("few.csv", &format!("{HEADER}{rows}"));
    let answer = json(&bench, &["few.csv", "--clock", "shared-constant"]);
    let warnings: Vec<String> = serde_json::from_value(answer["warnings"].clone()).unwrap();
    insta::assert_snapshot!(warnings.join("\n"));
    let users = answer["users"].as_array().unwrap();
    assert!(users.iter().all(|user| user["status"] != "ok"), "{users:?}");
    let lone = &users[1];
    assert_eq!((&lone["id"], &lone["status"]), (&"lone".into(), &"not_located".into()));
    for key in ["x_m", "y_m", "cov_m2", "r95_m"] {
        assert_eq!(lone.get(key), Some(&Value::Null), "{key}");
    }
    assert_eq!(
        (&answer["clock"]["offset_ns"]["1"], &answer["clock"]["offset_ns"]["9"]),
        (&0.0.into(), &Value::Null)
    );
}
