//! Drone to control center.

use super::layout::wire;
use super::peer::ClockState;
use crate::units::{
    CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId,
    VelEnuMmps,
};
use core::ops::BitOr;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most users in one [`Attached`] page.
pub const MAX_ATTACHED_PER_FRAME: usize = 24;
/// Most occasions in one TDOA report.
pub const MAX_TDOA_PER_FRAME: usize = 2;

wire! {
    /// What a drone tells the control center.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    pub enum Up {
        /// First word after boot, repeated until answered by [`Down::Welcome`](super::Down::Welcome).
        Hello {
            /// Oldest protocol version the drone speaks.
            version_min: u8,
            /// Newest protocol version the drone speaks.
            version_max: u8,
            /// Hash over the shapes of all messages: equal hashes read each other's bytes.
            schema_hash: u32,
            /// Ticks of the drone's SRS capture timer in `capture_ps` picoseconds: a ratio, since neither of the two
            /// need be whole a second or a tick.
            capture_ticks: u64,
            /// The time that `capture_ticks` take, picoseconds.
            capture_ps: u64,
        },
        /// Answer to every command, once executed or refused.
        CommandAck {
            /// The command answered.
            command: CommandId,
            /// What became of it.
            status: AckStatus,
        },
        /// The link is alive; sent when nothing else was for a while.
        Heartbeat,
        /// Position and velocity for everybody's collision avoidance.
        SharedState(SharedState),
        /// State of the vehicle for the operator.
        Telemetry(Telemetry),
        /// Users that the drone's cell hears.
        Attached(Attached),
        /// Differences of arrival time, formed by the serving drone.
        Tdoa(Vec<TdoaEntry, MAX_TDOA_PER_FRAME>),
        /// Something happened that the operator should know.
        Event {
            /// What.
            code: EventCode,
            /// When.
            time: TimePs,
            /// Meaning depends on the code (see [`EventCode`]).
            value: u32,
        },
    }

    /// Position and velocity at a time, with the radius of the disk (a ball in 3D) that the true
    /// position lies in (the paper's `r_s`).
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct SharedState {
        /// When the state was measured.
        pub time: TimePs,
        /// Position.
        pub pos: PosEnuMm,
        /// Velocity.
        pub vel: VelEnuMmps,
        /// Error radius of the position, millimetres.
        pub error_radius_mm: u16,
        /// How it flies.
        pub manner: Manner,
    }

    /// What became of a command.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub enum AckStatus {
        /// Done, or begun where it takes time.
        Accepted,
        /// Lane pieces are missing; the first missing waypoint index follows.
        Incomplete {
            /// Index of the first missing waypoint.
            first_missing: u16,
        },
        /// Not possible in the present phase.
        WrongPhase,
        /// A value is out of the range this drone can fly.
        OutOfRange,
        /// The supervisor has taken over and refuses.
        Overridden,
    }

    /// Phase of the flight as the drone sees it.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
    pub enum FlightPhase {
        /// On the ground, motors off.
        #[default]
        Grounded,
        /// Climbing above the pad.
        TakeOff,
        /// Holding a position.
        Hold,
        /// Flying the lanes in formation.
        Sweep,
        /// Flying to a placement.
        GoTo,
        /// At the placement, serving users.
        Serve,
        /// Flying back to the pad, commanded or by the supervisor.
        ReturnHome,
        /// Descending above the pad.
        Landing,
    }

    /// State of the vehicle for the operator, about once a second.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct Telemetry {
        /// When.
        pub time: TimePs,
        /// Phase of the flight.
        pub phase: FlightPhase,
        /// Mission in force, if any.
        pub mission: Option<MissionId>,
        /// Sweep phase: way flown along the lanes, millimetres.
        pub sweep_phase_mm: u32,
        /// Distance from the slot or goal, millimetres.
        pub track_error_mm: u32,
        /// Charge left, per mille.
        pub battery_permille: u16,
        /// Supervisor conditions in force, one bit each (`firmware::supervisor`).
        pub conditions: u32,
        /// Frames lost on the way down, counted from gaps in the sequence.
        pub frames_lost: u32,
        /// Frames refused by the decoder.
        pub frames_rejected: u32,
        /// Everything else the agent had to drop, clamp or refuse since boot.
        pub dropped: u32,
        /// The clock that arrival times are read off.
        pub clock: ClockState,
        /// What became of the captures of the users that the drone serves.
        pub tdoa: TdoaCounts,
    }

    /// What became of the captures of users that a drone serves, since boot; every count saturates.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    pub struct TdoaCounts {
        /// Differences formed.
        pub hits: u32,
        /// Differences not formed: the mate's capture did not come in time.
        pub misses: u32,
        /// Captures of mates dropped: the own one did not come in time.
        pub stale: u32,
        /// Captures dropped: the same drone had captured the occasion already, or both mates had.
        pub duplicates: u32,
        /// Occasions dropped for newer ones before they were reported.
        pub evicted: u32,
        /// Differences greater than any place of the user explains, reported and flagged.
        pub gated: u32,
        /// Differences clamped to 32 bits, reported and flagged.
        pub saturated: u32,
    }

    /// One page of the users that the drone's cell hears.
    #[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct Attached {
        /// When they were heard.
        pub time: TimePs,
        /// The users of this page.
        pub users: Vec<AttachedUser, MAX_ATTACHED_PER_FRAME>,
    }

    /// A user that the cell hears.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct AttachedUser {
        /// Who.
        pub user: UserId,
        /// One-way distance from the timing advance, in units of its step (39 m at 30 kHz subcarriers,
        /// TS 38.213 4.2).
        pub timing_advance: u16,
    }

    /// One SRS occasion at the serving drone: the differences of its fleet mates' arrival times to its own.
    #[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct TdoaEntry {
        /// The occasion.
        pub occasion: OccasionId,
        /// The user that transmitted.
        pub user: UserId,
        /// Arrival at the serving drone by its own clock.
        pub time: TimePs,
        /// Position of the serving drone at the arrival.
        pub pos: PosEnuMm,
        /// How well the serving drone captured it; its clock's error is not in it.
        pub sigma: ToaSigma,
        /// Fleet mates that captured the same transmission.
        pub mates: Vec<MateTdoa, 2>,
    }

    /// Difference of arrival time of one fleet mate to the serving drone.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub struct MateTdoa {
        /// The fleet mate.
        pub drone: DroneId,
        /// Its arrival time by its own clock less the serving drone's by its own.
        pub tdoa: TdoaPs,
        /// Its position at the arrival.
        pub pos: PosEnuMm,
        /// How well it captured the arrival, for itself; its clock's error is not in it.
        pub sigma: ToaSigma,
        /// What to know about the value.
        pub flags: TdoaFlags,
    }

    /// What an event says.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
    pub enum EventCode {
        /// Entered a phase of flight; value: the phase's number.
        PhaseEntered,
        /// A supervisor condition came up; value: its bit number.
        ConditionRaised,
        /// A supervisor condition cleared; value: its bit number.
        ConditionCleared,
        /// The lanes are flown; value: seconds since their start.
        SweepDone,
        /// At the commanded goal; value: distance to it in millimetres.
        GoalReached,
    }
}

