//! What a sweep is planned from, and what can be wrong with it.

use serde::Serialize;
use thiserror::Error;

use crate::geometry::V2;

/// More lanes than this are taken for a mistake in the radius or in the area's unit.
pub(super) const MAX_LANES: f64 = 10_000.0;

/// Proportions may miss 1 by this much (rounded decimals); they are scaled to sum to 1 exactly.
const PROPORTION_SLACK: f64 = 1e-6;

/// How the fleets share the work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SplitMode {
    /// Sub-areas by area proportion, each with its own zigzag.
    Area,
    /// One zigzag over the whole area, cut by flying time.
    Length,
    /// Whichever way lets the slowest fleet end first; by area when it makes no difference.
    #[default]
    Auto,
}

/// How a fleet flies around a corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerModel {
    /// Acceleration and braking, metres per second squared.
    pub max_accel_mps2: f64,
    /// Speed at the corner itself, metres per second; at or above cruise no time is lost.
    pub corner_speed_mps: f64,
}

/// What to plan.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepRequest {
    /// Number of fleets of three drones.
    pub fleets: usize,
    /// Each fleet's share, of the area or of the flying time; positive, summing to 1.
    pub proportions: Vec<f64>,
    /// How to share the work.
    pub split: SplitMode,
    /// Coverage radius of one drone (the paper's `R_C`), metres.
    pub radius_m: f64,
    /// Side of the fleet's triangle (the paper's d), metres.
    pub spacing_m: f64,
    /// Cruise speed, metres per second.
    pub speed_mps: f64,
    /// How corners are flown.
    pub corner: CornerModel,
    /// How far a fleet may stray from its lane without leaving a gap, metres.
    pub margin_m: f64,
    /// Where each fleet comes from; decides at which end of its path it begins.
    pub entry_m: Option<Vec<V2>>,
}

/// Why there is no plan.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SweepError {
    /// There is nobody to sweep.
    #[error("found 0 fleets, expected at least 1")]
    NoFleet,
    /// A list that does not have one entry per fleet.
    #[error("found {found} {what} for {fleets} fleets, expected one for each")]
    Count {
        /// The list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The number of fleets.
        fleets: usize,
    },
    /// A number out of its domain.
    #[error("{name} is {found}, expected {expected}")]
    Number {
        /// The field.
        name: String,
        /// Its value.
        found: f64,
        /// The domain.
        expected: &'static str,
    },
    /// Proportions that do not share out the whole.
    #[error("the proportions sum to {found}, expected 1")]
    ProportionSum {
        /// Their sum.
        found: f64,
    },
    /// A share too small to be cut off.
    #[error("proportion {proportion} of fleet {fleet} leaves it no area, expected a larger share")]
    ShareTooSmall {
        /// The fleet, from 0.
        fleet: usize,
        /// Its share.
        proportion: f64,
    },
    /// The disks of a fleet overlap too little.
    #[error(
        "a radius of {radius_m} m and a spacing of {spacing_m} m with a margin of {margin_m} m leave no \
         swath: expected radius > spacing / sqrt(3) + margin"
    )]
    NoSwath {
        /// Coverage radius, metres.
        radius_m: f64,
        /// Side of the fleet's triangle, metres.
        spacing_m: f64,
        /// Margin, metres.
        margin_m: f64,
    },
    /// A piece of the area that nobody gets near.
    #[error(
        "the area around ({x_m:.1} m, {y_m:.1} m) cannot be covered: no place within {radius_m:.0} m of it can be \
         flown to without entering a no-fly zone; expected a smaller zone, or the piece left out of the area"
    )]
    Unreachable {
        /// East coordinate of the piece, metres.
        x_m: f64,
        /// North coordinate, metres.
        y_m: f64,
        /// How near a fleet has to come, metres.
        radius_m: f64,
    },
    /// A fleet that cannot get to its lanes.
    #[error(
        "fleet {fleet} finds no way from its entry point that enters no no-fly zone, expected an open one"
    )]
    NoApproach {
        /// The fleet, from 0.
        fleet: usize,
    },
    /// An area that is not convex, or has zones, in more pieces than can be put in order.
    #[error("an area of this shape takes {lanes:.0} lanes or more for one fleet, expected at most {most:.0}")]
    TooManyPieces {
        /// Lanes it would take.
        lanes: f64,
        /// Most lanes.
        most: f64,
    },
    /// The area is larger than any that is meant.
    #[error(
        "an area {width_m:.0} m wide takes {lanes:.0} lanes of {swath_m} m, expected at most {MAX_LANES}"
    )]
    TooManyLanes {
        /// Least width of the area, metres.
        width_m: f64,
        /// Greatest distance between lanes, metres.
        swath_m: f64,
        /// Lanes it would take.
        lanes: f64,
    },
}

/// Checks the request and returns the proportions, scaled to sum to 1.
pub(super) fn check(request: &SweepRequest) -> Result<Vec<f64>, SweepError> {
    let fleets = request.fleets;
    if fleets == 0 {
        return Err(SweepError::NoFleet);
    }
    let count =
        |what, found| if found == fleets { Ok(()) } else { Err(SweepError::Count { what, found, fleets }) };
    count("proportions", request.proportions.len())?;
    count("entry points", request.entry_m.as_ref().map_or(fleets, Vec::len))?;
    let number = |name: &str, found: f64, good: bool, expected| {
        if good && found.is_finite() {
            Ok(())
        } else {
            Err(SweepError::Number { name: name.into(), found, expected })
        }
    };
    let positive = |name: &str, x: f64| number(name, x, x > 0.0, "a finite number above 0");
    let not_negative = |name: &str, x: f64| number(name, x, x >= 0.0, "a finite number, 0 or more");
    positive("radius_m", request.radius_m)?;
    not_negative("spacing_m", request.spacing_m)?;
    positive("speed_mps", request.speed_mps)?;
    positive("max_accel_mps2", request.corner.max_accel_mps2)?;
    not_negative("corner_speed_mps", request.corner.corner_speed_mps)?;
    not_negative("margin_m", request.margin_m)?;
    for (i, &p) in request.proportions.iter().enumerate() {
        positive(&format!("proportion {}", i + 1), p)?;
    }
    for (i, p) in request.entry_m.iter().flatten().enumerate() {
        number(&format!("x_m of entry point {}", i + 1), p.x, true, "a finite number")?;
        number(&format!("y_m of entry point {}", i + 1), p.y, true, "a finite number")?;
    }
    let found: f64 = request.proportions.iter().sum();
    if (found - 1.0).abs() > PROPORTION_SLACK {
        return Err(SweepError::ProportionSum { found });
    }
    Ok(request.proportions.iter().map(|p| p / found).collect())
}
