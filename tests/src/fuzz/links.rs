//! Targets of what comes over a link: radio, bus and flash.

use super::{
    Outcome, Target,
    seeds::{downs, ups},
};
use serde::{Deserialize, Serialize};
use skyroost_firmware::{
    agent::FlightAgent,
    board::{
        autopilot::{self, FROM_AUTOPILOT, FromAutopilot, TO_AUTOPILOT, ToAutopilot},
        bus::{self, FromBoard, ToBoard},
        bus_mode::{BusIntake, Heard},
        inflight::{Edge, Inflight},
        lockstep::{Ask, Lockstep, RadioIntake},
        provision::{PROVISION_LEN, Provision},
    },
    config::AgentConfig,
    io::{Inputs, NavFix, Outputs},
};
use skyroost_protocol::{
    Body, DecodeError, Frame, HEADER_LEN, Key, LinkEnd, LinkFault, MAX_FRAME, Message, Stamp, StreamDecoder,
    StreamFrame,
    codec::{self, decode_body},
    encode_stream,
    key::{KEY_LEN, ROOM},
    manage::{self},
    message::{Down, FlightPhase, Peer, Up},
    units::{DroneId, TimePs},
};
use std::sync::OnceLock;

pub(super) const ME: DroneId = DroneId(1);
pub(super) const STAMP: Stamp = Stamp { sender: ME, boot_epoch: 3, sequence: 77 };

pub(super) const fn target(
    name: &'static str,
    run: fn(&[u8]) -> Outcome,
    seeds: fn() -> Vec<Vec<u8>>,
    rounds: u32,
) -> Target {
    Target { name, run, seeds, words: &[], rounds }
}

// ---------------------------------------------------------------------------------------------------------------------
// Frames and messages of the radio.

/// A frame that is taken is the frame that its message makes: nothing else is taken for it.
pub(super) fn frame(bytes: &[u8]) -> Outcome {
    let Ok((header, message)) = skyroost_protocol::decode(bytes) else {
        if let Ok(parcel) = codec::parse(bytes) {
            let mut room = ROOM;
            let key = Key::new([9; KEY_LEN]).session(skyroost_protocol::Purpose::Up, ME, 1, 1);
            assert!(parcel.open(&key, &mut room).is_err(), "opened with a key that nobody has");
        }
        return Outcome::Refused;
    };
    let stamp = Stamp { sender: header.sender, boot_epoch: header.boot_epoch, sequence: header.sequence };
    let again = match &message {
        Message::Up(up) => codec::encode(&stamp, up),
        Message::Down(down) => codec::encode(&stamp, down),
        Message::Peer(peer) => codec::encode(&stamp, peer),
    };
    let again = again.expect("a frame holds every message");
    assert_eq!(skyroost_protocol::decode(&again), Ok((header, message)));
    // Of the bytes before the body a version or a flag of no meaning may differ, nothing behind them.
    assert_eq!(again.get(HEADER_LEN..), bytes.get(HEADER_LEN..));
    Outcome::Accepted
}

/// The first byte says whose message the others are.
pub(super) fn body(bytes: &[u8]) -> Outcome {
    fn of<B: Body + PartialEq + core::fmt::Debug>(body: &[u8]) -> Outcome {
        let Ok(message) = decode_body::<B>(body) else { return Outcome::Refused };
        let frame = codec::encode(&STAMP, &message).expect("a frame holds every message");
        assert_eq!(frame.get(HEADER_LEN..), Some(body), "there is one encoding");
        assert_eq!(decode_body::<B>(body), Ok(message));
        Outcome::Accepted
    }
    match bytes.split_first() {
        Some((kind, body)) if kind % 3 == 0 => of::<Up>(body),
        Some((kind, body)) if kind % 3 == 1 => of::<Down>(body),
        Some((_, body)) => of::<Peer>(body),
        None => Outcome::Refused,
    }
}

