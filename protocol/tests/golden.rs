//! The bytes of every message, field by field.
//!
//! The expected bytes are one group a field, packed by hand from postcard's specification and not by this
//! crate: varints of 7 bits a byte, the lowest first, signed integers zigzag before. A change here is a
//! change of the wire format: raise `PROTOCOL_VERSION`.

use heapless::Vec;
use skyroost_protocol::codec::{Body, encode};
use skyroost_protocol::header::FLAG_TAG;
use skyroost_protocol::key::Key;
use skyroost_protocol::message::{
    AckStatus, Attached, AttachedUser, CaptureEntry, ClockState, Command, Down, EventCode, FlightPhase,
    Heading, LanePiece, Manner, MateTdoa, MissionHeader, Peer, PeerState, SharedState, SrsRequest,
    SrsRequestEntry, TdoaCounts, TdoaEntry, TdoaFlags, Telemetry, Up, Vertical,
};
use skyroost_protocol::units::{
    CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId,
    VelEnuMmps,
};
use skyroost_protocol::{
    DecodeError, HEADER_LEN, Header, Kind, MAX_BODY, MAX_FRAME, MAX_STREAM, Message, PROTOCOL_VERSION,
    SCHEMA_HASH, Stamp, StreamFrame, TAG_LEN, decode, encode_stream,
};

const STAMP: Stamp = Stamp { sender: DroneId(3), boot_epoch: 7, sequence: 123_456 };
const TIME: TimePs = TimePs(1_234_567_890_123_456);
const POS: PosEnuMm = PosEnuMm([4_321_000, -1_234_567, 300_125]);
const STATE: SharedState = SharedState {
    time: TIME,
    pos: POS,
    vel: VelEnuMmps([9_876, -1_543, 12]),
    error_radius_mm: 2_000,
    manner: Manner::UNABLE,
};

fn bytes_of(hex: &str) -> std::vec::Vec<u8> {
    let digits: std::vec::Vec<char> = hex.chars().filter(|c| !c.is_whitespace()).collect();
    let byte = |pair: &[char]| u8::from_str_radix(&String::from_iter(pair), 16).expect("hex digits");
    digits.chunks(2).map(byte).collect()
}

/// The message has this body, and the body this message.
#[track_caller]
fn golden<B: Body + Clone>(message: B, wrap: fn(B) -> Message, body_hex: &str) {
    let body = bytes_of(body_hex);
    let frame = encode(&STAMP, &message).expect("a frame holds every message");
    assert_eq!(&frame[HEADER_LEN..], body);
    let (header, decoded) = decode(&frame).expect("a golden frame");
    assert_eq!(decoded, wrap(message));
    assert_eq!((header.kind, usize::from(header.body_len)), (B::KIND, body.len()));
}

#[track_caller]
fn up(message: Up, body_hex: &str) {
    golden(message, Message::Up, body_hex);
}

#[track_caller]
fn down(message: Down, body_hex: &str) {
    golden(message, Message::Down, body_hex);
}

#[track_caller]
fn peer(message: Peer, body_hex: &str) {
    golden(message, Message::Peer, body_hex);
}

#[test]
fn sizes_and_schema() {
    assert_eq!((PROTOCOL_VERSION, SCHEMA_HASH), (5, 0xc27c_c67f));
    assert_eq!((HEADER_LEN, MAX_BODY, TAG_LEN, MAX_FRAME, MAX_STREAM), (15, 207, 16, 238, 245));
}

#[test]
fn whole_frame() {
    let frame = encode(&STAMP, &Up::Heartbeat).expect("a frame holds every message");
    //                    magic version kind flags sender epoch sequence length body
    let expected = bytes_of("5352   05    01   00   0300  0700  40e20100  0100   02");
    assert_eq!(&frame[..], expected);
    let header = Header {
        version: 5,
        kind: Kind::Up,
        flags: 0,
        sender: DroneId(3),
        boot_epoch: 7,
        sequence: 123_456,
        body_len: 1,
    };
    assert_eq!(decode(&frame), Ok((header, Message::Up(Up::Heartbeat))));
}

#[test]
fn a_sealed_frame_is_understood_and_refused() {
    let mut frame = bytes_of("5352 05 01 01 0300 0700 40e20100 0100 02");
    assert_eq!(frame[4], FLAG_TAG);
    assert_eq!(decode(&frame), Err(DecodeError::Truncated));
    frame.extend([0xaa; TAG_LEN]);
    assert_eq!(decode(&frame), Err(DecodeError::Sealed));
    frame.push(0xaa);
    assert_eq!(decode(&frame), Err(DecodeError::TrailingBytes));
}

