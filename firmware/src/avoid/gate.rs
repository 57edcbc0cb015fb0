//! The stop gate: a velocity passes if, were both drones of every pair to brake straight from now on, they would
//! come to rest without coming too close.
//!
//! Half-planes look at the closest approach of steady flight; the gate looks at what happens when plans change. As long
//! as everybody's velocity passes, everybody can stop, whatever the others do next, and standing drones keep apart.
//! A velocity that does not pass is turned and slowed until it does.

use super::{halfplanes::HalfPlane, pca::Mover};
use crate::{
    Vec3,
    scalar::{greater, lesser, within},
};

/// Braking that is counted on, metres a second squared: below what the airframe can do.
const BRAKE_MPS2: f32 = 2.6;
/// Metres of separation more for every metre a second of both: what the velocity loop takes to turn round, and what a
/// state that is 0.2 s old does not say.
const PER_SPEED_S: f32 = 0.1;
/// Pieces into which braking paths are cut.
const PIECES: u8 = 6;
/// Below this relative speed along the line of sight two drones do not approach, metres a second.
const APART_MPS: f32 = 0.0;

/// Turned and slowed velocities to try, as shares along the wanted one and to its left: the nearest to it first.
const TRIES: [(f32, f32); 24] = [
    (1.0, 0.0),
    (0.966, 0.259),
    (0.966, -0.259),
    (0.7, 0.0),
    (0.866, 0.5),
    (0.866, -0.5),
    (0.606, 0.35),
    (0.606, -0.35),
    (0.4, 0.0),
    (0.643, 0.766),
    (0.643, -0.766),
    (0.35, 0.606),
    (0.35, -0.606),
    (0.15, 0.0),
    (0.342, 0.94),
    (0.342, -0.94),
    (0.0, 0.7),
    (0.0, -0.7),
    (0.0, 0.4),
    (0.0, -0.4),
    (-0.1, 0.99),
    (-0.1, -0.99),
    (-0.5, 0.5),
    (-0.5, -0.5),
];

/// A neighbour and the distance to keep from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Neighbour {
    /// Where it is and how it moves.
    pub mover: Mover,
    /// Least distance of both at rest, metres.
    pub keep_m: f32,
}

/// The velocity nearest to `wanted` among the turns and speeds that pass, or the one with the most room if none does.
///
/// None is turned towards one of the `walls` more than its row allows, or than `wanted` is already.
#[must_use]
pub fn passing(own: &Mover, wanted: Vec3, neighbours: &[Neighbour], walls: &[HalfPlane]) -> Vec3 {
    let free =
        |v: &Vec3| walls.iter().all(|row| row.normal.dot(v) >= lesser(row.at_least, row.normal.dot(&wanted)));
    let mut best = (f32::NEG_INFINITY, wanted);
    for (along, left) in TRIES {
        let v = Vec3::new(along * wanted.x - left * wanted.y, left * wanted.x + along * wanted.y, wanted.z);
        if !free(&v) {
            continue;
        }
        let room_m = room_m(own, &v, neighbours);
        if room_m >= 0.0 {
            return v;
        }
        if room_m > best.0 {
            best = (room_m, v);
        }
    }
    let stop = Vec3::zeros();
    if room_m(own, &stop, neighbours) > best.0 { stop } else { best.1 }
}

/// The least room to any neighbour beyond what is to be kept, if this drone had velocity `v` and all braked; metres.
fn room_m(own: &Mover, v: &Vec3, neighbours: &[Neighbour]) -> f32 {
    let mut least = f32::INFINITY;
    for neighbour in neighbours {
        let other = &neighbour.mover;
        let l = own.pos_enu_m - other.pos_enu_m;
        let distance_m = l.norm();
        if l.dot(&(v - other.vel_enu_mps)) >= APART_MPS * distance_m {
            continue;
        }
        let (speed, other_speed) = (v.norm(), other.vel_enu_mps.norm());
        let keep_m = neighbour.keep_m + PER_SPEED_S * (speed + other_speed);
        let ways_m = (speed * speed + other_speed * other_speed) * (0.5 / BRAKE_MPS2);
        if distance_m - ways_m >= keep_m {
            continue;
        }
        least = lesser(least, closest_m(&l, v, &other.vel_enu_mps) - keep_m);
    }
    least
}

/// Least distance of two that brake straight from a relative position.
fn closest_m(l: &Vec3, v: &Vec3, w: &Vec3) -> f32 {
    let (speed, other_speed) = (v.norm(), w.norm());
    let (stop_s, other_stop_s) = (speed / BRAKE_MPS2, other_speed / BRAKE_MPS2);
    let piece_s = greater(stop_s, other_stop_s) / f32::from(PIECES);
    // Way after a time as a multiple of the velocity: t - t^2 / 2 T until it stops at T.
    let way = |t: f32, stop_s: f32| {
        let t = lesser(t, stop_s);
        if stop_s > 0.0 { t - 0.5 * t * t / stop_s } else { 0.0 }
    };
    let mut from = *l;
    let mut least = l.norm_squared();
    for piece in 1..=PIECES {
        let t = piece_s * f32::from(piece);
        let to = l + v * way(t, stop_s) - w * way(t, other_stop_s);
        let step = to - from;
        let square = step.norm_squared();
        let share = if square > 0.0 { within(-from.dot(&step) / square, 0.0, 1.0) } else { 0.0 };
        least = lesser(least, (from + step * share).norm_squared());
        from = to;
    }
    libm::sqrtf(least)
}