/// Frames that a drone and its control center sealed; whoever has no key makes nothing of them that either believes.
pub(super) fn genuine() -> &'static [Frame] {
    static FRAMES: OnceLock<Vec<Frame>> = OnceLock::new();
    FRAMES.get_or_init(|| {
        let root = || Some(Key::new([5; KEY_LEN]));
        let mut drone = LinkEnd::new(ME, 3, DroneId::CONTROL, root());
        let mut control = LinkEnd::new(DroneId::CONTROL, 4, ME, root());
        let mut frames = Vec::new();
        let mut say = |end: &mut LinkEnd, up: Option<&Up>, down: Option<&Down>| {
            let mut frame = [0; MAX_FRAME];
            let length = match (up, down) {
                (Some(up), _) => end.encode_into(up, &mut frame),
                (_, Some(down)) => end.encode_into(down, &mut frame),
                _ => Ok(0),
            };
            let frame: Frame = frame[..length.expect("it fits")].iter().copied().collect();
            frames.push(frame.clone());
            frame
        };
        let hello = say(&mut drone, Some(&ups()[0]), None);
        let opened = control.open(&hello, &mut ROOM.clone()).map(|opened| opened.header.boot_epoch);
        control.meet(opened.expect("a hello of the drone"));
        for down in downs() {
            let frame = say(&mut control, None, Some(&down));
            let _ = drone.open(&frame, &mut ROOM.clone());
        }
        for up in ups() {
            let _ = say(&mut drone, Some(&up), None);
        }
        frames
    })
}

pub(super) fn sealed(bytes: &[u8]) -> Outcome {
    let root = || Some(Key::new([5; KEY_LEN]));
    let is_genuine = genuine().iter().any(|frame| frame.as_slice() == bytes);
    let mut fresh =
        [LinkEnd::new(ME, 3, DroneId::CONTROL, root()), LinkEnd::new(DroneId::CONTROL, 4, ME, root())];
    let mut met = fresh.clone();
    met[0].meet(4);
    met[1].meet(3);
    for end in fresh.iter_mut().chain(&mut met) {
        let taken = end.open(bytes, &mut ROOM.clone()).is_ok();
        assert!(!taken || is_genuine, "a frame is believed that nobody sealed");
        assert!(end.managed(bytes).is_err(), "a management frame is believed that nobody sealed");
    }
    // Of another boot, or with another key, nothing is believed at all, but a drone's hello, which tells no more than that it booted.
    let mut others = [
        LinkEnd::new(ME, 9, DroneId::CONTROL, root()),
        LinkEnd::new(ME, 3, DroneId::CONTROL, Some(Key::new([6; KEY_LEN]))),
        LinkEnd::new(DroneId::CONTROL, 4, ME, Some(Key::new([6; KEY_LEN]))),
    ];
    for end in &mut others {
        assert!(end.open(bytes, &mut ROOM.clone()).is_err(), "a frame of another boot or key is believed");
    }
    let refused = LinkEnd::new(ME, 3, DroneId::CONTROL, root()).open(bytes, &mut ROOM.clone()).err();
    // What looks like a sealed frame is worth changing further.
    Outcome::of(refused == Some(LinkFault::Decode(DecodeError::Forged)))
}

pub(super) fn management(bytes: &[u8]) -> Outcome {
    let key = Key::new([7; KEY_LEN]);
    assert!(manage::decode(bytes, Some(&key)).is_err(), "nobody sealed it");
    let Ok((header, message)) = manage::decode(bytes, None) else { return Outcome::Refused };
    let stamp = Stamp { sender: header.sender, boot_epoch: header.boot_epoch, sequence: header.sequence };
    let mut again = [0; MAX_FRAME];
    let length = manage::encode_into(&stamp, &message, None, &mut again).expect("it fits");
    let (_, found) = manage::decode(&again[..length], None).expect("what was just made");
    assert_eq!(found, message);
    Outcome::Accepted
}

// ---------------------------------------------------------------------------------------------------------------------
// Byte links.

/// Frames that are found do not depend on how the bytes come, and go and come back unchanged.
pub(super) fn stream(bytes: &[u8]) -> Outcome {
    let mut one_by_one = StreamDecoder::new();
    let mut found = Vec::new();
    for &byte in bytes {
        if let Some(end) = one_by_one.push(byte) {
            found.push(end.map(<[u8]>::to_vec));
        }
    }
    let portion = 1 + usize::from(bytes.first().copied().unwrap_or_default());
    let (mut in_portions, mut others) = (StreamDecoder::new(), Vec::new());
    for portion in bytes.chunks(portion) {
        let mut rest = portion;
        while !rest.is_empty() {
            let (taken, end) = in_portions.take(rest);
            assert!(taken > 0, "it goes on");
            others.extend(end.map(|end| end.map(<[u8]>::to_vec)));
            rest = &rest[taken..];
        }
    }
    assert_eq!(found, others);
    assert_eq!(one_by_one.counters(), in_portions.counters());
    let arrived = found.iter().any(Result::is_ok);
    for frame in found.iter().flatten() {
        assert_eq!(over_a_stream(frame).as_deref(), Some(&frame[..]));
    }
    if !bytes.is_empty() && bytes.len() <= MAX_FRAME {
        assert_eq!(over_a_stream(bytes).as_deref(), Some(bytes));
    }
    Outcome::of(arrived)
}

