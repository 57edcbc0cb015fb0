//! Control center to drone.

use super::layout::wire;
use super::up::SharedState;
use crate::key::Key;
use crate::units::{CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TimePs, UserId};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most waypoints of a mission: of its lanes and its walls together.
pub const MAX_WAYPOINTS: usize = 512;
/// Waypoints that stand for one wall.
pub const WAYPOINTS_PER_WALL: usize = 3;
/// Most waypoints in one lane piece.
pub const MAX_LANE_PIECE: usize = 16;
/// Most neighbours in one frame of relayed states.
pub const MAX_PEERS_PER_FRAME: usize = 5;
/// Most occasions in one SRS request.
pub const MAX_SRS_PER_REQUEST: usize = 12;

wire! {
    /// What the control center tells a drone.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    pub enum Down {
        /// Answer to a hello: the version both will speak from here on.
        Welcome {
            /// Protocol version chosen.
            version: u8,
            /// The control center's schema hash.
            schema_hash: u32,
            /// Whether the numbers of its commands go on where those of its boot before ended. Otherwise they begin anew.
            resumes: bool,
        },
        /// The link is alive.
        Heartbeat,
        /// Something to do; answered by [`Up::CommandAck`](super::Up::CommandAck) and repeated until then.
        Command {
            /// Its number; a number seen before is acknowledged again and not executed again.
            id: CommandId,
            /// What to do.
            command: Command,
        },
        /// A piece of the lanes of an announced mission; not acknowledged one by one.
        LanePiece(LanePiece),
        /// Users to be asked for their SRS.
        SrsRequest(SrsRequest),
        /// States of the nearest other drones.
        Peers(Vec<PeerState, MAX_PEERS_PER_FRAME>),
    }

    /// Commands, each acknowledged.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    pub enum Command {
        /// Announces a mission; its lane pieces follow. It takes the room of the lanes there were: until it
        /// is committed there is nothing to sweep.
        UploadBegin(MissionHeader),
        /// All pieces were sent: check and make ready.
        UploadCommit {
            /// The mission announced.
            mission: MissionId,
            /// CRC-32 over the waypoints, each as little-endian `i32` east and north.
            lanes_crc: u32,
        },
        /// Climb above the pad to the mission's altitude and hold.
        TakeOff,
        /// Start the lanes at this time, all drones of the fleet together.
        StartSweep {
            /// When the sweep phase begins to run.
            at: TimePs,
        },
        /// Fly to a placement and serve there.
        Place {
            /// The placement, the drone's altitude included.
            target: PosEnuMm,
        },
        /// Stop and hold.
        Hold,
        /// Go back to the pad and land.
        ReturnHome,
        /// The key that this link is sealed with after the first frame that comes under it.
        Rekey(Key),
        /// The key that the frames of fleet mates are sealed with from now on.
        PeerKey(Key),
    }

    /// What a drone must know of a mission besides the lanes.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct MissionHeader {
        /// The mission.
        pub mission: MissionId,
        /// The fleet, none for a reserve that joins in stage two.
        pub fleet: Option<FleetId>,
        /// The three drones of the fleet, by slot; unused for a reserve.
        pub mates: [DroneId; 3],
        /// Own slot in the triangle, 0 to 2.
        pub slot: u8,
        /// Side of the triangle (the paper's `d`), millimetres.
        pub spacing_mm: u32,
        /// How the triangle turns.
        pub heading: Heading,
        /// Direction of the triangle's slot 0 from its centre, milliradians from east, anticlockwise.
        pub orientation_mrad: i16,
        /// Cruise speed, millimetres a second.
        pub speed_mmps: u16,
        /// Altitude of flight, millimetres.
        pub altitude_mm: u32,
        /// Where the drone took off and returns to.
        pub home: PosEnuMm,
        /// Number of waypoints that follow in pieces, those of the walls included.
        pub waypoints: u16,
        /// Separation to keep from every other drone (the paper's `d_safe`), millimetres.
        pub d_safe_mm: u16,
        /// Number of walls: the last waypoints, [`WAYPOINTS_PER_WALL`] for each. The first two are the ends of a
        /// segment; the third is no place but a radius and a top: the wall is all that is within the radius of the
        /// segment, from the ground up to the top, millimetres.
        pub walls: u16,
        /// Whether to give way up and down.
        pub vertical: Vertical,
    }

    /// How gladly drones give way up and down, rather than to the side.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Vertical {
        /// Never: the altitude is left to guidance.
        Level,
        /// As gladly as to the side.
        Free,
        /// More gladly: a metre to the side counts for one and a half up or down.
        #[default]
        Preferred,
    }

    /// How the formation turns.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub enum Heading {
        /// The triangle keeps its orientation: the same offset for every drone, also through corners.
        #[default]
        Fixed,
        /// The triangle turns with the track.
        AlongTrack,
    }

    /// A bounded piece of a mission's lanes: the way of the formation's centre.
    #[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct LanePiece {
        /// The mission.
        pub mission: MissionId,
        /// Index of the first waypoint of this piece.
        pub first: u16,
        /// East and north of each waypoint, millimetres.
        pub waypoints_mm: Vec<[i32; 2], MAX_LANE_PIECE>,
    }

    /// Users to be asked for one SRS each.
    #[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct SrsRequest {
        /// Transmission time of the first entry.
        pub start: TimePs,
        /// Time from one entry's transmission to the next one's.
        pub spacing: TimePs,
        /// Occasion of the first entry; the others count up from it.
        pub first_occasion: OccasionId,
        /// Whom to ask.
        pub entries: Vec<SrsRequestEntry, MAX_SRS_PER_REQUEST>,
    }

    /// One user to be asked.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct SrsRequestEntry {
        /// Who.
        pub user: UserId,
        /// The drone that grants the transmission and forms the differences.
        pub serving: DroneId,
    }

    /// A neighbour's shared state as relayed.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct PeerState {
        /// The neighbour.
        pub drone: DroneId,
        /// Its state, with the time of its own measurement.
        pub state: SharedState,
    }
}
