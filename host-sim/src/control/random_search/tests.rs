use super::*;
use crate::rng::{self, Stream};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use skyroost_protocol::{
    codec::{MAX_FRAME, Message, Sender, decode},
    message::{AckStatus, Down, Manner, SharedState},
    units::{CommandId, VelEnuMmps},
};

const NOW: TimePs = TimePs::from_ms(100_000);
const BRAKE_M: f64 = 42.0;

fn later(ms: i64) -> TimePs {
    NOW.after(TimePs::from_ms(ms))
}

/// Up and searching since a while: place and velocity of each drone, which is the one that it was told.
fn searching(side_m: f64, drones: &[([f64; 2], [f64; 2])]) -> RandomSearch<ChaCha8Rng> {
    let plan = SearchPlan {
        starts_m: drones.iter().map(|(at, _)| V2::from(*at)).collect(),
        ground: Ground { side_m: V2::repeat(side_m), radius_m: 500.0, speed_mps: 10.0 },
        altitude_m: 100.0,
        d_safe_m: 10.0,
        vertical: Vertical::default(),
        relay_period: TimePs::from_ms(100),
        link_bytes_per_s: 0,
        keys: LinkKeys::none(),
        accel_mps2: 3.0,
        delay_s: 0.9,
        brake_m: BRAKE_M,
    };
    let mut search = RandomSearch::new(plan, rng::stream(7, Stream::Search, 0));
    (search.stage, search.stage_since) = (Stage::Search, TimePs(0));
    for (index, (at_m, velocity_mps)) in drones.iter().enumerate() {
        search.told[index].velocity_mps = V2::from(*velocity_mps);
        is_at(&mut search, index, NOW, *at_m, *velocity_mps);
    }
    search
}

fn is_at<R>(search: &mut RandomSearch<R>, drone: usize, time: TimePs, at_m: [f64; 2], v_mps: [f64; 2]) {
    let [x, y] = at_m.map(|m| (m * 1e3).round() as i32);
    let [vx, vy] = v_mps.map(|mps| (mps * 1e3).round() as i16);
    search.drones[drone].state = Some(SharedState {
        time,
        pos: PosEnuMm([x, y, 100_000]),
        vel: VelEnuMmps([vx, vy, 0]),
        error_radius_mm: 2_000,
        manner: Manner::ALONE,
    });
}

/// Drones that were told something new at the last decision.
fn told(search: &RandomSearch<ChaCha8Rng>, at: TimePs) -> Vec<usize> {
    (0..search.told.len()).filter(|&drone| search.told[drone].at == at).collect()
}

fn leg(search: &RandomSearch<ChaCha8Rng>, drone: usize) -> Leg {
    search.legs[drone].expect("it searches")
}

#[test]
fn two_that_meet_turn_away_from_each_other_and_nobody_else_turns() {
    let drones = |gap_m: f64| {
        [
            ([3000.0, 3000.0], [10.0, 0.0]),
            ([9000.0, 9000.0], [0.0, 10.0]),
            ([4000.0 + gap_m, 3000.0], [-10.0, 0.0]),
        ]
    };
    // Nearer than a turn can wait for another second, at 20 m/s.
    let mut search = searching(20_000.0, &drones(100.0));
    assert!((search.plan.ahead_s() - 5.23).abs() < 0.01);
    search.decide(NOW);
    assert_eq!(told(&search, NOW), [0, 2]);
    let (a, b) = (leg(&search, 0), leg(&search, 2));
    assert!(a.apart(&b, seconds(NOW)).closing() >= 0.0);
    for leg in [a, b] {
        assert!((leg.velocity_mps.norm() - 10.0).abs() < 1e-9);
    }
    let mut search = searching(20_000.0, &drones(110.0));
    search.decide(NOW);
    assert_eq!(told(&search, NOW), [] as [usize; 0]);
}

