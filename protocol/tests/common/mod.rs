//! Arbitrary messages of every shape, containers empty, part full and full.

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use skyroost_protocol::codec::encode;
use skyroost_protocol::key::{KEY_LEN, Key};
use skyroost_protocol::message::{
    AckStatus, Attached, AttachedUser, CaptureEntry, ClockState, Command, Down, EventCode, FlightPhase,
    Heading, LanePiece, MAX_ATTACHED_PER_FRAME, MAX_CAPTURES_PER_FRAME, MAX_LANE_PIECE, MAX_PEERS_PER_FRAME,
    MAX_SRS_PER_REQUEST, MAX_TDOA_PER_FRAME, Manner, MateTdoa, MissionHeader, Peer, PeerState, SharedState,
    SrsRequest, SrsRequestEntry, TdoaCounts, TdoaEntry, TdoaFlags, Telemetry, Up, Vertical,
};
use skyroost_protocol::units::{
    CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId,
    VelEnuMmps,
};
use skyroost_protocol::{Frame, Message, Stamp};

/// Up to `N` elements, often exactly `N`.
fn bounded<T: Strategy + Clone, const N: usize>(
    element: T,
) -> impl Strategy<Value = heapless::Vec<T::Value, N>>
where
    T::Value: Clone,
{
    prop_oneof![vec(element.clone(), 0..=N), vec(element, N)].prop_map(|v| v.into_iter().collect())
}

/// Integers of every length on the wire, equally often: varints are short where values are small.
fn any_length() -> impl Strategy<Value = i64> + Clone {
    (any::<i64>(), 0..64_u32).prop_map(|(value, shift)| value >> shift)
}

fn id<T: std::fmt::Debug>(make: fn(u16) -> T) -> impl Strategy<Value = T> + Clone {
    (any::<u16>(), 0..16_u32).prop_map(move |(value, shift)| make(value >> shift))
}

fn id32<T: std::fmt::Debug>(make: fn(u32) -> T) -> impl Strategy<Value = T> + Clone {
    (any::<u32>(), 0..32_u32).prop_map(move |(value, shift)| make(value >> shift))
}

fn time() -> impl Strategy<Value = TimePs> + Clone {
    any_length().prop_map(TimePs)
}

fn pos() -> impl Strategy<Value = PosEnuMm> + Clone {
    [any_length(), any_length(), any_length()].prop_map(|mm| PosEnuMm(mm.map(|mm| mm as i32)))
}

fn state() -> impl Strategy<Value = SharedState> + Clone {
    (time(), pos(), any::<[i16; 3]>(), any::<u16>(), any::<u8>()).prop_map(
        |(time, pos, vel, error_radius_mm, manner)| SharedState {
            time,
            pos,
            vel: VelEnuMmps(vel),
            error_radius_mm,
            manner: Manner(manner),
        },
    )
}

fn ack_status() -> impl Strategy<Value = AckStatus> {
    prop_oneof![
        Just(AckStatus::Accepted),
        any::<u16>().prop_map(|first_missing| AckStatus::Incomplete { first_missing }),
        Just(AckStatus::WrongPhase),
        Just(AckStatus::OutOfRange),
        Just(AckStatus::Overridden),
    ]
}

fn phase() -> impl Strategy<Value = FlightPhase> {
    use FlightPhase::{GoTo, Grounded, Hold, Landing, ReturnHome, Serve, Sweep, TakeOff};
    proptest::sample::select(&[Grounded, TakeOff, Hold, Sweep, GoTo, Serve, ReturnHome, Landing][..])
}

fn clock_state() -> impl Strategy<Value = ClockState> + Clone {
    let sigma_ns = || id(|sigma_ns| sigma_ns);
    prop_oneof![
        Just(ClockState::Free),
        sigma_ns().prop_map(|sigma_ns| ClockState::Locked { sigma_ns }),
        sigma_ns().prop_map(|sigma_ns| ClockState::Held { sigma_ns }),
    ]
}

