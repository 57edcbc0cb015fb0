//! What lies on the map: area, sub-areas, zones, lanes with their directions, and what stays uncovered.

use std::fmt::Write as _;

use crate::control::sweep::SubArea;
use crate::geometry::V2;
use crate::geometry::region::{Part, Region};
use crate::report::map::view::{View, px};
use crate::report::sweep::SweepReport;

/// Colours for fleets; more fleets begin again.
const COLOURS: usize = 6;
/// A shorter leg shows no arrow, pixels.
const ARROW_LEG_PX: f64 = 44.0;
/// More fleets show no ways to and from their pads: they would cover the map.
const TRANSITS_UP_TO: usize = 8;

/// Class of a fleet's colour.
pub(super) fn colour(fleet: usize) -> String {
    format!("f{}", fleet % COLOURS)
}

/// All points that the map has to show.
pub(super) fn everything_m(report: &SweepReport) -> Vec<V2> {
    let region = &report.area.region;
    let fleets = report.plan.sub_areas.iter();
    region
        .outer_vertices_m()
        .chain(fleets.clone().flat_map(|s| s.path_m.iter().copied()))
        .chain(fleets.map(|s| report.pads.centre_m(s.fleet)))
        .collect()
}

/// Draws what lies on the map.
pub(super) fn draw(svg: &mut String, report: &SweepReport, view: &View) {
    let area = outline(view, &report.area.region);
    let _ = writeln!(
        svg,
        "<defs>\n<clipPath id=\"within\"><path clip-rule=\"evenodd\" d=\"{area}\"/></clipPath>\n\
         <pattern id=\"hatch\" width=\"7\" height=\"7\" patternUnits=\"userSpaceOnUse\" patternTransform=\"rotate(45)\">\
         <path class=\"hatch\" d=\"M0 0V7\"/></pattern>\n</defs>\n\
         <path class=\"area\" fill-rule=\"evenodd\" d=\"{area}\"/>"
    );
    let fleets = &report.plan.sub_areas;
    fleets.iter().for_each(|fleet| tint(svg, report, view, fleet));
    for zone in report.area.region.no_fly() {
        let _ = writeln!(svg, "<path class=\"zone\" d=\"{}\"/>", view.path(zone.vertices_m(), true));
    }
    let _ = writeln!(svg, "<path class=\"outline\" d=\"{area}\"/>");
    for ring in &report.plan.residue_m {
        let _ = writeln!(svg, "<path class=\"uncovered\" d=\"{}\"/>", view.path(ring, true));
    }
    let with_transits = fleets.len() <= TRANSITS_UP_TO;
    fleets.iter().for_each(|fleet| lanes(svg, report, view, fleet, with_transits));
    // Marks last: no lane may cross a number.
    fleets.iter().for_each(|fleet| marks(svg, report, view, fleet));
}

fn outline(view: &View, region: &Region) -> String {
    view.rings(region.parts().iter().flat_map(Part::borders_m))
}

/// A fleet's part of the ground: its sub-area, or what its swath covers of the whole.
fn tint(svg: &mut String, report: &SweepReport, view: &View, fleet: &SubArea) {
    let class = colour(fleet.fleet);
    let _ = match &fleet.region {
        Some(region) => {
            writeln!(
                svg,
                "<path class=\"tint {class}\" fill-rule=\"evenodd\" d=\"{}\"/>",
                outline(view, region)
            )
        }
        None => writeln!(
            svg,
            "<g clip-path=\"url(#within)\"><path class=\"swath {class}\" stroke-width=\"{}\" d=\"{}\"/></g>",
            px(report.plan.swath_m * view.px_per_m()),
            view.path(&fleet.path_m, false)
        ),
    };
}

/// The way with an arrow on every leg that is long enough, and the ways there and back.
fn lanes(svg: &mut String, report: &SweepReport, view: &View, fleet: &SubArea, with_transits: bool) {
    let _ = writeln!(svg, "<g class=\"{}\">", colour(fleet.fleet));
    if with_transits {
        for way in report.ways_there_and_back_m(fleet) {
            let _ = writeln!(svg, "<path class=\"transit\" d=\"{}\"/>", view.path(&way, false));
        }
    }
    let _ = writeln!(svg, "<path class=\"lane\" d=\"{}\"/>", view.path(&fleet.path_m, false));
    for leg in fleet.path_m.windows(2) {
        let (from, to) = (view.point_px(leg[0]), view.point_px(leg[1]));
        if (to - from).norm() >= ARROW_LEG_PX {
            let middle = (from + to) / 2.0;
            let degrees = (to - from).y.atan2((to - from).x).to_degrees();
            let _ = writeln!(
                svg,
                "<path class=\"arrow\" d=\"M6 0L-4.5 4.5L-2.5 0L-4.5 -4.5Z\" transform=\"translate({} {}) rotate({})\"/>",
                px(middle.x),
                px(middle.y),
                px(degrees)
            );
        }
    }
    svg.push_str("</g>\n");
}

/// Pad, start and end of a fleet's lanes.
fn marks(svg: &mut String, report: &SweepReport, view: &View, fleet: &SubArea) {
    let class = colour(fleet.fleet);
    let pad = view.point_px(report.pads.centre_m(fleet.fleet));
    let _ = writeln!(svg, "{}", pad_mark(&class, pad));
    if let Some(&last) = fleet.path_m.last() {
        let _ = writeln!(svg, "{}", end_mark(&class, view.point_px(last)));
    }
    if let Some(&first) = fleet.path_m.first() {
        let _ = writeln!(svg, "{}", start_mark(&class, view.point_px(first), fleet.fleet));
    }
}

pub(super) fn pad_mark(class: &str, at: V2) -> String {
    let (x, y) = (px(at.x), px(at.y));
    format!("<path class=\"mark {class}\" d=\"M0 -6L6 5H-6Z\" transform=\"translate({x} {y})\"/>")
}

pub(super) fn start_mark(class: &str, at: V2, fleet: usize) -> String {
    let (x, y) = (px(at.x), px(at.y));
    format!(
        "<g transform=\"translate({x} {y})\"><circle class=\"mark {class}\" r=\"9\"/>\
         <text class=\"mark-text\" y=\"4\">{}</text></g>",
        fleet + 1
    )
}

pub(super) fn end_mark(class: &str, at: V2) -> String {
    let (x, y) = (px(at.x - 5.0), px(at.y - 5.0));
    format!("<rect class=\"open {class}\" x=\"{x}\" y=\"{y}\" width=\"10\" height=\"10\" rx=\"1.5\"/>")
}
