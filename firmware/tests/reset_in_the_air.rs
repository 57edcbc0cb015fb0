//! A board that is reset in the air keeps flying, keeps its distance, and is taken back by an upload.
#![allow(missing_docs)]

mod common;

use common::{Bench, FLEET, ME, header};
use proptest::{collection::vec, prelude::*};
use skyroost_firmware::{
    STEP_S, Vec3,
    agent::FlightAgent,
    config::AgentConfig,
    io::{Inputs, NavFix},
};
use skyroost_protocol::{
    codec::{Message, decode},
    message::{
        AckStatus, Command, Down, EventCode, FlightPhase, Manner, MissionHeader, PeerState, SharedState, Up,
    },
    units::{DroneId, MissionId, PosEnuMm, VelEnuMmps},
};

const MISSION: MissionId = MissionId(1);
const LANES_MM: [[i32; 2]; 2] = [[0, 0], [400_000, 0]];
/// An hour into the mission: whatever counts from its epoch has long run out.
const STEP_OF_RESET: i64 = 180_000;

/// A drone that was just reset, at this place and velocity.
fn reset_at(pos_enu_m: Vec3, vel_enu_mps: Vec3) -> Bench {
    let mut bench = Bench::new();
    bench.step = STEP_OF_RESET;
    bench.pos_enu_m = pos_enu_m;
    bench.outputs.setpoint.vel_enu_mps = vel_enu_mps;
    bench.inputs.in_air = true;
    bench
}

fn aloft() -> Bench {
    reset_at(Vec3::new(100.0, 50.0, 60.0), Vec3::zeros())
}

fn phases_entered(bench: &Bench) -> Vec<u32> {
    let entered = bench.outputs.uplink.iter().filter_map(|frame| match decode(frame) {
        Ok((_, Message::Up(Up::Event { code: EventCode::PhaseEntered, value, .. }))) => Some(value),
        _ => None,
    });
    entered.collect()
}

/// Flies on in touch with the control center.
fn in_touch(bench: &mut Bench, seconds: f32) {
    for _ in 0..(seconds / STEP_S) as usize {
        bench.tell(&Down::Heartbeat);
        bench.fly();
        assert!(bench.outputs.setpoint.motors, "at {} m", bench.pos_enu_m.z);
    }
}

/// Flies on alone, feeling the ground at `ground_m`, until the motors stop; returns after how long.
fn until_down(bench: &mut Bench, ground_m: f32, mut sense: impl FnMut(&mut Inputs)) -> f32 {
    for step in 0..20_000 {
        bench.inputs.in_air = bench.pos_enu_m.z > ground_m;
        bench.fly_sensing(&mut sense);
        if !bench.outputs.setpoint.motors {
            return step as f32 * STEP_S;
        }
    }
    panic!("{:?} at {}", bench.agent.phase(), bench.pos_enu_m);
}

#[test]
fn it_holds_where_it_is() {
    let mut bench = reset_at(Vec3::new(100.0, 50.0, 60.0), Vec3::new(8.0, 0.0, 0.0));
    bench.fly();
    assert_eq!(phases_entered(&bench), [FlightPhase::Hold as u32]);
    assert!(bench.outputs.setpoint.motors);
    let slowed_mps = bench.outputs.setpoint.vel_enu_mps.x;
    assert!((7.9..8.0).contains(&slowed_mps), "gently: {slowed_mps}");
    in_touch(&mut bench, 30.0);
    assert!((bench.pos_enu_m - Vec3::new(100.0, 50.0, 60.0)).norm() < 0.5, "{}", bench.pos_enu_m);
    assert_eq!(bench.agent.phase(), FlightPhase::Hold);
}

#[test]
fn on_the_ground_it_stays_there_whatever_is_said_later() {
    let mut bench = Bench::new();
    bench.fly();
    bench.inputs.in_air = true;
    bench.fly();
    assert!(!bench.outputs.setpoint.motors);
    assert_eq!(bench.agent.phase(), FlightPhase::Grounded);
}

