//! Shares the sweep among the fleets: by sub-areas, or by cutting one way over the whole.

use std::f64::consts::PI;
use std::slice;

use crate::geometry::V2;
use crate::geometry::region::Region;

use super::anywhere::Reach;
use super::frame::SweepFrame;
use super::route::Routes;
use super::timing::{Timing, length_m, part};
use super::{SplitMode, SweepError, Way, anywhere, apart, convex, cut};

/// What both ways of sharing need to know.
pub(super) struct Planner<'a> {
    pub(super) region: &'a Region,
    pub(super) proportions: &'a [f64],
    /// Of the sweep.
    pub(super) direction_rad: f64,
    pub(super) lane_swath_m: f64,
    pub(super) reach: Reach,
    pub(super) speed_mps: f64,
    pub(super) timing: Timing,
    /// Empty when nothing is known about where the fleets come from.
    pub(super) entry_m: &'a [V2],
    /// Ways around the no-fly zones.
    pub(super) routes: Routes,
    /// Distance that two fleets' centres should keep.
    pub(super) clearance_m: f64,
}

/// What one fleet gets.
pub(super) struct Share {
    /// Its sub-area; none where the fleets share one way.
    pub(super) region: Option<Region>,
    pub(super) way: Way,
}

/// Rounding: less is no difference between two costs.
const EQUAL: f64 = 1e-9;