#[test]
fn whole_stream_frame() {
    // CRC-32 by Python's zlib.crc32: 0x42a8331b; each COBS code counts to the next zero.
    let frame = bytes_of("5352 05 01 00 0300 0700 40e20100 0100 02");
    let mut out = StreamFrame::new();
    encode_stream(&frame, &mut out).expect("a frame fits the link");
    assert_eq!(&out[..], bytes_of("00 0553520501 0203 0207 0440e201 0201 06021b33a842 00"));
}

/// Postcard's specification worked by hand, bit by bit.
#[test]
fn truth_of_the_specification() {
    let state = |time, pos, vel, error_radius_mm| {
        Up::SharedState(SharedState {
            time: TimePs(time),
            pos: PosEnuMm(pos),
            vel: VelEnuMmps(vel),
            error_radius_mm,
            manner: Manner::ALONE,
        })
    };
    // Zigzag: 0, -1, 1, -2, 2 are 0, 1, 2, 3, 4.
    up(state(0, [-1, 1, -2], [2, 0, 0], 0), "03 00 01 02 03 04 00 00 00 00");
    // Seven bits a byte: zigzag 63 = 126 and -64 = 127 take one, 64 = 128 = 0b1_0000000 and
    // -65 = 129 = 0b1_0000001 two; 300 = 0b10_0101100, and 16,384 = 2^14 takes three.
    up(state(63, [-64, 64, -65], [0, 0, 0], 300), "03 7e 7f 8001 8101 00 00 00 ac02 00");
    up(state(64, [0, 0, 0], [0, 0, 0], 16_384), "03 8001 00 00 00 00 00 00 808001 00");
    // The extremes: 64 bits are 9 * 7 + 1, 32 bits 4 * 7 + 4, 16 bits 2 * 7 + 2; the zigzag of a minimum
    // is all ones, of a maximum all ones but the lowest.
    up(
        state(i64::MIN, [i32::MIN, i32::MAX, 0], [0, 0, 0], u16::MAX),
        "03 ffffffffffffffffff01 ffffffff0f feffffff0f 00 00 00 00 ffff03 00",
    );
    // A byte is a byte, never a varint.
    up(
        Up::Hello {
            version_min: 128,
            version_max: 255,
            schema_hash: 127,
            capture_ticks: 128,
            capture_ps: u64::MAX,
        },
        "00 80 ff 7f 8001 ffffffffffffffffff01",
    );
}

/// Only the shortest varint of a value is read: no two bodies say the same.
#[test]
fn refuses_padded_varints() {
    let body_of = |body_hex: &str| {
        let body = bytes_of(body_hex);
        let mut frame = bytes_of("5352 05 01 00 0300 0700 40e20100");
        frame.extend((body.len() as u16).to_le_bytes());
        frame.extend(body);
        decode(&frame).map(|(_, message)| message)
    };
    let ack = Up::CommandAck { command: CommandId(42), status: AckStatus::Accepted };
    assert_eq!(body_of("01 2a 00"), Ok(Message::Up(ack)));
    assert_eq!(body_of("01 aa00 00"), Err(DecodeError::Body), "the value");
    assert_eq!(body_of("01 2a 8000"), Err(DecodeError::Body), "the number of a variant");
    assert_eq!(body_of("8100 2a 00"), Err(DecodeError::Body), "the number of the message");
    assert_eq!(body_of("06 00"), Ok(Message::Up(Up::Tdoa(Vec::new()))));
    assert_eq!(body_of("06 8000"), Err(DecodeError::Body), "a length");
    assert_eq!(body_of("06 80808080808000"), Err(DecodeError::Body), "a length no board can read");
}

#[test]
fn link_messages() {
    let hello = Up::Hello {
        version_min: 1,
        version_max: 2,
        schema_hash: 0xdead_beef,
        capture_ticks: 384,
        capture_ps: 390_625,
    };
    up(hello, "00 01 02 effdb6f50d 8003 e1eb17");
    up(Up::Heartbeat, "02");
    down(Down::Welcome { version: 1, schema_hash: 0xdead_beef, resumes: true }, "00 01 effdb6f50d 01");
    down(Down::Heartbeat, "01");
}

