//! A run in the paper's closed model: nothing is flown but random search, and that by points.
//!
//! - `proposed`: every user is located, and its estimate lies anywhere within `r_e` of it, uniformly, as section 3.2 has it.
//!   Algorithm 2 places drones on the estimates with disks of `R_C - r_e`, each step solved exactly.
//! - `random`: random search over the mission time on the true positions. A base station hears whom it hears, so there
//!   is no error. It is counted at `R_C`, as the paper does, and at `R_C - r_e`, as the proposed method is; each count is the
//!   best of its kind.
//! - `full`: every user is located as well as the fleet can: its 95 % radius is the bound of a pass at a random distance
//!   from the lane ([`Formation::mission_radii_m`]: the scenario's noise, clocks unknown and shared), its error is normal, round,
//!   and within that radius with 95 %. All drones are placed together on the estimates with disks of `R_C` less each
//!   user's own radius; beyond [`MOST_TOGETHER`] users by Algorithm 2, as in missions.
//!
//! Guaranteed are users whose whole error disk is covered, actually served those within `R_C` of a drone in truth.

use std::f64::consts::TAU;
use std::time::Instant;

use rand_core::Rng;

use super::plan::{Method, Plan, Reading};
use super::runs::{Row, Run};
use super::search::{Ground, Track, grid, served_together};
use super::{RunFailure, Timed};
use crate::control::accuracy::{AccuracyError, Formation};
use crate::control::place::{
    Fleet, Objective, PlaceError, PlaceUser, Placement, TOLERANCE_M, place, place_joint,
};
use crate::geometry::V2;
use crate::rng::{self, Stream};
use crate::runner::formation::{fixed_orientation_rad, slot_m};
use crate::scenario::Scenario;
use crate::world::users::poisson_places;

/// More users are placed for greedily, as in missions: their sheer number leaves little to gain.
pub const MOST_TOGETHER: usize = 20_000;

/// Radius in standard deviations that holds 95 % of a round normal error: `sqrt(-2 ln 0.05)`.
const SIGMAS_OF_R95: f64 = 2.447_746_830_680_816;

/// What all runs of a campaign have in common.
#[derive(Clone, Debug)]
pub struct Closed {
    side_m: V2,
    radius_m: f64,
    ground: Ground,
    seconds: u32,
    reading: Reading,
    methods: Vec<Method>,
    /// Offset from the lane and 95 % radius, from the lane outwards; empty where no method needs them.
    radii_m: Vec<[f64; 2]>,
    /// Farthest that a user is from the lane that locates it.
    swath_radius_m: f64,
}

impl Closed {
    /// Prepares the runs of a plan.
    ///
    /// # Errors
    /// Where the formation cannot tell how well it locates, and a method asks for that.
    pub fn new(plan: &Plan) -> Result<Self, AccuracyError> {
        let Plan { campaign, scenario } = plan;
        let side_m = V2::new(scenario.area.width_m, scenario.area.height_m);
        let (radius_m, speed_mps) = (scenario.fleet.radius_m, scenario.fleet.speed_mps);
        let formation = formation(scenario);
        let asked = campaign.methods.contains(&Method::Full);
        Ok(Self {
            side_m,
            radius_m,
            ground: Ground { side_m, radius_m, speed_mps },
            seconds: scenario.mission.time_s as u32,
            reading: campaign.random_search,
            methods: campaign.methods.clone(),
            radii_m: if asked { formation.mission_radii_m()? } else { Vec::new() },
            swath_radius_m: formation.swath_radius_m(),
        })
    }

    /// Does a run: a row for each method, in the plan's order.
    ///
    /// # Errors
    /// What the methods refuse; a checked plan gives them no reason.
    pub fn rows(&self, run: &Run) -> Result<Vec<Timed>, RunFailure> {
        let box_m = (V2::zeros(), self.side_m);
        let users_m = poisson_places(run.density_per_km2, box_m, |_| true, &mut run.stream(Stream::Users))?;
        let timed = |&method: &Method| {
            let begun = Instant::now();
            let served = match method {
                Method::Proposed => self.proposed(run, &users_m)?,
                Method::Random => self.random(run, &users_m),
                Method::Full => self.full(run, &users_m)?,
            };
            let row: Row = run.row(method, users_m.len(), served);
            Ok(Timed { row, wall_s: begun.elapsed().as_secs_f64() })
        };
        self.methods.iter().map(timed).collect()
    }