impl Planner<'_> {
    /// The shares in the mode asked for, and the mode taken.
    pub(super) fn shares(&self, split: SplitMode) -> Result<(SplitMode, Vec<Share>), SweepError> {
        match split {
            SplitMode::Area => Ok((SplitMode::Area, self.by_area()?.0)),
            SplitMode::Length => Ok((SplitMode::Length, self.by_length(f64::INFINITY)?)),
            SplitMode::Auto => self.better(),
        }
    }

    /// By length where the slowest fleet's lanes take less time, all of them are no longer than plain lanes by area,
    /// and the fleets keep as far apart as they should.
    fn better(&self) -> Result<(SplitMode, Vec<Share>), SweepError> {
        let (area, plain_m) = self.by_area()?;
        let length = self.by_length(plain_m)?;
        let gains = self.slowest_s(&length) < self.slowest_s(&area) * (1.0 - EQUAL)
            && total_m(&length) <= plain_m * (1.0 + EQUAL)
            && (self.keeps_apart(&length) || !self.keeps_apart(&area));
        Ok(if gains { (SplitMode::Length, length) } else { (SplitMode::Area, area) })
    }

    /// The paper's way: sub-areas by proportion, each with lanes of its own; and the length of plain lanes over
    /// all of them. The first fleet gets the sub-area at the one end of the area or at the other: whichever ends
    /// first and is no longer than plain lanes in either order.
    fn by_area(&self) -> Result<(Vec<Share>, f64), SweepError> {
        let [forth, back] = [self.direction_rad, self.direction_rad + PI].map(|d| self.by_area_along(d));
        let ((forth, forth_m), (back, back_m)) = (forth?, back?);
        let plain_m = forth_m.min(back_m);
        let allowed = |shares: &Vec<Share>| total_m(shares) <= plain_m * (1.0 + 2.0 * EQUAL);
        let found = least([forth, back].into_iter().filter(allowed), |shares| self.end_of_all_s(shares));
        Ok((found, plain_m))
    }

    fn by_area_along(&self, direction_rad: f64) -> Result<(Vec<Share>, f64), SweepError> {
        let frame = SweepFrame::new(self.region.bbox_m(), direction_rad);
        let area = self.region.moved(|p| frame.inward(p));
        let cuts_m = cut::cut_heights_m(&area, self.proportions);
        let mut shares = Vec::with_capacity(self.proportions.len());
        let mut plain_total_m = 0.0;
        for (fleet, part) in cut::parts(&area, &cuts_m).into_iter().enumerate() {
            let proportion = self.proportions[fleet];
            let region =
                part.ok_or(SweepError::ShareTooSmall { fleet, proportion })?.moved(|p| frame.outward(p));
            let ways = self.ways(&region)?;
            let plain_m = shortest_plain_m(&ways);
            plain_total_m += plain_m;
            let allowed = ways.iter().filter(|way| way.length_m <= plain_m * (1.0 + EQUAL));
            let both = allowed.flat_map(|way| [way.clone(), way.reversed()]);
            shares.push(Share { region: Some(region), way: least(both, |way| self.end_s(fleet, way)) });
        }
        self.turn_apart(&mut shares);
        Ok((shares, plain_total_m))
    }

    /// One way over the whole area, each fleet flying the next part of it. All fleets fly the same way
    /// along, so that no two of them ever head for the same cut. Ways longer than `most_m` are left out, as long as
    /// there is another.
    fn by_length(&self, most_m: f64) -> Result<Vec<Share>, SweepError> {
        let ways = self.ways(self.region)?;
        let most_m = most_m.max(shortest_plain_m(&ways)) * (1.0 + EQUAL);
        let allowed = ways.iter().filter(|way| way.length_m <= most_m);
        let both = allowed.flat_map(|way| [way.clone(), way.reversed()]);
        let shared = both.flat_map(|way| {
            let cuts_m = self.timing.cuts_m(&way.path_m, self.proportions);
            [false, true].map(|backwards| way.cut_at(&cuts_m, backwards))
        });
        let cost = |ways: &Vec<Way>| {
            let ends_s = ways.iter().enumerate().map(|(fleet, way)| self.end_s(fleet, way));
            ends_s.fold(0.0, f64::max)
        };
        Ok(least(shared, cost).into_iter().map(|way| Share { region: None, way }).collect())
    }

    fn ways(&self, region: &Region) -> Result<Vec<Way>, SweepError> {
        match region.as_convex() {
            Some(polygon) => Ok(convex::ways(polygon, self.direction_rad, self.lane_swath_m)),
            None => anywhere::ways(region, self.direction_rad, self.reach),
        }
    }

    /// When a fleet is done: the shortest way from its entry point, where that is known, and its way.
    fn end_s(&self, fleet: usize, way: &Way) -> f64 {
        let transit_m = match (self.entry_m.get(fleet), way.path_m.first()) {
            (Some(&entry_m), Some(&start_m)) => self.routes.distances_m(entry_m, &[start_m])[0],
            _ => 0.0,
        };
        transit_m / self.speed_mps + self.timing.duration_s(&way.path_m)
    }

    /// The ways from a fleet's entry point to its first lane and from its last lane back, ends left out; none
    /// where there is no way.
    pub(super) fn transits_m(&self, fleet: usize, way: &Way) -> Option<[Vec<V2>; 2]> {
        let ends = way.path_m.first().zip(way.path_m.last());
        let (Some(&entry_m), Some((&first_m, &last_m))) = (self.entry_m.get(fleet), ends) else {
            return Some([Vec::new(), Vec::new()]);
        };
        let inner = |way_m: Vec<V2>| way_m[1..way_m.len() - 1].to_vec();
        Some([inner(self.routes.way(entry_m, first_m)?), inner(self.routes.way(last_m, entry_m)?)])
    }

    /// Flying time of the slowest fleet, without the way to its lanes.
    fn slowest_s(&self, shares: &[Share]) -> f64 {
        shares.iter().map(|s| self.timing.duration_s(&s.way.path_m)).fold(0.0, f64::max)
    }

    fn end_of_all_s(&self, shares: &[Share]) -> f64 {
        shares.iter().enumerate().map(|(fleet, s)| self.end_s(fleet, &s.way)).fold(0.0, f64::max)
    }

    /// Least distance of two fleets; none with a single one.
    pub(super) fn separation_m(&self, shares: &[Share]) -> Option<f64> {
        let flights: Vec<_> = shares.iter().map(|s| self.timing.flight(&s.way.path_m)).collect();
        apart::separation_m(&flights)
    }

    fn keeps_apart(&self, shares: &[Share]) -> bool {
        self.separation_m(shares).is_none_or(|m| m >= self.clearance_m)
    }

    /// Where fleets come too near to each other, turns ways round one by one, as long as that helps.
    fn turn_apart(&self, shares: &mut [Share]) {
        for fleet in 1..shares.len() {
            let (before, rest) = shares.split_at_mut(fleet);
            let share = &mut rest[0];
            let near_m = |way: &Way| {
                let own = self.timing.flight(&way.path_m);
                let others = before.iter().map(|s| self.timing.flight(&s.way.path_m));
                others.map(|other| apart::closest_m(&own, &other)).fold(f64::INFINITY, f64::min)
            };
            let turned = share.way.reversed();
            let (as_it_is_m, turned_m) = (near_m(&share.way), near_m(&turned));
            if as_it_is_m < self.clearance_m && turned_m > as_it_is_m {
                share.way = turned;
            }
        }
    }
}

fn total_m(shares: &[Share]) -> f64 {
    shares.iter().map(|s| s.way.length_m).sum()
}

fn shortest_plain_m(ways: &[Way]) -> f64 {
    convex::plain_ways(ways).iter().map(|way| way.length_m).fold(f64::INFINITY, f64::min)
}

impl Way {
    fn reversed(&self) -> Self {
        Self { path_m: self.path_m.iter().rev().copied().collect(), ..self.clone() }
    }

    /// The parts between cuts, each flown backwards or not.
    fn cut_at(&self, cuts_m: &[f64], backwards: bool) -> Vec<Self> {
        let starts_m = slice::from_ref(&0.0).iter().chain(cuts_m);
        let piece = |(&from_m, &to_m): (&f64, &f64)| {
            let path_m = part(&self.path_m, from_m, to_m);
            let turns = path_m.len().saturating_sub(1) / 2;
            let way = Self { length_m: length_m(&path_m), path_m, turns, ..self.clone() };
            if backwards { way.reversed() } else { way }
        };
        starts_m.zip(cuts_m).map(piece).collect()
    }
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