fn over_a_stream(frame: &[u8]) -> Option<Vec<u8>> {
    let mut coded = StreamFrame::new();
    encode_stream(frame, &mut coded).ok()?;
    let mut decoder = StreamDecoder::new();
    coded.iter().find_map(|&byte| decoder.push(byte)?.ok().map(<[u8]>::to_vec))
}

/// What crosses a byte link as one frame.
fn payload(frame: &StreamFrame) -> Vec<u8> {
    let mut decoder = StreamDecoder::new();
    frame.iter().find_map(|&byte| decoder.push(byte)?.ok().map(<[u8]>::to_vec)).expect("a whole frame")
}

/// What is decoded and encoded again says the same; bytes are compared, as no NaN equals another.
fn same_again<'a, T: Serialize + Deserialize<'a>>(
    bytes: &'a [u8],
    encode: impl Fn(&T) -> Vec<u8>,
    decode: impl for<'b> Fn(&'b [u8]) -> Option<Vec<u8>>,
    found: Option<T>,
) -> Outcome {
    let Some(message) = found else { return Outcome::Refused };
    let once = encode(&message);
    assert!(once.len() <= bytes.len(), "nothing is shorter than what is sent");
    assert_eq!(decode(&once), Some(once.clone()));
    Outcome::Accepted
}

pub(super) fn bus_payload<T: Serialize>(message: &T) -> Vec<u8> {
    let mut frame = StreamFrame::new();
    assert!(bus::encode(message, &mut frame), "every message within its bounds fits");
    payload(&frame)
}

