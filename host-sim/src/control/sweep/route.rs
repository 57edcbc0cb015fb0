//! Ways around no-fly zones: the shortest path among polygons, by the visibility graph.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::geometry::polygon::Polygon;
use crate::geometry::region::grown;
use crate::geometry::{V2, cross};

/// Corners of a way lie this much farther out than what must not be crossed.
pub(super) const ROOM_M: f64 = 1.0;

/// What may be flown, and the shortest ways there.
#[derive(Clone, Debug)]
pub(in crate::control) struct Routes {
    /// What the centre of a fleet must not enter, with the boxes around.
    blocked: Vec<(Polygon, [V2; 2])>,
    /// Borders on which ways lead around it.
    around: Vec<Polygon>,
    /// Corners of ways around it.
    nodes: Vec<V2>,
    /// From each node the nodes it sees, with their distances.
    sees: Vec<Vec<(usize, f64)>>,
}

impl Routes {
    /// Ways that stay `clearance_m` away from all zones, with corners `room_m` farther out, where those are `allowed`.
    pub(in crate::control) fn new(
        zones: &[Polygon],
        clearance_m: f64,
        room_m: f64,
        allowed: impl Fn(V2) -> bool,
    ) -> Self {
        if zones.is_empty() {
            return Self { blocked: Vec::new(), around: Vec::new(), nodes: Vec::new(), sees: Vec::new() };
        }
        let blocked: Vec<_> = grown(zones, clearance_m)
            .into_iter()
            .map(|ring| (ring.bbox_m(), ring))
            .map(|(b, r)| (r, b))
            .collect();
        let around = grown(zones, clearance_m + room_m);
        let mut routes = Self { blocked, around, nodes: Vec::new(), sees: Vec::new() };
        let corners = routes.around.iter().flat_map(|ring| ring.vertices_m().iter().copied());
        routes.nodes = corners.filter(|p| routes.is_free_point(*p) && allowed(*p)).collect();
        let n = routes.nodes.len();
        routes.sees = vec![Vec::new(); n];
        for i in 0..n {
            for j in i + 1..n {
                if routes.is_free(routes.nodes[i], routes.nodes[j]) {
                    let m = (routes.nodes[i] - routes.nodes[j]).norm();
                    routes.sees[i].push((j, m));
                    routes.sees[j].push((i, m));
                }
            }
        }
        routes
    }

    /// Whether there is nothing to fly around.
    pub(in crate::control) fn is_open(&self) -> bool {
        self.blocked.is_empty()
    }

    /// Corners of ways around the zones: free places near to them.
    pub(in crate::control) fn nodes_m(&self) -> &[V2] {
        &self.nodes
    }

    /// Borders that lead around the zones.
    pub(in crate::control) fn around(&self) -> &[Polygon] {
        &self.around
    }

    /// Whether a point is outside of what must not be entered.
    pub(in crate::control) fn is_free_point(&self, p: V2) -> bool {
        !self.blocked.iter().any(|(ring, [min, max])| within(p, *min, *max) && ring.contains(p))
    }

    /// Whether the straight way between two points is free.
    pub(in crate::control) fn is_free(&self, a: V2, b: V2) -> bool {
        let (low, high) = (a.inf(&b), a.sup(&b));
        !self.blocked.iter().any(|(ring, [min, max])| {
            let near = low.x <= max.x && min.x <= high.x && low.y <= max.y && min.y <= high.y;
            near && (ring.edges_m().any(|(p, q)| meet(a, b, p, q)) || ring.contains((a + b) / 2.0))
        })
    }

    /// The free parts of a level leg from west to east.
    pub(in crate::control) fn free_parts(&self, west: V2, east: V2) -> Vec<[V2; 2]> {
        let y = west.y;
        let mut cuts_m = vec![west.x, east.x];
        for (ring, [min, max]) in &self.blocked {
            if min.y <= y && y <= max.y {
                let crossings = ring.edges_m().filter(|(a, b)| (a.y > y) != (b.y > y));
                let at = crossings.map(|(a, b)| a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)));
                cuts_m
                    .extend(at.flat_map(|x| [x - ROOM_M, x + ROOM_M]).filter(|x| west.x < *x && *x < east.x));
            }
        }
        cuts_m.sort_by(f64::total_cmp);
        let parts = cuts_m.windows(2).map(|w| [V2::new(w[0], y), V2::new(w[1], y)]);
        let mut free: Vec<[V2; 2]> = Vec::new();
        for [a, b] in parts.filter(|[a, b]| self.is_free(*a, *b)) {
            match free.last_mut() {
                Some(last) if last[1] == a => last[1] = b,
                _ => free.push([a, b]),
            }
        }
        free
    }

    /// Distances from a point to some others, metres; infinite where there is no way.
    pub(in crate::control) fn distances_m(&self, from: V2, to: &[V2]) -> Vec<f64> {
        if self.is_open() {
            return to.iter().map(|p| (p - from).norm()).collect();
        }
        let reached = self.search(from).0;
        let around = |p: V2| {
            let seen = (0..self.nodes.len()).filter(|&i| reached[i].is_finite());
            // The nearest nodes first would be faster; there are few.
            seen.map(|i| (reached[i] + (self.nodes[i] - p).norm(), i))
                .filter(|&(_, i)| self.is_free(self.nodes[i], p))
                .map(|(m, _)| m)
                .fold(f64::INFINITY, f64::min)
        };
        to.iter().map(|&p| if self.is_free(from, p) { (p - from).norm() } else { around(p) }).collect()
    }

    /// The shortest way, both ends included; none where there is none.
    pub(in crate::control) fn way(&self, from: V2, to: V2) -> Option<Vec<V2>> {
        if self.is_free(from, to) {
            return Some(vec![from, to]);
        }
        let (reached, before) = self.search(from);
        let last = (0..self.nodes.len())
            .filter(|&i| reached[i].is_finite() && self.is_free(self.nodes[i], to))
            .min_by(|&i, &j| {
                let m = |k: usize| reached[k] + (self.nodes[k] - to).norm();
                m(i).total_cmp(&m(j))
            })?;
        let mut way = vec![to];
        let mut at = Some(last);
        while let Some(i) = at {
            way.push(self.nodes[i]);
            at = before[i];
        }
        way.push(from);
        way.reverse();
        Some(way)
    }

    /// Dijkstra from a point: for each node its distance, and the node before it on the way.
    fn search(&self, from: V2) -> (Vec<f64>, Vec<Option<usize>>) {
        let n = self.nodes.len();
        let (mut reached, mut before) = (vec![f64::INFINITY; n], vec![None; n]);
        let mut open = BinaryHeap::new();
        for (i, p) in self.nodes.iter().enumerate() {
            if self.is_free(from, *p) {
                reached[i] = (p - from).norm();
                open.push(Reverse((Metres(reached[i]), i)));
            }
        }
        while let Some(Reverse((Metres(m), i))) = open.pop() {
            if m > reached[i] {
                continue;
            }
            for &(j, step_m) in &self.sees[i] {
                if m + step_m < reached[j] {
                    (reached[j], before[j]) = (m + step_m, Some(i));
                    open.push(Reverse((Metres(m + step_m), j)));
                }
            }
        }
        (reached, before)
    }
}

