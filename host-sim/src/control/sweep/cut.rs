//! Exact cuts of a convex polygon into strips of given shares of its area.

use crate::geometry::V2;
use crate::geometry::polygon::{Polygon, clip};

/// Heights at which horizontal lines cut a convex polygon into parts with the given shares of its area,
/// from south to north: one fewer than there are shares.
///
/// Between two neighbouring vertex heights the length of a horizontal chord is linear in the height, so
/// the area below is quadratic, and the cut is a root of it: no iteration, no tolerance (Table 1, line 3).
pub(super) fn cut_heights_m(polygon: &Polygon, proportions: &[f64]) -> Vec<f64> {
    let mut levels: Vec<f64> = polygon.vertices_m().iter().map(|p| p.y).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let bands: Vec<Band> = levels
        .windows(2)
        .map(|w| {
            let chord_m = |y| chord_length_m(polygon, y);
            Band { low: w[0], high: w[1], bottom_m: chord_m(w[0]), top_m: chord_m(w[1]) }
        })
        .collect();
    let total_m2: f64 = bands.iter().map(Band::area_m2).sum();
    let mut share = 0.0;
    proportions[..proportions.len().saturating_sub(1)]
        .iter()
        .map(|p| {
            share += p;
            height_m(&bands, share * total_m2)
        })
        .collect()
}

/// The parts between the cuts.
pub(super) fn parts(polygon: &Polygon, cuts_m: &[f64]) -> Vec<Option<Polygon>> {
    let mut lows = vec![f64::NEG_INFINITY];
    lows.extend(cuts_m);
    let highs = cuts_m.iter().copied().chain([f64::INFINITY]);
    lows.iter()
        .zip(highs)
        .map(|(&low, high)| {
            let above = if low.is_finite() {
                clip(polygon.vertices_m(), -V2::y(), -low)
            } else {
                polygon.vertices_m().to_vec()
            };
            Polygon::new(&if high.is_finite() { clip(&above, V2::y(), high) } else { above }).ok()
        })
        .collect()
}

/// The trapezoid between two neighbouring vertex heights.
struct Band {
    low: f64,
    high: f64,
    bottom_m: f64,
    top_m: f64,
}

impl Band {
    fn area_m2(&self) -> f64 {
        (self.bottom_m + self.top_m) / 2.0 * (self.high - self.low)
    }
}

fn height_m(bands: &[Band], area_m2: f64) -> f64 {
    let mut left_m2 = area_m2;
    for band in bands {
        if left_m2 <= band.area_m2() {
            // bottom t + growth t^2 / 2 = left, solved without cancellation.
            let growth = (band.top_m - band.bottom_m) / (band.high - band.low);
            let root = (band.bottom_m * band.bottom_m + 2.0 * growth * left_m2).max(0.0).sqrt();
            let t = if left_m2 > 0.0 { 2.0 * left_m2 / (band.bottom_m + root) } else { 0.0 };
            return band.low + t.clamp(0.0, band.high - band.low);
        }
        left_m2 -= band.area_m2();
    }
    bands.last().map_or(0.0, |band| band.high)
}

fn chord_length_m(polygon: &Polygon, y: f64) -> f64 {
    let (mut west, mut east) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut see = |x: f64| (west, east) = (west.min(x), east.max(x));
    for (a, b) in polygon.edges_m() {
        let (low, high) = (a.y.min(b.y), a.y.max(b.y));
        if low <= y && y <= high {
            if low < high {
                see(a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)));
            } else {
                see(a.x);
                see(b.x);
            }
        }
    }
    (east - west).max(0.0)
}
