//! Simple polygons: validation, measures, and the diameter function that picks the sweep direction.

use std::f64::consts::PI;

use thiserror::Error;

use super::{V2, cross};

/// Coordinates beyond this are refused: no point on Earth is that far from a local origin, and the
/// products of two such numbers are still harmless.
const MAX_COORDINATE_M: f64 = 1e8;

/// Vertices closer than this share of the polygon's extent to each other, or to the line between their
/// neighbours, are removed (10 um in 10 km: rounding, never a shape).
const CLEAN_TOLERANCE: f64 = 1e-9;

/// Points this near to the border count as lying on it.
const BORDER_TOLERANCE_M: f64 = 1e-6;

/// Why a list of points is no polygon. Vertices are counted from 1, in the order given.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PolygonError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is ({x_m}, {y_m}): expected two finite numbers")]
    NotFinite {
        /// The vertex.
        vertex: usize,
        /// Its east coordinate, metres.
        x_m: f64,
        /// Its north coordinate, metres.
        y_m: f64,
    },
    /// A coordinate is larger than any on Earth.
    #[error("vertex {vertex} is ({x_m}, {y_m}): expected metres within +-{MAX_COORDINATE_M:e} of the origin")]
    OutOfRange {
        /// The vertex.
        vertex: usize,
        /// Its east coordinate, metres.
        x_m: f64,
        /// Its north coordinate, metres.
        y_m: f64,
    },
    /// Fewer than three different vertices.
    #[error("found {found} different vertices, expected at least 3")]
    TooFewVertices {
        /// How many differ.
        found: usize,
    },
    /// All vertices lie on one line.
    #[error("all vertices lie on the line through vertices {first} and {second}: expected an area")]
    ZeroArea {
        /// A vertex on the line.
        first: usize,
        /// Another one.
        second: usize,
    },
    /// Two edges cross, touch or overlap.
    #[error(
        "the edge from vertex {first} meets the edge from vertex {second}: expected a border that \
         never crosses or touches itself"
    )]
    SelfIntersection {
        /// First vertex of the one edge.
        first: usize,
        /// First vertex of the other.
        second: usize,
    },
}

/// A simple polygon without holes: at least three vertices, anticlockwise, no two of them equal, none on
/// the line between its neighbours, and a border that never meets itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    vertices_m: Vec<V2>,
}

/// The least distance between two parallel lines that hold a polygon between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MinWidth {
    /// That distance, metres.
    pub width_m: f64,
    /// Direction of the two lines, from east, in [0, pi).
    pub direction_rad: f64,
}

impl Polygon {
    /// Cleans and checks a border given in either orientation, closed by a repeated first vertex or not.
    ///
    /// # Errors
    /// [`PolygonError`] names the vertex at fault, counted from 1 in `points_m`.
    pub fn new(points_m: &[V2]) -> Result<Self, PolygonError> {
        for (i, p) in points_m.iter().enumerate() {
            let (vertex, x_m, y_m) = (i + 1, p.x, p.y);
            if !(p.x.is_finite() && p.y.is_finite()) {
                return Err(PolygonError::NotFinite { vertex, x_m, y_m });
            }
            if p.x.abs().max(p.y.abs()) > MAX_COORDINATE_M {
                return Err(PolygonError::OutOfRange { vertex, x_m, y_m });
            }
        }
        let [min, max] = bbox(points_m).unwrap_or([V2::zeros(); 2]);
        let tolerance_m = CLEAN_TOLERANCE * (max - min).norm();
        let mut border: Vec<Vertex> =
            points_m.iter().enumerate().map(|(i, &pos_m)| Vertex { number: i + 1, pos_m }).collect();
        remove_duplicates(&mut border, tolerance_m);
        if border.len() < 3 {
            return Err(PolygonError::TooFewVertices { found: border.len() });
        }
        refuse_line(&border, tolerance_m)?;
        remove_collinear(&mut border, tolerance_m);
        refuse_self_intersection(&border, tolerance_m)?;
        let mut vertices_m: Vec<V2> = border.into_iter().map(|v| v.pos_m).collect();
        if signed_area_m2(&vertices_m) < 0.0 {
            vertices_m.reverse();
        }
        Ok(Self { vertices_m })
    }

