//! Plan files of QGroundControl (version 1, geofence version 2): latitude before longitude, WGS84.

use serde_json::Value;

use super::border::{Border, Circle, Ring};
use super::check_rings;
use super::fault::{Fault, listed};
use super::json::{array, array_member, described, member, pair, parse};
use super::outline::{Outline, Outlines};

/// The polygon of the one survey, or else the one inclusion fence; exclusion fences are no-fly zones.
///
/// Several surveys are refused, and so are several inclusion fences without a survey: autopilots differ
/// in whether a drone has to stay in any or in all of them.
pub(super) fn read(text: &str) -> Result<Outlines, Fault> {
    let file = parse(text, "a plan file of QGroundControl (JSON)")?;
    let kind = member(&file, "fileType").unwrap_or(&Value::Null);
    if kind != "Plan" {
        return Err(Fault::content("\"fileType\"", described(kind), "\"Plan\""));
    }
    let surveys = surveys(&file)?;
    let Fences { inclusions, exclusions } = fences(&file)?;
    let names =
        |borders: &[Border]| -> Vec<String> { borders.iter().map(|it| it.place().to_owned()).collect() };
    let (mut areas, unused) =
        if surveys.is_empty() { (inclusions, Vec::new()) } else { (surveys, names(&inclusions)) };
    if areas.len() > 1 {
        let found = format!("{} areas: {}", areas.len(), listed(&names(&areas)));
        return Err(Fault::file(found, "exactly one survey, or none and exactly one inclusion fence"));
    }
    let Some(outer) = areas.pop() else {
        return Err(Fault::file("neither a survey nor an inclusion fence", "one of them"));
    };
    let left_out = unused.iter().map(|it| format!("{it} (an inclusion fence beside a survey)")).collect();
    Ok(Outlines { areas: vec![Outline { outer, holes: Vec::new() }], zones: exclusions, left_out })
}

/// The polygons of all complex items that are surveys. Other items are waypoints and the like, no areas.
fn surveys(file: &Value) -> Result<Vec<Border>, Fault> {
    let Some(mission) = member(file, "mission") else { return Ok(Vec::new()) };
    if member(mission, "items").is_none() {
        return Ok(Vec::new());
    }
    let mut surveys = Vec::new();
    for (i, item) in array_member(mission, "items", "\"mission\"")?.iter().enumerate() {
        if item["complexItemType"].as_str().is_some_and(|kind| kind.eq_ignore_ascii_case("survey")) {
            let place = format!("the survey (mission item {})", i + 1);
            surveys.push(ring(array_member(item, "polygon", &place)?, place)?.into());
        }
    }
    Ok(surveys)
}

/// What a geofence lets in and keeps out.
#[derive(Default)]
struct Fences {
    inclusions: Vec<Border>,
    exclusions: Vec<Border>,
}

fn fences(file: &Value) -> Result<Fences, Fault> {
    let mut fences = Fences::default();
    let Some(fence) = member(file, "geoFence") else { return Ok(fences) };
    if member(fence, "polygon").is_some() {
        let expected = "version 2 with \"polygons\" and \"circles\": open and save it in QGroundControl";
        return Err(Fault::content("\"geoFence\"", "\"polygon\", a geofence of version 1", expected));
    }
    for (members, kind) in [("polygons", "polygon"), ("circles", "circle")] {
        if member(fence, members).is_none() {
            continue;
        }
        let shapes = array_member(fence, members, "\"geoFence\"")?;
        check_rings(shapes.len())?;
        for (i, shape) in shapes.iter().enumerate() {
            let place = format!("geofence {kind} {}", i + 1);
            let inclusion = match shape.get("inclusion") {
                Some(Value::Bool(inclusion)) => *inclusion,
                other => {
                    let found = described(other.unwrap_or(&Value::Null));
                    return Err(Fault::content(format!("{place}, \"inclusion\""), found, "true or false"));
                }
            };
            let border = match kind {
                "polygon" => ring(array_member(shape, "polygon", &place)?, place)?.into(),
                _ => circle(shape, place)?,
            };
            if inclusion { &mut fences.inclusions } else { &mut fences.exclusions }.push(border);
        }
    }
    Ok(fences)
}

/// A ring that the format leaves open.
fn ring(positions: &[Value], place: String) -> Result<Ring, Fault> {
    let numbered = positions.iter().enumerate();
    let one = |(i, position)| lon_lat_deg(position, &format!("{place}, vertex {}", i + 1));
    let lon_lat_deg = numbered.map(one).collect::<Result<_, _>>()?;
    Ring::open(place, lon_lat_deg)
}

fn circle(shape: &Value, place: String) -> Result<Border, Fault> {
    let null = &Value::Null;
    let circle = member(shape, "circle").unwrap_or(null);
    let centre = member(circle, "center").unwrap_or(null);
    let centre_lon_lat_deg =
        lon_lat_deg(array(centre, &place).map(|_| centre)?, &format!("{place}, center"))?;
    let radius = member(circle, "radius").unwrap_or(null);
    match radius.as_f64() {
        Some(radius_m) => Circle::new(place, centre_lon_lat_deg, radius_m).map(Border::Circle),
        None => Err(Fault::content(format!("{place}, radius"), described(radius), "metres")),
    }
}

/// The one place where the order of the numbers in the file is turned.
fn lon_lat_deg(position: &Value, place: &str) -> Result<[f64; 2], Fault> {
    let [lat_deg, lon_deg] = pair(position, place, "latitude and longitude in degrees")?;
    Ok([lon_deg, lat_deg])
}
