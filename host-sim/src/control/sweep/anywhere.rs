//! Ways over an area of any shape, around no-fly zones.
//!
//! The area is cut into strips of equal height; each piece of a strip gets a lane, cut where it would enter a zone.
//! The lanes are flown in a short order, on the shortest ways around the zones. What is left uncovered, where
//! a zone kept a lane from reaching far enough, is found by exact geometry, and places from which to cover it join
//! the lanes until nothing is left.

use crate::geometry::V2;
use crate::geometry::coverage::covered_region;
use crate::geometry::polygon::{Polygon, modulo_pi};
use crate::geometry::region::Region;

use super::cut::between;
use super::frame::SweepFrame;
use super::route::{ROOM_M, Routes};
use super::timing::length_m;
use super::tour::{Distances, order};
use super::{SweepError, Way, swept};

/// Directions for which a whole way is made, of those whose lanes are shortest.
const DIRECTIONS: usize = 2;

/// Longest edges whose directions are looked at.
const EDGES: usize = 8;

/// Directions that differ by less are one.
const SAME_DIRECTION_RAD: f64 = 0.02;

/// Share of the area that may be left: rounding, not a gap.
const LEFT_SHARE: f64 = 1e-8;

/// Places are chosen so that they cover what is left with this much to spare, metres.
const SPARE_M: f64 = 0.5;

/// Most lanes of one way: their order takes the square of their number.
const MOST_LANES: f64 = 500.0;

/// Rounds of looking for what is left.
const MOST_ROUNDS: usize = 40;

/// What the lanes are laid with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Radius that the fleet covers for certain, less the margin, metres.
    pub(super) radius_m: f64,
    /// Distance that its centre keeps from zones, metres.
    pub(super) clearance_m: f64,
}

/// Ways worth comparing.
///
/// # Errors
/// [`SweepError::Unreachable`] where a piece of the area cannot be covered from anywhere that can be flown to.
pub(super) fn ways(region: &Region, direction_rad: f64, reach: Reach) -> Result<Vec<Way>, SweepError> {
    let fits = |d: &f64| lane_count(region, *d, reach) <= MOST_LANES;
    let directions: Vec<f64> = directions(region, direction_rad).into_iter().filter(fits).collect();
    if directions.is_empty() {
        let lanes = lane_count(region, direction_rad, reach);
        return Err(SweepError::TooManyPieces { lanes, most: MOST_LANES });
    }
    let mut laid: Vec<Laid> = directions.into_iter().map(|d| Laid::new(region, d, reach)).collect();
    laid.retain(|laid| laid.lanes.len() as f64 <= 2.0 * MOST_LANES);
    if laid.is_empty() {
        return Err(SweepError::TooManyPieces { lanes: 2.0 * MOST_LANES, most: MOST_LANES });
    }
    laid.sort_by(|a, b| a.effort_m.total_cmp(&b.effort_m));
    laid.iter().take(DIRECTIONS).map(Laid::way).collect()
}

/// Strips along a direction, each at least one lane.
fn lane_count(region: &Region, direction_rad: f64, reach: Reach) -> f64 {
    let frame = SweepFrame::new(region.bbox_m(), direction_rad);
    let heights_m = region.outer_vertices_m().map(|p| frame.inward(p).y);
    let [low_m, high_m] =
        heights_m.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], y| [low.min(y), high.max(y)]);
    ((high_m - low_m) / (2.0 * reach.radius_m)).ceil()
}

/// The sweep direction, across it, and along the longest edges.
fn directions(region: &Region, direction_rad: f64) -> Vec<f64> {
    let polygons = region.parts().iter().flat_map(|part| [&part.outer].into_iter().chain(&part.holes));
    let mut edges: Vec<V2> = polygons.flat_map(Polygon::edges_m).map(|(a, b)| b - a).collect();
    edges.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
    let along = edges.iter().take(EDGES).map(|edge| edge.y.atan2(edge.x));
    let mut found: Vec<f64> = Vec::new();
    for angle in [direction_rad, direction_rad + std::f64::consts::FRAC_PI_2].into_iter().chain(along) {
        let angle = modulo_pi(angle);
        if found.iter().all(|d| modulo_pi(d - angle).min(modulo_pi(angle - d)) > SAME_DIRECTION_RAD) {
            found.push(angle);
        }
    }
    found
}