    fn proposed(&self, run: &Run, users_m: &[V2]) -> Result<[usize; 2], PlaceError> {
        let mut rng = run.stream(Stream::Declared);
        let mut disk = |user: &V2| PlaceUser {
            pos_m: user + within_disk(&mut rng, run.r_e_m),
            radius_m: self.radius_m - run.r_e_m,
            weight: 1.0,
        };
        let disks: Vec<PlaceUser> = users_m.iter().map(&mut disk).collect();
        let placement = place(Objective::Guaranteed(&disks), fleet(run))?;
        Ok([placement.covered, self.served(users_m, &placement)])
    }

    fn random(&self, run: &Run, users_m: &[V2]) -> [usize; 2] {
        let rng = run.stream(Stream::Search);
        let track = Track::at_random(self.ground, run.drones as usize, self.seconds, rng);
        let actual = track.served(users_m, self.radius_m, self.reading);
        let guaranteed = if run.r_e_m > 0.0 {
            track.served(users_m, self.radius_m - run.r_e_m, self.reading)
        } else {
            actual
        };
        [guaranteed, actual]
    }

    fn full(&self, run: &Run, users_m: &[V2]) -> Result<[usize; 2], PlaceError> {
        let mut rng = run.stream(Stream::Modelled);
        let mut disk = |user: &V2| {
            let r95_m = self.r95_m(rng::unit(&mut rng) * self.swath_radius_m);
            let sigma_m = r95_m / SIGMAS_OF_R95;
            let error_m = V2::new(rng::normal(&mut rng), rng::normal(&mut rng)) * sigma_m;
            let located = r95_m.is_finite();
            located.then(|| PlaceUser { pos_m: user + error_m, radius_m: self.radius_m - r95_m, weight: 1.0 })
        };
        let disks: Vec<PlaceUser> = users_m.iter().filter_map(&mut disk).collect();
        let placement = place_all(&disks, fleet(run))?;
        Ok([placement.covered, self.served(users_m, &placement)])
    }

    /// Users who are in range of a drone in truth.
    fn served(&self, users_m: &[V2], placement: &Placement) -> usize {
        let sites_m: Vec<V2> = placement.sites.iter().flatten().map(|site| site.pos_m).collect();
        let reach_m = self.radius_m + TOLERANCE_M;
        served_together(&grid(users_m, reach_m), &sites_m, reach_m)
    }

    /// The 95 % radius at an offset from the lane, between those known linearly, beyond them as the last.
    fn r95_m(&self, offset_m: f64) -> f64 {
        let beyond = self.radii_m.partition_point(|[at_m, _]| *at_m <= offset_m);
        match (self.radii_m.get(beyond.wrapping_sub(1)), self.radii_m.get(beyond)) {
            (Some([from_m, near_m]), Some([to_m, far_m])) => {
                near_m + (far_m - near_m) * (offset_m - from_m) / (to_m - from_m)
            }
            (Some([_, r95_m]), None) | (None, Some([_, r95_m])) => *r95_m,
            (None, None) => f64::INFINITY,
        }
    }
}

/// All drones together, or greedily where users are too many for that.
pub(super) fn place_all(disks: &[PlaceUser], fleet: Fleet) -> Result<Placement, PlaceError> {
    if disks.len() > MOST_TOGETHER {
        place(Objective::Guaranteed(disks), fleet)
    } else {
        place_joint(disks, fleet, None)
    }
}

/// Drones may hover as near to each other as they like: the paper keeps them apart by altitude or not at all.
fn fleet(run: &Run) -> Fleet {
    Fleet { drones: run.drones as usize, min_separation_m: 0.0 }
}

/// Uniform in a disk about the origin.
fn within_disk(rng: &mut impl Rng, radius_m: f64) -> V2 {
    let (sin, cos) = (TAU * rng::unit(rng)).sin_cos();
    V2::new(cos, sin) * (radius_m * rng::unit(rng).sqrt())
}

