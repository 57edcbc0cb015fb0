//! The mission report in a real browser: it loads, plays, and lets no text of a mission run as script.
//! Screenshots are left in `target/report-screenshots/` for people to look at.

#[path = "report_browser/staged.rs"]
mod staged;

use std::{fs, path::PathBuf};

use serde_json::Value;
use skyroost_host_sim::{
    recording::{EventRecord, Recording},
    report::html::render,
};
use skyroost_tests::{
    report_check::{check_open_report, check_report, state},
    webdriver::{Browser, Window, keys},
};
use tempfile::TempDir;

const HOSTILE: &str =
    "</script><script>window.pwned=1</script><img src=x onerror='window.pwned=1'>{{script}}<!--";

fn screenshot(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../target/report-screenshots").join(name)
}

/// A report on disk, gone with the value.
struct Report {
    folder: TempDir,
}

impl Report {
    fn of(recording: &Recording, summary: &Value) -> Self {
        let folder = TempDir::with_prefix("skyroost-report-").expect("a temporary folder can be made");
        fs::write(folder.path().join("report.html"), render(recording, summary))
            .expect("a report can be written");
        Self { folder }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("report.html")
    }
}

#[test]
fn a_large_mission_loads_plays_and_stays_small() {
    let recording = staged::recording(5_000);
    let report = Report::of(&recording, &staged::summary(&recording));
    let size = fs::metadata(report.path()).expect("the report is there").len();
    assert!(size < 1_500_000, "{size} bytes");
    check_report(&report.path(), &screenshot("large.png"));
}

#[test]
fn a_mission_shows_its_users_as_the_slider_passes_them() {
    let recording = staged::recording(500);
    let report = Report::of(&recording, &staged::summary(&recording));
    let browser = Browser::start(Window::default());
    browser.open(&report.path());
    assert_eq!(browser.title(), "staged · skyroost mission report");

    let at_end = state(&browser);
    assert_eq!(at_end["users"]["pending"], 0, "every user is known at the end");
    assert!(
        at_end["drones"].as_array().is_some_and(|all| all.iter().all(|drone| drone["on_station"] == true))
    );
    browser.screenshot(&screenshot("end.png"));

    let slider = browser.find("#time");
    browser.type_keys(&slider, keys::HOME);
    let at_start = state(&browser);
    assert_eq!(at_start["users"]["pending"], 500, "no user is known at the start");
    assert_eq!(at_start["phase"], "Take-off and transit");
    browser.click(&slider);
    let in_sweep = state(&browser);
    let pending = in_sweep["users"]["pending"].as_u64().expect("users are counted");
    assert!((100..400).contains(&pending), "{pending} of 500 pending in mid-sweep");
    assert_eq!(in_sweep["users"]["guaranteed"], 0, "no one is served during the sweep");
    browser.screenshot(&screenshot("sweep.png"));
    check_open_report(&browser);
}

#[test]
fn dark_colours_are_used_where_the_reader_wants_them() {
    let mut recording = staged::recording(500);
    recording.uncovered_m = vec![vec![[9300.0, 4800.0], [10_000.0, 4700.0], [10_000.0, 5600.0]]];
    let report = Report::of(&recording, &staged::summary(&recording));
    let browser = Browser::start(Window { dark: true, ..Window::default() });
    browser.open(&report.path());
    assert_eq!(browser.eval("return matchMedia('(prefers-color-scheme: dark)').matches"), true);
    let paper = browser.eval("return getComputedStyle(document.body).backgroundColor");
    assert_eq!(paper, "rgb(18, 22, 26)");
    check_open_report(&browser);
    browser.click(&browser.find("#time"));
    browser.screenshot(&screenshot("dark.png"));
}

#[test]
fn hostile_text_stays_text() {
    let mut recording = staged::recording(50);
    recording.scenario = HOSTILE.into();
    recording.users[0].id = HOSTILE.into();
    recording.phases[1].name = format!("Sweep {HOSTILE}");
    recording.events.push(EventRecord { t_s: 10.0, drone: Some(1), text: HOSTILE.into() });
    let mut summary = staged::summary(&recording);
    summary["digest"] = HOSTILE.into();
    summary["placement"]["method"] = HOSTILE.into();
    let report = Report::of(&recording, &summary);
    let browser = Browser::start(Window::default());
    browser.open(&report.path());
    assert_eq!(browser.title(), format!("{HOSTILE} · skyroost mission report"));

    browser.type_keys(&browser.find("#find-id"), HOSTILE);
    browser.click(&browser.find("#find button"));
    let tip = browser.eval(
        "return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(
            () => done(document.querySelector('#tip b').textContent))))",
    );
    assert_eq!(tip, format!("User {HOSTILE}"));
    browser.screenshot(&screenshot("hostile.png"));
    browser.click(&browser.find("#zoom-fit"));
    check_open_report(&browser);
}
