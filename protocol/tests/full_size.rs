//! The largest instance of every message fits a frame, and the largest of them fills it.

use skyroost_protocol::codec::encode;
use skyroost_protocol::key::{KEY_LEN, Key};
use skyroost_protocol::message::{
    AckStatus, Attached, AttachedUser, CaptureEntry, ClockState, Command, Down, EventCode, FlightPhase,
    Heading, LanePiece, Manner, MateTdoa, MissionHeader, Peer, PeerState, SharedState, SrsRequest,
    SrsRequestEntry, TdoaCounts, TdoaEntry, TdoaFlags, Telemetry, Up, Vertical,
};
use skyroost_protocol::units::{
    CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId,
    VelEnuMmps,
};
use skyroost_protocol::{Body, HEADER_LEN, MAX_BODY, Stamp};

const TIME: TimePs = TimePs(i64::MAX);
const POS: PosEnuMm = PosEnuMm([i32::MIN; 3]);
const SIGMA: ToaSigma = ToaSigma(u16::MAX);
const CLOCK: ClockState = ClockState::Held { sigma_ns: u16::MAX };
const STATE: SharedState = SharedState {
    time: TIME,
    pos: POS,
    vel: VelEnuMmps([i16::MIN; 3]),
    error_radius_mm: u16::MAX,
    manner: Manner::UNABLE,
};

/// A vector with no room left.
fn full<T: Clone, const N: usize>(element: T) -> heapless::Vec<T, N> {
    std::iter::repeat_n(element, N).collect()
}

fn body_len<B: Body>(message: &B) -> usize {
    let stamp = Stamp { sender: DroneId(u16::MAX), boot_epoch: u16::MAX, sequence: u32::MAX };
    encode(&stamp, message).expect("a frame holds every message").len() - HEADER_LEN
}

#[test]
fn up() {
    let mate = MateTdoa {
        drone: DroneId(u16::MAX),
        tdoa: TdoaPs(i32::MIN),
        pos: POS,
        sigma: SIGMA,
        flags: TdoaFlags(255),
    };
    let entry = TdoaEntry {
        occasion: OccasionId(u32::MAX),
        user: UserId(u32::MAX),
        time: TIME,
        pos: POS,
        sigma: SIGMA,
        mates: full(mate),
    };
    let user = AttachedUser { user: UserId(u32::MAX), timing_advance: u16::MAX };
    let telemetry = Telemetry {
        time: TIME,
        phase: FlightPhase::Landing,
        mission: Some(MissionId(u16::MAX)),
        sweep_phase_mm: u32::MAX,
        track_error_mm: u32::MAX,
        battery_permille: u16::MAX,
        conditions: u32::MAX,
        frames_lost: u32::MAX,
        frames_rejected: u32::MAX,
        dropped: u32::MAX,
        clock: CLOCK,
        tdoa: TdoaCounts {
            hits: u32::MAX,
            misses: u32::MAX,
            stale: u32::MAX,
            duplicates: u32::MAX,
            evicted: u32::MAX,
            gated: u32::MAX,
            saturated: u32::MAX,
        },
    };
    let status = AckStatus::Incomplete { first_missing: u16::MAX };
    let messages = [
        (
            Up::Hello {
                version_min: 255,
                version_max: 255,
                schema_hash: u32::MAX,
                capture_ticks: u64::MAX,
                capture_ps: u64::MAX,
            },
            28,
        ),
        (Up::CommandAck { command: CommandId(u16::MAX), status }, 8),
        (Up::Heartbeat, 1),
        (Up::SharedState(STATE), 39),
        (Up::Telemetry(telemetry), 88),
        (Up::Attached(Attached { time: TIME, users: full(user) }), 204),
        (Up::Tdoa(full(entry)), 188),
        (Up::Event { code: EventCode::GoalReached, time: TIME, value: u32::MAX }, 17),
    ];
    for (message, expected) in messages {
        assert_eq!(body_len(&message), expected, "{message:?}");
        assert!(expected <= MAX_BODY);
    }
}

#[test]
fn down() {
    let header = MissionHeader {
        mission: MissionId(u16::MAX),
        fleet: Some(FleetId(u16::MAX)),
        mates: [DroneId(u16::MAX); 3],
        slot: 255,
        spacing_mm: u32::MAX,
        heading: Heading::AlongTrack,
        orientation_mrad: i16::MIN,
        speed_mmps: u16::MAX,
        altitude_mm: u32::MAX,
        home: POS,
        waypoints: u16::MAX,
        d_safe_mm: u16::MAX,
        walls: u16::MAX,
        vertical: Vertical::Preferred,
    };
    let entry = SrsRequestEntry { user: UserId(u32::MAX), serving: DroneId(u16::MAX) };
    let request =
        SrsRequest { start: TIME, spacing: TIME, first_occasion: OccasionId(u32::MAX), entries: full(entry) };
    let piece =
        LanePiece { mission: MissionId(u16::MAX), first: u16::MAX, waypoints_mm: full([i32::MIN, i32::MIN]) };
    let command = |command| Down::Command { id: CommandId(u16::MAX), command };
    let messages = [
        (Down::Welcome { version: 255, schema_hash: u32::MAX, resumes: true }, 8),
        (Down::Heartbeat, 1),
        (command(Command::UploadBegin(header)), 64),
        (command(Command::UploadCommit { mission: MissionId(u16::MAX), lanes_crc: u32::MAX }), 13),
        (command(Command::TakeOff), 5),
        (command(Command::StartSweep { at: TIME }), 15),
        (command(Command::Rekey(Key::new([255; KEY_LEN]))), 37),
        (command(Command::Place { target: POS }), 20),
        (command(Command::Hold), 5),
        (command(Command::ReturnHome), 5),
        (Down::LanePiece(piece), 168),
        (Down::SrsRequest(request), 123),
        (Down::Peers(full(PeerState { drone: DroneId(u16::MAX), state: STATE })), MAX_BODY),
    ];
    for (message, expected) in messages {
        assert_eq!(body_len(&message), expected, "{message:?}");
        assert!(expected <= MAX_BODY);
    }
}

#[test]
fn peer() {
    let capture =
        CaptureEntry { occasion: OccasionId(u32::MAX), toa: TIME, pos: POS, sigma: SIGMA, clock: CLOCK };
    let phase =
        Peer::SweepPhase { time: TIME, phase_um: i64::MIN, rate_mmps: u16::MAX, track_error_mm: u32::MAX };
    for (message, expected) in [(Peer::Captures(full(capture)), 187), (phase, 29)] {
        assert_eq!(body_len(&message), expected, "{message:?}");
        assert!(expected <= MAX_BODY);
    }
}
