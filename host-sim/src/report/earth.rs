//! Local metres as GeoJSON (RFC 7946), WGS84.
//!
//! Edges are those of the local frame, cut where a line straight in degrees would leave them by more than
//! centimetres. What lies across the 180th meridian is cut there in two, as RFC 7946 (3.1.9) asks for.

use i_overlay::core::{fill_rule::FillRule, overlay_rule::OverlayRule};
use i_overlay::float::single::SingleFloatOverlay;
use serde_json::{Value, json};

use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;

/// A longer edge is cut in pieces: over this a line straight in degrees is off by `s^2 tan(lat) / 8 r`, which is
/// 2 cm at 50 degrees.
const EDGE_M: f64 = 1_000.0;
/// Decimals of a degree: a tenth of a millimetre.
const DECIMALS: f64 = 1e9;

type Position = [f64; 2];
type Rings = Vec<Vec<Position>>;

/// A geometry, or null for none, and what it is.
#[expect(clippy::needless_pass_by_value, reason = "both become part of the feature")]
pub(super) fn feature(geometry: Value, properties: Value) -> Value {
    json!({ "type": "Feature", "geometry": geometry, "properties": properties })
}

/// All features as a text with a line's end.
pub(super) fn collection(features: &[Value]) -> String {
    let mut text = json!({ "type": "FeatureCollection", "features": features }).to_string();
    text.push('\n');
    text
}

/// Local metres as geometries on Earth.
pub(super) struct Earth<'a> {
    pub(super) frame: &'a LocalFrame,
}

impl Earth<'_> {
    /// Longitude and latitude, the longitude less than half a turn from the origin's: possibly beyond 180 degrees.
    fn degrees(&self, point_m: V2) -> Position {
        let [lon_deg, lat_deg] = self.frame.to_lon_lat_deg(point_m);
        let [origin_deg, _] = self.frame.origin_lon_lat_deg();
        [origin_deg + (lon_deg - origin_deg + 180.0).rem_euclid(360.0) - 180.0, lat_deg]
    }

    /// Points with no edge too long between them.
    fn edges(&self, points_m: &[V2]) -> Vec<Position> {
        let last = points_m.last().map(|&p| self.degrees(p));
        let piece = |w: &[V2]| {
            let (from, step) = (w[0], w[1] - w[0]);
            let pieces = (step.norm() / EDGE_M).ceil().max(1.0) as u32;
            (0..pieces).map(move |k| from + step * (f64::from(k) / f64::from(pieces))).collect::<Vec<_>>()
        };
        points_m.windows(2).flat_map(piece).map(|p| self.degrees(p)).chain(last).collect()
    }

    /// One place.
    pub(super) fn point(&self, point_m: V2) -> Value {
        json!({ "type": "Point", "coordinates": rounded(turned(self.degrees(point_m))) })
    }

    /// A line, or several where it crosses the 180th meridian; a point flown at is a line of no length.
    pub(super) fn line(&self, points_m: &[V2]) -> Value {
        let whole = match points_m {
            [only] => vec![self.degrees(*only); 2],
            _ => self.edges(points_m),
        };
        let mut lines: Vec<Vec<Position>> = Vec::new();
        let mut current: Vec<Position> = Vec::new();
        for point in whole {
            if let Some(&before) = current.last()
                && let Some(at) = crossing(before, point)
            {
                // Each of the two lines ends at the meridian as its own side calls it.
                current.push(at);
                lines.push(std::mem::take(&mut current));
                current.push(at);
            }
            current.push(point);
        }
        lines.push(current);
        let mut lines: Vec<Vec<Position>> = lines
            .iter()
            .filter(|line| line.len() > 1)
            .map(|line| {
                let turns = turns_of(line);
                line.iter().map(|&[lon, lat]| rounded([lon - 360.0 * turns, lat])).collect()
            })
            .collect();
        match lines.len() {
            1 => json!({ "type": "LineString", "coordinates": lines.remove(0) }),
            _ => json!({ "type": "MultiLineString", "coordinates": lines }),
        }
    }

    /// Polygons, each its outer ring and its holes; outer rings anticlockwise, holes clockwise, closed.
    pub(super) fn area(&self, parts_m: Vec<Vec<Vec<V2>>>) -> Value {
        let ring = |mut ring_m: Vec<V2>| {
            ring_m.extend(ring_m.first().copied());
            self.edges(&ring_m)
        };
        let parts = parts_m.into_iter().map(|part| part.into_iter().map(ring).collect::<Rings>());
        let mut polygons: Vec<Rings> = parts.flat_map(cut_at_180).collect();
        for position in polygons.iter_mut().flatten().flatten() {
            *position = rounded(*position);
        }
        match polygons.len() {
            1 => json!({ "type": "Polygon", "coordinates": polygons.remove(0) }),
            _ => json!({ "type": "MultiPolygon", "coordinates": polygons }),
        }
    }
}

/// Where a short line crosses the 180th meridian, on either of its two sides.
fn crossing(from: Position, to: Position) -> Option<Position> {
    [-180.0, 180.0].into_iter().find_map(|meridian| {
        let (before, after) = (from[0] - meridian, to[0] - meridian);
        (before * after < 0.0).then(|| [meridian, from[1] + (to[1] - from[1]) * (before / (before - after))])
    })
}

/// Turns by which a line that crosses no 180th meridian lies beyond it.
fn turns_of(line: &[Position]) -> f64 {
    let middle = line.iter().map(|p| p[0]).sum::<f64>() / line.len() as f64;
    ((middle + 180.0) / 360.0).floor()
}

fn turned([lon, lat]: Position) -> Position {
    [(lon + 180.0).rem_euclid(360.0) - 180.0, lat]
}

fn rounded(position: Position) -> Position {
    position.map(|degrees| (degrees * DECIMALS).round() / DECIMALS)
}

/// A polygon, cut in two where the 180th meridian runs through it, each side with longitudes of its own.
fn cut_at_180(rings: Rings) -> Vec<Rings> {
    if rings.iter().flatten().all(|p| p[0].abs() <= 180.0) {
        return vec![rings];
    }
    let sides = [-1.0, 0.0, 1.0].into_iter().flat_map(|turns: f64| {
        let (west, east) = (360.0 * turns - 180.0, 360.0 * turns + 180.0);
        let side = vec![vec![[west, -90.0], [east, -90.0], [east, 90.0], [west, 90.0]]];
        let open: Rings = rings.iter().map(|ring| ring[..ring.len() - 1].to_vec()).collect();
        let mut found = open.overlay_as::<i64>(&side, OverlayRule::Intersect, FillRule::NonZero);
        for ring in found.iter_mut().flatten() {
            ring.extend(ring.first().copied());
            // The cut is on the meridian itself, and no rounding of the overlay's grid beyond it.
            ring.iter_mut().for_each(|p| p[0] = (p[0] - 360.0 * turns).clamp(-180.0, 180.0));
        }
        found
    });
    sides.collect()
}