fn tdoa_counts() -> impl Strategy<Value = TdoaCounts> {
    any::<[u32; 7]>().prop_map(|[hits, misses, stale, duplicates, evicted, gated, saturated]| TdoaCounts {
        hits,
        misses,
        stale,
        duplicates,
        evicted,
        gated,
        saturated,
    })
}

fn telemetry() -> impl Strategy<Value = Telemetry> {
    let srs = (clock_state(), tdoa_counts());
    (time(), phase(), option::of(id(MissionId)), any::<[u32; 6]>(), any::<u16>(), srs).prop_map(
        |(time, phase, mission, counts, battery_permille, (clock, tdoa))| Telemetry {
            time,
            phase,
            mission,
            sweep_phase_mm: counts[0],
            track_error_mm: counts[1],
            battery_permille,
            conditions: counts[5],
            frames_lost: counts[2],
            frames_rejected: counts[3],
            dropped: counts[4],
            clock,
            tdoa,
        },
    )
}

fn attached() -> impl Strategy<Value = Attached> {
    let user =
        (id32(UserId), any::<u16>()).prop_map(|(user, timing_advance)| AttachedUser { user, timing_advance });
    (time(), bounded::<_, MAX_ATTACHED_PER_FRAME>(user)).prop_map(|(time, users)| Attached { time, users })
}

fn tdoa_entry() -> impl Strategy<Value = TdoaEntry> + Clone {
    let mate = (id(DroneId), any::<i32>(), pos(), id(ToaSigma), any::<u8>()).prop_map(
        |(drone, tdoa, pos, sigma, flags)| MateTdoa {
            drone,
            tdoa: TdoaPs(tdoa),
            pos,
            sigma,
            flags: TdoaFlags(flags),
        },
    );
    let head = (id32(OccasionId), id32(UserId), time(), pos(), id(ToaSigma));
    (head, vec(mate, 0..=2)).prop_map(|((occasion, user, time, pos, sigma), mates)| TdoaEntry {
        occasion,
        user,
        time,
        pos,
        sigma,
        mates: mates.into_iter().collect(),
    })
}

fn event() -> impl Strategy<Value = Up> {
    use EventCode::{ConditionCleared, ConditionRaised, GoalReached, PhaseEntered, SweepDone};
    let code = proptest::sample::select(
        &[PhaseEntered, ConditionRaised, ConditionCleared, SweepDone, GoalReached][..],
    );
    (code, time(), any::<u32>()).prop_map(|(code, time, value)| Up::Event { code, time, value })
}

/// Any message of a drone to the control center.
pub(crate) fn up() -> impl Strategy<Value = Up> {
    let hello = (any::<[u8; 2]>(), any::<u32>(), any::<[u64; 2]>()).prop_map(
        |([version_min, version_max], schema_hash, [capture_ticks, capture_ps])| Up::Hello {
            version_min,
            version_max,
            schema_hash,
            capture_ticks,
            capture_ps,
        },
    );
    prop_oneof![
        hello,
        (id(CommandId), ack_status()).prop_map(|(command, status)| Up::CommandAck { command, status }),
        Just(Up::Heartbeat),
        state().prop_map(Up::SharedState),
        telemetry().prop_map(Up::Telemetry),
        attached().prop_map(Up::Attached),
        bounded::<_, MAX_TDOA_PER_FRAME>(tdoa_entry()).prop_map(Up::Tdoa),
        event(),
    ]
}

