//! Truth tests: the solvers against independent computations, and the laws they must obey.
#![allow(clippy::float_cmp, reason = "counts and coordinates that must come out exactly")]

use std::time::{Duration, Instant};

use nalgebra::{Matrix2, Rotation2};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::disk::best_disk;
use super::*;

pub(super) fn user(x: f64, y: f64, radius_m: f64) -> PlaceUser {
    PlaceUser { pos_m: V2::new(x, y), radius_m, weight: 1.0 }
}

pub(super) fn unit(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

pub(super) fn point(rng: &mut ChaCha8Rng, side_m: f64) -> V2 {
    let x = unit(rng) * side_m;
    V2::new(x, unit(rng) * side_m)
}

/// Intersections of two circles; one point where they touch within a tolerance.
fn crossings(p: V2, r: f64, q: V2, s: f64) -> Vec<V2> {
    let d = (q - p).norm();
    if d < 1e-12 || d > r + s + 1e-9 || d < (r - s).abs() - 1e-9 {
        return vec![];
    }
    let along = (d * d + r * r - s * s) / (2.0 * d);
    let across = (r * r - along * along).max(0.0).sqrt();
    let e = (q - p) / d;
    let normal = V2::new(-e.y, e.x);
    vec![p + e * along + normal * across, p + e * along - normal * across]
}

/// Every centre at which a greatest weight must be found: the users, points of their circles, all
/// crossings of these, and those with the shores of exclusion disks. Radii are widened by `widening_m`.
pub(super) fn candidates(users: &[PlaceUser], taken: &[V2], shore_m: f64, widening_m: f64) -> Vec<V2> {
    let coverable = users.iter().filter(|u| u.radius_m >= 0.0);
    let mut circles: Vec<(V2, f64)> = coverable.map(|u| (u.pos_m, u.radius_m + widening_m)).collect();
    let mut points: Vec<V2> = circles.iter().map(|c| c.0).collect();
    circles.extend(taken.iter().map(|&t| (t, shore_m)));
    for (i, a) in circles.iter().enumerate() {
        points.extend([V2::x(), -V2::x(), V2::y(), -V2::y()].map(|way| a.0 + way * a.1));
        for b in &circles[i + 1..] {
            points.extend(crossings(a.0, a.1, b.0, b.1));
        }
    }
    points
}

pub(super) fn covers(u: &PlaceUser, at: V2, tolerance_m: f64) -> bool {
    u.radius_m >= 0.0 && (u.pos_m - at).norm() <= u.radius_m + tolerance_m
}

fn weight_at(users: &[PlaceUser], at: V2, tolerance_m: f64) -> f64 {
    users.iter().filter(|u| covers(u, at, tolerance_m)).map(|u| u.weight).sum()
}

/// Greatest weight by brute force: without the tolerance on disks, and with all of it. Between the two
/// every answer is right; they differ only where circles meet in one point or a site is just too near.
fn brute_force(users: &[PlaceUser], taken: &[V2], min_separation_m: f64) -> (f64, f64) {
    let greatest = |shore_m: f64, widening_m: f64, tolerance_m: f64| {
        let points = candidates(users, taken, shore_m, widening_m);
        let clear = |at: &V2| taken.iter().all(|t| (t - at).norm() >= shore_m - 1e-9);
        points.into_iter().filter(clear).map(|at| weight_at(users, at, tolerance_m)).fold(0.0, f64::max)
    };
    let strict = greatest(min_separation_m + 2.0 * KeepOut::CLEARANCE_M, 0.0, 1e-9);
    (strict, greatest(min_separation_m, 0.999 * TOLERANCE_M, TOLERANCE_M).max(strict))
}

fn check_sites(users: &[PlaceUser], fleet: Fleet) -> Placement {
    let placement = place(Objective::Guaranteed(users), fleet).unwrap();
    let mut left = users.to_vec();
    let mut taken: Vec<V2> = vec![];
    for site in &placement.sites {
        let best = brute_force(&left, &taken, fleet.min_separation_m);
        let Some(site) = site else {
            assert_eq!(best.0, 0.0, "a drone was left idle");
            continue;
        };
        let found = site.expected;
        assert!(found >= best.0 - 1e-9 && found <= best.1 + 1e-9, "found {found}, brute force {best:?}");
        assert!(
            weight_at(&left, site.pos_m, TOLERANCE_M) >= found - 1e-9,
            "the site does not reach its value"
        );
        assert!(taken.iter().all(|t| (t - site.pos_m).norm() >= fleet.min_separation_m));
        for &u in &site.covered {
            assert!(covers(&left[u], site.pos_m, TOLERANCE_M));
            assert!(left[u].radius_m - (left[u].pos_m - site.pos_m).norm() >= site.margin_m - 1e-9);
            left[u].radius_m = -1.0;
        }
        taken.push(site.pos_m);
    }
    assert!(placement.upper_bound >= placement.value - 1e-9);
    placement
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Users on a lattice meet in every degenerate way: coincident, tangent, concentric, cocircular.
    #[test]
    fn truth_steps_match_brute_force(
        spec in prop::collection::vec((0i32..12, 0i32..12, -1i32..6, 1u8..3), 0..12),
        drones in 0usize..4,
        separation in prop::sample::select(vec![0.0, 1.0, 2.5, 7.0]),
    ) {
        let users: Vec<PlaceUser> = spec.iter().map(|&(x, y, r, w)| PlaceUser {
            weight: f64::from(w), ..user(f64::from(x), f64::from(y), f64::from(r))
        }).collect();
        check_sites(&users, Fleet { drones, min_separation_m: separation });
    }

    #[test]
    fn truth_equal_radii_match_brute_force(
        spec in prop::collection::vec((0.0f64..3000.0, 0.0f64..3000.0), 0..13),
        drones in 1usize..4,
        separation in prop::sample::select(vec![0.0, 15.0, 400.0]),
    ) {
        let users: Vec<PlaceUser> = spec.iter().map(|&(x, y)| user(x, y, 470.0)).collect();
        check_sites(&users, Fleet { drones, min_separation_m: separation });
    }

    #[test]
    fn truth_no_pair_of_disks_beats_the_upper_bound(
        spec in prop::collection::vec((0.0f64..2000.0, 0.0f64..2000.0), 1..9),
    ) {
        let users: Vec<PlaceUser> = spec.iter().map(|&(x, y)| user(x, y, 500.0)).collect();
        let placement = place(Objective::Guaranteed(&users), Fleet { drones: 2, min_separation_m: 0.0 }).unwrap();
        let points = candidates(&users, &[], 0.0, 0.0);
        let both = |a: V2, b: V2| users.iter().filter(|u| covers(u, a, 1e-9) || covers(u, b, 1e-9)).count() as f64;
        let optimum = points.iter().flat_map(|&a| points.iter().map(move |&b| both(a, b))).fold(0.0, f64::max);
        prop_assert!(placement.upper_bound >= optimum - 1e-9);
        prop_assert!(!placement.proved_optimal || placement.value >= optimum - 1e-9);
    }

    /// Moving or turning the plane moves and turns the answer.
    #[test]
    fn placement_follows_the_plane(seed in 0u64..1000, turn in 0.0f64..6.3, east in -1e5f64..1e5) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let users: Vec<PlaceUser> = (0..60).map(|_| PlaceUser {
            pos_m: point(&mut rng, 4000.0), radius_m: 450.0 + 50.0 * unit(&mut rng), weight: 1.0
        }).collect();
        let turned = Rotation2::new(turn);
        let there = |p: V2| turned * p + V2::new(east, -0.3 * east);
        let moved: Vec<PlaceUser> = users.iter().map(|u| PlaceUser { pos_m: there(u.pos_m), ..*u }).collect();
        let (a, b) = (best_disk(&users).unwrap(), best_disk(&moved).unwrap());
        prop_assert_eq!(a.weight, b.weight);
        prop_assert!((a.margin_m - b.margin_m).abs() < 1e-6, "{a:?} {b:?}");
        prop_assert_eq!(a.covered, b.covered);
        prop_assert!((there(a.pos_m) - b.pos_m).norm() < 1e-3);
    }

    /// The largest margin against a nested golden-section search of the same concave function.
    #[test]
    fn truth_centre_has_the_largest_margin(
        disks in prop::collection::vec((0.0f64..400.0, 0.0f64..400.0, 300.0f64..500.0), 1..12),
    ) {
        let disks: Vec<(V2, f64)> = disks.iter().map(|&(x, y, r)| (V2::new(x, y), r)).collect();
        let margin = |x: f64, y: f64| disks.iter().map(|(p, r)| r - (p - V2::new(x, y)).norm()).fold(f64::MAX, f64::min);
        let along = |x: f64| golden(|y| margin(x, y));
        let truth = golden(along);
        let (at, found) = centre::most_margin(&disks, &KeepOut::default(), None).unwrap();
        prop_assert!((margin(at.x, at.y) - found).abs() < 1e-9);
        prop_assert!((found - truth).abs() < 1e-6, "found {found}, golden section {truth}");
    }
}

