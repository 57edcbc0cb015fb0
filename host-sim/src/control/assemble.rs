//! Assembly: from pads anywhere to fleets in formation, so that nobody can meet anybody, whoever is late.
//!
//! A fleet meets at the centroid of its pads, or near it where that is taken or not allowed. Its slots go to its drones
//! by the least sum of squared ways, which keeps straight ways from crossing each other (Turpin, Michael, Kumar, "CAPT:
//! Concurrent assignment and planning of trajectories for multiple robots", IJRR 33 (2014) 98-112, theorem 4.3). CAPT
//! then moves all at once, on a common clock, and asks for pads so far apart that this suffices. Here nobody has to be
//! on time: ways that come too near to each other get altitudes of their own, and the flight has three phases, each
//! begun when all have ended the one before.
//!
//! 1. All climb above their pads, each to the altitude of its layer. Pads are far enough apart.
//! 2. All fly to their slots, level. Ways within a layer are far enough apart as a whole, layers are as well.
//! 3. All descend above their slots to the altitude of flight. Slots are far enough apart.
//!
//! So two drones keep the distance however the phases are timed (the tests hold random plans against that). Everything
//! here is pure arithmetic on the plan; [`mission`](super::mission) flies it.

use super::airspace::{Airspace, KeepOut};
use crate::geometry::{V2, V3, coverage::Stadium, cross};
use std::f64::consts::TAU;

/// Ways in one layer are this much farther apart than avoidance plans with, metres: a drone is at a corner when it is
/// within 2 m of it, and either may be.
const WAYS_ROOM_M: f64 = 5.0;
/// Layers are this much farther apart than avoidance plans with, metres.
const LAYERS_ROOM_M: f64 = 3.0;
/// Fleets' triangles that stand as near to each other as they may are this much farther apart than avoidance plans
/// with, metres.
const FLEETS_ROOM_M: f64 = 10.0;
/// Fleets stand so many spacings apart where there is room for that.
const FLEETS_SPACINGS: f64 = 3.0;
/// A way around zones has fewer corners than this, or none is found.
const MOST_CORNERS: usize = 64;

/// Drones of a fleet.
pub const FLEET_DRONES: u8 = 3;

/// From the centre of a triangle of side `spacing_m` to its slot, 0 to 2.
#[must_use]
pub fn slot_m(orientation_rad: f64, slot: u8, spacing_m: f64) -> V2 {
    let angle = orientation_rad + f64::from(slot) * TAU / f64::from(FLEET_DRONES);
    V2::new(angle.cos(), angle.sin()) * (spacing_m / 3f64.sqrt())
}

/// The order in which three drones can take three slots.
const PERMUTATIONS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// One drone's way from its pad to its slot.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Index of the drone in the plan of the mission.
    pub drone: usize,
    /// From above the pad to above the slot, corners around zones included; metres.
    pub points_m: Vec<V2>,
    /// Layers above the altitude of flight; 0 for a way that nobody comes near.
    pub layer: usize,
}

/// How all fleets get from their pads into formation.
#[derive(Clone, Debug, PartialEq)]
pub struct Assembly {
    /// The ways of all drones of fleets.
    pub ways: Vec<Way>,
    /// The altitude of flight, metres.
    pub altitude_m: f64,
    /// From layer to layer, metres.
    pub layer_m: f64,
}

/// What is flown one after the other; all end one before any begins the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Above the pads, up to the layers.
    Climb,
    /// From pads to slots, level.
    Cross,
    /// Above the slots, down to the altitude of flight.
    Descend,
}

impl Phase {
    /// All phases in their order.
    pub const ALL: [Self; 3] = [Self::Climb, Self::Cross, Self::Descend];
}

impl Assembly {
    /// Altitude of a way between its ends, metres.
    #[must_use]
    pub fn crossing_m(&self, way: &Way) -> f64 {
        self.altitude_m + self.layer_m * way.layer as f64
    }

    /// Where a drone flies in a phase, one place after the other; nowhere if the phase asks nothing of it.
    #[must_use]
    pub fn goals_m(&self, way: &Way, phase: Phase) -> Vec<V3> {
        let crossing_m = self.crossing_m(way);
        let up_and_down = |end: Option<&V2>, altitude_m: f64| {
            let layered = end.filter(|_| way.layer > 0);
            layered.map(|at| at.push(altitude_m)).into_iter().collect()
        };
        match phase {
            Phase::Climb => up_and_down(way.points_m.first(), crossing_m),
            Phase::Cross => way.points_m.iter().skip(1).map(|at| at.push(crossing_m)).collect(),
            Phase::Descend => up_and_down(way.points_m.last(), self.altitude_m),
        }
    }

