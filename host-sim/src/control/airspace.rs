//! Where drones may fly at their altitude: around obstacles and within a fence; and the ways there.
//!
//! The control center sends drones only to places that are allowed, on ways that are free, from corner to corner. The
//! same obstacles and the fence go on board as walls (`firmware::avoid::walls`), for whatever drifts off its way.

use std::f64::consts::FRAC_PI_2;

use skyroost_protocol::message::WAYPOINTS_PER_WALL;

use crate::control::area::Obstacle;
use crate::control::sweep::route::Routes;
use crate::geometry::V2;
use crate::geometry::coverage::Stadium;
use crate::geometry::polygon::{Polygon, clip, convex_hull};
use crate::geometry::region::grown;

/// Corners of ways are this much farther from obstacles than asked: a drone is at a corner when it is within 2 m.
const ROOM_M: f64 = 3.0;
/// Borders of walls may be simplified by so much, where there is no room for all of their corners.
const SIMPLER_BY_M: [f64; 4] = [0.0, 1.0, 2.0, 4.0];
/// Places on a border count as within it.
const ROUNDING_M: f64 = 1e-3;

/// The fence, the obstacles and the ways between them.
#[derive(Clone, Debug)]
pub struct Airspace {
    obstacles: Vec<Obstacle>,
    fence: Polygon,
    /// The fence less the clearance.
    inner: Polygon,
    routes: Routes,
}

/// Whether an obstacle is in the way of drones at that altitude.
#[must_use]
pub fn is_in_the_way(obstacle: &Obstacle, altitude_m: f64, clearance_m: f64) -> bool {
    obstacle.top_m.is_none_or(|top_m| top_m + clearance_m > altitude_m)
}

/// What drones at that altitude must not enter: obstacles in the way, widened by the clearance.
#[must_use]
pub fn zones(obstacles: &[Obstacle], altitude_m: f64, clearance_m: f64) -> Vec<Polygon> {
    let in_the_way = obstacles.iter().filter(|it| is_in_the_way(it, altitude_m, clearance_m));
    let footprints: Vec<Polygon> = in_the_way.map(|it| it.footprint.clone()).collect();
    if footprints.is_empty() { footprints } else { grown(&footprints, clearance_m) }
}

/// A fence around some points: their convex hull with every side moved out. None where they are no area.
///
/// Sides meet in a corner where they turn by a right angle at most, and in more where they turn farther, so that no corner
/// lies more than 1.42 times as far out. Every drone holds the fence and looks at each of its sides in every step: few
/// of them, rather than round corners.
#[must_use]
pub fn fence_around(points_m: &[V2], by_m: f64) -> Option<Polygon> {
    let hull = Polygon::new(&convex_hull(points_m)).ok()?;
    let v = hull.vertices_m();
    let turned = |n: V2, by_rad: f64| {
        let (sin, cos) = by_rad.sin_cos();
        V2::new(n.x * cos - n.y * sin, n.x * sin + n.y * cos)
    };
    let corners = (0..v.len()).flat_map(|i| {
        let [before, at, after] = [v[(i + v.len() - 1) % v.len()], v[i], v[(i + 1) % v.len()]];
        let [from, to] = [at - before, after - at].map(|side| side.normalize());
        let turn_rad = from.perp(&to).atan2(from.dot(&to));
        let pieces = (turn_rad / FRAC_PI_2 - 1e-9).ceil().max(1.0);
        let piece_rad = turn_rad / pieces;
        let outwards = V2::new(from.y, -from.x) * (by_m / (0.5 * piece_rad).cos());
        (0..pieces as u32).map(move |piece| at + turned(outwards, (f64::from(piece) + 0.5) * piece_rad))
    });
    // Corners of a side that is shorter than rounding may lie inwards of their neighbours.
    Polygon::new(&convex_hull(&corners.collect::<Vec<V2>>())).ok()
}

/// Where nobody should be sent: a lost drone may be there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeepOut {
    /// Its middle, metres.
    pub centre_m: V2,
    /// Metres.
    pub radius_m: f64,
}

impl KeepOut {
    /// Whether a place is outside.
    #[must_use]
    pub fn allows(&self, p: V2) -> bool {
        (p - self.centre_m).norm() >= self.radius_m
    }

