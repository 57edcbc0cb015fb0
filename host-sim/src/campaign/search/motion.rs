//! How drones move that search at random: straight on at constant speed, until their coverage disk meets another's or the border.
//!
//! Points that turn on the spot, as in the paper's closed model; `runner::search` flies the same rule. Contacts are
//! computed, not stepped over: between two of them everybody is on a straight line, and where two lines meet is a
//! quadratic equation (`control::random_search::legs`).

use rand_core::Rng;

use crate::control::random_search::legs::{Contact, Ground, Leg, MOST_HEADINGS, STAY_S};
use crate::geometry::V2;

/// Disks and borders this near touch.
const TOUCH_M: f64 = 1e-6;

/// Drones on their way.
#[derive(Debug)]
pub struct Motion<R> {
    ground: Ground,
    rng: R,
    legs: Vec<Leg>,
    /// The first contact of each drone, as far as its own and the others' legs tell.
    next: Vec<Contact>,
    now_s: f64,
    started_apart: bool,
}

impl<R: Rng> Motion<R> {
    /// Drones at random places with disks that do not overlap, if there is room, and at random headings.
    ///
    /// # Panics
    /// Where the ground has no room for one disk: a campaign's plan is checked for it.
    pub fn new(ground: Ground, drones: usize, mut rng: R) -> Self {
        let starts_m = ground.starts(drones, 0.0, &mut rng).into_iter();
        let legs: Vec<Leg> =
            starts_m.map(|from_m| Leg { from_m, velocity_mps: V2::zeros(), since_s: 0.0 }).collect();
        let started_apart = (0..drones).all(|drone| {
            legs[..drone].iter().all(|leg| (leg.from_m - legs[drone].from_m).norm() >= ground.disks_m())
        });
        let next = vec![Contact { at_s: f64::INFINITY, with: None }; drones];
        let mut motion = Self { ground, rng, legs, next, now_s: 0.0, started_apart };
        for drone in 0..drones {
            motion.turn(&[drone], 0.0);
        }
        motion
    }

    /// Moves on to a time.
    ///
    /// # Panics
    /// For a time before the last one.
    pub fn advance(&mut self, to_s: f64) {
        assert!(to_s >= self.now_s, "time goes on: from {} to {to_s}", self.now_s);
        while let Some((drone, contact)) = self.first().filter(|(_, contact)| contact.at_s <= to_s) {
            match contact.with {
                Some(other) => self.turn(&[drone, other], contact.at_s),
                None => self.turn(&[drone], contact.at_s),
            }
        }
        self.now_s = to_s;
    }

    /// Whether no disk overlapped another at the start. Then none ever does, up to rounding.
    #[must_use]
    pub const fn started_apart(&self) -> bool {
        self.started_apart
    }

