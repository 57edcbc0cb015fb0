//! The bus of a board: what its flight code senses and does, as messages on a byte link.
//!
//! On the bus the host takes the places of autopilot, cell and radio (hardware in the loop): it sends what
//! the drone senses in a step, has the step done, and hears what the drone wants done. The radio's bytes
//! travel along, exactly as they cross the radio ([`skyroost_protocol::stream`]), in messages of their own.
//!
//! A message is [postcard](https://postcard.jamesmunns.com/wire-format) in a frame of the same byte link:
//! COBS, CRC-32, a zero on both sides. Numbers keep all their bits, those of a NaN as well.
//!
//! # A step over a link that loses frames
//! The inputs of a step are one [`ToBoard::Step`] and, before it, as many numbered [`ToBoard::Sense`] as it
//! says. The board takes parts in their order only. When the step comes and parts are missing, it names the
//! first missing one ([`FromBoard::Missing`]), and the host sends from there. When all are there the step is
//! done, once, and answered by numbered [`FromBoard::Act`] and a [`FromBoard::Done`]. The host repeats the step
//! until it has the whole answer, saying how much of it has arrived; the board repeats the rest. So nothing
//! is lost, nothing is done twice, and the board needs no clock for it: whatever a damaged link does, the
//! flight is the same to the bit.

#[cfg(test)]
mod tests;

use crate::{
    Vec3,
    config::{AgentConfig, FlightLimits, SupervisorConfig},
    counters::Counters,
    io::{Capture, NavFix, Pulse, Setpoint, SrsGate},
    srs::{clock::TickRate, discipline::Oscillator},
};
use heapless::Vec;
use serde::{Deserialize, Serialize, Serializer};
use skyroost_protocol::{
    key::Key,
    message::AttachedUser,
    stream::{StreamFrame, encode_stream_with},
    units::{DroneId, OccasionId, TimePs, ToaSigma, UserId},
};

/// Version of the bus; with the radio's schema hash it says whether host and image understand each other.
pub const BUS_VERSION: u16 = 6;

/// Most bytes of the radio in one message.
pub const MAX_RADIO_PART: usize = 200;
/// Most captures in one message.
pub const MAX_CAPTURES_PART: usize = 8;
/// Most users heard in one message.
pub const MAX_ATTACHED_PART: usize = 8;
/// Most gates in one message.
pub const MAX_GATES_PART: usize = 4;

/// Host to board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToBoard<'a> {
    /// Forget everything and be the drone of this configuration.
    Begin(Begin),
    /// Part `index` of what is sensed in step `step`.
    Sense {
        /// Number of the step.
        step: u32,
        /// Number of the part in the step, from 0.
        index: u16,
        /// The part.
        #[serde(borrow)]
        part: SensePart<'a>,
    },
    /// Do step `step` once all its parts are there; answer from part `have` on.
    Step {
        /// Number of the step: one more than that of the step before, from 1.
        step: u32,
        /// Parts that belong to it.
        parts: u16,
        /// Parts of the answer that have arrived already.
        have: u16,
        /// Tells apart the requests for one step; the answer repeats it, so that answers to requests given up
        /// do not start others.
        attempt: u8,
        /// What fits every step.
        head: StepHead,
    },
    /// Say how you fared.
    Report,
}

/// How a drone is born on the bus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Begin {
    /// The host's [`BUS_VERSION`].
    pub bus_version: u16,
    /// The host's [`SCHEMA_HASH`](skyroost_protocol::SCHEMA_HASH).
    pub schema_hash: u32,
    /// Bytes of the radio in a message of the answer, at most [`MAX_RADIO_PART`]: few where the link damages
    /// bytes.
    pub radio_part: u8,
    /// The drone.
    pub config: WireConfig,
    /// The root key of its link to the control center; none where nothing is sealed.
    pub key: Option<Key>,
}

