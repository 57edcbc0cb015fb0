//! How much of a polygon a flown track covers: the area of a union of stadiums within it, by exact geometry.

mod chain;
mod overlap;
mod search;
mod slab;
mod stadium;

pub use overlap::{overlap_area_m2, overlap_disk};
pub use stadium::{Stadium, stadiums_from_track};

use super::V2;
use super::polygon::Polygon;
use super::region::{Part, Region};
use search::Search;

/// What a track covers of a polygon.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Covered share of the polygon's area, in [0, 1]; exactly 1 when nothing is left.
    pub covered_fraction: f64,
    /// Area not covered, square metres.
    pub uncovered_area_m2: f64,
    /// What is not covered, as anticlockwise rings without common area, for drawing: arcs become chords
    /// (0.05 m), and one gap may be cut into several rings.
    pub residue: Vec<Vec<V2>>,
}

/// Area of a polygon, convex or not, that a union of stadiums leaves uncovered.
///
/// # Method
/// The polygon's bounding box is halved again and again. A cell within one stadium is done, a cell that
/// none reaches is uncovered, and a cell with few stadiums goes to an exact kernel that integrates what is
/// left in closed form. Long tracks stay cheap because a cell sees them through a tree of bounds
/// that it opens only as far as its own size asks for.
///
/// # Exactness
/// There is no sampling. Where everything is covered with positive overlap the answer is exactly 1, and
/// where neighbouring stadiums just touch, too, but for rounding. The error in the uncovered area is at
/// most `l e`, with l the length of the borders of the stadiums inside the polygon and outside each other,
/// and e = 1e-9 of the polygon's extent (consecutive legs that differ from a straight run by less count as
/// straight, never to the track's favour) or 1e-7 m (gaps narrower than that are rounding), whichever is
/// larger: for a 10 km square and 200 km of border, 3 m2 or 3e-8 of the area.
///
/// # Assumptions
/// Coordinates and radii are finite. Stadiums of radius zero or less cover nothing. The order of the
/// stadiums does not change the result beyond rounding, but a track in the order flown is fastest.
///
/// # Panics
/// If a coordinate or a radius is not finite.
#[must_use]
pub fn covered(polygon: &Polygon, stadiums: &[Stadium]) -> Coverage {
    covered_rings(&[polygon.vertices_m().to_vec()], polygon.area_m2(), stadiums)
}

/// Area of a region that a union of stadiums leaves uncovered; see [`covered`].
///
/// # Panics
/// If a coordinate or a radius is not finite.
#[must_use]
pub fn covered_region(region: &Region, stadiums: &[Stadium]) -> Coverage {
    let rings: Vec<Vec<V2>> = region.parts().iter().map(Part::keyhole_ring_m).collect();
    covered_rings(&rings, region.area_m2(), stadiums)
}

/// Rings without common area that may touch themselves; `area_m2` is what they enclose.
fn covered_rings(rings_m: &[Vec<V2>], area_m2: f64, stadiums: &[Stadium]) -> Coverage {
    let finite = |s: &Stadium| s.a.sum().is_finite() && s.b.sum().is_finite() && s.radius_m.is_finite();
    assert!(stadiums.iter().all(finite), "a track consists of finite numbers");
    let covering: Vec<Stadium> = stadiums.iter().copied().filter(|s| s.radius_m > 0.0).collect();
    let extent_m = rings_m.iter().flatten().copied().fold(None, |seen: Option<[V2; 2]>, p| {
        Some(seen.map_or([p; 2], |[min, max]| [min.inf(&p), max.sup(&p)]))
    });
    let Some([min, max]) = extent_m else { return Coverage::nothing_left() };
    let mut search = Search::new((max - min).norm(), &covering);
    for ring_m in rings_m {
        search.run(ring_m);
    }
    let uncovered_area_m2 = search.uncovered_area_m2.min(area_m2);
    Coverage {
        covered_fraction: 1.0 - uncovered_area_m2 / area_m2,
        uncovered_area_m2,
        residue: search.residue,
    }
}

impl Coverage {
    /// All is covered.
    fn nothing_left() -> Self {
        Self { covered_fraction: 1.0, uncovered_area_m2: 0.0, residue: Vec::new() }
    }
}

#[cfg(test)]
mod tests;
