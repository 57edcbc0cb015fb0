//! What meets: vehicles, their limits, and how well they know of each other.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use skyroost_protocol::message::{Manner, Vertical};

use super::NoiseModel;

/// More vehicles than anybody flies at once.
const MOST_VEHICLES: usize = 1_000;
/// Numbers beyond this are slips, metres.
const MOST_M: f64 = 1e5;

/// Vehicles that fly to goals past each other.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Encounter {
    /// Separation of true centres that must be kept, metres.
    #[serde(default = "defaults::d_safe_m")]
    pub d_safe_m: f64,
    /// Step of the physics, seconds.
    #[serde(default = "defaults::dt_s")]
    pub dt_s: f64,
    /// How long it goes on, seconds.
    #[serde(default = "defaults::duration_s")]
    pub duration_s: f64,
    /// Largest acceleration, as a vector.
    #[serde(default = "defaults::max_accel_mps2")]
    pub max_accel_mps2: f64,
    /// Cruise speed of a vehicle at rest, and what avoidance may ask for; the hard limit is 1.2 times this.
    #[serde(default = "defaults::max_speed_mps")]
    pub max_speed_mps: f64,
    /// From a state to its use by others, seconds.
    #[serde(default = "defaults::share_delay_s")]
    pub share_delay_s: f64,
    /// Between two states that a vehicle shares, seconds.
    #[serde(default = "defaults::share_period_s")]
    pub share_period_s: f64,
    /// Probability that one receiver misses one state.
    #[serde(default)]
    pub share_loss: f64,
    /// Error radius of positions, the paper's `r_s`, metres.
    #[serde(default = "defaults::r_s_m")]
    pub r_s_m: f64,
    /// Error radius that everybody believes in and tells, where it is not `r_s_m`, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub declared_r_s_m: Option<f64>,
    /// Whether vehicles give way up and down.
    #[serde(default)]
    pub vertical: Vertical,
    /// How positions err within it.
    #[serde(default)]
    pub noise: NoiseModel,
    /// Of errors and losses.
    #[serde(default = "defaults::seed")]
    pub seed: u64,
    /// Who meets.
    pub vehicles: Vec<VehicleSpec>,
}

/// One of those that meet.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleSpec {
    /// Its name, from 1.
    pub id: u16,
    /// Where it begins, metres ENU.
    pub pos_m: [f64; 3],
    /// How it begins; unless it begins at rest, its speed is its cruise speed.
    #[serde(default)]
    pub vel_mps: [f64; 3],
    /// Where to.
    pub goal_m: [f64; 3],
    /// Whether it avoids others. One that does not flies straight and is not known for it.
    #[serde(default = "defaults::cooperative")]
    pub cooperative: bool,
    /// Whether it tells that it cannot manoeuvre as it would have to: the others keep clear of it by themselves.
    #[serde(default)]
    pub has_right_of_way: bool,
}

impl VehicleSpec {
    /// Who gives way where it meets others.
    #[must_use]
    pub fn manner(&self) -> Manner {
        if self.has_right_of_way { Manner::UNABLE } else { Manner::ALONE }
    }

    /// Its cruise speed, m/s.
    #[must_use]
    pub fn cruise_mps(&self, max_speed_mps: f64) -> f64 {
        let own = crate::geometry::V3::from(self.vel_mps).norm();
        if own > 0.0 { own } else { max_speed_mps }
    }
}

mod defaults {
    pub(super) fn d_safe_m() -> f64 {
        10.0
    }
    pub(super) fn dt_s() -> f64 {
        0.02
    }
    pub(super) fn duration_s() -> f64 {
        120.0
    }
    pub(super) fn max_accel_mps2() -> f64 {
        3.0
    }
    pub(super) fn max_speed_mps() -> f64 {
        10.0
    }
    pub(super) fn share_delay_s() -> f64 {
        0.2
    }
    pub(super) fn share_period_s() -> f64 {
        0.1
    }
    pub(super) fn r_s_m() -> f64 {
        2.0
    }
    pub(super) fn seed() -> u64 {
        1
    }
    pub(super) fn cooperative() -> bool {
        true
    }
}

