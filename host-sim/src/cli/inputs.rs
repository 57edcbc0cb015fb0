//! Reads and checks everything a mission needs, so that all bad input is found before anything
//! flies or is written.

use crate::control::area::{Area, AreaError, read_fence, read_obstacles};
use crate::geometry::frame::LocalFrame;
use crate::runner::{InputError, MissionArea, MissionInput, MissionKeys, RunError};
use crate::scenario::{LoadedScenario, Overrides, Scenario};
use crate::world::users::read_users;
use std::path::Path;

/// Least drones that can sweep: three capture each user's signal together.
const FLEET_SIZE: u32 = 3;

/// The mission that a scenario file (or the built-in scenario) and the command line ask for.
pub(super) fn load(file: Option<&Path>, overrides: &Overrides) -> Result<MissionInput, RunError> {
    let mut loaded = match file {
        Some(file) => LoadedScenario::read(file).map_err(InputError::from)?,
        None => LoadedScenario::paper(),
    };
    loaded.apply(overrides);
    loaded.check().map_err(InputError::from)?;
    let scenario = loaded.scenario;
    let area = area(&scenario)?;
    let frame = area.origin_lon_lat_deg.map(|[lon_deg, lat_deg]| LocalFrame::new(lon_deg, lat_deg));
    let obstacles = placed("obstacles.file", scenario.obstacles.file.as_deref(), frame, read_obstacles)?;
    let fence = placed("fence.file", scenario.fence.file.as_deref(), frame, read_fence)?;
    let users = scenario.users.file.as_deref().map(read_users).transpose().map_err(InputError::from)?;
    let drones = scenario.fleet.drones;
    if drones < FLEET_SIZE {
        return Err(RunError::Infeasible(format!(
            "{drones} drones cannot sweep: a fleet needs {FLEET_SIZE}"
        )));
    }
    Ok(MissionInput {
        scenario,
        area,
        obstacles: obstacles.unwrap_or_default(),
        fence,
        users,
        keys: MissionKeys::default(),
    })
}

/// What a file in WGS84 holds, where the scenario names one.
fn placed<T>(
    key: &'static str,
    file: Option<&Path>,
    frame: Option<LocalFrame>,
    read: impl Fn(&Path, &LocalFrame) -> Result<T, AreaError>,
) -> Result<Option<T>, InputError> {
    let Some(file) = file else { return Ok(None) };
    let frame = frame.ok_or(InputError::Frameless { key })?;
    Ok(Some(read(file, &frame)?))
}

/// The area of the file, or the rectangle.
fn area(scenario: &Scenario) -> Result<MissionArea, InputError> {
    let table = &scenario.area;
    if let Some(file) = &table.file {
        let area = Area::read(file)?;
        let origin_lon_lat_deg = area.frame.map(|frame| frame.origin_lon_lat_deg());
        return Ok(MissionArea {
            name: file.display().to_string(),
            region: area.region,
            origin_lon_lat_deg,
            left_out: area.left_out,
        });
    }
    MissionArea::rectangle(scenario)
}
