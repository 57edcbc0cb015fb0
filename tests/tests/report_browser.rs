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

/// Borders inside of each other fill by turns, and zones reach over them.
#[test]
fn holes_stay_empty_and_zones_are_hatched() {
    let square = |west: f64, south: f64, side_m: f64| -> Vec<[f64; 2]> {
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| [west + side_m * x, south + side_m * y])
            .to_vec()
    };
    let mut recording = staged::recording(10);
    let lake = square(4_000.0, 4_000.0, 2_000.0);
    recording.area_m = vec![square(0.0, 0.0, 10_000.0), lake.iter().rev().copied().collect()];
    recording.no_fly_m = vec![lake, square(9_500.0, 9_500.0, 2_000.0)];
    recording.sub_areas.iter_mut().for_each(|sub_area| sub_area.polygon_m = None);
    let report = Report::of(&recording, &staged::summary(&recording));
    let browser = Browser::start(Window::default());
    browser.open(&report.path());
    check_open_report(&browser);
    let headline = browser.eval("return document.querySelector('#headline').textContent");
    assert!(headline.as_str().is_some_and(|text| text.contains("area 96")), "{headline}");
    // Share of what is painted of the ground around the middles of hole, area and outer zone.
    let painted = |layers: &str| {
        browser.eval(&format!(
            "for (const box of document.querySelectorAll('input[name^=layer-]'))
               if (box.checked !== {layers}.includes(box.name)) box.click();
             const {{ px_per_m, drones: [{{ enu_m, screen_px }}] }} = window.skyroost.state();
             const painted = ([e_m, n_m]) => {{
               const x_px = screen_px[0] + (e_m - enu_m[0]) * px_per_m - 12;
               const y_px = screen_px[1] - (n_m - enu_m[1]) * px_per_m - 12;
               const pen = document.querySelector('canvas.ground').getContext('2d');
               const {{ data }} = pen.getImageData(x_px, y_px, 24, 24);
               return data.filter((value, i) => i % 4 === 3 && value > 0).length / (24 * 24);
             }};
             const places = [[5000, 5000], [2000, 2000], [10500, 10500]];
             return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(
               () => done(places.map(painted)))))"
        ))
    };
    assert_eq!(painted("[]"), serde_json::json!([0, 1, 0]), "the hole is empty, the area full");
    let hatched = painted("['layer-noFly']");
    for zone in [0, 2] {
        let share = hatched[zone].as_f64().expect("a share");
        assert!(share > 0.1 && share < 0.9, "stripes over the zones: {hatched}");
    }
    painted("['layer-noFly', 'layer-grid', 'layer-plan']");
    browser.screenshot(&screenshot("zones.png"));
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

/// The readout's longitude and latitude against the way back: geodetic to earth-centred to local.
#[test]
fn truth_the_readout_agrees_with_wgs84() {
    let recording = staged::recording(10);
    let report = Report::of(&recording, &staged::summary(&recording));
    let browser = Browser::start(Window::default());
    browser.open(&report.path());
    let stage = browser.find("#stage");
    for offset_px in [[-300, -150], [-100, 100], [200, 220]] {
        browser.hover(&stage, offset_px);
        let readout = browser.eval("return document.querySelector('#readout').textContent");
        let readout =
            readout.as_str().expect("the readout is text").replace('−', "-").replace([',', '°'], "");
        let words: Vec<&str> = readout.split_whitespace().collect();
        let ["E", e_m, "m", "N", n_m, "m", "·", lat_deg, "N", lon_deg, "E"] = words[..] else {
            panic!("unexpected readout {readout:?}");
        };
        let number = |word: &str| word.parse::<f64>().expect("the readout holds numbers");
        let origin_deg = recording.origin_lon_lat_deg.expect("the staged mission has an origin");
        let [e_back_m, n_back_m] = local([number(lon_deg), number(lat_deg)], origin_deg);
        assert!((e_back_m - number(e_m)).abs() < 1.5, "{readout}: east is {e_back_m}");
        assert!((n_back_m - number(n_m)).abs() < 1.5, "{readout}: north is {n_back_m}");
    }
}

/// East and north of a point of the WGS84 ellipsoid.
fn local(point_deg: [f64; 2], origin_deg: [f64; 2]) -> [f64; 2] {
    let earth_centred = |[lon, lat]: [f64; 2]| {
        let e2 = 0.006_694_379_990_14_f64;
        let normal_m = 6_378_137.0 / (1.0 - e2 * lat.sin().powi(2)).sqrt();
        [lat.cos() * lon.cos(), lat.cos() * lon.sin(), (1.0 - e2) * lat.sin()].map(|x| x * normal_m)
    };
    let [lon, lat] = origin_deg.map(f64::to_radians);
    let (point, origin) = (earth_centred(point_deg.map(f64::to_radians)), earth_centred([lon, lat]));
    let [x, y, z] = [0, 1, 2].map(|i| point[i] - origin[i]);
    let outward = lon.cos() * x + lon.sin() * y;
    [lon.cos() * y - lon.sin() * x, lat.cos() * z - lat.sin() * outward]
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
