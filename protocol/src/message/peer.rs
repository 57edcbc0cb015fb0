//! Among the drones of a fleet.

use super::layout::wire;
use crate::units::{OccasionId, PosEnuMm, TimePs};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most captures in one frame.
pub const MAX_CAPTURES_PER_FRAME: usize = 5;

wire! {
    /// What a drone tells its fleet mates.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    pub enum Peer {
        /// Arrival times for the serving drone.
        Captures(Vec<CaptureEntry, MAX_CAPTURES_PER_FRAME>),
        /// Where the sender stands on the lanes.
        SweepPhase {
            /// When.
            time: TimePs,
            /// Way along the lanes, micrometres.
            phase_um: i64,
            /// Its rate, millimetres a second.
            rate_mmps: u16,
            /// Distance of the sender from its slot, millimetres.
            track_error_mm: u32,
        },
    }

    /// One captured arrival.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct CaptureEntry {
        /// The occasion.
        pub occasion: OccasionId,
        /// Arrival time by the sender's clock.
        pub toa: TimePs,
        /// Position of the sender at the arrival.
        pub pos: PosEnuMm,
    }
}
