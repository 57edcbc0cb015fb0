//! Reads and checks everything a mission needs, so that all bad input is found before anything
//! flies or is written.

use crate::runner::{InputError, MissionArea, MissionInput, MissionUser, RunError};
use crate::scenario::{LoadedScenario, Overrides, Scenario};
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
    let users = scenario.users.file.as_deref().map(read_users).transpose()?;
    let drones = scenario.fleet.drones;
    if drones < FLEET_SIZE {
        return Err(RunError::Infeasible(format!(
            "{drones} drones cannot sweep: a fleet needs {FLEET_SIZE}"
        )));
    }
    Ok(MissionInput { scenario, area, users })
}

/// The area of the file, or the rectangle.
fn area(scenario: &Scenario) -> Result<MissionArea, InputError> {
    let table = &scenario.area;
    if let Some(file) = &table.file {
        return read_area(file);
    }
    let (east, north) = (table.width_m, table.height_m);
    let polygon_m = vec![[0.0, 0.0], [east, 0.0], [east, north], [0.0, north]];
    Ok(MissionArea { polygon_m, origin_lon_lat_deg: None })
}

/// An area from a local CSV with the header `x_m,y_m`.
fn read_area(file: &Path) -> Result<MissionArea, InputError> {
    let polygon_m: Vec<[f64; 2]> = read_points(file)?.into_iter().map(|(_, pos_m)| pos_m).collect();
    if polygon_m.len() < 3 {
        let found = format!("{} corners", polygon_m.len());
        return Err(InputError::File {
            place: file.display().to_string(),
            found,
            expected: "3 corners or more",
        });
    }
    Ok(MissionArea { polygon_m, origin_lon_lat_deg: None })
}

/// Users from a local CSV with the header `x_m,y_m` and optionally `id`.
fn read_users(file: &Path) -> Result<Vec<MissionUser>, InputError> {
    let points = read_points(file)?;
    Ok(points.into_iter().map(|(id, pos_m)| MissionUser { id, pos_m }).collect())
}

/// The points of a CSV file, with their `id` or else their number.
fn read_points(file: &Path) -> Result<Vec<(String, [f64; 2])>, InputError> {
    let at = |place: String, found: String, expected| InputError::File { place, found, expected };
    let name = file.display().to_string();
    let text = std::fs::read_to_string(file)
        .map_err(|error| InputError::unreadable(file, &error, "a CSV file with the header x_m,y_m"))?;
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let headers =
        reader.headers().map_err(|error| at(name.clone(), error.to_string(), "the header x_m,y_m"))?.clone();
    let column = |name: &str| headers.iter().position(|header| header == name);
    let (Some(x), Some(y)) = (column("x_m"), column("y_m")) else {
        let found = format!("the header {:?}", headers.iter().collect::<Vec<_>>().join(","));
        return Err(at(format!("{name}:1"), found, "the header x_m,y_m"));
    };
    let id = column("id");

    let mut points = Vec::new();
    for (index, row) in reader.records().enumerate() {
        let row = row.map_err(|error| at(name.clone(), error.to_string(), "rows as long as the header"))?;
        let line = row.position().map_or(0, csv::Position::line);
        let number =
            |column: usize, field: &str| {
                let text = row.get(column).unwrap_or_default();
                text.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| {
                    at(format!("{name}:{line}: {field}"), format!("{text:?}"), "a finite number")
                })
            };
        let pos_m = [number(x, "x_m")?, number(y, "y_m")?];
        let id = id.and_then(|id| row.get(id)).map_or_else(|| format!("u{}", index + 1), str::to_owned);
        points.push((id, pos_m));
    }
    if points.is_empty() {
        return Err(at(name, "no rows".to_owned(), "at least one point"));
    }
    Ok(points)
}
