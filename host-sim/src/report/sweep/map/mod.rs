//! A picture of a planned sweep.
//!
//! - `ground`: area, sub-areas, zones, lanes and marks,
//! - `legend`: the panel beside the map.

mod ground;
mod legend;

use super::{SweepReport, name};
use crate::report::map::Sheet;

const STYLE: &str = include_str!("style.css");

/// Draws the whole picture; the same plan gives the same bytes.
pub(super) fn render(report: &SweepReport) -> String {
    let sheet = Sheet {
        what: "Sweep of",
        source: &report.area_name,
        subtitle: &subtitle(report),
        style: STYLE,
        points_m: &ground::everything_m(report),
    };
    sheet.render(|svg, view| ground::draw(svg, report, view), |panel| legend::draw(panel, report))
}

fn subtitle(report: &SweepReport) -> String {
    let fleets = match report.plan.sub_areas.len() {
        1 => "one fleet".to_owned(),
        fleets => format!("{fleets} fleets"),
    };
    format!(
        "{:.2} km² · {fleets} of three drones · {} m/s at {:.0} m · shared by {}",
        report.area.region.area_m2() / 1e6,
        report.request.speed_mps,
        report.altitude_m,
        name(report.plan.split),
    )
}
