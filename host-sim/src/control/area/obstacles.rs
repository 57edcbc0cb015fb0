//! Obstacles and fences of GeoJSON files (RFC 7946), in the local metres of an area.
//!
//! | geometry | properties | what it is |
//! | --- | --- | --- |
//! | Polygon, MultiPolygon | `height_m` | a prism from the ground to so high above it; holes count as filled |
//! | Point | `radius_m`, `height_m` | a cylinder |
//!
//! Without `height_m` there is no top: a no-fly zone. Anything else is refused, as what a drone should not hit is
//! nothing to leave out in silence.

use std::path::Path;

use serde_json::Value;

use super::border::{Border, Circle, Use};
use super::fault::{Fault, quoted};
use super::geojson::{check_crs, polygon, type_of};
use super::json::{array, array_member, described, member, pair, parse};
use super::{AreaError, check_rings, check_vertices, read_file, text};
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;
use crate::geometry::polygon::Polygon;

/// No building and no mast is higher.
const MAX_HEIGHT_M: f64 = 10_000.0;

/// Something that stands on the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// What it is called in messages.
    pub name: String,
    /// What it covers of the ground; of a cylinder, a polygon around it.
    pub footprint: Polygon,
    /// Centre and radius where it is a cylinder, metres.
    pub cylinder_m: Option<(V2, f64)>,
    /// Its height above the ground, metres; none for a no-fly zone.
    pub top_m: Option<f64>,
}

/// The obstacles of a file.
///
/// # Errors
/// [`AreaError`] names the file, the feature and the vertex, what was found, and what is expected.
pub fn read_obstacles(file: &Path, frame: &LocalFrame) -> Result<Vec<Obstacle>, AreaError> {
    parse_obstacles(file, &read_file(file)?, frame)
}

/// The obstacles that a file of that name holds.
///
/// # Errors
/// As [`read_obstacles`].
pub fn parse_obstacles(file: &Path, bytes: &[u8], frame: &LocalFrame) -> Result<Vec<Obstacle>, AreaError> {
    let read = |bytes: &[u8]| obstacles(text(bytes)?, frame);
    read(bytes).map_err(|fault| fault.in_file(file))
}

/// The fence of a file: its one Polygon, without holes and convex.
///
/// # Errors
/// As [`read_obstacles`].
pub fn read_fence(file: &Path, frame: &LocalFrame) -> Result<Polygon, AreaError> {
    parse_fence(file, &read_file(file)?, frame)
}

/// The fence that a file of that name holds.
///
/// # Errors
/// As [`read_obstacles`].
pub fn parse_fence(file: &Path, bytes: &[u8], frame: &LocalFrame) -> Result<Polygon, AreaError> {
    let read = |bytes: &[u8]| fence(text(bytes)?, frame);
    read(bytes).map_err(|fault| fault.in_file(file))
}

fn fence(text: &str, frame: &LocalFrame) -> Result<Polygon, Fault> {
    let file = parse(text, "GeoJSON (RFC 7946)")?;
    let features = features(&file)?;
    let [(place, feature)] = &features[..] else {
        return Err(Fault::file(format!("{} features", features.len()), "exactly one, the fence"));
    };
    let geometry = geometry(feature, place)?;
    if type_of(geometry, place)? != "Polygon" {
        return Err(Fault::content(place, described(&geometry["type"]), "a \"Polygon\""));
    }
    let [outer] = array_member(geometry, "coordinates", place)? else {
        return Err(Fault::content(place, "a fence with holes or without a ring", "one ring"));
    };
    let found = outline(std::slice::from_ref(outer), place, frame)?;
    match found.first_reflex_m() {
        None => Ok(found),
        Some(at) => {
            let found = format!("a border that turns inwards at ({:.1} m, {:.1} m)", at.x, at.y);
            Err(Fault::content(place, found, "a convex fence; take an obstacle without a height for a notch"))
        }
    }
}

