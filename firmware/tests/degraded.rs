//! What the supervisor is told of a flight that goes wrong, and what the drone then does.
#![allow(missing_docs)]

mod common;

use common::{Bench, header};
use skyroost_firmware::{
    Vec3,
    io::{Inputs, NavFix},
    supervisor::Condition,
};
use skyroost_protocol::{
    codec::{Message, decode},
    message::{
        AckStatus, Command, Down, EventCode, FlightPhase, MissionHeader, SrsRequest, SrsRequestEntry, Up,
        lanes_crc,
    },
    units::{MissionId, OccasionId, PosEnuMm, UserId},
};

const MISSION: MissionId = MissionId(1);
const BACK_AND_FORTH_MM: [[i32; 2]; 2] = [[0, 0], [2_000_000, 0]];

/// What a drone said of its conditions, with the seconds since it was first asked.
#[derive(Default)]
struct Told {
    steps: u32,
    events: Vec<(f32, Condition, bool)>,
}

impl Told {
    /// Flies on for so long, in touch with the control center.
    fn fly(&mut self, bench: &mut Bench, seconds: f32, mut sense: impl FnMut(&mut Inputs)) {
        for _ in 0..(seconds * 50.0) as u32 {
            bench.tell(&Down::Heartbeat);
            bench.fly_sensing(&mut sense);
            self.steps += 1;
            for frame in &bench.outputs.uplink {
                if let Ok((_, Message::Up(Up::Event { code, value, .. }))) = decode(frame)
                    && matches!(code, EventCode::ConditionRaised | EventCode::ConditionCleared)
                {
                    let condition = Condition::numbered(value).expect("a condition");
                    let at_s = self.steps as f32 * 0.02;
                    self.events.push((at_s, condition, code == EventCode::ConditionRaised));
                }
            }
        }
    }

    /// Whether it said these, each within so many seconds of when it should.
    #[track_caller]
    fn expect(&self, expected: &[(f32, Condition, bool)], within_s: f32) {
        let is_near = |(found, expected): (&(f32, Condition, bool), &(f32, Condition, bool))| {
            (found.0 - expected.0).abs() <= within_s && (found.1, found.2) == (expected.1, expected.2)
        };
        let all = self.events.len() == expected.len() && self.events.iter().zip(expected).all(is_near);
        assert!(all, "found {:?}, expected {expected:?}", self.events);
    }
}

/// Holds at 50 m with this mission.
fn in_the_air(header: MissionHeader, points_mm: &[[i32; 2]]) -> Bench {
    let mut bench = Bench::new();
    assert_eq!(bench.command(Command::UploadBegin(header)), AckStatus::Accepted);
    bench.send_lanes(MISSION, points_mm);
    let lanes_crc = lanes_crc(points_mm);
    assert_eq!(bench.command(Command::UploadCommit { mission: MISSION, lanes_crc }), AckStatus::Accepted);
    bench.take_off();
    bench
}

fn reserve(walls_mm: &[[i32; 2]]) -> Bench {
    let walls = walls_mm.len() as u16 / 3;
    in_the_air(MissionHeader { fleet: None, walls, ..header(MISSION, walls_mm) }, walls_mm)
}

fn blind(inputs: &mut Inputs) {
    inputs.nav = None;
}

fn well(_: &mut Inputs) {}

#[test]
fn without_navigation_it_stands_then_sinks_and_lands_where_it_sees_again() {
    let (mut bench, mut told) = (reserve(&[]), Told::default());
    let target = PosEnuMm([400_000, 0, 50_000]);
    assert_eq!(bench.command(Command::Place { target }), AckStatus::Accepted);
    told.fly(&mut bench, 10.0, well);
    let left_at_m = bench.pos_enu_m;
    told.fly(&mut bench, 9.9, blind);
    assert!((bench.pos_enu_m - left_at_m).norm() < 0.5, "stands: {}", bench.pos_enu_m);
    told.fly(&mut bench, 20.0, blind);
    assert!((bench.pos_enu_m.z - 30.1).abs() < 0.5, "sinks at 1 m/s: {}", bench.pos_enu_m);
    assert!(bench.outputs.setpoint.motors);
    assert_eq!(bench.agent.phase(), FlightPhase::Landing);
    // The wind has blown meanwhile.
    bench.pos_enu_m += Vec3::new(30.0, 40.0, 0.0);
    let seen_at_m = bench.pos_enu_m;
    told.fly(&mut bench, 40.0, well);
    assert_eq!(bench.agent.phase(), FlightPhase::Grounded);
    assert!((bench.pos_enu_m - seen_at_m).xy().norm() < 0.5, "lands there: {}", bench.pos_enu_m);
    use Condition::{NavigationGone, NavigationLost};
    let expected = [
        (10.5, NavigationLost, true),
        (20.0, NavigationGone, true),
        (40.9, NavigationLost, false),
        (40.9, NavigationGone, false),
    ];
    told.expect(&expected, 0.1);
}

