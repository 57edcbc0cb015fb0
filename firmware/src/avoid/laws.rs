//! Laws that avoidance as a whole obeys, for any neighbours.

use super::{Avoided, Rule, Separation, Vertical, avoid, pca::Mover};
use crate::{
    Vec3, ZERO,
    counters::Counters,
    peers::{MAX_PEERS, PeerTable},
};
use proptest::prelude::*;
use skyroost_protocol::{
    message::{Manner, PeerState, SharedState},
    units::{DroneId, PosEnuMm, TimePs, VelEnuMmps},
};

const MAX_SPEED_MPS: f32 = 10.0;
const USUAL: Separation = Separation {
    d_safe_m: 10.0,
    own_error_m: 2.0,
    max_speed_mps: MAX_SPEED_MPS,
    vertical: Vertical::Free,
    manner: Manner::ALONE,
    arm_m: ZERO,
    waits: false,
};

/// A neighbour's state, rounded as on the wire.
fn told(drone: usize, mover: &Mover) -> PeerState {
    let state = SharedState {
        time: TimePs(0),
        pos: PosEnuMm(mover.pos_enu_m.map(|m| libm::roundf(m * 1e3) as i32).into()),
        vel: VelEnuMmps(mover.vel_enu_mps.map(|mps| libm::roundf(mps * 1e3) as i16).into()),
        error_radius_mm: 2_000,
        manner: Manner::ALONE,
    };
    PeerState { drone: DroneId(drone as u16 + 1), state }
}

fn answer(own: &Mover, wanted: Vec3, others: &[Mover], rule: Rule) -> Avoided {
    let (mut peers, mut counters) = (PeerTable::new(), Counters::new());
    for (index, other) in others.iter().enumerate() {
        peers.update(&told(index, other), &own.pos_enu_m, &mut counters);
    }
    avoid(TimePs(0), own, wanted, &peers, core::iter::empty(), &USUAL, rule)
}

fn command(own: &Mover, wanted: Vec3, others: &[Mover]) -> Vec3 {
    answer(own, wanted, others, Rule::HalfPlanes).vel_enu_mps
}

/// Sides are chosen, turns are tried one after the other: there the answer jumps, and roundings decide. The laws are
/// held where a millimetre decides nothing.
fn decided(own: &Mover, wanted: Vec3, others: &[Mover]) -> bool {
    let here = command(own, wanted, others);
    [Vec3::x(), -Vec3::x(), Vec3::y(), -Vec3::y(), Vec3::z(), -Vec3::z()].iter().all(|way| {
        let beside =
            Mover { pos_enu_m: own.pos_enu_m + way * 3e-3, vel_enu_mps: own.vel_enu_mps + way * 3e-3 };
        (command(&beside, wanted, others) - here).norm() < 0.05
    })
}

fn vector(most: f32) -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-most..most).prop_map(Vec3::from)
}

fn mover() -> impl Strategy<Value = Mover> {
    (vector(60.0), vector(6.0)).prop_map(|(pos_enu_m, vel_enu_mps)| Mover { pos_enu_m, vel_enu_mps })
}

/// Anything that a number can be but infinite or none: zeros, tiny, huge.
fn finite() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(prop_oneof![
        Just(0.0f32),
        -20.0f32..20.0,
        any::<f32>().prop_filter("finite", |x| x.is_finite())
    ])
    .prop_map(Vec3::from)
}

proptest! {
    /// Turned about the vertical and shifted, the answer turns with it.
    #[test]
    fn the_answer_follows_rigid_motions(own in mover(), wanted in vector(5.0), others in prop::collection::vec(mover(), 0..6),
                                        angle in -3.0f32..3.0, shift in vector(500.0)) {
        let (sin, cos) = libm::sincosf(angle);
        let turned = |v: &Vec3| Vec3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z);
        let moved = |m: &Mover| Mover { pos_enu_m: turned(&m.pos_enu_m) + shift, vel_enu_mps: turned(&m.vel_enu_mps) };
        prop_assume!(decided(&own, wanted, &others));
        let here = command(&own, wanted, &others);
        let there = command(&moved(&own), turned(&wanted), &others.iter().map(moved).collect::<Vec<_>>());
        prop_assert!((turned(&here) - there).norm() < 0.1, "{} {}", turned(&here), there);
    }

    /// Two that see each other as in a mirror point do opposite things, so that what one does helps the other.
    #[test]
    fn a_pair_does_opposite_things(own in mover(), wanted in vector(5.0)) {
        let opposite = |m: &Mover| Mover { pos_enu_m: -m.pos_enu_m, vel_enu_mps: -m.vel_enu_mps };
        let other = opposite(&own);
        prop_assume!(decided(&own, wanted, &[other]));
        let (of_a, of_b) = (command(&own, wanted, &[other]), command(&other, -wanted, &[own]));
        prop_assert!((of_a + of_b).norm() < 0.1, "{} {}", of_a, of_b);
    }

    /// Coincident, at rest, head-on, or beyond all bounds: there is an answer, and it is not too fast.
    #[test]
    fn the_answer_is_finite_and_within_the_speed(pos in finite(), vel in finite(), wanted in finite(),
                                                 others in prop::collection::vec(mover(), 0..8), on_one: bool, standing: bool) {
        let own = Mover { pos_enu_m: pos, vel_enu_mps: vel };
        let alike = others.iter().map(|other| Mover {
            pos_enu_m: if on_one && pos.norm() < 1e5 { pos } else { other.pos_enu_m },
            vel_enu_mps: if standing { Vec3::zeros() } else { other.vel_enu_mps },
        });
        let others: Vec<Mover> = alike.collect();
        for rule in [Rule::HalfPlanes, Rule::LiteralPca] {
            let found = answer(&own, wanted, &others, rule);
            prop_assert!(found.vel_enu_mps.iter().all(|x| x.is_finite()), "{:?}", found);
            prop_assert!(!found.active || found.vel_enu_mps.norm() <= MAX_SPEED_MPS * 1.001
                || found.vel_enu_mps.norm() <= wanted.norm() * 1.001, "{:?}", found);
        }
    }

    /// Neighbours may be heard in any order.
    #[test]
    fn the_order_of_neighbours_does_not_matter(own in mover(), wanted in vector(5.0),
                                               others in prop::collection::vec(mover(), 2..8), turn in 1usize..7) {
        let mut shuffled = others.clone();
        shuffled.rotate_left(turn % others.len());
        shuffled.reverse();
        let (one, other) = (command(&own, wanted, &others), command(&own, wanted, &shuffled));
        prop_assert!((one - other).norm() < 1e-4, "{} {}", one, other);
    }
}

#[test]
fn the_most_neighbours_are_all_regarded() {
    // All but one far away; the one ahead, heard last, is avoided.
    let own = Mover { pos_enu_m: Vec3::zeros(), vel_enu_mps: Vec3::new(8.0, 0.0, 0.0) };
    let far =
        |i: usize| Mover { pos_enu_m: Vec3::new(-200.0, 20.0 * i as f32, 0.0), vel_enu_mps: Vec3::zeros() };
    let mut others: Vec<Mover> = (0..MAX_PEERS - 1).map(far).collect();
    assert!(!answer(&own, own.vel_enu_mps, &others, Rule::HalfPlanes).active);
    others.push(Mover { pos_enu_m: Vec3::new(40.0, 0.0, 0.0), vel_enu_mps: Vec3::zeros() });
    assert!(answer(&own, own.vel_enu_mps, &others, Rule::HalfPlanes).active);
}
