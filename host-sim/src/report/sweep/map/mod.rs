//! A picture of a planned sweep: one SVG without script or anything from outside, light or dark as its viewer
//! asks for.
//!
//! - `view`: metres to pixels, and the elements' text,
//! - `ground`: area, sub-areas, zones, lanes and marks,
//! - `legend`: the panel beside the map.

mod ground;
mod legend;
mod view;

use super::{SweepReport, name};
use std::fmt::Write as _;
use std::path::Path;
use view::{View, escaped, px};

const STYLE: &str = include_str!("style.css");

/// Space around everything, pixels.
const MARGIN_PX: f64 = 28.0;
/// Above the map.
const HEADER_PX: f64 = 84.0;
/// Width of the map, and of the panel beside it.
const MAP_WIDTH_PX: f64 = 820.0;
const PANEL_WIDTH_PX: f64 = 330.0;
/// Between map and panel.
const GAP_PX: f64 = 28.0;

/// Draws the whole picture; the same plan gives the same bytes.
pub(super) fn render(report: &SweepReport) -> String {
    let view = View::around(&ground::everything_m(report), [MARGIN_PX, HEADER_PX], MAP_WIDTH_PX);
    let panel_x = MARGIN_PX + MAP_WIDTH_PX + GAP_PX;
    let (legend, legend_px) = legend::draw(report, [panel_x, HEADER_PX], PANEL_WIDTH_PX);
    let width = panel_x + PANEL_WIDTH_PX + MARGIN_PX;
    let height = HEADER_PX + view.height_px().max(legend_px) + MARGIN_PX;
    let file = Path::new(&report.area_name).file_name();
    let file = file.map_or_else(|| report.area_name.clone().into(), |name| name.to_string_lossy());
    let title = escaped(&format!("Sweep of {file}"));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" role=\"img\" \
         aria-labelledby=\"title\">\n<title id=\"title\">{title}</title>\n<style>\n{STYLE}</style>\n",
        w = px(width),
        h = px(height),
    );
    let _ = writeln!(svg, "<rect class=\"paper\" width=\"{}\" height=\"{}\"/>", px(width), px(height));
    let _ = writeln!(svg, "<text class=\"title\" x=\"{MARGIN_PX}\" y=\"42\">{title}</text>");
    let _ = writeln!(svg, "<text class=\"muted\" x=\"{MARGIN_PX}\" y=\"65\">{}</text>", subtitle(report));
    ground::draw(&mut svg, report, &view);
    svg.push_str(&legend);
    svg.push_str("</svg>\n");
    svg
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