/// Lanes along a direction, in the sweep frame.
struct Laid {
    direction_rad: f64,
    frame: SweepFrame,
    area: Region,
    reach: Reach,
    lanes: Vec<[V2; 2]>,
    /// Length of the lanes and, roughly, of the changes between them.
    effort_m: f64,
}

impl Laid {
    fn new(region: &Region, direction_rad: f64, reach: Reach) -> Self {
        let frame = SweepFrame::new(region.bbox_m(), direction_rad);
        let area = region.moved(|p| frame.inward(p));
        // Beside a zone a lane ends a clearance before the border and still has to cover the strip's corners.
        let room_m = if region.no_fly().is_empty() { 0.0 } else { reach.clearance_m + 2.0 };
        let half_m = (reach.radius_m.powi(2) - room_m.powi(2)).max(0.01 * reach.radius_m.powi(2)).sqrt();
        let [min, max] = area.bbox_m();
        let count = ((max.y - min.y) / (2.0 * half_m) - 1e-9).ceil().max(1.0);
        let height_m = (max.y - min.y) / count;
        let mut lanes = Vec::new();
        for k in 0..count as usize {
            let low_m = min.y + k as f64 * height_m;
            let Some(strip) = between(&area, low_m, low_m + height_m) else { continue };
            lanes.extend(
                strip.parts().iter().map(|part| lane(&part.outer, low_m + height_m / 2.0, reach.radius_m)),
            );
        }
        let effort_m = lanes.iter().map(|[west, east]| east.x - west.x + height_m).sum();
        Self { direction_rad, frame, area, reach, lanes, effort_m }
    }

    fn way(&self) -> Result<Way, SweepError> {
        let routes = Routes::new(self.area.no_fly(), self.reach.clearance_m, ROOM_M, |_| true);
        let mut stops: Vec<[V2; 2]> =
            self.lanes.iter().flat_map(|[west, east]| routes.free_parts(*west, *east)).collect();
        if stops.is_empty() {
            stops.extend(self.first_place(&routes)?);
        }
        for _ in 0..MOST_ROUNDS {
            let path_m = self.path(&mut stops, &routes);
            let left = covered_region(&self.area, &swept(&path_m, self.reach.radius_m));
            if left.uncovered_area_m2 <= LEFT_SHARE * self.area.area_m2() {
                return Ok(self.finished(path_m, stops.len()));
            }
            // A ring of the residue may reach through a notch on a bridge of no area: those corners are none.
            let mut open: Vec<V2> = left.residue.concat();
            open.retain(|p| self.area.contains(*p));
            while let Some(&corner) = open.first() {
                let place = self.place_for(corner, &open, &path_m, &routes)?;
                stops.push([place; 2]);
                open.retain(|p| (p - place).norm() > self.reach.radius_m);
            }
        }
        // Every round covers corners of what was left; slivers that many rounds do not end are rounding.
        let path_m = self.path(&mut stops, &routes);
        Ok(self.finished(path_m, stops.len()))
    }

    fn finished(&self, path_m: Vec<V2>, stops: usize) -> Way {
        let path_m: Vec<V2> = path_m.into_iter().map(|p| self.frame.outward(p)).collect();
        Way {
            direction_rad: self.direction_rad,
            length_m: length_m(&path_m),
            path_m,
            turns: stops - 1,
            plain: false,
        }
    }

