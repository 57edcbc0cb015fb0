//! What localization is given and what it answers: plain data, free of the wire format.

use heapless::Vec as BoundedVec;
use skyroost_protocol::units::{DroneId, UserId};

use super::motion::Motion;

/// Speed of light in metres per nanosecond.
pub const C_M_PER_NS: f64 = 0.299_792_458;

/// Most captures of one occasion: a fleet is three drones.
pub const MAX_CAPTURES: usize = 3;

/// The arrival of one SRS at one drone (UL-RTOA of TS 38.215, 5.2.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capture {
    /// Who heard it.
    pub drone: DroneId,
    /// Where that drone was: east, north, up, in metres.
    pub pos_enu_m: [f64; 3],
    /// Arrival by that drone's own clock, relative to any reference common to the occasion.
    pub toa_ns: f64,
    /// Standard deviation of `toa_ns`; `None` means [`LocalizeConfig::sigma_toa_ns`].
    pub sigma_ns: Option<f64>,
}

/// One transmission of one user as a fleet heard it. Its emission time is unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct Occasion {
    /// Who sent it.
    pub user: UserId,
    /// The fleet that heard it: clocks are estimated per group.
    pub clock_group: u16,
    /// When, in seconds of mission time; only the clock model needs it, microseconds do not matter.
    pub time_s: f64,
    /// At most one capture per drone. Two carry one TDOA and are used; one alone says nothing.
    pub captures: BoundedVec<Capture, MAX_CAPTURES>,
}

/// What is unknown about the drones' clocks. All clocks of a group are modelled alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClockModel {
    /// Nothing: all clocks of a group agree.
    Synchronised,
    /// One constant offset per drone, shared by all users of the group.
    SharedConstant,
    /// Offset, drift and random walk per drone, shared by all users of the group. Without walk this is a
    /// straight line.
    SharedWander {
        /// Standard deviation of a clock's offset at `time_s` = 0; may be wide.
        offset_sigma_ns: f64,
        /// Standard deviation of a clock's constant drift.
        drift_sigma_ns_per_s: f64,
        /// Standard deviation of a clock's random walk after one second.
        walk_ns_per_sqrt_s: f64,
    },
}

/// How late (NLOS) captures are kept from spoiling a fix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Robust {
    /// Tukey's biweight: a capture more than `c` standard deviations off its occasion counts nothing.
    Tukey {
        /// Cut-off in standard deviations; 6 costs less than 1 % of efficiency on clean data.
        c: f64,
    },
    /// Plain least squares.
    None,
}

impl Robust {
    /// The stages to go through of those by which noise is first taken too large: least squares needs the last only, as
    /// the scale of the noise does not move its minimum.
    pub(super) fn stages<T>(self, stages: &[T]) -> &[T] {
        match self {
            Self::Tukey { .. } => stages,
            Self::None => &stages[stages.len().saturating_sub(1)..],
        }
    }
}

/// What the estimator assumes and demands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalizeConfig {
    /// Standard deviation of a capture that does not bring its own.
    pub sigma_toa_ns: f64,
    /// What is unknown about the clocks.
    pub clock: ClockModel,
    /// Altitude of all users above the frame's origin, as far as the terrain is known.
    pub user_altitude_m: f64,
    /// Standard deviation of a user's altitude about that; above 0 every user's altitude is estimated too.
    pub user_altitude_sigma_m: f64,
    /// Standard deviation of a drone's position along the line of sight, independent from capture to capture.
    pub drone_pos_sigma_m: f64,
    /// Standard deviation of each coordinate of a drone's position that stays the same for a whole pass, as that
    /// of a standalone GNSS receiver does: no number of captures averages it out.
    pub drone_bias_sigma_m: f64,
    /// Treatment of late captures.
    pub robust: Robust,
    /// A user lies about this close to the drones that heard it: start, weak prior and step limit.
    pub expected_radius_m: f64,
    /// A larger `r95_m` makes a fix [`FixStatus::PoorGeometry`].
    pub max_r95_m: f64,
    /// How users move.
    pub motion: Motion,
}

impl Default for LocalizeConfig {
    fn default() -> Self {
        Self {
            sigma_toa_ns: 5.0,
            clock: ClockModel::SharedWander {
                offset_sigma_ns: 200.0,
                drift_sigma_ns_per_s: 5.0,
                walk_ns_per_sqrt_s: 0.1,
            },
            user_altitude_m: 0.0,
            user_altitude_sigma_m: 0.0,
            drone_pos_sigma_m: 0.02,
            drone_bias_sigma_m: 0.0,
            robust: Robust::Tukey { c: 6.0 },
            expected_radius_m: 471.0,
            max_r95_m: 300.0,
            motion: Motion::STILL,
        }
    }
}

/// Bad input to [`super::localize`] or [`super::crlb`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LocalizeError {
    /// A field of [`LocalizeConfig`] out of its range.
    #[error("{field} is {found}, expected {expected}")]
    Config {
        /// The field's name.
        field: &'static str,
        /// Its value.
        found: f64,
        /// What would do.
        expected: &'static str,
    },
    /// The marks of late captures do not belong to these occasions.
    #[error("marks of late captures for {found} occasions, expected {expected}")]
    LateLength {
        /// Marks given.
        found: usize,
        /// Occasions given.
        expected: usize,
    },
}