#[test]
fn nothing_is_settled_before_the_autopilot_says_something() {
    let mut bench = aloft();
    bench.inputs.in_air = false;
    bench.fly_sensing(|inputs| inputs.nav = None);
    assert!(!bench.outputs.setpoint.motors);
    bench.inputs.in_air = true;
    bench.fly();
    assert_eq!(bench.agent.phase(), FlightPhase::Hold);
}

#[test]
fn without_a_fix_it_stands_and_then_sinks_until_the_ground() {
    let blind = |inputs: &mut Inputs| inputs.nav = None;
    let mut bench = aloft();
    let start_m = bench.pos_enu_m;
    for _ in 0..490 {
        bench.tell(&Down::Heartbeat);
        bench.fly_sensing(blind);
        assert!(bench.outputs.setpoint.motors);
    }
    assert_eq!((bench.agent.phase(), bench.pos_enu_m), (FlightPhase::Hold, start_m));
    let down_s = until_down(&mut bench, 0.0, blind);
    assert!((60.0..61.0).contains(&down_s), "60 m at 1 m/s: {down_s}");
}

#[test]
fn where_it_is_counts_from_the_first_fix() {
    let mut bench = aloft();
    for _ in 0..100 {
        bench.fly_sensing(|inputs| inputs.nav = None);
    }
    bench.pos_enu_m += Vec3::new(0.0, 7.0, 0.0);
    let seen_at_m = bench.pos_enu_m;
    in_touch(&mut bench, 10.0);
    assert!((bench.pos_enu_m - seen_at_m).norm() < 0.1, "{}", bench.pos_enu_m);
}

#[test]
fn it_lands_here_when_the_link_is_gone_and_stays_down() {
    let mut bench = aloft();
    let start_m = bench.pos_enu_m;
    // On a hill: no mission says how high the ground is.
    let down_s = until_down(&mut bench, 20.0, |_| {});
    // A minute of silence, and 40 m at 1.5 m/s.
    assert!((86.0..88.0).contains(&down_s), "{down_s}");
    assert!((bench.pos_enu_m - start_m).xy().norm() < 0.5 && bench.pos_enu_m.z > 19.0);
    assert_eq!(phases_entered(&bench), [FlightPhase::Grounded as u32]);
    // The autopilot changes its mind.
    bench.inputs.in_air = true;
    for _ in 0..100 {
        bench.fly();
        assert!(!bench.outputs.setpoint.motors);
    }
}

#[test]
fn it_goes_where_it_is_told_without_a_mission_but_not_home() {
    let mut bench = aloft();
    in_touch(&mut bench, 1.0);
    let target = PosEnuMm([300_000, 50_000, 60_000]);
    assert_eq!(bench.command(Command::Place { target }), AckStatus::Accepted);
    in_touch(&mut bench, 8.0);
    let fastest_mps = bench.outputs.setpoint.vel_enu_mps.norm();
    let limit_mps = AgentConfig::new(ME).limits.max_speed_mps;
    assert!((fastest_mps - limit_mps).abs() < 0.1, "{fastest_mps}");
    in_touch(&mut bench, 30.0);
    assert_eq!(bench.agent.phase(), FlightPhase::Serve);
    assert_eq!(bench.command(Command::Hold), AckStatus::Accepted);
    for refused in [Command::ReturnHome, Command::StartSweep { at: bench.now() }, Command::TakeOff] {
        assert_eq!(bench.command(refused), AckStatus::WrongPhase);
    }
    in_touch(&mut bench, 1.0);
    assert!((bench.pos_enu_m - Vec3::new(300.0, 50.0, 60.0)).norm() < 1.0, "{}", bench.pos_enu_m);
}

