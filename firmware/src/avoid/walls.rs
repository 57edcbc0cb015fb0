//! Walls: what stands on the ground and the fence, never met.
//!
//! A wall is a vertical stadium: all within a radius of a segment, from the ground to a top. A mast is a wall of
//! length zero; a building or a fence is its edges. Unlike a neighbour a wall does not move and does not give way, so
//! there is no pass to plan: a drone may close only as fast as it can brake. What is left of the wanted velocity runs
//! along the wall, to the side where the goal is.

use super::{halfplanes::HalfPlane, pca::Mover};
use crate::{
    Vec2, Vec3,
    scalar::{greater, lesser, within},
};
use heapless::Vec;

/// Most walls that are looked at together, the nearest.
pub const MAX_WALL_ROWS: usize = 8;

/// Braking in front of a wall, metres a second squared: what a pair of drones is trusted with, for one.
const BRAKE_MPS2: f32 = 2.0;
/// A velocity may grow by this much before the wall is looked at again, metres a second.
const SPEED_UP_MPS: f32 = 4.0;
/// Speed away from a wall for every metre too near, 1/s.
const PART_GAIN_PER_S: f32 = 1.0;
/// Greatest speed away from a wall, metres a second.
const PART_MPS: f32 = 2.0;

/// A vertical stadium.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wall {
    /// One end of its segment, east and north, metres.
    pub a_m: Vec2,
    /// The other end, metres; may equal the first.
    pub b_m: Vec2,
    /// Its radius around the segment, metres.
    pub radius_m: f32,
    /// Its top, metres above the local origin.
    pub top_m: f32,
}

impl Wall {
    /// A wall from its waypoints in a mission: both ends, then radius and top, millimetres.
    #[must_use]
    pub fn from_mm([a, b, [radius, top]]: [[i32; 2]; 3]) -> Self {
        let metres = |mm: i32| mm as f32 * 1e-3;
        Self {
            a_m: Vec2::from(a.map(metres)),
            b_m: Vec2::from(b.map(metres)),
            radius_m: metres(radius),
            top_m: metres(top),
        }
    }

    /// From the nearest place of its segment to a place.
    fn out_to(&self, at_m: Vec2) -> Vec2 {
        let (axis, from_a) = (self.b_m - self.a_m, at_m - self.a_m);
        let square = axis.norm_squared();
        let share = if square > 0.0 { within(from_a.dot(&axis) / square, 0.0, 1.0) } else { 0.0 };
        from_a - axis * share
    }

    /// From its radius to a place, metres; below zero within it.
    #[must_use]
    pub fn room_m(&self, at_m: Vec2) -> f32 {
        self.out_to(at_m).norm() - self.radius_m
    }

    /// Whether its segment meets the ray eastwards from a place: of a border, an odd number of walls do from within.
    #[inline(never)]
    #[must_use]
    pub fn is_east_of(&self, at_m: Vec2) -> bool {
        let (a, b) = (self.a_m, self.b_m);
        (a.y > at_m.y) != (b.y > at_m.y) && at_m.x < a.x + (at_m.y - a.y) / (b.y - a.y) * (b.x - a.x)
    }
}

/// The half-plane of velocities from which `own` can brake `keep_m` before the wall; none where it is above the wall,
/// or so far away that no velocity it may soon have is too fast.
///
/// The closing speed is at most `sqrt(2 a room)`; within `keep_m` it is below zero: the drone parts.
#[must_use]
pub fn row(own: &Mover, wall: &Wall, keep_m: f32) -> Option<HalfPlane> {
    if own.pos_enu_m.z >= wall.top_m + keep_m {
        return None;
    }
    let soon_mps = own.vel_enu_mps.norm() + SPEED_UP_MPS;
    let reach_m = soon_mps * soon_mps / (2.0 * BRAKE_MPS2) + wall.radius_m + keep_m;
    let at_m = own.pos_enu_m.xy();
    // Most walls are far away on one of the axes already.
    let is_beyond = |at: f32, a: f32, b: f32| at < lesser(a, b) - reach_m || at > greater(a, b) + reach_m;
    if is_beyond(at_m.x, wall.a_m.x, wall.b_m.x) || is_beyond(at_m.y, wall.a_m.y, wall.b_m.y) {
        return None;
    }
    let (axis, square) = (wall.b_m - wall.a_m, (wall.b_m - wall.a_m).norm_squared());
    let out = wall.out_to(at_m);
    let distance_m = out.norm();
    let room_m = distance_m - wall.radius_m - keep_m;
    let near = 2.0 * BRAKE_MPS2 * room_m < soon_mps * soon_mps;
    // A distance that is no number is none to brake for.
    if !near || !distance_m.is_finite() {
        return None;
    }
    let normal = if distance_m > 1e-3 {
        out / distance_m
    } else if square > 0.0 {
        Vec2::new(-axis.y, axis.x) / libm::sqrtf(square)
    } else {
        Vec2::x()
    };
    let at_least = if room_m > 0.0 {
        -libm::sqrtf(2.0 * BRAKE_MPS2 * room_m)
    } else {
        lesser(-PART_GAIN_PER_S * room_m, PART_MPS)
    };
    Some(HalfPlane { normal: Vec3::new(normal.x, normal.y, 0.0), at_least })
}

