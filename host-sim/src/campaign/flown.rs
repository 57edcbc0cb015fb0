//! A run that is flown: sweep, localization and placement by the flight code and the control center of missions.
//!
//! - `full`: what the mission itself came to: users with their estimated 95 % radii, drones placed by it and flown there.
//! - `proposed`: Algorithm 2 on the estimates of the same flight, every user taken to be within `r_e` of its estimate. It
//!   may be farther away: what is guaranteed is then not what is served.
//! - `random`: random search flown by the same boards, from the starts and first headings of the closed model.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use rand_core::Rng as _;

use super::plan::{Method, Plan, Reading};
use super::runs::Run;
use super::search::{Ground, Track, grid, served_together};
use super::{RunFailure, Timed};
use crate::control::place::{Fleet, Objective, PlaceUser, TOLERANCE_M, place};
use crate::fleet::Backend;
use crate::geometry::V2;
use crate::geometry::polygon::Polygon;
use crate::rng::Stream;
use crate::runner::{
    self, InputError, MissionArea, MissionInput, MissionKeys, Outcome, RunError, RunOptions,
};
use crate::scenario::Scenario;
use crate::world::users::poisson_users;

/// What all runs of a campaign have in common.
#[derive(Clone, Debug)]
pub struct Flown {
    scenario: Scenario,
    methods: Vec<Method>,
    reading: Reading,
}

impl Flown {
    /// Prepares the runs of a plan.
    #[must_use]
    pub fn new(plan: &Plan) -> Self {
        let Plan { campaign, scenario } = plan.clone();
        Self { scenario, methods: campaign.methods, reading: campaign.random_search }
    }

    /// Does a run: a row for each method, in the plan's order.
    ///
    /// # Errors
    /// What the mission or the methods refuse, and [`RunError::Interrupted`] once `cancel` is set.
    pub fn rows(&self, run: &Run, cancel: &AtomicBool) -> Result<Vec<Timed>, RunFailure> {
        let scenario = self.scenario_of(run);
        let flies = self.methods.iter().any(|method| *method != Method::Random);
        let begun = Instant::now();
        let outcome = if flies { Some(fly(&scenario, cancel)?) } else { None };
        let flown_s = begun.elapsed().as_secs_f64();
        let users_m: Vec<V2> = match &outcome {
            Some(outcome) => outcome.recording.users.iter().map(|user| V2::from(user.truth_m)).collect(),
            None => {
                let box_m = (V2::zeros(), side_m(&scenario));
                let users = poisson_users(run.density_per_km2, box_m, |_| true, scenario.seed)?;
                users.into_iter().map(|user| user.pos_m).collect()
            }
        };
        let timed = |&method: &Method| {
            let begun = Instant::now();
            let served = match (method, &outcome) {
                (Method::Full, Some(Outcome { summary, .. })) => {
                    [summary.placement.served_guaranteed, summary.placement.served_actual]
                        .map(|served| served as usize)
                }
                (Method::Proposed, Some(outcome)) => self.proposed(run, &users_m, outcome)?,
                _ => self.random(run, &scenario, &users_m, cancel)?,
            };
            let own_s = begun.elapsed().as_secs_f64();
            let wall_s = if method == Method::Random { own_s } else { own_s + flown_s };
            Ok(Timed { row: run.row(method, users_m.len(), served), wall_s })
        };
        self.methods.iter().map(timed).collect()
    }

    /// The scenario with the run's own users, drones and chance.
    fn scenario_of(&self, run: &Run) -> Scenario {
        let mut scenario = self.scenario.clone();
        scenario.seed = run.stream(Stream::Scenario).next_u64();
        scenario.users.density_per_km2 = run.density_per_km2;
        scenario.fleet.drones = run.drones;
        scenario
    }

    fn proposed(&self, run: &Run, users_m: &[V2], outcome: &Outcome) -> Result<[usize; 2], RunFailure> {
        let radius_m = self.scenario.fleet.radius_m;
        let located = outcome.recording.users.iter().filter_map(|user| user.estimate_m);
        let disk =
            |at: [f64; 2]| PlaceUser { pos_m: V2::from(at), radius_m: radius_m - run.r_e_m, weight: 1.0 };
        let disks: Vec<PlaceUser> = located.map(disk).collect();
        let fleet = Fleet { drones: run.drones as usize, min_separation_m: 0.0 };
        let placement = place(Objective::Guaranteed(&disks), fleet)?;
        let sites_m: Vec<V2> = placement.sites.iter().flatten().map(|site| site.pos_m).collect();
        let reach_m = radius_m + TOLERANCE_M;
        Ok([placement.covered, served_together(&grid(users_m, reach_m), &sites_m, reach_m)])
    }