#[test]
fn an_upload_takes_it_back() {
    let mut bench = aloft();
    in_touch(&mut bench, 1.0);
    assert_eq!(bench.upload(MISSION, &LANES_MM), AckStatus::Accepted);
    assert_eq!(bench.agent.phase(), FlightPhase::Hold);
    let at = bench.now();
    assert_eq!(bench.command(Command::StartSweep { at }), AckStatus::Accepted);
    in_touch(&mut bench, 10.0);
    assert!(bench.agent.sweep_phase_um() > 0);
    assert_eq!(bench.command(Command::ReturnHome), AckStatus::Accepted);
    bench.inputs.in_air = true;
    for _ in 0..6_000 {
        bench.tell(&Down::Heartbeat);
        bench.fly();
    }
    assert_eq!(bench.agent.phase(), FlightPhase::Grounded, "{}", bench.pos_enu_m);
    assert!(bench.pos_enu_m.xy().norm() < 2.5, "home: {}", bench.pos_enu_m);
}

#[test]
fn it_keeps_clear_of_others_without_a_mission() {
    for neighbour_mps in [0.0_f32, 6.0] {
        let mut bench = aloft();
        let mut neighbour_m = Vec3::new(180.0, 50.5, 60.0);
        let mut least_m = f32::INFINITY;
        in_touch(&mut bench, 0.1);
        assert_eq!(
            bench.command(Command::Place { target: PosEnuMm([300_000, 50_000, 60_000]) }),
            AckStatus::Accepted
        );
        for step in 0..2_500 {
            neighbour_m.x -= neighbour_mps * STEP_S;
            if step % 5 == 0 {
                let state = SharedState {
                    time: bench.now(),
                    pos: PosEnuMm(neighbour_m.map(|m| (m * 1e3) as i32).into()),
                    vel: VelEnuMmps([(-1e3 * neighbour_mps) as i16, 0, 0]),
                    error_radius_mm: 1_000,
                    manner: Manner::ALONE,
                };
                bench.tell(&Down::Peers([PeerState { drone: DroneId(9), state }].into_iter().collect()));
            }
            bench.tell(&Down::Heartbeat);
            bench.fly();
            let apart_m = (bench.pos_enu_m - neighbour_m).norm();
            least_m = if apart_m < least_m { apart_m } else { least_m };
        }
        assert!(least_m > AgentConfig::new(ME).d_safe_m, "{least_m} m from one at {neighbour_mps} m/s");
        assert_eq!(bench.agent.phase(), FlightPhase::Serve, "{}", bench.pos_enu_m);
    }
}

/// What an airborne start may meet.
#[derive(Clone, Debug)]
enum Happening {
    Command(Command),
    Upload(bool),
    /// So many steps: whether there is a fix, how the charge is, whether the autopilot says that it flies, and whether the control
    /// center is heard.
    Steps(u16, bool, u16, bool, bool),
    Wild([f32; 7]),
}

fn happening() -> impl Strategy<Value = Happening> {
    let position = prop::array::uniform3(-200_000..200_000_i32);
    prop_oneof![
        1 => Just(Happening::Command(Command::TakeOff)),
        1 => Just(Happening::Command(Command::Hold)),
        1 => Just(Happening::Command(Command::ReturnHome)),
        1 => Just(Happening::Command(Command::StartSweep { at: time_of_reset() })),
        2 => position.prop_map(|p| Happening::Command(Command::Place { target: PosEnuMm(p) })),
        2 => any::<bool>().prop_map(Happening::Upload),
        6 => (1..2_000_u16, prop::bool::weighted(0.7), 0..1_000_u16, prop::bool::weighted(0.8), any::<bool>())
            .prop_map(|(n, fix, charge, in_air, heard)| Happening::Steps(n, fix, charge, in_air, heard)),
        1 => prop::array::uniform7(any::<f32>()).prop_map(Happening::Wild),
    ]
}

fn time_of_reset() -> skyroost_protocol::units::TimePs {
    skyroost_protocol::units::TimePs::from_us(STEP_OF_RESET * skyroost_firmware::STEP_US)
}

