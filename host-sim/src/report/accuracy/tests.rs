//! What a report of a formation says of figures that are out of the ordinary.

use super::*;
use crate::control::accuracy::Formation;
use crate::geometry::V2;
use crate::runner::formation::{fixed_orientation_rad, slot_m};

fn report(spacing_m: f64, altitude_m: f64, sigma_toa_ns: f64) -> AccuracyReport {
    let corners: [V2; 3] = [0, 1, 2].map(|slot| slot_m(fixed_orientation_rad(0.0), slot, 1.0));
    let formation = Formation {
        corners,
        spacing_m,
        altitude_m,
        sigma_toa_ns,
        speed_mps: 10.0,
        radius_m: 500.0,
        srs_period_s: 5.0,
    };
    AccuracyReport { accuracy: Accuracy::of(formation).unwrap() }
}

/// A triangle as small as this one tells nothing of a position: beyond 10 km a bound is none.
#[test]
fn what_is_not_determined_is_no_number() {
    let report = report(0.5, 5000.0, 30.0);
    assert!(report.accuracy.one_srs_m.iter().all(|radius_m| radius_m.is_infinite()));
    let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
    assert_eq!(json["one_srs"]["r95_m"][0], serde_json::Value::Null);
    let page = report.to_markdown();
    assert!(page.contains("| one SRS | - | - |") && !page.contains("inf") && !page.contains("NaN"), "{page}");
    let svg = report.to_svg();
    assert!(svg.ends_with("</svg>\n") && !svg.contains("inf") && !svg.contains("NaN"), "{svg}");
}

/// A formation of one's own stands among those of the table, and its curves stand out.
#[test]
fn ones_own_formation_is_compared() {
    let report = report(70.0, 250.0, 7.0);
    let page = report.to_markdown();
    for told in ["\n| 70 m | 919 m |", "| h = 250 m |", "\n| 7 ns |"] {
        assert!(page.contains(told), "{told:?} is not in {page}");
    }
    let svg = report.to_svg();
    assert_eq!(svg.matches("<path class=\"curve c2 own\"").count(), 1);
    assert_eq!(svg.matches("<path class=\"curve c3 own\"").count(), 1);
    roxmltree::Document::parse(&svg).unwrap();
}

/// Text and page have the same figures, in lines that a terminal holds.
#[test]
fn text_and_page_say_the_same() {
    let report = report(50.0, 300.0, 5.0);
    let (text, page) = (report.to_string(), report.to_markdown());
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    let words =
        |text: &str| text.split_whitespace().filter(|word| !word.starts_with(['|', '#', '-'])).count();
    assert_eq!(words(&text), words(&page));
}
