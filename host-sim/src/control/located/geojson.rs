//! Users as points of GeoJSON (RFC 7946), as `skyroost locate` writes them: WGS84, longitude first.
//!
//! Properties: `id`; `r_e_m` or `r95_m`; `weight`; `cov_m2` as rows of a matrix, east first. Points with a `status` other than `ok` claim no position and are left
//! out, and so is everything that is no point; how many is told.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Matrix2;
use serde_json::Value;

use super::{
    CLAIMED, Located, LocatedError, LocatedUsers, MOST_RADIUS_M, MOST_USERS, MOST_VARIANCE_M2, MOST_WEIGHT,
};
use crate::control::place::UserBelief;
use crate::control::quoted::quoted;
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;

/// A complaint: where, what is there, what should be.
type Refused = (String, String, &'static str);

pub(super) fn parse(file: &Path, content: &[u8]) -> Result<LocatedUsers, LocatedError> {
    read(content).map_err(|(at, found, expected)| LocatedError::Feature {
        file: file.to_path_buf(),
        at,
        found,
        expected,
    })
}

fn read(content: &[u8]) -> Result<LocatedUsers, Refused> {
    let json: Value = serde_json::from_slice(content)
        .map_err(|error| (format!("line {}", error.line()), error.to_string(), "GeoJSON"))?;
    let features = json.get("features").and_then(Value::as_array);
    let collection = json.get("type").and_then(Value::as_str) == Some("FeatureCollection");
    let Some(features) = features.filter(|_| collection) else {
        return Err(("the file".into(), "no features".into(), "a FeatureCollection of points"));
    };
    let mut points: Vec<(Located, [f64; 2])> = Vec::new();
    let mut left_out = 0;
    let mut first_of: BTreeMap<String, usize> = BTreeMap::new();
    for (number, feature) in (1..).zip(features) {
        let at = format!("feature {number}");
        let Some(lon_lat) = point(feature, &at)? else {
            left_out += 1;
            continue;
        };
        let status = feature.pointer("/properties/status").and_then(Value::as_str);
        if status.is_some_and(|status| status != CLAIMED) {
            left_out += 1;
            continue;
        }
        let id = name(feature, &at)?;
        if let Some(first) = first_of.insert(id.clone(), number) {
            let found = format!("{}, the id of feature {first} as well", quoted(&id));
            return Err((at, found, "an id of its own"));
        }
        if points.len() == MOST_USERS {
            return Err((at, "one user more".into(), "at most a million"));
        }
        let error_radius_m = number_of(feature, &["r_e_m", "r95_m"], &at, MOST_RADIUS_M)?.unwrap_or(0.0);
        let weight = number_of(feature, &["weight"], &at, MOST_WEIGHT)?.unwrap_or(1.0);
        let cov_m2 = covariance(feature, &at)?;
        points.push((Located { id, pos_m: V2::zeros(), error_radius_m, weight, cov_m2 }, lon_lat));
    }
    let frame = middle(&points).map(|[lon, lat]| LocalFrame::new(lon, lat));
    let place = |(user, [lon, lat]): (Located, [f64; 2])| match &frame {
        Some(frame) => Located { pos_m: frame.to_local_m(lon, lat), ..user },
        None => user,
    };
    Ok(LocatedUsers { users: points.into_iter().map(place).collect(), frame, left_out })
}

/// Longitude and latitude of a point; none of any other geometry, or without one.
fn point(feature: &Value, at: &str) -> Result<Option<[f64; 2]>, Refused> {
    let Some(geometry) = feature.get("geometry").filter(|it| !it.is_null()) else { return Ok(None) };
    if geometry.get("type").and_then(Value::as_str) != Some("Point") {
        return Ok(None);
    }
    let degrees = |index: usize| geometry.get("coordinates")?.get(index)?.as_f64();
    match (degrees(0), degrees(1)) {
        (Some(lon), Some(lat)) if lon.abs() <= 180.0 && lat.abs() < 90.0 => Ok(Some([lon, lat])),
        _ => {
            let found = geometry.get("coordinates").map_or("nothing".to_owned(), ToString::to_string);
            Err((format!("{at}, coordinates"), found, "longitude and latitude in degrees"))
        }
    }
}

fn name(feature: &Value, at: &str) -> Result<String, Refused> {
    let id = feature.pointer("/properties/id").or_else(|| feature.get("id"));
    match id {
        Some(Value::String(id)) if !id.trim().is_empty() && id.len() <= 200 => Ok(id.clone()),
        Some(Value::Number(id)) => Ok(id.to_string()),
        found => {
            let found = found.map_or("nothing".to_owned(), ToString::to_string);
            Err((format!("{at}, id"), found, "a name of at most 200 bytes"))
        }
    }
}

/// The first of these properties that is there.
fn number_of(feature: &Value, names: &[&str], at: &str, most: f64) -> Result<Option<f64>, Refused> {
    let properties = feature.get("properties");
    let there = names.iter().find_map(|name| Some((name, properties?.get(name).filter(|it| !it.is_null())?)));
    let Some((name, value)) = there else { return Ok(None) };
    match value.as_f64().filter(|number| (0.0..=most).contains(number)) {
        Some(number) => Ok(Some(number)),
        None => Err((format!("{at}, {name}"), value.to_string(), "a number, 0 or more")),
    }
}

/// The covariance, where the feature has one.
fn covariance(feature: &Value, at: &str) -> Result<Option<Matrix2<f64>>, Refused> {
    let there = feature.pointer("/properties/cov_m2").filter(|it| !it.is_null());
    let Some(value) = there else { return Ok(None) };
    let number = |pointer: &str| value.pointer(pointer).and_then(Value::as_f64);
    let entries = [number("/0/0"), number("/0/1"), number("/1/0"), number("/1/1")];
    let matrix = match entries {
        [Some(xx), Some(xy), Some(yx), Some(yy)] => Some(Matrix2::new(xx, xy, yx, yy)),
        _ => None,
    };
    let sound = |matrix: &Matrix2<f64>| {
        UserBelief { pos_m: V2::zeros(), cov_m2: *matrix }.has_covariance()
            && matrix.max() <= MOST_VARIANCE_M2
    };
    match matrix.filter(sound) {
        Some(matrix) => Ok(Some(matrix)),
        None => Err((format!("{at}, cov_m2"), value.to_string(), "a covariance [[xx, xy], [xy, yy]] in m2")),
    }
}

/// The middle of all points, across the date line where that is nearer.
fn middle(points: &[(Located, [f64; 2])]) -> Option<[f64; 2]> {
    let [first_lon, _] = points.first()?.1;
    let turns = |lon: f64| (lon - first_lon + 540.0).rem_euclid(360.0) - 180.0;
    let bounds = |of: &dyn Fn(&[f64; 2]) -> f64| {
        let all = points.iter().map(|(_, at)| of(at));
        let (low, high) = all.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
        0.5 * (low + high)
    };
    let lon = first_lon + bounds(&|&[lon, _]| turns(lon));
    Some([(lon + 540.0).rem_euclid(360.0) - 180.0, bounds(&|&[_, lat]| lat)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(features: &str) -> String {
        format!("{{\"type\":\"FeatureCollection\",\"features\":[{features}]}}")
    }

    fn feature(id: &str, lon: f64, more: &str) -> String {
        format!(
            "{{\"type\":\"Feature\",\"geometry\":{{\"type\":\"Point\",\"coordinates\":[{lon},51]}},\
             \"properties\":{{\"id\":{id}{more}}}}}"
        )
    }

    #[test]
    fn points_become_users_around_their_middle() {
        let east = feature("\"a\"", 179.999, ",\"r95_m\":8.5");
        let west = feature("7", -179.999, ",\"status\":\"ok\",\"weight\":2");
        let guess = feature("\"c\"", 10.0, ",\"status\":\"ambiguous\"");
        let read = read(file(&[east, west, guess].join(",")).as_bytes()).unwrap();
        let [a, b] = &read.users[..] else { panic!("two users: {read:?}") };
        assert_eq!((a.id.as_str(), b.id.as_str(), read.left_out), ("a", "7", 1));
        assert!((a.error_radius_m - 8.5).abs() < 1e-12 && (b.weight - 2.0).abs() < 1e-12);
        // 0.002 degrees at 51 north.
        assert!((a.pos_m - b.pos_m - V2::new(-140.4, 0.0)).norm() < 0.2, "{:?}", a.pos_m - b.pos_m);
        assert!((a.pos_m + b.pos_m).norm() < 0.1);
    }

    #[test]
    fn faults_name_the_feature() {
        for (features, told) in [
            (feature("\"a\"", 181.0, ""), "feature 1, coordinates"),
            (feature("\"\"", 1.0, ""), "feature 1, id"),
            (feature("\"a\"", 1.0, ",\"r_e_m\":-1"), "feature 1, r_e_m"),
            ([feature("\"a\"", 1.0, ""), feature("\"a\"", 2.0, "")].join(","), "feature 2"),
        ] {
            assert_eq!(read(file(&features).as_bytes()).unwrap_err().0, told);
        }
        assert_eq!(read(b"{}").unwrap_err().0, "the file");
        assert_eq!(read(b"{\n\n,").unwrap_err().0, "line 3");
    }
}
