//! The lanes as uploaded, and how fast each place of them may be flown.
//!
//! Straight legs join in fillets whose radius keeps the corner within [`CORNER_DEVIATION_M`] of the
//! track flown: corners are flown, not cut. A fillet of radius `r` between legs that turn by `phi`
//! leaves the corner at `r (1/cos(phi/2) - 1)`, begins `r tan(phi/2)` before it and allows
//! `v = sqrt(a r)`. A backward pass over the corners makes sure that each can be braked for.

use crate::{
    Vec2,
    scalar::{greater, lesser},
};
use heapless::Vec;
use skyroost_protocol::message::MAX_WAYPOINTS;

/// Farthest that the track may pass from a waypoint, metres.
pub const CORNER_DEVIATION_M: f32 = 1.0;
/// Acceleration across the track in fillets, metres a second squared: leaves room for wind below the
/// airframe's 3 m/s².
pub const LATERAL_ACCEL_MPS2: f32 = 1.8;
/// Acceleration along the track, metres a second squared.
pub const ALONG_ACCEL_MPS2: f32 = 1.5;
/// Widest fillet, metres: enough for any cruise speed, and small enough for `f32`.
const WIDEST_FILLET_M: f32 = 100.0;

/// Micrometres in a metre.
const UM_PER_M: f32 = 1e6;

/// Why lanes cannot be flown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LanesError {
    /// Fewer than two distinct waypoints.
    TooShort,
    /// More waypoints than [`MAX_WAYPOINTS`].
    TooLong,
    /// The speed is not above zero.
    Speed,
}

/// One waypoint with the fillet around it and the straight that follows.
///
/// Ways are kept in whole micrometres: adding 0.2 m steps to tens of kilometres in `f32` would lose a
/// percent of the speed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Corner {
    at_m: Vec2,
    /// Unit vector of the straight that follows.
    along: Vec2,
    /// Polyline from this waypoint to the next, metres; 0 at the last.
    leg_m: f32,
    /// From the ends of the fillet to the waypoint, metres.
    tangent_m: f32,
    /// Radius of the fillet, metres; infinite where the track runs straight on.
    radius_m: f32,
    /// Angle turned, radians, left positive.
    turn_rad: f32,
    /// Greatest speed through the fillet, metres a second.
    speed_mps: f32,
    /// Way along the track where the fillet begins, micrometres.
    start_um: i64,
}

impl Corner {
    /// Length of the fillet's arc, metres.
    fn arc_m(&self) -> f32 {
        if self.tangent_m > 0.0 { self.radius_m * libm::fabsf(self.turn_rad) } else { 0.0 }
    }
}

/// A point of the track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackPoint {
    /// Position, metres.
    pub pos_m: Vec2,
    /// Unit vector along the track.
    pub along: Vec2,
    /// Curvature with its sign (left turns are positive), 1/m.
    pub curvature_per_m: f32,
    /// Greatest speed from which everything ahead can be flown, metres a second.
    pub speed_limit_mps: f32,
}

/// Lanes ready to fly.
#[derive(Clone, Debug, Default)]
pub struct Lanes {
    corners: Vec<Corner, MAX_WAYPOINTS>,
    cruise_mps: f32,
    length_um: i64,
}