    /// The same with so much more room around it.
    #[must_use]
    pub fn grown(&self, by_m: f64) -> Self {
        Self { radius_m: self.radius_m + by_m, ..*self }
    }
}

impl Airspace {
    /// The airspace at an altitude within a convex fence; drones keep `clearance_m` from all of its borders. None
    /// where the fence leaves no room for that.
    #[must_use]
    pub fn new(obstacles: Vec<Obstacle>, fence: Polygon, altitude_m: f64, clearance_m: f64) -> Option<Self> {
        let mut inner = fence.vertices_m().to_vec();
        for (a, b) in fence.edges_m() {
            let along = (b - a).normalize();
            let outwards = V2::new(along.y, -along.x);
            inner = clip(&inner, outwards, outwards.dot(&a) - clearance_m);
        }
        let inner = Polygon::new(&convex_hull(&inner)).ok()?;
        let footprints: Vec<Polygon> = obstacles
            .iter()
            .filter(|it| is_in_the_way(it, altitude_m, clearance_m))
            .map(|it| it.footprint.clone())
            .collect();
        let routes = Routes::new(&footprints, clearance_m, ROOM_M, |p| inner.contains(p));
        Some(Self { obstacles, fence, inner, routes })
    }

    /// The fence.
    #[must_use]
    pub fn fence(&self) -> &Polygon {
        &self.fence
    }

    /// All obstacles.
    #[must_use]
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// How far within the fence a place is, metres; negative outside.
    #[must_use]
    pub fn within_fence_m(&self, p: V2) -> f64 {
        let distance_m = border_distance_m(&self.fence, p);
        if self.fence.contains(p) { distance_m } else { -distance_m }
    }

    /// Whether a drone may be there.
    #[must_use]
    pub fn allows(&self, p: V2) -> bool {
        self.inner.contains(p) && self.routes.is_free_point(p)
    }

    /// Whether the straight way between two allowed places is free.
    #[must_use]
    pub fn is_free(&self, a: V2, b: V2) -> bool {
        self.routes.is_free(a, b)
    }

    /// The allowed place nearest to another one, as far as borders and corners tell; none where nothing is allowed.
    #[must_use]
    pub fn nearest_allowed(&self, p: V2) -> Option<V2> {
        if self.allows(p) {
            return Some(p);
        }
        let foot = |(a, b): (V2, V2)| Stadium { a, b, radius_m: 0.0 }.foot(p);
        let centre = self.inner.vertices_m().iter().sum::<V2>() / self.inner.vertices_m().len() as f64;
        let inwards = |at: V2| at + (centre - at).normalize() * ROUNDING_M;
        let fence = self.inner.edges_m().map(foot).map(inwards);
        let around = self.routes.around().iter().flat_map(Polygon::edges_m).map(foot);
        let places = fence.chain(around).chain(self.routes.nodes_m().iter().copied());
        let allowed = places.filter(|at| self.allows(*at));
        allowed.min_by(|a, b| (a - p).norm().total_cmp(&(b - p).norm()))
    }

    /// Where to fly next on the shortest way from one place to another; the goal itself where there is no way, as
    /// nobody can tell a better one.
    #[must_use]
    pub fn next_m(&self, from: V2, to: V2) -> V2 {
        if self.routes.is_free(from, to) {
            return to;
        }
        if !self.routes.is_free_point(from) {
            return self.nearest_allowed(from).unwrap_or(to);
        }
        self.routes.way(from, to).and_then(|way| way.get(1).copied()).unwrap_or(to)
    }

    /// Places that are allowed, each the nearest to the one asked for that keeps `apart_m` from those before it and is in none of the
    /// disks to keep out of; none where there is no such place.
    #[must_use]
    pub fn settled(&self, places_m: &[V2], apart_m: f64, keep_out: &[KeepOut]) -> Vec<Option<V2>> {
        let mut settled: Vec<Option<V2>> = Vec::with_capacity(places_m.len());
        for &asked in places_m {
            let free = |p: &V2| {
                self.allows(*p)
                    && keep_out.iter().all(|it| it.allows(*p))
                    && settled.iter().flatten().all(|other| (other - p).norm() >= apart_m)
            };
            let around = || {
                let turned = |ring: i32, turn: i32| {
                    let angle = f64::from(turn) * std::f64::consts::TAU / 16.0;
                    asked + V2::new(angle.cos(), angle.sin()) * (apart_m * f64::from(ring) / 2.0)
                };
                (1..=100).flat_map(move |ring| (0..16).map(move |turn| turned(ring, turn)))
            };
            settled.push(self.nearest_allowed(asked).filter(&free).or_else(|| around().find(&free)));
        }
        settled
    }

