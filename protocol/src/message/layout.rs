//! The wire format of every message on one page: tags, fields and their order.
//!
//! [`wire`](crate::wire) says how each is written. Whatever changes here changes
//! [`SCHEMA_HASH`] and one of the byte-golden tests.

use super::{
    AckStatus, Attached, AttachedUser, CaptureEntry, Command, Down, EventCode, FlightPhase, Heading,
    LanePiece, MAX_ATTACHED_PER_FRAME, MAX_CAPTURES_PER_FRAME, MAX_LANE_PIECE, MAX_PEERS_PER_FRAME,
    MAX_SRS_PER_REQUEST, MAX_TDOA_PER_FRAME, MateTdoa, MissionHeader, Peer, PeerState, SharedState,
    SrsRequest, SrsRequestEntry, TdoaEntry, TdoaFlags, Telemetry, Up,
};
use crate::units::{
    CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TdoaPs, TimePs, UserId, VelEnuMmps,
};
use crate::wire::{
    Full, Malformed, Reader, Wire, Writer, longest, shape_of, wire_enum, wire_newtype, wire_struct, with_part,
};
use heapless::Vec;

/// Hash over the shapes of all messages: both ends of a link compare it before anything else, because
/// equal hashes mean equal tags, fields, types and capacities.
pub const SCHEMA_HASH: u32 = {
    let shape = shape_of("skyroost");
    let shape = with_part(shape, "up", Up::SHAPE);
    let shape = with_part(shape, "down", Down::SHAPE);
    with_part(shape, "peer", Peer::SHAPE)
};

wire_newtype! {
    DroneId(u16);
    FleetId(u16);
    UserId(u32);
    OccasionId(u32);
    CommandId(u16);
    MissionId(u16);
    TimePs(i64);
    TdoaPs(i32);
    PosEnuMm([i32; 3]);
    VelEnuMmps([i32; 3]);
    TdoaFlags(u8);
}

// Drone to control center.

wire_enum!(Up {
    0 = Hello { version_min: u8, version_max: u8, schema_hash: u32, capture_tick_hz: u32 },
    1 = CommandAck { command: CommandId, status: AckStatus },
    2 = Heartbeat,
    3 = SharedState(state: SharedState),
    4 = Telemetry(telemetry: Telemetry),
    5 = Attached(page: Attached),
    6 = Tdoa(entries: Vec<TdoaEntry, MAX_TDOA_PER_FRAME>),
    7 = Event { code: EventCode, time: TimePs, value: u32 },
});

wire_enum!(AckStatus {
    0 = Accepted,
    1 = Incomplete { first_missing: u16 },
    2 = WrongPhase,
    3 = OutOfRange,
    4 = Overridden,
});

wire_struct!(SharedState { time: TimePs, pos: PosEnuMm, vel: VelEnuMmps, error_radius_mm: u16 });

wire_struct!(Telemetry {
    time: TimePs,
    phase: FlightPhase,
    mission: Option<MissionId>,
    sweep_phase_mm: u32,
    track_error_mm: u32,
    battery_permille: u16,
    conditions: u16,
    frames_lost: u32,
    frames_rejected: u32,
    dropped: u32,
});

wire_enum!(FlightPhase {
    0 = Grounded,
    1 = TakeOff,
    2 = Hold,
    3 = Sweep,
    4 = GoTo,
    5 = Serve,
    6 = ReturnHome,
    7 = Landing,
});

wire_struct!(Attached { time: TimePs, users: Vec<AttachedUser, MAX_ATTACHED_PER_FRAME> });

wire_struct!(AttachedUser { user: UserId, timing_advance: u16 });

wire_struct!(TdoaEntry {
    occasion: OccasionId,
    user: UserId,
    time: TimePs,
    pos: PosEnuMm,
    mates: Vec<MateTdoa, 2>,
});

wire_struct!(MateTdoa { drone: DroneId, tdoa: TdoaPs, pos: PosEnuMm, flags: TdoaFlags });

wire_enum!(EventCode {
    0 = PhaseEntered,
    1 = ConditionRaised,
    2 = ConditionCleared,
    3 = SweepDone,
    4 = GoalReached,
});

// Control center to drone.

wire_enum!(Down {
    0 = Welcome { version: u8, schema_hash: u32 },
    1 = Heartbeat,
    2 = Command { id: CommandId, command: Command },
    3 = LanePiece(piece: LanePiece),
    4 = SrsRequest(request: SrsRequest),
    5 = Peers(states: Vec<PeerState, MAX_PEERS_PER_FRAME>),
});

wire_enum!(Command {
    0 = UploadBegin(header: MissionHeader),
    1 = UploadCommit { mission: MissionId, lanes_crc: u32 },
    2 = TakeOff,
    3 = StartSweep { at: TimePs },
    4 = Place { target: PosEnuMm },
    5 = Hold,
    6 = ReturnHome,
});

wire_struct!(MissionHeader {
    mission: MissionId,
    fleet: Option<FleetId>,
    mates: [DroneId; 3],
    slot: u8,
    spacing_mm: u32,
    heading: Heading,
    orientation_mrad: i16,
    speed_mmps: u16,
    altitude_mm: u32,
    home: PosEnuMm,
    waypoints: u16,
    d_safe_mm: u16,
});

wire_enum!(Heading { 0 = Fixed, 1 = AlongTrack });

wire_struct!(LanePiece { mission: MissionId, first: u16, waypoints_mm: Vec<[i32; 2], MAX_LANE_PIECE> });

wire_struct!(SrsRequest {
    start: TimePs,
    spacing: TimePs,
    first_occasion: OccasionId,
    entries: Vec<SrsRequestEntry, MAX_SRS_PER_REQUEST>,
});

wire_struct!(SrsRequestEntry { user: UserId, serving: DroneId });

wire_struct!(PeerState { drone: DroneId, state: SharedState });

// Among the drones of a fleet.

wire_enum!(Peer {
    0 = Captures(entries: Vec<CaptureEntry, MAX_CAPTURES_PER_FRAME>),
    1 = SweepPhase { time: TimePs, phase_um: i64, rate_mmps: u16, track_error_mm: u32 },
});

wire_struct!(CaptureEntry { occasion: OccasionId, toa: TimePs, pos: PosEnuMm });
