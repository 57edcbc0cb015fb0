//! Regrouping: what is left to be swept when drones fall out, who flies it together, and along which lanes.
//!
//! Fleets that are whole stay together; survivors of the others, reserves and drones that came back are put together in threes,
//! those first that are farthest from everybody. What is left of the area is what no fleet has flown over so far, by the
//! way that all three of it had come along their lanes; it is shared out by what the batteries still hold (the paper's
//! proportions p_i, section 3.1). [`assemble`](super::assemble) then brings the threes into formation from wherever they are.

use super::{
    airspace::KeepOut,
    assemble::{Assembly, assembly, centres_m, slots_taken},
    mission::plan::{MissionPlan, PlannedFleet, Resweep},
    sweep::{self, SweepPlan, SweepRequest},
};
use crate::geometry::{
    V2,
    coverage::Stadium,
    polygon::Polygon,
    region::{Part, Region},
};
use skyroost_protocol::{message::MAX_WAYPOINTS, units::DroneId};
use std::ops::Range;

/// Least share of a fleet in what is left, of an equal one.
const LEAST_SHARE: f64 = 0.05;
/// How far the border of what counts as swept may lie within that of what was, metres, and how far at most.
const WITHIN_M: [f64; 2] = [0.02, 0.5];

/// A drone that can fly on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survivor {
    /// Its index in the plan of the mission.
    pub drone: usize,
    /// Where it is.
    pub pos_m: V2,
    /// Charge that it can spend before it has to return, per mille.
    pub charge_permille: u16,
}

/// The rest of a sweep.
#[derive(Clone, Debug)]
pub struct Regrouped {
    /// Who flies it, and along which lanes.
    pub fleets: Vec<PlannedFleet>,
    /// Fleet and slot of each of its drones, by index in the plan of the mission.
    pub members: Vec<(usize, (usize, u8))>,
    /// How they get into formation.
    pub assembly: Assembly,
    /// Whether lanes were cut off where no drone holds more: there is something left even then.
    pub cut_off: bool,
}

/// What of a region no stadium covers, with a margin of which half is taken for rounding; none where nothing is left.
#[must_use]
pub fn left(region: &Region, swept: &[Stadium], margin_m: f64) -> Option<Region> {
    let within_m = (0.5 * margin_m).clamp(WITHIN_M[0], WITHIN_M[1]);
    let covers: Vec<Polygon> = swept.iter().filter_map(|it| it.inscribed(within_m)).collect();
    // Between two chords there is nothing that the margin does not cover.
    let is_area = |part: &Part| part.outer.min_width().width_m > 2.0 * within_m;
    region.outside(&covers)?.keep(is_area)
}

/// What a fleet has covered between two ways along its lanes, transit included.
#[must_use]
pub fn swept(waypoints_m: &[V2], way_m: Range<f64>, radius_m: f64) -> Vec<Stadium> {
    let mut begin_m = 0.0;
    let mut stadiums = Vec::new();
    for leg in waypoints_m.windows(2) {
        let (a, way) = (leg[0], leg[1] - leg[0]);
        let long_m = way.norm();
        let [from_m, to_m] = [way_m.start, way_m.end].map(|m| (m - begin_m).clamp(0.0, long_m));
        begin_m += long_m;
        if from_m < to_m {
            let at = |m: f64| if m < long_m { a + way * (m / long_m) } else { leg[1] };
            stadiums.push(Stadium { a: at(from_m), b: at(to_m), radius_m });
        }
    }
    stadiums
}

/// The whole fleets and the threes that the others make up; at most two are left over.
#[must_use]
pub fn threes(whole: &[[usize; 3]], survivors: &[Survivor]) -> Vec<[Survivor; 3]> {
    let of = |drone: usize| survivors.iter().find(|it| it.drone == drone).copied();
    let mut fleets: Vec<[Survivor; 3]> = Vec::new();
    for members in whole {
        if let [Some(a), Some(b), Some(c)] = members.map(of) {
            fleets.push([a, b, c]);
        }
    }
    let taken = |it: &Survivor| fleets.iter().flatten().any(|member| member.drone == it.drone);
    let mut others: Vec<Survivor> = survivors.iter().filter(|it| !taken(it)).copied().collect();
    while others.len() >= 3 {
        let apart_m2 = |a: &Survivor, b: &Survivor| (a.pos_m - b.pos_m).norm_squared();
        let nearest_m2 = |it: &Survivor| {
            let rest = others.iter().filter(|other| other.drone != it.drone);
            rest.map(|other| apart_m2(it, other)).fold(f64::INFINITY, f64::min)
        };
        let lonely = others.iter().max_by(|a, b| nearest_m2(a).total_cmp(&nearest_m2(b)));
        let Some(&first) = lonely else { break };
        others
            .sort_by(|a, b| apart_m2(a, &first).total_cmp(&apart_m2(b, &first)).then(a.drone.cmp(&b.drone)));
        let mut fleet = [others[0], others[1], others[2]];
        fleet.sort_by_key(|it| it.drone);
        fleets.push(fleet);
        others.drain(..3);
    }
    fleets
}

