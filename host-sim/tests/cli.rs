//! The `skyroost` command as a script sees it: exit status, stdout, stderr and files.

mod support;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use support::Bench;

const RESULT_FILES: [&str; 5] =
    ["recording.json", "report.html", "summary.json", "trajectory.csv", "users.csv"];

#[test]
fn help_shows_every_option_and_examples() {
    let ran = Bench::of("mission").run(&["mission", "--help"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn help_of_the_command_lists_subcommands_and_exit_statuses() {
    let ran = Bench::of("mission").run(&["--help"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn version_is_the_packages() {
    let ran = Bench::of("mission").run(&["--version"]);
    assert_eq!((ran.code, ran.stdout), (Some(0), format!("skyroost {}\n", env!("CARGO_PKG_VERSION"))));
}

#[test]
fn wrong_usage_exits_2() {
    let bench = Bench::of("mission");
    for args in [&[][..], &["fly"], &["mission", "--sed", "1"], &["mission", "a.toml", "b.toml"]] {
        let ran = bench.run(args);
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""), "{args:?}");
    }
}

#[test]
fn options_with_values_out_of_range_are_refused() {
    let bench = Bench::of("mission");
    bench.refused(&["--seed", "-1"], &["--seed"]);
    bench.refused(&["--threads", "0"], &["--threads", "1..=1024"]);
    bench.refused(&["--threads", "100000000"], &["--threads"]);
    bench.refused(&["--drones", "0"], &["--drones", "fleet.drones", "found 0", "1 to 4096"]);
    bench.refused(&["--drones", "-3"], &["--drones", "-3"]);
    bench.refused(&["--drones", "4097"], &["--drones", "found 4097", "1 to 4096"]);
    bench.refused(&["--density-per-km2", "nan"], &["--density-per-km2", "found NaN"]);
    bench.refused(&["--density-per-km2", "-1"], &["--density-per-km2", "found -1"]);
    bench.refused(&["--loss-fraction", "1.5"], &["--loss-fraction", "from 0 to 1"]);
    bench.refused(&["--duration-s", "inf"], &["--duration-s", "found inf"]);
    bench.refused(&["--backend", "abacus"], &["--backend", "inproc, qemu or serial:"]);
}

#[test]
fn what_is_said_about_boards_must_fit_together() {
    let bench = Bench::of("mission");
    for (option, value) in [("--board-image", "image"), ("--board-log", "logs")] {
        let told = [option, "expected --backend qemu"];
        bench.refused(&[option, value], &told);
        bench.refused(&["--backend", "serial:/dev/null", option, value], &told);
    }
    for backend in ["serial", "serial:", "serial:/dev/null,", "qemu:", "QEMU"] {
        bench.refused(&["--backend", backend], &[backend, "inproc, qemu or serial:"]);
    }
}

#[test]
fn an_image_that_is_not_there_is_named() {
    let bench = Bench::of("mission");
    let boards = ["--backend", "qemu", "--board-image"];
    bench.refused(&[&boards[..], &["none/image"]].concat(), &["--board-image", "none/image", "No such file"]);
    bench.refused(&[&boards[..], &["."]].concat(), &["--board-image", "directory"]);
    let with_logs = ["--board-log", "logs/today"];
    bench.refused(&[&boards[..], &["none/image"], &with_logs].concat(), &["none/image"]);
}

#[test]
fn a_folder_for_logs_that_cannot_be_is_refused_before_anything_starts() {
    let bench = Bench::of("mission").file("file", "");
    // Had anything been started, the missing image would have been told.
    let boards = ["--backend", "qemu", "--board-image", "none", "--board-log"];
    bench.refused(&[&boards[..], &["file"]].concat(), &["--board-log: file: cannot be written"]);
    bench.refused(&[&boards[..], &["file/logs"]].concat(), &["--board-log: file: cannot be written"]);
    bench.refused(&[&boards[..], &["/proc/logs"]].concat(), &["--board-log: /proc/logs: cannot be written"]);
}

#[test]
fn ports_must_be_as_many_as_drones() {
    let bench = Bench::of("mission");
    bench.refused(&["--backend", "serial:a,b"], &["--backend", "found 2 serial port(s) for 6 drones"]);
    bench
        .refused(&["--backend", "serial:a,b,c,d", "--drones", "3"], &["found 4 serial port(s) for 3 drones"]);
}

#[test]
fn a_port_that_is_not_there_is_a_board_that_failed() {
    let bench = Bench::of("mission").file("file", "");
    for (ports, told) in [
        ("/dev/none-1,/dev/none-2,/dev/none-3", ["board of drone 1", "/dev/none-1"]),
        ("file,/dev/none-2,/dev/none-3", ["board of drone 1", "file"]),
    ] {
        let backend = format!("serial:{ports}");
        let ran = bench.run(&["mission", "--drones", "3", "--backend", &backend]);
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(4), ""), "{}", ran.stderr);
        for told in told {
            assert!(ran.stderr.contains(told), "{told:?} is not in: {}", ran.stderr);
        }
        assert_eq!(bench.names("."), ["file"]);
    }
}

#[test]
fn a_missing_scenario_is_named() {
    Bench::of("mission").refused(&["none.toml"], &["none.toml", "No such file"]);
}

#[test]
fn a_scenario_that_is_no_text_is_named() {
    let bench = Bench::of("mission");
    fs::write(bench.path("photo.toml"), [0xff, 0xd8, 0xff, 0xe0]).expect("an input file");
    bench.refused(&["photo.toml"], &["photo.toml", "UTF-8"]);
}

#[test]
fn an_unknown_key_is_named_with_its_line() {
    let bench = Bench::of("mission").file("host.toml", "name = 'x'\n\n[fleet]\ndronez = 6\n");
    bench.refused(
        &["host.toml"],
        &["host.toml:4: fleet.dronez: found an unknown key, expected one of `drones`"],
    );
}

#[test]
fn zero_drones_are_named_with_their_line() {
    let bench = Bench::of("mission").file("host.toml", "# a\n[fleet]\ndrones = 0\n");
    bench.refused(&["host.toml"], &["error: host.toml:3: fleet.drones: found 0, expected 1 to 4096\n"]);
}

#[test]
fn more_drones_than_ids_are_refused() {
    let bench = Bench::of("mission").file("host.toml", "[fleet]\ndrones = 4097\n");
    bench.refused(&["host.toml"], &["host.toml:2: fleet.drones: found 4097, expected 1 to 4096"]);
}

#[test]
fn numbers_that_are_none_and_negative_radii_are_refused() {
    let bench = Bench::of("mission")
        .file("nan.toml", "[fleet]\nradius_m = nan\n")
        .file("neg.toml", "[fleet]\nradius_m = -1\n");
    bench.refused(&["nan.toml"], &["nan.toml:2: fleet.radius_m: found NaN"]);
    bench.refused(&["neg.toml"], &["neg.toml:2: fleet.radius_m: found -1"]);
}

#[test]
fn a_missing_area_or_users_file_is_named() {
    let bench = Bench::of("mission").file("host.toml", "[area]\nfile = 'gone.csv'\n");
    bench.refused(&["host.toml"], &["gone.csv", "No such file"]);
    bench.refused(&["--area", "none.csv"], &["none.csv", "No such file"]);
    bench.refused(&["--users", "none.csv"], &["none.csv", "No such file"]);
}

#[test]
fn a_wrong_header_is_named() {
    let bench = Bench::of("mission").file("bad.csv", "lon,lat\n1,2\n3,4\n5,6\n");
    bench.refused(&["--area", "bad.csv"], &["bad.csv", "lon,lat", "x_m,y_m"]);
    bench.refused(&["--users", "bad.csv"], &["bad.csv", "lon,lat", "x_m,y_m"]);
}

#[test]
fn a_fault_in_an_area_on_earth_is_named_with_its_place() {
    let ring = "13.7,51.0 13.8,51.0 13.8,51.1";
    let kml = |ring: &str| {
        format!(
            "<kml>\n<Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates>\
             </LinearRing></outerBoundaryIs></Polygon></Placemark>\n</kml>"
        )
    };
    let plan = r#"{"fileType":"Plan","mission":{"items":[{"complexItemType":"survey",
        "polygon":[[51.0,13.7],[51.0,13.8],[51.1,13.7],[51.1,13.8]]}]}}"#;
    let bench = Bench::of("mission")
        .file("open.kml", &kml(ring))
        .file("pole.kml", &kml("0,89 120,89 -120,89 0,89"))
        .file("bow.plan", plan)
        .file("zip.kmz", "PK")
        .file("two.json", r#"{"type":"GeometryCollection","geometries":[]}"#);
    bench.refused(&["--area", "open.kml"], &["open.kml: placemark (line 2)", "vertex 3", "unclosed"]);
    bench.refused(&["--area", "pole.kml"], &["a ring around the north pole"]);
    bench.refused(
        &["--area", "bow.plan"],
        &["the survey (mission item 1): the edge from vertex 2", "vertex 4"],
    );
    bench.refused(&["--area", "zip.kmz"], &["zip.kmz", "unzip"]);
    bench.refused(&["--area", "two.json"], &["two.json", "a GeometryCollection"]);
}

