//! Operating areas of any shape: several polygons, with holes, and zones that no drone may enter.

use i_overlay::core::{fill_rule::FillRule, overlay_rule::OverlayRule};
use i_overlay::float::single::SingleFloatOverlay;
use i_overlay::mesh::float::outline::offset::OutlineOffset;
use i_overlay::mesh::float::style::{LineJoin, OutlineStyle};
use thiserror::Error;

use super::polygon::{MinWidth, Polygon, min_width};
use super::{V2, cross};

/// An operating area.
///
/// What has to be covered is the polygons given less the no-fly zones: nobody is looked for in a zone, and
/// no drone may enter one, wherever it lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    parts: Vec<Part>,
    no_fly: Vec<Polygon>,
}

/// One connected part of an area.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its outer border.
    pub outer: Polygon,
    /// Its holes, disjoint and within the outer border; they may touch it, and each other, in single points.
    pub holes: Vec<Polygon>,
}

/// Why there is no area.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum RegionError {
    /// No polygon was given.
    #[error("found no polygon, expected at least one")]
    Empty,
    /// The no-fly zones take up everything.
    #[error("found no-fly zones over all of the area, expected them to leave some of it")]
    NothingLeft,
}

impl From<Polygon> for Region {
    fn from(outer: Polygon) -> Self {
        Self { parts: vec![Part { outer, holes: Vec::new() }], no_fly: Vec::new() }
    }
}

impl Region {
    /// The union of some polygons, less the union of the no-fly zones.
    ///
    /// A single polygon without zones is kept as it is. Otherwise the borders are computed on a grid of
    /// 2^-62 of their extent, and slivers that are no polygon (see [`Polygon::new`]) are left out.
    ///
    /// # Errors
    /// [`RegionError`] where nothing is left to sweep.
    pub fn new(outers: Vec<Polygon>, no_fly: Vec<Polygon>) -> Result<Self, RegionError> {
        if let ([_], []) = (outers.as_slice(), no_fly.as_slice()) {
            return outers.into_iter().next().map(Self::from).ok_or(RegionError::Empty);
        }
        if outers.is_empty() {
            return Err(RegionError::Empty);
        }
        let parts = overlay(&contours(&outers), &contours(&no_fly), OverlayRule::Difference);
        if parts.is_empty() { Err(RegionError::NothingLeft) } else { Ok(Self { parts, no_fly }) }
    }

    /// The area less further no-fly zones.
    ///
    /// # Errors
    /// [`RegionError::NothingLeft`] where they take up everything.
    pub fn without(&self, zones: &[Polygon]) -> Result<Self, RegionError> {
        let left = self.outside(zones).ok_or(RegionError::NothingLeft)?;
        Ok(Self { no_fly: self.no_fly.iter().chain(zones).cloned().collect(), ..left })
    }

    /// The same area with other no-fly zones, which are flown around only: what they take up has to be covered still.
    #[must_use]
    pub fn around(&self, no_fly: Vec<Polygon>) -> Self {
        Self { parts: self.parts.clone(), no_fly }
    }

    /// What of the area lies in none of the polygons, with the same no-fly zones; none where nothing is left but slivers.
    #[must_use]
    pub fn outside(&self, polygons: &[Polygon]) -> Option<Self> {
        if polygons.is_empty() {
            return Some(self.clone());
        }
        let parts = overlay(&self.contours(), &contours(polygons), OverlayRule::Difference);
        (!parts.is_empty()).then(|| Self { parts, no_fly: self.no_fly.clone() })
    }

    /// What of the area lies in any of the polygons, with the same no-fly zones; none where that is no area.
    #[must_use]
    pub fn within(&self, polygons: &[Polygon]) -> Option<Self> {
        let parts = overlay(&self.contours(), &contours(polygons), OverlayRule::Intersect);
        (!parts.is_empty()).then(|| Self { parts, no_fly: self.no_fly.clone() })
    }

    /// The parts that are wanted; none where none is.
    #[must_use]
    pub fn keep(mut self, is_wanted: impl Fn(&Part) -> bool) -> Option<Self> {
        self.parts.retain(is_wanted);
        (!self.parts.is_empty()).then_some(self)
    }

    /// The borders of all parts.
    fn contours(&self) -> Vec<Contour> {
        self.parts.iter().flat_map(Part::borders_m).map(|ring| contour(&ring)).collect()
    }

    /// What has to be covered: disjoint parts.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Where no drone may fly.
    #[must_use]
    pub fn no_fly(&self) -> &[Polygon] {
        &self.no_fly
    }

    /// The area's only border, where there is no other.
    #[must_use]
    pub fn as_polygon(&self) -> Option<&Polygon> {
        match self.parts.as_slice() {
            [part] if part.holes.is_empty() => Some(&part.outer),
            _ => None,
        }
    }