#[test]
fn low_and_blind_it_flies_home_once_it_sees() {
    let (mut bench, mut told) = (reserve(&[]), Told::default());
    told.fly(&mut bench, 2.0, blind);
    told.fly(&mut bench, 2.0, |inputs| (inputs.nav, inputs.battery_permille) = (None, 140));
    assert_eq!(bench.agent.phase(), FlightPhase::Hold, "home is not found blind");
    told.fly(&mut bench, 2.0, |inputs| inputs.battery_permille = 140);
    assert!(matches!(bench.agent.phase(), FlightPhase::ReturnHome | FlightPhase::Landing));
}

#[test]
fn a_lost_step_or_two_do_not_matter() {
    let (mut bench, mut told) = (reserve(&[]), Told::default());
    assert_eq!(bench.command(Command::Place { target: PosEnuMm([400_000, 0, 50_000]) }), AckStatus::Accepted);
    told.fly(&mut bench, 10.0, well);
    told.fly(&mut bench, 0.1, blind);
    told.fly(&mut bench, 0.1, well);
    let speed_mps = bench.outputs.setpoint.vel_enu_mps.norm();
    assert!(speed_mps > 9.0, "{speed_mps} m/s");
    told.expect(&[], 0.0);
}

#[test]
fn a_wide_error_is_told() {
    let (mut bench, mut told) = (reserve(&[]), Told::default());
    told.fly(&mut bench, 5.0, |inputs| inputs.nav.iter_mut().for_each(|nav| nav.error_radius_m = 12.0));
    told.fly(&mut bench, 10.0, well);
    use Condition::NavigationPoor;
    told.expect(&[(2.0, NavigationPoor, true), (10.0, NavigationPoor, false)], 0.1);
}

/// A fence of 200 m around the pad, and a house within.
const YARD_MM: [[i32; 2]; 24] = {
    const FENCE: [i32; 2] = [0, i32::MAX];
    const HOUSE: [i32; 2] = [0, 80_000];
    const A: [[i32; 2]; 4] =
        [[-100_000, -100_000], [100_000, -100_000], [100_000, 100_000], [-100_000, 100_000]];
    const B: [[i32; 2]; 4] = [[30_000, 30_000], [60_000, 30_000], [60_000, 60_000], [30_000, 60_000]];
    [
        A[0], A[1], FENCE, A[1], A[2], FENCE, A[2], A[3], FENCE, A[3], A[0], FENCE, //
        B[0], B[1], HOUSE, B[1], B[2], HOUSE, B[2], B[3], HOUSE, B[3], B[0], HOUSE,
    ]
};

#[test]
fn beyond_the_fence_it_holds_until_it_is_sent_home() {
    let (mut bench, mut told) = (reserve(&YARD_MM), Told::default());
    told.fly(&mut bench, 3.0, well);
    told.expect(&[], 0.0);
    // Something carries it to the fence, and then over it.
    bench.pos_enu_m = Vec3::new(97.5, 5.0, 50.0);
    told.fly(&mut bench, 0.6, well);
    bench.pos_enu_m = Vec3::new(140.0, 5.0, 50.0);
    told.fly(&mut bench, 30.0, well);
    let at_m = bench.pos_enu_m;
    assert!((at_m.x - 140.0).abs() < 8.0, "it holds: {at_m}");
    use Condition::{FenceCrossed, FenceNear};
    let expected = [(3.3, FenceNear, true), (3.9, FenceCrossed, true), (5.9, FenceNear, false)];
    told.expect(&expected, 0.35);
    assert_eq!(bench.command(Command::Place { target: PosEnuMm([300_000, 0, 50_000]) }), AckStatus::Accepted);
    told.fly(&mut bench, 20.0, well);
    assert!((bench.pos_enu_m - at_m).norm() < 4.0, "and goes nowhere else: {}", bench.pos_enu_m);
    assert_eq!(bench.command(Command::ReturnHome), AckStatus::Accepted);
    assert_eq!(bench.agent.phase(), FlightPhase::ReturnHome);
}

