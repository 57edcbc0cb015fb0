//! The panel beside the map: does it fit the time, who flies how far, and what the marks mean.

use super::ground::{colour, end_mark, pad_mark, start_mark};
use crate::geometry::V2;
use crate::report::map::Panel;
use crate::report::map::view::px;
use crate::report::sweep::{ModeTried, SweepReport, name, percent};

/// Where the column of numbers in the middle ends.
const COLUMN_PX: f64 = 214.0;

/// Fills the panel.
pub(super) fn draw(panel: &mut Panel, report: &SweepReport) {
    time(panel, report);
    fleets(panel, report);
    coverage(panel, report);
    symbols(panel, report);
}

fn minutes(time_s: f64) -> String {
    format!("{:.1} min", time_s / 60.0)
}

fn time(panel: &mut Panel, report: &SweepReport) {
    panel.head(&format!("Mission time {}", minutes(report.mission_time_s)));
    for ModeTried { split, figures } in &report.modes {
        let taken = *split == report.plan.split;
        let weight = if taken { "strong" } else { "muted" };
        panel.text(weight, 0.0, &format!("by {}{}", name(*split), if taken { " (taken)" } else { "" }));
        match figures {
            Ok(figures) => {
                panel.text(&format!("number {weight}"), COLUMN_PX, &minutes(figures.duration_s));
                let (class, verdict) = if report.meets(figures.duration_s) {
                    ("pass", "meets it")
                } else {
                    ("fail", "misses it")
                };
                panel.text(&format!("number {class}"), panel.width, verdict);
            }
            Err(_) => panel.text("number muted", panel.width, "no such plan"),
        }
        panel.next();
    }
    panel.gap();
}

fn fleets(panel: &mut Panel, report: &SweepReport) {
    panel.head("Fleets");
    for fleet in &report.plan.sub_areas {
        let class = colour(fleet.fleet);
        let turns = if fleet.turns == 1 { "1 turn".to_owned() } else { format!("{} turns", fleet.turns) };
        panel.mark(|at| start_mark(&class, at, fleet.fleet), &turns);
        panel.text("number", COLUMN_PX, &format!("{:.2} km", fleet.length_m / 1e3));
        panel.text("number strong", panel.width, &minutes(fleet.duration_s));
        panel.next();
    }
    panel.gap();
}

fn coverage(panel: &mut Panel, report: &SweepReport) {
    panel.head("Coverage");
    let class = if report.plan.residue_m.is_empty() { "pass" } else { "fail" };
    panel.text("", 0.0, "of the area");
    panel.text(&format!("number {class}"), panel.width, &percent(report.plan.covered_fraction));
    panel.next();
    panel.text("", 0.0, "swath of a fleet");
    panel.text("number", panel.width, &format!("{:.1} m", report.plan.swath_m));
    panel.next();
    if let Some(separation_m) = report.plan.separation_m {
        panel.text("", 0.0, "fleets apart, at least");
        panel.text("number", panel.width, &format!("{separation_m:.0} m"));
        panel.next();
    }
    panel.gap();
}

fn symbols(panel: &mut Panel, report: &SweepReport) {
    panel.head("Legend");
    let class = colour(0);
    panel.symbol(|at| start_mark(&class, at, 0), "start of a fleet's lanes");
    panel.symbol(|at| end_mark(&class, at), "their end");
    panel.symbol(|at| pad_mark(&class, at), "take-off and landing");
    let line = |what: &str, at: V2| {
        format!("<path class=\"{what} {class}\" d=\"M{} {}h20\"/>", px(at.x - 10.0), px(at.y))
    };
    panel.symbol(|at| line("lane", at), "lanes");
    panel.symbol(|at| line("transit", at), "way there and back");
    let square = |what: &str, at: V2| {
        format!(
            "<rect class=\"{what}\" x=\"{}\" y=\"{}\" width=\"18\" height=\"14\" rx=\"2\"/>",
            px(at.x - 9.0),
            px(at.y - 7.0)
        )
    };
    if !report.area.region.no_fly().is_empty() {
        panel.symbol(|at| square("zone", at), "no-fly zone");
    }
    if !report.plan.residue_m.is_empty() {
        panel.symbol(|at| square("uncovered", at), "not covered");
    }
}