/// The rows of the nearest walls.
pub fn rows(own: &Mover, walls: impl Iterator<Item = Wall>, keep_m: f32) -> Vec<HalfPlane, MAX_WALL_ROWS> {
    let mut rows: Vec<HalfPlane, MAX_WALL_ROWS> = Vec::new();
    for found in walls.filter_map(|wall| row(own, &wall, keep_m)) {
        let Err(found) = rows.push(found) else { continue };
        // The nearer the wall, the more its row asks for.
        let least = rows.iter_mut().reduce(|a, b| if b.at_least < a.at_least { b } else { a });
        if let Some(least) = least.filter(|least| least.at_least < found.at_least) {
            *least = found;
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::limited;
    use proptest::prelude::*;

    const KEEP_M: f32 = 2.5;

    fn wall(a: [f32; 2], b: [f32; 2], radius_m: f32) -> Wall {
        Wall { a_m: Vec2::from(a), b_m: Vec2::from(b), radius_m, top_m: 100.0 }
    }

    fn mover(pos: [f32; 3], vel: [f32; 3]) -> Mover {
        Mover { pos_enu_m: Vec3::from(pos), vel_enu_mps: Vec3::from(vel) }
    }

    fn room_m(wall: &Wall, pos: &Vec3) -> f32 {
        let (axis, from_a) = (wall.b_m - wall.a_m, pos.xy() - wall.a_m);
        let share =
            if axis.norm() > 0.0 { within(from_a.dot(&axis) / axis.norm_squared(), 0.0, 1.0) } else { 0.0 };
        (from_a - axis * share).norm() - wall.radius_m
    }

    #[test]
    fn truth_of_the_room_before_a_wall() {
        let wall = wall([0.0, -50.0], [0.0, 50.0], 1.0);
        for (at, room) in [([4.0, 0.0], 3.0), ([-4.0, 50.0], 3.0), ([3.0, 54.0], 4.0), ([0.5, 0.0], -0.5)] {
            assert!((wall.room_m(Vec2::from(at)) - room).abs() < 1e-5, "{at:?}");
            assert_eq!(wall.is_east_of(Vec2::from(at)), at[0] < 0.0 && at[1] < 50.0, "{at:?}");
        }
    }

    #[test]
    fn truth_of_a_straight_approach() {
        let wall = wall([0.0, -50.0], [0.0, 50.0], 1.0);
        let row = row(&mover([19.5, 0.0, 30.0], [-10.0, 0.0, 0.0]), &wall, KEEP_M).unwrap();
        assert_eq!(row.normal, Vec3::x());
        assert!((row.at_least + 8.0).abs() < 1e-5, "8 m/s need 16 m at 2 m/s2: {row:?}");
        assert!(super::row(&mover([0.0, 0.0, 102.6], [0.0; 3]), &wall, KEEP_M).is_none(), "above it");
        assert!(
            super::row(&mover([90.0, 0.0, 10.0], [-10.0, 0.0, 0.0]), &wall, KEEP_M).is_none(),
            "far away"
        );
        let inside = super::row(&mover([-2.0, 0.0, 10.0], [0.0; 3]), &wall, KEEP_M).unwrap();
        assert_eq!(inside, HalfPlane { normal: -Vec3::x(), at_least: 1.5 }, "too near");
    }

    #[test]
    fn the_nearest_walls_are_kept() {
        let far_to_near = (1..=20).rev().map(|x| wall([x as f32, 0.0], [x as f32, 0.0], 0.1));
        let own = mover([0.0, 0.0, 10.0], [10.0, 0.0, 0.0]);
        let found = rows(&own, far_to_near, 0.0);
        let least = found.iter().map(|row| row.at_least).fold(f32::INFINITY, lesser);
        assert_eq!(found.len(), MAX_WALL_ROWS);
        assert!((least + libm::sqrtf(2.0 * BRAKE_MPS2 * 7.9)).abs() < 1e-4, "that of the eighth: {least}");
    }

    proptest! {
        #[test]
        fn any_input_gives_finite_rows(pos: [f32; 3], vel: [f32; 3], mm: [[i32; 2]; 3], keep in -100.0f32..100.0) {
            prop_assume!(pos.iter().chain(&vel).all(|x| x.is_finite()));
            for pos in [pos, pos.map(|x| x % 1e3), [mm[0][0] as f32 * 1e-3, mm[0][1] as f32 * 1e-3, 0.0]] {
                if let Some(row) = row(&mover(pos, vel), &Wall::from_mm(mm), keep) {
                    prop_assert!(row.at_least.is_finite() && (row.normal.norm() - 1.0).abs() < 1e-3, "{row:?}");
                }
            }
        }

        /// Turned and moved, the world has the same rows turned.
        #[test]
        fn rigid_motions_change_nothing(pos in prop::array::uniform3(-60.0f32..60.0), vel in prop::array::uniform3(-10.0f32..10.0),
                                        ends in prop::array::uniform4(-60.0f32..60.0), angle in -3.0f32..3.0, shift in prop::array::uniform2(-90.0f32..90.0)) {
            let (sin, cos) = libm::sincosf(angle);
            let turn = |v: Vec2| Vec2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos);
            let turn3 = |v: Vec3| { let t = turn(v.xy()); Vec3::new(t.x, t.y, v.z) };
            let shift = Vec2::from(shift);
            let here = wall([ends[0], ends[1]], [ends[2], ends[3]], 3.0);
            let there = Wall { a_m: turn(here.a_m) + shift, b_m: turn(here.b_m) + shift, ..here };
            let own = mover(pos, vel);
            prop_assume!(room_m(&here, &own.pos_enu_m) > -2.5); // not on the segment, where any side is as good
            let moved = Mover { pos_enu_m: turn3(own.pos_enu_m) + Vec3::new(shift.x, shift.y, 0.0), vel_enu_mps: turn3(own.vel_enu_mps) };
            let (a, b) = (row(&own, &here, KEEP_M), row(&moved, &there, KEEP_M));
            if let (Some(a), Some(b)) = (a, b) {
                prop_assert!((turn3(a.normal) - b.normal).norm() < 2e-3 && (a.at_least - b.at_least).abs() < 2e-2, "{a:?} {b:?}");
            }
        }

        /// A point that obeys, accelerating by 3 m/s2 at most, never gets within what is to be kept, wherever it
        /// would rather go.
        #[test]
        fn whoever_obeys_keeps_away(start in prop::array::uniform2(-80.0f32..80.0), ends in prop::array::uniform4(-40.0f32..40.0),
                                    goals in prop::collection::vec(prop::array::uniform2(-60.0f32..60.0), 1..6), radius in 0.0f32..20.0) {
            let wall = wall([ends[0], ends[1]], [ends[2], ends[3]], radius);
            let mut own = mover([start[0], start[1], 20.0], [0.0; 3]);
            prop_assume!(room_m(&wall, &own.pos_enu_m) > KEEP_M);
            for step in 0..3_000usize {
                let goal = Vec2::from(goals[step / 600 % goals.len()]);
                let way = goal - own.pos_enu_m.xy();
                let wanted = limited(Vec3::new(way.x, way.y, 0.0), 10.0);
                // What is wanted first, at 1 m/s2, and then what the wall asks for.
                let mut v = own.vel_enu_mps + limited(wanted - own.vel_enu_mps, 0.02);
                if let Some(row) = row(&own, &wall, KEEP_M) {
                    v += row.normal * greater(row.at_least - row.normal.dot(&v), 0.0);
                }
                own.vel_enu_mps += limited(v - own.vel_enu_mps, 0.06);
                own.pos_enu_m += own.vel_enu_mps * crate::STEP_S;
                prop_assert!(room_m(&wall, &own.pos_enu_m) > KEEP_M - 0.2, "step {step}: {own:?}");
            }
        }
    }
}