/// Messages of the bench's bus; the first byte says in which direction.
pub(super) fn bus_message(bytes: &[u8]) -> Outcome {
    let Some((direction, bytes)) = bytes.split_first() else { return Outcome::Refused };
    // No frame of the byte link is longer.
    let bytes = bytes.get(..MAX_FRAME).unwrap_or(bytes);
    if direction % 2 == 0 {
        let again = |bytes: &[u8]| bus::decode::<ToBoard<'_>>(bytes).map(|message| bus_payload(&message));
        same_again(bytes, bus_payload::<ToBoard<'_>>, again, bus::decode(bytes))
    } else {
        let again = |bytes: &[u8]| bus::decode::<FromBoard<'_>>(bytes).map(|message| bus_payload(&message));
        same_again(bytes, bus_payload::<FromBoard<'_>>, again, bus::decode(bytes))
    }
}

pub(super) fn autopilot_payload<T: Serialize>(tag: u8, message: &T) -> Vec<u8> {
    payload(&autopilot::encode(tag, message).expect("every message fits"))
}

/// Messages of the autopilot's bus, with the byte before them that says in which direction.
pub(super) fn autopilot_message(bytes: &[u8]) -> Outcome {
    let bytes = bytes.get(..MAX_FRAME).unwrap_or(bytes);
    let from = autopilot::decode::<FromAutopilot>(FROM_AUTOPILOT, bytes);
    let to = autopilot::decode::<ToAutopilot>(TO_AUTOPILOT, bytes);
    if from.is_some() || to.is_some() {
        assert!(bus::decode::<ToBoard<'_>>(bytes).is_none(), "it is a message of the host as well");
    }
    if from.is_some() {
        let encode = |message: &FromAutopilot| autopilot_payload(FROM_AUTOPILOT, message);
        let again = |bytes: &[u8]| autopilot::decode(FROM_AUTOPILOT, bytes).map(|message| encode(&message));
        same_again(bytes, encode, again, from)
    } else {
        let encode = |message: &ToAutopilot| autopilot_payload(TO_AUTOPILOT, message);
        let again = |bytes: &[u8]| autopilot::decode(TO_AUTOPILOT, bytes).map(|message| encode(&message));
        same_again(bytes, encode, again, to)
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// Whole talks: messages one after the other, each with its length before it.

pub(super) fn talk(messages: &[Vec<u8>]) -> Vec<u8> {
    messages.iter().flat_map(|message| [&[message.len().min(255) as u8][..], message].concat()).collect()
}

fn messages(talk: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = talk;
    core::iter::from_fn(move || {
        let (length, after) = rest.split_first()?;
        let (message, after) = after.split_at_checked(usize::from(*length)).unwrap_or((after, &[]));
        rest = after;
        Some(message)
    })
}

/// A board on the bench: each message comes undamaged, which chance alone would hardly bring about.
pub(super) fn lockstep(bytes: &[u8]) -> Outcome {
    let (mut lockstep, mut radio) = (Lockstep::new(), RadioIntake::new());
    let (mut inputs, outputs) = (Inputs::new(), Outputs::new());
    let (mut frame, mut steps) = (StreamFrame::new(), 0);
    for message in messages(bytes) {
        if encode_stream(message, &mut frame).is_err() {
            continue;
        }
        let mut rest = frame.as_slice();
        while !rest.is_empty() {
            let (taken, asked) = lockstep.take(rest, &mut inputs);
            assert!(taken > 0, "it goes on");
            rest = &rest[taken..];
            match asked {
                Some(Ask::Radio(bytes)) => radio.take(bytes, &mut inputs),
                Some(Ask::Begin(..)) => assert!(lockstep.begun().is_some()),
                Some(Ask::Step { have, .. } | Ask::Answer { have }) => {
                    steps += 1;
                    lockstep.stepped(steps);
                    let (mut answer, mut said) = (lockstep.answer(have, &outputs), StreamFrame::new());
                    assert!(answer.next_frame(&mut said) && !answer.next_frame(&mut said));
                    inputs.clear();
                }
                Some(Ask::Say(_) | Ask::Report) | None => {}
            }
        }
    }
    Outcome::of(steps > 0)
}

/// A board in flight: what it hears, edges, and steps between.
pub(super) fn inflight(bytes: &[u8]) -> Outcome {
    let mut board = Inflight::new(AgentConfig::new(ME).oscillator, 7);
    let (mut intake, mut inputs, mut outputs) = (BusIntake::new(), Inputs::new(), Outputs::new());
    let (mut timer, mut last, mut frame) = (7_u32, None, StreamFrame::new());
    for message in messages(bytes) {
        let number = message.iter().fold(0_u32, |sum, byte| sum.rotate_left(7) ^ u32::from(*byte));
        timer = timer.wrapping_add(19_660_800);
        board.read(timer);
        match message.first() {
            Some(0) => board.edge(Edge::Pulse(timer.wrapping_sub(number % 1_000))),
            Some(1) => board.edge(Edge::Trigger(timer.wrapping_sub(number % 40_000_000))),
            _ if encode_stream(message, &mut frame).is_ok() => {
                for heard in frame.iter().filter_map(|byte| intake.push(*byte)) {
                    if let Heard::Autopilot(message) = heard {
                        board.hear(message, timer);
                    }
                }
            }
            _ => {}
        }
        if let Some(now) = board.step_time(timer) {
            assert!(last.is_none_or(|last| last <= now), "time never runs back");
            last = Some(now);
            inputs.clear();
            board.sense(&mut inputs);
            outputs.clear();
            board.act(now, &outputs);
        }
    }
    Outcome::of(last.is_some() || board.identity().is_some())
}

pub(super) fn provision(bytes: &[u8]) -> Outcome {
    let mut sector = [0xff; PROVISION_LEN];
    sector.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
    let Ok(given) = Provision::read(&sector) else { return Outcome::Refused };
    let again = given.to_bytes();
    assert_eq!(Provision::read(&again).map(|given| given.to_bytes()), Ok(again));
    Outcome::Accepted
}

/// A flight: frames as they come, plain, with a step of the whole flight code for each.
pub(super) fn agent(bytes: &[u8]) -> Outcome {
    let mut agent = FlightAgent::new(AgentConfig::new(ME), None);
    let (mut inputs, mut outputs) = (Inputs::new(), Outputs::new());
    let mut pos_enu_m = skyroost_firmware::Vec3::zeros();
    let mut obeyed = false;
    for (step, message) in (0..).zip(messages(bytes).take(64)) {
        inputs.clear();
        inputs.battery_permille = 900;
        inputs.nav =
            Some(NavFix { pos_enu_m, vel_enu_mps: outputs.setpoint.vel_enu_mps, error_radius_m: 1.0 });
        inputs
            .frames
            .extend(message.get(..MAX_FRAME.min(message.len())).map(|frame| frame.iter().copied().collect()));
        outputs.clear();
        agent.step(TimePs::from_ms(20 * step), &inputs, &mut outputs);
        let setpoint = outputs.setpoint;
        assert!(setpoint.vel_enu_mps.iter().chain(&setpoint.accel_enu_mps2).all(|x| x.is_finite()));
        assert_eq!(setpoint.motors, agent.phase() != FlightPhase::Grounded);
        pos_enu_m += setpoint.vel_enu_mps * skyroost_firmware::STEP_S;
        obeyed |= outputs.uplink.len() > 1;
    }
    Outcome::of(obeyed)
}