fn mission_header() -> impl Strategy<Value = MissionHeader> {
    let heading = proptest::sample::select(&[Heading::Fixed, Heading::AlongTrack][..]);
    let vertical = proptest::sample::select(&[Vertical::Level, Vertical::Free, Vertical::Preferred][..]);
    (
        (id(MissionId), option::of(id(FleetId)), any::<[u16; 3]>(), any::<u8>(), heading),
        (any::<[u32; 2]>(), any::<i16>(), any::<[u16; 4]>(), pos(), vertical),
    )
        .prop_map(
            |((mission, fleet, mates, slot, heading), (longs, orientation_mrad, shorts, home, vertical))| {
                MissionHeader {
                    mission,
                    fleet,
                    mates: mates.map(DroneId),
                    slot,
                    spacing_mm: longs[0],
                    heading,
                    orientation_mrad,
                    speed_mmps: shorts[0],
                    altitude_mm: longs[1],
                    home,
                    waypoints: shorts[1],
                    d_safe_mm: shorts[2],
                    walls: shorts[3],
                    vertical,
                }
            },
        )
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        mission_header().prop_map(Command::UploadBegin),
        (id(MissionId), any::<u32>())
            .prop_map(|(mission, lanes_crc)| Command::UploadCommit { mission, lanes_crc }),
        Just(Command::TakeOff),
        time().prop_map(|at| Command::StartSweep { at }),
        pos().prop_map(|target| Command::Place { target }),
        Just(Command::Hold),
        Just(Command::ReturnHome),
        any::<[u8; KEY_LEN]>().prop_map(|bytes| Command::Rekey(Key::new(bytes))),
        any::<[u8; KEY_LEN]>().prop_map(|bytes| Command::PeerKey(Key::new(bytes))),
    ]
}

fn lane_piece() -> impl Strategy<Value = LanePiece> {
    (id(MissionId), any::<u16>(), bounded::<_, MAX_LANE_PIECE>(any::<[i32; 2]>()))
        .prop_map(|(mission, first, waypoints_mm)| LanePiece { mission, first, waypoints_mm })
}

fn srs_request() -> impl Strategy<Value = SrsRequest> {
    let entry = (id32(UserId), id(DroneId)).prop_map(|(user, serving)| SrsRequestEntry { user, serving });
    (time(), time(), id32(OccasionId), bounded::<_, MAX_SRS_PER_REQUEST>(entry)).prop_map(
        |(start, spacing, first_occasion, entries)| SrsRequest { start, spacing, first_occasion, entries },
    )
}

/// Any message of the control center to a drone.
pub(crate) fn down() -> impl Strategy<Value = Down> {
    let neighbour = (id(DroneId), state()).prop_map(|(drone, state)| PeerState { drone, state });
    prop_oneof![
        any::<(u8, u32, bool)>().prop_map(|(version, schema_hash, resumes)| Down::Welcome {
            version,
            schema_hash,
            resumes
        }),
        Just(Down::Heartbeat),
        (id(CommandId), command()).prop_map(|(id, command)| Down::Command { id, command }),
        lane_piece().prop_map(Down::LanePiece),
        srs_request().prop_map(Down::SrsRequest),
        bounded::<_, MAX_PEERS_PER_FRAME>(neighbour).prop_map(Down::Peers),
    ]
}

/// Any message among fleet mates.
pub(crate) fn peer() -> impl Strategy<Value = Peer> {
    let capture = (id32(OccasionId), time(), pos(), id(ToaSigma), clock_state())
        .prop_map(|(occasion, toa, pos, sigma, clock)| CaptureEntry { occasion, toa, pos, sigma, clock });
    prop_oneof![
        bounded::<_, MAX_CAPTURES_PER_FRAME>(capture).prop_map(Peer::Captures),
        (time(), any::<i64>(), any::<u16>(), any::<u32>()).prop_map(
            |(time, phase_um, rate_mmps, track_error_mm)| Peer::SweepPhase {
                time,
                phase_um,
                rate_mmps,
                track_error_mm,
            }
        ),
    ]
}

/// Any message.
pub(crate) fn message() -> impl Strategy<Value = Message> {
    prop_oneof![up().prop_map(Message::Up), down().prop_map(Message::Down), peer().prop_map(Message::Peer)]
}

/// Any stamp.
pub(crate) fn stamp() -> impl Strategy<Value = Stamp> {
    (id(DroneId), any::<u16>(), any::<u32>()).prop_map(|(sender, boot_epoch, sequence)| Stamp {
        sender,
        boot_epoch,
        sequence,
    })
}

/// The frame of a message.
pub(crate) fn frame_of(stamp: &Stamp, message: &Message) -> Frame {
    match message {
        Message::Up(body) => encode(stamp, body),
        Message::Down(body) => encode(stamp, body),
        Message::Peer(body) => encode(stamp, body),
    }
    .expect("a frame holds every message")
}
