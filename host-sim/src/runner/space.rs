//! What a mission may hit and must not leave, and whether its plan does.

use super::{MissionInput, RunError, flights::Flights};
use crate::{
    control::{
        airspace::{Airspace, border_distance_m, fence_around},
        area::Obstacle,
    },
    geometry::{V2, polygon::Polygon, region::Region},
    scenario::Scenario,
};
use skyroost_firmware::avoid::TRACKING_M;
use skyroost_protocol::message::MAX_WAYPOINTS;

/// Fleets meet with so much more room around them than they take, metres: the corners of their lanes need some.
const CORNERS_ROOM_M: f64 = 5.0;

/// The area's no-fly zones and what the obstacles' file names.
pub(super) fn obstacles(input: &MissionInput) -> Vec<Obstacle> {
    let zone = |(number, footprint): (usize, &Polygon)| Obstacle {
        name: format!("no-fly zone {number} of the area"),
        footprint: footprint.clone(),
        cylinder_m: None,
        top_m: None,
    };
    let zones = (1..).zip(input.area.region.no_fly()).map(zone);
    zones.chain(input.obstacles.iter().cloned()).collect()
}

/// What is to be covered: the area less obstacles without a top, where nobody is looked for either.
pub(super) fn region(input: &MissionInput) -> Result<Region, RunError> {
    let topless = input.obstacles.iter().filter(|it| it.top_m.is_none());
    let zones: Vec<Polygon> = topless.map(|it| it.footprint.clone()).collect();
    let left = input.area.region.without(&zones);
    left.map_err(|error| RunError::Infeasible(format!("{}: {error}", input.area.name)))
}

/// Where fleets may meet: the airspace less the room of a triangle that turns, before any lane is planned.
pub(super) fn room(
    input: &MissionInput,
    obstacles: &[Obstacle],
    pads_m: &[V2],
) -> Result<Airspace, RunError> {
    let scenario = &input.scenario;
    let clearance_m = scenario.obstacles.clearance_m;
    let triangle_m = triangle_m(scenario);
    let fence = match &input.fence {
        Some(fence) => fence.clone(),
        None => {
            let planned: Vec<V2> =
                input.area.region.outer_vertices_m().chain(pads_m.iter().copied()).collect();
            let by_m = scenario.fence.margin_m + triangle_m + clearance_m;
            fence_around(&planned, by_m).ok_or_else(|| too_narrow(clearance_m))?
        }
    };
    let room_m = clearance_m + triangle_m + CORNERS_ROOM_M;
    Airspace::new(obstacles.to_vec(), fence, scenario.fleet.altitude_m, room_m).ok_or_else(|| {
        RunError::Infeasible(format!("the fence leaves no room for a triangle with {room_m:.1} m around it"))
    })
}

/// Where fleets may meet in the airspace of a mission, if anywhere.
pub(super) fn meeting_room(scenario: &Scenario, airspace: &Airspace) -> Option<Airspace> {
    let room_m = scenario.obstacles.clearance_m + triangle_m(scenario);
    let fence = airspace.fence().clone();
    Airspace::new(airspace.obstacles().to_vec(), fence, scenario.fleet.altitude_m, room_m)
}

/// From a fleet's centre to where any of its drones may be, metres.
fn triangle_m(scenario: &Scenario) -> f64 {
    scenario.fleet.spacing_m / 3f64.sqrt() + scenario.fleet.margin_m
}