#[test]
fn at_the_border_one_turns_inward_and_its_goal_lies_beyond_the_other_end() {
    let mut search = searching(10_000.0, &[([540.0, 3000.0], [-10.0, 0.0]), ([5000.0, 5000.0], [0.0, 10.0])]);
    search.decide(NOW);
    assert_eq!(told(&search, NOW), [0]);
    assert!(search.told[0].velocity_mps.x > 0.0);
    let goal_m = places(&mut search, NOW)[0];
    let ground = search.plan.ground;
    let out_m = (ground.low_m() - goal_m).max().max((goal_m - ground.high_m()).max());
    assert!(out_m > 0.0 && out_m <= BRAKE_M + 1e-3, "{out_m} m beyond the border");
    assert!(((goal_m - ground.within(goal_m)).norm() - BRAKE_M).abs() < BRAKE_M);
}

/// Borders on two sides and disks on the two others: it stays for a second, until the others have gone.
#[test]
fn a_drone_that_is_wedged_in_stays_until_there_is_a_way_out() {
    let still = [0.0, 0.0];
    let mut search =
        searching(10_000.0, &[([500.0, 500.0], still), ([1500.0, 500.0], still), ([500.0, 1500.0], still)]);
    search.decide(NOW);
    assert_eq!(told(&search, NOW), [0, 1, 2]);
    assert_eq!(search.told[0].velocity_mps, V2::zeros());
    assert!((places(&mut search, NOW)[0] - V2::new(500.0, 500.0)).norm() < 1e-3, "it stays where it is");
    assert!([1, 2].iter().all(|&other| search.told[other].velocity_mps.norm() > 9.0));
    let next = later(1_000);
    is_at(&mut search, 1, next, [2500.0, 900.0], [10.0, 0.0]);
    is_at(&mut search, 2, next, [900.0, 2500.0], [0.0, 10.0]);
    search.decide(next);
    assert!(search.told[0].velocity_mps.norm() > 9.0 && search.told[0].at == next);
}

/// Goals in frames that go out at a time, in order.
fn places(search: &mut RandomSearch<ChaCha8Rng>, now: TimePs) -> Vec<V2> {
    let mut goals_m = Vec::new();
    search.decide_due = TimePs(i64::MAX);
    let mut send = |_: DroneId, frame: &[u8]| {
        if let Ok((_, Message::Down(Down::Command { command: Command::Place { target }, .. }))) =
            decode(frame)
        {
            goals_m.push(pos_m(&target).xy());
        }
    };
    search.step(now, &mut send).unwrap();
    goals_m
}

fn says(search: &mut RandomSearch<ChaCha8Rng>, sender: &mut Sender, now: TimePs, message: &Up) {
    let mut frame = [0; MAX_FRAME];
    let length = sender.encode_into(message, &mut frame).unwrap();
    search.receive(now, DroneId(1), &frame[..length], &mut |_, _| {}).unwrap();
}

#[test]
fn a_heading_is_repeated_until_it_is_acknowledged() {
    let mut search = searching(10_000.0, &[([540.0, 3000.0], [-10.0, 0.0])]);
    search.decide(NOW);
    let goal_m = places(&mut search, NOW);
    assert_eq!(goal_m.len(), 1);
    assert_eq!(places(&mut search, later(500)), [] as [V2; 0]);
    assert_eq!(places(&mut search, later(600)), goal_m);
    // Meanwhile nobody knows when it turns: it is counted on no earlier than if it were told now.
    let line = search.leg_as_told(0, later(600)).unwrap();
    assert!((line.since_s - (seconds(later(600)) + search.plan.delay_s)).abs() < 1e-9);
    let mut sender = Sender::new(DroneId(1), 1);
    let ack = Up::CommandAck { command: CommandId(1), status: AckStatus::Accepted };
    says(&mut search, &mut sender, later(700), &ack);
    assert_eq!(places(&mut search, later(1_300)), [] as [V2; 0]);
    let line = search.leg_as_told(0, later(1_300)).unwrap();
    assert!((line.since_s - (seconds(NOW) + search.plan.delay_s)).abs() < 1e-9);
}