/// [`AgentConfig`] as it crosses the bus.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WireConfig {
    id: DroneId,
    boot_epoch: u16,
    capture_ticks: u64,
    capture_ps: u64,
    tolerance_ppb: u32,
    walk_ps: u32,
    wander_fs_per_s2: u32,
    pulse_ps: u32,
    srs_symbols: u8,
    share_period: TimePs,
    uplink_bytes_per_s: u32,
    d_safe_m: f32,
    max_speed_mps: f32,
    max_accel_mps2: f32,
    max_vertical_mps: f32,
    link_warn_ms: u32,
    link_hold_ms: u32,
    link_return_ms: u32,
    nav_lost_ms: u32,
    battery_low_permille: u16,
    battery_critical_permille: u16,
    mate_lost_ms: u32,
    nav_gone_ms: u16,
    nav_error_mm: u16,
    battery_warn_permille: u16,
    fence_near_mm: u16,
    wind_warn_mmps: u16,
    wind_act_mmps: u16,
}

impl From<&AgentConfig> for WireConfig {
    fn from(config: &AgentConfig) -> Self {
        // Named in full, so that a new constant cannot be forgotten.
        let AgentConfig {
            id,
            boot_epoch,
            oscillator,
            srs_symbols,
            share_period,
            uplink_bytes_per_s,
            d_safe_m,
            limits,
            supervisor,
        } = *config;
        let Oscillator { rate, tolerance_ppb, walk_ps, wander_fs_per_s2, pulse_ps } = oscillator;
        let FlightLimits { max_speed_mps, max_accel_mps2, max_vertical_mps } = limits;
        let SupervisorConfig {
            link_warn_ms,
            link_hold_ms,
            link_return_ms,
            nav_lost_ms,
            battery_low_permille,
            battery_critical_permille,
            mate_lost_ms,
            nav_gone_ms,
            nav_error_mm,
            battery_warn_permille,
            fence_near_mm,
            wind_warn_mmps,
            wind_act_mmps,
        } = supervisor;
        let (capture_ticks, capture_ps) = rate.ratio();
        Self {
            id,
            boot_epoch,
            capture_ticks,
            capture_ps,
            tolerance_ppb,
            walk_ps,
            wander_fs_per_s2,
            pulse_ps,
            srs_symbols,
            share_period,
            uplink_bytes_per_s,
            d_safe_m,
            max_speed_mps,
            max_accel_mps2,
            max_vertical_mps,
            link_warn_ms,
            link_hold_ms,
            link_return_ms,
            nav_lost_ms,
            battery_low_permille,
            battery_critical_permille,
            mate_lost_ms,
            nav_gone_ms,
            nav_error_mm,
            battery_warn_permille,
            fence_near_mm,
            wind_warn_mmps,
            wind_act_mmps,
        }
    }
}

impl WireConfig {
    /// The configuration; none when the capture timer does not tick.
    #[must_use]
    pub fn agent_config(&self) -> Option<AgentConfig> {
        Some(AgentConfig {
            id: self.id,
            boot_epoch: self.boot_epoch,
            oscillator: Oscillator {
                rate: TickRate::of_ticks(self.capture_ticks, self.capture_ps).ok()?,
                tolerance_ppb: self.tolerance_ppb,
                walk_ps: self.walk_ps,
                wander_fs_per_s2: self.wander_fs_per_s2,
                pulse_ps: self.pulse_ps,
            },
            srs_symbols: self.srs_symbols,
            share_period: self.share_period,
            uplink_bytes_per_s: self.uplink_bytes_per_s,
            d_safe_m: self.d_safe_m,
            limits: FlightLimits {
                max_speed_mps: self.max_speed_mps,
                max_accel_mps2: self.max_accel_mps2,
                max_vertical_mps: self.max_vertical_mps,
            },
            supervisor: SupervisorConfig {
                link_warn_ms: self.link_warn_ms,
                link_hold_ms: self.link_hold_ms,
                link_return_ms: self.link_return_ms,
                nav_lost_ms: self.nav_lost_ms,
                battery_low_permille: self.battery_low_permille,
                battery_critical_permille: self.battery_critical_permille,
                mate_lost_ms: self.mate_lost_ms,
                nav_gone_ms: self.nav_gone_ms,
                nav_error_mm: self.nav_error_mm,
                battery_warn_permille: self.battery_warn_permille,
                fence_near_mm: self.fence_near_mm,
                wind_warn_mmps: self.wind_warn_mmps,
                wind_act_mmps: self.wind_act_mmps,
            },
        })
    }
}

