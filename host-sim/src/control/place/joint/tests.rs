//! The joint optimum against brute force over all combinations of candidate centres, and its laws.
#![allow(clippy::float_cmp, reason = "counts that must come out exactly")]

use nalgebra::Rotation2;
use proptest::prelude::*;

use super::super::truth::{candidates, covers, point, unit, user};
use super::super::*;
use super::prices::Prices;
use super::{Joint, place_joint};
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;

fn fleet(drones: usize) -> Fleet {
    Fleet { drones, min_separation_m: 0.0 }
}

/// Greatest weight of `drones` disks among all candidate centres.
fn brute_force(users: &[PlaceUser], drones: usize, widening_m: f64, tolerance_m: f64) -> f64 {
    let set = |at: V2| {
        users
            .iter()
            .enumerate()
            .filter(|(_, u)| covers(u, at, tolerance_m))
            .fold(0u32, |set, (i, _)| set | 1 << i)
    };
    let mut sets: Vec<u32> = candidates(users, &[], 0.0, widening_m).into_iter().map(set).collect();
    sets.sort_unstable();
    sets.dedup();
    let inside = |set: &u32| sets.iter().any(|other| other != set && set & !other == 0);
    let sets: Vec<u32> = sets.iter().filter(|set| !inside(set)).copied().collect();
    let worth =
        |set: u32| users.iter().enumerate().filter(|(i, _)| set >> i & 1 == 1).map(|(_, u)| u.weight).sum();
    fn deepest(sets: &[u32], covered: u32, drones: usize, worth: &dyn Fn(u32) -> f64) -> f64 {
        let mut best = worth(covered);
        if drones > 0 {
            for (i, set) in sets.iter().enumerate() {
                best = best.max(deepest(&sets[i + 1..], covered | set, drones - 1, worth));
            }
        }
        best
    }
    deepest(&sets, 0, drones, &worth)
}

/// Places the fleet and holds every claim against independent computation.
fn check(users: &[PlaceUser], drones: usize) -> Placement {
    let found = place_joint(users, fleet(drones), None).unwrap();
    let mut seen = vec![false; users.len()];
    let mut value = 0.0;
    for site in found.sites.iter().flatten() {
        for &u in &site.covered {
            assert!(covers(&users[u], site.pos_m, TOLERANCE_M), "user {u} is not covered: {site:?}");
            assert!(!std::mem::replace(&mut seen[u], true), "user {u} is claimed twice");
            value += users[u].weight;
        }
    }
    assert!((value - found.value).abs() < 1e-9, "the value is what the sites claim");
    assert_eq!(found.covered, seen.iter().filter(|seen| **seen).count());
    assert!(found.upper_bound >= found.value - 1e-9);
    assert!(found.proved_optimal, "no limit, no doubt: {found:?}");
    let greedy = place(Objective::Guaranteed(users), fleet(drones)).unwrap();
    assert!(found.value >= greedy.value - 1e-9, "{} below greedy's {}", found.value, greedy.value);
    assert!(
        greedy.value >= (1.0 - (-1f64).exp()) * found.value - 1e-9,
        "greedy's guarantee (Nemhauser 1978)"
    );
    found
}