    /// The walls of all obstacles and of the fence as waypoints of a mission, in at most so many; none where that is
    /// too few for them.
    #[must_use]
    pub fn walls_mm(&self, most: usize) -> Option<Vec<[i32; 2]>> {
        let all = |by_m: f64| -> Vec<[i32; 2]> {
            let fence = ring_mm(&self.fence, by_m, None);
            fence.chain(self.obstacles.iter().flat_map(|it| wall_mm(it, by_m))).flatten().collect()
        };
        SIMPLER_BY_M.into_iter().map(all).find(|walls| walls.len() <= most)
    }
}

/// Three waypoints for each wall of an obstacle.
fn wall_mm(obstacle: &Obstacle, simpler_by_m: f64) -> Vec<[[i32; 2]; WAYPOINTS_PER_WALL]> {
    match obstacle.cylinder_m {
        Some((centre_m, radius_m)) => {
            vec![[point_mm(centre_m), point_mm(centre_m), [mm(radius_m), top_mm(obstacle.top_m)]]]
        }
        None => ring_mm(&obstacle.footprint, simpler_by_m, obstacle.top_m).collect(),
    }
}

/// The edges of a border with so few corners that it stays within `by_m` of them.
fn ring_mm(
    ring: &Polygon,
    by_m: f64,
    top_m: Option<f64>,
) -> impl Iterator<Item = [[i32; 2]; WAYPOINTS_PER_WALL]> {
    let v = ring.vertices_m();
    let mut corners = vec![0];
    for next in 2..=v.len() {
        let from = corners[corners.len() - 1];
        let chord = Stadium { a: v[from], b: v[next % v.len()], radius_m: by_m };
        if (from + 1..next).any(|skipped| chord.axis_distance_m(v[skipped]) > by_m) {
            corners.push(next - 1);
        }
    }
    let points: Vec<[i32; 2]> = corners.into_iter().map(|i| point_mm(v[i])).collect();
    let extent = [mm(by_m), top_mm(top_m)];
    (0..points.len()).map(move |i| [points[i], points[(i + 1) % points.len()], extent])
}

fn mm(metres: f64) -> i32 {
    (metres * 1e3).round() as i32
}

fn point_mm(p: V2) -> [i32; 2] {
    [mm(p.x), mm(p.y)]
}

fn top_mm(top_m: Option<f64>) -> i32 {
    top_m.map_or(i32::MAX, mm)
}