    /// The way along all stops that can be reached from each other; drops the others.
    fn path(&self, stops: &mut Vec<[V2; 2]>, routes: &Routes) -> Vec<V2> {
        let table = |stops: &[[V2; 2]]| -> Vec<Vec<f64>> {
            let ends: Vec<V2> = stops.concat();
            ends.iter().map(|from| routes.distances_m(*from, &ends)).collect()
        };
        let mut distances = table(stops);
        // Walled-in stops: those that the stop with most company cannot reach.
        let company = |i: usize| distances[2 * i].iter().filter(|m| m.is_finite()).count();
        let hub = (0..stops.len()).max_by_key(|&i| (company(i), std::cmp::Reverse(i))).unwrap_or_default();
        let reached: Vec<bool> = (0..stops.len()).map(|i| distances[2 * hub][2 * i].is_finite()).collect();
        if reached.contains(&false) {
            let mut reached = reached.into_iter();
            stops.retain(|_| reached.next().unwrap_or(false));
            distances = table(stops);
        }
        let mut path_m: Vec<V2> = Vec::new();
        for (lane, backwards) in order(&Distances(distances)) {
            let [mut from, mut to] = stops[lane];
            if backwards {
                (from, to) = (to, from);
            }
            if let Some(&at) = path_m.last() {
                path_m.extend(routes.way(at, from).unwrap_or_default());
            }
            path_m.extend([from, to]);
        }
        path_m.dedup();
        path_m
    }

    /// A place from which to cover a corner of what is left, and as much else of it as can be: of equal ones
    /// that nearest to the way.
    fn place_for(&self, corner: V2, open: &[V2], path_m: &[V2], routes: &Routes) -> Result<V2, SweepError> {
        let radius_m = self.reach.radius_m - SPARE_M;
        let rings = [0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0].map(|share| share * radius_m);
        let around = rings.into_iter().flat_map(|m| {
            (0..24).map(move |k| {
                let angle = f64::from(k) * std::f64::consts::TAU / 24.0;
                V2::new(angle.cos(), angle.sin()) * m
            })
        });
        let near_nodes = routes.nodes_m().iter().copied();
        let candidates = around.map(|step| corner + step).chain(near_nodes);
        let candidates =
            candidates.filter(|p| (p - corner).norm() <= radius_m + 1e-9 && routes.is_free_point(*p));
        let mut rated: Vec<(usize, f64, V2)> = candidates
            .map(|p| {
                let covered = open.iter().filter(|q| (*q - p).norm() <= radius_m + 1e-9).count();
                let detour_m = path_m.iter().map(|q| (q - p).norm()).fold(f64::INFINITY, f64::min);
                (covered, detour_m, p)
            })
            .collect();
        rated.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)));
        let start = path_m.first().copied();
        let reachable = |p: V2| start.is_none_or(|start| routes.way(start, p).is_some());
        rated.into_iter().map(|(_, _, p)| p).find(|p| reachable(*p)).ok_or_else(|| {
            let at = self.frame.outward(corner);
            SweepError::Unreachable { x_m: at.x, y_m: at.y, radius_m: self.reach.radius_m }
        })
    }

    /// Where to begin when no lane can be flown.
    fn first_place(&self, routes: &Routes) -> Result<Option<[V2; 2]>, SweepError> {
        let open: Vec<V2> = self.area.outer_vertices_m().collect();
        let Some(&corner) = open.first() else { return Ok(None) };
        self.place_for(corner, &open, &[], routes).map(|place| Some([place; 2]))
    }
}

/// The shortest level leg at a height whose points, each with a disk of radius r, cover all of a polygon that is
/// no farther than r above or below: see `lanes`, for any shape, as a stadium that covers all vertices covers
/// their convex hull.
fn lane(piece: &Polygon, y_m: f64, radius_m: f64) -> [V2; 2] {
    let half = |p: &V2| (radius_m * radius_m - (p.y - y_m).powi(2)).max(0.0).sqrt();
    let vertices_m = piece.vertices_m();
    let first_end = vertices_m.iter().map(|p| p.x + half(p)).fold(f64::INFINITY, f64::min);
    let last_begin = vertices_m.iter().map(|p| p.x - half(p)).fold(f64::NEG_INFINITY, f64::max);
    let ends = if first_end > last_begin {
        let [min, max] = piece.bbox_m();
        [f64::midpoint(last_begin.max(min.x), first_end.min(max.x)); 2]
    } else {
        [first_end, last_begin]
    };
    ends.map(|x| V2::new(x, y_m))
}