    /// Number of layers, the one at the altitude of flight included.
    #[must_use]
    pub fn layers(&self) -> usize {
        self.ways.iter().map(|way| way.layer + 1).max().unwrap_or(0)
    }

    /// Height of the uppermost layer above the altitude of flight, metres.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.layer_m * self.layers().saturating_sub(1) as f64
    }

    /// Length of the longest way, metres.
    #[must_use]
    pub fn longest_m(&self) -> f64 {
        self.ways.iter().map(|way| length_m(&way.points_m)).fold(0.0, f64::max)
    }
}

/// Where fleets meet: each at the centroid of its pads, or as near to it as `room` and the fleets before it allow. The
/// airspace `room` allows what has room for a whole triangle; `plan_m` is the distance that avoidance plans with. No triangle is
/// laid where somebody lost may be. None where the room does not suffice.
#[must_use]
pub fn centres_m(
    room: &Airspace,
    pads_m: &[[V2; 3]],
    spacing_m: f64,
    plan_m: f64,
    lost: &[KeepOut],
) -> Option<Vec<V2>> {
    let triangle_m = spacing_m / 3f64.sqrt();
    let lost: Vec<KeepOut> = lost.iter().map(|it| it.grown(triangle_m)).collect();
    let asked_m: Vec<V2> = pads_m.iter().map(|pads| pads.iter().sum::<V2>() / 3.0).collect();
    let least_m = 2.0 * spacing_m / 3f64.sqrt() + plan_m + FLEETS_ROOM_M;
    let wide_m = least_m.max(FLEETS_SPACINGS * spacing_m);
    let settled =
        |apart_m: f64| room.settled(&asked_m, apart_m, &lost).into_iter().collect::<Option<Vec<V2>>>();
    settled(wide_m).or_else(|| settled(least_m))
}

/// For each slot the drone, by its place in `pads_m`, that flies there: the least sum of squared distances, of several
/// the first.
#[must_use]
pub fn slots_taken(pads_m: &[V2; 3], slots_m: &[V2; 3]) -> [usize; 3] {
    let cost_m2 = |taken: &[usize; 3]| -> f64 {
        taken.iter().zip(slots_m).map(|(&drone, slot)| (slot - pads_m[drone]).norm_squared()).sum()
    };
    let mut best = PERMUTATIONS[0];
    for taken in PERMUTATIONS {
        if cost_m2(&taken) < cost_m2(&best) {
            best = taken;
        }
    }
    best
}

/// The ways of drones (index in the plan, pad, slot) through the airspace, and their layers above `altitude_m`.
/// `plan_m` is the distance that avoidance plans with; pads have to be as far from each other, and slots as well.
#[must_use]
pub fn assembly(airspace: &Airspace, ends_m: &[(usize, V2, V2)], altitude_m: f64, plan_m: f64) -> Assembly {
    let ways_m: Vec<Vec<V2>> = ends_m.iter().map(|&(_, pad, slot)| way_m(airspace, pad, slot)).collect();
    let layers = layers(&ways_m, plan_m + WAYS_ROOM_M);
    let ways = ends_m.iter().zip(ways_m).zip(layers);
    Assembly {
        ways: ways.map(|((&(drone, ..), points_m), layer)| Way { drone, points_m, layer }).collect(),
        altitude_m,
        layer_m: plan_m + LAYERS_ROOM_M,
    }
}

/// From place to place, corner by corner around what is in the way.
fn way_m(airspace: &Airspace, from_m: V2, to_m: V2) -> Vec<V2> {
    let mut points_m = vec![from_m];
    let mut at_m = from_m;
    while at_m != to_m && points_m.len() < MOST_CORNERS {
        at_m = airspace.next_m(at_m, to_m);
        points_m.push(at_m);
    }
    if at_m != to_m || points_m.len() == 1 {
        points_m.push(to_m);
    }
    points_m
}

