//! A drone's link as the control center has it.

use super::*;
use crate::control::mission::simple;
use skyroost_protocol::{
    codec::{Message, decode},
    key::KEY_LEN,
    message::{Heading, Manner, Vertical},
    stream::FRAMING,
    units::MissionId,
};

fn sent(link: &mut DroneLink, ms: i64) -> Vec<Message> {
    let mut frames = Vec::new();
    link.step(TimePs::from_ms(ms), &mut |_, f| frames.push(decode(f).unwrap().1)).unwrap();
    frames
}

#[test]
fn a_command_is_repeated_until_acknowledged() {
    let mut link = DroneLink::new(DroneId(1), &LinkKeys::none(), 0);
    link.command(Command::TakeOff);
    link.command(Command::Hold);
    let first = sent(&mut link, 0);
    assert!(matches!(first[..], [Message::Down(Down::Command { id: CommandId(1), .. })]));
    assert!(sent(&mut link, 100).is_empty());
    assert_eq!(sent(&mut link, 700), first);
    link.acknowledged(TimePs(0), CommandId(1), AckStatus::Accepted, &mut |_, _| {}).unwrap();
    link.acknowledged(TimePs(0), CommandId(1), AckStatus::Accepted, &mut |_, _| {}).unwrap(); // late twin
    assert!(matches!(sent(&mut link, 720)[..], [Message::Down(Down::Command { id: CommandId(2), .. })]));
    let refused =
        link.acknowledged(TimePs(0), CommandId(2), AckStatus::WrongPhase, &mut |_, _| {}).unwrap_err();
    assert_eq!(refused.to_string(), "drone 1 refused hold: WrongPhase");
}

#[test]
fn a_silent_drone_is_given_up() {
    let mut link = DroneLink::new(DroneId(7), &LinkKeys::none(), 0);
    link.command(Command::TakeOff);
    let mut result = Ok(());
    for s in 0..100 {
        result = link.step(TimePs::from_ms(s * 1000), &mut |_, _| {});
        if result.is_err() {
            break;
        }
    }
    assert_eq!(result.unwrap_err().to_string(), "drone 7 did not answer take-off");
}

/// After how many seconds a drone counts as not getting to its goal, 500 m off: it is at `at_m` then, and tells its phase or is not heard.
fn stays_short_after(at_m: impl Fn(f64) -> f64, phase: impl Fn(i64) -> Option<FlightPhase>) -> Option<i64> {
    let mut link = DroneLink::new(DroneId(1), &LinkKeys::none(), 0);
    link.command(place_at(V2::new(500.0, 0.0), 50.0));
    assert_eq!(sent(&mut link, 0).len(), 1);
    link.acknowledged(TimePs(0), CommandId(1), AckStatus::Accepted, &mut |_, _| {}).unwrap();
    (1..=600).find(|&s| {
        let now = TimePs::from_ms(1_000 * s);
        if let Some(phase) = phase(s) {
            link.telemetry = Some(simple::telemetry(now, phase));
            let pos = PosEnuMm([(1e3 * at_m(s as f64)) as i32, 0, 50_000]);
            let vel = VelEnuMmps([1_000, 0, 0]);
            let manner = Manner::ALONE;
            link.state = Some(SharedState { time: now, pos, vel, error_radius_mm: 1_000, manner });
        }
        link.stays_short(now) == Some(V2::new(500.0, 0.0))
    })
}

#[test]
fn who_stays_on_its_way_for_a_minute_does_not_get_there() {
    let on_its_way = |_| Some(FlightPhase::GoTo);
    // Two in each other's way waver.
    assert_eq!(stays_short_after(|s| 100.0 + 2.0 * s.sin(), on_its_way), Some(61));
    assert_eq!(stays_short_after(|s| 0.1 * s, on_its_way), None, "slowly is a way as well");
    assert_eq!(stays_short_after(|_| 100.0, |_| Some(FlightPhase::Hold)), None, "it was told to");
    // On a link of which most is lost it is judged all the same, when it is heard.
    let seldom = |s| (s % 7 == 1).then_some(FlightPhase::GoTo);
    assert_eq!(stays_short_after(|_| 100.0, seldom), Some(64));
    // Who has been elsewhere begins anew.
    let held = |s| Some(if s == 30 { FlightPhase::Hold } else { FlightPhase::GoTo });
    assert_eq!(stays_short_after(|_| 100.0, held), Some(91));
}

/// A drone's end of a sealed link.
struct Sealed {
    end: LinkEnd,
}

impl Sealed {
    fn boots(epoch: u16) -> Self {
        let root = Some(Key::new([7; KEY_LEN]));
        Self { end: LinkEnd::new(DroneId(1), epoch, DroneId::CONTROL, root) }
    }

