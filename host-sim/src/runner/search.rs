//! Flies random search: the drones, boards, links and weather of missions, with another commander.

use super::{
    RunError,
    links::Outbox,
    setup::{self, link_delay_s},
};
use crate::{
    control::{
        mission::plan::PlannedDrone,
        random_search::{RandomSearch, SearchPlan, legs::Ground},
    },
    fleet::Hangar,
    geometry::V2,
    scenario::Scenario,
};
use rand_core::Rng;
use skyroost_firmware::{STEP_US, guidance::goto};
use skyroost_protocol::units::{DroneId, TimePs};
use std::sync::atomic::{AtomicBool, Ordering};

/// Steps between two words of the commander: 40 ms, of which a second is a multiple.
const WINDOW_STEPS: u64 = 2;
/// Steps of a second.
const SECOND_STEPS: u64 = 1_000_000 / STEP_US as u64;
/// How far a vehicle lags behind the velocity that it is told, seconds: what its velocity loop and its attitude take.
const LAG_S: f64 = 0.8;

/// Flies drones at random for so many seconds from when all are up, the last one included: second by second the true places
/// of those that search. Starts and headings come of `rng`, everything else of the scenario's seed.
///
/// # Errors
/// When there is no room for the pads, a drone does not come up, and [`RunError::Interrupted`] once `cancel` is set.
pub fn random_search(
    scenario: &Scenario,
    ground: Ground,
    seconds: u32,
    mut rng: impl Rng,
    cancel: &AtomicBool,
) -> Result<Vec<Vec<V2>>, RunError> {
    let fleet = &scenario.fleet;
    let passing_m = fleet.passing_m();
    let starts_m = ground.starts(fleet.drones as usize, passing_m, &mut rng);
    let near = |(index, at): (usize, &V2)| starts_m[..index].iter().any(|pad| (pad - at).norm() < passing_m);
    if starts_m.iter().enumerate().any(near) {
        return Err(RunError::Infeasible(format!(
            "the area has no room for the pads of {} drones that search at random; fewer would do",
            fleet.drones
        )));
    }
    let stand = |(id, at): (u16, &V2)| PlannedDrone { id: DroneId(id), pad_m: at.push(0.0), fleet: None };
    let drones: Vec<PlannedDrone> = (1..).zip(&starts_m).map(stand).collect();
    let keys = setup::simulated_keys(scenario.seed, drones.len());
    let mut islands = setup::islands(scenario, &drones, 0, &keys, &Hangar::InProc)?;
    let place_of: Vec<(usize, usize)> = (0..drones.len()).map(|drone| (drone, 0)).collect();
    let around = setup::surroundings(scenario, &[]);
    let plan = SearchPlan {
        starts_m,
        ground,
        altitude_m: fleet.altitude_m,
        d_safe_m: fleet.d_safe_m,
        vertical: fleet.vertical,
        relay_period: TimePs((scenario.link.share_period_s * 1e12) as i64),
        link_bytes_per_s: scenario.link.bytes_per_s(),
        keys,
        accel_mps2: fleet.max_accel_mps2,
        delay_s: link_delay_s(scenario) + LAG_S,
        brake_m: f64::from(goto::braking_m(fleet.speed_mps as f32)),
    };
    let mut commander = RandomSearch::new(plan, rng);
    let mut outbox = Outbox::default();
    let mut places_m = Vec::with_capacity(seconds as usize + 1);
    let (mut step, mut desks) = (0, Vec::new());
    loop {
        outbox.exchange(step * STEP_US as u64, &mut commander, &mut islands, &place_of)?;
        if let Some(started) = commander.started()
            && (step - started.0 as u64 / (STEP_US as u64 * 1_000_000)).is_multiple_of(SECOND_STEPS)
        {
            let searching = islands.iter().enumerate().filter(|(drone, _)| commander.searches(*drone));
            places_m.push(searching.map(|(_, island)| island.drones[0].vehicle.pos_enu_m().xy()).collect());
            if places_m.len() > seconds as usize {
                return Ok(places_m);
            }
        }
        if step.is_multiple_of(SECOND_STEPS) && cancel.load(Ordering::Relaxed) {
            return Err(RunError::Interrupted);
        }
        for island in &mut islands {
            island.run::<false>(step, WINDOW_STEPS, &around, &mut desks)?;
        }
        step += WINDOW_STEPS;
    }
}
