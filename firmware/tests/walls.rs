//! Walls come with the mission, stand until another one is announced, and are never met.
#![allow(missing_docs)]

mod common;

use common::{Bench, header};
use skyroost_firmware::{Vec3, scalar::lesser};
use skyroost_protocol::{
    message::{AckStatus, Command, Down, FlightPhase, MissionHeader, lanes_crc},
    units::{MissionId, PosEnuMm},
};

const MISSION: MissionId = MissionId(1);
const TALL_MM: i32 = 200_000;

/// A reserve holds above its pad, and walls stand.
fn reserve(walls_mm: &[[i32; 2]]) -> Bench {
    let mut bench = Bench::new();
    assert_eq!(upload(&mut bench, walls_mm, walls_mm.len() as u16 / 3), AckStatus::Accepted);
    bench.take_off();
    assert_eq!(bench.agent.phase(), FlightPhase::Hold);
    bench
}

fn upload(bench: &mut Bench, points_mm: &[[i32; 2]], walls: u16) -> AckStatus {
    let header = MissionHeader { fleet: None, walls, ..header(MISSION, points_mm) };
    match bench.command(Command::UploadBegin(header)) {
        AckStatus::Accepted => {}
        refused => return refused,
    }
    bench.send_lanes(MISSION, points_mm);
    bench.command(Command::UploadCommit { mission: MISSION, lanes_crc: lanes_crc(points_mm) })
}

/// Sends the drone there and watches it for so long; its least distance from a place on the way, metres.
fn least_m(bench: &mut Bench, to_mm: [i32; 2], from: impl Fn(&Vec3) -> f32) -> f32 {
    let target = PosEnuMm([to_mm[0], to_mm[1], 50_000]);
    assert_eq!(bench.command(Command::Place { target }), AckStatus::Accepted);
    let mut least = f32::INFINITY;
    for _ in 0..6_000 {
        bench.tell(&Down::Heartbeat);
        bench.fly();
        least = lesser(least, from(&bench.pos_enu_m));
    }
    least
}

#[test]
fn a_mast_in_the_way_is_flown_around() {
    let mut bench = reserve(&[[100_000, 0], [100_000, 0], [5_000, TALL_MM]]);
    let mast = |at: &Vec3| (at - Vec3::new(100.0, 0.0, at.z)).norm() - 5.0;
    let least = least_m(&mut bench, [200_000, 1_000], mast);
    // The error radius of 1 m and what avoidance plans with besides.
    assert!((1.4..3.0).contains(&least), "{least} m from the mast");
    assert_eq!(bench.agent.phase(), FlightPhase::Serve, "it arrived, at {}", bench.pos_enu_m);
}

#[test]
fn a_fence_is_never_left() {
    let mut bench = reserve(&[[60_000, -500_000], [60_000, 500_000], [0, i32::MAX]]);
    let inside = |at: &Vec3| 60.0 - at.x;
    let least = least_m(&mut bench, [100_000, 40_000], inside);
    assert!((1.3..2.0).contains(&least), "{least} m within");
    assert!((bench.pos_enu_m.y - 40.0).abs() < 1.0, "as near as can be: {}", bench.pos_enu_m);
}

#[test]
fn what_is_low_is_flown_over() {
    let mut bench = reserve(&[[60_000, -500_000], [60_000, 500_000], [0, 40_000]]);
    least_m(&mut bench, [100_000, 0], |_| 0.0);
    assert_eq!(bench.agent.phase(), FlightPhase::Serve);
}

#[test]
fn walls_without_their_waypoints_are_refused() {
    let mut bench = Bench::new();
    let points_mm = [[0, 0]; 8];
    assert_eq!(upload(&mut bench, &points_mm, 3), AckStatus::OutOfRange);
    assert_eq!(upload(&mut bench, &points_mm, u16::MAX), AckStatus::OutOfRange);
    assert_eq!(upload(&mut bench, &points_mm, 2), AckStatus::Accepted);
}

#[test]
fn lanes_end_before_the_walls() {
    let lanes_mm = [[0, 0], [300_000, 0], [900_000, 900_000], [900_000, 900_000], [1_000, TALL_MM]];
    let lanes = |points_mm: &[[i32; 2]], walls| {
        let mut lanes = skyroost_firmware::guidance::lanes::Lanes::empty();
        lanes.open(points_mm.len(), walls).unwrap();
        lanes.write(0, points_mm);
        lanes.lay(10.0, f32::INFINITY).unwrap();
        lanes
    };
    let mut walled = lanes(&lanes_mm, 1);
    assert_eq!(walled.length_um(), lanes(&lanes_mm[..2], 0).length_um());
    assert_eq!(walled.walls().count(), 0, "not before all has arrived");
    walled.raise_walls();
    assert_eq!(walled.walls().count(), 1);
}