/// Maximum of a concave function over [-100, 500].
/// The greatest margin to disks (position, radius) as a cone program, `max t` with `|p - x| <= r - t`.
fn margin_by_cones(disks: &[(V2, f64)]) -> (V2, f64) {
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
    // Rows of each disk: r - t, p - x, in the order of the cone; columns x, y, t.
    let n = disks.len();
    let rows: [Vec<usize>; 3] = [1, 2, 0].map(|row| (0..n).map(|k| 3 * k + row).collect());
    let matrix = CscMatrix::new(3 * n, 3, vec![0, n, 2 * n, 3 * n], rows.concat(), vec![1.0; 3 * n]);
    let right: Vec<f64> = disks.iter().flat_map(|(p, r)| [*r, p.x, p.y]).collect();
    let cones = vec![SupportedConeT::SecondOrderConeT(3); n];
    let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
    let none = CscMatrix::zeros((3, 3));
    let mut solver = DefaultSolver::new(&none, &[0.0, 0.0, -1.0], &matrix, &right, &cones, settings).unwrap();
    solver.solve();
    assert_eq!(solver.solution.status, SolverStatus::Solved);
    let x = &solver.solution.x;
    (V2::new(x[0], x[1]), x[2])
}

proptest! {
    #[test]
    fn truth_a_cone_program_centres_drones_in_the_same_place(
        disks in prop::collection::vec((-300.0..300.0_f64, -300.0..300.0_f64, 400.0..500.0_f64), 1..25),
    ) {
        let disks: Vec<(V2, f64)> = disks.iter().map(|&(x, y, r)| (V2::new(x, y), r)).collect();
        let (at, margin_m) = centre::most_margin(&disks, &KeepOut::default(), None).unwrap();
        let (by_cones, most_m) = margin_by_cones(&disks);
        prop_assert!((margin_m - most_m).abs() < 1e-4, "{margin_m} {most_m}");
        // Near the optimum the margin is flat along one direction at most.
        prop_assert!((at - by_cones).norm() < 0.5, "{at} {by_cones}");
    }
}

