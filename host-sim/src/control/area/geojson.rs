//! GeoJSON (RFC 7946): longitude before latitude, WGS84.

use serde_json::Value;

use super::border::{Border, Ring};
use super::check_rings;
use super::fault::{Fault, listed, quoted};
use super::json::{array, array_member, described, member, pair, parse};
use super::outline::{Outline, Outlines};

/// How the coordinate reference system of RFC 7946 is called by files of the older GeoJSON 2008 that name it.
const WGS84_NAMES: [&str; 5] = [
    "urn:ogc:def:crs:OGC:1.3:CRS84",
    "urn:ogc:def:crs:OGC::CRS84",
    "OGC:CRS84",
    "urn:ogc:def:crs:EPSG::4326",
    "EPSG:4326",
];

/// The one areal geometry: bare, of a feature, or of the only feature in a collection that has one.
/// Points and lines are left out; several areas and geometry collections are refused.
pub(super) fn read(text: &str) -> Result<Outlines, Fault> {
    let file = parse(text, "GeoJSON (RFC 7946)")?;
    check_crs(&file, "the file")?;
    let mut found = Found::default();
    match type_of(&file, "the file")? {
        "FeatureCollection" => {
            for (i, feature) in array_member(&file, "features", "the feature collection")?.iter().enumerate()
            {
                let place = format!("feature {}", i + 1);
                let kind = type_of(feature, &place)?;
                if kind != "Feature" {
                    return Err(Fault::content(place, format!("a {}", quoted(kind)), "a \"Feature\""));
                }
                check_crs(feature, &place)?;
                found.add_feature(feature, place)?;
            }
        }
        "Feature" => found.add_feature(&file, "the feature".into())?,
        _ => found.add_geometry(&file, "the geometry".into(), None)?,
    }
    found.outlines()
}

/// The geometries met so far.
#[derive(Default)]
struct Found<'a> {
    areal: Vec<Areal<'a>>,
    left_out: Vec<String>,
}

/// A Polygon or a MultiPolygon.
struct Areal<'a> {
    geometry: &'a Value,
    place: String,
    /// The place with the name that the file gives it.
    label: String,
}

impl<'a> Found<'a> {
    fn add_feature(&mut self, feature: &'a Value, place: String) -> Result<(), Fault> {
        let name = member(feature, "properties").and_then(|it| member(it, "name")).and_then(Value::as_str);
        match member(feature, "geometry") {
            Some(geometry) => self.add_geometry(geometry, place, name),
            None => {
                self.left_out.push(format!("{place} (no geometry)"));
                Ok(())
            }
        }
    }

    fn add_geometry(&mut self, geometry: &'a Value, place: String, name: Option<&str>) -> Result<(), Fault> {
        check_crs(geometry, &place)?;
        let label = name.map_or_else(|| place.clone(), |name| format!("{place} {}", quoted(name)));
        match type_of(geometry, &place)? {
            "Polygon" | "MultiPolygon" => self.areal.push(Areal { geometry, place, label }),
            kind @ ("Point" | "MultiPoint" | "LineString" | "MultiLineString") => {
                self.left_out.push(format!("{label} (a {kind})"));
            }
            "GeometryCollection" => {
                let expected = "a Polygon or a MultiPolygon by itself";
                return Err(Fault::content(place, "a GeometryCollection", expected));
            }
            other => {
                let expected = "a type of RFC 7946 (Polygon, MultiPolygon, Feature, FeatureCollection)";
                return Err(Fault::content(place, format!("the type {}", quoted(other)), expected));
            }
        }
        Ok(())
    }

    fn outlines(self) -> Result<Outlines, Fault> {
        let expected = "exactly one area, a Polygon or a MultiPolygon";
        let [Areal { geometry, place, .. }] = &self.areal[..] else {
            let found = if self.areal.len() > 1 {
                let labels: Vec<String> = self.areal.into_iter().map(|it| it.label).collect();
                format!("{} areas: {}", labels.len(), listed(&labels))
            } else if self.left_out.is_empty() {
                "no feature".to_owned()
            } else {
                format!("no area, only {}", listed(&self.left_out))
            };
            return Err(Fault::file(found, expected));
        };
        let coordinates = array_member(geometry, "coordinates", place)?;
        let areas = if geometry["type"] == "Polygon" {
            vec![polygon(coordinates, place)?]
        } else {
            check_rings(coordinates.len())?;
            let numbered = coordinates.iter().enumerate();
            let one = |(i, rings): (usize, &Value)| {
                let place = format!("{place}, polygon {}", i + 1);
                polygon(array(rings, &place)?, &place)
            };
            numbered.map(one).collect::<Result<_, _>>()?
        };
        if areas.is_empty() {
            return Err(Fault::content(place, "a MultiPolygon without a polygon", "at least one"));
        }
        Ok(Outlines { areas, zones: Vec::new(), left_out: self.left_out })
    }
}

pub(super) fn polygon(rings: &[Value], place: &str) -> Result<Outline, Fault> {
    check_rings(rings.len())?;
    let Some((outer, holes)) = rings.split_first() else {
        return Err(Fault::content(place, "a polygon without a ring", "at least one"));
    };
    let hole = |(i, hole): (usize, &Value)| ring(hole, format!("{place}, hole {}", i + 1)).map(Border::from);
    Ok(Outline {
        outer: ring(outer, place.to_owned())?.into(),
        holes: holes.iter().enumerate().map(hole).collect::<Result<_, _>>()?,
    })
}

fn ring(positions: &Value, place: String) -> Result<Ring, Fault> {
    let mut lon_lat_deg = Vec::new();
    for (i, position) in array(positions, &place)?.iter().enumerate() {
        lon_lat_deg.push(pair(
            position,
            &format!("{place}, vertex {}", i + 1),
            "longitude and latitude in degrees",
        )?);
    }
    Ring::closed(place, lon_lat_deg)
}

pub(super) fn type_of<'a>(value: &'a Value, place: &str) -> Result<&'a str, Fault> {
    let expected = "a GeoJSON object with its \"type\"";
    if !value.is_object() {
        return Err(Fault::content(place, described(value), expected));
    }
    match member(value, "type") {
        Some(Value::String(kind)) => Ok(kind),
        other => Err(Fault::content(
            place,
            format!("the type {}", described(other.unwrap_or(&Value::Null))),
            expected,
        )),
    }
}

/// RFC 7946 (4) knows WGS84 only; a file that says otherwise would be misread.
pub(super) fn check_crs(value: &Value, place: &str) -> Result<(), Fault> {
    let Some(crs) = member(value, "crs") else { return Ok(()) };
    let name = member(crs, "properties").and_then(|it| member(it, "name"));
    match name {
        Some(Value::String(name)) if WGS84_NAMES.iter().any(|it| it.eq_ignore_ascii_case(name)) => Ok(()),
        _ => {
            let found = format!("the coordinate reference system {}", described(name.unwrap_or(crs)));
            Err(Fault::content(format!("{place}, \"crs\""), found, "WGS84 (CRS84, EPSG:4326) or no \"crs\""))
        }
    }
}
