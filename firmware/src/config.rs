//! What an agent is born with; everything else it is told by mission upload.

use crate::srs::{clock::TickRate, discipline::Oscillator};
use skyroost_protocol::units::{DroneId, TimePs};

/// The capture timer counts samples of the baseband: a tick of 2 T_c, the finest grid that UL-RTOA is
/// reported on (TS 38.133 13.1).
const BASEBAND_RATE: TickRate = match TickRate::new(983_040_000) {
    Ok(rate) => rate,
    Err(_) => unreachable!(),
};

/// A temperature-compensated oscillator of a cell and a timing receiver: 25 ppm at most, a tenth of a nanosecond over a
/// second, 0.1 ps a second every second; pulses within 20 ns.
const BASEBAND: Oscillator = Oscillator {
    rate: BASEBAND_RATE,
    tolerance_ppb: 25_000,
    walk_ps: 100,
    wander_fs_per_s2: 100,
    pulse_ps: 20_000,
};

/// What a drone without a mission keeps from everybody, metres: the paper's `d_safe`, which missions have unless their scenario says
/// otherwise. Only a board that starts anew in the air flies without one.
const D_SAFE_M: f32 = 10.0;

/// Constants of one drone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgentConfig {
    /// Who this drone is.
    pub id: DroneId,
    /// Counts boots from 1, so that sequence numbers never repeat.
    pub boot_epoch: u16,
    /// What the SRS capture timer counts, and the pulses that discipline it.
    pub oscillator: Oscillator,
    /// Symbols that an SRS is repeated over: 1, 2 or 4.
    pub srs_symbols: u8,
    /// Time between two states shared for avoidance.
    pub share_period: TimePs,
    /// Bytes a second that the link to the control center takes; 0 for any number. Where it takes less than it wants to say, what keeps
    /// drones apart goes first, then what it measures, then telemetry.
    pub uplink_bytes_per_s: u32,
    /// Separation to keep from everybody as long as there is no mission to say it, metres.
    pub d_safe_m: f32,
    /// What the airframe can do.
    pub limits: FlightLimits,
    /// When the supervisor steps in.
    pub supervisor: SupervisorConfig,
}

impl AgentConfig {
    /// Defaults for the drone `id`, booted for the first time.
    #[must_use]
    pub const fn new(id: DroneId) -> Self {
        Self {
            id,
            boot_epoch: 1,
            oscillator: BASEBAND,
            srs_symbols: 1,
            share_period: TimePs::from_ms(100),
            uplink_bytes_per_s: 0,
            d_safe_m: D_SAFE_M,
            limits: FlightLimits::COPTER,
            supervisor: SupervisorConfig::USUAL,
        }
    }
}

/// What the airframe can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightLimits {
    /// Greatest horizontal speed that may be commanded, metres a second.
    pub max_speed_mps: f32,
    /// Greatest acceleration, metres a second squared.
    pub max_accel_mps2: f32,
    /// Greatest climb or descent, metres a second.
    pub max_vertical_mps: f32,
}

impl FlightLimits {
    /// Those of a small multicopter.
    pub const COPTER: Self = Self { max_speed_mps: 12.0, max_accel_mps2: 3.0, max_vertical_mps: 3.0 };
}

impl Default for FlightLimits {
    fn default() -> Self {
        Self::COPTER
    }
}

/// When the supervisor steps in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupervisorConfig {
    /// Silence of the control center after which the operator is warned, milliseconds.
    pub link_warn_ms: u32,
    /// Silence after which the drone stops and holds, milliseconds.
    pub link_hold_ms: u32,
    /// Silence after which the drone returns home, milliseconds.
    pub link_return_ms: u32,
    /// Time without a navigation solution after which it counts as lost, milliseconds.
    pub nav_lost_ms: u32,
    /// Charge below which the drone returns home, per mille.
    pub battery_low_permille: u16,
    /// Charge below which it lands where it is, per mille.
    pub battery_critical_permille: u16,
    /// Silence of a fleet mate on the lanes after which it counts as lost, milliseconds.
    pub mate_lost_ms: u32,
    /// Time without a navigation solution after which the drone lands blind, milliseconds.
    pub nav_gone_ms: u16,
    /// Error radius of navigation above which the operator is warned, millimetres.
    pub nav_error_mm: u16,
    /// Charge below which the operator is warned, per mille.
    pub battery_warn_permille: u16,
    /// Distance from fence and obstacles, beyond the own error radius, below which the operator is warned, millimetres.
    pub fence_near_mm: u16,
    /// Velocity lacking because of wind above which the operator is warned, millimetres a second.
    pub wind_warn_mmps: u16,
    /// Velocity lacking above which the drone returns home, millimetres a second.
    pub wind_act_mmps: u16,
}

impl SupervisorConfig {
    /// What suits links of some kilometres and a battery that lasts a mission.
    pub const USUAL: Self = Self {
        link_warn_ms: 2_000,
        link_hold_ms: 10_000,
        link_return_ms: 60_000,
        nav_lost_ms: 500,
        battery_low_permille: 150,
        battery_critical_permille: 50,
        mate_lost_ms: 1_600,
        nav_gone_ms: 10_000,
        nav_error_mm: 10_000,
        battery_warn_permille: 250,
        fence_near_mm: 2_000,
        wind_warn_mmps: 2_000,
        wind_act_mmps: 4_000,
    };
}

impl Default for SupervisorConfig {
    fn default() -> Self {
        Self::USUAL
    }
}