    /// The area's only border, where that is convex and there are no zones.
    #[must_use]
    pub fn as_convex(&self) -> Option<&Polygon> {
        self.as_polygon().filter(|polygon| self.no_fly.is_empty() && polygon.is_convex())
    }

    /// Area to be covered.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        self.parts.iter().map(Part::area_m2).sum()
    }

    /// South-west and north-east corner of the smallest upright rectangle around the area.
    #[must_use]
    pub fn bbox_m(&self) -> [V2; 2] {
        let boxes = self.parts.iter().map(|part| part.outer.bbox_m());
        boxes.reduce(|[a, b], [c, d]| [a.inf(&c), b.sup(&d)]).unwrap_or([V2::zeros(); 2])
    }

    /// All vertices of the outer borders.
    pub fn outer_vertices_m(&self) -> impl Iterator<Item = V2> + '_ {
        self.parts.iter().flat_map(|part| part.outer.vertices_m().iter().copied())
    }

    /// Least width of the area's convex hull; see [`Polygon::min_width`].
    #[must_use]
    pub fn min_width(&self) -> MinWidth {
        min_width(&self.outer_vertices_m().collect::<Vec<_>>())
    }

    /// Whether a point has to be covered; borders count as inside.
    #[must_use]
    pub fn contains(&self, point_m: V2) -> bool {
        self.parts.iter().any(|part| part.contains(point_m))
    }

    /// What of the area lies between two heights, with the same no-fly zones; none where that is no area.
    #[must_use]
    pub fn within_band(&self, low_m: f64, high_m: f64) -> Option<Self> {
        let [min, max] = self.bbox_m();
        let [west, east] = [min.x - 1.0, max.x + 1.0];
        let band = vec![vec![[west, low_m], [east, low_m], [east, high_m], [west, high_m]]];
        let parts = overlay(&self.contours(), &band, OverlayRule::Intersect);
        (!parts.is_empty()).then(|| Self { parts, no_fly: self.no_fly.clone() })
    }

    /// The area moved by a map that keeps distances and orientation.
    #[must_use]
    pub fn moved(&self, rigid_map: impl Fn(V2) -> V2 + Copy) -> Self {
        let moved = |polygons: &[Polygon]| polygons.iter().map(|p| p.moved(rigid_map)).collect();
        let part = |part: &Part| Part { outer: part.outer.moved(rigid_map), holes: moved(&part.holes) };
        Self { parts: self.parts.iter().map(part).collect(), no_fly: moved(&self.no_fly) }
    }
}

/// Step of the arcs around the corners of what has been grown, radians.
const ARC_STEP_RAD: f64 = 0.5;

/// The outer borders of all points within a distance of some polygons, and of a little more around corners, where
/// arcs are drawn by chords: polygons that grow together become one, and pockets between them are filled.
#[must_use]
pub fn grown(polygons: &[Polygon], by_m: f64) -> Vec<Polygon> {
    let radius_m = by_m / (ARC_STEP_RAD / 2.0).cos();
    let style = OutlineStyle::new(radius_m).line_join(LineJoin::Round(ARC_STEP_RAD));
    let shapes = contours(polygons).outline(&style);
    let outers: Vec<Contour> = shapes.into_iter().filter_map(|shape| shape.into_iter().next()).collect();
    overlay(&outers, &Vec::new(), OverlayRule::Subject).into_iter().map(|part| part.outer).collect()
}

/// A border as the boolean operations take it.
type Contour = Vec<[f64; 2]>;

fn contour(ring_m: &[V2]) -> Contour {
    ring_m.iter().map(|v| [v.x, v.y]).collect()
}

fn contours(polygons: &[Polygon]) -> Vec<Contour> {
    polygons.iter().map(|p| contour(p.vertices_m())).collect()
}

/// A boolean operation; contours are the area on their left.
fn overlay(subject: &Vec<Contour>, clip: &Vec<Contour>, rule: OverlayRule) -> Vec<Part> {
    let ring = |contour: &Contour| {
        Polygon::new(&contour.iter().map(|&[x, y]| V2::new(x, y)).collect::<Vec<_>>()).ok()
    };
    let shapes = subject.overlay_as::<i64>(clip, rule, FillRule::NonZero);
    let part = |contours: &Vec<Contour>| {
        let (outer, holes) = contours.split_first()?;
        Some(Part { outer: ring(outer)?, holes: holes.iter().filter_map(ring).collect() })
    };
    shapes.iter().filter_map(part).collect()
}

