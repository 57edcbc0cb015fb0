//! The tables of `docs/supervisor.md` are those that the flight code flies by.
#![allow(missing_docs)]

use skyroost_firmware::{
    config::SupervisorConfig,
    supervisor::{
        Action, Condition,
        table::{Demands, Level, Row, TABLE, Watched},
    },
};
use std::{fmt::Write, fs, path::Path};

/// What the hand-written part of the page ends with.
const MARK: &str = "<!-- From here on: `SKYROOST_UPDATE_DOCS=1 cargo test -p skyroost-firmware --test supervisor_page`. -->\n";

fn watched(watched: Watched) -> &'static str {
    match watched {
        Watched::GroundLink => "ground link",
        Watched::PeerLink => "peer link",
        Watched::TimeSync => "time sync",
        Watched::Navigation => "navigation",
        Watched::Battery => "battery",
        Watched::Geofence => "geofence",
        Watched::Wind => "wind",
        Watched::Captures => "captures",
        Watched::Avoidance => "avoidance",
    }
}

fn action(demands: Demands) -> &'static str {
    match demands.action() {
        Action::None => "-",
        Action::Hold => "hold",
        Action::ReturnHome => "return home",
        Action::Land => "land",
    }
}

/// When it comes up, and what must be so again before it is over.
fn words(condition: Condition) -> (String, String) {
    use Condition as C;
    let limit = condition.limit(&SupervisorConfig::USUAL);
    let thousandth = |x: i32| f64::from(x) * 1e-3;
    let (above, band, for_s) =
        (thousandth(limit.above), thousandth(limit.band), f64::from(limit.for_ms) * 1e-3);
    let lasting = if for_s > 0.0 { format!(" for {for_s} s") } else { String::new() };
    match condition {
        C::LinkQuiet | C::LinkLost | C::LinkGone => {
            (format!("control center silent for {above} s"), "heard".to_owned())
        }
        C::MateLost | C::MateGone => {
            (format!("on the lanes, a mate silent for {above} s"), "heard".to_owned())
        }
        C::NavigationLost | C::NavigationGone => {
            (format!("no solution for {above} s"), "a solution".to_owned())
        }
        C::CapturesMissed | C::CapturesGone => {
            (format!("on the lanes, gates opened and nothing captured for {above} s"), "a capture".to_owned())
        }
        C::NavigationPoor => {
            (format!("error radius above {above} m{lasting}"), format!("{} m or less", above - band))
        }
        C::BatteryWaning | C::BatteryLow | C::BatteryCritical => {
            let percent = |x: i32| f64::from(-x) * 0.1;
            (
                format!("charge below {} %", percent(limit.above)),
                format!("{} % or more", percent(limit.above - limit.band)),
            )
        }
        C::ClockHeld => {
            (format!("the pulses that there were have failed{lasting}"), "disciplined".to_owned())
        }
        C::ClockUseless => {
            (format!("held, deviation above {} ns", limit.above), "disciplined, or less".to_owned())
        }
        C::FenceNear => (
            format!("nearer than {} m and the error radius to fence or obstacle", -above),
            format!("{} m or more", band - above),
        ),
        C::FenceCrossed => ("beyond the fence or within an obstacle".to_owned(), "not so".to_owned()),
        C::WindStrong | C::WindBeyond => {
            (format!("velocity {above} m/s short{lasting}"), format!("{} m/s or less", above - band))
        }
        C::Avoiding => (format!("avoidance changed the velocity within {} s", -above), "not so".to_owned()),
    }
}

fn conditions() -> String {
    let mut page = String::from(
        "| bit | subject | condition | level | comes up | the drone | over after |\n| --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut rows: Vec<&Row> = TABLE.iter().collect();
    let stronger = |row: &Row| (row.level == Level::Acts, row.demands.action());
    rows.sort_by_key(|row| (row.watched as u8, stronger(row)));
    for row in rows {
        let (comes_up, over) = words(row.condition);
        let level = if row.level == Level::Warns { "warn" } else { "act" };
        let clear_s = f64::from(row.clears_after_ms) * 1e-3;
        let lasting = if clear_s > 0.0 { format!(" for {clear_s} s") } else { String::new() };
        let (bit, name) = (row.condition as u8, row.condition.name());
        let (subject, action) = (watched(row.watched), action(row.demands));
        let _ = writeln!(
            page,
            "| {bit} | {subject} | {name} | {level} | {comes_up} | {action} | {over}{lasting} |"
        );
    }
    page
}

fn pairs() -> String {
    let letter = |demands: Demands| match demands.action() {
        Action::None => ".",
        Action::Hold => "H",
        Action::ReturnHome => "R",
        Action::Land => "L",
    };
    let mut page = String::from("| bit | |");
    for row in TABLE {
        let _ = write!(page, " {} |", row.condition as u8);
    }
    let _ = writeln!(page, "\n| --- | --- |{}", " --- |".repeat(TABLE.len()));
    for row in TABLE {
        let _ = write!(page, "| {} | {} |", row.condition as u8, row.condition.name());
        for other in TABLE {
            let _ = write!(page, " {} |", letter(row.demands.and(other.demands)));
        }
        page.push('\n');
    }
    page
}

#[test]
fn the_page_in_docs_shows_the_table() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/supervisor.md");
    let page = fs::read_to_string(&file).expect("the page is there");
    let (by_hand, tables) =
        page.split_once(MARK).expect("the mark between what is written by hand and what is not");
    let written = format!(
        "\n## Conditions\n\n{}\n## Every pair\n\nFly on (.), hold (H), return home (R), land (L).\n\n{}",
        conditions(),
        pairs()
    );
    if std::env::var_os("SKYROOST_UPDATE_DOCS").is_some() {
        fs::write(&file, [by_hand, MARK, &written].concat()).expect("the page can be written");
        return;
    }
    assert!(
        tables == written,
        "docs/supervisor.md is stale: \
         `SKYROOST_UPDATE_DOCS=1 cargo test -p skyroost-firmware --test supervisor_page` writes it anew"
    );
}
