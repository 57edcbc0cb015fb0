//! The lanes as uploaded, and how fast each place of them may be flown.
//!
//! Straight legs join in fillets whose radius keeps the corner within [`CORNER_DEVIATION_M`] of the
//! track flown: corners are flown, not cut. A fillet of radius `r` between legs that turn by `phi`
//! leaves the corner at `r (1/cos(phi/2) - 1)`, begins `r tan(phi/2)` before it and allows
//! `v = sqrt(a r)`. A backward pass over the corners makes sure that each can be braked for.

use crate::{
    Vec2,
    avoid::walls::Wall,
    scalar::{greater, lesser, sin_cos},
};
use heapless::Vec;
use skyroost_protocol::message::{MAX_WAYPOINTS, WAYPOINTS_PER_WALL};

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
    /// More walls than there are waypoints for.
    Walls,
    /// The speed is not above zero.
    Speed,
}

/// One waypoint with the fillet around it and the straight that follows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
}

impl Corner {
    /// The corner at `at_m` between its neighbours; there is nothing to turn at either end.
    fn new(before_m: Option<Vec2>, at_m: Vec2, next_m: Option<Vec2>) -> Self {
        let (along, leg_m) = next_m.map_or((Vec2::zeros(), 0.0), |next_m| leg(at_m, next_m));
        let mut corner = Self { at_m, along, leg_m, tangent_m: 0.0, radius_m: f32::INFINITY, turn_rad: 0.0 };
        if let (Some(before_m), true) = (before_m, leg_m > 0.0) {
            let (before, before_leg_m) = leg(before_m, at_m);
            // 0.49: neighbouring fillets never meet.
            let room_m = 0.49 * lesser(before_leg_m, leg_m);
            corner.turn_rad = libm::atan2f(before.perp(&along), before.dot(&along));
            (corner.tangent_m, corner.radius_m) = fillet(before, along, room_m);
        }
        corner
    }

    /// Length of the fillet's arc, metres.
    fn arc_m(&self) -> f32 {
        if self.tangent_m > 0.0 { self.radius_m * libm::fabsf(self.turn_rad) } else { 0.0 }
    }

    /// Length of the straight that follows, up to the next fillet, metres.
    fn straight_m(&self, next_tangent_m: f32) -> f32 {
        greater(self.leg_m - self.tangent_m - next_tangent_m, 0.0)
    }

    /// Way along the track from this fillet's beginning to the next one's, micrometres.
    fn way_um(&self, next_tangent_m: f32) -> i64 {
        (self.arc_m() * UM_PER_M) as i64 + (self.straight_m(next_tangent_m) * UM_PER_M) as i64
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

/// The leg of the track that was looked at last: a fillet and the straight that follows. Belongs to the
/// lanes that it was used with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cursor {
    leg: Option<Leg>,
}

impl Cursor {
    /// Nothing looked at yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { leg: None }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Leg {
    /// Indices of the waypoints at both ends.
    from_index: u16,
    to_index: u16,
    from: Corner,
    to: Corner,
    /// Way along the track where the leg's fillet begins and where that of the next one does, micrometres.
    start_um: i64,
    end_um: i64,
}

/// The lanes and the walls of a mission, and room to assemble them in.
///
/// Of each waypoint two things are kept: where it is, and how fast it may be passed, which depends on all
/// that lies ahead. The rest is worked out for one leg at a time when it is entered. Ways are whole
/// micrometres: adding 0.2 m steps to tens of kilometres in `f32` would lose a percent of the speed.
#[derive(Clone, Debug)]
pub struct Lanes {
    /// As uploaded, those of the walls last; repeated waypoints of the lanes count once.
    waypoints_mm: Vec<[i32; 2], MAX_WAYPOINTS>,
    /// Greatest speed through the fillet at each waypoint, metres a second; of repeated ones at the first.
    speeds_mps: [f32; MAX_WAYPOINTS],
    cruise_mps: f32,
    length_um: i64,
    laid: bool,
    /// Whether what is behind the lanes are walls that stand.
    walled: bool,
    /// Waypoints of the lanes.
    lane_count: u16,
}

impl Default for Lanes {
    fn default() -> Self {
        Self::empty()
    }
}

impl Lanes {
    /// No lanes.
    #[must_use]
    pub const fn empty() -> Self {
        Self {
            waypoints_mm: Vec::new(),
            speeds_mps: [0.0; MAX_WAYPOINTS],
            cruise_mps: 0.0,
            length_um: 0,
            laid: false,
            walled: false,
            lane_count: 0,
        }
    }

