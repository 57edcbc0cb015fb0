//! What must hold of every mission report, whatever mission it shows: it loads without a word on the
//! console and without a network, and its slider really moves the drones.

use std::path::Path;

use serde_json::Value;

use crate::webdriver::{Browser, Window, keys};

/// Opens a report and checks it, then leaves a screenshot of its end at `screenshot`.
///
/// # Panics
/// If anything is wrong with the report, or no browser is installed.
pub fn check_report(report: &Path, screenshot: &Path) {
    let browser = Browser::start(Window::default());
    browser.open(report);
    check_open_report(&browser);
    browser.screenshot(screenshot);
}

/// The same checks on a report that is already open; leaves the slider at the end.
///
/// # Panics
/// If anything is wrong with the report.
pub fn check_open_report(browser: &Browser) {
    let title = browser.title();
    assert!(title.ends_with("skyroost mission report"), "title is {title:?}");
    check_slider(browser);
    check_playing(browser);
    check_map(browser);
    check_nothing_foreign(browser);
    check_console(browser);
}

/// What the page says of the slider's time: `window.skyroost.state()`.
#[must_use]
pub fn state(browser: &Browser) -> Value {
    browser.eval("return window.skyroost.state()")
}

/// Keys and pointer move the slider, and with it the drones, in the state and on the canvas.
fn check_slider(browser: &Browser) {
    let slider = browser.find("#time");
    let end_s = time_s(&state(browser), "end_s");

    browser.type_keys(&slider, keys::HOME);
    let start = state(browser);
    assert!(time_s(&start, "t_s") <= 0.0, "Home goes to the start");
    let canvas_at_start = flying_pixels(browser);

    browser.type_keys(&slider, keys::RIGHT);
    let stepped_s = time_s(&state(browser), "t_s");
    assert!(stepped_s > 0.0 && stepped_s <= 60.0, "an arrow is a small step, not {stepped_s} s");

    browser.click(&slider);
    let middle = state(browser);
    let middle_s = time_s(&middle, "t_s");
    assert!(
        (middle_s - end_s / 2.0).abs() < 0.02 * end_s + 1.0,
        "a click in the middle is {middle_s} of {end_s} s"
    );
    assert_ne!(positions(&start, "enu_m"), positions(&middle, "enu_m"), "drones moved over the ground");
    assert_ne!(positions(&start, "screen_px"), positions(&middle, "screen_px"), "drones moved on the screen");
    assert_ne!(canvas_at_start, flying_pixels(browser), "drones moved on the canvas");

    browser.type_keys(&slider, keys::END);
    let rest_s = end_s - time_s(&state(browser), "t_s");
    assert!(rest_s.abs() <= 1.0, "End goes to the end, not {rest_s} s before it");
}

/// The button plays from the start once the end is reached, and pauses.
fn check_playing(browser: &Browser) {
    let button = browser.find("#play");
    browser.click(&button);
    wait_until(browser, "the mission plays", |now| now["playing"] == true && time_s(now, "t_s") > 0.0);
    browser.click(&button);
    let paused = state(browser);
    assert_eq!(paused["playing"], false, "a second click pauses");
    browser.type_keys(&browser.find("#time"), keys::END);
}

/// The wheel and the buttons zoom, dragging moves, Fit comes back.
fn check_map(browser: &Browser) {
    let stage = browser.find("#stage");
    let fitted = state(browser);
    browser.wheel(&stage, -300);
    wait_until(browser, "the wheel zooms in", |now| scale(now) > 1.2 * scale(&fitted));
    browser.click(&browser.find("#zoom-out"));
    let before = state(browser);
    browser.drag(&stage, [-60, 20], [40, 50]);
    let after = state(browser);
    assert_ne!(positions(&before, "screen_px"), positions(&after, "screen_px"), "dragging moves the map");
    assert_eq!(positions(&before, "enu_m"), positions(&after, "enu_m"), "dragging moves no drone");
    browser.click(&browser.find("#zoom-fit"));
    assert_eq!(positions(&state(browser), "screen_px"), positions(&fitted, "screen_px"), "Fit comes back");
}

fn check_nothing_foreign(browser: &Browser) {
    let fetched = browser.eval("return performance.getEntriesByType('resource').map(it => it.name)");
    let foreign: Vec<_> = fetched.as_array().into_iter().flatten().filter(|it| !is_inline(it)).collect();
    assert!(foreign.is_empty(), "the report loads {foreign:?}");
    assert_eq!(browser.eval("return window.pwned ?? null"), Value::Null, "text of the mission ran as script");
}

fn is_inline(name: &Value) -> bool {
    name.as_str().is_some_and(|it| it.starts_with("data:"))
}

fn check_console(browser: &Browser) {
    let said = browser.console();
    assert!(said.is_empty(), "the console is not empty: {said:#?}");
}

fn time_s(state: &Value, name: &str) -> f64 {
    state[name].as_f64().unwrap_or_else(|| panic!("no {name} in {state}"))
}

fn scale(state: &Value) -> f64 {
    time_s(state, "px_per_m")
}

fn positions(state: &Value, name: &str) -> Vec<Value> {
    let drones = state["drones"].as_array().expect("the state lists the drones");
    assert!(!drones.is_empty(), "the report shows no drone");
    drones.iter().map(|drone| drone[name].clone()).collect()
}

/// The drones' canvas layer as it is painted at the next frame.
fn flying_pixels(browser: &Browser) -> Value {
    browser.eval(
        "return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(
            () => done(document.querySelector('canvas.air').toDataURL()))))",
    )
}

fn wait_until(browser: &Browser, what: &str, holds: impl Fn(&Value) -> bool) {
    let mut last = Value::Null;
    for _ in 0..100 {
        last = state(browser);
        if holds(&last) {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    panic!("{what}: not within 5 s; {last:#}");
}