/// The airspace with its fence, once all that is planned lies in it.
pub(super) fn airspace(
    input: &MissionInput,
    mut obstacles: Vec<Obstacle>,
    flights: &Flights,
) -> Result<Airspace, RunError> {
    let scenario = &input.scenario;
    let clearance_m = scenario.obstacles.clearance_m;
    let pads = || flights.drones.iter().map(|drone| drone.pad_m.xy());
    check_pads(&obstacles, flights, scenario.fleet.r_s_m + f64::from(TRACKING_M))?;
    let triangle_m = triangle_m(scenario);
    let fence = match &input.fence {
        Some(fence) => fence.clone(),
        None => {
            let corners = flights.fleets.iter().flat_map(|fleet| fleet.waypoints_m.iter().copied());
            let planned: Vec<V2> =
                input.area.region.outer_vertices_m().chain(pads()).chain(corners).collect();
            let by_m = scenario.fence.margin_m + triangle_m + clearance_m;
            fence_around(&planned, by_m).ok_or_else(|| too_narrow(clearance_m))?
        }
    };
    let [min, max] = fence.bbox_m();
    // Beyond the fence nobody comes near an obstacle.
    obstacles.retain(|it| {
        let [low, high] = it.footprint.bbox_m();
        low.x <= max.x && min.x <= high.x && low.y <= max.y && min.y <= high.y
    });
    let altitude_m = scenario.fleet.altitude_m;
    let airspace =
        Airspace::new(obstacles, fence, altitude_m, clearance_m).ok_or_else(|| too_narrow(clearance_m))?;
    check_fence(&airspace, flights, triangle_m, clearance_m)?;
    Ok(airspace)
}

fn too_narrow(clearance_m: f64) -> RunError {
    RunError::Infeasible(format!(
        "the fence leaves no room with {clearance_m} m (obstacles.clearance_m) to its border"
    ))
}

/// Refuses pads that stand in obstacles, or so near that no drone climbs there.
fn check_pads(obstacles: &[Obstacle], flights: &Flights, keep_m: f64) -> Result<(), RunError> {
    for drone in &flights.drones {
        let pad_m = drone.pad_m.xy();
        let near =
            |it: &&Obstacle| it.footprint.contains(pad_m) || border_distance_m(&it.footprint, pad_m) < keep_m;
        if let Some(obstacle) = obstacles.iter().find(near) {
            return Err(RunError::Infeasible(format!(
                "the pad of drone {} at ({:.1} m, {:.1} m) is not {keep_m} m away from {}; another place \
                 would do",
                drone.id.0, pad_m.x, pad_m.y, obstacle.name
            )));
        }
    }
    Ok(())
}

/// Refuses lanes and pads that are not within the fence.
fn check_fence(
    airspace: &Airspace,
    flights: &Flights,
    triangle_m: f64,
    clearance_m: f64,
) -> Result<(), RunError> {
    let pads = flights
        .drones
        .iter()
        .map(|drone| (format!("the pad of drone {}", drone.id.0), drone.pad_m.xy(), 0.0));
    let lanes = flights.fleets.iter().enumerate().flat_map(|(fleet, planned)| {
        let name = format!("the way of fleet {}", fleet + 1);
        planned.waypoints_m.iter().map(move |at| (name.clone(), *at, triangle_m))
    });
    for (name, at, size_m) in pads.chain(lanes) {
        let (found_m, least_m) = (airspace.within_fence_m(at), size_m + clearance_m);
        if found_m < least_m {
            return Err(RunError::Infeasible(format!(
                "{name} leaves the fence: at ({:.1} m, {:.1} m) it is {found_m:.1} m within, expected at least \
                 {least_m:.1} m; a wider fence or a smaller area would do",
                at.x, at.y
            )));
        }
    }
    Ok(())
}

/// The walls, where the drones have room for them beside their lanes.
pub(super) fn walls(airspace: &Airspace, flights: &Flights) -> Result<Vec<[i32; 2]>, RunError> {
    let longest = flights.fleets.iter().map(|fleet| fleet.waypoints_m.len()).max().unwrap_or_default();
    // Lanes that are too long by themselves are refused as such.
    let room = MAX_WAYPOINTS.saturating_sub(longest);
    airspace.walls_mm(if room == 0 { usize::MAX } else { room }).ok_or_else(|| {
        RunError::Infeasible(format!(
            "the walls of {} obstacles and of the fence do not fit the {room} waypoints that the longest lanes leave \
             of a drone's {MAX_WAYPOINTS}; fewer obstacles, or simpler borders, would do",
            airspace.obstacles().len()
        ))
    })
}