    /// The vertices, anticlockwise, the first not repeated.
    #[must_use]
    pub fn vertices_m(&self) -> &[V2] {
        &self.vertices_m
    }

    /// The edges, anticlockwise.
    pub fn edges_m(&self) -> impl Iterator<Item = (V2, V2)> + '_ {
        edges(&self.vertices_m)
    }

    /// Enclosed area.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        signed_area_m2(&self.vertices_m)
    }

    /// South-west and north-east corner of the smallest upright rectangle around the polygon.
    #[must_use]
    pub fn bbox_m(&self) -> [V2; 2] {
        bbox(&self.vertices_m).unwrap_or([V2::zeros(); 2])
    }

    /// Whether no vertex points inwards.
    #[must_use]
    pub fn is_convex(&self) -> bool {
        self.first_reflex_m().is_none()
    }

    /// The first vertex that points inwards, if there is one.
    #[must_use]
    pub fn first_reflex_m(&self) -> Option<V2> {
        let v = &self.vertices_m;
        let n = v.len();
        (0..n)
            .find(|&i| cross(v[(i + 1) % n] - v[i], v[(i + 2) % n] - v[(i + 1) % n]) < 0.0)
            .map(|i| v[(i + 1) % n])
    }

    /// Whether a point lies in the polygon; the border counts as inside, to a micrometre.
    #[must_use]
    pub fn contains(&self, point_m: V2) -> bool {
        self.on_border(point_m) || self.winds_around(point_m)
    }

    /// Whether a point lies in the polygon and not on its border, to a micrometre.
    #[must_use]
    pub fn contains_inside(&self, point_m: V2) -> bool {
        !self.on_border(point_m) && self.winds_around(point_m)
    }

    fn on_border(&self, point_m: V2) -> bool {
        self.edges_m().any(|(a, b)| {
            let side = cross(b - a, point_m - a);
            side.abs() <= BORDER_TOLERANCE_M * (b - a).norm() && (point_m - a).dot(&(point_m - b)) <= 0.0
        })
    }

    /// Whether a ray to the east crosses the border an odd number of times; of an edge its lower end counts.
    fn winds_around(&self, point_m: V2) -> bool {
        let crosses = |&(a, b): &(V2, V2)| {
            (a.y > point_m.y) != (b.y > point_m.y) && (cross(b - a, point_m - a) > 0.0) == (b.y > a.y)
        };
        self.edges_m().filter(crosses).count() % 2 == 1
    }

    /// Extent of the polygon across a direction: the paper's diameter function (Table 1, line 1) at the
    /// angle perpendicular to `direction_rad`.
    #[must_use]
    pub fn width_m(&self, direction_rad: f64) -> f64 {
        let normal = V2::new(-direction_rad.sin(), direction_rad.cos());
        let [low, high] = extent(&self.vertices_m, normal);
        high - low
    }

    /// The minimum of the diameter function, by rotating calipers over the convex hull (Toussaint,
    /// "Solving geometric problems with the rotating calipers", 1983), in O(n log n).
    ///
    /// Between two edge directions the width is the projection of one fixed diagonal, `L |sin|`, which is
    /// concave, so the minimum lies across an edge. Of equal widths the direction nearest to east wins.
    #[must_use]
    pub fn min_width(&self) -> MinWidth {
        min_width(&self.vertices_m)
    }

    /// The part of a convex polygon where `normal . p <= offset_m`; none where no area is left.
    ///
    /// # Panics
    /// If the polygon is not convex: the part might fall into several.
    #[must_use]
    pub fn clip_half_plane(&self, normal: V2, offset_m: f64) -> Option<Self> {
        assert!(self.is_convex(), "only a convex polygon stays in one piece under a cut");
        Self::new(&clip(&self.vertices_m, normal, offset_m)).ok()
    }

    /// The polygon moved by a map that keeps distances and orientation.
    #[must_use]
    pub fn moved(&self, rigid_map: impl Fn(V2) -> V2) -> Self {
        Self { vertices_m: self.vertices_m.iter().map(|&p| rigid_map(p)).collect() }
    }
}