    /// Lanes over `waypoints_mm`, ready to fly; see [`lay`](Self::lay).
    ///
    /// # Errors
    /// When there is nothing to fly or no speed to fly it at.
    pub fn new(waypoints_mm: &[[i32; 2]], cruise_mps: f32, max_turn_radps: f32) -> Result<Self, LanesError> {
        let mut lanes = Self::empty();
        lanes.open(waypoints_mm.len(), 0)?;
        lanes.write(0, waypoints_mm);
        lanes.lay(cruise_mps, max_turn_radps)?;
        Ok(lanes)
    }

    /// Gives up the lanes and all room for others.
    pub fn clear(&mut self) {
        self.reopen();
        self.lane_count = 0;
        self.waypoints_mm.clear();
    }

    /// Gives up the lanes there are and makes room for `waypoints` others, the last of them for so many walls.
    ///
    /// # Errors
    /// [`LanesError::TooLong`] and [`LanesError::Walls`]; there is then no room at all.
    pub fn open(&mut self, waypoints: usize, walls: usize) -> Result<(), LanesError> {
        self.clear();
        let lanes =
            waypoints.checked_sub(walls.saturating_mul(WAYPOINTS_PER_WALL)).ok_or(LanesError::Walls)?;
        self.waypoints_mm.resize_default(waypoints).map_err(|_| LanesError::TooLong)?;
        self.lane_count = lanes as u16;
        Ok(())
    }

    /// Gives up the lanes and walls there are but keeps their waypoints, to be written anew.
    pub const fn reopen(&mut self) {
        self.laid = false;
        self.walled = false;
    }

    /// Raises the walls once all waypoints have been written.
    pub const fn raise_walls(&mut self) {
        self.walled = true;
    }

    /// The walls that stand.
    pub fn walls(&self) -> impl Iterator<Item = Wall> {
        self.walls_from(0)
    }

    /// Those of them from number `first` on.
    pub fn walls_from(&self, first: usize) -> impl Iterator<Item = Wall> {
        let behind = self.waypoints_mm.get(usize::from(self.lane_count)..).filter(|_| self.walled);
        let walls = behind.unwrap_or_default().chunks_exact(WAYPOINTS_PER_WALL).skip(first);
        walls.filter_map(|points| Some(Wall::from_mm(points.try_into().ok()?)))
    }

    /// The waypoints of the lanes.
    fn lanes_mm(&self) -> &[[i32; 2]] {
        self.waypoints_mm.get(..usize::from(self.lane_count)).unwrap_or_default()
    }

    /// Puts a piece of the lanes in its place, `first` waypoints from their start; false where there is no
    /// room for it. Lanes that are laid, and walls that stand, stay as they are.
    pub fn write(&mut self, first: usize, piece_mm: &[[i32; 2]]) -> bool {
        let room = self.waypoints_mm.get_mut(first..).and_then(|rest| rest.get_mut(..piece_mm.len()));
        let Some(room) = room else { return false };
        if !self.laid && !self.walled {
            room.copy_from_slice(piece_mm);
        }
        true
    }

    /// All waypoints there is room for, east and north.
    #[must_use]
    pub fn waypoints_mm(&self) -> &[[i32; 2]] {
        &self.waypoints_mm
    }

    /// Lays fillets and speeds over the waypoints and makes the lanes ready to fly. Repeated waypoints count
    /// once. The track turns no faster than `max_turn_radps` (infinite where nothing turns with it).
    ///
    /// # Errors
    /// When there is nothing to fly or no speed to fly it at.
    pub fn lay(&mut self, cruise_mps: f32, max_turn_radps: f32) -> Result<(), LanesError> {
        self.laid = false;
        if cruise_mps.is_nan() || cruise_mps <= 0.0 {
            return Err(LanesError::Speed);
        }
        let first = self.lanes_mm().first();
        if self.lanes_mm().iter().all(|other| Some(other) == first) {
            return Err(LanesError::TooShort);
        }
        (self.cruise_mps, self.length_um) = (cruise_mps, 0);
        // From the end back: no corner is passed faster than the next one can be braked for.
        let (mut next_m, mut next_mps, mut next_tangent_m) = (None, 0.0f32, 0.0);
        for index in (0..self.lanes_mm().len()).rev() {
            let Some((before_m, at_m)) = self.unless_repeated(index) else { continue };
            let corner = Corner::new(before_m, at_m, next_m);
            let braking_m = corner.straight_m(next_tangent_m);
            let reachable = libm::sqrtf(next_mps * next_mps + 2.0 * ALONG_ACCEL_MPS2 * braking_m);
            let speed_mps = if before_m.is_none() || corner.leg_m <= 0.0 || corner.leg_m.is_nan() {
                0.0 // at both ends
            } else if corner.radius_m.is_finite() {
                let grip_mps = libm::sqrtf(LATERAL_ACCEL_MPS2 * corner.radius_m);
                lesser(lesser(grip_mps, max_turn_radps * corner.radius_m), cruise_mps)
            } else {
                cruise_mps
            };
            self.length_um = self.length_um.saturating_add(corner.way_um(next_tangent_m));
            (next_m, next_mps, next_tangent_m) = (Some(at_m), lesser(speed_mps, reachable), corner.tangent_m);
            if let Some(speed) = self.speeds_mps.get_mut(index) {
                *speed = next_mps;
            }
        }
        self.laid = true;
        Ok(())
    }