/// Plans the rest of a sweep for these threes, or for fewer of them where there is too little left for all; none where nobody
/// can fly it. Nobody meets where somebody lost may be.
#[must_use]
pub fn regroup(
    plan: &MissionPlan,
    again: &Resweep,
    left: &Region,
    mut threes: Vec<[Survivor; 3]>,
    lost: &[KeepOut],
) -> Option<Regrouped> {
    let [low, high] = left.bbox_m();
    let centre_m = |three: &[Survivor; 3]| three.iter().map(|it| it.pos_m).sum::<V2>() / 3.0;
    let away_m = |three: &[Survivor; 3]| {
        let at = centre_m(three);
        (at - V2::new(at.x.clamp(low.x, high.x), at.y.clamp(low.y, high.y))).norm()
    };
    threes.sort_by(|a, b| away_m(a).total_cmp(&away_m(b)));
    while !threes.is_empty() {
        let places: Vec<[V2; 3]> = threes.iter().map(|three| three.map(|it| it.pos_m)).collect();
        let planned = centres_m(&again.room, &places, plan.spacing_m, again.passing_m, lost)
            .and_then(|centres| Some((shared(again, left, &threes, &centres, plan.spacing_m)?, centres)));
        if let Some((sweep, centres)) = planned {
            return Some(crewed(plan, again, &sweep, &threes, &centres));
        }
        threes.pop();
    }
    None
}

/// The sweep of what is left by so many fleets; none where a fleet would have less than its own size to fly.
fn shared(
    again: &Resweep,
    left: &Region,
    threes: &[[Survivor; 3]],
    centres_m: &[V2],
    spacing_m: f64,
) -> Option<SweepPlan> {
    let charge =
        |three: &[Survivor; 3]| three.iter().map(|it| f64::from(it.charge_permille)).fold(f64::MAX, f64::min);
    let mean = threes.iter().map(charge).sum::<f64>() / threes.len() as f64;
    let shares: Vec<f64> =
        threes.iter().map(|three| charge(three).max(LEAST_SHARE * mean).max(1.0)).collect();
    let sum: f64 = shares.iter().sum();
    let request = SweepRequest {
        fleets: threes.len(),
        proportions: shares.iter().map(|share| share / sum).collect(),
        entry_m: Some(centres_m.to_vec()),
        ..again.request.clone()
    };
    let sweep = sweep::plan(left, &request).ok()?;
    let is_long = sweep.sub_areas.iter().all(|sub| sub.length_m >= spacing_m);
    (threes.len() == 1 || is_long).then_some(sweep)
}

/// Gives the lanes to the threes, and everybody a slot.
fn crewed(
    plan: &MissionPlan,
    again: &Resweep,
    sweep: &SweepPlan,
    threes: &[[Survivor; 3]],
    centres_m: &[V2],
) -> Regrouped {
    let most = MAX_WAYPOINTS - plan.walls_mm.len();
    let mut clock_groups = plan.fleets.iter().map(|fleet| fleet.clock_group).max().map_or(0, |last| last + 1);
    let (mut fleets, mut members, mut ends) = (Vec::new(), Vec::new(), Vec::new());
    let mut cut_off = false;
    for (index, (three, &centre_m)) in threes.iter().zip(centres_m).enumerate() {
        let mut fleet = PlannedFleet::along(sweep, index, centre_m, [DroneId::CONTROL; 3], 0);
        let waypoints_m = &mut fleet.waypoints_m;
        for at in waypoints_m.iter_mut() {
            // A lane may end outside of the area, and the fence was drawn around other lanes.
            if !again.room.allows(*at) {
                *at = again.room.nearest_allowed(*at).unwrap_or(*at);
            }
        }
        cut_off |= waypoints_m.len() > most;
        waypoints_m.truncate(most);
        let slots_m = fleet.slots_m(plan.heading, plan.orientation_rad, plan.spacing_m);
        let taken = slots_taken(&three.map(|it| it.pos_m), &slots_m);
        for (slot, &member) in (0u8..).zip(&taken) {
            let it = three[member];
            members.push((it.drone, (index, slot)));
            ends.push((it.drone, it.pos_m, slots_m[usize::from(slot)]));
        }
        fleet.mates = taken.map(|member| plan.drones[three[member].drone].id);
        fleet.clock_group = known_group(plan, fleet.mates).unwrap_or_else(|| {
            clock_groups += 1;
            clock_groups - 1
        });
        fleets.push(fleet);
    }
    let assembly = assembly(&plan.airspace, &ends, plan.altitude_m, again.passing_m);
    Regrouped { fleets, members, assembly, cut_off }
}