fn golden(f: impl Fn(f64) -> f64) -> f64 {
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    let (mut low, mut high) = (-100.0, 500.0);
    for _ in 0..60 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if f(a) < f(b) { low = a } else { high = b }
    }
    f(0.5 * (low + high))
}

#[test]
fn closed_disks_touch_within_the_tolerance_and_not_beyond() {
    let pair = |gap: f64| [user(-500.0, 10.0, 500.0), user(500.0 + gap, 10.0, 500.0)];
    for (gap, weight) in [(0.0, 2.0), (5e-7, 2.0), (1e-5, 1.0)] {
        let disk = best_disk(&pair(gap)).unwrap();
        assert_eq!(disk.weight, weight, "gap {gap}");
    }
    let disk = best_disk(&pair(0.0)).unwrap();
    assert!((disk.pos_m - V2::new(0.0, 10.0)).norm() < 1e-6 && disk.margin_m.abs() < 1e-6);
}

#[test]
fn degenerate_inputs_have_plain_answers() {
    let fleet = Fleet { drones: 3, min_separation_m: 0.0 };
    let run = |users: &[PlaceUser]| check_sites(users, fleet);
    let nobody = run(&[]);
    assert_eq!((nobody.covered, nobody.upper_bound, nobody.proved_optimal), (0, 0.0, true));
    assert_eq!(nobody.sites, vec![None; 3]);

    let one = run(&[user(3.0, 4.0, 500.0)]);
    let site = one.sites[0].as_ref().unwrap();
    assert_eq!((site.pos_m, site.margin_m, site.covered.as_slice()), (V2::new(3.0, 4.0), 500.0, &[0][..]));
    assert!(one.proved_optimal && one.sites[1].is_none());

    let out_of_reach = run(&[user(0.0, 0.0, -1.0), user(1.0, 1.0, -1e-9)]);
    assert_eq!(
        (out_of_reach.covered, out_of_reach.never_coverable, out_of_reach.proved_optimal),
        (0, 2, true)
    );

    let pinned = run(&[user(7.0, 0.0, 0.0), user(0.0, 0.0, 500.0)]);
    assert_eq!(pinned.covered, 2, "a user of radius 0 is covered from right above");
    assert!((pinned.sites[0].as_ref().unwrap().pos_m - V2::new(7.0, 0.0)).norm() < 1e-6);

    let coincident = run(&[user(5.0, 5.0, 500.0); 11]);
    assert_eq!(
        (coincident.covered, coincident.sites[1].is_none(), coincident.proved_optimal),
        (11, true, true)
    );

    let collinear: Vec<PlaceUser> =
        (0..9).map(|i| user(250.0 * f64::from(i), 250.0 * f64::from(i), 500.0)).collect();
    let sites = run(&collinear);
    assert_eq!(sites.covered, 9);

    let circle: Vec<PlaceUser> = (0..12)
        .map(|i| f64::from(i) * std::f64::consts::FRAC_PI_6)
        .map(|a| user(1e6 + 500.0 * a.cos(), -1e6 + 500.0 * a.sin(), 500.0))
        .collect();
    let disk = best_disk(&circle).unwrap();
    assert_eq!(disk.covered.len(), 12, "all on one circle around the only centre");

    let far = [user(-1e8, 1e8, 500.0), user(1e8, -1e8, 500.0), user(1e8, -1e8 + 800.0, 500.0)];
    assert_eq!(run(&far).covered, 3);
}

