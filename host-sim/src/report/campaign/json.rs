//! Every number of every figure, for scripts.

use serde::Serialize;

use super::CampaignReport;
use crate::campaign::figures::{Comparison, Curve, Figure};
use crate::campaign::plan::{Fidelity, Method};
use crate::campaign::statistics::Estimate;

#[derive(Serialize)]
struct Answer<'a> {
    name: &'a str,
    fidelity: Fidelity,
    seeds: u32,
    figures: Vec<FigureAnswer>,
}

#[derive(Serialize)]
struct FigureAnswer {
    r_e_m: f64,
    drones: u32,
    picture: String,
    curves: Vec<CurveAnswer>,
    comparisons: Vec<ComparisonAnswer>,
}

#[derive(Serialize)]
struct CurveAnswer {
    method: Method,
    count: &'static str,
    points: Vec<PointAnswer>,
}

#[derive(Serialize)]
struct ComparisonAnswer {
    method: Method,
    count: &'static str,
    /// How random search is counted.
    against: &'static str,
    points: Vec<PointAnswer>,
    /// Null where the difference does not fall to zero.
    crossover_per_km2: Option<f64>,
    /// The upper end is null where it may lie beyond the last density.
    crossover_interval_per_km2: Option<[Option<f64>; 2]>,
}

#[derive(Serialize)]
struct PointAnswer {
    density_per_km2: f64,
    mean: f64,
    /// Ends of the 95 % interval; null for a single run.
    low: Option<f64>,
    high: Option<f64>,
    runs: usize,
}

pub(super) fn render(report: &CampaignReport) -> String {
    let campaign = &report.plan.campaign;
    let figure = |figure: &Figure| FigureAnswer {
        r_e_m: figure.r_e_m,
        drones: figure.drones,
        picture: report.picture_file(figure),
        curves: figure.curves.iter().map(curve).collect(),
        comparisons: figure.comparisons.iter().map(comparison).collect(),
    };
    let answer = Answer {
        name: &report.plan.scenario.name,
        fidelity: campaign.fidelity,
        seeds: campaign.seeds,
        figures: report.figures.iter().map(figure).collect(),
    };
    // Plain data with names for keys: there is nothing in it that JSON could not say.
    serde_json::to_string(&answer).map_or_else(|_| String::new(), |text| text + "\n")
}

fn curve(curve: &Curve) -> CurveAnswer {
    CurveAnswer { method: curve.method, count: curve.count.name(), points: points(&curve.points) }
}

fn comparison(it: &Comparison) -> ComparisonAnswer {
    ComparisonAnswer {
        method: it.method,
        count: it.count.name(),
        against: it.against.name(),
        points: points(&it.points),
        crossover_per_km2: it.crossover.map(|crossover| crossover.at),
        crossover_interval_per_km2: it.crossover.map(|crossover| crossover.interval.map(finite)),
    }
}

fn points(points: &[(f64, Estimate)]) -> Vec<PointAnswer> {
    let point = |&(density_per_km2, it): &(f64, Estimate)| {
        let [low, high] = it.interval().map(finite);
        PointAnswer { density_per_km2, mean: it.mean, low, high, runs: it.count }
    };
    points.iter().map(point).collect()
}

fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}
