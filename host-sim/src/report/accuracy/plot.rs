//! Three charts: radii against the offset for several sides, for several altitudes, and against the error of clocks.

use std::fmt::Write as _;

use crate::control::accuracy::{Accuracy, Curve, SYNC_USERS, Sync};
use crate::report::chart::{Axis, Chart, Line, STYLE};
use crate::report::map::view::px;
use crate::report::map::{HEADER_PX, MARGIN_PX, header};

/// Size of a chart, and what lies between two.
const CHART_PX: [f64; 2] = [372.0, 440.0];
const GAP_PX: f64 = 30.0;
/// Right of a chart for the names of curves.
const NAMES_PX: f64 = 56.0;
/// Colours that curves may have.
const COLOURS: usize = 6;

/// Draws the whole picture; the same figures give the same bytes.
pub(super) fn render(accuracy: &Accuracy) -> String {
    let formation = &accuracy.formation;
    let subtitle = format!(
        "95 % radius of a whole pass in metres · noise {} ns, d = {} m, h = {} m, {} m/s, R = {} m unless said otherwise",
        formation.sigma_toa_ns,
        formation.spacing_m,
        formation.altitude_m,
        formation.speed_mps,
        formation.radius_m
    );
    let [width, height] = CHART_PX;
    let size_px = [2.0 * MARGIN_PX + 3.0 * width + 2.0 * GAP_PX, HEADER_PX + height + MARGIN_PX];
    let mut svg = header("How well a formation locates", &subtitle, STYLE, size_px);
    let Accuracy { spacing_curves, altitude_curves, residual_curves, .. } = accuracy;
    let all = spacing_curves.iter().chain(altitude_curves).chain(residual_curves);
    let y = Axis::logarithmic(all.flat_map(|curve| &curve.points).map(|point| point[1]));
    let widest_m = spacing_curves.iter().chain(altitude_curves).flat_map(|curve| &curve.points);
    let offset = Axis::linear(widest_m.map(|point| point[0]).fold(1.0, f64::max));
    let place_px = |column: f64| [MARGIN_PX + column * (width + GAP_PX), HEADER_PX, width, height];
    let x_name = "distance of the user from the lane, m";
    for (column, (head, curves, own)) in [
        ("by the side of the triangle", spacing_curves, formation.spacing_m),
        ("by altitude", altitude_curves, formation.altitude_m),
    ]
    .into_iter()
    .enumerate()
    {
        let place_px = place_px(column as f64);
        let chart = Chart { place_px, names_px: NAMES_PX, head, x: offset, y, x_name };
        chart.draw(&mut svg, &lines(curves, own));
    }
    let residual = Axis::logarithmic([0.1, 9.99].into_iter());
    let chart = Chart {
        place_px: place_px(2.0),
        names_px: NAMES_PX,
        head: "by the error of clocks",
        x: residual,
        y,
        x_name: "constant error of each trusted clock, ns",
    };
    let mut clocks = lines(residual_curves, f64::NAN);
    clocks.extend(estimated(accuracy));
    chart.draw(&mut svg, &clocks);
    legend(&mut svg, &chart);
    svg.push_str("</svg>\n");
    svg
}

/// Curves with a name each; one's own formation stands out.
fn lines(curves: &[Curve], own: f64) -> Vec<Line> {
    let line = |(i, curve): (usize, &Curve)| {
        let weight = if (curve.of - own).abs() <= 1e-9 * own { " own" } else { "" };
        Line {
            class: format!("c{}{weight}", i % COLOURS),
            name: format!("{} m", curve.of),
            points: curve.points.clone(),
            band: Vec::new(),
        }
    };
    curves.iter().enumerate().map(line).collect()
}

/// What is reached where the clocks are estimated, at the offsets of the curves.
fn estimated(accuracy: &Accuracy) -> Vec<Line> {
    let Some(mission) = accuracy.sync.iter().find(|row| row.of == Sync::Mission) else { return Vec::new() };
    let level_m = |curve: &Curve| {
        let at = accuracy.offset_m.iter().position(|offset_m| (offset_m - curve.of).abs() < 1e-9)?;
        mission.r95_m.get(at).copied()
    };
    let line = |(i, curve): (usize, &Curve)| {
        let level_m = level_m(curve)?;
        let points = curve.points.iter().map(|point| [point[0], level_m]).collect();
        let class = format!("c{} dashed", i % COLOURS);
        Some(Line { class, name: String::new(), points, band: Vec::new() })
    };
    accuracy.residual_curves.iter().enumerate().filter_map(line).collect()
}

/// What full and dashed curves are, in the corner that they leave free.
fn legend(svg: &mut String, chart: &Chart) {
    let [left, top, _, height] = chart.frame_px();
    for (line, (class, text)) in [
        ("", "trusted, at 3 distances from the lane".to_owned()),
        ("dashed", format!("estimated with {SYNC_USERS} users, as in missions")),
    ]
    .into_iter()
    .enumerate()
    {
        let y = top + height - 32.0 + 18.0 * line as f64;
        let _ = writeln!(
            svg,
            "<path class=\"curve sample {class}\" d=\"M{} {}h22\"/><text class=\"small halo\" x=\"{}\" y=\"{}\">{text}</text>",
            px(left + 10.0),
            px(y - 4.0),
            px(left + 40.0),
            px(y)
        );
    }
}