#[test]
fn crowded_users_stay_cheap() {
    // 20,000 within a metre: every circle crosses every other close to the same two curves.
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let users: Vec<PlaceUser> =
        (0..20_000).map(|_| PlaceUser { pos_m: point(&mut rng, 1.0), ..user(0.0, 0.0, 500.0) }).collect();
    let placement =
        place(Objective::Guaranteed(&users), Fleet { drones: 2, min_separation_m: 15.0 }).unwrap();
    assert_eq!((placement.covered, placement.proved_optimal), (20_000, true));
}

#[test]
fn truth_many_circles_near_one_point_are_exact_and_cheap() {
    // Hundreds of circles pass near where a best centre lies, so that large nodes cannot part them.
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let on_a_circle: Vec<PlaceUser> = (0..2_000)
        .map(|i| f64::from(i) * 1.234)
        .map(|angle| user(470.0 * angle.cos(), 470.0 * angle.sin(), 470.0))
        .collect();
    let two_blobs: Vec<PlaceUser> = (0..2_000)
        .map(|i| PlaceUser {
            pos_m: V2::new(f64::from(i % 2) * 939.9, 0.0) + point(&mut rng, 0.2),
            ..user(0.0, 0.0, 470.0)
        })
        .collect();
    let households: Vec<PlaceUser> = (0..100)
        .flat_map(|_| [PlaceUser { pos_m: point(&mut rng, 2_000.0), ..user(0.0, 0.0, 470.0) }; 20])
        .collect();
    for (what, users) in [("on a circle", on_a_circle), ("two blobs", two_blobs), ("households", households)]
    {
        let weight = |users: &[PlaceUser]| best_disk(users).unwrap().weight;
        let (least, greatest) = brute_force(&users[..120], &[], 0.0);
        let found = weight(&users[..120]);
        assert!(found >= least && found <= greatest, "{what}: {found} of {least} to {greatest}");
        let began = Instant::now();
        let found = weight(&users);
        assert!(began.elapsed() < Duration::from_secs(8), "{what}: {found} in {:?}", began.elapsed());
    }
}

#[test]
fn drones_without_users_stay_home_and_sites_keep_apart() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let users: Vec<PlaceUser> =
        (0..400).map(|_| PlaceUser { pos_m: point(&mut rng, 900.0), ..user(0.0, 0.0, 470.0) }).collect();
    let placement =
        place(Objective::Guaranteed(&users), Fleet { drones: 12, min_separation_m: 15.0 }).unwrap();
    let sites: Vec<&Site> = placement.sites.iter().flatten().collect();
    assert!(sites.len() >= 2);
    for (i, a) in sites.iter().enumerate() {
        assert!(sites[..i].iter().all(|b| (a.pos_m - b.pos_m).norm() >= 15.0));
    }
    assert_eq!(sites.iter().map(|s| s.covered.len()).sum::<usize>(), placement.covered);
}

