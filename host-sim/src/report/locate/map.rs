//! A picture of located users: their 95 % ellipses, what the others are worth, and where the drones heard them.

use std::fmt::Write as _;

use super::{LocateReport, STATUSES, clock_name};
use crate::control::localize::{ClockModel, FixStatus};
use crate::geometry::V2;
use crate::report::figures::{quantile, status_name};
use crate::report::map::view::{View, escaped, px};
use crate::report::map::{Panel, Sheet};

const STYLE: &str = include_str!("map.css");

/// Corners of an ellipse.
const CORNERS: u32 = 36;
/// Up to this many users have their names on the map; dots and ellipses of more are smaller.
const NAMED: usize = 40;
/// Ellipses are drawn larger until that of the median user is about this large, of few users and of many, pixels.
const MEDIAN_PX: [f64; 2] = [12.0, 4.0];
/// By one of these factors.
const FACTORS: [f64; 6] = [50.0, 20.0, 10.0, 5.0, 2.0, 1.0];
/// More clocks do not fit beside the map.
const CLOCKS: usize = 8;

/// Draws the whole picture; the same answer gives the same bytes.
pub(super) fn render(report: &LocateReport) -> String {
    // A guess that claims nothing may lie anywhere and must not make the map small.
    let located = report.located().map(|(_, position)| V2::from(position.pos_m));
    let points_m: Vec<V2> = report.track_m.iter().copied().chain(located).collect();
    let sheet = Sheet {
        what: "Users located from",
        source: &report.source,
        subtitle: &format!(
            "{} of {} users · {} captures of {} drones",
            report.count(FixStatus::Ok),
            report.users.len(),
            report.captures,
            report.drones.len()
        ),
        style: STYLE,
        points_m: &points_m,
    };
    let factor = factor(report, &sheet.view());
    sheet.render(|svg, view| draw(svg, report, view, factor), |panel| fill(panel, report, factor))
}

/// How much larger than they are ellipses have to be drawn to be seen.
fn factor(report: &LocateReport, view: &View) -> f64 {
    let median_px = quantile(&report.r95_m(), 0.5).unwrap_or_default() * view.px_per_m();
    let most_px = MEDIAN_PX[usize::from(report.users.len() > NAMED)];
    FACTORS.into_iter().find(|factor| factor * median_px <= most_px).unwrap_or(1.0)
}

fn draw(svg: &mut String, report: &LocateReport, view: &View, factor: f64) {
    let dots: String = report.track_m.iter().map(|&at_m| dot(view.point_px(at_m))).collect();
    let _ = writeln!(svg, "<path class=\"track\" d=\"{dots}\"/>");
    for (_, position) in report.located() {
        let at_m = V2::from(position.pos_m);
        let ellipse: Vec<V2> = position
            .ellipse_m(CORNERS)
            .into_iter()
            .map(|corner_m| at_m + (corner_m - at_m) * factor)
            .collect();
        let _ = writeln!(svg, "<path class=\"ellipse\" d=\"{}\"/>", view.path(&ellipse, true));
    }
    let size = if report.users.len() > NAMED { " small" } else { "" };
    for status in STATUSES {
        let of_status = report.users.iter().filter(|user| user.status == status);
        let dots: String = of_status
            .filter_map(|user| user.position)
            .map(|it| dot(view.point_px(V2::from(it.pos_m))))
            .collect();
        if !dots.is_empty() {
            let _ = writeln!(svg, "<path class=\"user {}{size}\" d=\"{dots}\"/>", status_name(status));
        }
    }
    if report.users.len() <= NAMED {
        for (user, position) in report.users.iter().filter_map(|user| Some((user, user.position?))) {
            let at = view.point_px(V2::from(position.pos_m));
            let name = escaped(&user.id);
            let _ = writeln!(
                svg,
                "<text class=\"name halo\" x=\"{}\" y=\"{}\">{name}</text>",
                px(at.x + 7.0),
                px(at.y + 4.0)
            );
        }
    }
}

/// A dot as a stroke of no length with round ends.
fn dot(at: V2) -> String {
    format!("M{} {}h0", px(at.x), px(at.y))
}

fn fill(panel: &mut Panel, report: &LocateReport, factor: f64) {
    panel.head("Users");
    for status in STATUSES {
        let count = report.count(status);
        if count > 0 || status == FixStatus::Ok {
            let class = status_name(status);
            let what = class.replace('_', " ");
            panel.mark(|at| format!("<path class=\"user {class}\" d=\"{}\"/>", dot(at)), &what);
            panel.text("number strong", panel.width, &count.to_string());
            panel.next();
        }
    }
    panel.gap();
    let r95_m = report.r95_m();
    if let (Some(median), Some(p95), Some(most)) =
        (quantile(&r95_m, 0.5), quantile(&r95_m, 0.95), r95_m.last())
    {
        panel.head("95 % radius");
        for (what, radius_m) in [("median", median), ("95th percentile", p95), ("widest", *most)] {
            panel.text("", 0.0, what);
            panel.text("number", panel.width, &format!("{radius_m:.1} m"));
            panel.next();
        }
        panel.gap();
    }
    clocks(panel, report);
    panel.head("Legend");
    let larger = if factor > 1.0 { format!(", drawn {factor} times as large") } else { String::new() };
    let ellipse = |at: V2| {
        format!("<ellipse class=\"ellipse\" cx=\"{}\" cy=\"{}\" rx=\"9\" ry=\"5.5\"/>", px(at.x), px(at.y))
    };
    panel.symbol(ellipse, &format!("95 % ellipse{larger}"));
    let dots = |at: V2| [-8.0, -4.0, 0.0, 4.0, 8.0].map(|dx| dot(at + V2::new(dx, 0.0))).concat();
    panel.symbol(|at| format!("<path class=\"track\" d=\"{}\"/>", dots(at)), "where the drones heard users");
}

fn clocks(panel: &mut Panel, report: &LocateReport) {
    panel.head(&format!("Clocks: {}", clock_name(report.config.clock)));
    if report.config.clock == ClockModel::Synchronised {
        panel.text("", 0.0, "taken as synchronised");
        panel.next();
    } else {
        for drone in report.drones.iter().take(CLOCKS) {
            let offset = drone
                .line
                .map_or_else(|| "unknown".to_owned(), |[offset_ns, _]| format!("{offset_ns:.1} ns"));
            panel.text("", 0.0, &format!("drone {}", drone.id));
            panel.text("number", panel.width, &offset);
            panel.next();
        }
        if report.drones.len() > CLOCKS {
            panel.text("muted", 0.0, &format!("and {} more", report.drones.len() - CLOCKS));
            panel.next();
        }
    }
    panel.gap();
}
