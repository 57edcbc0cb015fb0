//! Drones that are sent home or made to land by their supervisors at the same time keep the separation.
//!
//! Whole flight codes, in touch with a control center that passes their states on a fifth of a second late; none of
//! what they do is told by it once they are under way.
#![allow(missing_docs)]

mod common;

use common::{Bench, header};
use skyroost_firmware::{
    STEP_S, Vec3,
    agent::FlightAgent,
    avoid::Vertical,
    config::AgentConfig,
    guidance::limited,
    io::NavFix,
    scalar::{greater, lesser},
};
use skyroost_protocol::{
    PROTOCOL_VERSION, SCHEMA_HASH,
    codec::{Message, decode},
    message::{
        AckStatus, Command, Down, FlightPhase, MissionHeader, PeerState, SharedState, Telemetry, Up,
        lanes_crc,
    },
    units::{DroneId, MissionId, PosEnuMm, VelEnuMmps},
};
use std::collections::VecDeque;

const MISSION: MissionId = MissionId(1);
/// A shared state is heard by others after this many steps.
const DELAY_STEPS: usize = 10;
const D_SAFE_M: f32 = 10.0;
const FULL: u16 = 900;
/// Below these the drone returns home, and lands where it is.
const LOW: u16 = 140;
const CRITICAL: u16 = 40;

struct Drone {
    bench: Bench,
    vel_mps: Vec3,
    accel_mps2: Vec3,
    battery_permille: u16,
    last: Option<SharedState>,
}

impl Drone {
    fn phase(&self) -> FlightPhase {
        self.bench.agent.phase()
    }

    /// One step of what is at the end of a velocity loop.
    fn fly(&mut self) {
        let (vel_enu_mps, pos_enu_m, charge) = (self.vel_mps, self.bench.pos_enu_m, self.battery_permille);
        self.bench.fly_sensing(|inputs| {
            inputs.nav = Some(NavFix { pos_enu_m, vel_enu_mps, error_radius_m: 2.0 });
            inputs.battery_permille = charge;
        });
        let setpoint = self.bench.outputs.setpoint;
        let demand = (setpoint.vel_enu_mps - self.vel_mps) * 1.2 + setpoint.accel_enu_mps2;
        self.accel_mps2 += (limited(demand, 3.0) - self.accel_mps2) * (STEP_S / 0.25);
        if self.phase() == FlightPhase::Grounded {
            (self.vel_mps, self.accel_mps2) = (Vec3::zeros(), Vec3::zeros());
        }
        self.bench.pos_enu_m = pos_enu_m + self.vel_mps * STEP_S;
        self.vel_mps += self.accel_mps2 * STEP_S;
    }
}

/// Drones with their own pads, all hearing of each other.
struct Sky {
    drones: Vec<Drone>,
    under_way: VecDeque<(usize, PeerState)>,
    step: usize,
    least_m: f32,
    /// The first so many drones hear of nobody, and nobody of them.
    cut_off: usize,
}

impl Sky {
    /// All at their goals, from pads on a line 20 m apart.
    fn at(goals_m: &[[f32; 3]], vertical: Vertical) -> Self {
        let drone = |index: usize| {
            let mut bench = Bench::new();
            bench.agent = FlightAgent::new(AgentConfig::new(DroneId(1 + index as u16)), None);
            let home = PosEnuMm([20_000 * index as i32, 0, 0]);
            bench.pos_enu_m = Vec3::new(20.0 * index as f32, 0.0, 0.0);
            let header = MissionHeader { fleet: None, home, vertical, ..header(MISSION, &[]) };
            assert_eq!(bench.command(Command::UploadBegin(header)), AckStatus::Accepted);
            let lanes_crc = lanes_crc(&[]);
            assert_eq!(
                bench.command(Command::UploadCommit { mission: MISSION, lanes_crc }),
                AckStatus::Accepted
            );
            assert_eq!(bench.command(Command::TakeOff), AckStatus::Accepted);
            bench.tell(&Down::Welcome {
                version: PROTOCOL_VERSION,
                schema_hash: SCHEMA_HASH,
                resumes: false,
            });
            Drone {
                bench,
                vel_mps: Vec3::zeros(),
                accel_mps2: Vec3::zeros(),
                battery_permille: FULL,
                last: None,
            }
        };
        let drones = (0..goals_m.len()).map(drone).collect();
        let mut sky =
            Self { drones, under_way: VecDeque::new(), step: 3, least_m: f32::INFINITY, cut_off: 0 };
        sky.fly_until(60.0, |drone| drone.phase() == FlightPhase::Hold);
        sky.place(goals_m);
        sky
    }