    fn seals(&mut self, message: &Up) -> Vec<u8> {
        let mut frame = [0; MAX_FRAME];
        let length = self.end.encode_into(message, &mut frame).unwrap();
        frame[..length].to_vec()
    }

    /// Says hello to `link` at `ms` and hears the answer; what it said.
    fn meets(&mut self, link: &mut DroneLink, ms: i64) -> Vec<u8> {
        let hello = self.seals(&Up::Hello {
            version_min: MIN_PROTOCOL_VERSION,
            version_max: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            capture_ticks: 1,
            capture_ps: 1,
        });
        let mut answers = Vec::new();
        link.hear(TimePs::from_ms(ms), &hello, &mut |_, frame| answers.push(frame.to_vec())).unwrap();
        let mut room = ROOM;
        let opened = self.end.open(&answers[0], &mut room).unwrap();
        assert!(matches!(decode_body(opened.body), Ok(Down::Welcome { resumes: false, .. })));
        hello
    }

    fn tells(&mut self, link: &mut DroneLink, ms: i64) {
        let telemetry = self.seals(&Up::Telemetry(simple::telemetry(TimePs::from_ms(ms), FlightPhase::Hold)));
        link.hear(TimePs::from_ms(ms), &telemetry, &mut |_, _| {}).unwrap();
    }
}

fn sealed_keys() -> LinkKeys {
    LinkKeys::new(vec![Key::new([7; KEY_LEN])], 1, &Key::new([9; KEY_LEN]))
}

#[test]
fn a_sealed_drone_is_connected_once_it_speaks_to_this_boot() {
    let (mut link, mut drone) = (DroneLink::new(DroneId(1), &sealed_keys(), 0), Sealed::boots(5));
    drone.meets(&mut link, 0);
    assert!(!link.connected, "its hello may have been recorded");
    drone.tells(&mut link, 100);
    assert!(link.connected && link.telemetry.is_some());
}

/// Who repeats a hello keeps no silent drone alive, and makes nobody forget what a drone said; a board that starts anew does.
#[test]
fn a_hello_said_again_by_somebody_changes_nothing() {
    let (mut link, mut drone) = (DroneLink::new(DroneId(1), &sealed_keys(), 0), Sealed::boots(5));
    let hello = drone.meets(&mut link, 0);
    drone.tells(&mut link, 100);
    for ms in (200..5_000).step_by(50) {
        let _ = link.hear(TimePs::from_ms(ms), &hello, &mut |_, _| {});
    }
    assert!(link.telemetry.is_some() && link.said_phase == Some(FlightPhase::Hold));
    assert_eq!(link.silence(TimePs::from_ms(5_000)), TimePs::from_ms(4_900));
    assert_eq!(link.watched(TimePs::from_ms(5_000), TimePs::from_ms(100)), Some(true), "it is lost");

    Sealed::boots(6).meets(&mut link, 6_000);
    assert!(link.telemetry.is_none() && link.said_phase.is_none());
}

#[test]
fn a_control_center_that_was_killed_is_met_again_and_says_its_command_once_more() {
    let (mut link, mut drone) = (DroneLink::new(DroneId(1), &sealed_keys(), 0), Sealed::boots(5));
    drone.meets(&mut link, 0);
    drone.tells(&mut link, 100);
    link.command(Command::Hold);
    link.step(TimePs::from_ms(200), &mut |_, _| {}).unwrap(); // lost on the way
    link.resume(TimePs::from_ms(5_000), &sealed_keys().at_boot(2));

    // What the drone seals for the boot that is over is not read; it is asked who it is.
    let mut asked = Vec::new();
    let stale = drone.seals(&Up::Heartbeat);
    link.hear(TimePs::from_ms(5_100), &stale, &mut |_, frame| asked.push(frame.to_vec())).unwrap();
    assert!(matches!(drone.end.managed(&asked[0]), Ok((_, Management::Identify))));
    let mut identity = [0; MAX_MANAGEMENT];
    let length = drone.end.manage(&Management::Identity(Identity::OWN), &mut identity).unwrap();
    let mut said = Vec::new();
    link.hear(TimePs::from_ms(5_200), &identity[..length], &mut |_, frame| said.push(frame.to_vec()))
        .unwrap();
    link.step(TimePs::from_ms(6_000), &mut |_, frame| said.push(frame.to_vec())).unwrap();
    let heard: Vec<Down> = said
        .iter()
        .map(|frame| {
            let mut room = ROOM;
            decode_body(drone.end.open(frame, &mut room).unwrap().body).unwrap()
        })
        .collect();
    assert!(matches!(heard[0], Down::Welcome { resumes: true, .. }), "{heard:?}");
    assert!(
        matches!(heard.last(), Some(Down::Command { id: CommandId(1), command: Command::Hold })),
        "{heard:?}"
    );
    drone.tells(&mut link, 6_100);
    assert!(link.connected && link.refusals.forged == 1);
}