#[test]
fn within_a_house_is_crossed_and_above_it_is_not() {
    for (up_m, crossed) in [(50.0, true), (90.0, false)] {
        let (mut bench, mut told) = (reserve(&YARD_MM), Told::default());
        let at_m = Vec3::new(45.0, 45.0, up_m);
        for _ in 0..4 {
            bench.pos_enu_m = at_m;
            told.fly(&mut bench, 0.2, well);
        }
        assert_eq!(!told.events.is_empty(), crossed, "{up_m} m: {:?}", told.events);
    }
}

#[test]
fn wind_that_takes_what_is_flown_sends_it_home() {
    let (mut bench, mut told) = (reserve(&[]), Told::default());
    let target = PosEnuMm([8_000_000, 0, 50_000]);
    assert_eq!(bench.command(Command::Place { target }), AckStatus::Accepted);
    let against = |lacking_mps: f32| {
        move |inputs: &mut Inputs| {
            let lacking_mps = Vec3::new(lacking_mps, 0.0, 0.0);
            inputs.nav = inputs.nav.map(|nav| NavFix { vel_enu_mps: nav.vel_enu_mps - lacking_mps, ..nav });
        }
    };
    told.fly(&mut bench, 10.0, against(1.8));
    told.expect(&[], 0.0);
    told.fly(&mut bench, 1.5, against(6.0)); // a gust
    told.fly(&mut bench, 10.0, against(0.0));
    told.expect(&[], 0.0);
    told.fly(&mut bench, 10.0, against(3.0));
    assert_eq!(bench.agent.phase(), FlightPhase::GoTo);
    told.fly(&mut bench, 20.0, against(6.0));
    assert_eq!(bench.agent.phase(), FlightPhase::ReturnHome);
    use Condition::{WindBeyond, WindStrong};
    told.expect(&[(26.7, WindStrong, true), (37.3, WindBeyond, true)], 0.2);
}

#[test]
fn gates_that_capture_nothing_are_told_and_an_end_of_requests_is_not() {
    let mut bench = in_the_air(header(MISSION, &BACK_AND_FORTH_MM), &BACK_AND_FORTH_MM);
    let mut told = Told::default();
    let at = bench.now();
    assert_eq!(bench.command(Command::StartSweep { at }), AckStatus::Accepted);
    let mut occasion = 0;
    let mut listen = |told: &mut Told, bench: &mut Bench, seconds: u32| {
        for _ in 0..seconds {
            occasion += 1;
            let entries = [SrsRequestEntry { user: UserId(1), serving: common::ME }];
            bench.tell(&Down::SrsRequest(SrsRequest {
                start: bench.now().after(skyroost_protocol::units::TimePs::from_ms(200)),
                spacing: skyroost_protocol::units::TimePs(0),
                first_occasion: OccasionId(occasion),
                entries: entries.into_iter().collect(),
            }));
            told.fly(bench, 1.0, well);
        }
    };
    listen(&mut told, &mut bench, 15);
    told.fly(&mut bench, 30.0, well);
    listen(&mut told, &mut bench, 70);
    use Condition::{CapturesGone, CapturesMissed};
    told.events.retain(|(_, condition, _)| matches!(condition, CapturesGone | CapturesMissed));
    assert_eq!(bench.agent.phase(), FlightPhase::Sweep);
    told.expect(&[(65.2, CapturesMissed, true), (105.2, CapturesGone, true)], 0.2);
}