/// The minimum of the diameter function of some points; see [`Polygon::min_width`].
pub(super) fn min_width(points_m: &[V2]) -> MinWidth {
    let hull = convex_hull(points_m);
    let mut best = MinWidth { width_m: f64::INFINITY, direction_rad: 0.0 };
    for (start, end) in edges(&hull) {
        let edge = end - start;
        // All points are looked at: calipers that turn from vertex to vertex stop where rounding bends a straight line of them.
        let heights_m = hull.iter().map(|p| cross(edge, p - start) / edge.norm());
        let [low_m, high_m] = heights_m.fold([0.0f64; 2], |[low, high], h| [low.min(h), high.max(h)]);
        let found = MinWidth { width_m: high_m - low_m, direction_rad: modulo_pi(edge.y.atan2(edge.x)) };
        let slack_m = CLEAN_TOLERANCE * found.width_m;
        if found.width_m < best.width_m - slack_m
            || (found.width_m <= best.width_m + slack_m && found.direction_rad < best.direction_rad)
        {
            best = found;
        }
    }
    best
}

/// A direction without a sense: the angle modulo pi, in [0, pi).
#[must_use]
pub fn modulo_pi(angle_rad: f64) -> f64 {
    let a = angle_rad.rem_euclid(PI);
    // An angle a rounding error below pi is east too.
    if a > PI - 1e-12 { 0.0 } else { a }
}

/// The part of a convex ring where `normal . p <= offset_m` (Sutherland and Hodgman 1974). Of a ring that
/// is not convex, parts may stay joined by bridges of no area along the cut.
#[must_use]
pub fn clip(ring_m: &[V2], normal: V2, offset_m: f64) -> Vec<V2> {
    let mut kept = Vec::with_capacity(ring_m.len() + 2);
    for (a, b) in edges(ring_m) {
        let (ha, hb) = (normal.dot(&a) - offset_m, normal.dot(&b) - offset_m);
        if ha <= 0.0 {
            kept.push(a);
        }
        if (ha < 0.0 && hb > 0.0) || (ha > 0.0 && hb < 0.0) {
            kept.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    kept
}

/// Area enclosed by a ring, positive when it runs anticlockwise.
#[must_use]
pub fn signed_area_m2(ring_m: &[V2]) -> f64 {
    let Some(&origin) = ring_m.first() else { return 0.0 };
    edges(ring_m).map(|(a, b)| cross(a - origin, b - origin)).sum::<f64>() / 2.0
}

/// Least and greatest `axis . p` over some points.
#[must_use]
pub fn extent(points_m: &[V2], axis: V2) -> [f64; 2] {
    points_m.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
        let h = axis.dot(p);
        [low.min(h), high.max(h)]
    })
}

fn edges(ring: &[V2]) -> impl Iterator<Item = (V2, V2)> + '_ {
    ring.iter().copied().zip(ring.iter().copied().cycle().skip(1))
}

/// South-west and north-east corner of the smallest upright rectangle around some points.
pub(super) fn bbox(points: &[V2]) -> Option<[V2; 2]> {
    let first = *points.first()?;
    Some(points.iter().fold([first; 2], |[min, max], p| [min.inf(p), max.sup(p)]))
}

