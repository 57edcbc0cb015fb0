//! Straight legs, what they meet, and where drones start: what random search is in any model of flight.

use std::f64::consts::TAU;

use rand_core::Rng;

use crate::geometry::V2;
use crate::rng;

/// Headings drawn for those that touch, before they stay where they are for a while: a drone may be wedged in.
pub const MOST_HEADINGS: usize = 64;
/// How long they stay, seconds.
pub const STAY_S: f64 = 1.0;
/// Starts drawn for a drone, before one is taken whose disk overlaps another's: there may be no room.
const MOST_STARTS: usize = 1000;

/// Where and how drones search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// East and north side of the area, whose corner is the origin; at least twice `radius_m` each.
    pub side_m: V2,
    /// Coverage radius of a drone (the paper's `R_C`): its disk stays within the area and apart from the others.
    pub radius_m: f64,
    /// Constant speed.
    pub speed_mps: f64,
}

impl Ground {
    /// Places for drones, at random: with disks that do not overlap, if there is room, else `least_m` from each other.
    ///
    /// # Panics
    /// Where the ground has no room for one disk: a campaign's plan is checked for it.
    pub fn starts(&self, drones: usize, least_m: f64, rng: &mut impl Rng) -> Vec<V2> {
        assert!(self.speed_mps > 0.0 && self.radius_m >= 0.0, "drones move: {self:?}");
        assert!(self.side_m.min() >= 2.0 * self.radius_m, "a disk has room: {self:?}");
        let mut taken_m: Vec<V2> = Vec::with_capacity(drones);
        let mut drawn_m = Vec::new();
        for _ in 0..drones {
            let apart = |at: &V2, by_m: f64| taken_m.iter().all(|taken| (taken - at).norm() >= by_m);
            drawn_m.clear();
            while drawn_m.len() < MOST_STARTS && !drawn_m.last().is_some_and(|at| apart(at, self.disks_m())) {
                let draw = V2::new(rng::unit(rng), rng::unit(rng));
                drawn_m.push(self.low_m() + draw.component_mul(&(self.high_m() - self.low_m())));
            }
            let free = drawn_m.last().filter(|at| apart(at, self.disks_m()));
            let start_m =
                free.or_else(|| drawn_m.iter().find(|at| apart(at, least_m))).unwrap_or(&drawn_m[0]);
            taken_m.push(*start_m);
        }
        taken_m
    }

    /// A velocity in any direction.
    pub fn heading_mps(&self, rng: &mut impl Rng) -> V2 {
        let (sin, cos) = (TAU * rng::unit(rng)).sin_cos();
        V2::new(cos, sin) * self.speed_mps
    }

    /// Distance of two drones whose disks touch.
    #[must_use]
    pub fn disks_m(&self) -> f64 {
        2.0 * self.radius_m
    }

    /// Centres lie within the area shrunk by the radius: its least corner.
    #[must_use]
    pub fn low_m(&self) -> V2 {
        V2::repeat(self.radius_m)
    }

    /// Its greatest corner.
    #[must_use]
    pub fn high_m(&self) -> V2 {
        self.side_m - V2::repeat(self.radius_m)
    }

    /// The nearest place for a centre: rounding may put one a hair outside.
    #[must_use]
    pub fn within(&self, at_m: V2) -> V2 {
        at_m.sup(&self.low_m()).inf(&self.high_m())
    }
}

/// A straight leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Where it begins.
    pub from_m: V2,
    /// How it goes on; zero for a drone that stays.
    pub velocity_mps: V2,
    /// When it begins.
    pub since_s: f64,
}

impl Leg {
    /// Where it is at a time.
    #[must_use]
    pub fn at(&self, t_s: f64) -> V2 {
        self.from_m + self.velocity_mps * (t_s - self.since_s)
    }

    /// When its disk meets the border; infinite for one that stays.
    #[must_use]
    pub fn border_s(&self, ground: &Ground) -> f64 {
        let Self { from_m, velocity_mps, since_s } = *self;
        let (low, high) = (ground.low_m(), ground.high_m());
        let along = |axis: usize| {
            let (at, towards) = (from_m[axis], velocity_mps[axis]);
            match towards {
                t if t > 0.0 => (high[axis] - at) / t,
                t if t < 0.0 => (low[axis] - at) / t,
                _ => f64::INFINITY,
            }
        };
        since_s + along(0).min(along(1)).max(0.0)
    }

    /// When two disks meet, from `at_s` on: the smaller root of `|p + w t| = 2 R`, in the form that loses no digits.
    /// Disks that overlap meet at once where they come closer, and else never.
    #[must_use]
    pub fn meets_s(&self, other: &Self, at_s: f64, ground: &Ground) -> f64 {
        let apart = self.apart(other, at_s);
        let (closing, squared) = (apart.closing(), apart.relative_mps.norm_squared());
        let beyond = apart.relative_m.norm_squared() - ground.disks_m().powi(2);
        let discriminant = closing * closing - squared * beyond;
        let in_s = if closing >= 0.0 || (beyond > 0.0 && discriminant < 0.0) {
            f64::INFINITY
        } else if beyond <= 0.0 {
            0.0
        } else {
            beyond / (discriminant.sqrt() - closing)
        };
        at_s + in_s
    }

    /// The drone on this leg seen from one on another.
    #[must_use]
    pub fn apart(&self, other: &Self, at_s: f64) -> Apart {
        Apart {
            relative_m: self.at(at_s) - other.at(at_s),
            relative_mps: self.velocity_mps - other.velocity_mps,
        }
    }
}

/// One drone seen from another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Apart {
    /// From the other to the one.
    pub relative_m: V2,
    /// Its change.
    pub relative_mps: V2,
}

impl Apart {
    /// How far.
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        self.relative_m.norm()
    }

    /// Negative while they come closer.
    #[must_use]
    pub fn closing(&self) -> f64 {
        self.relative_m.dot(&self.relative_mps)
    }
}

/// What a drone meets next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// When.
    pub at_s: f64,
    /// The other drone; none for the border, and for the end of a stay.
    pub with: Option<usize>,
}
