//! Reads the operating area from the files people have.
//!
//! | ending | format | the area | no-fly zones |
//! | --- | --- | --- | --- |
//! | `.geojson`, `.json` | GeoJSON, WGS84 (RFC 7946) | the one Polygon or MultiPolygon | its holes |
//! | `.kml` | KML 2.3 (OGC 12-007r2), WGS84 | the polygons of the one placemark that has any | their inner boundaries |
//! | `.plan` | [plan file] of QGroundControl, WGS84 | the survey's polygon, else the inclusion fence | exclusion fences |
//! | `.csv` | header `x_m,y_m`, a vertex a row, local metres | the rows | none |
//!
//! [plan file]: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html
//!
//! # From degrees to metres
//! Vertices are projected to a [`LocalFrame`] at the middle of the area's bounding box, and edges are
//! straight there: over the length of an edge that is the shortest way, not the parallel that a straight
//! line between equal latitudes is in a table of degrees. Heights are ignored. The date line is no border:
//! every edge takes the shorter way around, and parts that were cut apart at the 180th meridian, as RFC
//! 7946 (3.1.9) asks for, grow together again. An area with a pole in it is refused.
//!
//! # What is mended and what is refused
//! Either orientation, repeated, nearly repeated and nearly collinear vertices are mended (see
//! [`Polygon::new`](crate::geometry::polygon::Polygon::new)); polygons that overlap count once; a zone may
//! reach over the border or lie outside. Refused are borders that cross or touch themselves, rings that
//! the format wants closed and are not, a hole that cuts nothing out of its polygon, a polygon that lies in
//! another one's hole, several areas in one file, and what is larger than the limits below. What is no area
//! beside the one that is (a point, a line, a fence beside a survey) is named in [`Area::left_out`].
//!
//! # Limits
//! 4 MiB, 10,000 vertices and 1,000 rings a file, which come near each other in at most 200,000 places;
//! 200 km from west to east and from south to north.

mod border;
mod csv;
mod fault;
mod geojson;
mod json;
mod kml;
mod obstacles;
mod outline;
mod plan;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Read;
use std::path::Path;

pub use fault::AreaError;
use fault::Fault;
pub use obstacles::{Obstacle, parse_fence, parse_obstacles, read_fence, read_obstacles};

use crate::geometry::frame::LocalFrame;
use crate::geometry::region::Region;

/// A wider area is refused: the projection keeps no promise there, and no sweep is meant.
const MAX_EXTENT_M: f64 = 200_000.0;
/// A larger file is refused unread.
const MAX_BYTES: u64 = 4 << 20;
/// More vertices are no border that anyone flies, and checks take their square.
const MAX_VERTICES: usize = 10_000;
/// More rings are taken for a mistake.
const MAX_RINGS: usize = 1_000;

/// An operating area.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// What to sweep and where not to fly, in local metres.
    pub region: Region,
    /// Where local coordinates lie on Earth; none when the file is local itself.
    pub frame: Option<LocalFrame>,
    /// What the file holds beside the area and is not used, for people.
    pub left_out: Vec<String>,
}

impl Area {
    /// Reads a file; its ending tells the format (see the module).
    ///
    /// # Errors
    /// [`AreaError`] names the file, the line or the feature and vertex, what was found, and what is expected.
    pub fn read(file: &Path) -> Result<Self, AreaError> {
        let parse = parser(file)?;
        parse(&read_file(file)?).map_err(|fault| fault.in_file(file))
    }

    /// Reads what a file of that name holds.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(file: &Path, bytes: &[u8]) -> Result<Self, AreaError> {
        parser(file)?(bytes).map_err(|fault| fault.in_file(file))
    }
}

/// All of a file; one byte more than is allowed tells a file that is too long, even one without an end.
fn read_file(file: &Path) -> Result<Vec<u8>, AreaError> {
    let cannot = |source| AreaError::Read { file: file.to_path_buf(), source };
    let mut bytes = Vec::new();
    File::open(file).and_then(|f| f.take(MAX_BYTES + 1).read_to_end(&mut bytes)).map_err(cannot)?;
    Ok(bytes)
}

type Parser = fn(&[u8]) -> Result<Area, Fault>;

/// What reads a file of that name.
fn parser(file: &Path) -> Result<Parser, AreaError> {
    let ending = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match ending.as_str() {
        "geojson" | "json" => Ok(|bytes| geojson::read(text(bytes)?)?.into_area()),
        "kml" => Ok(|bytes| kml::read(text(bytes)?)?.into_area()),
        "plan" => Ok(|bytes| plan::read(text(bytes)?)?.into_area()),
        "csv" => Ok(|bytes| csv::read(text(bytes)?)),
        "kmz" => {
            let expected = "KML: unzip it and give the .kml file inside";
            Err(Fault::file("a zipped KML", expected).in_file(file))
        }
        _ => Err(AreaError::UnknownFormat { file: file.to_path_buf(), found: ending }),
    }
}

/// The file as text: UTF-8 of a bearable size, without the byte order mark that some programs put first.
fn text(bytes: &[u8]) -> Result<&str, Fault> {
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Fault::file(
            format!("more than {MAX_BYTES} bytes"),
            format!("at most {} MiB", MAX_BYTES >> 20),
        ));
    }
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let line = 1 + bytes.iter().take(e.valid_up_to()).filter(|&&b| b == b'\n').count();
        Fault::content(format!("line {line}"), "bytes that are no UTF-8", "text in UTF-8")
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    if text.trim().is_empty() { Err(Fault::file("nothing", "an area")) } else { Ok(text) }
}

/// Refuses more rings than are borne.
fn check_rings(rings: usize) -> Result<(), Fault> {
    if rings <= MAX_RINGS {
        return Ok(());
    }
    Err(Fault::file(format!("{rings} rings"), format!("at most {MAX_RINGS}")))
}

/// Refuses more vertices than are borne.
fn check_vertices(vertices: usize) -> Result<(), Fault> {
    if vertices <= MAX_VERTICES {
        return Ok(());
    }
    Err(Fault::file(format!("{vertices} vertices"), format!("at most {MAX_VERTICES}: simplify the border")))
}
