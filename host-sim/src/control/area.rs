//! Reads the operating area from the files people have: GeoJSON or a list of local coordinates.

use std::fs;
use std::path::{Path, PathBuf};

use geojson::{Feature, GeoJson, Geometry, GeometryValue, Position};
use thiserror::Error;

use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;
use crate::geometry::polygon::{Polygon, PolygonError};

/// A wider area is refused: the projection keeps no promise there, and no sweep is meant.
const MAX_EXTENT_M: f64 = 200_000.0;

/// The header of a local file.
const CSV_HEADER: [&str; 2] = ["x_m", "y_m"];

/// An operating area.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// Its border in local metres.
    pub polygon: Polygon,
    /// Where local coordinates lie on Earth; none when the file is local itself.
    pub frame: Option<LocalFrame>,
}

/// Why a file is no area.
#[derive(Debug, Error)]
pub enum AreaError {
    /// The file cannot be read.
    #[error("{}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The name does not tell the format.
    #[error("{}: found the ending {found:?}, expected .geojson or .csv", file.display())]
    UnknownFormat {
        /// The file.
        file: PathBuf,
        /// Its ending.
        found: String,
    },
    /// Something in the file is not what it should be.
    #[error("{}: {place}: found {found}, expected {expected}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// Line, or feature and vertex.
        place: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// The border is no simple polygon.
    #[error("{}: {place}: {source}", file.display())]
    Polygon {
        /// The file.
        file: PathBuf,
        /// The feature, or the rows: vertex 1 is on line 2.
        place: String,
        /// What is wrong with it.
        source: PolygonError,
    },
}

/// A fault without the file's name.
enum Fault {
    Content { place: String, found: String, expected: String },
    Polygon { place: String, source: PolygonError },
}

impl Fault {
    fn content(place: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Content { place: place.into(), found: found.into(), expected: expected.into() }
    }

    fn in_file(self, file: &Path) -> AreaError {
        let file = file.to_path_buf();
        match self {
            Self::Content { place, found, expected } => AreaError::Content { file, place, found, expected },
            Self::Polygon { place, source } => AreaError::Polygon { file, place, source },
        }
    }
}

impl Area {
    /// Reads a `.geojson` file (WGS84 longitude, latitude; one polygon without holes, bare, as a feature, or
    /// alone in a feature collection) or a `.csv` file (header `x_m,y_m`, one vertex a row, local metres).
    /// Local coordinates of a GeoJSON area have their origin at the middle of its bounding box.
    ///
    /// # Errors
    /// [`AreaError`] names the file, the line or the feature, what was found, and what is expected.
    pub fn read(file: &Path) -> Result<Self, AreaError> {
        let ending = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let parse = match ending.as_str() {
            "geojson" => Self::from_geojson,
            "csv" => Self::from_csv,
            _ => return Err(AreaError::UnknownFormat { file: file.to_path_buf(), found: ending }),
        };
        let bytes = fs::read(file).map_err(|source| AreaError::Read { file: file.to_path_buf(), source })?;
        parse(&bytes).map_err(|fault| fault.in_file(file))
    }

    fn from_geojson(bytes: &[u8]) -> Result<Self, Fault> {
        if bytes.iter().all(u8::is_ascii_whitespace) {
            return Err(Fault::content("the whole file", "nothing", "a GeoJSON polygon"));
        }
        let fault = |e: serde_json::Error| {
            let place = match e.line() {
                0 => "the whole file".to_owned(), // the structure is wrong, not a character
                line => format!("line {line}, column {}", e.column()),
            };
            Fault::content(place, e.to_string(), "GeoJSON (RFC 7946)")
        };
        let mut value: serde_json::Value = serde_json::from_slice(bytes).map_err(fault)?;
        plain_numbers(&mut value);
        let json: GeoJson = serde_json::from_value(value).map_err(fault)?;
        let (place, ring) = the_ring(json)?;
        let frame = frame_around(&ring, &place)?;
        let points_m: Vec<V2> = ring.iter().map(|p| frame.to_local_m(p[0], p[1])).collect();
        let polygon =
            Polygon::new(&points_m).map_err(|source| Fault::Polygon { place: place.clone(), source })?;
        check_extent(&polygon, &place)?;
        Ok(Self { polygon, frame: Some(frame) })
    }

