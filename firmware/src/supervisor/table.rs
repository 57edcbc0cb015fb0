//! The table: what is watched, what each condition makes the drone do, and how conditions clear.
//!
//! What several conditions come to is no matter of their order: each demands an action and may rule one out, and the
//! strongest action demanded that nothing rules out is taken. `docs/supervisor.md` shows the table and every pair.

use crate::config::SupervisorConfig;

/// What can be wrong; the discriminant is the bit number in telemetry and events, and the place in [`TABLE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The control center has been silent for a while.
    LinkQuiet = 0,
    /// Silent for long.
    LinkLost = 1,
    /// Silent for very long.
    LinkGone = 2,
    /// No navigation solution.
    NavigationLost = 3,
    /// The battery gives just enough to return home.
    BatteryLow = 4,
    /// The battery gives just enough to land here.
    BatteryCritical = 5,
    /// A fleet mate on the lanes has been silent; the control center decides.
    MateLost = 6,
    /// Avoidance changed the velocity a moment ago: the drone is not where guidance wants it.
    Avoiding = 7,
    /// The pulses per second that there were have failed. A clock that never had any is none the worse.
    ClockHeld = 8,
    /// The clock has been without pulses for so long that arrival times say nothing any more.
    ClockUseless = 9,
    /// The navigation solution declares a wider error than the mission counts on.
    NavigationPoor = 10,
    /// No navigation solution for so long that none is to be expected: land blind.
    NavigationGone = 11,
    /// Nearer to the fence or an obstacle than guidance or avoidance would ever bring it.
    FenceNear = 12,
    /// Beyond the fence, or within an obstacle.
    FenceCrossed = 13,
    /// The velocity falls short of what is commanded: wind near the limits.
    WindStrong = 14,
    /// It falls short by so much that the drone cannot keep its place: wind beyond the limits.
    WindBeyond = 15,
    /// On the lanes, and the gates that were opened captured nothing for a while.
    CapturesMissed = 16,
    /// Nothing for long; the control center decides.
    CapturesGone = 17,
    /// The battery will soon ask for a return.
    BatteryWaning = 18,
    /// A fleet mate on the lanes has been silent for long; the control center decides.
    MateGone = 19,
}

/// How many conditions there are.
pub const CONDITIONS: usize = TABLE.len();

impl Condition {
    /// Its bit.
    #[must_use]
    pub const fn bit(self) -> u32 {
        1 << self as u32
    }

    /// The condition of that bit number.
    #[must_use]
    pub fn numbered(number: u32) -> Option<Self> {
        Some(TABLE.get(usize::try_from(number).ok()?)?.condition)
    }

    /// What people call it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::LinkQuiet => "control link quiet",
            Self::LinkLost => "control link lost",
            Self::LinkGone => "control link gone",
            Self::NavigationLost => "navigation lost",
            Self::BatteryLow => "battery low",
            Self::BatteryCritical => "battery critical",
            Self::MateLost => "fleet mate lost",
            Self::Avoiding => "avoiding",
            Self::ClockHeld => "time sync lost",
            Self::ClockUseless => "clock useless",
            Self::NavigationPoor => "navigation poor",
            Self::NavigationGone => "navigation gone",
            Self::FenceNear => "fence near",
            Self::FenceCrossed => "fence crossed",
            Self::WindStrong => "wind strong",
            Self::WindBeyond => "wind beyond limits",
            Self::CapturesMissed => "captures missed",
            Self::CapturesGone => "captures gone",
            Self::BatteryWaning => "battery waning",
            Self::MateGone => "fleet mate gone",
        }
    }

    /// When it comes up.
    #[must_use]
    pub const fn limit(self, config: &SupervisorConfig) -> Limit {
        match self {
            Self::LinkQuiet => Limit::silence(config.link_warn_ms),
            Self::LinkLost => Limit::silence(config.link_hold_ms),
            Self::LinkGone => Limit::silence(config.link_return_ms),
            Self::NavigationLost => Limit::silence(config.nav_lost_ms),
            Self::NavigationGone => Limit::silence(config.nav_gone_ms as u32),
            Self::NavigationPoor => Limit::level(config.nav_error_mm as i32, 1_000, NAVIGATION_POOR_MS),
            Self::BatteryWaning => Limit::charge(config.battery_warn_permille),
            Self::BatteryLow => Limit::charge(config.battery_low_permille),
            Self::BatteryCritical => Limit::charge(config.battery_critical_permille),
            Self::MateLost => Limit::silence(config.mate_lost_ms),
            Self::MateGone => Limit::silence(MATE_GONE_MS),
            // Of the time since then, with its sign turned.
            Self::Avoiding => Limit::level(-AVOIDED_LATELY_MS, 0, 0),
            Self::ClockHeld => Limit::level(0, 0, CLOCK_HELD_MS),
            Self::ClockUseless => Limit::level(CLOCK_USELESS_NS, 0, 0),
            Self::FenceNear => Limit::level(-(config.fence_near_mm as i32), FENCE_BAND_MM, 0),
            Self::FenceCrossed => Limit::level(0, 0, 0),
            Self::WindStrong => Limit::level(config.wind_warn_mmps as i32, WIND_BAND_MMPS, WIND_WARN_MS),
            Self::WindBeyond => Limit::level(config.wind_act_mmps as i32, WIND_BAND_MMPS, WIND_ACT_MS),
            Self::CapturesMissed => Limit::silence(CAPTURES_WARN_MS),
            Self::CapturesGone => Limit::silence(CAPTURES_GONE_MS),
        }
    }
}

