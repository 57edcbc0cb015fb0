//! The mission report: one HTML file that shows the map, plays the mission and names the results,
//! without a server, a network or a framework.

mod embed;
mod track;

use crate::recording::Recording;
use embed::Embedded;

const TEMPLATE: &str = include_str!("assets/report.html");
const STYLES: [&str; 3] = [
    include_str!("assets/theme.css"),
    include_str!("assets/layout.css"),
    include_str!("assets/controls.css"),
];
/// In order of use: each file leans on those before it only. They share one function's scope.
const SCRIPTS: [&str; 13] = [
    include_str!("assets/units.js"),
    include_str!("assets/data.js"),
    include_str!("assets/mission.js"),
    include_str!("assets/geodesy.js"),
    include_str!("assets/view.js"),
    include_str!("assets/brush.js"),
    include_str!("assets/ground.js"),
    include_str!("assets/flown.js"),
    include_str!("assets/marks.js"),
    include_str!("assets/legend.js"),
    include_str!("assets/timeline.js"),
    include_str!("assets/panel.js"),
    include_str!("assets/main.js"),
];

/// Renders a flown mission as one self-contained HTML page.
///
/// `summary` is the object `skyroost mission --json` prints; whatever it lacks shows as a dash. An
/// array `limits` in it, of objects `{"name","value","limit","ok"}`, is listed with the results
/// and decides the page's verdict together with coverage and separation.
///
/// Positions are rounded to a centimetre, tracks thinned to within 0.35 m on each axis. The phase
/// whose name contains "sweep" tells when the fleets sweep and, by its end, when the placements are
/// known. The same input gives the same bytes.
///
/// The page asks nothing of any network (its content security policy forbids it), and text from the
/// mission (names, identifiers, events) is never read as markup or script.
#[must_use]
pub fn render(recording: &Recording, summary: &serde_json::Value) -> String {
    let data = Embedded::new(recording, summary).to_json();
    let title = format!("{} · skyroost mission report", recording.scenario);
    fill(
        TEMPLATE,
        &[
            ("title", &escape_text(&title)),
            ("style", &STYLES.join("\n")),
            ("script", &SCRIPTS.join("\n")),
            ("data", &escape_json(&data)),
        ],
    )
}

/// Replaces each `{{name}}` of the template. What is filled in is not searched again, so that no
/// text of a mission can pose as a placeholder.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut page =
        String::with_capacity(values.iter().map(|(_, value)| value.len()).sum::<usize>() + template.len());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        let (name, after) = after.split_once("}}").expect("a placeholder of the template is closed");
        let value = values.iter().find(|(known, _)| *known == name);
        let (_, value) = value.expect("a placeholder of the template is known");
        page.push_str(before);
        page.push_str(value);
        rest = after;
    }
    page.push_str(rest);
    page
}

/// Text for HTML content and quoted attributes.
fn escape_text(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            _ => escaped.push(c),
        }
    }
    escaped
}

/// JSON for the inside of a `<script>` element: no `<` is left, so neither `</script>` nor `<!--`
/// can occur. In JSON these characters stand in strings only, where an escape means the same.
fn escape_json(json: &str) -> String {
    let mut escaped = String::with_capacity(json.len());
    for c in json.chars() {
        match c {
            '<' | '>' | '&' | '\u{2028}' | '\u{2029}' => {
                escaped.push_str(&format!("\\u{:04x}", u32::from(c)));
            }
            _ => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::{Value, json};

    use super::*;
    use crate::recording::{DroneRecord, TrackSample, UserRecord};

    const DATA_START: &str = "<script type=\"application/json\" id=\"data\">";

    /// The embedded data, found the way a browser finds it: up to the first end tag.
    fn embedded(page: &str) -> Value {
        let (_, data) = page.split_once(DATA_START).expect("the page embeds its data");
        let (data, _) = data.split_once("</script").expect("the data end");
        serde_json::from_str(data).expect("the data are JSON")
    }

    fn user(id: &str) -> UserRecord {
        UserRecord { id: id.into(), truth_m: [1234.567, -89.0], status: "ok", ..UserRecord::default() }
    }

    proptest! {
        #[test]
        fn any_text_comes_back_and_never_as_markup(text in "(\\PC|[<>&\"'{}/!\\-\u{2028}]|</script>|<!--|\\{\\{data\\}\\}){0,12}") {
            let recording = Recording {
                scenario: text.clone(),
                users: vec![user(&text)],
                ..Recording::default()
            };
            let calm = render(&Recording { users: vec![user("u")], ..Recording::default() }, &Value::Null);
            let page = render(&recording, &json!({ "digest": text }));
            let data = embedded(&page);
            prop_assert_eq!(data["scenario"].as_str(), Some(text.as_str()));
            prop_assert_eq!(data["users"][0][0].as_str(), Some(text.as_str()));
            prop_assert_eq!(data["summary"]["digest"].as_str(), Some(text.as_str()));
            prop_assert_eq!(page.matches('<').count(), calm.matches('<').count());
        }
    }

    #[test]
    fn the_assets_hold_nothing_that_would_end_their_element_or_call_the_network() {
        for asset in STYLES.iter().chain(&SCRIPTS) {
            assert!(!asset.contains("</"), "an end tag inside an asset");
            assert!(!asset.contains("http://") && !asset.contains("https://"), "an address inside an asset");
        }
    }

    #[test]
    fn a_large_mission_of_noisy_tracks_stays_small() {
        // Six drones at 1 Hz over 6,500 s, every sample off the line, and 5,000 users.
        let track = |drone: u16| {
            let sample = |i: i32| {
                let t_s = f64::from(i);
                let shake_m = f64::from((i * 7919 + i32::from(drone)) % 13) * 0.3;
                TrackSample { t_s, pos_enu_m: [10.0 * t_s + shake_m, 500.0 - shake_m, 300.0 + shake_m] }
            };
            (0..6500).map(sample).collect()
        };
        let recording = Recording {
            drones: (1..=6).map(|id| DroneRecord { id, fleet: Some(id % 2), track: track(id) }).collect(),
            users: (0..5000)
                .map(|i| UserRecord {
                    estimate_m: Some([1233.333 + f64::from(i), -91.234_567]),
                    cov_m2: Some([[1.234_567, 0.1], [0.1, 9.876_543]]),
                    r95_m: Some(5.432_1),
                    occasions: 120,
                    heard_s: Some(4321.987),
                    served_guaranteed_by: Some(3),
                    served_actual_by: Some(3),
                    ..user(&format!("u{i}"))
                })
                .collect(),
            ..Recording::default()
        };
        let page = render(&recording, &Value::Null);
        assert!(page.len() < 1_500_000, "{} bytes", page.len());
    }

    #[test]
    fn an_empty_recording_still_makes_a_page() {
        let page = render(&Recording::default(), &Value::Null);
        assert_eq!(embedded(&page)["end_s"], json!(1.0));
    }

    #[test]
    fn a_seed_beyond_a_scripts_integers_survives() {
        let recording = Recording { seed: u64::MAX, ..Recording::default() };
        assert_eq!(embedded(&render(&recording, &Value::Null))["seed"], json!(u64::MAX.to_string()));
    }
}