#[test]
fn bad_input_is_named() {
    let fleet = Fleet { drones: 1, min_separation_m: 0.0 };
    let bad = |users: &[PlaceUser]| place(Objective::Guaranteed(users), fleet).unwrap_err().to_string();
    assert_eq!(
        bad(&[user(0.0, 0.0, 1.0), user(0.0, f64::NAN, 1.0)]),
        "user 1: pos_m.y is NaN, expected a finite value within +-1e8 m"
    );
    assert_eq!(
        bad(&[user(0.0, 0.0, f64::INFINITY)]),
        "user 0: radius_m is inf, expected a finite value within +-1e8 m"
    );
    assert!(matches!(
        place(Objective::Guaranteed(&[PlaceUser { weight: -1.0, ..user(0.0, 0.0, 1.0) }]), fleet),
        Err(PlaceError::BadWeight { user: 0, .. })
    ));
    let lopsided = UserBelief { pos_m: V2::zeros(), cov_m2: Matrix2::new(1.0, 2.0, 2.0, 1.0) };
    assert_eq!(
        place(Objective::Expected { users: &[lopsided], radius_m: 500.0 }, fleet),
        Err(PlaceError::BadCovariance { user: 0 })
    );
    assert!(matches!(
        place(Objective::Guaranteed(&[]), Fleet { drones: 1, min_separation_m: f64::NAN }),
        Err(PlaceError::BadSeparation { .. })
    ));
}

/// Two independent standard normal variates (Box and Muller).
fn normals(rng: &mut ChaCha8Rng) -> V2 {
    let (u, v) = (1.0 - unit(rng), unit(rng));
    let radius = (-2.0 * u.ln()).sqrt();
    V2::new(radius * (std::f64::consts::TAU * v).cos(), radius * (std::f64::consts::TAU * v).sin())
}

#[test]
fn truth_probability_of_service_matches_sampling() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for distance_m in [0.0, 300.0, 485.0, 498.0, 500.0, 504.0, 530.0] {
        let root = Matrix2::new(6.0, 2.0, 0.0, 9.0);
        let belief = UserBelief { pos_m: V2::new(1000.0, 2000.0), cov_m2: root * root.transpose() };
        let way = point(&mut rng, 1.0);
        let centre_m = belief.pos_m + way / way.norm() * distance_m;
        const DRAWS: u32 = 40_000;
        let hits = (0..DRAWS)
            .filter(|_| (belief.pos_m + root * normals(&mut rng) - centre_m).norm() <= 500.0)
            .count();
        let sampled = hits as f64 / f64::from(DRAWS);
        let found = belief.within(centre_m, 500.0);
        assert!((found - sampled).abs() < 0.012, "at {distance_m}: found {found}, sampled {sampled}");
        assert!((expected_served(centre_m, &[belief, belief], 500.0) - 2.0 * found).abs() < 1e-12);
    }
}

#[test]
fn truth_expected_step_beats_every_centre_of_a_grid() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..4 {
        let users: Vec<UserBelief> = (0..25)
            .map(|_| UserBelief { pos_m: point(&mut rng, 1500.0), cov_m2: Matrix2::new(20.0, 8.0, 8.0, 9.0) })
            .collect();
        let fleet = Fleet { drones: 1, min_separation_m: 0.0 };
        let placement = place(Objective::Expected { users: &users, radius_m: 300.0 }, fleet).unwrap();
        let grid =
            (0..=600).flat_map(|x| (0..=600).map(move |y| V2::new(f64::from(x) * 2.5, f64::from(y) * 2.5)));
        let best = grid.map(|at| expected_served(at, &users, 300.0)).fold(0.0, f64::max);
        assert!(placement.value >= best - expected::GAP_USERS, "found {}, grid {best}", placement.value);
        assert!(placement.upper_bound >= best && placement.upper_bound < best + 0.2);
    }
}

#[test]
fn certain_positions_make_the_objectives_agree() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let users: Vec<PlaceUser> =
        (0..80).map(|_| PlaceUser { pos_m: point(&mut rng, 4000.0), ..user(0.0, 0.0, 500.0) }).collect();
    let beliefs: Vec<UserBelief> =
        users.iter().map(|u| UserBelief { pos_m: u.pos_m, cov_m2: Matrix2::zeros() }).collect();
    let fleet = Fleet { drones: 1, min_separation_m: 0.0 };
    let counted = place(Objective::Guaranteed(&users), fleet).unwrap();
    let expected = place(Objective::Expected { users: &beliefs, radius_m: 500.0 }, fleet).unwrap();
    assert!((counted.value - expected.value).abs() < 1e-9);
    assert_eq!(counted.covered, expected.covered);
}