impl Lanes {
    /// Lays fillets and speeds over `waypoints_mm` (east and north). Repeated waypoints count once. The
    /// track turns no faster than `max_turn_radps` (infinite where nothing turns with it).
    ///
    /// # Errors
    /// When there is nothing to fly or no speed to fly it at.
    pub fn new(waypoints_mm: &[[i32; 2]], cruise_mps: f32, max_turn_radps: f32) -> Result<Self, LanesError> {
        if cruise_mps.is_nan() || cruise_mps <= 0.0 {
            return Err(LanesError::Speed);
        }
        let mut lanes = Self { corners: Vec::new(), cruise_mps, length_um: 0 };
        let mut previous: Option<[i32; 2]> = None;
        for &[east_mm, north_mm] in waypoints_mm {
            if previous == Some([east_mm, north_mm]) {
                continue;
            }
            previous = Some([east_mm, north_mm]);
            let corner = Corner {
                at_m: Vec2::new(east_mm as f32 * 1e-3, north_mm as f32 * 1e-3),
                along: Vec2::zeros(),
                leg_m: 0.0,
                tangent_m: 0.0,
                radius_m: f32::INFINITY,
                turn_rad: 0.0,
                speed_mps: 0.0,
                start_um: 0,
            };
            lanes.corners.push(corner).map_err(|_| LanesError::TooLong)?;
        }
        if lanes.corners.len() < 2 {
            return Err(LanesError::TooShort);
        }
        lanes.lay_legs();
        lanes.lay_fillets(max_turn_radps);
        lanes.limit_speeds();
        lanes.measure();
        Ok(lanes)
    }

    /// Length of the track, micrometres: the phase at which everything is flown.
    #[must_use]
    pub fn length_um(&self) -> i64 {
        self.length_um
    }

    /// Cruise speed, metres a second.
    #[must_use]
    pub fn cruise_mps(&self) -> f32 {
        self.cruise_mps
    }

    /// Number of waypoints kept.
    #[must_use]
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there is nothing to fly.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    fn lay_legs(&mut self) {
        let mut next: Option<Vec2> = None;
        for corner in self.corners.iter_mut().rev() {
            if let Some(next_m) = next {
                let leg = next_m - corner.at_m;
                corner.leg_m = leg.norm();
                corner.along = leg / corner.leg_m;
            }
            next = Some(corner.at_m);
        }
    }

    fn lay_fillets(&mut self, max_turn_radps: f32) {
        let mut before: Option<Corner> = None;
        for corner in &mut self.corners {
            if let (Some(before), true) = (before, corner.leg_m > 0.0) {
                // 0.49: neighbouring fillets never meet.
                let room_m = 0.49 * lesser(before.leg_m, corner.leg_m);
                corner.turn_rad =
                    libm::atan2f(before.along.perp(&corner.along), before.along.dot(&corner.along));
                (corner.tangent_m, corner.radius_m) = fillet(corner.turn_rad, room_m);
                corner.speed_mps = if corner.radius_m.is_finite() {
                    let grip_mps = libm::sqrtf(LATERAL_ACCEL_MPS2 * corner.radius_m);
                    lesser(lesser(grip_mps, max_turn_radps * corner.radius_m), self.cruise_mps)
                } else {
                    self.cruise_mps
                };
            }
            before = Some(*corner);
        }
    }

    /// No corner faster than the next one can be braked for.
    fn limit_speeds(&mut self) {
        let mut ahead = (0.0f32, 0.0f32); // speed and tangent of the corner ahead
        for corner in self.corners.iter_mut().rev() {
            let straight_m = greater(corner.leg_m - corner.tangent_m - ahead.1, 0.0);
            let reachable = libm::sqrtf(ahead.0 * ahead.0 + 2.0 * ALONG_ACCEL_MPS2 * straight_m);
            corner.speed_mps = lesser(corner.speed_mps, reachable);
            ahead = (corner.speed_mps, corner.tangent_m);
        }
    }

    /// Ways along the track: each corner's arc, then its straight.
    fn measure(&mut self) {
        let mut next_tangent_m = 0.0;
        for corner in self.corners.iter_mut().rev() {
            // Holds the straight for a moment; replaced by the running sum below.
            corner.start_um =
                (greater(corner.leg_m - corner.tangent_m - next_tangent_m, 0.0) * UM_PER_M) as i64;
            next_tangent_m = corner.tangent_m;
        }
        let mut way_um = 0;
        for corner in &mut self.corners {
            let straight_um = corner.start_um;
            corner.start_um = way_um;
            way_um += (corner.arc_m() * UM_PER_M) as i64 + straight_um;
        }
        self.length_um = way_um;
    }