/// Whether the drone landed by itself, which is the only way to stop the motors that it has.
#[derive(Default)]
struct Watch {
    lands: bool,
    landed: bool,
    /// The step last looked at.
    step: i64,
}

impl Watch {
    fn look(&mut self, bench: &Bench) -> Result<(), TestCaseError> {
        if core::mem::replace(&mut self.step, bench.step) == bench.step {
            return Ok(());
        }
        for phase in phases_entered(bench) {
            let grounded = phase == FlightPhase::Grounded as u32;
            self.landed = grounded && self.lands;
            self.lands = phase == FlightPhase::Landing as u32;
        }
        let (phase, motors) = (bench.agent.phase(), bench.outputs.setpoint.motors);
        prop_assert_eq!(motors, !self.landed, "{:?}, in the air: {}", phase, bench.inputs.in_air);
        prop_assert_eq!(motors, phase != FlightPhase::Grounded);
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// From an airborne start on the motors run until the drone itself has landed; and while it has no mission, it lands only
    /// where the autopilot no longer says that it flies.
    #[test]
    fn motors_never_stop_in_the_air(
        first_fix: bool,
        happenings in vec(happening(), 1..24),
    ) {
        let mut bench = aloft();
        bench.fly_sensing(|inputs| if !first_fix { inputs.nav = None });
        let mut watch = Watch::default();
        watch.look(&bench)?;
        let mut has_mission = false;
        for happening in happenings {
            match happening {
                Happening::Command(command) => _ = bench.command(command),
                Happening::Upload(fleet) => {
                    let fleet_header = header(MISSION, &LANES_MM);
                    let header = if fleet {
                        fleet_header
                    } else {
                        MissionHeader { fleet: None, mates: FLEET, ..fleet_header }
                    };
                    if bench.command(Command::UploadBegin(header)) == AckStatus::Accepted {
                        watch.look(&bench)?;
                        bench.send_lanes(MISSION, &LANES_MM); // one piece, one step
                        watch.look(&bench)?;
                        let lanes_crc = skyroost_protocol::message::lanes_crc(&LANES_MM);
                        let commit = Command::UploadCommit { mission: MISSION, lanes_crc };
                        has_mission |= bench.command(commit) == AckStatus::Accepted;
                    }
                }
                Happening::Steps(steps, fix, charge, in_air, heard) => {
                    bench.inputs.in_air = in_air;
                    for _ in 0..steps {
                        if heard {
                            bench.tell(&Down::Heartbeat);
                        }
                        bench.fly_sensing(|inputs| {
                            inputs.battery_permille = charge;
                            if !fix {
                                inputs.nav = None;
                            }
                        });
                        let was_landed = watch.landed;
                        watch.look(&bench)?;
                        prop_assert!(has_mission || !in_air || watch.landed == was_landed, "landed aloft");
                    }
                }
                Happening::Wild([px, py, pz, vx, vy, vz, error_radius_m]) => bench.fly_sensing(|inputs| {
                    inputs.nav = Some(NavFix {
                        pos_enu_m: Vec3::new(px, py, pz),
                        vel_enu_mps: Vec3::new(vx, vy, vz),
                        error_radius_m,
                    });
                }),
            }
            watch.look(&bench)?;
            if !bench.pos_enu_m.iter().all(|x| x.is_finite()) {
                break;
            }
        }
    }
}

/// In the place of an agent that flew, as a board's memory keeps it.
#[test]
fn a_restart_in_place_is_a_start_as_well() {
    let mut bench = aloft();
    in_touch(&mut bench, 1.0);
    bench.agent.restart(AgentConfig::new(ME), None);
    bench.fly();
    assert!(bench.outputs.setpoint.motors);
    assert_eq!(phases_entered(&bench), [FlightPhase::Hold as u32]);
    let mut other = FlightAgent::new(AgentConfig::new(ME), None);
    other.restart(AgentConfig::new(ME), None);
    bench.agent = other;
    bench.inputs.in_air = false;
    bench.fly();
    assert!(!bench.outputs.setpoint.motors);
}
