//! A planned sweep for scripts, maps, autopilots and people.
//!
//! - `json`: every figure, for scripts,
//! - `flight_plan`: a plan file of QGroundControl for each drone,
//! - `geojson`: sub-areas and lanes for other maps,
//! - `map`: a picture,
//! - `text`: the figures that decide, for people.

mod flight_plan;
mod geojson;
mod json;
mod map;
mod text;

pub use flight_plan::WayBlocked;

use crate::control::air_to_ground::{AirToGround, ServedDisk};
use crate::control::area::Area;
use crate::control::sweep::{SplitMode, SubArea, SweepPlan, SweepRequest};
use crate::geometry::V2;
use crate::runner::formation::Pads;

/// A planned sweep and what it was planned from.
#[derive(Clone, Debug)]
pub struct SweepReport {
    /// Where the area comes from, for people.
    pub area_name: String,
    /// The area, and where it lies on Earth.
    pub area: Area,
    /// What was asked for.
    pub request: SweepRequest,
    /// Where the fleets take off and land.
    pub pads: Pads,
    /// Altitude above the pads at which everything is flown, metres.
    pub altitude_m: f64,
    /// The link that gave radius and altitude, and the disk that it serves; none where the radius was given.
    pub link: Option<(AirToGround, ServedDisk)>,
    /// Time that the lanes may take, seconds.
    pub mission_time_s: f64,
    /// The plan.
    pub plan: SweepPlan,
    /// Every way of sharing that was tried, the one taken among them.
    pub modes: Vec<ModeTried>,
}

/// What one way of sharing would come to.
#[derive(Clone, Debug, PartialEq)]
pub struct ModeTried {
    /// The way of sharing; never `Auto`.
    pub split: SplitMode,
    /// Flying time of the slowest fleet and length of all lanes, or why there is no such plan.
    pub figures: Result<ModeFigures, String>,
}

/// Figures of a plan that compare it to another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModeFigures {
    /// Flying time of the slowest fleet, without the ways to the lanes and back, seconds.
    pub duration_s: f64,
    /// Length of all lanes with their turns, metres.
    pub length_m: f64,
}

impl From<&SweepPlan> for ModeFigures {
    fn from(plan: &SweepPlan) -> Self {
        Self { duration_s: plan.duration_s(), length_m: plan.length_m() }
    }
}

impl SweepReport {
    /// The plan as one JSON object, with a line's end.
    ///
    /// # Panics
    /// Never: every key is a string and every number finite.
    #[must_use]
    pub fn to_json(&self) -> String {
        json::render(self)
    }

    /// Sub-areas, lanes, zones and what is left uncovered, as GeoJSON; none where the area has no place on Earth.
    #[must_use]
    pub fn to_geojson(&self) -> Option<String> {
        self.area.frame.as_ref().map(|frame| geojson::render(self, frame))
    }

    /// A picture of the plan as a self-contained SVG with light and dark colours.
    #[must_use]
    pub fn to_svg(&self) -> String {
        map::render(self)
    }

    /// Names and contents of the drones' plan files; none where the area has no place on Earth.
    ///
    /// # Errors
    /// [`WayBlocked`] where a drone would have to fly through a no-fly zone.
    pub fn flight_plans(&self) -> Result<Option<Vec<(String, String)>>, WayBlocked> {
        self.area.frame.as_ref().map(|frame| flight_plan::files(self, frame)).transpose()
    }

    /// Whether a flying time is within the mission's.
    fn meets(&self, duration_s: f64) -> bool {
        duration_s <= self.mission_time_s
    }

    /// The way from a fleet's pad to its first lane, and that from its last one back, corner by corner.
    fn ways_there_and_back_m(&self, sub_area: &SubArea) -> [Vec<V2>; 2] {
        let pad_m = vec![self.pads.centre_m(sub_area.fleet)];
        let end = |end: Option<&V2>| end.copied().into_iter().collect::<Vec<_>>();
        let SubArea { path_m, approach_m, way_back_m, .. } = sub_area;
        [
            [&pad_m[..], approach_m, &end(path_m.first())].concat(),
            [&end(path_m.last())[..], way_back_m, &pad_m].concat(),
        ]
    }

    /// The lengths of these ways, metres.
    fn transits_m(&self, sub_area: &SubArea) -> [f64; 2] {
        self.ways_there_and_back_m(sub_area)
            .map(|way_m| way_m.windows(2).fold(0.0, |sum, leg| sum + (leg[1] - leg[0]).norm()))
    }
}

/// The name of a way of sharing, as the option takes it.
const fn name(split: SplitMode) -> &'static str {
    match split {
        SplitMode::Area => "area",
        SplitMode::Length => "length",
        SplitMode::Auto => "auto",
    }
}

/// Rounded down, so that 100 % is said only of the whole, up to the rounding of its computation.
fn percent(fraction: f64) -> String {
    const ROUNDING: f64 = 1e-9;
    format!("{:.2} %", ((fraction + ROUNDING) * 1e4).floor() / 1e2)
}

#[cfg(test)]
mod tests;