#[test]
fn command_ack() {
    let ack = |status| Up::CommandAck { command: CommandId(42), status };
    up(ack(AckStatus::Accepted), "01 2a 00");
    up(ack(AckStatus::Incomplete { first_missing: 300 }), "01 2a 01 ac02");
    up(ack(AckStatus::WrongPhase), "01 2a 02");
    up(ack(AckStatus::OutOfRange), "01 2a 03");
    up(ack(AckStatus::Overridden), "01 2a 04");
}

#[test]
fn shared_states() {
    let state = "80ebd5c8a7b5b104 d0bb8f04 8dda9601 bad124 a89a01 8d18 18 d00f ff";
    up(Up::SharedState(STATE), &format!("03 {state}"));
    let peers = [PeerState { drone: DroneId(5), state: STATE }];
    down(Down::Peers(peers.into_iter().collect()), &format!("05 01 05 {state}"));
    down(Down::Peers(Vec::new()), "05 00");
}

#[test]
fn telemetry() {
    let telemetry = |phase, mission| {
        Up::Telemetry(Telemetry {
            time: TIME,
            phase,
            mission,
            sweep_phase_mm: 60_000_000,
            track_error_mm: 1_500,
            battery_permille: 873,
            conditions: 5,
            frames_lost: 12,
            frames_rejected: 3,
            dropped: 9,
            clock: ClockState::Locked { sigma_ns: 300 },
            tdoa: TdoaCounts {
                hits: 10,
                misses: 11,
                stale: 12,
                duplicates: 13,
                evicted: 14,
                gated: 300,
                saturated: 16,
            },
        })
    };
    let rest = "808ece1c dc0b e906 05 0c 03 09 01 ac02 0a 0b 0c 0d 0e ac02 10";
    up(telemetry(FlightPhase::Serve, Some(MissionId(77))), &format!("04 80ebd5c8a7b5b104 05 01 4d {rest}"));
    let phases = [
        FlightPhase::Grounded,
        FlightPhase::TakeOff,
        FlightPhase::Hold,
        FlightPhase::Sweep,
        FlightPhase::GoTo,
        FlightPhase::Serve,
        FlightPhase::ReturnHome,
        FlightPhase::Landing,
    ];
    for (number, phase) in phases.into_iter().enumerate() {
        up(telemetry(phase, None), &format!("04 80ebd5c8a7b5b104 {number:02x} 00 {rest}"));
    }
}

#[test]
fn attached() {
    let near = AttachedUser { user: UserId(9), timing_advance: 12 };
    let far = AttachedUser { user: UserId(70_000), timing_advance: 1_282 };
    let page = Attached { time: TIME, users: [near, far].into_iter().collect() };
    up(Up::Attached(page), "05 80ebd5c8a7b5b104 02 09 0c f0a204 820a");
}

#[test]
fn tdoa() {
    let mate = |drone, tdoa_ps, sigma, flags| MateTdoa {
        drone: DroneId(drone),
        tdoa: TdoaPs(tdoa_ps),
        pos: POS,
        sigma: ToaSigma(sigma),
        flags,
    };
    let both = TdoaEntry {
        occasion: OccasionId(1000),
        user: UserId(9),
        time: TIME,
        pos: POS,
        sigma: ToaSigma(300),
        mates: Vec::from_array([
            mate(1, -123_456, 626, TdoaFlags::GATED | TdoaFlags::HELD),
            mate(2, i32::MAX, 1, TdoaFlags::SATURATED | TdoaFlags::UNJUDGED),
        ]),
    };
    let none = TdoaEntry {
        occasion: OccasionId(1001),
        user: UserId(10),
        time: TimePs(TIME.0 + 1),
        pos: POS,
        sigma: ToaSigma(u16::MAX),
        mates: Vec::new(),
    };
    up(
        Up::Tdoa([both, none].into_iter().collect()),
        "06 02
         e807 09 80ebd5c8a7b5b104 d0bb8f04 8dda9601 bad124 ac02 02
             01 ff880f d0bb8f04 8dda9601 bad124 f204 0a
             02 feffffff0f d0bb8f04 8dda9601 bad124 01 05
         e907 0a 82ebd5c8a7b5b104 d0bb8f04 8dda9601 bad124 ffff03 00",
    );
}

