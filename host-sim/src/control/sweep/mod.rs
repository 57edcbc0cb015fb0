//! Stage one: who sweeps what, and along which lanes (the paper's Section 3.1 and Table 1).
//!
//! The sweep runs parallel to the edge across which the area is narrowest. The fleets either get sub-areas
//! cut parallel to the sweep (the paper's way) or share one zigzag over the whole area, cut by flying
//! time; the second way needs fewer lanes in all, because only one width is rounded up to whole swaths.

mod cut;
mod lanes;
mod request;
mod timing;

pub use request::{CornerModel, SplitMode, SweepError, SweepRequest};

use crate::geometry::V2;
use crate::geometry::coverage::{Stadium, covered};
use crate::geometry::polygon::{Polygon, clip, extent};
use crate::geometry::region::Region;
use lanes::{Lane, lanes, zigzag};
use request::{MAX_LANES, check};
use timing::{Timing, length_m, part};

/// One fleet's part of the sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct SubArea {
    /// The fleet, from 0.
    pub fleet: usize,
    /// Its share of the area, or of the flying time.
    pub proportion: f64,
    /// Its sub-area; none where the fleets share one zigzag.
    pub polygon: Option<Polygon>,
    /// The way of the centre of its overlap disk, corner by corner.
    pub path_m: Vec<V2>,
    /// Length of that way, metres.
    pub length_m: f64,
    /// Changes from one lane to the next (two corners each). A change flown by two fleets counts for both.
    pub turns: usize,
    /// Flying time: cruise plus what the corners cost, without the way to the first lane, seconds.
    pub duration_s: f64,
    /// Share of the fleet's own part that its path covers: of its sub-area, or of the strips of its lanes
    /// up to the cuts.
    pub covered_fraction: f64,
}

/// A sweep of the whole area.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepPlan {
    /// The way of sharing used, never `Auto`.
    pub split: SplitMode,
    /// Direction of the lanes, from east, in [0, pi).
    pub direction_rad: f64,
    /// Least width of the area, metres; the lanes run across it.
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
}

impl SweepPlan {
    /// Flying time of the slowest fleet, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.sub_areas.iter().map(|s| s.duration_s).fold(0.0, f64::max)
    }
}

/// Plans the sweep of a convex area.
///
/// # Assumptions
/// Each fleet keeps its triangle, so it covers at least the disk of radius `R - d / sqrt(3)` around its
/// centre, whichever way the triangle points. Lanes run straight; a lane ends where its disk already
/// reaches the border, and where the border is oblique it may end outside of the area by less than the
/// height of a strip.
///
/// # Small areas
/// An area whose extents along and across the sweep are both less than a swath is refused: there is
/// nothing to sweep (any area that one position covers is among these). A long area narrower than a
/// swath is one lane.
///
/// # Errors
/// [`SweepError`] names the field, what was found and what is expected.
pub fn plan(region: &Region, request: &SweepRequest) -> Result<SweepPlan, SweepError> {
    let proportions = check(request)?;
    let Some(polygon) = region.as_convex() else {
        let corner = region.parts().iter().find_map(|part| part.outer.first_reflex_m());
        let corner = corner.or_else(|| region.outer_vertices_m().next()).unwrap_or_default();
        return Err(SweepError::NotConvex { x_m: corner.x, y_m: corner.y });
    };
    let radius_m = request.radius_m - request.spacing_m / 3f64.sqrt();
    let (swath_m, lane_swath_m) = (2.0 * radius_m, 2.0 * (radius_m - request.margin_m));
    if lane_swath_m <= 0.0 {
        let SweepRequest { radius_m, spacing_m, margin_m, .. } = *request;
        return Err(SweepError::NoSwath { radius_m, spacing_m, margin_m });
    }
    let narrowest = polygon.min_width();
    let frame = SweepFrame::new(polygon, narrowest.direction_rad);
    let area = polygon.moved(|p| frame.inward(p));
    let [west, east] = extent(area.vertices_m(), V2::x());
    let (length_m, width_m) = (east - west, narrowest.width_m);
    if length_m < swath_m && width_m < swath_m {
        return Err(SweepError::AreaTooSmall { length_m, width_m, swath_m });
    }
    let lanes = (width_m / lane_swath_m).ceil();
    if lanes > MAX_LANES {
        return Err(SweepError::TooManyLanes { width_m, swath_m: lane_swath_m, lanes });
    }
    let planner = Planner {
        area,
        proportions,
        lane_swath_m,
        radius_m,
        speed_mps: request.speed_mps,
        timing: Timing::new(request.speed_mps, &request.corner),
        entry_m: request.entry_m.iter().flatten().map(|&p| frame.inward(p)).collect(),
    };
    let (split, mut sub_areas) = match request.split {
        SplitMode::Area => (SplitMode::Area, planner.by_area()?),
        SplitMode::Length => (SplitMode::Length, planner.by_length()),
        SplitMode::Auto => planner.faster()?,
    };
    for s in &mut sub_areas {
        s.path_m.iter_mut().for_each(|p| *p = frame.outward(*p));
        s.polygon = s.polygon.take().map(|polygon| polygon.moved(|p| frame.outward(p)));
    }
    let track: Vec<Stadium> = sub_areas.iter().flat_map(|s| swept(&s.path_m, radius_m)).collect();
    let covered_fraction = covered(polygon, &track).covered_fraction;
    let (direction_rad, margin_m) = (narrowest.direction_rad, request.margin_m);
    Ok(SweepPlan { split, direction_rad, width_m, swath_m, margin_m, sub_areas, covered_fraction })
}

