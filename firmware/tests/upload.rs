//! Uploads share their room with the lanes that are flown: what that means for both.
#![allow(missing_docs)]

mod common;

use common::{Bench, header};
use skyroost_protocol::{
    message::{AckStatus, Command, Down, FlightPhase, LanePiece, lanes_crc},
    units::{MissionId, TimePs},
};

const FIRST: MissionId = MissionId(1);
const SECOND: MissionId = MissionId(2);

/// There and back again, `count` waypoints.
fn lanes(count: i32) -> Vec<[i32; 2]> {
    (0..count).map(|i| [1_000_000 * (i / 2 % 2), 30_000 * i]).collect()
}

fn sweeping(bench: &mut Bench, lanes_mm: &[[i32; 2]]) {
    assert_eq!(bench.upload(FIRST, lanes_mm), AckStatus::Accepted);
    bench.take_off();
    let at = bench.now();
    assert_eq!(bench.command(Command::StartSweep { at }), AckStatus::Accepted);
}

#[test]
fn the_longest_mission_is_taken_in_any_order_and_repeatedly() {
    let mut bench = Bench::new();
    let lanes_mm = lanes(512);
    let begin = Command::UploadBegin(header(FIRST, &lanes_mm));
    let commit = Command::UploadCommit { mission: FIRST, lanes_crc: lanes_crc(&lanes_mm) };
    assert_eq!(bench.command(begin.clone()), AckStatus::Accepted);
    assert_eq!(bench.command(commit.clone()), AckStatus::Incomplete { first_missing: 0 });
    for first in (0..512).step_by(16).rev().filter(|first| *first != 48) {
        let waypoints_mm = lanes_mm[first..first + 16].iter().copied().collect();
        bench.tell(&Down::LanePiece(LanePiece { mission: FIRST, first: first as u16, waypoints_mm }));
        bench.fly();
    }
    assert_eq!(bench.command(begin), AckStatus::Accepted, "the same again keeps what arrived");
    assert_eq!(bench.command(commit.clone()), AckStatus::Incomplete { first_missing: 48 });
    bench.send_lanes(FIRST, &lanes_mm);
    for _ in 0..2 {
        assert_eq!(bench.command(commit.clone()), AckStatus::Accepted);
    }
    assert_eq!(bench.agent.counters().lanes_refused, 0);
}

#[test]
fn a_mission_announced_takes_the_room_of_the_one_before() {
    let mut bench = Bench::new();
    assert_eq!(bench.upload(FIRST, &lanes(4)), AckStatus::Accepted);
    bench.take_off();
    let second = lanes(6);
    assert_eq!(bench.command(Command::UploadBegin(header(SECOND, &second))), AckStatus::Accepted);
    let start = Command::StartSweep { at: TimePs(0) };
    assert_eq!(bench.command(start.clone()), AckStatus::WrongPhase, "its lanes are gone");
    bench.send_lanes(SECOND, &second);
    let commit = Command::UploadCommit { mission: SECOND, lanes_crc: lanes_crc(&second) };
    assert_eq!(bench.command(commit), AckStatus::Accepted);
    assert_eq!(bench.command(start), AckStatus::Accepted);
}

#[test]
fn a_mission_announced_leaves_the_way_home() {
    let mut bench = Bench::new();
    assert_eq!(bench.upload(FIRST, &lanes(4)), AckStatus::Accepted);
    bench.take_off();
    assert_eq!(bench.command(Command::UploadBegin(header(SECOND, &lanes(6)))), AckStatus::Accepted);
    assert_eq!(bench.command(Command::ReturnHome), AckStatus::Accepted);
    for _ in 0..3_000 {
        bench.tell(&Down::Heartbeat);
        bench.fly();
    }
    assert_eq!(bench.agent.phase(), FlightPhase::Grounded);
}

#[test]
fn a_wrong_checksum_starts_the_upload_over() {
    let mut bench = Bench::new();
    let (lanes_mm, others) = (lanes(4), lanes(5));
    assert_eq!(bench.upload(FIRST, &lanes_mm), AckStatus::Accepted);
    let wrong = Command::UploadCommit { mission: FIRST, lanes_crc: lanes_crc(&others) };
    assert_eq!(bench.command(wrong), AckStatus::Incomplete { first_missing: 0 });
    bench.send_lanes(FIRST, &lanes_mm);
    let right = Command::UploadCommit { mission: FIRST, lanes_crc: lanes_crc(&lanes_mm) };
    assert_eq!(bench.command(right), AckStatus::Accepted);
}

/// A piece that was long under way, or another one under the number of the mission being flown, must not
/// bend the lanes under the drone.
#[test]
fn nothing_touches_lanes_that_are_flown() {
    let lanes_mm = lanes(8);
    let (mut left_alone, mut pestered) = (Bench::new(), Bench::new());
    for bench in [&mut left_alone, &mut pestered] {
        sweeping(bench, &lanes_mm);
    }
    for step in 0..2_000 {
        for bench in [&mut left_alone, &mut pestered] {
            bench.tell(&Down::Heartbeat);
        }
        if step % 10 == 0 {
            let waypoints_mm = [[-9_000_000, 4_000_000 + step]].into_iter().collect();
            pestered.tell(&Down::LanePiece(LanePiece { mission: FIRST, first: 2, waypoints_mm }));
            pestered.tell(&Down::LanePiece(LanePiece {
                mission: SECOND,
                first: 0,
                waypoints_mm: Default::default(),
            }));
        }
        left_alone.fly();
        pestered.fly();
        assert_eq!(left_alone.outputs.setpoint, pestered.outputs.setpoint);
    }
    assert_eq!(pestered.agent.phase(), FlightPhase::Sweep);
    assert_eq!(pestered.command(Command::UploadBegin(header(SECOND, &lanes_mm))), AckStatus::WrongPhase);
    assert_eq!(pestered.agent.counters().lanes_refused, 200, "those of another mission");
}