/// A distance that can be ordered; never NaN.
#[derive(PartialEq)]
struct Metres(f64);

impl Eq for Metres {}

impl PartialOrd for Metres {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Metres {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

fn within(p: V2, min: V2, max: V2) -> bool {
    min.x <= p.x && p.x <= max.x && min.y <= p.y && p.y <= max.y
}

/// Whether two segments have a point in common.
fn meet(a: V2, b: V2, p: V2, q: V2) -> bool {
    let sides =
        |from: V2, to: V2, u: V2, v: V2| cross(to - from, u - from) * cross(to - from, v - from) <= 0.0;
    let (low, high) = (p.inf(&q), p.sup(&q));
    let (from, to) = (a.inf(&b), a.sup(&b));
    low.x <= to.x
        && from.x <= high.x
        && low.y <= to.y
        && from.y <= high.y
        && sides(a, b, p, q)
        && sides(p, q, a, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(west: f64, south: f64, east: f64, north: f64) -> Polygon {
        let corners = [[west, south], [east, south], [east, north], [west, north]];
        Polygon::new(&corners.map(V2::from)).unwrap()
    }

    fn length_m(way: &[V2]) -> f64 {
        way.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }

    #[test]
    fn truth_around_a_square() {
        let routes = Routes::new(&[rectangle(0.0, 0.0, 1000.0, 1000.0)], 40.0, ROOM_M, |_| true);
        let (a, b) = (V2::new(-500.0, 500.0), V2::new(1500.0, 500.0));
        let way = routes.way(a, b).unwrap();
        // Taut around the south or the north: between the square's corners and those 45 m out.
        let taut = |out: f64| 2.0 * (500.0 - out).hypot(500.0 + out) + 1000.0 + 2.0 * out;
        assert!(
            length_m(&way) > 2.0 * 500f64.hypot(540.0) + 1000.0 - 1.0 && length_m(&way) < taut(45.0),
            "{way:?}"
        );
        assert!(way.windows(2).all(|w| routes.is_free(w[0], w[1])));
        assert!((routes.distances_m(a, &[b])[0] - length_m(&way)).abs() < 1e-9);
        assert!(!routes.is_free(a, b) && !routes.is_free_point(V2::new(-20.0, 500.0)));
        let beside = V2::new(-500.0, 1200.0);
        assert_eq!(routes.way(a, beside), Some(vec![a, beside]));
    }

    #[test]
    fn what_is_walled_in_cannot_be_reached() {
        let walls = [
            rectangle(0.0, 0.0, 1000.0, 50.0),
            rectangle(0.0, 950.0, 1000.0, 1000.0),
            rectangle(0.0, 0.0, 50.0, 1000.0),
            rectangle(950.0, 0.0, 1000.0, 1000.0),
        ];
        let routes = Routes::new(&walls, 40.0, ROOM_M, |_| true);
        let (inside, outside) = (V2::new(500.0, 500.0), V2::new(2000.0, 500.0));
        assert_eq!(routes.way(outside, inside), None);
        assert_eq!(routes.distances_m(outside, &[inside]), [f64::INFINITY]);
    }

    #[test]
    fn a_leg_is_cut_where_zones_lie() {
        let zones = [rectangle(100.0, -10.0, 200.0, 10.0), rectangle(500.0, -10.0, 510.0, 5.0)];
        let routes = Routes::new(&zones, 20.0, ROOM_M, |_| true);
        let parts = routes.free_parts(V2::zeros(), V2::new(1000.0, 0.0));
        assert_eq!(parts.len(), 3);
        for (part, [from, to]) in parts.iter().zip([[0.0, 79.0], [221.0, 479.0], [531.0, 1000.0]]) {
            assert!((part[0].x - from).abs() < 1.5 && (part[1].x - to).abs() < 1.5, "{part:?}");
        }
        assert!(routes.free_parts(V2::new(120.0, 0.0), V2::new(130.0, 0.0)).is_empty());
    }
}