fn obstacles(text: &str, frame: &LocalFrame) -> Result<Vec<Obstacle>, Fault> {
    let file = parse(text, "GeoJSON (RFC 7946)")?;
    let mut found = Vec::new();
    for (place, feature) in features(&file)? {
        let geometry = geometry(feature, &place)?;
        let name = property(feature, "name").and_then(Value::as_str);
        let name = name.map_or_else(|| place.clone(), |name| format!("{place} {}", quoted(name)));
        let top_m = measure(feature, "height_m", &place, MAX_HEIGHT_M)?;
        let rings = |it: &Value, place: &str| outline(array(it, place)?, place, frame);
        let prism = |footprint, name| Obstacle { name, footprint, cylinder_m: None, top_m };
        let coordinates = |place: &str| {
            member(geometry, "coordinates")
                .ok_or_else(|| Fault::content(place, "no \"coordinates\"", "an array \"coordinates\""))
        };
        match type_of(geometry, &place)? {
            "Polygon" => found.push(prism(rings(coordinates(&place)?, &place)?, name)),
            "MultiPolygon" => {
                let polygons = array(coordinates(&place)?, &place)?;
                check_rings(polygons.len())?;
                for (i, polygon) in polygons.iter().enumerate() {
                    let part = format!(", polygon {}", i + 1);
                    found.push(prism(rings(polygon, &format!("{place}{part}"))?, format!("{name}{part}")));
                }
            }
            "Point" => {
                let Some(radius_m) = measure(feature, "radius_m", &place, f64::INFINITY)? else {
                    return Err(Fault::content(
                        place,
                        "a Point without \"radius_m\"",
                        "its radius in metres",
                    ));
                };
                let at_deg = pair(coordinates(&place)?, &place, "longitude and latitude in degrees")?;
                let border = Border::Circle(Circle::new(place, at_deg, radius_m)?);
                let footprint = border.polygon(frame, Use::Zone)?;
                let cylinder_m = Some((frame.to_local_m(at_deg[0], at_deg[1]), radius_m));
                found.push(Obstacle { name, footprint, cylinder_m, top_m });
            }
            other => {
                let expected = "a Polygon, a MultiPolygon or a Point with \"radius_m\"";
                return Err(Fault::content(place, format!("a {}", quoted(other)), expected));
            }
        }
    }
    check_rings(found.len())?;
    check_vertices(found.iter().map(|it| it.footprint.vertices_m().len()).sum())?;
    Ok(found)
}

/// The features of a collection, or the only one, with their places.
fn features(file: &Value) -> Result<Vec<(String, &Value)>, Fault> {
    check_crs(file, "the file")?;
    let features = match type_of(file, "the file")? {
        "FeatureCollection" => {
            let all = array_member(file, "features", "the feature collection")?.iter().enumerate();
            all.map(|(i, feature)| (format!("feature {}", i + 1), feature)).collect()
        }
        "Feature" => vec![("the feature".to_owned(), file)],
        other => {
            return Err(Fault::content(
                "the file",
                quoted(other),
                "a \"FeatureCollection\" or a \"Feature\"",
            ));
        }
    };
    for (place, feature) in &features {
        let kind = type_of(feature, place)?;
        if kind != "Feature" {
            return Err(Fault::content(place, format!("a {}", quoted(kind)), "a \"Feature\""));
        }
        check_crs(feature, place)?;
    }
    Ok(features)
}

fn geometry<'a>(feature: &'a Value, place: &str) -> Result<&'a Value, Fault> {
    let geometry = member(feature, "geometry");
    let geometry =
        geometry.ok_or_else(|| Fault::content(place, "no geometry", "one that stands somewhere"))?;
    check_crs(geometry, place)?;
    Ok(geometry)
}

/// The outer border of a polygon's rings; the others are read too, as faults in them are faults.
fn outline(rings: &[Value], place: &str, frame: &LocalFrame) -> Result<Polygon, Fault> {
    let mut outer = polygon(rings, place)?.outer;
    outer.turn_near(frame.origin_lon_lat_deg()[0]);
    outer.polygon(frame, Use::Zone)
}

fn property<'a>(feature: &'a Value, name: &str) -> Option<&'a Value> {
    member(feature, "properties").and_then(|it| member(it, name))
}

