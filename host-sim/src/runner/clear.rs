//! How near drones come to obstacles and to the fence, by their true positions.

use crate::{
    control::{
        airspace::{Airspace, border_distance_m},
        area::Obstacle,
    },
    geometry::{V2, V3},
};

/// The least distances so far, looked at in every step of the flight code that could lower them.
pub(super) struct Clearance {
    speed_mps: f64,
    /// Least distance from an obstacle, and when to look next at each drone.
    obstacles: Least,
    /// Least distance from the fence, from within.
    fence: Least,
}

struct Least {
    metres: f64,
    look_s: Vec<f64>,
}

impl Least {
    fn new(drones: usize) -> Self {
        Self { metres: f64::INFINITY, look_s: vec![0.0; drones] }
    }

    /// Looks at a drone if it could have come nearer than ever, at most so fast.
    fn look(&mut self, drone: usize, t_s: f64, speed_mps: f64, distance_m: impl Fn() -> f64) {
        if t_s >= self.look_s[drone] {
            let found_m = distance_m();
            self.metres = self.metres.min(found_m);
            self.look_s[drone] = t_s + (found_m - self.metres) / speed_mps;
        }
    }

    fn metres(&self) -> Option<f64> {
        self.metres.is_finite().then_some(self.metres)
    }
}

impl Clearance {
    /// Of so many drones, none of which is ever faster.
    pub(super) fn new(drones: usize, max_speed_mps: f64) -> Self {
        let least = || Least::new(drones);
        Self { speed_mps: max_speed_mps + 1.0, obstacles: least(), fence: least() }
    }

    /// The drones are at `positions_m` at `t_s`; nobody minds those that are excused.
    pub(super) fn moved(
        &mut self,
        t_s: f64,
        positions_m: &[V3],
        airspace: &Airspace,
        is_excused: impl Fn(usize) -> bool,
    ) {
        for (drone, at) in positions_m.iter().enumerate().filter(|(drone, _)| !is_excused(*drone)) {
            let nearest = || {
                let each = airspace.obstacles().iter().map(|it| distance_m(it, *at));
                each.fold(f64::INFINITY, f64::min)
            };
            if !airspace.obstacles().is_empty() {
                self.obstacles.look(drone, t_s, self.speed_mps, nearest);
            }
            self.fence.look(drone, t_s, self.speed_mps, || airspace.within_fence_m(at.xy()));
        }
    }

    /// Least distance from an obstacle, metres; none without obstacles.
    pub(super) fn least_m(&self) -> Option<f64> {
        self.obstacles.metres()
    }

    /// Least distance from the fence, metres, negative outside.
    pub(super) fn within_fence_m(&self) -> Option<f64> {
        self.fence.metres()
    }
}

/// Distance from an obstacle, metres; 0 within it.
fn distance_m(obstacle: &Obstacle, at: V3) -> f64 {
    let beside_m = beside_m(obstacle, at.xy());
    let above_m = obstacle.top_m.map_or(0.0, |top_m| (at.z - top_m).max(0.0));
    beside_m.hypot(above_m)
}

/// Distance over ground from what an obstacle covers, metres.
fn beside_m(Obstacle { footprint, cylinder_m, .. }: &Obstacle, at: V2) -> f64 {
    match cylinder_m {
        Some((centre_m, radius_m)) => ((at - centre_m).norm() - radius_m).max(0.0),
        None if footprint.contains(at) => 0.0,
        None => border_distance_m(footprint, at),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::polygon::Polygon;

    fn square(side_m: f64) -> Polygon {
        let corners = [[0.0, 0.0], [side_m, 0.0], [side_m, side_m], [0.0, side_m]];
        Polygon::new(&corners.map(V2::from)).unwrap()
    }

    #[test]
    fn truth_beside_above_and_within() {
        let block =
            |top_m| Obstacle { name: String::new(), footprint: square(10.0), cylinder_m: None, top_m };
        let mast = Obstacle { cylinder_m: Some((V2::new(5.0, 5.0), 2.0)), ..block(Some(50.0)) };
        for (obstacle, at, expected_m) in [
            (&block(Some(20.0)), [13.0, 5.0, 10.0], 3.0),
            (&block(Some(20.0)), [13.0, 5.0, 24.0], 5.0),
            (&block(Some(20.0)), [5.0, 5.0, 27.0], 7.0),
            (&block(Some(20.0)), [5.0, 5.0, 7.0], 0.0),
            (&block(None), [5.0, 14.0, 900.0], 4.0),
            (&mast, [5.0, 12.0, 30.0], 5.0),
        ] {
            assert!((distance_m(obstacle, V3::from(at)) - expected_m).abs() < 1e-9, "{at:?}");
        }
    }

    #[test]
    fn looking_away_misses_nothing() {
        let obstacles =
            vec![Obstacle { name: String::new(), footprint: square(10.0), cylinder_m: None, top_m: None }];
        let fence =
            Polygon::new(&[[-2e3, -2e3], [2e3, -2e3], [2e3, 2e3], [-2e3, 2e3]].map(V2::from)).unwrap();
        let airspace = Airspace::new(obstacles, fence, 100.0, 10.0).unwrap();
        let mut watch = Clearance::new(1, 10.0);
        for step in 0..10_000 {
            let t_s = f64::from(step) * 0.02;
            watch.moved(t_s, &[V3::new(10.0 * t_s - 500.0, 14.0, 50.0)], &airspace, |_| false);
        }
        assert_eq!(watch.least_m(), Some(4.0));
        assert!((watch.within_fence_m().unwrap() - 500.0).abs() < 0.3, "{:?}", watch.within_fence_m());
    }
}