impl Part {
    /// Its area.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        self.outer.area_m2() - self.holes.iter().map(Polygon::area_m2).sum::<f64>()
    }

    /// Whether a point lies in it; borders count as inside.
    #[must_use]
    pub fn contains(&self, point_m: V2) -> bool {
        self.outer.contains(point_m) && !self.holes.iter().any(|hole| hole.contains_inside(point_m))
    }

    /// All borders, the area on the left of each: the outer one anticlockwise, the holes clockwise.
    pub fn borders_m(&self) -> impl Iterator<Item = Vec<V2>> + '_ {
        let outer = self.outer.vertices_m().to_vec();
        let clockwise = |hole: &Polygon| hole.vertices_m().iter().rev().copied().collect();
        std::iter::once(outer).chain(self.holes.iter().map(clockwise))
    }

    /// The part as one ring: each hole is joined to what lies east of it by a bridge of no area.
    ///
    /// From the easternmost hole on, a bridge runs east from a hole's easternmost vertex to the first border
    /// it meets: the outer one, or that of a hole joined already, as others have no vertex so far east.
    #[must_use]
    pub fn keyhole_ring_m(&self) -> Vec<V2> {
        let mut ring: Vec<V2> = self.outer.vertices_m().to_vec();
        let east = |hole: &Polygon| hole.bbox_m()[1].x;
        let mut holes: Vec<&Polygon> = self.holes.iter().collect();
        holes.sort_by(|a, b| east(b).total_cmp(&east(a)));
        for hole in holes {
            let mut inner: Vec<V2> = hole.vertices_m().iter().rev().copied().collect();
            let Some(first) = (0..inner.len()).max_by(|&i, &j| inner[i].x.total_cmp(&inner[j].x)) else {
                continue;
            };
            inner.rotate_left(first);
            let Some((edge, at_m)) = first_to_the_east(&ring, inner[0]) else { continue };
            inner.push(inner[0]);
            inner.push(at_m);
            inner.insert(0, at_m);
            ring.splice(edge + 1..edge + 1, inner);
        }
        ring
    }
}