/// What is sensed in every step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepHead {
    /// GNSS time since the mission's epoch.
    pub now: TimePs,
    /// The navigation solution, if there is one.
    pub nav: Option<WireNav>,
    /// Whether the vehicle flies.
    pub in_air: bool,
    /// Value of the capture timer.
    pub timer_ticks: u32,
    /// The pulse per second, if there was one.
    pub pulse: Option<WirePulse>,
    /// Charge of the battery, per mille.
    pub battery_permille: u16,
}

/// [`Pulse`] as it crosses the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WirePulse {
    ticks: u32,
    second: i32,
}

impl From<Pulse> for WirePulse {
    fn from(Pulse { ticks, second }: Pulse) -> Self {
        Self { ticks, second }
    }
}

impl From<WirePulse> for Pulse {
    fn from(WirePulse { ticks, second }: WirePulse) -> Self {
        Self { ticks, second }
    }
}

/// [`NavFix`] as it crosses the bus.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WireNav {
    pos_enu_m: [f32; 3],
    vel_enu_mps: [f32; 3],
    error_radius_m: f32,
}

impl From<NavFix> for WireNav {
    fn from(fix: NavFix) -> Self {
        let NavFix { pos_enu_m, vel_enu_mps, error_radius_m } = fix;
        Self { pos_enu_m: pos_enu_m.into(), vel_enu_mps: vel_enu_mps.into(), error_radius_m }
    }
}

impl From<WireNav> for NavFix {
    fn from(fix: WireNav) -> Self {
        let WireNav { pos_enu_m, vel_enu_mps, error_radius_m } = fix;
        Self { pos_enu_m: pos_enu_m.into(), vel_enu_mps: vel_enu_mps.into(), error_radius_m }
    }
}

/// What only some steps sense.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SensePart<'a> {
    /// Bytes that came over the radio, at most [`MAX_RADIO_PART`]; a frame may go on in the next part.
    Radio(#[serde(serialize_with = "as_bytes")] &'a [u8]),
    /// Captures of the SRS timer.
    Captures(Vec<WireCapture, MAX_CAPTURES_PART>),
    /// Users that the cell hears.
    Attached(Vec<AttachedUser, MAX_ATTACHED_PART>),
}

/// [`Capture`] as it crosses the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WireCapture {
    occasion: OccasionId,
    ticks: u32,
    symbol: u8,
    sigma: ToaSigma,
}

impl From<Capture> for WireCapture {
    fn from(Capture { occasion, ticks, symbol, sigma }: Capture) -> Self {
        Self { occasion, ticks, symbol, sigma }
    }
}

impl From<WireCapture> for Capture {
    fn from(WireCapture { occasion, ticks, symbol, sigma }: WireCapture) -> Self {
        Self { occasion, ticks, symbol, sigma }
    }
}

/// Board to host.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromBoard<'a> {
    /// The board is the drone asked for; or it is nobody (id 0), as the host speaks another version of
    /// the bus or of the radio.
    Ready {
        /// The image's [`BUS_VERSION`].
        bus_version: u16,
        /// The image's [`SCHEMA_HASH`](skyroost_protocol::SCHEMA_HASH).
        schema_hash: u32,
        /// Who it is now.
        id: DroneId,
    },
    /// The message cannot be obeyed.
    Refused(Refusal),
    /// A frame arrived damaged; it may or may not have been part of a step.
    Damaged,
    /// Step `step` cannot be done yet: parts from `next` on are missing.
    Missing {
        /// The step.
        step: u32,
        /// The first part that is missing.
        next: u16,
        /// The request's.
        attempt: u8,
    },
    /// Part `index` of what step `step` wants done.
    Act {
        /// The step.
        step: u32,
        /// Number of the part in the answer, from 0.
        index: u16,
        /// The part.
        #[serde(borrow)]
        part: ActPart<'a>,
    },
    /// Step `step` is done and its answer complete with `parts` parts.
    Done {
        /// The step.
        step: u32,
        /// Parts of the answer.
        parts: u16,
        /// The request's.
        attempt: u8,
        /// For the autopilot.
        setpoint: WireSetpoint,
        /// What the step took, in the board's own units: see [`Report::worst_step_cost`].
        cost: u32,
    },
    /// How the board fared.
    Report(Report),
}