/// Convex hull, anticlockwise, without collinear points (Andrew's monotone chain, 1979).
#[must_use]
pub fn convex_hull(points: &[V2]) -> Vec<V2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = &V2>| {
        let mut chain: Vec<V2> = Vec::new();
        for &p in points {
            while let [.., a, b] = chain[..]
                && cross(b - a, p - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut sorted.iter());
    hull.extend(half(&mut sorted.iter().rev()));
    hull
}

/// A vertex that remembers its number in the input.
#[derive(Clone, Copy)]
struct Vertex {
    number: usize,
    pos_m: V2,
}

fn remove_duplicates(border: &mut Vec<Vertex>, tolerance_m: f64) {
    border.dedup_by(|b, a| (b.pos_m - a.pos_m).norm() <= tolerance_m);
    while border.len() > 1 && (border[border.len() - 1].pos_m - border[0].pos_m).norm() <= tolerance_m {
        border.pop();
    }
}

fn remove_collinear(border: &mut Vec<Vertex>, tolerance_m: f64) {
    let mut i = 0;
    let mut unchanged = 0;
    while unchanged < border.len() && border.len() > 3 {
        let n = border.len();
        let (a, b, c) = (border[(i + n - 1) % n].pos_m, border[i % n].pos_m, border[(i + 1) % n].pos_m);
        // A vertex that turns back is a spike, no point of the line: it is left for the next check.
        if cross(c - a, b - a).abs() <= tolerance_m * (c - a).norm() && (b - a).dot(&(c - b)) > 0.0 {
            border.remove(i % n);
            i = (i % n).saturating_sub(1);
            unchanged = 0;
        } else {
            i = (i + 1) % n;
            unchanged += 1;
        }
    }
}

fn refuse_line(border: &[Vertex], tolerance_m: f64) -> Result<(), PolygonError> {
    let first = border[0];
    let distance_m = |v: &Vertex| (v.pos_m - first.pos_m).norm();
    let second = *border.iter().max_by(|a, b| distance_m(a).total_cmp(&distance_m(b))).unwrap_or(&first);
    let along = second.pos_m - first.pos_m;
    if border.iter().all(|v| cross(along, v.pos_m - first.pos_m).abs() <= tolerance_m * along.norm()) {
        return Err(PolygonError::ZeroArea { first: first.number, second: second.number });
    }
    Ok(())
}

/// Compares the edges whose spans from west to east overlap.
fn refuse_self_intersection(border: &[Vertex], tolerance_m: f64) -> Result<(), PolygonError> {
    let n = border.len();
    let edge = |i: usize| (border[i].pos_m, border[(i + 1) % n].pos_m);
    let west = |i: usize| edge(i).0.x.min(edge(i).1.x);
    let east = |i: usize| edge(i).0.x.max(edge(i).1.x);
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| west(i).total_cmp(&west(j)));
    for (k, &i) in order.iter().enumerate() {
        for &j in order[k + 1..].iter().take_while(|&&j| west(j) <= east(i)) {
            let (first, second) = (i.min(j), i.max(j));
            let meets = if second == first + 1 {
                is_spike(edge(first), edge(second).1, tolerance_m)
            } else if first == 0 && second == n - 1 {
                is_spike(edge(second), edge(first).1, tolerance_m)
            } else {
                segments_meet(edge(first), edge(second))
            };
            if meets {
                let (first, second) = (border[first].number, border[second].number);
                return Err(PolygonError::SelfIntersection { first, second });
            }
        }
    }
    Ok(())
}

/// Whether the way a, b, c turns back upon itself at b.
fn is_spike((a, b): (V2, V2), c: V2, tolerance_m: f64) -> bool {
    let (ab, bc) = (b - a, c - b);
    cross(ab, bc).abs() <= tolerance_m * ab.norm().max(bc.norm()) && ab.dot(&bc) < 0.0
}