#[test]
fn empty_files_and_coordinates_that_are_no_numbers_are_refused() {
    let bench = Bench::of("mission")
        .file("nan.csv", "x_m,y_m\n0,0\n5000,0\n5000,NaN\n")
        .file("word.csv", "x_m,y_m\n0,0\n5000,far\n0,5000\n")
        .file("head.csv", "x_m,y_m\n")
        .file("none.csv", "");
    for option in ["--area", "--users"] {
        bench.refused(&[option, "nan.csv"], &["nan.csv", "4", "y_m", "NaN"]);
        bench.refused(&[option, "word.csv"], &["word.csv", "3", "y_m", "far"]);
        bench.refused(&[option, "head.csv"], &["head.csv"]);
        bench.refused(&[option, "none.csv"], &["none.csv"]);
    }
}

#[test]
fn fewer_than_three_drones_are_infeasible() {
    let bench = Bench::of("mission");
    let ran = bench.run(&["mission", "--drones", "2"]);
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(3), ""));
    assert!(ran.stderr.contains("a fleet needs 3"), "{}", ran.stderr);
    assert!(bench.names(".").is_empty());
}

#[test]
fn an_out_directory_that_cannot_be_is_refused_before_flying() {
    let bench = Bench::of("mission").file("file", "");
    bench.refused(&["--out", "file/out"], &["--out: file: cannot be written"]);
    bench.refused(&["--out", "file"], &["--out: file: cannot be written"]);
}