/// Silence of a fleet mate after which the operator is reminded of it, milliseconds.
const MATE_GONE_MS: u32 = 10_000;
/// A clock without pulses is told once it has been for this long, milliseconds.
const CLOCK_HELD_MS: u16 = 5_000;
/// Deviation of a held clock above which arrival times say nothing, nanoseconds: 300 m.
const CLOCK_USELESS_NS: i32 = 1_000;
/// For how long velocity must be lacking to be told and to be acted upon, milliseconds.
const WIND_WARN_MS: u16 = 3_000;
const WIND_ACT_MS: u16 = 5_000;
/// Time for which gates capture nothing, milliseconds.
const CAPTURES_WARN_MS: u32 = 20_000;
const CAPTURES_GONE_MS: u32 = 60_000;
/// A manoeuvre of avoidance goes on until avoidance has had nothing to say for this long, milliseconds.
const AVOIDED_LATELY_MS: i32 = 2_000;
/// A wide error is told once it has been wide for this long, milliseconds.
const NAVIGATION_POOR_MS: u16 = 2_000;
/// A charge must grow by this much to be another one, per mille: the voltage recovers where the load is taken off.
const CHARGE_BAND_PERMILLE: i32 = 20;
/// Farther away by this much than where it was near, millimetres.
const FENCE_BAND_MM: i32 = 1_000;
/// Below the limit by this much, millimetres a second.
const WIND_BAND_MMPS: i32 = 500;

/// When a condition comes up: its measure is above `above` for `for_ms`. It is over once the measure has been at or below
/// `above - band` for the time in its [`Row`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// The measure's limit, in its own unit.
    pub above: i32,
    /// By how much less the measure must be for the condition to be over.
    pub band: i32,
    /// For how long the measure must be above, milliseconds.
    pub for_ms: u16,
}

impl Limit {
    /// Of a silence, milliseconds.
    const fn silence(ms: u32) -> Self {
        Self::level(if ms > i32::MAX as u32 { i32::MAX } else { ms as i32 }, 0, 0)
    }

    /// Of a charge, with its sign turned, as less is worse.
    const fn charge(permille: u16) -> Self {
        Self::level(-(permille as i32), CHARGE_BAND_PERMILLE, 0)
    }

    const fn level(above: i32, band: i32, for_ms: u16) -> Self {
        Self { above, band, for_ms }
    }

    /// Whether `measure` is wrong; where the condition is in force already, a little less is wrong as well.
    #[must_use]
    pub const fn is_beyond(&self, measure: i32, in_force: bool) -> bool {
        measure > if in_force { self.above.saturating_sub(self.band) } else { self.above }
    }
}

/// What is watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Watched {
    /// Words of the control center.
    GroundLink,
    /// Words of the fleet mates, on the lanes.
    PeerLink,
    /// The clock that arrivals are read off.
    TimeSync,
    /// The navigation solution.
    Navigation,
    /// The charge.
    Battery,
    /// The fence and the obstacles.
    Geofence,
    /// What the wind leaves of the commanded velocity.
    Wind,
    /// Captures of the gates that were opened, on the lanes.
    Captures,
    /// What avoidance made of the wanted velocity; told and nothing else.
    Avoidance,
}

/// What a condition is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// To be told in time.
    Warns,
    /// To be acted upon, by the drone or, where its action is none, by the control center.
    Acts,
}