/// Whether two closed segments have a point in common.
fn segments_meet((a, b): (V2, V2), (c, d): (V2, V2)) -> bool {
    let side = |p: V2, q: V2, r: V2| {
        let s = cross(q - p, r - p);
        if s > 0.0 { 1 } else { -i32::from(s < 0.0) }
    };
    // A point on the line through a segment lies on the segment when it sees the ends in opposite directions.
    let on = |p: V2, q: V2, r: V2| side(p, q, r) == 0 && (p - r).dot(&(q - r)) <= 0.0;
    (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0)
        || on(a, b, c)
        || on(a, b, d)
        || on(c, d, a)
        || on(c, d, b)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ring(points: &[[f64; 2]]) -> Vec<V2> {
        points.iter().map(|&[x, y]| V2::new(x, y)).collect()
    }

    fn polygon(points: &[[f64; 2]]) -> Polygon {
        Polygon::new(&ring(points)).unwrap()
    }

    #[test]
    fn cleaning_keeps_the_shape_and_turns_it_anticlockwise() {
        let messy = polygon(&[
            [0.0, 0.0],
            [0.0, 0.0],
            [0.0, 300.0],
            [0.0, 1000.0],
            [500.0, 1000.0],
            [1000.0, 1000.0],
            [1000.0, 1e-8],
            [1000.0, 0.0],
            [0.0, 0.0],
        ]);
        assert_eq!(messy.vertices_m().len(), 4);
        assert!((messy.area_m2() - 1e6).abs() < 1e-3);
        assert!(messy.is_convex());
    }

    #[test]
    fn faults_name_the_vertex() {
        let fault = |points: &[[f64; 2]]| Polygon::new(&ring(points)).unwrap_err();
        assert!(matches!(
            fault(&[[0.0, 0.0], [1.0, f64::NAN], [0.0, 1.0]]),
            PolygonError::NotFinite { vertex: 2, .. }
        ));
        assert!(matches!(
            fault(&[[0.0, 0.0], [1.0, 0.0], [1e300, 1.0]]),
            PolygonError::OutOfRange { vertex: 3, .. }
        ));
        assert_eq!(fault(&[]), PolygonError::TooFewVertices { found: 0 });
        assert_eq!(fault(&[[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]), PolygonError::TooFewVertices { found: 2 });
        assert_eq!(
            fault(&[[0.0, 0.0], [1.0, 1.0], [3.0, 3.0], [2.0, 2.0]]),
            PolygonError::ZeroArea { first: 1, second: 3 }
        );
        let bow_tie = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]];
        assert_eq!(fault(&bow_tie), PolygonError::SelfIntersection { first: 1, second: 3 });
        let spike = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [4.0, 2.0], [0.0, 4.0]];
        assert_eq!(fault(&spike), PolygonError::SelfIntersection { first: 2, second: 4 });
        let touching = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 0.0], [0.0, 4.0]];
        assert_eq!(fault(&touching), PolygonError::SelfIntersection { first: 1, second: 4 });
        assert_eq!(
            fault(&bow_tie).to_string(),
            "the edge from vertex 1 meets the edge from vertex 3: expected a border that never crosses \
             or touches itself"
        );
    }

    #[test]
    fn an_l_shape_is_valid_but_not_convex() {
        let l = polygon(&[[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 4.0], [0.0, 4.0]]);
        assert_eq!(l.first_reflex_m(), Some(V2::new(1.0, 1.0)));
        assert!((l.area_m2() - 7.0).abs() < 1e-12);
        assert!(l.contains(V2::new(0.5, 3.0)) && l.contains(V2::new(4.0, 0.5)));
        assert!(!l.contains(V2::new(2.0, 2.0)) && !l.contains(V2::new(5.0, 1.0)));
        // The hull counts: its slanted edge from (4, 1) to (1, 4) lies 5/sqrt(2) from the origin.
        assert!((l.min_width().width_m - 5.0 / 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn truth_width_of_known_shapes() {
        let square = polygon(&[[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]);
        assert_eq!(square.min_width(), MinWidth { width_m: 10.0, direction_rad: 0.0 });
        assert!((square.width_m(PI / 4.0) - 200f64.sqrt()).abs() < 1e-12);
        let tall = polygon(&[[0.0, 0.0], [3.0, 0.0], [3.0, 10.0], [0.0, 10.0]]);
        assert!((tall.min_width().direction_rad - PI / 2.0).abs() < 1e-15);
        // The least height of a 3-4-5 triangle stands on its longest side.
        let triangle = polygon(&[[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]).min_width();
        assert!((triangle.width_m - 2.4).abs() < 1e-12);
        assert!((triangle.direction_rad - (-3f64).atan2(4.0).rem_euclid(PI)).abs() < 1e-12);
    }

    /// Convex polygons of 3 to 12 vertices on an ellipse, a few kilometres wide, anywhere.
    fn convex() -> impl Strategy<Value = Polygon> {
        let angles = prop::collection::vec(0.0..2.0 * PI, 3..12);
        (angles, 500.0..5000.0f64, 500.0..5000.0f64, -1e5..1e5f64, 0.0..PI).prop_filter_map(
            "no area",
            |(mut angles, a_m, b_m, shift_m, turn)| {
                angles.sort_by(f64::total_cmp);
                let points: Vec<V2> = angles
                    .iter()
                    .map(|t| {
                        let p = V2::new(a_m * t.cos(), b_m * t.sin());
                        nalgebra::Rotation2::new(turn) * p + V2::new(shift_m, -shift_m)
                    })
                    .collect();
                Polygon::new(&points).ok()
            },
        )
    }

    proptest! {
        #[test]
        fn a_straight_line_of_vertices_makes_nothing_narrow(
            ends in prop::array::uniform2(prop::array::uniform2(-1e3..1e3_f64)),
            at in prop::collection::vec(0.01..0.99_f64, 1..6),
            aside_m in 10.0..1e3_f64,
        ) {
            let [a, b] = ends.map(V2::from);
            let way = b - a;
            prop_assume!(way.norm() > 1.0);
            let top = 0.5 * (a + b) + V2::new(-way.y, way.x) * (aside_m / way.norm());
            let expected = min_width(&[a, b, top]).width_m;
            let mut points: Vec<V2> = at.iter().map(|f| a + way * *f).collect();
            points.extend([a, b, top]);
            let found = min_width(&points).width_m;
            prop_assert!((found - expected).abs() < 1e-6 * expected.max(1.0), "{found} of {expected}");
        }

        #[test]
        fn truth_min_width_is_the_least_over_all_directions(polygon in convex()) {
            let found = polygon.min_width();
            let scanned = (0..3600).map(|i| polygon.width_m(f64::from(i) * PI / 3600.0)).fold(f64::MAX, f64::min);
            let [min, max] = polygon.bbox_m();
            prop_assert!((polygon.width_m(found.direction_rad) - found.width_m).abs() < 1e-6);
            prop_assert!(found.width_m <= scanned + 1e-6);
            prop_assert!(scanned - found.width_m < (max - min).norm() * PI / 3600.0);
        }

        #[test]
        fn two_halves_make_a_whole(polygon in convex(), angle in 0.0..PI, share in 0.05..0.95f64) {
            let normal = V2::new(angle.cos(), angle.sin());
            let [low, high] = extent(polygon.vertices_m(), normal);
            let offset_m = low + share * (high - low);
            let area = |p: Option<Polygon>| p.map_or(0.0, |p| p.area_m2());
            let parts = area(polygon.clip_half_plane(normal, offset_m))
                + area(polygon.clip_half_plane(-normal, -offset_m));
            prop_assert!((parts / polygon.area_m2() - 1.0).abs() < 1e-9);
        }

        #[test]
        fn no_points_make_it_panic(points in prop::collection::vec((-5i8..5, -5i8..5), 0..9)) {
            let points: Vec<V2> = points.iter().map(|&(x, y)| V2::new(f64::from(x), f64::from(y))).collect();
            if let Ok(polygon) = Polygon::new(&points) {
                prop_assert!(polygon.area_m2() > 0.0);
                prop_assert!(polygon.vertices_m().iter().all(|&v| polygon.contains(v)));
                prop_assert_eq!(Polygon::new(polygon.vertices_m()).unwrap(), polygon.clone());
            }
        }
    }
}