    /// Index of the leg that holds `phase_um`; `hint` is where to look first (the last answer).
    #[must_use]
    pub fn leg_at(&self, phase_um: i64, hint: usize) -> usize {
        let last = self.corners.len().saturating_sub(2);
        let mut index = hint.min(last);
        // At most the number of legs in either direction; in flight mostly none.
        while index > 0 && self.corners.get(index).is_some_and(|c| c.start_um > phase_um) {
            index -= 1;
        }
        while index < last && self.corners.get(index + 1).is_some_and(|c| c.start_um <= phase_um) {
            index += 1;
        }
        index
    }

    /// The track at `phase_um` of leg `leg` (from [`leg_at`](Self::leg_at)); none without lanes.
    #[must_use]
    pub fn at(&self, phase_um: i64, leg: usize) -> Option<TrackPoint> {
        let (from, to) = (self.corners.get(leg)?, self.corners.get(leg + 1)?);
        let way_m = (phase_um - from.start_um).max(0) as f32 / UM_PER_M;
        let arc_m = from.arc_m();
        if way_m < arc_m {
            return Some(in_fillet(from, way_m / arc_m));
        }
        let straight_m = greater(from.leg_m - from.tangent_m - to.tangent_m, 0.0);
        let along_m = lesser(way_m - arc_m, straight_m);
        let braking_m = straight_m - along_m;
        let speed = libm::sqrtf(to.speed_mps * to.speed_mps + 2.0 * ALONG_ACCEL_MPS2 * braking_m);
        Some(TrackPoint {
            pos_m: from.at_m + from.along * (from.tangent_m + along_m),
            along: from.along,
            curvature_per_m: 0.0,
            speed_limit_mps: lesser(speed, self.cruise_mps),
        })
    }
}

/// Tangent length and radius of the fillet for a turn, the tangent at most `room_m`.
fn fillet(turn_rad: f32, room_m: f32) -> (f32, f32) {
    let (sin_half, cos_half) = libm::sincosf(0.5 * libm::fabsf(turn_rad));
    if sin_half < 1e-4 {
        return (0.0, f32::INFINITY);
    }
    if cos_half < 1e-3 {
        return (0.0, 0.0); // reversal on the spot
    }
    // deviation / (1/cos - 1) without the cancellation.
    let radius_m = CORNER_DEVIATION_M * cos_half * (1.0 + cos_half) / (sin_half * sin_half);
    let radius_m = lesser(lesser(radius_m, WIDEST_FILLET_M), room_m * cos_half / sin_half);
    (radius_m * sin_half / cos_half, radius_m)
}

/// The fillet around `corner`, `share` (0 to 1) of its arc flown.
fn in_fillet(corner: &Corner, share: f32) -> TrackPoint {
    let side = if corner.turn_rad < 0.0 { -1.0 } else { 1.0 };
    let heading_in = rotated(corner.along, -corner.turn_rad);
    let along = rotated(corner.along, corner.turn_rad * (share - 1.0));
    let to_centre = |heading: Vec2| Vec2::new(-heading.y, heading.x) * (side * corner.radius_m);
    let entry_m = corner.at_m - heading_in * corner.tangent_m;
    TrackPoint {
        pos_m: entry_m + to_centre(heading_in) - to_centre(along),
        along,
        curvature_per_m: side / corner.radius_m,
        speed_limit_mps: corner.speed_mps,
    }
}