impl LocalizeConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that is out of its range.
    pub fn check(&self) -> Result<(), LocalizeError> {
        const POSITIVE: &str = "a number from 1e-6 to 1e6";
        const NOT_NEGATIVE: &str = "a number from 0 to 1e12";
        const ALTITUDE: &str = "a number from -1e8 to 1e8";
        let require = |ok: bool, field, found: f64, expected| {
            if ok { Ok(()) } else { Err(LocalizeError::Config { field, found, expected }) }
        };
        let positive = |field, value: f64| require((1e-6..=1e6).contains(&value), field, value, POSITIVE);
        let not_negative =
            |field, value: f64| require((0.0..=1e12).contains(&value), field, value, NOT_NEGATIVE);
        positive("sigma_toa_ns", self.sigma_toa_ns)?;
        if let ClockModel::SharedWander { offset_sigma_ns, drift_sigma_ns_per_s, walk_ns_per_sqrt_s } =
            self.clock
        {
            not_negative("offset_sigma_ns", offset_sigma_ns)?;
            not_negative("drift_sigma_ns_per_s", drift_sigma_ns_per_s)?;
            not_negative("walk_ns_per_sqrt_s", walk_ns_per_sqrt_s)?;
        }
        let altitude = self.user_altitude_m;
        require(altitude.abs() <= 1e8, "user_altitude_m", altitude, ALTITUDE)?;
        for (field, sigma_m) in [
            ("user_altitude_sigma_m", self.user_altitude_sigma_m),
            ("drone_pos_sigma_m", self.drone_pos_sigma_m),
            ("drone_bias_sigma_m", self.drone_bias_sigma_m),
        ] {
            require((0.0..=1e6).contains(&sigma_m), field, sigma_m, "a number from 0 to 1e6")?;
        }
        if let Robust::Tukey { c } = self.robust {
            positive("c", c)?;
        }
        positive("expected_radius_m", self.expected_radius_m)?;
        positive("max_r95_m", self.max_r95_m)?;
        let Motion { speed_mps, turn_s } = self.motion;
        require((0.0..=100.0).contains(&speed_mps), "motion.speed_mps", speed_mps, "a number from 0 to 100")?;
        positive("motion.turn_s", turn_s)
    }
}

/// What a fix is worth. Only [`FixStatus::Ok`] claims a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FixStatus {
    /// The user is within `r95_m` of `pos_m` with 95 % probability.
    Ok,
    /// A second point explains the captures about as well.
    Ambiguous,
    /// The circle is beyond the limit, or the cost is not the parabola its covariance says.
    PoorGeometry,
    /// The captures contradict each other more than their noise allows.
    Inconsistent,
    /// Fewer than two usable TDOAs.
    NotLocated,
}

/// Where one user is.
#[derive(Clone, Debug, PartialEq)]
pub struct UserFix {
    /// Who.
    pub user: UserId,
    /// East and north in metres, of a user that walks at `last_heard_s`. A best guess unless the status is [`FixStatus::Ok`].
    pub pos_m: [f64; 2],
    /// Covariance of `pos_m`, the uncertainty of the clocks included.
    pub cov_m2: [[f64; 2]; 2],
    /// Radius of the circle around `pos_m` that holds 95 % of that Gaussian.
    pub r95_m: f64,
    /// Altitude above the frame's origin: the one assumed, or where that is uncertain, the estimate.
    pub altitude_m: f64,
    /// Its standard deviation; 0 where the altitude was taken as known.
    pub altitude_sigma_m: f64,
    /// What it is worth.
    pub status: FixStatus,
    /// Occasions with two or more captures.
    pub occasions: u32,
    /// Captures of these occasions that the robust weights threw out.
    pub rejected: u32,
    /// Mission time of the last occasion, whatever its captures.
    pub last_heard_s: f64,
}

/// The clock of one drone against the reference drone of its group (the one with the lowest id).
#[derive(Clone, Debug, PartialEq)]
pub struct ClockFix {
    /// The group.
    pub clock_group: u16,
    /// Whose clock; the reference drone is listed with zeros.
    pub drone: DroneId,
    /// Mission time that `offset_ns` belongs to: the group's first occasion.
    pub reference_time_s: f64,
    /// Offset at `reference_time_s`.
    pub offset_ns: f64,
    /// The constant part of the drift.
    pub drift_ns_per_s: f64,
    /// Time in seconds and offset in nanoseconds at every knot; linear between knots.
    pub knots: Vec<(f64, f64)>,
}

impl ClockFix {
    /// Offset at a time, nanoseconds: between the knots, or beyond them along the drift.
    pub(super) fn at_ns(&self, time_s: f64) -> f64 {
        let knots = &self.knots;
        let next = knots.partition_point(|(t, _)| *t <= time_s);
        match (next.checked_sub(1).and_then(|k| knots.get(k)), knots.get(next)) {
            (Some((t0, a)), Some((t1, b))) => a + (b - a) * (time_s - t0) / (t1 - t0),
            (Some((t, a)), None) | (None, Some((t, a))) => a + self.drift_ns_per_s * (time_s - t),
            (None, None) => 0.0,
        }
    }
}

/// The answer of [`super::localize`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Localization {
    /// One fix per user heard, sorted by user.
    pub users: Vec<UserFix>,
    /// Sorted by group, then drone.
    pub clocks: Vec<ClockFix>,
    /// Linear systems solved, over all groups.
    pub iterations: u32,
    /// What was dropped or clamped, with counts, and what did not converge.
    pub warnings: Vec<String>,
}
