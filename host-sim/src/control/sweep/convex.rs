//! Ways over a convex polygon: lanes along one of its edges, back and forth.

use std::f64::consts::PI;

use crate::geometry::polygon::{Polygon, extent, modulo_pi};
use crate::geometry::{V2, cross};

use super::lanes::{Chains, Lane, good_lanes, plain_lanes, zigzag};
use super::timing::length_m;
use super::{Way, frame::SweepFrame};

/// Directions whose strips are optimised, of those with the shortest plain lanes.
const DIRECTIONS: usize = 4;

/// Strips of different heights have to gain this share of the length.
const WORTH_IT: f64 = 1e-3;

/// Directions that differ by less are one.
const SAME_DIRECTION_RAD: f64 = 1e-9;

/// Ways worth comparing, each back and forth along lanes parallel to an edge, and in front of them the plain
/// ones of Maza and Ollero: equal strips along `direction_rad`, and along the edge across which the polygon is narrowest.
pub(super) fn ways(polygon: &Polygon, direction_rad: f64, swath_m: f64) -> Vec<Way> {
    let classic = [direction_rad, polygon.min_width().direction_rad];
    let edges = polygon.edges_m().map(|(a, b)| modulo_pi((b - a).y.atan2((b - a).x)));
    let mut tried: Vec<Tried> = Vec::new();
    let mut ways: Vec<Way> = Vec::new();
    for (index, direction_rad) in classic.into_iter().chain(edges).enumerate() {
        if tried.iter().all(|t| (t.direction_rad - direction_rad).abs() > SAME_DIRECTION_RAD) {
            let found = Tried::new(polygon, direction_rad, swath_m);
            if index < classic.len() {
                ways.extend(found.plain().map(|way| Way { plain: true, ..way }));
            }
            tried.push(found);
        }
    }
    tried.sort_by(|a, b| a.plain_m.total_cmp(&b.plain_m));
    for t in tried.iter().take(DIRECTIONS) {
        ways.extend(t.plain());
        let optimised = good_lanes(&t.chains, swath_m).into_iter().flat_map(|lanes| t.both_ways(&lanes));
        ways.extend(optimised.filter(|way| way.length_m < t.plain_m * (1.0 - WORTH_IT)));
    }
    ways
}

/// Whether the centroid lies above half the height.
fn heavier_north(polygon: &Polygon) -> bool {
    // First moment of the area, by triangles from the origin.
    let moment_m3: f64 = polygon.edges_m().map(|(a, b)| cross(a, b) * (a.y + b.y)).sum();
    let [south, north] = extent(polygon.vertices_m(), V2::y());
    moment_m3 / (6.0 * polygon.area_m2()) > f64::midpoint(south, north)
}

/// How many of the [`ways`] are plain: what every other has to be held against.
pub(super) fn plain_ways(ways: &[Way]) -> &[Way] {
    let plain = ways.iter().take_while(|way| way.plain).count();
    &ways[..plain]
}

/// A direction of lanes.
struct Tried {
    direction_rad: f64,
    frame: SweepFrame,
    chains: Chains,
    lanes: Vec<Lane>,
    plain_m: f64,
}

impl Tried {
    fn new(polygon: &Polygon, direction_rad: f64, swath_m: f64) -> Self {
        let frame = SweepFrame::new(polygon.bbox_m(), direction_rad);
        // The search for strips goes from south to north and may end in either of two local minima: begin at the
        // same end however the area lies.
        let frame = if heavier_north(&polygon.moved(|p| frame.inward(p))) {
            SweepFrame::new(polygon.bbox_m(), direction_rad + PI)
        } else {
            frame
        };
        let chains = Chains::new(&polygon.moved(|p| frame.inward(p)));
        let lanes = plain_lanes(&chains, swath_m);
        let plain_m = [true, false]
            .map(|from_west| length_m(&zigzag(&lanes, from_west)))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        Self { direction_rad, frame, chains, lanes, plain_m }
    }

    fn plain(&self) -> [Way; 2] {
        self.both_ways(&self.lanes)
    }

    fn both_ways(&self, lanes: &[Lane]) -> [Way; 2] {
        [true, false].map(|from_west| {
            let path_m: Vec<V2> =
                zigzag(lanes, from_west).into_iter().map(|p| self.frame.outward(p)).collect();
            Way {
                direction_rad: self.direction_rad,
                length_m: length_m(&path_m),
                path_m,
                turns: lanes.len() - 1,
                plain: false,
            }
        })
    }
}