/// Why nothing can meet like that.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum EncounterError {
    /// A number is out of range.
    #[error("{field} is {found}, expected {expected}")]
    Range {
        /// Its name.
        field: String,
        /// What it is.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// Two vehicles have one name.
    #[error("vehicles[{index}].id is {id}, as that of vehicles[{first}]; expected an id of its own")]
    SameId {
        /// The second of them.
        index: usize,
        /// The first.
        first: usize,
        /// Their name.
        id: u16,
    },
    /// Nobody, or too many.
    #[error("{found} vehicles, expected 1 to 1000")]
    Vehicles {
        /// How many.
        found: usize,
    },
}

impl Encounter {
    /// These vehicles, all else as usual.
    #[must_use]
    pub fn of(vehicles: Vec<VehicleSpec>) -> Self {
        Self {
            d_safe_m: defaults::d_safe_m(),
            dt_s: defaults::dt_s(),
            duration_s: defaults::duration_s(),
            max_accel_mps2: defaults::max_accel_mps2(),
            max_speed_mps: defaults::max_speed_mps(),
            share_delay_s: defaults::share_delay_s(),
            share_period_s: defaults::share_period_s(),
            share_loss: 0.0,
            r_s_m: defaults::r_s_m(),
            declared_r_s_m: None,
            vertical: Vertical::default(),
            noise: NoiseModel::default(),
            seed: defaults::seed(),
            vehicles,
        }
    }

    /// Error radius that everybody believes in, metres.
    #[must_use]
    pub fn declared_m(&self) -> f64 {
        self.declared_r_s_m.unwrap_or(self.r_s_m)
    }

    /// Refuses what cannot be flown.
    ///
    /// # Errors
    /// [`EncounterError`] names the field, what it holds and what it may hold.
    pub fn check(&self) -> Result<(), EncounterError> {
        let within = |field: &str, found: f64, least: f64, most: f64, expected| {
            let fault = || EncounterError::Range { field: field.to_owned(), found, expected };
            if found >= least && found <= most { Ok(()) } else { Err(fault()) }
        };
        within("d_safe_m", self.d_safe_m, 0.0, 60.0, "0 to 60 m")?;
        within("dt_s", self.dt_s, 1e-3, 0.1, "0.001 to 0.1 s")?;
        within("duration_s", self.duration_s, self.dt_s, 86_400.0, "a step to a day")?;
        within("max_accel_mps2", self.max_accel_mps2, 0.1, 50.0, "0.1 to 50 m/s2")?;
        within("max_speed_mps", self.max_speed_mps, 0.1, 50.0, "0.1 to 50 m/s")?;
        within("share_delay_s", self.share_delay_s, 0.0, 10.0, "0 to 10 s")?;
        within("share_period_s", self.share_period_s, self.dt_s, 10.0, "dt_s to 10 s")?;
        within("share_loss", self.share_loss, 0.0, 1.0, "0 to 1")?;
        within("r_s_m", self.r_s_m, 0.0, 60.0, "0 to 60 m")?;
        within("declared_r_s_m", self.declared_m(), 0.0, 60.0, "0 to 60 m")?;
        if self.vehicles.is_empty() || self.vehicles.len() > MOST_VEHICLES {
            return Err(EncounterError::Vehicles { found: self.vehicles.len() });
        }
        let mut first_of: BTreeMap<u16, usize> = BTreeMap::new();
        for (index, vehicle) in self.vehicles.iter().enumerate() {
            let name = |field: &str| format!("vehicles[{index}].{field}");
            within(&name("id"), f64::from(vehicle.id), 1.0, 65_534.0, "1 to 65534")?;
            if let Some(first) = first_of.insert(vehicle.id, index) {
                return Err(EncounterError::SameId { index, first, id: vehicle.id });
            }
            for (axis, field) in ["pos_m[0]", "pos_m[1]", "pos_m[2]"].iter().enumerate() {
                within(&name(field), vehicle.pos_m[axis], -MOST_M, MOST_M, "within 100 km")?;
            }
            for (axis, field) in ["goal_m[0]", "goal_m[1]", "goal_m[2]"].iter().enumerate() {
                within(&name(field), vehicle.goal_m[axis], -MOST_M, MOST_M, "within 100 km")?;
            }
            let speed_mps = vehicle.cruise_mps(self.max_speed_mps);
            within(
                &name("vel_mps"),
                speed_mps,
                0.0,
                self.max_speed_mps * (1.0 + 1e-9),
                "at most max_speed_mps",
            )?;
        }
        Ok(())
    }
}