fn check_by_brute_force(users: &[PlaceUser], drones: usize) {
    let found = check(users, drones).value;
    let strict = brute_force(users, drones, 0.0, 1e-9);
    let lax = brute_force(users, drones, 0.999 * TOLERANCE_M, TOLERANCE_M).max(strict);
    assert!(found >= strict - 1e-9 && found <= lax + 1e-9, "found {found}, brute force {strict} to {lax}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn truth_lattices_match_brute_force(
        spec in prop::collection::vec((0i32..12, 0i32..12, -1i32..5, 1u8..3), 0..11),
        drones in 0usize..4,
    ) {
        let users: Vec<PlaceUser> = spec.iter().map(|&(x, y, r, w)| PlaceUser {
            weight: f64::from(w), ..user(f64::from(x), f64::from(y), f64::from(r))
        }).collect();
        check_by_brute_force(&users, drones);
    }

    #[test]
    fn truth_random_users_match_brute_force(
        spec in prop::collection::vec((0.0f64..3000.0, 0.0f64..3000.0, 300.0f64..500.0), 0..14),
        drones in 1usize..4,
    ) {
        let users: Vec<PlaceUser> = spec.iter().map(|&(x, y, r)| user(x, y, r)).collect();
        check_by_brute_force(&users, drones);
    }

    #[test]
    fn truth_weights_that_are_no_whole_numbers_match_brute_force(
        spec in prop::collection::vec((0.0f64..2000.0, 0.0f64..2000.0, 0.0f64..2.0), 0..12),
        drones in 1usize..4,
    ) {
        let users: Vec<PlaceUser> =
            spec.iter().map(|&(x, y, weight)| PlaceUser { weight, ..user(x, y, 500.0) }).collect();
        check_by_brute_force(&users, drones);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// Enumeration and combination alone, from any prices and with no placement to begin with: the best prices mostly leave
    /// them nothing to do.
    #[test]
    fn truth_any_prices_lead_to_the_optimum(
        spec in prop::collection::vec((0.0f64..3000.0, 0.0f64..3000.0, 1u8..4, 0.0f64..1.0), 1..14),
        drones in 1usize..5,
    ) {
        let users: Vec<PlaceUser> = (spec.iter())
            .map(|&(x, y, weight, _)| PlaceUser { weight: f64::from(weight), ..user(x, y, 500.0) })
            .collect();
        let given: Vec<f64> = users.iter().zip(&spec).map(|(user, spec)| spec.3 * user.weight).collect();
        let optimum = brute_force(&users, drones, 0.0, 1e-9);
        let (prices, columns) = Prices::at(&users, drones, &given, None).unwrap();
        prop_assert!(prices.bound() >= optimum - 1e-9, "bound {} of {optimum}", prices.bound());
        let mut joint = Joint {
            users: &users, drones, until: None, grain: 1.0, best: Vec::new(), value: 0.0, bound: f64::INFINITY,
        };
        prop_assert!(joint.worth(&columns) <= optimum);
        joint.close(&prices);
        prop_assert!(joint.is_proved());
        prop_assert_eq!(joint.value, optimum);
        prop_assert_eq!(joint.worth(&joint.best), optimum);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// More drones and more radius serve no fewer; the plane may be moved and turned, users listed in any order.
    #[test]
    fn laws(seed in 0u64..10_000, drones in 1usize..6, turn in 0.0f64..6.3, east in -1e5f64..1e5) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let users: Vec<PlaceUser> = (0..120).map(|_| PlaceUser {
            pos_m: point(&mut rng, 4000.0), radius_m: 400.0 + 50.0 * unit(&mut rng), weight: 1.0
        }).collect();
        let value = check(&users, drones).value;
        prop_assert!(check(&users, drones + 1).value >= value);
        let wider: Vec<PlaceUser> =
            users.iter().map(|u| PlaceUser { radius_m: u.radius_m + 20.0, ..*u }).collect();
        prop_assert!(check(&wider, drones).value >= value);
        let turned = Rotation2::new(turn);
        let moved: Vec<PlaceUser> = (users.iter().rev())
            .map(|u| PlaceUser { pos_m: turned * u.pos_m + V2::new(east, -0.3 * east), ..*u })
            .collect();
        prop_assert_eq!(check(&moved, drones).value, value);
    }
}

#[test]
fn degenerate_inputs_have_plain_answers() {
    let value = |users: &[PlaceUser], drones| check(users, drones).value;
    let same = vec![user(3.0, 4.0, 500.0); 50];
    let line: Vec<PlaceUser> = (0..30).map(|i| user(100.0 * f64::from(i), 0.0, 500.0)).collect();
    let apart =
        [user(0.0, 0.0, 500.0), user(1000.0, 0.0, 500.0), user(2000.0, 0.0, 500.0), user(3000.0, 0.0, 500.0)];
    assert_eq!((value(&[], 3), value(&same, 2), value(&same, 0)), (0.0, 50.0, 0.0));
    assert_eq!((value(&line, 1), value(&line, 2), value(&line, 3)), (11.0, 22.0, 30.0));
    // Pairs exactly two radii apart.
    assert_eq!((value(&apart, 1), value(&apart, 2)), (2.0, 4.0));
    // No room for error, and none at all.
    assert_eq!((value(&[user(0.0, 0.0, 0.0); 3], 1), value(&[user(0.0, 0.0, -1.0); 3], 1)), (3.0, 0.0));
}

/// Greedy takes the middle; two disks side by side serve all.
#[test]
fn truth_where_greedy_is_wrong() {
    let users: Vec<PlaceUser> =
        [-1400.0, -1300.0, -600.0, -500.0, 500.0, 600.0, 1300.0, 1400.0]
            .into_iter()
            .flat_map(|x| [user(x, 0.0, 500.0)])
            .chain((0..3).flat_map(|i| {
                [user(-450.0 + f64::from(i), 1.0, 500.0), user(450.0 - f64::from(i), 1.0, 500.0)]
            }))
            .collect();
    let greedy = place(Objective::Guaranteed(&users), fleet(2)).unwrap();
    let joint = check(&users, 2);
    assert_eq!((greedy.value, joint.value), (11.0, 14.0));
}

#[test]
fn when_time_is_up_the_best_so_far_is_the_answer() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let users: Vec<PlaceUser> = (0..400).map(|_| user_at(point(&mut rng, 3000.0))).collect();
    let found = place_joint(&users, fleet(5), Some(std::time::Instant::now())).unwrap();
    let greedy = place(Objective::Guaranteed(&users), fleet(5)).unwrap();
    assert!(found.value >= greedy.value && found.upper_bound >= found.value);
}

fn user_at(at: V2) -> PlaceUser {
    user(at.x, at.y, 470.0)
}