/// Why a message cannot be obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// A configuration that no drone can have.
    Config,
    /// A step before any [`ToBoard::Begin`].
    NotBegun,
    /// Not the step after the last one: the last one done is this.
    OutOfStep(u32),
}

/// What only some steps do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ActPart<'a> {
    /// Bytes for the radio, at most [`MAX_RADIO_PART`]; a frame may go on in the next part.
    Radio(#[serde(serialize_with = "as_bytes")] &'a [u8]),
    /// SRS occasions to listen to.
    Gates(Vec<WireGate, MAX_GATES_PART>),
}

/// [`SrsGate`] as it crosses the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WireGate {
    occasion: OccasionId,
    user: UserId,
    at: TimePs,
    grant: bool,
}

impl From<SrsGate> for WireGate {
    fn from(SrsGate { occasion, user, at, grant }: SrsGate) -> Self {
        Self { occasion, user, at, grant }
    }
}

impl From<WireGate> for SrsGate {
    fn from(WireGate { occasion, user, at, grant }: WireGate) -> Self {
        Self { occasion, user, at, grant }
    }
}

/// [`Setpoint`] as it crosses the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WireSetpoint {
    motors: bool,
    vel_enu_mps: [f32; 3],
    accel_enu_mps2: [f32; 3],
}

impl From<Setpoint> for WireSetpoint {
    fn from(Setpoint { motors, vel_enu_mps, accel_enu_mps2 }: Setpoint) -> Self {
        Self { motors, vel_enu_mps: vel_enu_mps.into(), accel_enu_mps2: accel_enu_mps2.into() }
    }
}

impl From<WireSetpoint> for Setpoint {
    fn from(WireSetpoint { motors, vel_enu_mps, accel_enu_mps2 }: WireSetpoint) -> Self {
        Self { motors, vel_enu_mps: Vec3::from(vel_enu_mps), accel_enu_mps2: Vec3::from(accel_enu_mps2) }
    }
}

/// How a board fared since it began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// The flight code's own counts, in the order of [`Counters`].
    pub counters: [u32; Counters::COUNT],
    /// What the bus and the radio's byte link dropped.
    pub link: LinkCounters,
    /// Steps done.
    pub steps: u32,
    /// Greatest cost of a step: cycles of the core on the chip, ticks of its clock in the emulator.
    pub worst_step_cost: u32,
    /// Most bytes of stack ever in use; 0 where nobody measured.
    pub stack_used: u32,
}

/// What the board's links dropped; every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkCounters {
    /// Frames of the bus that came damaged.
    pub bus_damaged: u32,
    /// Parts of a step that came twice or out of order.
    pub bus_out_of_order: u32,
    /// Steps that were asked for before all parts were there, or again.
    pub bus_repeated: u32,
    /// Frames of the radio that came damaged.
    pub radio_damaged: u32,
    /// Frames, captures or users that the inputs of a step had no room for.
    pub inputs_overflowed: u32,
}

/// In one piece, where a sequence of numbers would go one by one; the bytes are the same.
fn as_bytes<S: Serializer>(bytes: &&[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytes)
}

/// Replaces `frame` by `message` as it goes over the bus. Returns whether it fits: every message within its
/// bounds does; where one does not, `frame` is empty.
pub fn encode<T: Serialize>(message: &T, frame: &mut StreamFrame) -> bool {
    encode_stream_with(frame, |frame| postcard::serialize_with_flavor(message, Append(frame))).is_ok()
}

/// Lets postcard append to a frame.
struct Append<'a>(&'a mut StreamFrame);

impl postcard::ser_flavors::Flavor for Append<'_> {
    type Output = ();

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.0.push(byte).map_err(|_| postcard::Error::SerializeBufferFull)
    }

    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        self.0.extend_from_slice(bytes).map_err(|_| postcard::Error::SerializeBufferFull)
    }

    fn finalize(self) -> postcard::Result<()> {
        Ok(())
    }
}

/// The message in what [`StreamDecoder`](skyroost_protocol::stream::StreamDecoder) found; none when it is not
/// one, or bytes follow it.
#[must_use]
pub fn decode<'a, T: Deserialize<'a>>(payload: &'a [u8]) -> Option<T> {
    match postcard::take_from_bytes(payload) {
        Ok((message, [])) => Some(message),
        _ => None,
    }
}
