//! What the supervisor looks at, and what is measured of it for each condition.

use super::Condition;
use skyroost_protocol::{message::ClockState, units::TimePs};

/// The measure of what is not there to be wrong.
const NOTHING: i32 = i32::MIN;

/// What the supervisor looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// Whether the drone is in the air: on the ground nothing is wrong and nothing overridden.
    pub airborne: bool,
    /// Silence of the control center, milliseconds.
    pub link_silent_ms: u32,
    /// Silence of the fleet mate that has been silent the longest, milliseconds; none off the lanes.
    pub mates_silent_ms: Option<u32>,
    /// The clock that arrivals are read off.
    pub clock: ClockState,
    /// Time without a navigation solution, milliseconds.
    pub nav_silent_ms: u32,
    /// Error radius of the last one, millimetres.
    pub nav_error_mm: i32,
    /// Charge left, per mille.
    pub battery_permille: u16,
    /// Where the drone is to the nearest wall; none without walls.
    pub fence: Option<FenceRoom>,
    /// What is lacking of the commanded velocity in the mean of some seconds, millimetres a second.
    pub shortfall_mmps: i32,
    /// Time for which gates have captured nothing, milliseconds; none off the lanes, and where none are opened.
    pub captures_silent_ms: Option<u32>,
    /// Time since avoidance last changed the velocity, milliseconds; none where it never did.
    pub avoided_ago_ms: Option<u32>,
}

/// Where a drone is to the walls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FenceRoom {
    /// Distance to the nearest one less the own error radius, millimetres.
    pub room_mm: i32,
    /// Whether it is within one, or on the other side of it than home.
    pub crossed: bool,
}

impl Health {
    /// What there is of `condition`: the more, the worse.
    pub(super) fn measure(&self, condition: Condition) -> i32 {
        use Condition as C;
        let count = |ms: u32| i32::try_from(ms).unwrap_or(i32::MAX);
        let known = |ms: Option<u32>| ms.map_or(NOTHING, count);
        match condition {
            C::LinkQuiet | C::LinkLost | C::LinkGone => count(self.link_silent_ms),
            C::MateLost | C::MateGone => known(self.mates_silent_ms),
            C::ClockHeld => i32::from(matches!(self.clock, ClockState::Held { .. })),
            C::ClockUseless => match self.clock {
                ClockState::Held { sigma_ns } => i32::from(sigma_ns),
                ClockState::Free | ClockState::Locked { .. } => NOTHING,
            },
            C::NavigationLost | C::NavigationGone => count(self.nav_silent_ms),
            C::NavigationPoor => self.nav_error_mm,
            C::BatteryWaning | C::BatteryLow | C::BatteryCritical => -i32::from(self.battery_permille),
            C::FenceNear => self.fence.map_or(NOTHING, |fence| fence.room_mm.saturating_neg()),
            C::FenceCrossed => self.fence.map_or(NOTHING, |fence| i32::from(fence.crossed)),
            C::WindStrong | C::WindBeyond => self.shortfall_mmps,
            C::CapturesMissed | C::CapturesGone => known(self.captures_silent_ms),
            C::Avoiding => self.avoided_ago_ms.map_or(NOTHING, |ms| count(ms).saturating_neg()),
        }
    }
}

/// A time in milliseconds, which wrap after 49 days: in one word, where only short times matter.
#[must_use]
pub const fn low_ms(time: TimePs) -> u32 {
    (time.0 / TimePs::from_ms(1).0) as u32
}

/// How long ago something was, milliseconds; what is yet to come is now. One function: a board divides for it.
#[inline(never)]
#[must_use]
pub fn ago_ms(now: TimePs, then: TimePs) -> u32 {
    u32::try_from(now.since(then).0.max(0) / TimePs::from_ms(1).0).unwrap_or(u32::MAX)
}