    /// Where everybody is now.
    pub fn positions_m(&self) -> impl Iterator<Item = V2> + '_ {
        self.legs.iter().map(|leg| self.ground.within(leg.at(self.now_s)))
    }

    /// The first contact of all; of two at once, the drone with the lower number.
    fn first(&self) -> Option<(usize, Contact)> {
        let all = self.next.iter().copied().enumerate();
        all.reduce(|a, b| if b.1.at_s < a.1.at_s { b } else { a })
    }

    /// New headings for drones that have met something: away from all that they touch.
    fn turn(&mut self, drones: &[usize], at_s: f64) {
        for &drone in drones {
            let from_m = self.ground.within(self.legs[drone].at(at_s));
            self.legs[drone] = Leg { from_m, velocity_mps: V2::zeros(), since_s: at_s };
        }
        let turned = (0..MOST_HEADINGS).any(|_| {
            for &drone in drones {
                self.legs[drone].velocity_mps = self.ground.heading_mps(&mut self.rng);
            }
            drones.iter().all(|&drone| self.is_free(drone, at_s))
        });
        if !turned {
            drones.iter().for_each(|&drone| self.legs[drone].velocity_mps = V2::zeros());
        }
        self.look_ahead(drones, at_s, !turned);
    }

    /// Whether a drone moves away from, or along, all that it touches.
    fn is_free(&self, drone: usize, at_s: f64) -> bool {
        let Leg { from_m, velocity_mps, .. } = self.legs[drone];
        let (low, high) = (self.ground.low_m(), self.ground.high_m());
        let within = (0..2).all(|axis| {
            let (at, towards) = (from_m[axis], velocity_mps[axis]);
            !(at <= low[axis] + TOUCH_M && towards < 0.0 || at >= high[axis] - TOUCH_M && towards > 0.0)
        });
        within
            && (0..self.legs.len()).filter(|&other| other != drone).all(|other| {
                let apart = self.legs[drone].apart(&self.legs[other], at_s);
                apart.distance_m() > self.ground.disks_m() + TOUCH_M || apart.closing() >= 0.0
            })
    }

    /// Finds the next contacts of drones with new legs, and of those that these legs concern.
    fn look_ahead(&mut self, turned: &[usize], at_s: f64, stay: bool) {
        for &drone in turned {
            self.next[drone] = self.contact_of(drone, at_s);
            if stay && self.next[drone].at_s > at_s + STAY_S {
                self.next[drone] = Contact { at_s: at_s + STAY_S, with: None };
            }
        }
        for other in (0..self.legs.len()).filter(|other| !turned.contains(other)) {
            if self.next[other].with.is_some_and(|with| turned.contains(&with)) {
                self.next[other] = self.contact_of(other, at_s);
                continue;
            }
            for &drone in turned {
                let contact = self.contact_between(other, drone, at_s);
                if contact.at_s < self.next[other].at_s {
                    self.next[other] = contact;
                }
            }
        }
    }

    /// The first contact of a drone from a time on.
    fn contact_of(&self, drone: usize, at_s: f64) -> Contact {
        let border = Contact { at_s: self.legs[drone].border_s(&self.ground).max(at_s), with: None };
        let others = (0..self.legs.len()).filter(|&other| other != drone);
        let contacts = others.map(|other| self.contact_between(drone, other, at_s));
        contacts.fold(border, |first, contact| if contact.at_s < first.at_s { contact } else { first })
    }

    fn contact_between(&self, drone: usize, other: usize, at_s: f64) -> Contact {
        let at_s = self.legs[drone].meets_s(&self.legs[other], at_s, &self.ground);
        Contact { at_s, with: Some(other) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{self, Stream};
    use proptest::prelude::*;

    fn motion(side_m: [f64; 2], drones: usize, seed: u64) -> Motion<rand_chacha::ChaCha8Rng> {
        let ground = Ground { side_m: V2::from(side_m), radius_m: 500.0, speed_mps: 10.0 };
        Motion::new(ground, drones, rng::stream(seed, Stream::Search, 0))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// However crowded: disks stay within the area and apart, and nobody is faster than told.
        #[test]
        fn disks_stay_within_and_apart(
            seed in any::<u64>(), drones in 1..9_usize, width_m in 1000.0..9000.0_f64, height_m in 1000.0..9000.0_f64,
        ) {
            let mut motion = motion([width_m, height_m], drones, seed);
            let mut before_m: Vec<V2> = motion.positions_m().collect();
            for step in 1..400 {
                motion.advance(f64::from(step) * 2.5);
                let at_m: Vec<V2> = motion.positions_m().collect();
                for (drone, (at, before)) in at_m.iter().zip(&before_m).enumerate() {
                    prop_assert!(at.min() >= 500.0 && at.x <= width_m - 500.0 && at.y <= height_m - 500.0, "{at}");
                    prop_assert!((at - before).norm() <= 25.0 + 1e-6);
                    for other in &at_m[..drone] {
                        prop_assert!(!motion.started_apart() || (at - other).norm() >= 1000.0 - 1e-5);
                    }
                }
                before_m = at_m;
            }
        }

        /// What is seen of the motion does not change it.
        #[test]
        fn looking_changes_nothing(seed in any::<u64>(), drones in 1..6_usize) {
            let [mut often, mut once] = [(); 2].map(|()| motion([4000.0, 4000.0], drones, seed));
            (0..=500).for_each(|second| often.advance(f64::from(second)));
            once.advance(500.0);
            prop_assert!(often.positions_m().eq(once.positions_m()));
        }
    }

    /// A drone alone turns at the border only, and there comes off it.
    #[test]
    fn legs_are_straight_between_contacts() {
        let mut motion = motion([3000.0, 2000.0], 1, 5);
        let mut places_m = Vec::new();
        for second in 0..2000 {
            motion.advance(f64::from(second));
            places_m.extend(motion.positions_m());
        }
        let mut turns = 0;
        for three in places_m.windows(3) {
            let bend_m = (three[0] - 2.0 * three[1] + three[2]).norm();
            let [left, right, bottom, top] =
                [three[1].x - 500.0, 2500.0 - three[1].x, three[1].y - 500.0, 1500.0 - three[1].y];
            let border_m = left.min(right).min(bottom).min(top);
            assert!(bend_m < 1e-6 || border_m <= 10.0, "bent by {bend_m} m, {border_m} m from the border");
            turns += u32::from(bend_m > 1e-6);
        }
        assert!(turns > 10, "{turns}");
    }

    /// Two that meet turn both, and others do not.
    #[test]
    fn a_contact_turns_both_and_nobody_else() {
        let mut motion = motion([100_000.0, 100_000.0], 3, 1);
        let leg = |x: f64, y: f64, v: f64| Leg {
            from_m: V2::new(x, y),
            velocity_mps: V2::new(v, 0.0),
            since_s: 0.0,
        };
        motion.legs = vec![
            leg(20_000.0, 20_000.0, 10.0),
            leg(23_000.0, 20_000.0, -10.0),
            leg(20_000.0, 60_000.0, 10.0),
        ];
        motion.look_ahead(&[0, 1, 2], 0.0, false);
        motion.advance(99.9);
        assert_eq!(motion.legs[0].since_s.to_bits(), 0);
        motion.advance(100.1);
        let since: Vec<f64> = motion.legs.iter().map(|leg| leg.since_s).collect();
        assert!(
            (since[0] - 100.0).abs() < 1e-9 && (since[1] - 100.0).abs() < 1e-9 && since[2].to_bits() == 0,
            "{since:?}"
        );
        let apart = motion.legs[0].apart(&motion.legs[1], 100.1);
        assert!(apart.closing() >= 0.0 && apart.distance_m() >= 1000.0 - 1e-9);
        let headings: Vec<V2> = motion.legs.iter().map(|leg| leg.velocity_mps).collect();
        assert!(
            (headings[0] - V2::new(10.0, 0.0)).norm() > 1e-3
                && (headings[1] + V2::new(10.0, 0.0)).norm() > 1e-3
        );
        assert!((headings[0].norm() - 10.0).abs() < 1e-9);
    }
}
