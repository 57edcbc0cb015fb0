//! A picture of a placement: the drones' disks, the users they serve, and those that nobody serves.

use std::fmt::Write as _;

use super::PlaceReport;
use crate::geometry::V2;
use crate::report::map::view::{View, px};
use crate::report::map::{Panel, Sheet};

const STYLE: &str = include_str!("map.css");
/// More users are drawn as smaller dots.
const FEW: usize = 400;

/// Draws the whole picture; the same answer gives the same bytes.
pub(super) fn render(report: &PlaceReport) -> String {
    let placement = &report.placement;
    let mut points_m: Vec<V2> = report.users.iter().map(|user| user.pos_m).collect();
    for site in placement.sites.iter().flatten() {
        let reach = V2::repeat(report.radius_m);
        points_m.extend([site.pos_m - reach, site.pos_m + reach]);
    }
    let sheet = Sheet {
        what: "Drones placed for",
        source: &report.source,
        subtitle: &format!(
            "{} of {} users within {} m of {} drones · {}",
            placement.covered,
            report.users.len(),
            report.radius_m,
            placement.sites.len(),
            if placement.proved_optimal { "proved optimal" } else { "not proved optimal" }
        ),
        style: STYLE,
        points_m: &points_m,
    };
    sheet.render(|svg, view| draw(svg, report, view), |panel| fill(panel, report))
}

fn draw(svg: &mut String, report: &PlaceReport, view: &View) {
    let radius_px = px(report.radius_m * view.px_per_m());
    for site in report.placement.sites.iter().flatten() {
        let at = view.point_px(site.pos_m);
        let _ = writeln!(
            svg,
            "<circle class=\"disk\" cx=\"{}\" cy=\"{}\" r=\"{radius_px}\"/>",
            px(at.x),
            px(at.y)
        );
    }
    let served_by = report.served_by();
    let size = if report.users.len() > FEW { " small" } else { "" };
    for (class, served) in [("left", false), ("served", true)] {
        let users = report.users.iter().zip(&served_by).filter(|(_, by)| by.is_some() == served);
        let dots: String = users.map(|(user, _)| dot(view.point_px(user.pos_m))).collect();
        if !dots.is_empty() {
            let _ = writeln!(svg, "<path class=\"user {class}{size}\" d=\"{dots}\"/>");
        }
    }
    for (number, site) in (1..).zip(&report.placement.sites) {
        let Some(site) = site else { continue };
        let at = view.point_px(site.pos_m);
        let _ = writeln!(svg, "<path class=\"drone\" d=\"{}\"/>", cross(at));
        let (x, y) = (px(at.x + 8.0), px(at.y - 6.0));
        let _ = writeln!(svg, "<text class=\"name halo\" x=\"{x}\" y=\"{y}\">{number}</text>");
    }
}

/// A dot as a stroke of no length with round ends.
fn dot(at: V2) -> String {
    format!("M{} {}h0", px(at.x), px(at.y))
}

fn cross(at: V2) -> String {
    format!("M{} {}h10m-5 -5v10", px(at.x - 5.0), px(at.y))
}

fn fill(panel: &mut Panel, report: &PlaceReport) {
    panel.head("Drones");
    for (number, site) in (1..).zip(&report.placement.sites) {
        let told = site.as_ref().map_or_else(
            || "stand-by".to_owned(),
            |site| format!("{} users, {:.1} m to spare", site.covered.len(), site.margin_m),
        );
        panel.text("", 0.0, &format!("drone {number}"));
        panel.text("number", panel.width, &told);
        panel.next();
    }
    panel.gap();
    panel.head("Legend");
    panel.symbol(|at| format!("<path class=\"drone\" d=\"{}\"/>", cross(at)), "drone");
    let ring = |at: V2| format!("<circle class=\"disk\" cx=\"{}\" cy=\"{}\" r=\"7\"/>", px(at.x), px(at.y));
    panel.symbol(ring, "what it covers");
    panel.symbol(|at| format!("<path class=\"user served\" d=\"{}\"/>", dot(at)), "user served");
    panel.symbol(|at| format!("<path class=\"user left\" d=\"{}\"/>", dot(at)), "user left over");
}