/// Distance of a place from a polygon's border, metres.
#[must_use]
pub fn border_distance_m(polygon: &Polygon, p: V2) -> f64 {
    let edges = polygon.edges_m().map(|(a, b)| Stadium { a, b, radius_m: 0.0 }.axis_distance_m(p));
    edges.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rectangle(west: f64, south: f64, east: f64, north: f64) -> Polygon {
        Polygon::new(&[[west, south], [east, south], [east, north], [west, north]].map(V2::from)).unwrap()
    }

    fn prism(footprint: Polygon, top_m: Option<f64>) -> Obstacle {
        Obstacle { name: String::new(), footprint, cylinder_m: None, top_m }
    }

    fn town() -> Airspace {
        let obstacles = vec![
            prism(rectangle(400.0, 400.0, 600.0, 600.0), Some(95.0)),
            prism(rectangle(100.0, 100.0, 200.0, 200.0), Some(80.0)),
            prism(rectangle(700.0, 0.0, 720.0, 500.0), None),
        ];
        Airspace::new(obstacles, rectangle(0.0, 0.0, 1_000.0, 1_000.0), 100.0, 10.0).unwrap()
    }

    #[test]
    fn what_is_low_is_flown_over() {
        let town = town();
        for (x, y, allowed) in [
            (500.0, 500.0, false), // 95 m is less than 10 m below 100 m
            (395.0, 500.0, false),
            (389.0, 500.0, true),
            (150.0, 150.0, true), // 80 m is not
            (710.0, 250.0, false),
            (9.0, 900.0, false), // at the fence
            (11.0, 900.0, true),
        ] {
            assert_eq!(town.allows(V2::new(x, y)), allowed, "({x}, {y})");
        }
        assert!((town.within_fence_m(V2::new(1_003.0, 500.0)) + 3.0).abs() < 1e-9);
    }

    #[test]
    fn a_fence_around_anything_is_convex() {
        for turn in 0..200 {
            let at = |k: i32| V2::new(f64::from(turn * k % 97) * 41.7, f64::from(turn * k * k % 89) * 33.1);
            let points: Vec<V2> = (1..12).map(at).collect();
            let Some(fence) = fence_around(&points, 142.0) else { continue };
            assert!(
                fence.is_convex() && Airspace::new(vec![], fence.clone(), 100.0, 10.0).is_some(),
                "{fence:?}"
            );
            assert!(points.iter().all(|p| fence.contains(*p) && border_distance_m(&fence, *p) > 141.9));
            let hull = convex_hull(&points);
            let nearest_m =
                |corner: &V2| hull.iter().map(|p| (p - corner).norm()).fold(f64::INFINITY, f64::min);
            assert!(fence.vertices_m().iter().all(|corner| nearest_m(corner) < 142.0 * 1.415), "{fence:?}");
        }
    }

    #[test]
    fn a_fence_has_no_more_sides_than_it_needs() {
        let sides = |points: &[[f64; 2]]| {
            let points: Vec<V2> = points.iter().copied().map(V2::from).collect();
            fence_around(&points, 100.0).unwrap().vertices_m().len()
        };
        assert_eq!(sides(&[[0.0, 0.0], [900.0, 0.0], [900.0, 500.0], [0.0, 500.0]]), 4);
        // The sharp end of a wedge is cut off.
        assert_eq!(sides(&[[0.0, 0.0], [900.0, 0.0], [900.0, 100.0]]), 5);
    }

    #[test]
    fn walls_go_into_the_room_there_is() {
        let town = town();
        assert_eq!(town.walls_mm(512).map(|walls| walls.len()), Some(4 * 4 * WAYPOINTS_PER_WALL));
        assert_eq!(town.walls_mm(47), None);
        let round: Vec<V2> = (0..90)
            .map(|i| {
                V2::new(f64::from(4 * i).to_radians().cos(), f64::from(4 * i).to_radians().sin()) * 300.0
            })
            .collect();
        let round = Airspace::new(vec![], Polygon::new(&round).unwrap(), 100.0, 10.0).unwrap();
        let walls = round.walls_mm(150).unwrap();
        assert!(walls.len() > 60, "{}", walls.len());
        for wall in walls.chunks_exact(WAYPOINTS_PER_WALL) {
            assert_eq!(wall[2], [1_000, i32::MAX]);
        }
    }

    proptest! {
        /// From anywhere to anywhere: corner by corner, and no leg leaves what is allowed.
        #[test]
        fn every_leg_is_free(ends in prop::array::uniform4(0.0..1_000.0f64)) {
            let town = town();
            let [mut at, to] = [V2::new(ends[0], ends[1]), V2::new(ends[2], ends[3])].map(|p| town.nearest_allowed(p).unwrap());
            for _ in 0..12 {
                let next = town.next_m(at, to);
                for share in 0..=100 {
                    prop_assert!(town.allows(at + (next - at) * (f64::from(share) / 100.0)), "{at} {next}");
                }
                at = next;
            }
            prop_assert_eq!(at, to);
        }

        /// Whatever is asked for, what is settled is allowed, apart, and where it was asked for if that was possible.
        #[test]
        fn settled_places_are_allowed_and_apart(asked in prop::collection::vec(prop::array::uniform2(-200.0..1_200.0f64), 1..12)) {
            let (town, asked) = (town(), asked.into_iter().map(V2::from).collect::<Vec<_>>());
            let found: Vec<V2> = town.settled(&asked, 15.0, &[]).into_iter().flatten().collect();
            prop_assert_eq!(found.len(), asked.len());
            for (i, a) in found.iter().enumerate() {
                prop_assert!(town.allows(*a));
                prop_assert!(found[..i].iter().all(|b| (a - b).norm() >= 15.0));
                let apart = asked[..i].iter().chain(&found[..i]).all(|b| (asked[i] - b).norm() >= 15.0);
                prop_assert!(*a == asked[i] || !town.allows(asked[i]) || !apart);
            }
        }
    }
}