/// The clock group of these three, if they flew together before.
fn known_group(plan: &MissionPlan, mates: [DroneId; 3]) -> Option<u16> {
    let known = plan.fleets.iter().find(|fleet| mates.iter().all(|mate| fleet.mates.contains(mate)));
    known.map(|fleet| fleet.clock_group)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::coverage::covered_region;
    use proptest::prelude::*;

    fn survivor(drone: usize, x: f64, y: f64) -> Survivor {
        Survivor { drone, pos_m: V2::new(x, y), charge_permille: 500 }
    }

    #[test]
    fn whole_fleets_stay_and_the_loneliest_finds_company_first() {
        let all = [
            survivor(0, 0.0, 0.0),
            survivor(1, 50.0, 0.0),
            survivor(2, 25.0, 43.0),
            survivor(3, 1_000.0, 0.0),
            survivor(4, 1_050.0, 0.0),
            survivor(7, 3_000.0, 0.0),
            survivor(8, 3_050.0, 0.0),
            survivor(9, 9_000.0, 0.0),
        ];
        let found = threes(&[[0, 1, 2], [3, 4, 5], [6, 7, 8]], &all);
        let drones = |three: &[Survivor; 3]| three.map(|it| it.drone);
        assert_eq!(found.iter().map(drones).collect::<Vec<_>>(), [[0, 1, 2], [7, 8, 9]]);
        assert!(threes(&[], &all[..2]).is_empty(), "two are no fleet");
    }

    fn square(side_m: f64) -> Region {
        Polygon::new(&[[0.0, 0.0], [side_m, 0.0], [side_m, side_m], [0.0, side_m]].map(V2::from))
            .unwrap()
            .into()
    }

    #[test]
    fn nothing_is_left_of_an_area_whose_lanes_were_flown() {
        let region = square(3_000.0);
        let request = SweepRequest {
            fleets: 1,
            proportions: vec![1.0],
            split: sweep::SplitMode::Auto,
            radius_m: 500.0,
            spacing_m: 50.0,
            speed_mps: 10.0,
            corner: sweep::CornerModel { max_accel_mps2: 2.5, corner_speed_mps: 3.0 },
            margin_m: 2.0,
            entry_m: None,
        };
        let path_m = &sweep::plan(&region, &request).unwrap().sub_areas[0].path_m;
        let radius_m = 500.0 - 50.0 / 3f64.sqrt();
        assert_eq!(left(&region, &swept(path_m, 0.0..f64::INFINITY, radius_m), 2.0), None);
        let half = left(&region, &swept(path_m, 0.0..4_000.0, radius_m), 2.0).unwrap();
        assert!(half.area_m2() > 1e6 && half.area_m2() < 8e6);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// What was swept and what is left are the whole: the area that is left is what exact coverage says is not covered, but for
        /// the margin along the border.
        #[test]
        fn what_is_left_is_what_is_not_covered(
            places in prop::collection::vec(prop::array::uniform2(0.0..3_000.0f64), 2..12),
            way_m in 0.0..9_000.0f64,
        ) {
            let (region, radius_m) = (square(3_000.0), 300.0);
            let track: Vec<V2> = places.iter().copied().map(V2::from).collect();
            let stadiums = swept(&track, 0.0..way_m, radius_m);
            let uncovered_m2 = covered_region(&region, &stadiums).uncovered_area_m2;
            let left_m2 = left(&region, &stadiums, 2.0).map_or(0.0, |it| it.area_m2());
            let border_m: f64 = stadiums.iter().map(|s| 2.0 * (s.b - s.a).norm() + 6.3 * s.radius_m).sum();
            prop_assert!(left_m2 >= uncovered_m2 - border_m * 0.5 - 1.0, "{left_m2} of {uncovered_m2}");
            prop_assert!(left_m2 <= uncovered_m2 + border_m * 0.5 + 1.0, "{left_m2} of {uncovered_m2}");
            if let Some(left) = left(&region, &stadiums, 2.0) {
                for part in left.parts() {
                    for at in part.outer.vertices_m() {
                        let within = stadiums.iter().any(|s| s.axis_distance_m(*at) < s.radius_m - 0.6);
                        prop_assert!(!within, "{at} was swept");
                    }
                }
            }
        }
    }
}
