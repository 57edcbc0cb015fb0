//! What goes into a step and what comes out of it: bounded buffers owned by the caller.
//!
//! The caller clears them between steps ([`Inputs::clear`], [`Outputs::clear`]); an input that does
//! not fit is the caller's to count, an output that does not fit is counted by the agent.

use crate::{Vec3, ZERO};
use heapless::Vec;
use skyroost_protocol::{
    codec::Frame,
    message::{AttachedUser, MAX_ATTACHED_PER_FRAME, MAX_CAPTURES_PER_FRAME},
    units::{OccasionId, TimePs, ToaSigma, UserId},
};

/// Most frames received in one step, and most sent to the control center.
pub const MAX_FRAMES_PER_STEP: usize = 16;
/// Most SRS captures in one step.
pub const MAX_CAPTURES_PER_STEP: usize = 16;
/// Most frames sent to fleet mates in one step: the captures of a step, and the sweep phase. More there
/// cannot be.
pub const MAX_PEER_FRAMES_PER_STEP: usize = MAX_CAPTURES_PER_STEP.div_ceil(MAX_CAPTURES_PER_FRAME) + 1;
/// Most SRS gates opened in one step.
pub const MAX_GATES_PER_STEP: usize = 16;

/// Everything that reached the drone since the last step.
#[derive(Clone, Debug)]
pub struct Inputs {
    /// Navigation solution of the autopilot; none while it has none.
    pub nav: Option<NavFix>,
    /// Whether the autopilot says that the vehicle flies (`EXTENDED_SYS_STATE` of MAVLink: any landed state but undefined and on the
    /// ground). Where it says nothing, false.
    pub in_air: bool,
    /// Value of the wrapping SRS capture counter at this step.
    pub timer_ticks: u32,
    /// The pulse per second that the same counter captured since the last step, if there was one.
    pub pulse: Option<Pulse>,
    /// SRS arrivals captured since the last step.
    pub captures: Vec<Capture, MAX_CAPTURES_PER_STEP>,
    /// Users that the cell reports, a page at a time.
    pub attached: Vec<AttachedUser, MAX_ATTACHED_PER_FRAME>,
    /// Frames received from the control center and from fleet mates.
    pub frames: Vec<Frame, MAX_FRAMES_PER_STEP>,
    /// Charge left in the battery, per mille.
    pub battery_permille: u16,
}

impl Default for Inputs {
    fn default() -> Self {
        Self::new()
    }
}

impl Inputs {
    /// Nothing came in.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            nav: None,
            in_air: false,
            timer_ticks: 0,
            pulse: None,
            captures: Vec::new(),
            attached: Vec::new(),
            frames: Vec::new(),
            battery_permille: 0,
        }
    }

    /// Forgets everything, keeping the memory.
    pub fn clear(&mut self) {
        self.nav = None;
        self.pulse = None;
        self.captures.clear();
        self.attached.clear();
        self.frames.clear();
    }
}

/// Navigation solution: position and velocity with the declared bound of the position error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavFix {
    /// Position in the mission's local frame, metres.
    pub pos_enu_m: Vec3,
    /// Velocity, metres a second.
    pub vel_enu_mps: Vec3,
    /// Radius of the ball around `pos_enu_m` that holds the true position, metres (the paper's `r_s`).
    pub error_radius_m: f32,
}

/// A pulse of the navigation receiver as the timer captured it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// The wrapping capture counter at the pulse.
    pub ticks: u32,
    /// Number of the second that it began, since the mission's epoch.
    pub second: i32,
}

/// One SRS arrival as the timer captured it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capture {
    /// The occasion whose gate was open.
    pub occasion: OccasionId,
    /// The wrapping capture counter at the arrival.
    pub ticks: u32,
    /// Which of the symbols that the SRS is repeated over, from 0.
    pub symbol: u8,
    /// How well the receiver found the arrival; the counter's own step is not in it.
    pub sigma: ToaSigma,
}

/// Everything the drone wants done.
#[derive(Clone, Debug)]
pub struct Outputs {
    /// For the autopilot's velocity loop.
    pub setpoint: Setpoint,
    /// Frames for the control center.
    pub uplink: Vec<Frame, MAX_FRAMES_PER_STEP>,
    /// Frames for the fleet mates.
    pub peer: Vec<Frame, MAX_PEER_FRAMES_PER_STEP>,
    /// SRS occasions to listen to.
    pub srs_gates: Vec<SrsGate, MAX_GATES_PER_STEP>,
}

impl Default for Outputs {
    fn default() -> Self {
        Self::new()
    }
}

impl Outputs {
    /// Nothing is wanted.
    #[must_use]
    pub const fn new() -> Self {
        Self { setpoint: Setpoint::REST, uplink: Vec::new(), peer: Vec::new(), srs_gates: Vec::new() }
    }

    /// Forgets everything, keeping the memory.
    pub fn clear(&mut self) {
        self.setpoint = Setpoint::default();
        self.uplink.clear();
        self.peer.clear();
        self.srs_gates.clear();
    }
}

/// Command to the autopilot's velocity loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// Whether the motors run.
    pub motors: bool,
    /// Velocity wanted, metres a second.
    pub vel_enu_mps: Vec3,
    /// Acceleration known ahead (corners, braking), metres a second squared.
    pub accel_enu_mps2: Vec3,
}

impl Setpoint {
    /// Motors off.
    pub const REST: Self = Self { motors: false, vel_enu_mps: ZERO, accel_enu_mps2: ZERO };
}

/// An SRS occasion to listen to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SrsGate {
    /// The occasion.
    pub occasion: OccasionId,
    /// Whose SRS is expected.
    pub user: UserId,
    /// When the user transmits.
    pub at: TimePs,
    /// Whether this drone serves the user and so grants the transmission.
    pub grant: bool,
}