/// Local coordinates turned so that the lanes run along x.
struct SweepFrame {
    centre: V2,
    along: V2,
}

impl SweepFrame {
    fn new(polygon: &Polygon, direction_rad: f64) -> Self {
        let [min, max] = polygon.bbox_m();
        Self { centre: (min + max) / 2.0, along: V2::new(direction_rad.cos(), direction_rad.sin()) }
    }

    fn across(&self) -> V2 {
        V2::new(-self.along.y, self.along.x)
    }

    fn inward(&self, p: V2) -> V2 {
        V2::new(self.along.dot(&(p - self.centre)), self.across().dot(&(p - self.centre)))
    }

    fn outward(&self, p: V2) -> V2 {
        self.centre + self.along * p.x + self.across() * p.y
    }
}

/// What the two ways of sharing need to know; all in the sweep frame.
struct Planner {
    area: Polygon,
    proportions: Vec<f64>,
    lane_swath_m: f64,
    radius_m: f64,
    speed_mps: f64,
    timing: Timing,
    /// Empty when nothing is known about where the fleets come from.
    entry_m: Vec<V2>,
}

impl Planner {
    /// The paper's way: sub-areas by proportion, a zigzag each.
    fn by_area(&self) -> Result<Vec<SubArea>, SweepError> {
        let cuts_m = cut::cut_heights_m(&self.area, &self.proportions);
        let parts = cut::parts(&self.area, &cuts_m);
        self.proportions
            .iter()
            .zip(parts)
            .enumerate()
            .map(|(fleet, (&proportion, part))| {
                let part = part.ok_or(SweepError::ShareTooSmall { fleet, proportion })?;
                let lanes = lanes(&part, self.lane_swath_m);
                let [forth, mirrored] = [true, false].map(|from_west| zigzag(&lanes, from_west));
                let ways = [&forth, &mirrored].into_iter().flat_map(|way| [way.clone(), reversed(way)]);
                let path_m = least(ways, |way| self.end_s(fleet, way));
                let covered_fraction = covered(&part, &swept(&path_m, self.radius_m)).covered_fraction;
                let turns = lanes.len() - 1;
                Ok(self.sub_area(fleet, Some(part), path_m, turns, covered_fraction))
            })
            .collect()
    }

    /// One zigzag over the whole area, each fleet flying the next part of it. All fleets fly the same way
    /// along, so that no two of them ever head for the same cut.
    fn by_length(&self) -> Vec<SubArea> {
        let lanes = lanes(&self.area, self.lane_swath_m);
        let shared = [true, false].map(|from_west| {
            let way = zigzag(&lanes, from_west);
            let cuts_m = self.timing.cuts_m(&way, &self.proportions);
            (way, cuts_m)
        });
        let ways = shared.iter().flat_map(|(way, cuts_m)| [(way, cuts_m, false), (way, cuts_m, true)]);
        let paths = |&(way, cuts_m, backwards): &(&Vec<V2>, &Vec<f64>, bool)| -> Vec<Vec<V2>> {
            let starts = [0.0].into_iter().chain(cuts_m.iter().copied());
            let parts = starts.zip(cuts_m).map(|(from_m, &to_m)| part(way, from_m, to_m));
            parts.map(|p| if backwards { reversed(&p) } else { p }).collect()
        };
        let best = least(ways, |way| {
            let ends = paths(way).into_iter().enumerate().map(|(fleet, path_m)| self.end_s(fleet, &path_m));
            ends.fold(0.0, f64::max)
        });
        let mut from_m = 0.0;
        let mut sub_areas = Vec::with_capacity(self.proportions.len());
        for ((fleet, path_m), &to_m) in paths(&best).into_iter().enumerate().zip(best.1) {
            let served = served(&lanes, best.0, from_m, to_m);
            let covered_fraction = covered_share(&served.strips_m, &swept(&path_m, self.radius_m));
            sub_areas.push(self.sub_area(fleet, None, path_m, served.turns, covered_fraction));
            from_m = to_m;
        }
        sub_areas
    }

