//! Areas in local metres: a list of vertices.

use ::csv::{ReaderBuilder, Trim};

use super::fault::{Fault, quoted};
use super::{Area, MAX_EXTENT_M, check_vertices};
use crate::geometry::V2;
use crate::geometry::polygon::Polygon;
use crate::geometry::region::Region;

const HEADER: [&str; 2] = ["x_m", "y_m"];

/// One polygon, a vertex a row, closed by a repeated first vertex or not.
pub(super) fn read(text: &str) -> Result<Area, Fault> {
    let mut reader =
        ReaderBuilder::new().has_headers(false).flexible(true).trim(Trim::All).from_reader(text.as_bytes());
    let mut points_m = Vec::new();
    let mut headed = false;
    for record in reader.records() {
        let record = record.map_err(|e| Fault::file(e.to_string(), "CSV"))?;
        let line = record.position().map_or(0, ::csv::Position::line);
        let place = format!("line {line}");
        let fields: Vec<&str> = record.iter().collect();
        if !headed {
            if fields != HEADER {
                return Err(Fault::content(place, quoted(&fields.join(",")), "the header \"x_m,y_m\""));
            }
            headed = true;
            continue;
        }
        let [x, y] = fields[..] else {
            return Err(Fault::content(place, format!("{} fields", fields.len()), "2 fields, x_m and y_m"));
        };
        let number = |name: &str, text: &str| match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => {
                Err(Fault::content(format!("line {line}, {name}"), quoted(text), "a finite number of metres"))
            }
        };
        points_m.push(V2::new(number(HEADER[0], x)?, number(HEADER[1], y)?));
    }
    check_vertices(points_m.len())?;
    let place = "the rows (vertex 1 is the first after the header)";
    let polygon = Polygon::new(&points_m).map_err(|source| Fault::Polygon { place: place.into(), source })?;
    check_extent(&polygon, place)?;
    Ok(Area { region: Region::from(polygon), frame: None, left_out: Vec::new() })
}

fn check_extent(polygon: &Polygon, place: &str) -> Result<(), Fault> {
    let [min, max] = polygon.bbox_m();
    let extent_m = (max - min).amax();
    if extent_m > MAX_EXTENT_M {
        let found = format!("an area {:.0} km wide", extent_m / 1000.0);
        return Err(Fault::content(place, found, format!("at most {:.0} km", MAX_EXTENT_M / 1000.0)));
    }
    Ok(())
}