/// How a drone flies, as far as others must know to avoid it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manner(pub u8);

impl Manner {
    /// For itself: it gives way and so do others.
    pub const ALONE: Self = Self(0);
    /// It cannot manoeuvre as it would have to: all others give way.
    pub const UNABLE: Self = Self(u8::MAX);

    /// In formation: its fleet gives way as one body. Fleets beyond the 254th are not told apart, and fly alone.
    #[must_use]
    pub const fn formation(fleet: FleetId) -> Self {
        if fleet.0 < 254 { Self(fleet.0 as u8 + 1) } else { Self::ALONE }
    }

    /// The formation that it is part of.
    #[must_use]
    pub const fn fleet(self) -> Option<FleetId> {
        if self.0 == Self::ALONE.0 || self.0 == Self::UNABLE.0 {
            None
        } else {
            Some(FleetId(self.0 as u16 - 1))
        }
    }
}

impl TdoaCounts {
    /// Nothing counted yet.
    pub const NONE: Self =
        Self { hits: 0, misses: 0, stale: 0, duplicates: 0, evicted: 0, gated: 0, saturated: 0 };
}

/// What to know about a TDOA value; no bit set means nothing special.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TdoaFlags(pub u8);

impl TdoaFlags {
    /// The difference did not fit 32 bits and was clamped.
    pub const SATURATED: Self = Self(1);
    /// The difference is greater than the distance of the two drones explains, by more than both clocks are
    /// stated to be off: one of the two captures is late, the mate's where the difference is positive.
    pub const GATED: Self = Self(2);
    /// One of the two clocks runs free, so that nothing can be said of the difference by itself.
    pub const UNJUDGED: Self = Self(4);
    /// One of the two clocks has lost its pulses.
    pub const HELD: Self = Self(8);

    /// Whether all bits of `other` are set here.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl BitOr for TdoaFlags {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl FlightPhase {
    /// All phases; each has its place as its number in events.
    pub const ALL: [Self; 8] = [
        Self::Grounded,
        Self::TakeOff,
        Self::Hold,
        Self::Sweep,
        Self::GoTo,
        Self::Serve,
        Self::ReturnHome,
        Self::Landing,
    ];

    /// The phase of that number, as [`EventCode::PhaseEntered`] tells it.
    #[must_use]
    pub fn numbered(number: u32) -> Option<Self> {
        Self::ALL.get(usize::try_from(number).ok()?).copied()
    }
}