    /// Length of the track, micrometres: the phase at which everything is flown.
    #[must_use]
    pub fn length_um(&self) -> i64 {
        if self.laid { self.length_um } else { 0 }
    }

    /// Cruise speed, metres a second.
    #[must_use]
    pub fn cruise_mps(&self) -> f32 {
        self.cruise_mps
    }

    /// Whether there is nothing to fly.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.laid
    }

    /// The track at `phase_um`; none without lanes. `cursor` is where to look first, and in flight mostly
    /// where it is.
    #[must_use]
    pub fn at(&self, phase_um: i64, cursor: &mut Cursor) -> Option<TrackPoint> {
        if !self.laid {
            return None;
        }
        let mut leg = match cursor.leg {
            Some(leg) => leg,
            None => self.first_leg()?,
        };
        // No more legs than waypoints in either direction.
        for _ in 0..MAX_WAYPOINTS {
            let neighbour = if phase_um < leg.start_um {
                self.leg_before(&leg)
            } else if phase_um >= leg.end_um {
                self.leg_after(&leg)
            } else {
                None
            };
            let Some(neighbour) = neighbour else { break };
            leg = neighbour;
        }
        cursor.leg = Some(leg);
        Some(self.on_leg(&leg, phase_um))
    }

    fn on_leg(&self, leg: &Leg, phase_um: i64) -> TrackPoint {
        let (from, to) = (&leg.from, &leg.to);
        let way_m = phase_um.saturating_sub(leg.start_um).max(0) as f32 / UM_PER_M;
        let arc_m = from.arc_m();
        if way_m < arc_m {
            return in_fillet(from, self.speed_at(leg.from_index), way_m / arc_m);
        }
        let straight_m = from.straight_m(to.tangent_m);
        let along_m = lesser(way_m - arc_m, straight_m);
        let braking_m = straight_m - along_m;
        let to_mps = self.speed_at(leg.to_index);
        let speed = libm::sqrtf(to_mps * to_mps + 2.0 * ALONG_ACCEL_MPS2 * braking_m);
        TrackPoint {
            pos_m: from.at_m + from.along * (from.tangent_m + along_m),
            along: from.along,
            curvature_per_m: 0.0,
            speed_limit_mps: lesser(speed, self.cruise_mps),
        }
    }

    fn first_leg(&self) -> Option<Leg> {
        let to_index = self.index_after(0)?;
        let (from, to) = (self.corner(0)?, self.corner(to_index)?);
        Some(Leg { from_index: 0, to_index, from, to, start_um: 0, end_um: from.way_um(to.tangent_m) })
    }

    fn leg_after(&self, leg: &Leg) -> Option<Leg> {
        let (from_index, from, start_um) = (leg.to_index, leg.to, leg.end_um);
        let to_index = self.index_after(from_index)?;
        let to = self.corner(to_index)?;
        let end_um = start_um.saturating_add(from.way_um(to.tangent_m));
        Some(Leg { from_index, to_index, from, to, start_um, end_um })
    }

    fn leg_before(&self, leg: &Leg) -> Option<Leg> {
        let (to_index, to, end_um) = (leg.from_index, leg.from, leg.start_um);
        let from_index = self.index_before(to_index)?;
        let from = self.corner(from_index)?;
        let start_um = end_um.saturating_sub(from.way_um(to.tangent_m));
        Some(Leg { from_index, to_index, from, to, start_um, end_um })
    }

    /// The corner at a waypoint that does not repeat the one before.
    fn corner(&self, index: u16) -> Option<Corner> {
        let (before_m, at_m) = self.unless_repeated(usize::from(index))?;
        let next = self.index_after(index).and_then(|next| self.lanes_mm().get(usize::from(next)));
        Some(Corner::new(before_m, at_m, next.copied().map(metres)))
    }

    /// The waypoint at `index` and the one before it; none where they are the same.
    fn unless_repeated(&self, index: usize) -> Option<(Option<Vec2>, Vec2)> {
        let at = self.lanes_mm().get(index)?;
        let before = index.checked_sub(1).and_then(|before| self.lanes_mm().get(before));
        (before != Some(at)).then(|| (before.copied().map(metres), metres(*at)))
    }

    /// Index of the next waypoint that is another one.
    fn index_after(&self, index: u16) -> Option<u16> {
        let mut rest = self.lanes_mm().get(usize::from(index)..)?.iter();
        let here = rest.next()?;
        Some(index + 1 + rest.position(|other| other != here)? as u16)
    }

