//! A figure as two charts: who is served, and how many more than by random search. Bands are 95 % intervals of the means.

use std::fmt::Write as _;

use super::{CampaignReport, counted, distinct, distinct_comparisons, title};
use crate::campaign::figures::{Count, Figure};
use crate::campaign::plan::{Fidelity, Method};
use crate::campaign::statistics::Estimate;
use crate::report::chart::{self, Axis, Chart, Line};
use crate::report::map::view::px;
use crate::report::map::{HEADER_PX, MARGIN_PX, header};

const STYLE: &str = include_str!("style.css");

/// Size of a chart, what lies between two, and room for the names of curves.
const CHART_PX: [f64; 2] = [590.0, 470.0];
const GAP_PX: f64 = 24.0;
const NAMES_PX: f64 = 208.0;

/// Draws the whole picture; the same figures give the same bytes.
pub(super) fn render(report: &CampaignReport, figure: &Figure) -> String {
    let (campaign, scenario) = (&report.plan.campaign, &report.plan.scenario);
    let fidelity = match campaign.fidelity {
        Fidelity::Paper => "closed model of the paper",
        Fidelity::Flight => "every run flown",
    };
    let subtitle = format!(
        "{} drones, r_e = {} m, R_C = {} m, {} km x {} km · {fidelity} · {} seeds · bands: 95 % intervals of the mean",
        figure.drones,
        figure.r_e_m,
        scenario.fleet.radius_m,
        scenario.area.width_m * 1e-3,
        scenario.area.height_m * 1e-3,
        campaign.seeds
    );
    let [width, height] = CHART_PX;
    let size_px = [2.0 * MARGIN_PX + 2.0 * width + GAP_PX, HEADER_PX + height + MARGIN_PX];
    let style = [chart::STYLE, STYLE].concat();
    let mut svg = header(&format!("Users served: {}", scenario.name), &subtitle, &style, size_px);
    let x = Axis::linear(campaign.densities_per_km2.iter().copied().fold(1.0, f64::max));
    let x_name = "users per km²";
    let left = [MARGIN_PX, HEADER_PX, width, height];
    let right = [MARGIN_PX + width + GAP_PX, HEADER_PX, width, height];

    let curves: Vec<Line> = distinct(figure)
        .map(|curve| {
            let name = if figure.r_e_m > 0.0 || curve.method == Method::Full {
                format!("{}, {}", title(curve.method), counted(curve.method, curve.count))
            } else {
                title(curve.method).to_owned()
            };
            line(curve.method, is_bold(curve.method, curve.count), name, &curve.points)
        })
        .collect();
    let y = Axis::around_zero(ordinates(&curves));
    let served = Chart { place_px: left, names_px: NAMES_PX, head: "users served on average", x, y, x_name };
    served.draw(&mut svg, &curves);

    let differences: Vec<Line> = distinct_comparisons(figure)
        .map(|it| {
            let name = match (it.count, it.against) {
                (Count::Guaranteed, Count::Actual) => format!("{}, the paper's count", title(it.method)),
                _ if figure.r_e_m > 0.0 => format!("{}, both {}", title(it.method), it.count.name()),
                _ => title(it.method).to_owned(),
            };
            line(it.method, it.against == Count::Actual && it.count == Count::Guaranteed, name, &it.points)
        })
        .collect();
    if !differences.is_empty() {
        let y = Axis::around_zero(ordinates(&differences));
        let head = "more than by random search, on the same users";
        let more = Chart { place_px: right, names_px: NAMES_PX, head, x, y, x_name };
        more.draw(&mut svg, &differences);
        let ([left, _, width, _], zero) = (more.frame_px(), more.ordinate_px(0.0));
        let _ = writeln!(svg, "<path class=\"zero\" d=\"M{} {}h{}\"/>", px(left), px(zero), px(width));
    }
    svg.push_str("</svg>\n");
    svg
}

/// The curves of the paper's own convention.
fn is_bold(method: Method, count: Count) -> bool {
    (method == Method::Random) == (count == Count::Actual)
}

fn line(method: Method, bold: bool, name: String, points: &[(f64, Estimate)]) -> Line {
    let colour = match method {
        Method::Proposed => "c0",
        Method::Random => "c1",
        Method::Full => "c2",
    };
    Line {
        class: format!("{colour} {}", if bold { "own" } else { "dashed" }),
        name,
        points: points.iter().map(|(x, it)| [*x, it.mean]).collect(),
        band: points.iter().map(|(_, it)| it.interval()).collect(),
    }
}

fn ordinates(lines: &[Line]) -> impl Iterator<Item = f64> {
    lines
        .iter()
        .flat_map(|line| line.points.iter().map(|point| point[1]).chain(line.band.iter().flatten().copied()))
}
