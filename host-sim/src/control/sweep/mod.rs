//! Stage one: who sweeps what, and along which lanes (the paper's Section 3.1 and Table 1).
//!
//! The fleets either get sub-areas cut parallel to the sweep (the paper's way) or share one way over the whole
//! area, cut by flying time; the second needs fewer lanes in all, because only one width is rounded up to whole
//! swaths. In either, lanes are laid along several directions, and the way that ends first is taken.
//!
//! - `request`: what a sweep is planned from, and what can be wrong with it,
//! - `cut`: sub-areas of exact shares,
//! - `lanes`, `convex`: lanes over a convex polygon, back and forth,
//! - `anywhere`: lanes over an area of any shape, in an order of `tour`, on ways around zones of `route`,
//! - `timing`: how long a way takes, and where to cut it,
//! - `apart`: how near the fleets come to each other.

mod anywhere;
mod apart;
mod convex;
mod cut;
mod frame;
mod lanes;
mod planner;
mod request;
pub(super) mod route;
mod timing;
mod tour;

pub use request::{CornerModel, SplitMode, SweepError, SweepRequest};

use crate::geometry::V2;
use crate::geometry::coverage::{Stadium, covered_region};
use crate::geometry::polygon::MinWidth;
use crate::geometry::region::Region;
use anywhere::Reach;
use planner::{Planner, Share};
use request::{MAX_LANES, check};
use route::{ROOM_M, Routes};
use timing::Timing;

/// How far a corner may be cut by the flight code (`guidance::lanes`), rounded up, metres.
const CORNER_ROOM_M: f64 = 2.0;

/// One fleet's part of the sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct SubArea {
    /// The fleet, from 0.
    pub fleet: usize,
    /// Its share of the area, or of the flying time.
    pub proportion: f64,
    /// Its sub-area; none where the fleets share one way.
    pub region: Option<Region>,
    /// Area of its sub-area; where the fleets share one way, the part of the whole that it covers, m2.
    pub area_m2: f64,
    /// Corners of the way from its entry point to the first lane, where no-fly zones lie between; both ends
    /// left out.
    pub approach_m: Vec<V2>,
    /// The same of the way back from the last lane.
    pub way_back_m: Vec<V2>,
    /// The way of the centre of its overlap disk, corner by corner.
    pub path_m: Vec<V2>,
    /// Direction of its lanes, from east, in [0, pi).
    pub direction_rad: f64,
    /// Length of that way, metres.
    pub length_m: f64,
    /// Changes from one lane to the next (two corners each). A change flown by two fleets counts for both.
    pub turns: usize,
    /// Flying time: cruise plus what the corners cost, without the way to the first lane, seconds.
    pub duration_s: f64,
    /// Share of its sub-area that its path covers; where the fleets share one way, the share of the whole that
    /// all of them cover.
    pub covered_fraction: f64,
}

/// A sweep of the whole area.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepPlan {
    /// The way of sharing used, never `Auto`.
    pub split: SplitMode,
    /// Direction of the sweep, from east, in [0, pi): that of the edge of the area's convex hull across which
    /// the hull is narrowest. Cuts are parallel to it, and lanes where nothing else is better.
    pub direction_rad: f64,
    /// Least width of the area's convex hull, metres.
    pub width_m: f64,
    /// Diameter of the disk that the fleet's overlap region holds in any orientation, metres. Lanes are
    /// at most this less two margins apart.
    pub swath_m: f64,
    /// The margin planned with, metres.
    pub margin_m: f64,
    /// The fleets' parts, in the order of the fleets.
    pub sub_areas: Vec<SubArea>,
    /// Share of the area that all paths together cover.
    pub covered_fraction: f64,
    /// What they leave uncovered, as anticlockwise rings, for drawing.
    pub residue_m: Vec<Vec<V2>>,
    /// Least distance between the centres of two fleets, when all begin their lanes at once and then wait at their
    /// ends, metres; none with a single fleet.
    pub separation_m: Option<f64>,
}

impl SweepPlan {
    /// Flying time of the slowest fleet, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.sub_areas.iter().map(|s| s.duration_s).fold(0.0, f64::max)
    }

    /// Length of all ways, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.sub_areas.iter().map(|s| s.length_m).sum()
    }
}

/// A way over an area: what a single fleet would fly.
#[derive(Clone, Debug)]
struct Way {
    path_m: Vec<V2>,
    direction_rad: f64,
    length_m: f64,
    /// Changes from one lane to the next.
    turns: usize,
    /// Equal strips along a direction that Maza and Ollero would take.
    plain: bool,
}