    fn faster(&self) -> Result<(SplitMode, Vec<SubArea>), SweepError> {
        let slowest_s = |sub_areas: &[SubArea]| {
            sub_areas.iter().map(|s| self.end_s(s.fleet, &s.path_m)).fold(0.0, f64::max)
        };
        let (area, length) = (self.by_area()?, self.by_length());
        let gains = slowest_s(&length) < slowest_s(&area) * (1.0 - 1e-9);
        Ok(if gains { (SplitMode::Length, length) } else { (SplitMode::Area, area) })
    }

    /// When a fleet is done: the straight way from its entry point, where that is known, and its path.
    fn end_s(&self, fleet: usize, path_m: &[V2]) -> f64 {
        let transit_m = match (self.entry_m.get(fleet), path_m.first()) {
            (Some(entry_m), Some(start_m)) => (start_m - entry_m).norm(),
            _ => 0.0,
        };
        transit_m / self.speed_mps + self.timing.duration_s(path_m)
    }

    fn sub_area(
        &self,
        fleet: usize,
        polygon: Option<Polygon>,
        path_m: Vec<V2>,
        turns: usize,
        covered_fraction: f64,
    ) -> SubArea {
        SubArea {
            fleet,
            proportion: self.proportions[fleet],
            polygon,
            length_m: length_m(&path_m),
            turns,
            duration_s: self.timing.duration_s(&path_m),
            covered_fraction,
            path_m,
        }
    }
}

/// What a part of the shared zigzag serves.
#[derive(Default)]
struct Served {
    strips_m: Vec<Vec<V2>>,
    turns: usize,
}

/// The strips, or parts of strips, of the lanes between two cuts.
fn served(lanes: &[Lane], way_m: &[V2], from_m: f64, to_m: f64) -> Served {
    const SLACK_M: f64 = 1e-6;
    let mut served = Served::default();
    let mut at_m = 0.0;
    let mut rest = way_m;
    for (i, lane) in lanes.iter().enumerate() {
        let corners = if lane.west_m == lane.east_m { 1 } else { 2 };
        let (leg, after) = rest.split_at(corners);
        let (start_m, end_m) = (at_m, at_m + length_m(leg));
        if start_m <= to_m + SLACK_M && end_m >= from_m - SLACK_M {
            let mut strip_m = lane.strip_m.clone();
            let along = (leg[corners - 1] - leg[0]).try_normalize(0.0).unwrap_or_else(V2::x);
            let cut = |s_m: f64| along.dot(&leg[0]) + s_m - start_m;
            if to_m < end_m - SLACK_M {
                strip_m = clip(&strip_m, along, cut(to_m));
            }
            if from_m > start_m + SLACK_M {
                strip_m = clip(&strip_m, -along, -cut(from_m));
            }
            served.strips_m.push(strip_m);
        }
        if let Some(&next) = after.first() {
            at_m = end_m + (next - leg[corners - 1]).norm();
            // The change to the next lane, if any of it lies between the cuts.
            served.turns +=
                usize::from(i + 1 < lanes.len() && end_m < to_m - SLACK_M && at_m > from_m + SLACK_M);
        }
        rest = after;
    }
    served
}

/// Share of some rings' area that a track covers.
fn covered_share(rings_m: &[Vec<V2>], track: &[Stadium]) -> f64 {
    let (mut area_m2, mut uncovered_m2) = (0.0, 0.0);
    for polygon in rings_m.iter().filter_map(|ring| Polygon::new(ring).ok()) {
        area_m2 += polygon.area_m2();
        uncovered_m2 += covered(&polygon, track).uncovered_area_m2;
    }
    if area_m2 > 0.0 { 1.0 - uncovered_m2 / area_m2 } else { 1.0 }
}

/// The stadiums that a disk sweeps over along a path.
fn swept(path_m: &[V2], radius_m: f64) -> Vec<Stadium> {
    match path_m {
        [only] => vec![Stadium { a: *only, b: *only, radius_m }],
        _ => path_m.windows(2).map(|w| Stadium { a: w[0], b: w[1], radius_m }).collect(),
    }
}

fn reversed(path_m: &[V2]) -> Vec<V2> {
    path_m.iter().rev().copied().collect()
}

/// The item of least cost; the first of those that differ by no more than rounding.
///
/// # Panics
/// If there is no item.
fn least<T>(items: impl Iterator<Item = T>, cost: impl Fn(&T) -> f64) -> T {
    let mut best: Option<(f64, T)> = None;
    for item in items {
        let found = cost(&item);
        if best.as_ref().is_none_or(|(lowest, _)| found < lowest * (1.0 - 1e-12)) {
            best = Some((found, item));
        }
    }
    let Some((_, item)) = best else { panic!("there is always a way to choose from") };
    item
}

#[cfg(test)]
mod tests;