#[test]
fn events() {
    let codes = [
        EventCode::PhaseEntered,
        EventCode::ConditionRaised,
        EventCode::ConditionCleared,
        EventCode::SweepDone,
        EventCode::GoalReached,
    ];
    for (number, code) in codes.into_iter().enumerate() {
        let event = Up::Event { code, time: TIME, value: 5_000 };
        up(event, &format!("07 {number:02x} 80ebd5c8a7b5b104 8827"));
    }
}

#[test]
fn commands() {
    let command = |command| Down::Command { id: CommandId(42), command };
    let header = MissionHeader {
        mission: MissionId(77),
        fleet: Some(FleetId(1)),
        mates: [DroneId(4), DroneId(5), DroneId(6)],
        slot: 2,
        spacing_mm: 50_000,
        heading: Heading::AlongTrack,
        orientation_mrad: -1_571,
        speed_mmps: 10_000,
        altitude_mm: 300_000,
        home: PosEnuMm([1, -2, 3]),
        waypoints: 512,
        d_safe_mm: 10_000,
        walls: 7,
        vertical: Vertical::Preferred,
    };
    let reserve =
        MissionHeader { fleet: None, mates: [DroneId(0); 3], slot: 0, heading: Heading::Fixed, ..header };
    let tail = "c518 904e e0a712 02 03 06 8004 904e 07 02";
    down(command(Command::UploadBegin(header)), &format!("02 2a 00 4d 01 01 04 05 06 02 d08603 01 {tail}"));
    down(command(Command::UploadBegin(reserve)), &format!("02 2a 00 4d 00 00 00 00 00 d08603 00 {tail}"));
    let commit = Command::UploadCommit { mission: MissionId(77), lanes_crc: 0x1234_5678 };
    down(command(commit), "02 2a 01 4d f8acd19101");
    down(command(Command::TakeOff), "02 2a 02");
    down(command(Command::StartSweep { at: TIME }), "02 2a 03 80ebd5c8a7b5b104");
    down(command(Command::Place { target: POS }), "02 2a 04 d0bb8f04 8dda9601 bad124");
    down(command(Command::Hold), "02 2a 05");
    down(command(Command::ReturnHome), "02 2a 06");
    let key = || Key::new(core::array::from_fn(|i| i as u8));
    let bytes = "00010203 04050607 08090a0b 0c0d0e0f 10111213 14151617 18191a1b 1c1d1e1f";
    down(command(Command::Rekey(key())), &format!("02 2a 07 {bytes}"));
    down(command(Command::PeerKey(key())), &format!("02 2a 08 {bytes}"));
}

#[test]
fn lane_piece() {
    let waypoints_mm = [[-1, 1], [10_000_000, -10_000_000]].into_iter().collect();
    down(
        Down::LanePiece(LanePiece { mission: MissionId(77), first: 16, waypoints_mm }),
        "03 4d 10 02 01 02 80dac409 ffd9c409",
    );
}

#[test]
fn srs_request() {
    let entry = |user, drone| SrsRequestEntry { user: UserId(user), serving: DroneId(drone) };
    let request = SrsRequest {
        start: TIME,
        spacing: TimePs::from_ms(1),
        first_occasion: OccasionId(1000),
        entries: [entry(9, 3), entry(10, 4)].into_iter().collect(),
    };
    down(Down::SrsRequest(request), "04 80ebd5c8a7b5b104 80a8d6b907 e807 02 09 03 0a 04");
}

#[test]
fn peers_of_a_fleet() {
    let clocks = [
        (ClockState::Free, "00"),
        (ClockState::Locked { sigma_ns: 7 }, "01 07"),
        (ClockState::Held { sigma_ns: 300 }, "02 ac02"),
    ];
    for (clock, as_bytes) in clocks {
        let capture =
            CaptureEntry { occasion: OccasionId(1000), toa: TIME, pos: POS, sigma: ToaSigma(626), clock };
        peer(
            Peer::Captures([capture].into_iter().collect()),
            &format!("00 01 e807 80ebd5c8a7b5b104 d0bb8f04 8dda9601 bad124 f204 {as_bytes}"),
        );
    }
    let phase =
        Peer::SweepPhase { time: TIME, phase_um: -60_000_000_001, rate_mmps: 10_000, track_error_mm: 1_500 };
    peer(phase, "01 80ebd5c8a7b5b104 81e0ba84bf03 904e dc0b");
}
