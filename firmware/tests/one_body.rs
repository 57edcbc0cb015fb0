//! A fleet in formation gives way as one body: it passes others in its triangle and comes back to its lane.
#![allow(missing_docs)]

use skyroost_firmware::{
    STEP_S, Vec2, Vec3,
    avoid::{self, Rule, Separation, Vertical, pca::Mover},
    counters::Counters,
    guidance::{formation::Slot, lanes::TrackPoint, limited, steadying, track},
    io::NavFix,
    peers::PeerTable,
    scalar::{greater, lesser},
};
use skyroost_protocol::{
    message::{Heading, Manner, PeerState, SharedState},
    units::{DroneId, FleetId, PosEnuMm, TimePs, VelEnuMmps},
};
use std::{collections::VecDeque, f32::consts::FRAC_PI_2};

const SIDE_M: f32 = 50.0;
const ALTITUDE_M: f32 = 100.0;
/// A shared state is heard by others after this many steps, and shared every so many.
const DELAY_STEPS: usize = 10;
const SHARE_STEPS: usize = 5;

/// A fleet on a straight lane.
#[derive(Clone, Copy)]
struct Fleet {
    from_m: Vec2,
    vel_mps: Vec2,
    first_id: u16,
}

impl Fleet {
    fn id(&self) -> FleetId {
        FleetId(self.first_id)
    }

    fn track(&self, t_s: f32) -> TrackPoint {
        TrackPoint {
            pos_m: self.from_m + self.vel_mps * t_s,
            along: self.vel_mps.normalize(),
            curvature_per_m: 0.0,
            speed_limit_mps: 10.0,
        }
    }
}

/// Whoever flies: in a fleet by slot, or straight on by itself, avoiding nobody.
#[derive(Clone, Copy)]
enum Pilot {
    Member(Fleet, u8),
    Intruder(Vec3),
}

struct Drone {
    id: DroneId,
    pilot: Pilot,
    body: Mover,
    peers: PeerTable,
}

struct Sky {
    drones: Vec<Drone>,
    under_way: VecDeque<(usize, PeerState)>,
    step: usize,
}

impl Sky {
    fn new(fleets: &[Fleet], intruders: &[(Vec3, Vec3)]) -> Self {
        let member = |fleet: Fleet, slot: u8| {
            let place = slot_of(slot).reference(&fleet.track(0.0), fleet.vel_mps.norm(), 0.0, ALTITUDE_M);
            Drone {
                id: DroneId(fleet.first_id + u16::from(slot)),
                pilot: Pilot::Member(fleet, slot),
                body: Mover { pos_enu_m: place.pos_enu_m, vel_enu_mps: place.vel_enu_mps },
                peers: PeerTable::new(),
            }
        };
        let intruder = |(index, &(pos_enu_m, vel_enu_mps)): (usize, &(Vec3, Vec3))| Drone {
            id: DroneId(100 + index as u16),
            pilot: Pilot::Intruder(vel_enu_mps),
            body: Mover { pos_enu_m, vel_enu_mps },
            peers: PeerTable::new(),
        };
        let members = fleets.iter().flat_map(|&fleet| (0..3).map(move |slot| member(fleet, slot)));
        Self {
            drones: members.chain(intruders.iter().enumerate().map(intruder)).collect(),
            under_way: VecDeque::new(),
            step: 0,
        }
    }

    fn fly_a_step(&mut self) {
        let now = TimePs::from_ms(20 * self.step as i64);
        if self.step.is_multiple_of(SHARE_STEPS) {
            self.under_way.extend(self.drones.iter().map(|drone| (self.step, told(now, drone))));
        }
        let delay = if self.step == 0 { 0 } else { DELAY_STEPS };
        while let Some((_, state)) = self.under_way.pop_front_if(|(sent, _)| *sent + delay <= self.step) {
            for drone in self.drones.iter_mut().filter(|drone| drone.id != state.drone) {
                drone.peers.update(&state, &drone.body.pos_enu_m, &mut Counters::new());
            }
        }
        let t_s = self.step as f32 * STEP_S;
        for drone in &mut self.drones {
            let (vel_mps, accel_mps2) = command(drone, now, t_s);
            let body = &mut drone.body;
            let accel = limited((vel_mps - body.vel_enu_mps) * 1.2 + accel_mps2, 3.0);
            body.pos_enu_m += body.vel_enu_mps * STEP_S + accel * (0.5 * STEP_S * STEP_S);
            body.vel_enu_mps += accel * STEP_S;
        }
        self.step += 1;
    }

    fn at(&self, index: usize) -> Vec3 {
        self.drones[index].body.pos_enu_m
    }