/// Plans the sweep of an area.
///
/// # Assumptions
/// Each fleet keeps its triangle, so it covers at least the disk of radius `R - d / sqrt(3)` around its
/// centre, whichever way the triangle points. A lane ends where its disk already reaches the border, and where the
/// border is oblique it may end outside of the area by less than the height of a strip. Between the parts of an area
/// that is not convex the ways lead where it is shortest, over land that nobody asked about; no drone enters
/// a no-fly zone: a fleet's centre keeps the radius of its triangle, the margin and a corner's room from each.
///
/// # Promises
/// Of a convex area no way by sub-areas is longer than plain lanes with exact insets (equal strips along the
/// sweep direction, or along the direction in which the sub-area is narrowest), and `Auto` shares one way
/// only where that is no longer in all.
///
/// # Errors
/// [`SweepError`] names the field, what was found and what is expected.
pub fn plan(region: &Region, request: &SweepRequest) -> Result<SweepPlan, SweepError> {
    let proportions = check(request)?;
    let radius_m = request.radius_m - request.spacing_m / 3f64.sqrt();
    let (swath_m, lane_swath_m) = (2.0 * radius_m, 2.0 * (radius_m - request.margin_m));
    if lane_swath_m <= 0.0 {
        let SweepRequest { radius_m, spacing_m, margin_m, .. } = *request;
        return Err(SweepError::NoSwath { radius_m, spacing_m, margin_m });
    }
    let MinWidth { width_m, direction_rad } = region.min_width();
    let lanes = (width_m / lane_swath_m).ceil();
    if lanes > MAX_LANES {
        return Err(SweepError::TooManyLanes { width_m, swath_m: lane_swath_m, lanes });
    }
    let reach = Reach {
        radius_m: radius_m - request.margin_m,
        clearance_m: request.spacing_m / 3f64.sqrt() + request.margin_m + CORNER_ROOM_M,
    };
    let planner = Planner {
        region,
        proportions: &proportions,
        direction_rad,
        lane_swath_m,
        speed_mps: request.speed_mps,
        timing: Timing::new(request.speed_mps, &request.corner),
        entry_m: request.entry_m.as_deref().unwrap_or_default(),
        reach,
        routes: Routes::new(region.no_fly(), reach.clearance_m, ROOM_M, |_| true),
        clearance_m: apart::clearance_m(request.spacing_m),
    };
    let (split, shares) = planner.shares(request.split)?;
    let tracks: Vec<Vec<Stadium>> = shares.iter().map(|s| swept(&s.way.path_m, radius_m)).collect();
    let whole = covered_region(region, &tracks.concat());
    let sub_area = |(fleet, (share, track)): (usize, (Share, &Vec<Stadium>))| {
        let Share { region: own, way } = share;
        let [approach_m, way_back_m] =
            planner.transits_m(fleet, &way).ok_or(SweepError::NoApproach { fleet })?;
        let (area_m2, covered_fraction) = match &own {
            Some(own) => (own.area_m2(), covered_region(own, track).covered_fraction),
            None => {
                (region.area_m2() - covered_region(region, track).uncovered_area_m2, whole.covered_fraction)
            }
        };
        Ok(SubArea {
            fleet,
            proportion: proportions[fleet],
            approach_m,
            way_back_m,
            region: own,
            area_m2,
            direction_rad: way.direction_rad,
            length_m: way.length_m,
            turns: way.turns,
            duration_s: planner.timing.duration_s(&way.path_m),
            covered_fraction,
            path_m: way.path_m,
        })
    };
    let separation_m = planner.separation_m(&shares);
    let sub_areas = shares.into_iter().zip(&tracks).enumerate().map(sub_area).collect::<Result<_, _>>()?;
    Ok(SweepPlan {
        split,
        direction_rad,
        width_m,
        swath_m,
        margin_m: request.margin_m,
        sub_areas,
        covered_fraction: whole.covered_fraction,
        residue_m: whole.residue,
        separation_m,
    })
}

/// The stadiums that a disk sweeps over along a path.
fn swept(path_m: &[V2], radius_m: f64) -> Vec<Stadium> {
    match path_m {
        [only] => vec![Stadium { a: *only, b: *only, radius_m }],
        _ => path_m.windows(2).map(|w| Stadium { a: w[0], b: w[1], radius_m }).collect(),
    }
}

#[cfg(test)]
mod tests;