#[test]
fn a_drone_that_goes_home_searches_no_more_and_its_disk_is_nobodys_business() {
    let pair = [([3000.0, 3000.0], [10.0, 0.0]), ([4080.0, 3000.0], [-10.0, 0.0])];
    let home = Up::Event { code: EventCode::PhaseEntered, time: NOW, value: FlightPhase::ReturnHome as u32 };
    let refused = Up::CommandAck { command: CommandId(1), status: AckStatus::WrongPhase };
    for message in [home, refused] {
        let mut search = searching(10_000.0, &pair);
        search.decide(NOW);
        assert_eq!(told(&search, NOW), [0, 1]);
        places(&mut search, NOW);
        says(&mut search, &mut Sender::new(DroneId(1), 1), NOW, &message);
        assert!(!search.searches(0) && search.searches(1));
        is_at(&mut search, 0, later(1_000), [3000.0, 3000.0], [10.0, 0.0]);
        is_at(&mut search, 1, later(1_000), [4080.0, 3000.0], [-10.0, 0.0]);
        search.told[1].velocity_mps = V2::new(-10.0, 0.0);
        search.decide(later(1_000));
        assert_eq!(told(&search, later(1_000)), [] as [usize; 0]);
    }
}

#[test]
fn a_drone_that_falls_silent_searches_again_once_it_is_heard() {
    let mut search = searching(10_000.0, &[([3000.0, 3000.0], [10.0, 0.0])]);
    let mut sender = Sender::new(DroneId(1), 1);
    let state = |search: &RandomSearch<ChaCha8Rng>, time| {
        Up::SharedState(SharedState { time, ..search.drones[0].state.unwrap() })
    };
    for (heard, now, searches) in [
        (Some(NOW), NOW, true),
        (None, later(1_400), true),
        (None, later(1_600), false),
        (Some(later(1_700)), later(1_700), true),
    ] {
        if let Some(time) = heard {
            let state = state(&search, time);
            says(&mut search, &mut sender, now, &state);
        }
        places(&mut search, now);
        assert_eq!(search.searches(0), searches, "{now:?}");
    }
}

#[test]
fn drones_that_do_not_answer_are_named() {
    let mut search = searching(10_000.0, &[([3000.0, 3000.0], [0.0, 0.0])]);
    search.stage = Stage::Connect;
    let error = search.step(later(100_000), &mut |_, _| {}).unwrap_err();
    assert!(error.to_string().contains("did not end within 120 s: drone 1 None"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// However crowded: after a decision nobody meets anything before a turn told a second later would help, but for
    /// those that have no way out and stay.
    #[test]
    fn a_decision_leaves_nobody_about_to_meet(seed in any::<u64>(), count in 1..9_usize, side_m in 2000.0..8000.0_f64) {
        let mut rng = rng::stream(seed, Stream::Faults, 0);
        let ground = Ground { side_m: V2::repeat(side_m), radius_m: 500.0, speed_mps: 10.0 };
        let starts_m = ground.starts(count, 0.0, &mut rng);
        let drones: Vec<_> =
            starts_m.iter().map(|at| ([at.x, at.y], ground.heading_mps(&mut rng).into())).collect();
        let mut search = searching(side_m, &drones);
        search.decide(NOW);
        let until_s = seconds(NOW) + search.plan.ahead_s();
        let moves = |drone: &usize| search.told[*drone].velocity_mps != V2::zeros();
        for a in (0..count).filter(moves) {
            prop_assert!(leg(&search, a).border_s(&ground) > until_s);
            for b in (0..a).filter(moves) {
                prop_assert!(leg(&search, a).meets_s(&leg(&search, b), seconds(NOW), &ground) > until_s);
            }
        }
    }
}
