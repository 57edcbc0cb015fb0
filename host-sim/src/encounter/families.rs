//! Families of encounters: what goes wrong in the air, drawn from a seed.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::{Encounter, VehicleSpec};
use crate::geometry::V3;

/// Altitude of all, metres.
const UP_M: f64 = 100.0;
/// Starts are this far apart at least, metres: nobody begins in a conflict.
const START_M: f64 = 40.0;
/// Goals are this far apart at least, metres: all can be reached.
const GOAL_M: f64 = 22.0;
/// Corners of a fleet's triangle of 50 m, metres.
const TRIANGLE_M: [[f64; 2]; 3] = [[0.0, 28.868], [-25.0, -14.434], [25.0, -14.434]];

/// A kind of encounter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Two that pass near one point at about one time, from anywhere.
    Crossing,
    /// All on a circle, each with its goal opposite.
    Circle,
    /// Anywhere in a box, to anywhere in it.
    Box,
    /// Two fleets of three through each other.
    Fleets,
    /// Fleets that end their lanes side by side and leave for sites across.
    SweepEnd,
    /// A fast one behind a slow one, nearly in line.
    Overtake,
    /// One that passes another that hovers, which avoids or does not.
    Hover,
    /// As [`Family::Crossing`], but the second does not avoid.
    Intruder,
    /// Two towards each other on exactly one line.
    HeadOn,
    /// Two side by side whose ways meet at a small angle.
    Shallow,
}

impl Family {
    /// How many meet unless told otherwise.
    #[must_use]
    pub const fn usual_count(self) -> usize {
        match self {
            Self::Crossing | Self::Overtake | Self::Hover | Self::Intruder | Self::HeadOn | Self::Shallow => {
                2
            }
            Self::Circle => 8,
            Self::Box => 20,
            Self::Fleets | Self::SweepEnd => 6,
        }
    }
}

/// An encounter of a family, of `count` vehicles where it has no number of its own.
#[must_use]
pub fn draw(family: Family, count: usize, seed: u64) -> Encounter {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed));
    let vehicles = match family {
        Family::Crossing => apart(|| crossing(&mut dice)),
        Family::Circle => circle(count),
        Family::Box => scattered(&mut dice, count),
        Family::Fleets => apart(|| fleets(&mut dice)),
        Family::SweepEnd => sweep_end(&mut dice, count),
        Family::Overtake => overtake(&mut dice),
        Family::Hover => hover(&mut dice),
        Family::Intruder => with_intruder(apart(|| crossing(&mut dice))),
        Family::HeadOn => head_on(&mut dice),
        Family::Shallow => shallow(&mut dice),
    };
    Encounter { seed, duration_s: 300.0, ..Encounter::of(vehicles) }
}

struct Dice(ChaCha8Rng);

impl Dice {
    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64)
    }

    fn chance(&mut self) -> bool {
        self.0.next_u64() & 1 == 1
    }
}

/// Draws again until nobody begins or ends too close to another.
fn apart(mut drawn: impl FnMut() -> Vec<VehicleSpec>) -> Vec<VehicleSpec> {
    loop {
        let vehicles = drawn();
        let far = |a: [f64; 3], b: [f64; 3], least_m: f64| (V3::from(a) - V3::from(b)).norm() >= least_m;
        let fits = (0..vehicles.len()).all(|i| {
            (0..i).all(|j| {
                let (a, b) = (&vehicles[i], &vehicles[j]);
                far(a.pos_m, b.pos_m, START_M) && far(a.goal_m, b.goal_m, GOAL_M)
            })
        });
        if fits {
            return vehicles;
        }
    }
}

fn vehicle(index: usize, from: [f64; 2], to: [f64; 2], speed_mps: f64) -> VehicleSpec {
    let (pos, goal) = (V3::new(from[0], from[1], UP_M), V3::new(to[0], to[1], UP_M));
    let way = goal - pos;
    let vel = if speed_mps > 0.0 { way * (speed_mps / way.norm()) } else { V3::zeros() };
    VehicleSpec {
        id: index as u16 + 1,
        pos_m: pos.into(),
        vel_mps: vel.into(),
        goal_m: goal.into(),
        cooperative: true,
        has_right_of_way: false,
    }
}

fn crossing(dice: &mut Dice) -> Vec<VehicleSpec> {
    let until_s = dice.within(15.0, 40.0);
    let one = |index| {
        let (sin, cos) = dice.within(0.0, TAU).sin_cos();
        let (speed_mps, beside_m) = (dice.within(4.0, 10.0), dice.within(-6.0, 6.0));
        let way_m = speed_mps * until_s;
        let at = |along: f64| [cos * along - sin * beside_m, sin * along + cos * beside_m];
        vehicle(index, at(-way_m), at(way_m), speed_mps)
    };
    (0..2).map(one).collect()
}