/// A layer for each way, such that ways within a layer are `apart_m` apart everywhere: greedy colours of the graph of
/// conflicts, whoever has the most of them first (Welsh and Powell, "An upper bound for the chromatic number of a graph",
/// The Computer Journal 10 (1967) 85-86). A way without conflicts is in layer 0.
fn layers(ways_m: &[Vec<V2>], apart_m: f64) -> Vec<usize> {
    let count = ways_m.len();
    let mut conflicts: Vec<Vec<usize>> = vec![Vec::new(); count];
    for a in 0..count {
        for b in a + 1..count {
            if distance_m(&ways_m[a], &ways_m[b]) < apart_m {
                conflicts[a].push(b);
                conflicts[b].push(a);
            }
        }
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|&way| std::cmp::Reverse(conflicts[way].len()));
    let mut layers: Vec<Option<usize>> = vec![None; count];
    for way in order {
        let taken: Vec<usize> = conflicts[way].iter().filter_map(|&other| layers[other]).collect();
        layers[way] = (0..).find(|layer| !taken.contains(layer));
    }
    layers.into_iter().map(Option::unwrap_or_default).collect()
}

/// Least distance of two polylines, metres.
fn distance_m(a: &[V2], b: &[V2]) -> f64 {
    let pairs = a.windows(2).flat_map(|one| b.windows(2).map(move |other| (one, other)));
    pairs
        .map(|(one, other)| legs_distance_m([one[0], one[1]], [other[0], other[1]]))
        .fold(f64::INFINITY, f64::min)
}

/// Least distance of two straight legs, metres: 0 where they cross, else that of an end from the other leg.
fn legs_distance_m([a, b]: [V2; 2], [c, d]: [V2; 2]) -> f64 {
    let sides = |from: V2, to: V2, p: V2, q: V2| cross(to - from, p - from) * cross(to - from, q - from);
    if sides(a, b, c, d) < 0.0 && sides(c, d, a, b) < 0.0 {
        return 0.0;
    }
    let from = |a: V2, b: V2, p: V2| Stadium { a, b, radius_m: 0.0 }.axis_distance_m(p);
    from(a, b, c).min(from(a, b, d)).min(from(c, d, a)).min(from(c, d, b))
}