    fn fly(&mut self) {
        while let Some((_, state)) = self.under_way.pop_front_if(|(sent, _)| *sent + DELAY_STEPS <= self.step)
        {
            if usize::from(state.drone.0) <= self.cut_off {
                continue;
            }
            for drone in self.drones.iter_mut().skip(self.cut_off) {
                drone.bench.tell(&Down::Peers([state].into_iter().collect()));
            }
        }
        let airborne: Vec<bool> = self.drones.iter().map(|d| d.phase() != FlightPhase::Grounded).collect();
        for (index, drone) in self.drones.iter_mut().enumerate() {
            drone.fly();
            for frame in &drone.bench.outputs.uplink {
                match decode(frame) {
                    Ok((_, Message::Up(Up::SharedState(state)))) => drone.last = Some(state),
                    // On the ground nothing is shared; the control center tells that it stands there.
                    Ok((
                        _,
                        Message::Up(Up::Telemetry(Telemetry { phase: FlightPhase::Grounded, time, .. })),
                    )) => {
                        let landed = |state| SharedState { time, vel: VelEnuMmps([0; 3]), ..state };
                        drone.last = drone.last.map(landed);
                    }
                    _ => continue,
                }
                let heard = drone.last.map(|state| PeerState { drone: DroneId(1 + index as u16), state });
                self.under_way.extend(heard.map(|heard| (self.step, heard)));
            }
        }
        for (a, first) in self.drones.iter().enumerate() {
            for (b, second) in self.drones.iter().enumerate().take(a) {
                if airborne[a] || airborne[b] {
                    let apart_m = (first.bench.pos_enu_m - second.bench.pos_enu_m).norm();
                    self.least_m = lesser(self.least_m, apart_m);
                }
            }
        }
        self.step += 1;
    }

    /// Sends every drone to a goal.
    fn place(&mut self, goals_m: &[[f32; 3]]) {
        for (drone, goal_m) in self.drones.iter_mut().zip(goals_m) {
            let target = PosEnuMm(goal_m.map(|m| (m * 1e3) as i32));
            assert_eq!(drone.bench.command(Command::Place { target }), AckStatus::Accepted);
        }
        self.step += 1;
    }

    #[track_caller]
    fn fly_until(&mut self, within_s: f32, done: impl Fn(&Drone) -> bool) {
        for _ in 0..(within_s / STEP_S) as usize {
            if self.drones.iter().all(&done) {
                return;
            }
            self.fly();
        }
        let at: Vec<_> = self.drones.iter().map(|d| (d.phase(), d.bench.pos_enu_m)).collect();
        panic!("not after {within_s} s: {at:?}");
    }

    fn fly_for(&mut self, seconds: f32) {
        (0..(seconds / STEP_S) as usize).for_each(|_| self.fly());
    }

    fn serve(&mut self) {
        self.fly_until(150.0, |drone| drone.phase() == FlightPhase::Serve);
    }

    #[track_caller]
    fn comes_down(&mut self, what: &str) {
        self.fly_until(400.0, |drone| drone.phase() == FlightPhase::Grounded);
        assert!(self.least_m >= D_SAFE_M, "{what}: {} m", self.least_m);
    }
}

/// Around the middle of the pads, so that ways home cross; every other one on the other side.
fn circle(drones: usize, radius_m: f32) -> Vec<[f32; 3]> {
    let middle_m = 10.0 * (drones - 1) as f32;
    let place = |index: usize| {
        let angle = std::f32::consts::TAU * (index * 5 % drones) as f32 / drones as f32 + 0.4;
        {
            let (sin, cos) = libm::sincosf(angle);
            [middle_m + radius_m * cos, radius_m * sin, 50.0]
        }
    };
    (0..drones).map(place).collect()
}

#[test]
fn all_are_sent_home_at_once() {
    for vertical in [Vertical::Preferred, Vertical::Free] {
        for drones in [2, 4, 7] {
            let mut sky = Sky::at(&circle(drones, 150.0), vertical);
            sky.serve();
            sky.drones.iter_mut().for_each(|drone| drone.battery_permille = LOW);
            sky.comes_down(&format!("{drones} drones, {vertical:?}"));
            let off_m = |(index, drone): (usize, &Drone)| {
                (drone.bench.pos_enu_m - Vec3::new(20.0 * index as f32, 0.0, 0.0)).xy().norm()
            };
            let worst_m = sky.drones.iter().enumerate().map(off_m).fold(0.0, greater);
            assert!(worst_m < 2.0, "{worst_m} m off the pad");
        }
    }
}