fn circle(count: usize) -> Vec<VehicleSpec> {
    let radius_m = (20.0 * count as f64 / TAU).max(100.0);
    let one = |index| {
        let (sin, cos) = (TAU * index as f64 / count as f64).sin_cos();
        vehicle(index, [radius_m * cos, radius_m * sin], [-radius_m * cos, -radius_m * sin], 0.0)
    };
    (0..count).map(one).collect()
}

fn scattered(dice: &mut Dice, count: usize) -> Vec<VehicleSpec> {
    let side_m = 45.0 * (count as f64).sqrt();
    let mut points = || {
        let mut points: Vec<[f64; 2]> = Vec::new();
        while points.len() < count {
            let at = [dice.within(0.0, side_m), dice.within(0.0, side_m)];
            if points.iter().all(|p| (p[0] - at[0]).hypot(p[1] - at[1]) >= GOAL_M) {
                points.push(at);
            }
        }
        points
    };
    let (from, to) = (points(), points());
    (0..count).map(|index| vehicle(index, from[index], to[index], 0.0)).collect()
}

fn fleets(dice: &mut Dice) -> Vec<VehicleSpec> {
    let mut vehicles = Vec::new();
    for fleet in 0..2 {
        let (sin, cos) = dice.within(0.0, TAU).sin_cos();
        let (turn_sin, turn_cos) = dice.within(0.0, TAU).sin_cos();
        let beside_m = dice.within(-20.0, 20.0);
        for (slot, [x, y]) in TRIANGLE_M.iter().enumerate() {
            let corner = [x * turn_cos - y * turn_sin, x * turn_sin + y * turn_cos];
            let at = |along: f64| {
                [cos * along - sin * beside_m + corner[0], sin * along + cos * beside_m + corner[1]]
            };
            vehicles.push(vehicle(3 * fleet + slot, at(-250.0), at(250.0), 10.0));
        }
    }
    vehicles
}

fn sweep_end(dice: &mut Dice, count: usize) -> Vec<VehicleSpec> {
    let goals = scattered(dice, count);
    let start = |index: usize| {
        let [x, y] = TRIANGLE_M[index % 3];
        [x + 90.0 * (index / 3) as f64, y - 60.0]
    };
    let leave = |(index, goal): (usize, VehicleSpec)| {
        let to = [2.0 * goal.goal_m[0], 2.0 * goal.goal_m[1] + 60.0];
        VehicleSpec { vel_mps: [0.0, 10.0, 0.0], ..vehicle(index, start(index), to, 0.0) }
    };
    goals.into_iter().enumerate().map(leave).collect()
}

fn overtake(dice: &mut Dice) -> Vec<VehicleSpec> {
    let (slow_mps, beside_m) = (dice.within(2.0, 6.0), dice.within(-5.0, 5.0));
    vec![
        vehicle(0, [-100.0, beside_m], [500.0, beside_m], 10.0),
        vehicle(1, [0.0, 0.0], [400.0, 0.0], slow_mps),
    ]
}

fn hover(dice: &mut Dice) -> Vec<VehicleSpec> {
    let beside_m = dice.within(-8.0, 8.0);
    let passing = vehicle(0, [-150.0, beside_m], [150.0, 0.0], dice.within(4.0, 10.0));
    vec![passing, VehicleSpec { cooperative: dice.chance(), ..vehicle(1, [0.0; 2], [0.0; 2], 0.0) }]
}

fn with_intruder(mut vehicles: Vec<VehicleSpec>) -> Vec<VehicleSpec> {
    for vehicle in vehicles.iter_mut().skip(1) {
        vehicle.cooperative = false;
    }
    vehicles
}

fn head_on(dice: &mut Dice) -> Vec<VehicleSpec> {
    let (west, east) = ([-200.0, 0.0], [200.0, 0.0]);
    vec![vehicle(0, west, east, dice.within(4.0, 10.0)), vehicle(1, east, west, dice.within(4.0, 10.0))]
}

fn shallow(dice: &mut Dice) -> Vec<VehicleSpec> {
    // They would meet halfway, at nearly one time.
    let (beside_m, slope, speed_mps) = (25.0, dice.within(0.05, 0.2), dice.within(6.0, 9.5));
    let way_m = 2.0 * beside_m / slope;
    vec![
        vehicle(0, [0.0, beside_m], [way_m, -beside_m], speed_mps),
        vehicle(1, [0.0, -beside_m], [way_m, beside_m], speed_mps + dice.within(-0.3, 0.3)),
    ]
}
