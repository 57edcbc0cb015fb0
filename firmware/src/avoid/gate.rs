//! The stop gate: a velocity passes if, were both drones of every pair to brake straight from now on, they would
//! come to rest without coming too close.
//!
//! Half-planes give way and answer even where they contradict each other; the gate does not give way. As long as
//! everybody's velocity passes, everybody can stop, whatever the others do next, and standing drones keep apart.
//! A velocity that does not pass is turned and slowed until it does.

use super::{Neighbour, braking, halfplanes::HalfPlane, pca::Mover};
use crate::{Vec3, guidance::limited, scalar::lesser};

/// What a velocity can change until the next state of a neighbour is heard, metres a second: a velocity is judged by
/// what it makes of the present one in that time. Else turns that take a second would count as made.
pub(super) const REACHED_MPS: f32 = 1.5;

/// Turned and slowed velocities to try, as shares along the wanted one and to its left: the nearest to it first.
const TRIES: [(f32, f32); 12] = [
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
    (0.0, 0.0),
];

/// The velocity nearest to `wanted` among the turns and speeds that pass, or the one with the most room if none does.
///
/// None is turned towards one of the `walls` more than its row allows, or than `wanted` is already.
#[must_use]
pub fn passing<N: Iterator<Item = Neighbour>>(
    own: &Mover,
    wanted: Vec3,
    neighbours: impl Fn() -> N,
    walls: &[HalfPlane],
) -> Vec3 {
    let free =
        |v: &Vec3| walls.iter().all(|row| row.normal.dot(v) >= lesser(row.at_least, row.normal.dot(&wanted)));
    let mut best = (f32::NEG_INFINITY, wanted);
    for (along, left) in TRIES {
        let turned = |x: f32, y: f32| along * x - left * y;
        let share = lesser(libm::fabsf(along) + libm::fabsf(left), 1.0);
        let v = Vec3::new(turned(wanted.x, wanted.y), turned(wanted.y, -wanted.x), share * wanted.z);
        if !free(&v) {
            continue;
        }
        let room_m = room_m(own, &v, neighbours());
        if room_m >= 0.0 {
            return v;
        }
        if room_m > best.0 {
            best = (room_m, v);
        }
    }
    best.1
}

/// The least room to any neighbour beyond what is to be kept, if this drone sought velocity `v` and then all braked; metres.
fn room_m(own: &Mover, v: &Vec3, neighbours: impl Iterator<Item = Neighbour>) -> f32 {
    let reached = own.vel_enu_mps + limited(v - own.vel_enu_mps, REACHED_MPS);
    let mut least = f32::INFINITY;
    for neighbour in neighbours {
        if let Some((closest, keep_m)) = braking::meeting(own, &reached, &neighbour, 0.0) {
            least = lesser(least, closest.rel_m.norm() - keep_m);
        }
    }
    least
}