/// What the supervisor makes the drone do, weakest first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Action {
    /// Nothing: fly on.
    #[default]
    None,
    /// Stop and stay.
    Hold,
    /// Fly back to the pad and land.
    ReturnHome,
    /// Land here.
    Land,
}

/// A condition's row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// The condition.
    pub condition: Condition,
    /// What it is about.
    pub watched: Watched,
    /// What it is for.
    pub level: Level,
    /// What it demands, and what cannot be done under it.
    pub demands: Demands,
    /// For how long all must be well before it is over, milliseconds.
    pub clears_after_ms: u16,
}

/// All conditions, in the order of their numbers.
pub const TABLE: [Row; 20] = {
    use Condition as C;
    use Level::{Acts, Warns};
    use Watched as W;
    const NONE: Demands = Demands::NONE;
    const HOLD: Demands = Demands::of(Action::Hold);
    const RETURN: Demands = Demands::of(Action::ReturnHome);
    const LAND: Demands = Demands::of(Action::Land);
    [
        row(C::LinkQuiet, W::GroundLink, Warns, NONE, 1_000),
        row(C::LinkLost, W::GroundLink, Acts, HOLD, 1_000),
        row(C::LinkGone, W::GroundLink, Acts, RETURN, 1_000),
        // Nobody finds home blind.
        row(C::NavigationLost, W::Navigation, Acts, HOLD.without(Action::ReturnHome), 1_000),
        row(C::BatteryLow, W::Battery, Acts, RETURN, 0),
        row(C::BatteryCritical, W::Battery, Acts, LAND, 0),
        row(C::MateLost, W::PeerLink, Warns, NONE, 1_000),
        row(C::Avoiding, W::Avoidance, Warns, NONE, 0),
        row(C::ClockHeld, W::TimeSync, Warns, NONE, 2_000),
        row(C::ClockUseless, W::TimeSync, Acts, NONE, 2_000),
        row(C::NavigationPoor, W::Navigation, Warns, NONE, 5_000),
        row(C::NavigationGone, W::Navigation, Acts, LAND.without(Action::ReturnHome), 1_000),
        row(C::FenceNear, W::Geofence, Warns, NONE, 2_000),
        row(C::FenceCrossed, W::Geofence, Acts, HOLD, 2_000),
        row(C::WindStrong, W::Wind, Warns, NONE, 5_000),
        row(C::WindBeyond, W::Wind, Acts, RETURN, 5_000),
        row(C::CapturesMissed, W::Captures, Warns, NONE, 1_000),
        row(C::CapturesGone, W::Captures, Acts, NONE, 1_000),
        row(C::BatteryWaning, W::Battery, Warns, NONE, 0),
        row(C::MateGone, W::PeerLink, Acts, NONE, 1_000),
    ]
};

const fn row(
    condition: Condition,
    watched: Watched,
    level: Level,
    demands: Demands,
    clears_after_ms: u16,
) -> Row {
    Row { condition, watched, level, demands, clears_after_ms }
}

// A condition's number is its place.
const _: () = {
    let (mut place, mut rows): (usize, &[Row]) = (0, &TABLE);
    while let [row, rest @ ..] = rows {
        assert!(row.condition as usize == place);
        (place, rows) = (place + 1, rest);
    }
};

/// What conditions demand and what they rule out, a bit for each action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Demands {
    wanted: u8,
    ruled_out: u8,
}

impl Demands {
    /// Nothing.
    pub const NONE: Self = Self { wanted: 0, ruled_out: 0 };

    /// This action.
    #[must_use]
    pub const fn of(action: Action) -> Self {
        Self { wanted: 1 << action as u8, ..Self::NONE }
    }

    /// The same, under which `action` cannot be done, whoever demands it.
    #[must_use]
    pub const fn without(self, action: Action) -> Self {
        Self { ruled_out: self.ruled_out | 1 << action as u8, ..self }
    }

    /// All that both demand and rule out; the order of them does not matter.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self { wanted: self.wanted | other.wanted, ruled_out: self.ruled_out | other.ruled_out }
    }

    /// The strongest action that is demanded and not ruled out.
    #[must_use]
    pub const fn action(self) -> Action {
        let possible = self.wanted & !self.ruled_out;
        if possible & 1 << Action::Land as u8 != 0 {
            Action::Land
        } else if possible & 1 << Action::ReturnHome as u8 != 0 {
            Action::ReturnHome
        } else if possible & 1 << Action::Hold as u8 != 0 {
            Action::Hold
        } else {
            Action::None
        }
    }
}