/// The formation that a scenario flies, on a lane that leads east.
fn formation(scenario: &Scenario) -> Formation {
    let orientation_rad = fixed_orientation_rad(0.0);
    Formation {
        corners: [0, 1, 2].map(|slot| slot_m(orientation_rad, slot, 1.0)),
        spacing_m: scenario.fleet.spacing_m,
        altitude_m: scenario.fleet.altitude_m - scenario.users.altitude_m,
        speed_mps: scenario.fleet.speed_mps,
        radius_m: scenario.fleet.radius_m,
        srs_period_s: scenario.srs.period_s,
        // Of the mean of all symbols; the tick's own noise remains.
        sigma_toa_ns: (scenario.srs.sigma_toa_ns / f64::from(scenario.srs.symbols).sqrt()).max(0.3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::plan::PlanOverrides;
    use crate::world::moments;

    fn closed(campaign: &str) -> (Plan, Closed) {
        let plan = Plan::from_toml(&format!("[campaign]\n{campaign}"), "plan.toml", PlanOverrides::default())
            .unwrap();
        let closed = Closed::new(&plan).unwrap();
        (plan, closed)
    }

    #[test]
    fn truth_errors_are_uniform_in_the_disk() {
        let mut rng = rng::stream(1, Stream::Declared, 0);
        let draws: Vec<V2> = (0..40_000).map(|_| within_disk(&mut rng, 30.0)).collect();
        assert!(draws.iter().all(|draw| draw.norm() <= 30.0));
        // Of a uniform disk: each coordinate has variance R^2/4, the mean distance is 2R/3.
        let (mean, variance) = moments(draws.iter().map(|draw| draw.x));
        assert!(mean.abs() < 0.3 && (variance / 225.0 - 1.0).abs() < 0.03, "{mean} {variance}");
        let (mean, _) = moments(draws.iter().map(V2::norm));
        assert!((mean - 20.0).abs() < 0.15, "{mean}");
    }

    /// 95 % of the errors that `full` draws are within the radius that it claims.
    #[test]
    fn truth_the_radius_holds_95_percent() {
        let mut rng = rng::stream(1, Stream::Modelled, 0);
        let within = |_| V2::new(rng::normal(&mut rng), rng::normal(&mut rng)).norm() <= SIGMAS_OF_R95;
        let share = (0..100_000).map(within).filter(|within| *within).count() as f64 / 1e5;
        assert!((share - 0.95).abs() < 4.0 * (0.95 * 0.05 / 1e5_f64).sqrt(), "{share}");
    }

    /// Known of missions: about 6 m over the swath with clocks known, 8.6 m in the median as flown.
    #[test]
    fn modelled_radii_are_those_of_missions() {
        let (_, closed) = closed("densities_per_km2 = [5]");
        let radii: Vec<f64> =
            (0..100).map(|k| closed.r95_m(f64::from(k) * closed.swath_radius_m / 100.0)).collect();
        assert!(radii.iter().all(|r95_m| (4.0..40.0).contains(r95_m)), "{radii:?}");
        let mut sorted = radii.clone();
        sorted.sort_by(f64::total_cmp);
        assert!((6.0..12.0).contains(&sorted[50]), "{}", sorted[50]);
        let [[_, first], ..] = closed.radii_m[..] else { panic!("no radii") };
        assert!((closed.r95_m(0.0) - first).abs() < 1e-12);
    }

    #[test]
    fn every_row_keeps_what_it_says() {
        let (plan, closed) =
            closed("seeds = 3\ndensities_per_km2 = [0, 2, 20]\nr_e_m = [30, 0]\ndrones = [2, 6]");
        for number in 0..plan.runs() {
            let run = plan.run(number).unwrap();
            let rows = closed.rows(&run).unwrap();
            assert_eq!(rows.iter().map(|it| it.row.method).collect::<Vec<_>>(), plan.campaign.methods);
            let again = closed.rows(&run).unwrap();
            for (Timed { row, .. }, again) in rows.iter().zip(&again) {
                assert_eq!(row, &again.row);
                assert!(row.served_actual <= row.users, "{row:?}");
                // Errors stay within the radius, so guaranteed users are served; a normal error may leave its radius.
                if row.method != Method::Full {
                    assert!(row.served_guaranteed <= row.served_actual, "{row:?}");
                }
                if row.r_e_m == 0.0 && row.method != Method::Full {
                    assert_eq!(row.served_guaranteed, row.served_actual, "{row:?}");
                }
                assert_eq!(row.users, rows[0].row.users);
            }
        }
    }

    #[test]
    fn greedy_among_visited_places_serves_no_less() {
        let served = |reading: &str| {
            let (plan, closed) = closed(&format!("densities_per_km2 = [20]\nrandom_search = \"{reading}\""));
            let run = plan.run(0).unwrap();
            closed.rows(&run).unwrap()[1].row.served_actual
        };
        assert!(served("greedy") > served("simultaneous"));
    }
}