    /// Index of the waypoint before, the first of its repetitions.
    fn index_before(&self, index: u16) -> Option<u16> {
        let mut before = self.lanes_mm().get(..usize::from(index))?.iter();
        let last = before.next_back()?;
        Some(before.rposition(|other| other != last).map_or(0, |other| other as u16 + 1))
    }

    fn speed_at(&self, index: u16) -> f32 {
        self.speeds_mps.get(usize::from(index)).copied().unwrap_or_default()
    }
}

fn metres(mm: [i32; 2]) -> Vec2 {
    Vec2::from(mm.map(|mm| mm as f32 * 1e-3))
}

/// Direction and length of the way from one waypoint to another.
fn leg(from_m: Vec2, to_m: Vec2) -> (Vec2, f32) {
    let leg = to_m - from_m;
    let leg_m = leg.norm();
    (leg / leg_m, leg_m)
}

/// Tangent length and radius of the fillet for a turn between two directions, the tangent at most `room_m`.
fn fillet(before: Vec2, along: Vec2, room_m: f32) -> (f32, f32) {
    // Of the half angle, from the chords: exact at both ends, and a tenth of what libm's trigonometry costs, which
    // computes in f64, without hardware on a board.
    let (sin_half, cos_half) = (0.5 * (along - before).norm(), 0.5 * (along + before).norm());
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

/// The fillet around `corner`, passed at `speed_mps`, `share` (0 to 1) of its arc flown.
fn in_fillet(corner: &Corner, speed_mps: f32, share: f32) -> TrackPoint {
    let side = if corner.turn_rad < 0.0 { -1.0 } else { 1.0 };
    let heading_in = rotated(corner.along, -corner.turn_rad);
    let along = rotated(corner.along, corner.turn_rad * (share - 1.0));
    let to_centre = |heading: Vec2| Vec2::new(-heading.y, heading.x) * (side * corner.radius_m);
    let entry_m = corner.at_m - heading_in * corner.tangent_m;
    TrackPoint {
        pos_m: entry_m + to_centre(heading_in) - to_centre(along),
        along,
        curvature_per_m: side / corner.radius_m,
        speed_limit_mps: speed_mps,
    }
}

/// `v` turned left by `angle_rad`.
fn rotated(v: Vec2, angle_rad: f32) -> Vec2 {
    let (sin, cos) = sin_cos(angle_rad);
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
        let (mut phase_um, mut speed, mut cursor) = (0i64, 0.0f32, Cursor::default());
        for _ in 0..2_000_000 {
            let point = lanes.at(phase_um, &mut cursor).unwrap();
            speed = lesser(greater(point.speed_limit_mps, 0.2), speed + ALONG_ACCEL_MPS2 * 0.02);
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
        fly(&corner_lanes(), |p, _| nearest = lesser((p.pos_m - Vec2::new(1000.0, 0.0)).norm(), nearest));
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

    #[test]
    fn a_fleet_that_waits_at_the_end_stays_there() {
        let (lanes, mut cursor) = (corner_lanes(), Cursor::new());
        let end = lanes.at(lanes.length_um(), &mut cursor).unwrap();
        assert!((end.pos_m - Vec2::new(0.0, 900.0)).norm() < 1e-3);
        assert_eq!(lanes.at(i64::MAX, &mut cursor), Some(end));
        let start = lanes.at(i64::MIN, &mut cursor).unwrap();
        assert!(start.pos_m.norm() < 1e-3);
    }

    proptest! {
        /// Neither does it matter where the cursor comes from, nor whether waypoints stand there twice.
        #[test]
        fn the_track_is_one(
            raw in prop::collection::vec(prop::array::uniform2(-300_000..300_000i32), 2..20),
            twice in 0..3usize, shares in prop::collection::vec(0.0..1.0f64, 1..30),
        ) {
            prop_assume!(raw.windows(2).any(|w| w[0] != w[1]));
            let repeated: std::vec::Vec<[i32; 2]> =
                raw.iter().enumerate().flat_map(|(i, w)| [*w].repeat(if i % 2 == twice { 2 } else { 1 })).collect();
            let lanes = Lanes::new(&raw, 10.0, 0.3).unwrap();
            let same = Lanes::new(&repeated, 10.0, 0.3).unwrap();
            prop_assert_eq!(lanes.length_um(), same.length_um());
            let (mut cursor, mut other) = (Cursor::new(), Cursor::new());
            for share in shares {
                let phase_um = (share * lanes.length_um() as f64) as i64;
                let here = lanes.at(phase_um, &mut cursor);
                prop_assert_eq!(here, lanes.at(phase_um, &mut Cursor::new()));
                prop_assert_eq!(here, same.at(phase_um, &mut other));
            }
        }

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