    fn from_csv(bytes: &[u8]) -> Result<Self, Fault> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(bytes);
        let mut points_m = Vec::new();
        let mut headed = false;
        for record in reader.byte_records() {
            let record = record.map_err(|e| Fault::content("the whole file", e.to_string(), "CSV"))?;
            let line = record.position().map_or(0, csv::Position::line);
            let fields: Vec<String> =
                record.iter().map(|f| String::from_utf8_lossy(f).into_owned()).collect();
            let place = format!("line {line}");
            if !headed {
                // A byte order mark is no part of the header.
                if fields.join(",").trim_start_matches('\u{feff}') != CSV_HEADER.join(",") {
                    return Err(Fault::content(place, quoted(&fields.join(",")), "the header \"x_m,y_m\""));
                }
                headed = true;
                continue;
            }
            let [x, y] = fields.as_slice() else {
                return Err(Fault::content(
                    place,
                    format!("{} fields", fields.len()),
                    "2 fields, x_m and y_m",
                ));
            };
            let number = |name: &str, text: &str| match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(Fault::content(
                    format!("line {line}, {name}"),
                    quoted(text),
                    "a finite number of metres",
                )),
            };
            points_m.push(V2::new(number(CSV_HEADER[0], x)?, number(CSV_HEADER[1], y)?));
        }
        if !headed {
            return Err(Fault::content(
                "the whole file",
                "nothing",
                "the header \"x_m,y_m\" and at least 3 rows",
            ));
        }
        let place = "the rows (vertex 1 is the first after the header)";
        let polygon =
            Polygon::new(&points_m).map_err(|source| Fault::Polygon { place: place.into(), source })?;
        check_extent(&polygon, place)?;
        Ok(Self { polygon, frame: None })
    }
}

fn quoted(text: &str) -> String {
    let mut short: String = text.chars().take(60).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    format!("{short:?}")
}

/// Makes every number one that reads as an `f64`. A crate for the boards' logs has serde_json keep numbers as
/// text (`arbitrary_precision`), which the readers of GeoJSON do not understand.
fn plain_numbers(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Number(number) => {
            if let Some(plain) = number.as_f64().and_then(serde_json::Number::from_f64) {
                *number = plain;
            }
        }
        serde_json::Value::Array(values) => values.iter_mut().for_each(plain_numbers),
        serde_json::Value::Object(members) => members.values_mut().for_each(plain_numbers),
        _ => {}
    }
}

/// The one ring of a file, and where it is.
fn the_ring(json: GeoJson) -> Result<(String, Vec<Position>), Fault> {
    match json {
        GeoJson::Geometry(geometry) => ring_of(geometry, "the geometry".into()),
        GeoJson::Feature(feature) => ring_of_feature(feature, "the feature".into()),
        GeoJson::FeatureCollection(collection) => {
            let found = collection.features.len();
            let mut features = collection.features.into_iter();
            match (features.next(), features.next()) {
                (Some(only), None) => ring_of_feature(only, "feature 1".into()),
                _ => Err(Fault::content(
                    "the feature collection",
                    format!("{found} features"),
                    "exactly one, a polygon",
                )),
            }
        }
    }
}

fn ring_of_feature(feature: Feature, place: String) -> Result<(String, Vec<Position>), Fault> {
    match feature.geometry {
        Some(geometry) => ring_of(geometry, place),
        None => Err(Fault::content(place, "no geometry", "a Polygon")),
    }
}

fn ring_of(geometry: Geometry, place: String) -> Result<(String, Vec<Position>), Fault> {
    let found = geometry.value.type_name();
    let GeometryValue::Polygon { coordinates } = geometry.value else {
        return Err(Fault::content(place, format!("a {found}"), "a Polygon"));
    };
    let rings = coordinates.len();
    let mut rings_left = coordinates.into_iter();
    match (rings_left.next(), rings_left.next()) {
        (Some(ring), None) => Ok((place, ring)),
        (None, _) => Err(Fault::content(place, "a Polygon without a ring", "one ring")),
        _ => Err(Fault::content(place, format!("a Polygon with {} holes", rings - 1), "no holes")),
    }
}