/// Lanes of so many waypoints, and their header.
fn lanes(waypoints: u16) -> (MissionHeader, Vec<[i32; 2]>) {
    let header = MissionHeader {
        mission: MissionId(1),
        fleet: None,
        mates: [DroneId(1), DroneId(2), DroneId(3)],
        slot: 0,
        spacing_mm: 50_000,
        heading: Heading::Fixed,
        orientation_mrad: 0,
        speed_mmps: 10_000,
        altitude_mm: 50_000,
        home: PosEnuMm([0, 0, 0]),
        waypoints,
        d_safe_mm: 10_000,
        walls: 0,
        vertical: Vertical::Preferred,
    };
    (header, (0..i32::from(waypoints)).map(|n| [100_000 * n, -100_000 * n]).collect())
}

/// When each message is said of an upload to a drone that answers every command 100 ms later, and how long its frame is.
fn uploaded(bytes_per_s: u32, waypoints: u16) -> Vec<(i64, Down, usize)> {
    let mut link = DroneLink::new(DroneId(1), &LinkKeys::none(), bytes_per_s);
    let (header, waypoints_mm) = lanes(waypoints);
    link.upload(header, waypoints_mm);
    let (mut said, mut answers) = (Vec::new(), VecDeque::new());
    for ms in (0..60_000).step_by(40) {
        let now = TimePs::from_ms(ms);
        let mut send = |_, frame: &[u8]| {
            let Ok((_, Message::Down(message))) = decode(frame) else { panic!("no message") };
            if let Down::Command { id, .. } = &message {
                answers.push_back((ms + 100, *id));
            }
            said.push((ms, message, frame.len() + FRAMING));
        };
        link.step(now, &mut send).unwrap();
        link.say_lanes(now, &mut send);
        let due = answers.pop_front_if(|(due, _)| *due <= ms);
        if let Some((_, id)) = due {
            link.acknowledged(now, id, AckStatus::Accepted, &mut |_, frame| {
                let Ok((_, Message::Down(message))) = decode(frame) else { panic!("no message") };
                said.push((ms, message, frame.len() + FRAMING));
            })
            .unwrap();
        }
    }
    assert!(link.idle());
    said
}

#[test]
fn pieces_of_lanes_keep_to_the_rate_and_the_commitment_comes_after_them() {
    const RATE: usize = 1_000;
    let is_piece = |said: &&(i64, Down, usize)| matches!(said.1, Down::LanePiece(_));
    let free = uploaded(0, 300);
    let paced = uploaded(RATE as u32, 300);
    let messages = |said: &[(i64, Down, usize)]| said.iter().map(|it| it.1.clone()).collect::<Vec<_>>();
    assert_eq!(messages(&free), messages(&paced), "the same in the same order, said once");
    let times = |said: &[(i64, Down, usize)]| said.iter().filter(is_piece).map(|it| it.0).collect::<Vec<_>>();
    assert!(times(&free).iter().all(|ms| *ms == times(&free)[0]), "at once where there is room");

    let pieces: Vec<_> = paced.iter().filter(is_piece).collect();
    assert_eq!(pieces.len(), 300_usize.div_ceil(MAX_LANE_PIECE));
    for (first, (from, ..)) in pieces.iter().enumerate() {
        let mut bytes = 0;
        for (until, _, length) in &pieces[first..] {
            bytes += length;
            let most = RATE * (until - from + 100) as usize / 1_000 + MAX_FRAME + FRAMING;
            assert!(bytes <= most, "{bytes} bytes from {from} to {until} ms");
        }
    }
    let bytes: usize = pieces.iter().map(|it| it.2).sum();
    let took_ms = pieces[pieces.len() - 1].0 - pieces[0].0;
    assert!(took_ms < 1_200 * bytes as i64 / RATE as i64, "nothing waits for longer than it has to");
}

/// What cannot wait is said whatever was said before.
#[test]
fn a_command_waits_for_no_piece() {
    let mut link = DroneLink::new(DroneId(1), &LinkKeys::none(), 500);
    let (header, waypoints_mm) = lanes(300);
    link.upload(header, waypoints_mm);
    assert_eq!(sent(&mut link, 0).len(), 1);
    let mut pieces = 0;
    link.acknowledged(TimePs::from_ms(100), CommandId(1), AckStatus::Accepted, &mut |_, _| pieces += 1)
        .unwrap();
    assert!((1..4).contains(&pieces), "{pieces} at once");
    assert!(link.pace.held_back.pieces > 0);
    link.forget_commands();
    link.command(Command::Hold);
    let said = sent(&mut link, 120);
    assert!(matches!(said[..], [Message::Down(Down::Command { command: Command::Hold, .. })]), "{said:?}");
    link.say_lanes(TimePs::from_ms(60_000), &mut |_, _| panic!("the lanes were given up"));
}