/// A scenario without limits, so that the outcome of the mission does not matter, cut off early.
const SHORT: &str = "[mission]\nduration_s = 20\n";

#[test]
fn json_is_one_object_and_nothing_else_and_the_files_appear() {
    let bench = Bench::of("mission").file("short.toml", SHORT);
    let ran = bench.run(&["mission", "short.toml", "--json", "--quiet"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    let summary: serde_json::Value = serde_json::from_str(&ran.stdout).expect("one JSON object");
    for (table, field) in [
        ("sweep", "coverage_fraction"),
        ("localization", "crlb_ratio"),
        ("placement", "served_guaranteed"),
        ("safety", "min_separation_m"),
        ("link", "rejected"),
        ("timing", "realtime_factor"),
    ] {
        assert!(summary[table].get(field).is_some(), "{table}.{field}");
    }
    assert_eq!(bench.names("skyroost-out"), RESULT_FILES);
    let written = fs::read_to_string(bench.path("skyroost-out/summary.json")).expect("the summary");
    assert_eq!(written, ran.stdout);
}

#[test]
fn a_failed_limit_exits_1_with_results() {
    let bench =
        Bench::of("mission").file("strict.toml", &format!("{SHORT}[limits]\ncoverage_fraction_min = 1\n"));
    let ran = bench.run(&["mission", "strict.toml", "--out", "deep/er"]);
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    assert!(ran.stdout.contains("FAIL  coverage_fraction_min"), "{}", ran.stdout);
    assert!(ran.stdout.contains("deep/er/report.html"), "{}", ran.stdout);
    assert_eq!(bench.names("deep/er"), RESULT_FILES);
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let bench = Bench::of("mission").file("short.toml", SHORT);
    for args in [&["--help"][..], &["mission", "short.toml", "--json"]] {
        let mut child = bench
            .command(args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts");
        drop(child.stdout.take());
        let ran = child.wait_with_output().expect("the command ends");
        let stderr = String::from_utf8_lossy(&ran.stderr);
        assert_eq!(ran.status.code(), Some(0), "{stderr}");
        assert!(!stderr.contains("panicked"), "{stderr}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_stdout_is_an_error_and_no_panic() {
    let bench = Bench::of("mission").file("short.toml", SHORT);
    let full = fs::File::options().write(true).open("/dev/full").expect("/dev/full");
    let ran = bench.command(&["mission", "short.toml"]).stdout(full).output().expect("the command runs");
    let stderr = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("error: stdout"), "{stderr}");
}

#[test]
#[cfg(unix)]
fn an_interrupt_exits_130_and_leaves_nothing() {
    let bench = Bench::of("mission");
    for signal in ["-INT", "-TERM"] {
        let child = bench
            .command(&["mission"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts");
        // The directory appears just before the mission flies, after the handler is in place.
        wait_for(&bench.path("skyroost-out"));
        let killed = Command::new("kill").args([signal, &child.id().to_string()]).status();
        assert!(killed.is_ok_and(|status| status.success()));
        let ran = child.wait_with_output().expect("the command ends");
        assert_eq!(ran.status.code(), Some(130));
        assert!(ran.stdout.is_empty());
        assert!(bench.names(".").is_empty(), "{:?}", bench.names("."));
    }
}

fn wait_for(path: &Path) {
    for _ in 0..1000 {
        if path.exists() {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    panic!("{} does not appear", path.display());
}