#[test]
fn all_land_at_once_where_they_meet() {
    for drones in [2, 4, 7] {
        let mut sky = Sky::at(&circle(drones, 150.0), Vertical::Preferred);
        sky.serve();
        sky.drones.iter_mut().for_each(|drone| drone.battery_permille = LOW);
        sky.fly_for(14.0); // all on their way home
        sky.drones.iter_mut().for_each(|drone| drone.battery_permille = CRITICAL);
        sky.comes_down(&format!("{drones} drones"));
    }
}

#[test]
fn some_land_while_others_fly_home_through_them() {
    let mut sky = Sky::at(&circle(7, 150.0), Vertical::Preferred);
    sky.serve();
    sky.drones.iter_mut().for_each(|drone| drone.battery_permille = LOW);
    sky.fly_for(8.0);
    for index in [1, 4] {
        sky.drones[index].battery_permille = CRITICAL;
        sky.fly_for(4.0);
    }
    sky.comes_down("two of seven land on the way");
}

#[test]
fn who_lands_from_above_comes_down_past_those_below() {
    for vertical in [Vertical::Preferred, Vertical::Free] {
        for (what, goals_m) in [
            ("right above", vec![[60.0, 80.0, 90.0], [60.0, 80.0, 50.0]]),
            ("a little aside", vec![[63.0, 80.0, 90.0], [60.0, 80.0, 50.0]]),
            ("above two", vec![[60.0, 80.0, 110.0], [60.0, 80.0, 80.0], [60.0, 80.0, 50.0]]),
        ] {
            let mut sky = Sky::at(&goals_m, vertical);
            sky.serve();
            sky.drones[0].battery_permille = CRITICAL;
            sky.fly_for(200.0);
            let phases: Vec<FlightPhase> = sky.drones.iter().map(Drone::phase).collect();
            assert_eq!(phases[0], FlightPhase::Grounded, "{what}: {}", sky.drones[0].bench.pos_enu_m);
            assert!(phases[1..].iter().all(|phase| *phase == FlightPhase::Serve), "{what}: {phases:?}");
            assert!(sky.least_m >= D_SAFE_M, "{what}, {vertical:?}: {} m", sky.least_m);
        }
    }
}

#[test]
fn all_of_a_stack_land_at_once() {
    let mut sky =
        Sky::at(&[[60.0, 80.0, 110.0], [60.0, 80.0, 80.0], [60.0, 80.0, 50.0]], Vertical::Preferred);
    sky.serve();
    sky.drones.iter_mut().for_each(|drone| drone.battery_permille = CRITICAL);
    sky.comes_down("a stack");
}

/// While all cross the same place the control center dies, at any moment and for any time, or some lose their link: who hears of nobody
/// stops, and waits until it does.
#[test]
fn nobody_crosses_the_others_ways_unheard() {
    const ALL: usize = 7;
    for (radius_m, begins_s) in [(60.0, 0..9), (100.0, 3..13), (150.0, 6..16)] {
        for begun_s in begins_s {
            for (cut_off, silent_s) in [(ALL, 3.0), (ALL, 5.0), (ALL, 8.0), (ALL, 20.0), (1, 5.0), (3, 8.0)] {
                let mut goals_m = circle(ALL, radius_m);
                let mut sky = Sky::at(&goals_m, Vertical::Preferred);
                sky.serve();
                // To the other side, all through the middle.
                goals_m.iter_mut().for_each(|[x, y, _]| (*x, *y) = (120.0 - *x, -*y));
                sky.place(&goals_m);
                sky.fly_for(begun_s as f32);
                sky.cut_off = cut_off;
                sky.fly_for(silent_s);
                sky.cut_off = 0;
                sky.fly_for(60.0); // by when but for a pair that stands above each other all have arrived
                let least_m = sky.least_m;
                assert!(
                    least_m >= D_SAFE_M,
                    "{cut_off} cut off for {silent_s} s from {begun_s} s on, {radius_m} m around: {least_m} m"
                );
            }
        }
    }
}

/// A drone that its own supervisor sends home does not wait for a control center.
#[test]
fn who_has_to_come_home_does_not_wait() {
    let mut sky = Sky::at(&[[10.0, 300.0, 50.0]], Vertical::Preferred);
    sky.fly_for(15.0);
    sky.cut_off = 1;
    sky.fly_for(20.0);
    let waits_at_m = sky.drones[0].bench.pos_enu_m;
    assert_eq!(sky.drones[0].phase(), FlightPhase::GoTo);
    assert!(sky.drones[0].vel_mps.norm() < 0.5, "it waits");
    sky.drones[0].battery_permille = LOW;
    sky.fly_for(10.0);
    assert_eq!(sky.drones[0].phase(), FlightPhase::ReturnHome);
    assert!((sky.drones[0].bench.pos_enu_m - waits_at_m).norm() > 20.0, "it flies");
    sky.comes_down("low");
}