    fn least_m(&self) -> f32 {
        let pairs = (0..self.drones.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        pairs.map(|(a, b)| (self.at(a) - self.at(b)).norm()).fold(f32::INFINITY, lesser)
    }

    /// By how much the worst side of the fleet whose first drone this is differs from the triangle's.
    fn bent_m(&self, first: usize) -> f32 {
        let sides = [(0, 1), (1, 2), (2, 0)];
        let side_m = |(a, b): (usize, usize)| (self.at(first + a) - self.at(first + b)).norm();
        sides.map(|pair| (side_m(pair) - SIDE_M).abs()).into_iter().fold(0.0, greater)
    }

    /// How far the worst drone of the fleet is off its slot.
    fn off_m(&self, first: usize) -> f32 {
        let t_s = self.step as f32 * STEP_S;
        let off = |drone: &Drone| match drone.pilot {
            Pilot::Member(fleet, slot) => {
                let place = slot_of(slot).reference(&fleet.track(t_s), fleet.vel_mps.norm(), 0.0, ALTITUDE_M);
                (place.pos_enu_m - drone.body.pos_enu_m).norm()
            }
            Pilot::Intruder(_) => 0.0,
        };
        self.drones[first..first + 3].iter().map(off).fold(0.0, greater)
    }
}

fn slot_of(slot: u8) -> Slot {
    Slot::new(slot, SIDE_M, FRAC_PI_2, Heading::Fixed)
}

fn told(time: TimePs, drone: &Drone) -> PeerState {
    let manner = match drone.pilot {
        Pilot::Member(fleet, _) => Manner::formation(fleet.id()),
        Pilot::Intruder(_) => Manner::ALONE,
    };
    let state = SharedState {
        time,
        pos: PosEnuMm(drone.body.pos_enu_m.map(|m| (m * 1e3) as i32).into()),
        vel: VelEnuMmps(drone.body.vel_enu_mps.map(|mps| (mps * 1e3) as i16).into()),
        error_radius_mm: 2_000,
        manner,
    };
    PeerState { drone: drone.id, state }
}

fn command(drone: &Drone, now: TimePs, t_s: f32) -> (Vec3, Vec3) {
    let (fleet, slot) = match drone.pilot {
        Pilot::Member(fleet, slot) => (fleet, slot),
        Pilot::Intruder(vel_mps) => return (vel_mps, Vec3::zeros()),
    };
    let point = fleet.track(t_s);
    let place = slot_of(slot).reference(&point, fleet.vel_mps.norm(), 0.0, ALTITUDE_M);
    let Mover { pos_enu_m, vel_enu_mps } = drone.body;
    let nav = NavFix { pos_enu_m, vel_enu_mps, error_radius_m: 2.0 };
    let separation = Separation {
        d_safe_m: 10.0,
        own_error_m: 2.0,
        max_speed_mps: 12.0,
        vertical: Vertical::Level,
        manner: Manner::formation(fleet.id()),
        arm_m: (place.pos_enu_m.xy() - point.pos_m).push(0.0),
        waits: false,
    };
    let wanted = track(&nav, &place);
    let nobody = core::iter::empty();
    let avoided = avoid::avoid(now, &drone.body, wanted, &drone.peers, nobody, &separation, Rule::HalfPlanes);
    let accel = if avoided.active { Vec3::zeros() } else { steadying(&nav, &place) };
    (avoided.vel_enu_mps, accel)
}

/// Flies for so long; the least separation and the most that a fleet was bent, metres.
fn watch(sky: &mut Sky, fleets: usize, seconds: f32) -> (f32, f32) {
    let (mut least_m, mut bent_m) = (f32::INFINITY, 0.0_f32);
    for _ in 0..(seconds / STEP_S) as usize {
        sky.fly_a_step();
        least_m = lesser(least_m, sky.least_m());
        bent_m = (0..fleets).map(|fleet| sky.bent_m(3 * fleet)).fold(bent_m, greater);
    }
    (least_m, bent_m)
}

const EASTWARDS: Fleet = Fleet { from_m: Vec2::new(0.0, 0.0), vel_mps: Vec2::new(8.0, 0.0), first_id: 1 };

fn level(x: f32, y: f32) -> Vec3 {
    Vec3::new(x, y, ALTITUDE_M)
}

#[test]
fn the_triangle_passes_whoever_does_not_give_way_as_one() {
    let cases = [
        ("head-on", level(400.0, 0.0), Vec3::new(-8.0, 0.0, 0.0)),
        ("head-on at a slot", level(400.0, 25.0), Vec3::new(-8.0, 0.0, 0.0)),
        ("hovering on the lane", level(300.0, 5.0), Vec3::zeros()),
        ("crossing", level(240.0, 240.0), Vec3::new(0.0, -8.0, 0.0)),
        ("overtaking", level(-150.0, 3.0), Vec3::new(11.0, 0.0, 0.0)),
    ];
    for (name, from_m, vel_mps) in cases {
        let mut sky = Sky::new(&[EASTWARDS], &[(from_m, vel_mps)]);
        let (least_m, bent_m) = watch(&mut sky, 1, 120.0);
        assert!(least_m >= 10.0, "{name}: {least_m} m");
        assert!(bent_m <= 5.0, "{name}: the triangle was bent by {bent_m} m");
        assert!(sky.off_m(0) < 1.0, "{name}: back to {} m", sky.off_m(0));
    }
}

#[test]
fn two_fleets_meet_and_both_keep_their_triangles() {
    for (north_m, vel_mps) in [(0.0, [-8.0, 0.0]), (40.0, [-8.0, 0.0]), (-60.0, [-6.0, 3.0])] {
        let from_m = Vec2::new(500.0, north_m);
        let other = Fleet { from_m, vel_mps: Vec2::from(vel_mps), first_id: 11 };
        let mut sky = Sky::new(&[EASTWARDS, other], &[]);
        let (least_m, bent_m) = watch(&mut sky, 2, 150.0);
        assert!(least_m >= 10.0, "{north_m} m: {least_m} m");
        assert!(bent_m <= 5.0, "{north_m} m: a triangle was bent by {bent_m} m");
        assert!(sky.off_m(0) < 1.0 && sky.off_m(3) < 1.0, "{north_m} m: {} {}", sky.off_m(0), sky.off_m(3));
    }
}

#[test]
fn whoever_is_within_the_triangle_is_avoided_by_each() {
    // Comes down through the middle, slowly; the triangle is no solid body.
    let mut sky = Sky::new(&[EASTWARDS], &[(level(0.0, 0.0) + Vec3::z() * 40.0, Vec3::new(8.0, 0.0, -1.0))]);
    let (least_m, _) = watch(&mut sky, 1, 100.0);
    assert!(least_m >= 10.0, "{least_m} m");
}