/// A frame at the middle of the ring's bounding box, after a check of every position.
fn frame_around(ring: &[Position], place: &str) -> Result<LocalFrame, Fault> {
    let Some(first) = ring.first() else {
        return Err(Fault::content(place, "an empty ring", "at least 3 positions"));
    };
    let (mut west, mut east, mut south, mut north) = (0.0_f64, 0.0_f64, 90.0_f64, -90.0_f64);
    for (i, position) in ring.iter().enumerate() {
        let place = format!("{place}, vertex {}", i + 1);
        let [lon_deg, lat_deg, ..] = *position.as_slice() else {
            return Err(Fault::content(
                place,
                format!("{} numbers", position.len()),
                "longitude and latitude",
            ));
        };
        if !(lon_deg.abs() <= 180.0 && lat_deg.abs() <= 90.0) {
            let found = format!("({lon_deg}, {lat_deg})");
            return Err(Fault::content(
                place,
                found,
                "longitude within +-180 and latitude within +-90 degrees",
            ));
        }
        // Longitudes from the first vertex, the shorter way around: the date line is no border.
        let from_first_deg = (lon_deg - first[0] + 180.0).rem_euclid(360.0) - 180.0;
        (west, east) = (west.min(from_first_deg), east.max(from_first_deg));
        (south, north) = (south.min(lat_deg), north.max(lat_deg));
    }
    let lon_deg = (first[0] + (west + east) / 2.0 + 180.0).rem_euclid(360.0) - 180.0;
    Ok(LocalFrame::new(lon_deg, (south + north) / 2.0))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, content: &str) -> Result<Area, String> {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join(name);
        fs::write(&file, content).unwrap();
        Area::read(&file).map_err(|e| e.to_string().replace(&format!("{}/", dir.path().display()), ""))
    }

    const RING: &str = "[[13.70,51.05],[13.80,51.05],[13.80,51.10],[13.70,51.10],[13.70,51.05]]";

    #[test]
    fn polygon_feature_and_collection_are_the_same_area() {
        let geometry = format!(r#"{{"type":"Polygon","coordinates":[{RING}]}}"#);
        let feature = format!(r#"{{"type":"Feature","properties":{{"name":"x"}},"geometry":{geometry}}}"#);
        let collection = format!(r#"{{"type":"FeatureCollection","features":[{feature}]}}"#);
        let area = read("a.geojson", &geometry).unwrap();
        assert_eq!(area.polygon.vertices_m().len(), 4);
        let [lon_deg, lat_deg] = area.frame.unwrap().origin_lon_lat_deg();
        assert!((lon_deg - 13.75).abs() < 1e-9 && (lat_deg - 51.075).abs() < 1e-9);
        assert_eq!(read("b.GeoJSON", &feature).unwrap(), area);
        assert_eq!(read("c.geojson", &collection).unwrap(), area);
    }

    #[test]
    fn truth_the_fixture_has_the_area_that_proj_gives_it() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/dresden-elbe.geojson");
        let area = Area::read(&file).unwrap();
        // pyproj.Geod(ellps="WGS84").polygon_area_perimeter over the ring.
        let truth_m2 = 32_746_441.3;
        assert!((area.polygon.area_m2() / truth_m2 - 1.0).abs() < 1e-6, "{} m2", area.polygon.area_m2());
        assert!(area.polygon.is_convex());
    }

    #[test]
    fn an_area_across_the_date_line_is_small() {
        let ring = "[[179.95,-16.5],[-179.95,-16.5],[-179.95,-16.4],[179.95,-16.4]]";
        let area = read("a.geojson", &format!(r#"{{"type":"Polygon","coordinates":[{ring}]}}"#)).unwrap();
        assert!((area.polygon.area_m2() / (10_678.0 * 11_065.0) - 1.0).abs() < 1e-2);
    }

    #[test]
    fn local_rows_are_taken_as_they_are() {
        let area = read("a.csv", "x_m,y_m\n0,0\n1000, 0\r\n1000,2000\n\n0,2000\n").unwrap();
        assert_eq!(area.polygon.bbox_m(), [V2::new(0.0, 0.0), V2::new(1000.0, 2000.0)]);
        assert!(area.frame.is_none());
    }

    #[test]
    fn faults_name_file_place_found_and_expected() {
        let fault = |name: &str, content: &str| read(name, content).unwrap_err();
        let polygon =
            |ring: &str| fault("a.geojson", &format!(r#"{{"type":"Polygon","coordinates":[{ring}]}}"#));
        for (found, parts) in [
            (fault("a.kml", ""), vec!["a.kml", "\"kml\"", "expected .geojson or .csv"]),
            (fault("a.csv", ""), vec!["a.csv", "nothing", "x_m,y_m"]),
            (fault("a.csv", "x,y\n0,0\n"), vec!["line 1", "\"x,y\"", "\"x_m,y_m\""]),
            (fault("a.csv", "y_m,x_m\n0,0\n"), vec!["line 1", "\"y_m,x_m\""]),
            (fault("a.csv", "x_m,y_m\n0,0\n1,nan\n"), vec!["line 3, y_m", "\"nan\"", "finite"]),
            (fault("a.csv", "x_m,y_m\n0,0\n1,2,3\n"), vec!["line 3", "3 fields", "2 fields"]),
            (fault("a.csv", "x_m,y_m\n0,0\n1,2\n"), vec!["found 2 different vertices"]),
            (fault("a.csv", "x_m,y_m\n0,0\n9e5,0\n0,9e5\n"), vec!["900 km", "at most 200 km"]),
            (fault("a.geojson", " \n"), vec!["nothing", "a GeoJSON polygon"]),
            (fault("a.geojson", "{\"type\":\n}"), vec!["line 2", "GeoJSON"]),
            (
                fault("a.geojson", r#"{"type":"Feature","properties":null,"geometry":null}"#),
                vec!["the feature", "no geometry"],
            ),
            (
                fault("a.geojson", r#"{"type":"FeatureCollection","features":[]}"#),
                vec!["0 features", "exactly one"],
            ),
            (
                fault("a.geojson", r#"{"type":"MultiPolygon","coordinates":[]}"#),
                vec!["a MultiPolygon", "expected a Polygon"],
            ),
            (polygon(&format!("{RING},{RING}")), vec!["1 holes", "no holes"]),
            (polygon("[[0,0],[1,95],[1,0]]"), vec!["vertex 2", "(1, 95)", "latitude"]),
            (polygon("[[0,0],[0.1,0.1],[0.1,0],[0,0.1]]"), vec!["the edge from vertex 1", "vertex 3"]),
        ] {
            for part in parts {
                assert!(found.contains(part), "{found:?} lacks {part:?}");
            }
        }
        assert!(
            Area::read(Path::new("/no/such/file.csv")).unwrap_err().to_string().contains("/no/such/file.csv")
        );
    }
}
