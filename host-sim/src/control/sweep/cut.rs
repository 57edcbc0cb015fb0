//! Exact cuts of an area into strips of given shares.

use crate::geometry::V2;
use crate::geometry::polygon::{Polygon, clip};
use crate::geometry::region::Region;

/// Heights at which horizontal lines cut an area into parts with the given shares of it, from south to
/// north: one fewer than there are shares.
///
/// Between two neighbouring vertex heights the length of the horizontal chords is linear in the height, so
/// the area below is quadratic, and the cut is a root of it: no iteration, no tolerance (Table 1, line 3).
pub(super) fn cut_heights_m(area: &Region, proportions: &[f64]) -> Vec<f64> {
    let bands = bands(area);
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

/// The parts between the cuts; none where a part is no area.
pub(super) fn parts(area: &Region, cuts_m: &[f64]) -> Vec<Option<Region>> {
    let lows = [f64::NEG_INFINITY].into_iter().chain(cuts_m.iter().copied());
    let highs = cuts_m.iter().copied().chain([f64::INFINITY]);
    lows.zip(highs).map(|(low, high)| between(area, low, high)).collect()
}

/// What of an area lies between two heights.
pub(super) fn between(area: &Region, low_m: f64, high_m: f64) -> Option<Region> {
    let [min, max] = area.bbox_m();
    if low_m <= min.y && high_m >= max.y {
        return Some(area.clone());
    }
    if let Some(polygon) = area.as_convex() {
        let above = if low_m > min.y {
            clip(polygon.vertices_m(), -V2::y(), -low_m)
        } else {
            polygon.vertices_m().to_vec()
        };
        let ring = if high_m < max.y { clip(&above, V2::y(), high_m) } else { above };
        return Polygon::new(&ring).ok().map(Region::from);
    }
    area.within_band(low_m.max(min.y), high_m.min(max.y))
}

/// The strip between two neighbouring vertex heights.
struct Band {
    low: f64,
    high: f64,
    bottom_m: f64,
    top_m: f64,
}

impl Band {
    fn area_m2(&self) -> f64 {
        f64::midpoint(self.bottom_m, self.top_m) * (self.high - self.low)
    }
}

/// All bands from south to north. Edges that climb have the area on their west side, those that fall on their
/// east side: the signed sum of where they are at a height is the length of the chords there.
fn bands(area: &Region) -> Vec<Band> {
    let edges: Vec<(V2, V2)> = area
        .parts()
        .iter()
        .flat_map(|part| part.borders_m().collect::<Vec<_>>())
        .flat_map(|ring| (0..ring.len()).map(|i| (ring[i], ring[(i + 1) % ring.len()])).collect::<Vec<_>>())
        .collect();
    let mut levels: Vec<f64> = edges.iter().map(|(a, _)| a.y).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    levels
        .windows(2)
        .map(|w| {
            let (low, high) = (w[0], w[1]);
            let (mut bottom_m, mut top_m) = (0.0, 0.0);
            for (a, b) in &edges {
                let (south, north, sign) = if a.y <= b.y { (a, b, 1.0) } else { (b, a, -1.0) };
                if south.y <= low && high <= north.y && south.y < north.y {
                    let x = |y: f64| south.x + (north.x - south.x) * ((y - south.y) / (north.y - south.y));
                    bottom_m += sign * x(low);
                    top_m += sign * x(high);
                }
            }
            Band { low, high, bottom_m: bottom_m.max(0.0), top_m: top_m.max(0.0) }
        })
        .collect()
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
