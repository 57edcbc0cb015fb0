//! `skyroost keys` as an operator sees it: what is made, who may read it, and what is never shown.

mod support;

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use serde_json::Value;
use skyroost_firmware::board::provision::{PROVISION_LEN, Provision};
use support::Bench;

fn bench() -> Bench {
    let bench = Bench::of("keys");
    let ran = bench.run(&["keys", "new", "--drones", "3", "--out", "fleet.keys"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    bench
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

/// The keys of a file as it stands.
fn keys(bench: &Bench) -> Vec<String> {
    let text = fs::read_to_string(bench.path("fleet.keys")).unwrap();
    let quoted = |line: &str| line.strip_prefix("key = \"")?.strip_suffix('"').map(str::to_owned);
    text.lines().filter_map(quoted).collect()
}

fn shown(bench: &Bench) -> Value {
    let ran = bench.run(&["keys", "show", "fleet.keys", "--json"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    serde_json::from_str(&ran.stdout).expect("one JSON object and nothing else")
}

#[test]
fn help_shows_every_option_and_examples() {
    let ran = Bench::of("keys").run(&["keys", "--help"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn keys_are_fresh_for_the_owner_alone_and_never_shown() {
    let bench = bench();
    let made = keys(&bench);
    assert_eq!(mode(&bench.path("fleet.keys")), 0o600);
    assert!(made.len() == 3 && made.iter().all(|key| key.len() == 64));
    assert!(made[0] != made[1] && made[1] != made[2]);
    let text = bench.run(&["keys", "show", "fleet.keys"]).stdout;
    let drones = shown(&bench)["drones"].as_array().unwrap().clone();
    assert_eq!(drones.len(), 3);
    for (key, drone) in made.iter().zip(&drones) {
        let fingerprint = drone["fingerprint"].as_str().unwrap();
        assert!(text.contains(fingerprint));
        assert!(!text.contains(&key[..8]) && !key.contains(fingerprint));
    }
    // What is there is not touched.
    bench.refused(&["new", "--drones", "3", "--out", "fleet.keys"], &["is there already"]);
    assert_eq!(keys(&bench), made);
}

#[test]
fn a_file_that_others_can_read_and_one_of_something_else_are_refused() {
    let bench = bench().file("users.csv", "x_m,y_m\n1,2\n");
    fs::set_permissions(bench.path("users.csv"), Permissions::from_mode(0o600)).unwrap();
    bench.refused(&["show", "users.csv"], &["users.csv", "line 1"]);
    fs::set_permissions(bench.path("fleet.keys"), Permissions::from_mode(0o640)).unwrap();
    bench.refused(&["show", "fleet.keys"], &["mode 640", "chmod 600"]);
}

#[test]
fn what_is_wrong_is_named_and_no_key_is_repeated() {
    let bench = bench();
    let text = fs::read_to_string(bench.path("fleet.keys")).unwrap();
    let key = &keys(&bench)[1];
    for (from, to, expected) in [
        (key.as_str(), &key[..63], "drone 2"),
        ("id = 3", "id = 2", "drone 2"),
        ("id = 3", "id = 0", "drone 0"),
        ("format = 1", "format = 7", "format 7, expected 1"),
        ("format = 1", "format = 1\nsecret = 1", "line 3"),
        ("control_boots = 0", "control_boots = -1", "line 3"),
        ("id = 2", &format!("id = \"{key}\""), "line 11"),
        ("id = 2", &format!("{key} = 2"), "line 11"),
        ("id = 2", &format!("id = 2\n{}\\\"{key}", "x = \""), "line 12"),
        ("control_key = \"", "control_key = \"0", "control_key is none"),
    ] {
        fs::write(bench.path("fleet.keys"), text.replacen(from, to, 1)).unwrap();
        let ran = bench.run(&["keys", "show", "fleet.keys"]);
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""), "{to}");
        assert!(ran.stderr.contains(expected), "{}", ran.stderr);
        assert!(!ran.stderr.contains(&key[..16]), "{}", ran.stderr);
    }
}

#[test]
fn a_drone_is_given_its_key_or_an_open_link() {
    let bench = bench();
    let given = |out: &str, more: &[&str]| {
        let ran =
            bench.run(&[&["keys", "export", "fleet.keys", "--drone", "2", "--out", out], more].concat());
        assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
        assert_eq!(mode(&bench.path(out)), 0o600);
        let bytes: [u8; PROVISION_LEN] = fs::read(bench.path(out)).unwrap().try_into().unwrap();
        (Provision::read(&bytes).expect("what a board reads"), ran.stdout)
    };
    let (sealed, _) = given("drone-2.bin", &[]);
    let key = sealed.key.expect("a key");
    let hex: String = key.expose().iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!((sealed.drone.0, &hex), (2, &keys(&bench)[1]));
    let (open, said) = given("open.bin", &["--unauthenticated"]);
    assert_eq!((open.drone.0, open.key), (2, None));
    assert!(said.contains("OPEN LINK"));
    bench.refused(&["export", "fleet.keys", "--drone", "9", "--out", "nine.bin"], &["no key for drone 9"]);
}

fn export(bench: &Bench, out: &str) -> support::Ran {
    bench.run(&["keys", "export", "fleet.keys", "--drone", "2", "--out", out])
}

/// Whether each was exported, by `keys show`.
fn exported(bench: &Bench) -> Vec<bool> {
    let drones = shown(bench)["drones"].as_array().unwrap().clone();
    drones.iter().map(|drone| drone["exported"].as_bool().unwrap()).collect()
}

#[test]
fn a_key_is_exported_once_and_then_another() {
    let bench = bench();
    assert_eq!(exported(&bench), [false; 3]);
    assert_eq!(export(&bench, "first.bin").code, Some(0));
    assert_eq!(exported(&bench), [false, true, false]);
    assert_eq!(bench.run(&["keys", "show", "fleet.keys"]).stdout.matches("exported").count(), 1);
    let text = fs::read(bench.path("fleet.keys")).unwrap();
    bench.refused(
        &["export", "fleet.keys", "--drone", "2", "--out", "again.bin"],
        &["the key of drone 2 was exported already", "keys renew"],
    );
    assert!(!bench.path("again.bin").exists());
    assert_eq!(fs::read(bench.path("fleet.keys")).unwrap(), text);
    // An open link repeats nothing, and says nothing of the key.
    let open = ["keys", "export", "fleet.keys", "--drone", "2", "--out", "open.bin", "--unauthenticated"];
    assert_eq!(bench.run(&open).code, Some(0));
    assert_eq!(bench.run(&["keys", "renew", "fleet.keys", "--drone", "2"]).code, Some(0));
    assert_eq!(exported(&bench), [false; 3]);
    assert_eq!(export(&bench, "second.bin").code, Some(0));
    assert_ne!(fs::read(bench.path("first.bin")).unwrap(), fs::read(bench.path("second.bin")).unwrap());
    assert_eq!(mode(&bench.path("fleet.keys")), 0o600);
}

#[test]
fn an_export_that_cannot_be_written_has_given_nothing() {
    let bench = bench().file("taken.bin", "");
    let text = fs::read(bench.path("fleet.keys")).unwrap();
    for (out, expected) in [("taken.bin", "is there already"), ("nowhere/drone-2.bin", "No such file")] {
        bench.refused(&["export", "fleet.keys", "--drone", "2", "--out", out], &[out, expected]);
        assert_eq!(fs::read(bench.path("fleet.keys")).unwrap(), text);
    }
    assert_eq!(export(&bench, "drone-2.bin").code, Some(0));
}

#[test]
fn a_renewed_key_is_another() {
    let bench = bench();
    let before = keys(&bench);
    assert_eq!(bench.run(&["keys", "renew", "fleet.keys", "--drone", "2"]).code, Some(0));
    let after = keys(&bench);
    assert_eq!((&after[0], &after[2]), (&before[0], &before[2]));
    assert_ne!(after[1], before[1]);
    assert_eq!(mode(&bench.path("fleet.keys")), 0o600);
}

/// Every start of a control center has an epoch of its own, and drones without a key are named before anything flies.
#[test]
fn a_mission_spends_a_boot_of_the_control_center() {
    let bench = bench();
    let fly = |drones: &str| {
        let limits = ["--duration-s", "5", "--density-per-km2", "0", "--json", "--out", "out"];
        bench.run(&[&["mission", "--keys", "fleet.keys", "--drones", drones][..], &limits].concat())
    };
    for boots in 1..=2 {
        let ran = fly("3");
        assert!(matches!(ran.code, Some(0 | 1)), "{}", ran.stderr); // no limit is met so soon
        let summary: Value = serde_json::from_str(&ran.stdout).unwrap();
        assert_eq!(summary["link"]["authenticated"], true);
        assert_eq!(shown(&bench)["control_boots"], boots);
    }
    let ran = fly("4");
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""));
    assert!(ran.stderr.contains("no key for drone 4"), "{}", ran.stderr);
    assert_eq!(shown(&bench)["control_boots"], 2);
}

#[test]
fn doing_without_keys_is_said_in_every_summary() {
    let bench = Bench::of("keys");
    let args =
        ["mission", "--unauthenticated", "--duration-s", "5", "--density-per-km2", "0", "--out", "out"];
    let ran = bench.run(&args);
    assert!(matches!(ran.code, Some(0 | 1)), "{}", ran.stderr); // no limit is met so soon
    assert!(ran.stdout.contains("UNAUTHENTICATED"), "{}", ran.stdout);
    let summary: Value = serde_json::from_slice(&fs::read(bench.path("out/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["link"]["authenticated"], false);
    assert!(fs::read_to_string(bench.path("out/report.html")).unwrap().contains("authenticated"));
}
