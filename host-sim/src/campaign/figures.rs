//! The figures of a campaign: one for each error radius and number of drones, curves over the density.
//!
//! Figure 6 of the paper sets the proposed method, counted at `R_C - r_e`, against random search, counted at `R_C`. Every
//! figure here has both counts of every method, so that it can be seen what the convention does.

use super::plan::{Method, Plan};
use super::runs::Row;
use super::statistics::{Crossover, Estimate, crossover};
use crate::rng::{self, Stream};

/// Which users count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// Those whose whole error disk is covered; of random search, those within `R_C - r_e`.
    Guaranteed,
    /// Those whose true position is covered.
    Actual,
}

impl Count {
    /// As results spell it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Guaranteed => "guaranteed",
            Self::Actual => "actual",
        }
    }

    fn of(self, row: &Row) -> f64 {
        match self {
            Self::Guaranteed => row.served_guaranteed as f64,
            Self::Actual => row.served_actual as f64,
        }
    }
}

/// A method counted in one way.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// The method.
    pub method: Method,
    /// Who counts.
    pub count: Count,
    /// By density, ascending: users served on average.
    pub points: Vec<(f64, Estimate)>,
}

/// What a method serves more than random search, on the same users.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The method and who counts of its users.
    pub method: Method,
    /// Who counts of its users.
    pub count: Count,
    /// Who counts of those of random search.
    pub against: Count,
    /// By density, ascending: the difference on average.
    pub points: Vec<(f64, Estimate)>,
    /// Density at which it falls to zero, if it does.
    pub crossover: Option<Crossover>,
}

/// Everything at one error radius and number of drones.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Error of position that the proposed method assumes.
    pub r_e_m: f64,
    /// Number of drones.
    pub drones: u32,
    /// Every method, counted both ways.
    pub curves: Vec<Curve>,
    /// Every other method against random search, if that was run: by the paper's convention, then both counted alike.
    pub comparisons: Vec<Comparison>,
}

/// The conventions that methods are compared by: the paper's first.
const CONVENTIONS: [[Count; 2]; 3] = [
    [Count::Guaranteed, Count::Actual],
    [Count::Guaranteed, Count::Guaranteed],
    [Count::Actual, Count::Actual],
];

/// All figures of a campaign, from its rows.
#[must_use]
pub fn figures(plan: &Plan, rows: &[Row]) -> Vec<Figure> {
    let campaign = &plan.campaign;
    let mut densities = campaign.densities_per_km2.clone();
    densities.sort_by(f64::total_cmp);
    let all =
        campaign.r_e_m.iter().flat_map(|&r_e_m| campaign.drones.iter().map(move |&drones| (r_e_m, drones)));
    let of = |(index, (r_e_m, drones)): (usize, (f64, u32))| {
        let own: Vec<&Row> =
            rows.iter().filter(|row| row.drones == drones && row.r_e_m.total_cmp(&r_e_m).is_eq()).collect();
        let table = Table { densities: &densities, rows: &own };
        let curve = |&method: &Method| {
            [Count::Guaranteed, Count::Actual].map(|count| {
                let points = table.estimates(|density| table.values(method, count, density));
                Curve { method, count, points }
            })
        };
        let curves = campaign.methods.iter().flat_map(curve).collect();
        let searched = campaign.methods.contains(&Method::Random);
        let others = campaign.methods.iter().filter(|method| searched && **method != Method::Random);
        let pairs = others.flat_map(|&method| CONVENTIONS.map(|convention| (method, convention)));
        let comparison = |(nth, (method, [count, against])): (usize, (Method, [Count; 2]))| {
            let difference = |density: f64| -> Vec<f64> {
                let ours = table.values(method, count, density);
                // Rows of a run follow each other, so that both are in order of the run.
                let theirs = table.values(Method::Random, against, density);
                ours.iter().zip(&theirs).map(|(a, b)| a - b).collect()
            };
            let differences: Vec<(f64, Vec<f64>)> =
                densities.iter().map(|&density| (density, difference(density))).collect();
            let mut rng = rng::stream(campaign.base_seed, Stream::Bootstrap, (index * 64 + nth) as u64);
            Comparison {
                method,
                count,
                against,
                points: table.estimates(difference),
                crossover: crossover(&differences, &mut rng),
            }
        };
        Figure { r_e_m, drones, curves, comparisons: pairs.enumerate().map(comparison).collect() }
    };
    all.enumerate().map(of).collect()
}

/// The rows of one figure.
struct Table<'a> {
    densities: &'a [f64],
    rows: &'a [&'a Row],
}

impl Table<'_> {
    fn values(&self, method: Method, count: Count, density: f64) -> Vec<f64> {
        let own = |row: &&&Row| row.method == method && row.density_per_km2.total_cmp(&density).is_eq();
        self.rows.iter().filter(own).map(|row| count.of(row)).collect()
    }

    fn estimates(&self, values: impl Fn(f64) -> Vec<f64>) -> Vec<(f64, Estimate)> {
        let estimate = |&density: &f64| Some((density, Estimate::of(&values(density))?));
        self.densities.iter().filter_map(estimate).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::plan::PlanOverrides;

    /// A campaign whose results are made up: proposed falls below random search at 20 users/km².
    fn made_up() -> (Plan, Vec<Row>) {
        let toml = "[campaign]\nseeds = 10\ndensities_per_km2 = [30, 10]\nr_e_m = [30, 0]\nmethods = [\"random\", \"proposed\"]";
        let plan = Plan::from_toml(toml, "plan.toml", PlanOverrides::default()).unwrap();
        let row = |run: u64, method: Method| {
            let run = plan.run(run).unwrap();
            let shift = run.seed as usize;
            let served = match method {
                Method::Random => [100 + shift, 120 + shift],
                _ if run.density_per_km2 > 20.0 => [110 + shift, 125 + shift],
                _ => [130 + shift, 140 + shift],
            };
            run.row(method, 1000, served)
        };
        let rows = (0..plan.runs())
            .flat_map(|run| [Method::Random, Method::Proposed].map(|method| row(run, method)));
        let rows = rows.collect();
        (plan, rows)
    }

    #[test]
    fn curves_and_comparisons_by_density() {
        let (plan, rows) = made_up();
        let all = figures(&plan, &rows);
        assert_eq!(all.iter().map(|it| (it.r_e_m, it.drones)).collect::<Vec<_>>(), [(30.0, 6), (0.0, 6)]);
        let figure = &all[0];
        let means =
            |curve: &Curve| curve.points.iter().map(|(x, it)| (*x, it.mean, it.count)).collect::<Vec<_>>();
        assert_eq!(means(&figure.curves[0]), [(10.0, 105.5, 10), (30.0, 105.5, 10)]);
        assert_eq!(means(&figure.curves[2]), [(10.0, 135.5, 10), (30.0, 115.5, 10)]);
        // By the paper's convention +10 and -10; counted alike always above.
        let found: Vec<_> = figure.comparisons.iter().map(|it| it.crossover.map(|it| it.at)).collect();
        assert_eq!(found, [Some(20.0), None, None]);
        let differences: Vec<f64> = figure.comparisons[0].points.iter().map(|(_, it)| it.mean).collect();
        assert_eq!(differences, [10.0, -10.0]);
        // On the same users: what both share does not widen the interval.
        assert!(figure.comparisons[0].points[0].1.half_width < 1e-9);
        assert_eq!(figures(&plan, &rows), all);
    }
}
