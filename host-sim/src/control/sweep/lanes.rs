//! Lanes over a convex polygon, in the sweep frame: x along the lanes, y across them.

use crate::geometry::V2;
use crate::geometry::polygon::{Polygon, clip, extent};

/// Share of a swath that a polygon may be wider than a whole number of swaths: rounding, not another lane.
const WIDTH_SLACK: f64 = 1e-9;

/// One lane: a straight leg that covers a strip of the polygon.
#[derive(Clone, Debug)]
pub(super) struct Lane {
    /// What the lane serves, a convex ring.
    pub(super) strip_m: Vec<V2>,
    /// Its western end.
    pub(super) west_m: V2,
    /// Its eastern end, equal to the western one where a single position covers the strip.
    pub(super) east_m: V2,
}

/// The lanes from south to north: the least number of equal strips no higher than a swath.
pub(super) fn lanes(polygon: &Polygon, swath_m: f64) -> Vec<Lane> {
    let [south, north] = extent(polygon.vertices_m(), V2::y());
    let count = ((north - south) / swath_m - WIDTH_SLACK).ceil().max(1.0);
    let height_m = (north - south) / count;
    (0..count as usize)
        .map(|i| {
            let low = south + i as f64 * height_m;
            let above = clip(polygon.vertices_m(), -V2::y(), -low);
            lane(clip(&above, V2::y(), low + height_m), low + height_m / 2.0, swath_m / 2.0)
        })
        .collect()
}

/// The shortest leg at height y whose points, each with a disk of radius r, cover a convex strip.
///
/// A stadium is convex, so it covers the strip when it covers the strip's vertices. The leg comes within r
/// of the vertex (x_k, y_k) when it meets the interval `x_k -+ sqrt(r^2 - (y_k - y)^2)`: it has to begin
/// before the first of these intervals ends and end after the last of them begins.
fn lane(strip_m: Vec<V2>, y_m: f64, radius_m: f64) -> Lane {
    let (mut first_end, mut last_begin) = (f64::INFINITY, f64::NEG_INFINITY);
    for p in &strip_m {
        let half = (radius_m * radius_m - (p.y - y_m).powi(2)).max(0.0).sqrt();
        first_end = first_end.min(p.x + half);
        last_begin = last_begin.max(p.x - half);
    }
    if first_end > last_begin {
        // All intervals have points in common: any of them will do, the middle of those over the strip.
        let [west, east] = extent(&strip_m, V2::x());
        let x_m = (last_begin.max(west) + first_end.min(east)) / 2.0;
        (first_end, last_begin) = (x_m, x_m);
    }
    Lane { strip_m, west_m: V2::new(first_end, y_m), east_m: V2::new(last_begin, y_m) }
}

/// The way along all lanes in turn, back and forth, the first one from its western or its eastern end.
pub(super) fn zigzag(lanes: &[Lane], from_west: bool) -> Vec<V2> {
    let mut path_m: Vec<V2> = Vec::with_capacity(2 * lanes.len());
    for (i, lane) in lanes.iter().enumerate() {
        let eastwards = from_west == (i % 2 == 0);
        let (start, end) = if eastwards { (lane.west_m, lane.east_m) } else { (lane.east_m, lane.west_m) };
        path_m.push(start);
        if end != start {
            path_m.push(end);
        }
    }
    path_m
}
