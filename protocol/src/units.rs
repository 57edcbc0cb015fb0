//! Identifiers and integer units of everything on the wire.
//!
//! Wire times are integers: [`TimePs`] counts picoseconds in 64 bits (±106 days), [`TdoaPs`]
//! picoseconds in 32 bits (±2.1 ms, or ±640 km of path difference). Positions are whole millimetres
//! in the mission's local east-north-up frame (±2,147 km), so that no rounding differs between the
//! host and a board.

use serde::{Deserialize, Serialize};

/// Most drones one control center can steer: ids run from 1 to this number.
pub const MAX_DRONES: u16 = 4096;

/// A drone, numbered from 1; 0 never names a drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct DroneId(pub u16);

impl DroneId {
    /// The control center as a sender or receiver.
    pub const CONTROL: Self = Self(0);
}

/// A fleet of three drones, numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct FleetId(pub u16);

/// A user (mobile station) as the radio network names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct UserId(pub u32);

/// One SRS occasion: one transmission of one user, unique within a mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct OccasionId(pub u32);

/// A command of the control center that a drone acknowledges, numbered per drone from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct CommandId(pub u16);

/// A mission upload; pieces of different uploads never mix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct MissionId(pub u16);

/// A time or a duration in picoseconds; as a time, since the mission's epoch (GNSS time).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TimePs(pub i64);

/// Picoseconds in a microsecond.
const PS_PER_US: i64 = 1_000_000;

impl TimePs {
    /// From microseconds; saturates beyond ±106 days.
    #[must_use]
    pub const fn from_us(us: i64) -> Self {
        Self(us.saturating_mul(PS_PER_US))
    }

    /// From milliseconds; saturates beyond ±106 days.
    #[must_use]
    pub const fn from_ms(ms: i64) -> Self {
        Self(ms.saturating_mul(1000 * PS_PER_US))
    }

    /// Whole microseconds, rounded down.
    #[must_use]
    pub const fn as_us(self) -> i64 {
        self.0.div_euclid(PS_PER_US)
    }

    /// `self - earlier`, saturating.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Self {
        Self(self.0.saturating_sub(earlier.0))
    }

    /// `self + duration`, saturating.
    #[must_use]
    pub const fn after(self, duration: Self) -> Self {
        Self(self.0.saturating_add(duration.0))
    }

    /// A short duration in seconds (the exactness of `f32`: 24 bits).
    #[must_use]
    pub const fn as_secs_f32(self) -> f32 {
        self.0 as f32 * 1e-12
    }
}

/// A time difference of arrival in picoseconds (1 ps = 0.3 mm of path).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TdoaPs(pub i32);

/// Standard deviation of an arrival time in steps of 8 ps, 2.4 mm of path: up to 524 ns, where it saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ToaSigma(pub u16);

impl ToaSigma {
    const STEP_PS: u32 = 8;

    /// From picoseconds, rounded up.
    #[must_use]
    pub const fn from_ps(ps: u32) -> Self {
        let steps = ps.div_ceil(Self::STEP_PS);
        Self(if steps > u16::MAX as u32 { u16::MAX } else { steps as u16 })
    }

    /// In picoseconds.
    #[must_use]
    pub const fn ps(self) -> u32 {
        self.0 as u32 * Self::STEP_PS
    }
}

/// A position in millimetres: east, north, up from the mission's origin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct PosEnuMm(pub [i32; 3]);

/// A velocity in millimetres a second: east, north, up; saturates at 32.767 m/s each way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct VelEnuMmps(pub [i16; 3]);

impl VelEnuMmps {
    /// From metres a second, rounded; NaN becomes 0.
    #[must_use]
    pub fn from_mps(mps: [f32; 3]) -> Self {
        Self(mps.map(|v| mm_from_m(v).clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16))
    }

    /// In metres a second.
    #[must_use]
    pub fn mps(self) -> [f32; 3] {
        self.0.map(|v| m_from_mm(i32::from(v)))
    }
}

/// Metres to millimetres, rounded half away from zero, saturating; NaN becomes 0.
#[must_use]
pub fn mm_from_m(metres: f32) -> i32 {
    let mm = metres * 1000.0;
    // `as` saturates and maps NaN to zero; adding the half first rounds.
    (if mm < 0.0 { mm - 0.5 } else { mm + 0.5 }) as i32
}

/// Millimetres to metres.
#[must_use]
pub const fn m_from_mm(mm: i32) -> f32 {
    mm as f32 * 1e-3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_round_up_and_saturate() {
        for (ps, steps) in
            [(0, 0), (1, 1), (8, 1), (9, 2), (5_001, 626), (524_280, 65_535), (u32::MAX, 65_535)]
        {
            assert_eq!(ToaSigma::from_ps(ps), ToaSigma(steps), "{ps} ps");
        }
        assert_eq!(ToaSigma(626).ps(), 5_008);
    }
}