/// The edge of a ring that a ray to the east meets first, and where.
fn first_to_the_east(ring_m: &[V2], from_m: V2) -> Option<(usize, V2)> {
    let n = ring_m.len();
    let meets = |i: usize| {
        let (a, b) = (ring_m[i], ring_m[(i + 1) % n]);
        // An edge that climbs has the area on its west side: there the ray leaves it.
        let climbs = a.y <= from_m.y && from_m.y < b.y;
        let x_m = a.x + (b.x - a.x) * ((from_m.y - a.y) / (b.y - a.y));
        let ahead = cross(b - a, from_m - a) >= 0.0;
        (climbs && ahead).then(|| (i, V2::new(x_m.max(from_m.x), from_m.y)))
    };
    (0..n).filter_map(meets).min_by(|a, b| a.1.x.total_cmp(&b.1.x))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::coverage::{Stadium, covered_region};
    use crate::geometry::polygon::signed_area_m2;

    fn rectangle(west: f64, south: f64, east: f64, north: f64) -> Polygon {
        let corners = [[west, south], [east, south], [east, north], [west, north]];
        Polygon::new(&corners.map(|[x, y]| V2::new(x, y))).unwrap()
    }

    #[test]
    fn a_polygon_alone_is_kept_as_it_is() {
        let square = rectangle(0.0, 0.0, 0.1, 0.3);
        let region = Region::new(vec![square.clone()], vec![]).unwrap();
        assert_eq!(region.as_convex(), Some(&square));
        assert_eq!(region, Region::from(square));
    }

    #[test]
    fn zones_are_cut_out_wherever_they_lie() {
        let zones = vec![
            rectangle(2.0, 2.0, 3.0, 3.0),   // inside: a hole
            rectangle(-1.0, 8.0, 1.0, 9.0),  // across the border: a notch
            rectangle(5.0, -1.0, 6.0, 11.0), // all the way through: two parts
            rectangle(20.0, 0.0, 21.0, 1.0), // outside: nothing to cut
        ];
        let region = Region::new(vec![rectangle(0.0, 0.0, 10.0, 10.0)], zones.clone()).unwrap();
        assert_eq!(region.parts().len(), 2);
        assert!((region.area_m2() - (100.0 - 1.0 - 1.0 - 10.0)).abs() < 1e-9);
        assert_eq!(region.no_fly(), zones);
        assert_eq!(region.as_convex(), None);
        for (x, y, inside) in [
            (1.0, 1.0, true),
            (2.5, 2.5, false),
            (2.0, 2.5, true),
            (0.5, 8.5, false),
            (5.5, 5.0, false),
            (9.0, 9.0, true),
            (20.5, 0.5, false),
        ] {
            assert_eq!(region.contains(V2::new(x, y)), inside, "({x}, {y})");
        }
    }

    #[test]
    fn further_zones_are_cut_out_or_flown_around() {
        let area =
            Region::new(vec![rectangle(0.0, 0.0, 10.0, 10.0)], vec![rectangle(1.0, 1.0, 2.0, 2.0)]).unwrap();
        let zone = rectangle(5.0, 5.0, 7.0, 7.0);
        let less = area.without(std::slice::from_ref(&zone)).unwrap();
        assert!((less.area_m2() - (100.0 - 1.0 - 4.0)).abs() < 1e-9 && less.no_fly().len() == 2);
        let around = area.around(vec![zone.clone()]);
        assert!((around.area_m2() - 99.0).abs() < 1e-9 && around.no_fly() == [zone]);
        assert_eq!(area.without(&[rectangle(-1.0, -1.0, 11.0, 11.0)]), Err(RegionError::NothingLeft));
    }

    #[test]
    fn polygons_that_overlap_count_once() {
        let region =
            Region::new(vec![rectangle(0.0, 0.0, 2.0, 1.0), rectangle(1.0, 0.0, 3.0, 1.0)], vec![]).unwrap();
        assert_eq!(region.parts().len(), 1);
        assert!((region.area_m2() - 3.0).abs() < 1e-9);
        assert_eq!(region.bbox_m(), [V2::new(0.0, 0.0), V2::new(3.0, 1.0)]);
    }

    #[test]
    fn nothing_is_no_area() {
        assert_eq!(Region::new(vec![], vec![]), Err(RegionError::Empty));
        let (small, large) = (rectangle(0.0, 0.0, 1.0, 1.0), rectangle(-1.0, -1.0, 2.0, 2.0));
        assert_eq!(Region::new(vec![small], vec![large]), Err(RegionError::NothingLeft));
    }

    #[test]
    fn what_grows_together_becomes_one() {
        let squares = [
            rectangle(0.0, 0.0, 100.0, 100.0),
            rectangle(150.0, 0.0, 250.0, 100.0),
            rectangle(900.0, 0.0, 910.0, 10.0),
        ];
        let found = grown(&squares, 30.0);
        assert_eq!(found.len(), 2);
        for polygon in &found {
            for (a, b) in polygon.edges_m() {
                let nearest = |p: V2| squares.iter().map(|s| distance_m(s, p)).fold(f64::INFINITY, f64::min);
                for share in [0.0, 0.3, 0.5, 0.7] {
                    let m = nearest(a + (b - a) * share);
                    assert!((30.0 - 1e-3..32.0).contains(&m), "{m}");
                }
            }
        }
    }

    fn distance_m(polygon: &Polygon, p: V2) -> f64 {
        let legs = polygon.edges_m().map(|(a, b)| Stadium { a, b, radius_m: 0.0 }.axis_distance_m(p));
        legs.fold(f64::INFINITY, f64::min)
    }

    proptest! {
        /// Rectangles as holes at random: the ring has the part's area, and as much of it is covered as
        /// the borders one by one say.
        #[test]
        fn a_keyhole_ring_is_the_part(
            holes in prop::collection::vec((0.0..9_000.0f64, 0.0..9_000.0f64, 50.0..3_000.0f64, 50.0..3_000.0f64), 1..6),
            legs in prop::collection::vec((-500.0..10_500.0f64, -500.0..10_500.0f64), 2..6),
        ) {
            let zones = holes.iter().map(|&(x, y, w, h)| rectangle(x, y, x + w, y + h)).collect();
            let Ok(region) = Region::new(vec![rectangle(0.0, 0.0, 10_000.0, 10_000.0)], zones) else { return Ok(()) };
            let mut uncovered_m2 = 0.0;
            let path: Vec<V2> = legs.iter().map(|&(x, y)| V2::new(x, y)).collect();
            let track: Vec<Stadium> =
                path.windows(2).map(|w| Stadium { a: w[0], b: w[1], radius_m: 471.0 }).collect();
            for part in region.parts() {
                let ring_m2 = signed_area_m2(&part.keyhole_ring_m());
                prop_assert!((ring_m2 - part.area_m2()).abs() < 1e-3, "{} {}", ring_m2, part.area_m2());
                uncovered_m2 += crate::geometry::coverage::covered(&part.outer, &track).uncovered_area_m2;
                for hole in &part.holes {
                    uncovered_m2 -= crate::geometry::coverage::covered(hole, &track).uncovered_area_m2;
                }
            }
            let found = covered_region(&region, &track);
            prop_assert!((found.uncovered_area_m2 - uncovered_m2).abs() < 5.0, "{} {}", found.uncovered_area_m2, uncovered_m2);
            let drawn_m2: f64 = found.residue.iter().map(|ring| signed_area_m2(ring)).sum();
            prop_assert!((drawn_m2 - uncovered_m2).abs() < 1e-3 * region.area_m2(), "{} {}", drawn_m2, uncovered_m2);
        }
    }
}