    fn random(
        &self,
        run: &Run,
        scenario: &Scenario,
        users_m: &[V2],
        cancel: &AtomicBool,
    ) -> Result<[usize; 2], RunError> {
        let Scenario { fleet, mission, .. } = scenario;
        let ground =
            Ground { side_m: side_m(scenario), radius_m: fleet.radius_m, speed_mps: fleet.speed_mps };
        let rng = run.stream(Stream::Search);
        let places_m = runner::random_search(scenario, ground, mission.time_s as u32, rng, cancel)?;
        let track = Track::of_places(run.drones as usize, &places_m);
        Ok([fleet.radius_m - run.r_e_m, fleet.radius_m]
            .map(|radius_m| track.served(users_m, radius_m, self.reading)))
    }
}

fn side_m(scenario: &Scenario) -> V2 {
    V2::new(scenario.area.width_m, scenario.area.height_m)
}

/// Flies the mission of a scenario whose area is a rectangle.
fn fly(scenario: &Scenario, cancel: &AtomicBool) -> Result<Outcome, RunError> {
    let side_m = side_m(scenario);
    let corners = [[0.0, 0.0], [side_m.x, 0.0], [side_m.x, side_m.y], [0.0, side_m.y]].map(V2::from);
    let input = MissionInput {
        scenario: scenario.clone(),
        area: MissionArea {
            name: "area.width_m and area.height_m".to_owned(),
            region: Polygon::new(&corners).map_err(InputError::from)?.into(),
            origin_lon_lat_deg: None,
            left_out: Vec::new(),
        },
        obstacles: Vec::new(),
        fence: None,
        users: None,
        keys: MissionKeys::default(),
    };
    let options = RunOptions::new(1, Backend::InProc, cancel, &|_| {});
    // On a thread that is not of the pool: one of the pool that waits for the mission's own would begin further missions
    // meanwhile, one within the other.
    std::thread::scope(|scope| {
        let flight = scope.spawn(|| runner::fly(&input, &options));
        flight.join().unwrap_or_else(|_| Err(RunError::Link("the flight code panicked".to_owned())))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::plan::PlanOverrides;

    #[test]
    fn a_flown_run_has_what_its_mission_came_to() {
        let toml = "[campaign]\nfidelity = \"flight\"\nseeds = 1\ndensities_per_km2 = [20]\n\
                    [fleet]\ndrones = 3\n[area]\nwidth_m = 2000\nheight_m = 2000\n[mission]\ntime_s = 600\n";
        let plan = Plan::from_toml(toml, "plan.toml", PlanOverrides::default()).unwrap();
        let (flown, run) = (Flown::new(&plan), plan.run(0).unwrap());
        let rows = flown.rows(&run, &AtomicBool::new(false)).unwrap();
        let [proposed, random, full] = [0, 1, 2].map(|k| rows[k].row);
        assert_eq!(
            [proposed, random, full].map(|row| row.method),
            [Method::Proposed, Method::Random, Method::Full]
        );
        let outcome = fly(&flown.scenario_of(&run), &AtomicBool::new(false)).unwrap();
        let placement = &outcome.summary.placement;
        assert_eq!(
            [full.served_guaranteed, full.served_actual],
            [placement.served_guaranteed, placement.served_actual].map(u64::from)
        );
        assert_eq!(full.users, u64::from(outcome.summary.localization.users));
        assert!(proposed.served_guaranteed > 0 && proposed.served_actual <= full.served_actual);
        assert!(random.served_guaranteed <= random.served_actual && random.served_actual <= random.users);
        // Users of a run that flies nothing are the same.
        let alone = Flown { methods: vec![Method::Random], ..flown };
        assert_eq!(alone.rows(&run, &AtomicBool::new(false)).unwrap()[0].row, random);
    }
}