/// `v` turned left by `angle_rad`.
fn rotated(v: Vec2, angle_rad: f32) -> Vec2 {
    let (sin, cos) = libm::sincosf(angle_rad);
    Vec2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn corner_lanes() -> Lanes {
        Lanes::new(&[[0, 0], [1_000_000, 0], [1_000_000, 900_000], [0, 900_000]], 10.0, f32::INFINITY)
            .unwrap()
    }

    /// Flies the profile at 50 Hz and calls `visit` with every point and the speed there.
    fn fly(lanes: &Lanes, mut visit: impl FnMut(TrackPoint, f32)) {
        let (mut phase_um, mut speed, mut leg) = (0i64, 0.0f32, 0);
        for _ in 0..2_000_000 {
            leg = lanes.leg_at(phase_um, leg);
            let point = lanes.at(phase_um, leg).unwrap();
            speed = point.speed_limit_mps.max(0.2).min(speed + ALONG_ACCEL_MPS2 * 0.02);
            visit(point, speed);
            if phase_um >= lanes.length_um() {
                return;
            }
            phase_um += (speed * 0.02 * UM_PER_M) as i64;
        }
        panic!("the lanes never end");
    }

    #[test]
    fn corners_are_flown_within_their_deviation() {
        let mut nearest = f32::INFINITY;
        fly(&corner_lanes(), |p, _| nearest = nearest.min((p.pos_m - Vec2::new(1000.0, 0.0)).norm()));
        assert!((nearest - CORNER_DEVIATION_M).abs() < 0.05, "passes the corner at {nearest} m");
    }

    #[test]
    fn a_corner_costs_four_to_five_seconds() {
        let lanes = corner_lanes();
        let mut steps = 0;
        fly(&lanes, |_, _| steps += 1);
        let ideal_s = 2_900.0 / 10.0 + 10.0 / ALONG_ACCEL_MPS2; // start and stop
        let lost_s = steps as f32 * 0.02 - ideal_s;
        assert!((8.0..11.0).contains(&lost_s), "two corners cost {lost_s} s");
    }

    #[test]
    fn bad_lanes_are_refused() {
        assert_eq!(Lanes::new(&[[0, 0], [0, 0]], 10.0, f32::INFINITY).unwrap_err(), LanesError::TooShort);
        assert_eq!(Lanes::new(&[[0, 0], [1, 0]], f32::NAN, f32::INFINITY).unwrap_err(), LanesError::Speed);
        let many: std::vec::Vec<_> = (0..=MAX_WAYPOINTS as i32).map(|i| [i * 1000, 0]).collect();
        assert_eq!(Lanes::new(&many, 10.0, f32::INFINITY).unwrap_err(), LanesError::TooLong);
    }

    proptest! {
        /// Whatever the corners: the track is continuous, stays near the polyline's corners, and never
        /// asks for more acceleration across or along it than allowed.
        #[test]
        fn any_lanes_are_flyable(raw in prop::collection::vec((-2_000_000..2_000_000i32, -2_000_000..2_000_000i32), 2..12)) {
            let waypoints: std::vec::Vec<[i32; 2]> = raw.iter().map(|&(e, n)| [e, n]).collect();
            prop_assume!(waypoints.windows(2).any(|w| w[0] != w[1]));
            let lanes = Lanes::new(&waypoints, 10.0, f32::INFINITY).unwrap();
            let mut last: Option<(TrackPoint, f32)> = None;
            let mut worst = None;
            fly(&lanes, |p, speed| {
                if let Some((before, speed_before)) = last {
                    let jump = (p.pos_m - before.pos_m).norm();
                    let braking = (speed_before - speed) / 0.02;
                    let across = speed * speed * p.curvature_per_m.abs();
                    // One step of 0.2 m, f32 at 2 km, and one step late at the start of a bend.
                    if jump > 0.2 + 0.02 || braking > 4.0 * ALONG_ACCEL_MPS2 || (speed > 0.21 && across > LATERAL_ACCEL_MPS2 * 1.05) {
                        worst = Some((jump, braking, across));
                    }
                }
                last = Some((p, speed));
            });
            prop_assert_eq!(worst, None);
            let end = last.unwrap().0.pos_m;
            let goal = waypoints.last().unwrap();
            prop_assert!((end - Vec2::new(goal[0] as f32 * 1e-3, goal[1] as f32 * 1e-3)).norm() < 0.5);
        }
    }
}