/// A length that a property gives: above zero and at most `most_m`.
fn measure(feature: &Value, name: &str, place: &str, most_m: f64) -> Result<Option<f64>, Fault> {
    let Some(value) = property(feature, name) else { return Ok(None) };
    match value.as_f64() {
        Some(metres) if metres > 0.0 && metres <= most_m && metres.is_finite() => Ok(Some(metres)),
        _ => {
            let most = if most_m.is_finite() { format!(" and up to {most_m}") } else { String::new() };
            let expected = format!("a number above 0{most}, in metres");
            Err(Fault::content(format!("{place}, {name:?}"), described(value), expected))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a degree from the equator, where a thousandth of a degree is some 111 m either way.
    fn frame() -> LocalFrame {
        LocalFrame::new(10.0, 0.5)
    }

    fn feature(geometry: &str, properties: &str) -> String {
        format!(r#"{{"type":"Feature","geometry":{geometry},"properties":{{{properties}}}}}"#)
    }

    fn collection(features: &[String]) -> String {
        format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(","))
    }

    const SQUARE: &str = "[[10,0.5],[10.001,0.5],[10.001,0.501],[10,0.501],[10,0.5]]";

    #[test]
    fn prisms_and_cylinders_stand_where_the_file_says() {
        let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{SQUARE}],[{SQUARE}]]}}"#);
        let point = r#"{"type":"Point","coordinates":[10.01,0.5]}"#;
        let file = collection(&[
            feature(&multi, r#""height_m":40,"name":"mill""#),
            feature(point, r#""radius_m":25,"height_m":180.5"#),
            feature(&format!(r#"{{"type":"Polygon","coordinates":[{SQUARE}]}}"#), ""),
        ]);
        let found = obstacles(&file, &frame()).unwrap_or_default();
        let tops: Vec<_> = found.iter().map(|it| it.top_m).collect();
        assert_eq!(tops, [Some(40.0), Some(40.0), Some(180.5), None]);
        assert_eq!(found[1].name, r#"feature 1 "mill", polygon 2"#);
        let (centre_m, radius_m) = found[2].cylinder_m.unwrap_or_default();
        assert!(
            (centre_m - V2::new(1_113.0, 0.0)).norm() < 2.0 && (radius_m - 25.0).abs() < 1e-9,
            "{centre_m}"
        );
        assert!((found[0].footprint.area_m2() - 111.3 * 110.6).abs() < 100.0);
        for angle in 0..100 {
            let at = centre_m + V2::new(f64::from(angle).cos(), f64::from(angle).sin()) * 25.0;
            assert!(found[2].footprint.contains(at), "the polygon lies around the cylinder");
        }
    }

    #[test]
    fn faults_name_the_feature() {
        let square = format!(r#"{{"type":"Polygon","coordinates":[{SQUARE}]}}"#);
        let good = feature(&square, "");
        let point = r#"{"type":"Point","coordinates":[10,0.5]}"#;
        for (second, parts) in [
            (feature(&square, r#""height_m":-3"#), ["feature 2", "\"height_m\"", "-3"]),
            (feature(&square, r#""height_m":"tall""#), ["feature 2", "\"height_m\"", "tall"]),
            (feature(point, r#""height_m":30"#), ["feature 2", "radius_m", "Point"]),
            (feature(point, r#""radius_m":0"#), ["feature 2", "\"radius_m\"", "above 0"]),
            (
                feature(r#"{"type":"LineString","coordinates":[]}"#, ""),
                ["feature 2", "LineString", "Polygon"],
            ),
            (
                feature(&square.replace("[10.001,0.5]", "[10.001]"), ""),
                ["feature 2", "vertex 2", "1 numbers"],
            ),
            (feature(&square.replace("[10.001,0.501],", ""), ""), ["accepted", "", ""]),
            (feature("null", ""), ["feature 2", "no geometry", "stands"]),
        ] {
            let said = match obstacles(&collection(&[good.clone(), second]), &frame()) {
                Ok(_) => "accepted".to_owned(),
                Err(fault) => fault.in_file(Path::new("town.geojson")).to_string(),
            };
            assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        }
    }

    #[test]
    fn a_fence_is_one_convex_ring() {
        let of = |ring: &str| feature(&format!(r#"{{"type":"Polygon","coordinates":[{ring}]}}"#), "");
        assert!(fence(&of(SQUARE), &frame()).is_ok());
        let notched = "[[10,0.5],[10.001,0.5],[10.0005,0.5005],[10.001,0.501],[10,0.501],[10,0.5]]";
        for (file, expected) in [
            (of(notched), "turns inwards"),
            (of(&format!("{SQUARE},{SQUARE}")), "one ring"),
            (collection(&[of(SQUARE), of(SQUARE)]), "exactly one"),
        ] {
            let said = fence(&file, &frame()).err().map(|fault| fault.in_file(Path::new("f")).to_string());
            assert!(said.as_ref().is_some_and(|said| said.contains(expected)), "{said:?}");
        }
    }
}