/// Length of a polyline, metres.
fn length_m(points_m: &[V2]) -> f64 {
    points_m.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::area::Obstacle;
    use crate::geometry::polygon::Polygon;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    const PLAN_M: f64 = 17.0;
    const SPACING_M: f64 = 50.0;
    const ALTITUDE_M: f64 = 100.0;

    fn rectangle(west: f64, south: f64, east: f64, north: f64) -> Polygon {
        Polygon::new(&[[west, south], [east, south], [east, north], [west, north]].map(V2::from)).unwrap()
    }

    /// A square of 2 km around the origin, with two towers.
    fn town(clearance_m: f64) -> Airspace {
        let tower = |footprint| Obstacle { name: String::new(), footprint, cylinder_m: None, top_m: None };
        let towers = vec![
            tower(rectangle(-300.0, -200.0, -100.0, 250.0)),
            tower(rectangle(400.0, 300.0, 450.0, 600.0)),
        ];
        Airspace::new(towers, rectangle(-1_000.0, -1_000.0, 1_000.0, 1_000.0), ALTITUDE_M, clearance_m)
            .unwrap()
    }

    fn slots_m(centre_m: V2, turned_rad: f64) -> [V2; 3] {
        [0.0, 1.0, 2.0].map(|slot| {
            let angle = turned_rad + slot * TAU / 3.0;
            centre_m + V2::new(angle.cos(), angle.sin()) * (SPACING_M / 3f64.sqrt())
        })
    }

    /// Those of the places that keep the distance of pads and are allowed, in whole fleets.
    fn pads(places: &[[f64; 2]], within_m: f64) -> Vec<[V2; 3]> {
        let town = town(10.0);
        let mut pads_m: Vec<V2> = Vec::new();
        for place in places {
            let at = V2::from(*place) * within_m;
            if town.allows(at) && pads_m.iter().all(|other| (other - at).norm() >= PLAN_M) {
                pads_m.push(at);
            }
        }
        pads_m.as_chunks::<3>().0.to_vec()
    }

    fn planned(pads_m: &[[V2; 3]], turned_rad: f64) -> (Vec<V2>, Assembly) {
        let room = town(10.0 + SPACING_M / 3f64.sqrt());
        let centres = centres_m(&room, pads_m, SPACING_M, PLAN_M, &[]).unwrap();
        let mut ends = Vec::new();
        for (f, (pads, centre)) in pads_m.iter().zip(&centres).enumerate() {
            let slots = slots_m(*centre, turned_rad);
            let taken = slots_taken(pads, &slots);
            ends.extend(
                taken.into_iter().zip(slots).map(|(member, slot)| (3 * f + member, pads[member], slot)),
            );
        }
        (centres, assembly(&town(10.0), &ends, ALTITUDE_M, PLAN_M))
    }

    /// Where a drone is that has done a share of a phase.
    fn on_the_way(assembly: &Assembly, way: &Way, phase: Phase, share: f64) -> V3 {
        let before_m = Phase::ALL
            .into_iter()
            .take_while(|it| *it != phase)
            .flat_map(|it| assembly.goals_m(way, it))
            .last();
        let mut corners = vec![before_m.unwrap_or(way.points_m[0].push(ALTITUDE_M))];
        corners.extend(assembly.goals_m(way, phase));
        let mut left_m = share * corners.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum::<f64>();
        for leg in corners.windows(2) {
            let long_m = (leg[1] - leg[0]).norm();
            if left_m <= long_m && long_m > 0.0 {
                return leg[0] + (leg[1] - leg[0]) * (left_m / long_m);
            }
            left_m -= long_m;
        }
        corners[corners.len() - 1]
    }

    #[test]
    fn truth_distances_of_legs() {
        let at = V2::new;
        for (one, other, expected_m) in [
            ([at(0.0, 0.0), at(10.0, 0.0)], [at(5.0, -5.0), at(5.0, 5.0)], 0.0),
            ([at(0.0, 0.0), at(10.0, 0.0)], [at(13.0, 4.0), at(20.0, 4.0)], 5.0),
            ([at(0.0, 0.0), at(10.0, 0.0)], [at(5.0, 3.0), at(5.0, 9.0)], 3.0),
            ([at(0.0, 0.0), at(10.0, 0.0)], [at(12.0, 0.0), at(20.0, 0.0)], 2.0),
            ([at(0.0, 0.0), at(10.0, 0.0)], [at(10.0, 0.0), at(20.0, 7.0)], 0.0),
            ([at(1.0, 1.0), at(1.0, 1.0)], [at(4.0, 5.0), at(4.0, 5.0)], 5.0),
        ] {
            assert!((legs_distance_m(one, other) - expected_m).abs() < 1e-12, "{one:?} {other:?}");
            assert!((legs_distance_m(other, one) - expected_m).abs() < 1e-12, "{other:?} {one:?}");
        }
    }

    #[test]
    fn ways_that_meet_nobody_stay_at_the_altitude_of_flight() {
        let far =
            pads(&[[-0.9, -0.9], [-0.8, -0.9], [-0.85, -0.8], [0.9, 0.9], [0.8, 0.9], [0.85, 0.8]], 1_000.0);
        let (centres, assembly) = planned(&far, 0.0);
        assert_eq!(assembly.layers(), 1, "{assembly:?}");
        assert!((centres[0] - V2::new(-850.0, -2_600.0 / 3.0)).norm() < 1e-9, "the centroid is free");
        for way in &assembly.ways {
            assert!(assembly.goals_m(way, Phase::Climb).is_empty());
            assert!(assembly.goals_m(way, Phase::Descend).is_empty());
        }
    }

    #[test]
    fn ways_that_cross_cross_at_altitudes_of_their_own() {
        let east = [(0, V2::new(600.0, -100.0), V2::new(900.0, -100.0))];
        let north = [(1, V2::new(700.0, -300.0), V2::new(700.0, 200.0))];
        let assembly = assembly(&town(10.0), &[east, north].concat(), ALTITUDE_M, PLAN_M);
        assert_eq!(assembly.ways.iter().map(|way| way.layer).collect::<Vec<_>>(), [0, 1]);
        let up = assembly.goals_m(&assembly.ways[1], Phase::Climb);
        assert_eq!(up, [V3::new(700.0, -300.0, ALTITUDE_M + PLAN_M + LAYERS_ROOM_M)]);
        assert_eq!(assembly.goals_m(&assembly.ways[1], Phase::Descend), [V3::new(700.0, 200.0, ALTITUDE_M)]);
    }

    #[test]
    fn without_room_there_is_no_plan() {
        let crowd: Vec<[V2; 3]> = (0..9).map(|_| [V2::zeros(); 3]).collect();
        let narrow = Airspace::new(vec![], rectangle(-60.0, -60.0, 60.0, 60.0), ALTITUDE_M, 10.0).unwrap();
        assert_eq!(centres_m(&narrow, &crowd, SPACING_M, PLAN_M, &[]), None);
        // Four do not fit at three spacings, but at the least distance.
        let narrow = Airspace::new(vec![], rectangle(-80.0, -80.0, 80.0, 80.0), ALTITUDE_M, 10.0).unwrap();
        let found = centres_m(&narrow, &crowd[..2], SPACING_M, PLAN_M, &[]).unwrap();
        let apart_m = (found[0] - found[1]).norm();
        assert!((84.0..150.0).contains(&apart_m), "{apart_m}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// From random bases, three to thirty drones: however the phases are timed, nobody comes nearer to anybody
        /// than avoidance plans with; all leave from their pads and end in their slots, each in one of its own.
        #[test]
        fn nobody_meets_anybody(
            places in prop::collection::vec(prop::array::uniform2(-1.0..1.0f64), 4..40),
            within_m in 60.0..1_000.0f64,
            turned_rad in -PI..PI,
            shares in prop::collection::vec(prop::collection::vec(0.0..1.0f64, 30), 40),
        ) {
            let mut pads_m = pads(&places, within_m);
            pads_m.truncate(10);
            let (centres, assembly) = planned(&pads_m, turned_rad);
            prop_assert_eq!(assembly.ways.len(), 3 * pads_m.len());
            for (i, a) in centres.iter().enumerate() {
                for b in &centres[..i] {
                    prop_assert!((a - b).norm() >= 2.0 * SPACING_M / 3f64.sqrt() + PLAN_M + FLEETS_ROOM_M);
                }
            }
            let mut slots: Vec<V2> = centres.iter().flat_map(|centre| slots_m(*centre, turned_rad)).collect();
            for way in &assembly.ways {
                prop_assert_eq!(way.points_m[0], pads_m[way.drone / 3][way.drone % 3]);
                let end = way.points_m[way.points_m.len() - 1];
                let slot = slots.iter().position(|slot| *slot == end);
                prop_assert!(slot.is_some(), "{} ends nowhere", way.drone);
                slots.remove(slot.unwrap());
            }
            for phase in Phase::ALL {
                // At random moments, and pair by pair all along the ways of the two.
                for shares in &shares {
                    let all: Vec<V3> = assembly.ways.iter().zip(shares).map(|(way, share)| on_the_way(&assembly, way, phase, *share)).collect();
                    for (i, a) in all.iter().enumerate() {
                        for (j, b) in all[..i].iter().enumerate() {
                            prop_assert!((a - b).norm() >= PLAN_M - 1e-6, "{phase:?}: {i} at {a}, {j} at {b}");
                        }
                    }
                }
                let along: Vec<Vec<V3>> = assembly.ways.iter().map(|way| {
                    (0..=120).map(|k| on_the_way(&assembly, way, phase, f64::from(k) / 120.0)).collect()
                }).collect();
                for (i, one) in along.iter().enumerate() {
                    for other in &along[..i] {
                        let least_m = one.iter().flat_map(|a| other.iter().map(move |b| (a - b).norm())).fold(f64::INFINITY, f64::min);
                        prop_assert!(least_m >= PLAN_M - 1e-6, "{phase:?}: {least_m} m");
                    }
                }
            }
        }

        /// The slots taken are those of brute force over all ways to give them away, written out by itself.
        #[test]
        fn slots_are_taken_at_the_least_cost(ends in prop::array::uniform6(prop::array::uniform2(-500.0..500.0f64))) {
            let [a, b, c, x, y, z] = ends.map(V2::from);
            let (pads, slots) = ([a, b, c], [x, y, z]);
            let taken = slots_taken(&pads, &slots);
            let cost = |of: [usize; 3]| (0..3).map(|slot| (slots[slot] - pads[of[slot]]).norm_squared()).sum::<f64>();
            let mut seen = taken;
            seen.sort_unstable();
            prop_assert_eq!(seen, [0, 1, 2]);
            for i in 0..3usize {
                for j in (0..3).filter(|&j| j != i) {
                    prop_assert!(cost(taken) <= cost([i, j, 3 - i - j]) + 1e-9);
                }
            }
        }
    }
}
