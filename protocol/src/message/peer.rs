//! Among the drones of a fleet.

use super::layout::wire;
use crate::units::{OccasionId, PosEnuMm, TimePs, ToaSigma};
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
            /// Distance of the sender from its slot, as far as the fleet should wait for it, millimetres.
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
        /// How well the receiver and its counter captured it; the clock's error is not in it.
        pub sigma: ToaSigma,
        /// The clock that `toa` was read off.
        pub clock: ClockState,
    }

    /// How a drone's clock stands to GNSS time.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub enum ClockState {
        /// It runs by itself, its offset unknown: there was never a pulse per second to discipline it.
        #[default]
        Free,
        /// Disciplined by the pulse per second.
        Locked {
            /// Standard deviation of its error, nanoseconds, rounded up; saturates.
            sigma_ns: u16,
        },
        /// Disciplined once; the pulses have failed.
        Held {
            /// Standard deviation of its error, nanoseconds, rounded up; saturates.
            sigma_ns: u16,
        },
    }
}

impl ClockState {
    /// Standard deviation of the clock's error, nanoseconds; none where nobody knows it.
    #[must_use]
    pub const fn sigma_ns(self) -> Option<u16> {
        match self {
            Self::Locked { sigma_ns } | Self::Held { sigma_ns } if sigma_ns < u16::MAX => Some(sigma_ns),
            _ => None,
        }
    }
}
