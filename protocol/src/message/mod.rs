//! The messages, by direction: [`Up`] drone to control center, [`Down`] control center to drone,
//! [`Peer`] among fleet mates.
//!
//! Every container is bounded, so the largest encoding of every message is known when the crate is
//! compiled. The order of variants and fields is the order on the wire: additions go to the end and raise
//! [`PROTOCOL_VERSION`](crate::PROTOCOL_VERSION), and the byte-golden tests say so when one moves.

mod checksum;
mod down;
mod layout;
mod peer;
mod up;

pub use checksum::lanes_crc;
pub use down::{
    Command, Down, Heading, LanePiece, MAX_LANE_PIECE, MAX_PEERS_PER_FRAME, MAX_SRS_PER_REQUEST,
    MAX_WAYPOINTS, MissionHeader, PeerState, SrsRequest, SrsRequestEntry, Vertical, WAYPOINTS_PER_WALL,
};
pub use layout::SCHEMA_HASH;
pub(crate) use layout::{Layout, longest};
pub use peer::{CaptureEntry, ClockState, MAX_CAPTURES_PER_FRAME, Peer};
pub use up::{
    AckStatus, Attached, AttachedUser, EventCode, FlightPhase, MAX_ATTACHED_PER_FRAME, MAX_TDOA_PER_FRAME,
    Manner, MateTdoa, SharedState, TdoaCounts, TdoaEntry, TdoaFlags, Telemetry, Up,
};
