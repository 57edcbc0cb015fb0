//! Truth against SciPy and against scatter, whole missions, invariances, hostile inputs.

use heapless::Vec as BoundedVec;
use proptest::prelude::*;
use skyroost_protocol::units::DroneId;

use super::sim::{Flown, World};
use super::*;

const WANDER: ClockModel =
    ClockModel::SharedWander { offset_sigma_ns: 200.0, drift_sigma_ns_per_s: 5.0, walk_ns_per_sqrt_s: 0.1 };

fn run(occasions: &[Occasion], cfg: &LocalizeConfig) -> Localization {
    let found = localize(occasions, cfg).expect("a good configuration");
    for fix in &found.users {
        let [[xx, xy], [yx, yy]] = fix.cov_m2;
        let numbers = [fix.pos_m[0], fix.pos_m[1], xx, xy, yx, yy, fix.r95_m, fix.last_heard_s];
        assert!(numbers.iter().all(|x| x.is_finite()), "{fix:?}");
        assert!(xx > 0.0 && xx * yy > xy * yx && fix.r95_m > 0.0, "{fix:?}");
        let narrow = fix.r95_m <= cfg.max_r95_m || !cfg.motion.is_still();
        assert!(fix.status != FixStatus::Ok || narrow, "{fix:?}");
    }
    for clock in &found.clocks {
        assert!(clock.knots.iter().all(|(t, ns)| t.is_finite() && ns.is_finite()), "{clock:?}");
        assert!(clock.offset_ns.is_finite() && clock.drift_ns_per_s.is_finite(), "{clock:?}");
    }
    found
}

// ---------------------------------------------------------------------------------------------------- truth

/// The noise of `scripts/localize_truth.py`.
fn hashed(keys: [i64; 3]) -> f64 {
    let mut x: i64 = 17;
    for k in keys.into_iter().chain([1, 2]) {
        x = ((x ^ (x >> 13)) * 1_103_515_245 + k * 12_345 + 12_820_163) % (1 << 31);
    }
    x as f64 / f64::from(1 << 30) - 1.0
}

/// The case of `scripts/localize_truth.py`. The clocks are taken out up to what `clock` leaves unknown.
fn scipy_case(clock: ClockModel, late: bool) -> Vec<Occasion> {
    const USERS: [[f64; 2]; 4] = [[120.0, 210.0], [310.0, -330.0], [520.0, 60.0], [700.0, -140.0]];
    const CLOCKS: [[f64; 2]; 3] = [[0.0, 0.0], [130.0, 3.0], [-75.0, -4.5]];
    let mut occasions = Vec::new();
    for t in (0..90).step_by(3) {
        let x = 10.0 * t as f64;
        for (u, p) in USERS.iter().enumerate().filter(|(_, p)| (p[0] - x).hypot(p[1]) <= 471.0) {
            let mut captures = BoundedVec::new();
            for (d, [offset, drift]) in CLOCKS.iter().enumerate().filter(|(d, _)| (t + u + d) % 7 != 0) {
                let angle = std::f64::consts::TAU * (d as f64 / 3.0 + 0.25);
                let side = 50.0 / 3f64.sqrt();
                let at = [x + side * angle.cos(), side * angle.sin(), 300.0];
                let distance = ((p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2) + 9e4).sqrt();
                let clock_ns = match clock {
                    ClockModel::Synchronised => 0.0,
                    ClockModel::SharedConstant => *offset,
                    ClockModel::SharedWander { .. } => offset + drift * t as f64,
                };
                let mut toa_ns =
                    distance / C_M_PER_NS + clock_ns + 8.0 * hashed([u as i64, t as i64, d as i64]);
                if late && (5 * t + 3 * u + d) % 23 == 0 {
                    toa_ns += 300.0;
                }
                let drone = DroneId(d as u16 + 1);
                captures.push(Capture { drone, pos_enu_m: at, toa_ns, sigma_ns: None }).expect("three");
            }
            occasions.push(Occasion { user: UserId(u as u32), clock_group: 0, time_s: t as f64, captures });
        }
    }
    occasions
}

const LINE: ClockModel =
    ClockModel::SharedWander { offset_sigma_ns: 200.0, drift_sigma_ns_per_s: 5.0, walk_ns_per_sqrt_s: 0.0 };

/// SciPy 1.x `least_squares`, all unknowns in one dense problem: east, north, covariance xx, xy, yy.
fn truth_scipy(clock: ClockModel, expected: [[f64; 5]; 4]) -> Localization {
    let cfg =
        LocalizeConfig { clock, drone_pos_sigma_m: 0.0, robust: Robust::None, ..LocalizeConfig::default() };
    let found = run(&scipy_case(clock, false), &cfg);
    for (fix, [east, north, xx, xy, yy]) in found.users.iter().zip(expected) {
        assert!((fix.pos_m[0] - east).abs() < 0.02 && (fix.pos_m[1] - north).abs() < 0.02, "{fix:?}");
        let cov = [fix.cov_m2[0][0] - xx, fix.cov_m2[0][1] - xy, fix.cov_m2[1][1] - yy];
        assert!(cov.iter().all(|c| c.abs() < 2e-3 * yy), "{fix:?} against {xx} {xy} {yy}");
    }
    found
}

#[test]
fn truth_scipy_synchronised() {
    let expected = [
        [119.172328, 220.606580, 30.50317649, -9.25936137, 41.21330643],
        [314.676679, -315.538208, 27.36407423, -0.27114345, 67.54535665],
        [520.619180, 55.641743, 18.40636203, 0.17713697, 11.53117257],
        [699.954987, -148.290784, 22.00883272, -2.48103008, 23.00520996],
    ];
    truth_scipy(ClockModel::Synchronised, expected);
}

#[test]
fn truth_scipy_constant() {
    let expected = [
        [113.915672, 239.624349, 71.87825772, -12.61440695, 186.22538253],
        [310.837625, -292.340424, 68.61350525, 20.49027697, 252.02371463],
        [517.341196, 67.602248, 53.47819066, 10.31409071, 68.63432433],
        [696.409727, -134.188987, 52.51842753, 6.30396650, 96.21522475],
    ];
    let found = truth_scipy(ClockModel::SharedConstant, expected);
    let offsets: Vec<f64> = found.clocks.iter().map(|clock| clock.offset_ns).collect();
    assert!((offsets[1] - 125.995279).abs() < 1e-2 && (offsets[2] + 80.266904).abs() < 1e-2, "{offsets:?}");
}

#[test]
fn truth_scipy_line() {
    let expected = [
        [114.990691, 240.295173, 74.51278431, -11.53381734, 188.67475935],
        [310.970580, -289.770660, 68.88497699, 20.34029267, 262.76591172],
        [516.270992, 68.718524, 58.09438004, 8.98391414, 74.96324837],
        [694.254931, -132.142470, 66.49073426, -2.66525317, 113.10370460],
    ];
    truth_scipy(LINE, expected);
}

/// With late captures and SciPy's trust region on the biweight cost, emission times as unknowns of their own.
#[test]
fn truth_scipy_tukey() {
    let expected = [
        [115.122839, 242.714194],
        [311.333782, -281.657310],
        [516.281125, 70.785353],
        [693.952473, -129.954505],
    ];
    let cfg = LocalizeConfig { clock: LINE, drone_pos_sigma_m: 0.0, ..LocalizeConfig::default() };
    let found = run(&scipy_case(LINE, true), &cfg);
    for (fix, [east, north]) in found.users.iter().zip(expected) {
        assert!((fix.pos_m[0] - east).hypot(fix.pos_m[1] - north) < 0.5, "{fix:?} against {east} {north}");
    }
}

// ------------------------------------------------------------------------------------------- whole missions

#[derive(Debug)]
struct Score {
    users: usize,
    ok_fraction: f64,
    in_r95_fraction: f64,
    r95_median_m: f64,
    crlb_ratio: f64,
}

fn error_m(flown: &Flown, fix: &UserFix) -> f64 {
    let p = flown.at(fix.user, fix.last_heard_s);
    (fix.pos_m[0] - p[0]).hypot(fix.pos_m[1] - p[1])
}

fn score(world: &World, cfg: &LocalizeConfig) -> Score {
    let flown = world.fly();
    let found = run(&flown.occasions, cfg);
    let bound = crlb(&flown.occasions, &flown.late, &flown.truth, cfg).expect("good input");
    let ok: Vec<&UserFix> = found.users.iter().filter(|fix| fix.status == FixStatus::Ok).collect();
    let mut r95_m: Vec<f64> = ok.iter().map(|fix| fix.r95_m).collect();
    r95_m.sort_unstable_by(f64::total_cmp);
    let inside = ok.iter().filter(|fix| error_m(&flown, fix) <= fix.r95_m).count();
    Score {
        users: found.users.len(),
        ok_fraction: ok.len() as f64 / found.users.len() as f64,
        in_r95_fraction: inside as f64 / ok.len() as f64,
        r95_median_m: r95_m[r95_m.len() / 2],
        crlb_ratio: crlb_ratio(&found.users, &flown.truth, &bound).expect("users with fixes"),
    }
}

fn accept(world: &World) {
    let score = score(world, &LocalizeConfig::default());
    let good = score.ok_fraction >= 0.99
        && score.in_r95_fraction >= 0.9
        && score.r95_median_m <= 15.0
        && score.crlb_ratio <= 1.25;
    assert!(good, "{score:?} of {world:?}");
}

#[test]
fn missions_at_one_user_per_km2() {
    (1..5).for_each(|seed| accept(&World { users_per_km2: 1.0, seed, ..World::default() }));
}

#[test]
fn missions_at_five_users_per_km2() {
    (1..3).for_each(|seed| accept(&World { seed, ..World::default() }));
}

#[test]
fn a_dense_mission() {
    accept(&World { users_per_km2: 50.0, side_m: 4_000.0, ..World::default() });
}

#[test]
fn one_fleet_for_12000_s() {
    accept(&World { fleets: 1, users_per_km2: 1.0, seed: 7, ..World::default() });
}

/// Median error, the share of users located, and of those the share within their radius.
fn walked(world: &World, motion: Motion) -> [f64; 3] {
    let flown = world.fly();
    let found = run(&flown.occasions, &LocalizeConfig { motion, ..LocalizeConfig::default() });
    let ok: Vec<&UserFix> = found.users.iter().filter(|fix| fix.status == FixStatus::Ok).collect();
    let mut off_m: Vec<f64> = ok.iter().map(|fix| error_m(&flown, fix)).collect();
    let inside = ok.iter().zip(&off_m).filter(|(fix, off_m)| **off_m <= fix.r95_m).count();
    off_m.sort_unstable_by(f64::total_cmp);
    let located = ok.len() as f64 / found.users.len() as f64;
    [off_m[off_m.len() / 2], located, inside as f64 / ok.len() as f64]
}

#[test]
fn users_that_walk_are_followed() {
    let mut told = String::new();
    let mut all_well = true;
    for (speed_mps, seed, least) in [(0.2, 1, 0.91), (0.5, 2, 0.91), (1.0, 3, 0.9), (1.5, 4, 0.8)] {
        let motion = Motion { speed_mps, turn_s: 60.0 };
        let world = World { motion, seed, side_m: 6_000.0, users_per_km2: 8.0, ..World::default() };
        let [followed_m, located, inside] = walked(&world, motion);
        let [taken_to_stand_m, _, believed] = walked(&world, Motion::STILL);
        all_well &= located >= 0.97 && (least..=0.995).contains(&inside);
        all_well &= followed_m < taken_to_stand_m && believed < 0.7;
        told +=
            &format!("{speed_mps} m/s: off by {followed_m:.1} m, {located:.3} located, {inside:.3} inside; ");
        told += &format!("taken to stand {taken_to_stand_m:.1} m, {believed:.3}\n");
    }
    assert!(all_well, "{told}");
    println!("{told}");
}

/// Ten users on 100 km2: never two at a time, only the clocks' priors tie them together.
#[test]
fn users_who_never_overlap_in_time() {
    for seed in 1..6 {
        let world = World { fleets: 1, users_per_km2: 0.1, seed, ..World::default() };
        let flown = world.fly();
        for fix in run(&flown.occasions, &LocalizeConfig::default()).users {
            assert!(
                fix.status != FixStatus::Ok || error_m(&flown, &fix) < 2.0 * fix.r95_m,
                "{seed}: {fix:?}"
            );
        }
    }
}

/// One user is too little to separate clocks and position well, and the answer says so.
#[test]
fn a_lone_user_is_not_oversold() {
    for seed in 1..10 {
        let world = World { fleets: 1, users_per_km2: 0.01, seed, ..World::default() };
        let flown = world.fly();
        for fix in run(&flown.occasions, &LocalizeConfig::default()).users {
            assert!(
                fix.status != FixStatus::Ok || error_m(&flown, &fix) < 1.5 * fix.r95_m,
                "{seed}: {fix:?}"
            );
        }
    }
}

/// Scatter of many small clean missions against the bound, and no better than it either.
#[test]
fn truth_bound_is_attained() {
    let cfg = LocalizeConfig { robust: Robust::None, ..LocalizeConfig::default() };
    let (mut squares, mut users) = (0.0, 0.0);
    for seed in 100..150 {
        let world = World {
            side_m: 2_500.0,
            fleets: 1,
            users_per_km2: 6.0,
            late_fraction: 0.0,
            seed,
            ..World::default()
        };
        let score = score(&world, &cfg);
        squares += score.crlb_ratio.powi(2) * score.users as f64;
        users += score.users as f64;
    }
    let ratio = (squares / users).sqrt();
    assert!((ratio - 1.0).abs() < 0.06, "{ratio}");
}

#[test]
fn late_captures_ruin_least_squares_and_the_statuses_say_so() {
    let flown = World { users_per_km2: 1.0, ..World::default() }.fly();
    let cfg = LocalizeConfig { robust: Robust::None, ..LocalizeConfig::default() };
    let found = run(&flown.occasions, &cfg);
    let refused = found.users.iter().filter(|fix| fix.status == FixStatus::Inconsistent).count();
    assert!(refused >= 95, "{refused}");
}

// ----------------------------------------------------------------------------------------------- invariances

fn small() -> Flown {
    World { side_m: 3_000.0, ..World::default() }.fly()
}

#[test]
fn order_and_threads_do_not_matter() {
    let flown = small();
    let cfg = LocalizeConfig::default();
    let expected = run(&flown.occasions, &cfg);
    let mut mixed = flown.occasions.clone();
    mixed.reverse();
    let half = mixed.len() / 2;
    mixed.rotate_left(half);
    mixed.iter_mut().for_each(|occasion| occasion.captures.reverse());
    assert_eq!(run(&mixed, &cfg), expected);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        assert_eq!(pool.install(|| run(&flown.occasions, &cfg)), expected);
    }
}

#[test]
fn translation_and_a_common_shift_of_arrivals_do_not_matter() {
    let flown = small();
    let cfg = LocalizeConfig::default();
    let expected = run(&flown.occasions, &cfg);
    let mut moved = flown.occasions.clone();
    for (i, occasion) in moved.iter_mut().enumerate() {
        for capture in &mut occasion.captures {
            let [east, north, up] = capture.pos_enu_m;
            capture.pos_enu_m = [east + 4096.0, north - 8192.0, up + 64.0];
            capture.toa_ns += 1024.0 * (i % 1000) as f64;
        }
    }
    let found = run(&moved, &LocalizeConfig { user_altitude_m: 64.0, ..cfg });
    for (a, b) in expected.users.iter().zip(&found.users) {
        let (east, north) = (b.pos_m[0] - 4096.0 - a.pos_m[0], b.pos_m[1] + 8192.0 - a.pos_m[1]);
        assert!(
            east.hypot(north) < 1e-3 && (a.r95_m - b.r95_m).abs() < 1e-3 && a.status == b.status,
            "{a:?} {b:?}"
        );
    }
}

#[test]
fn a_user_heard_by_two_groups_gets_one_better_fix() {
    let mut first = World { fleets: 1, side_m: 2_000.0, users_per_km2: 8.0, ..World::default() }.fly();
    let alone = run(&first.occasions, &LocalizeConfig::default());
    let second = World { fleets: 1, side_m: 2_000.0, users_per_km2: 8.0, ..World::default() };
    for mut occasion in (World { sigma_toa_ns: 4.99, ..second }).fly().occasions {
        occasion.clock_group = 1;
        first.occasions.push(occasion);
    }
    let both = run(&first.occasions, &LocalizeConfig::default());
    assert_eq!(both.users.len(), alone.users.len());
    for (a, b) in alone.users.iter().zip(&both.users) {
        assert!(b.r95_m < 0.8 * a.r95_m && b.occasions == 2 * a.occasions, "{a:?} {b:?}");
    }
}

// -------------------------------------------------------------------------------------------- hostile inputs

fn occasion(user: u32, time_s: f64, captures: &[(u16, [f64; 3], f64)]) -> Occasion {
    let captures = (captures.iter())
        .map(|&(drone, pos_enu_m, toa_ns)| Capture {
            drone: DroneId(drone),
            pos_enu_m,
            toa_ns,
            sigma_ns: None,
        })
        .collect();
    Occasion { user: UserId(user), clock_group: 0, time_s, captures }
}

/// Noise-free occasions of one user and synchronous drones flying east, at these places in formation.
fn pass(user: [f64; 2], formation: &[[f64; 2]], seconds: u32) -> Vec<Occasion> {
    (0..seconds)
        .map(|t| {
            let x = 10.0 * f64::from(t);
            let captures: Vec<_> = (formation.iter().enumerate())
                .map(|(d, f)| {
                    let at = [x + f[0], f[1], 300.0];
                    let distance = ((user[0] - at[0]).powi(2) + (user[1] - at[1]).powi(2) + 9e4).sqrt();
                    (d as u16 + 1, at, distance / C_M_PER_NS)
                })
                .collect();
            occasion(1, f64::from(t), &captures)
        })
        .collect()
}

const TRIANGLE: [[f64; 2]; 3] = [[0.0, 28.9], [-25.0, -14.4], [25.0, -14.4]];

#[test]
fn nothing_in_nothing_out() {
    assert_eq!(run(&[], &LocalizeConfig::default()), Localization::default());
    assert!(crlb(&[], &[], &BTreeMap::new(), &LocalizeConfig::default()).expect("good").is_empty());
}

#[test]
fn one_occasion_or_single_captures_do_not_claim_a_position() {
    for clock in [ClockModel::Synchronised, ClockModel::SharedConstant, WANDER] {
        let cfg = LocalizeConfig { clock, ..LocalizeConfig::default() };
        let found = run(&pass([100.0, 100.0], &TRIANGLE, 1), &cfg);
        assert!(clock == ClockModel::Synchronised || found.users[0].status != FixStatus::Ok, "{found:?}");
        let found = run(&pass([100.0, 100.0], &TRIANGLE[..2], 1), &cfg);
        assert_eq!(found.users[0].status, FixStatus::NotLocated);
        let found = run(&pass([100.0, 100.0], &TRIANGLE[..1], 50), &cfg);
        assert_eq!((found.users[0].status, found.users[0].occasions), (FixStatus::NotLocated, 0));
    }
}

#[test]
fn coincident_drones_see_nothing() {
    let found = run(&pass([100.0, 100.0], &[[0.0; 2]; 3], 60), &LocalizeConfig::default());
    assert_eq!(found.users[0].status, FixStatus::PoorGeometry);
}

/// Three drones in line with their flight cannot tell left from right.
#[test]
fn drones_in_line_are_ambiguous() {
    let line = [[-25.0, 0.0], [0.0, 0.0], [25.0, 0.0]];
    for clock in [ClockModel::Synchronised, ClockModel::SharedConstant] {
        let cfg = LocalizeConfig { clock, ..LocalizeConfig::default() };
        let found = run(&pass([300.0, 200.0], &line, 60), &cfg);
        assert_eq!(found.users[0].status, FixStatus::Ambiguous, "{found:?}");
    }
}

#[test]
fn captures_that_contradict_each_other_are_inconsistent() {
    let cfg = LocalizeConfig { clock: ClockModel::Synchronised, ..LocalizeConfig::default() };
    let mut occasions = pass([300.0, 200.0], &TRIANGLE, 60);
    for (i, occasion) in occasions.iter_mut().enumerate() {
        for (k, capture) in occasion.captures.iter_mut().enumerate() {
            capture.toa_ns += 2000.0 * hashed([i as i64, k as i64, 5]);
        }
    }
    assert_eq!(run(&occasions, &cfg).users[0].status, FixStatus::Inconsistent);
}

#[test]
fn drops_are_counted() {
    let mut occasions = pass([300.0, 200.0], &TRIANGLE, 60);
    occasions[3].time_s = f64::NAN;
    occasions[5].captures[1].toa_ns = f64::INFINITY;
    occasions[6].captures[1].drone = DroneId(1);
    occasions[7].captures[2].sigma_ns = Some(0.0);
    let found = run(&occasions, &LocalizeConfig::default());
    let count = |what: &str| found.warnings.iter().filter(|w| w.contains(what)).count();
    assert_eq!((found.warnings.len(), count("time"), count("2 captures"), count("twice")), (3, 1, 1, 1));
}

#[test]
fn bad_configurations_are_named() {
    let cfg = LocalizeConfig { sigma_toa_ns: -1.0, ..LocalizeConfig::default() };
    let message = localize(&[], &cfg).expect_err("negative").to_string();
    assert_eq!(message, "sigma_toa_ns is -1, expected a number from 1e-6 to 1e6");
    let late = crlb(&[], &[[false; 3]], &BTreeMap::new(), &LocalizeConfig::default());
    assert!(matches!(late, Err(LocalizeError::LateLength { found: 1, expected: 0 })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Whatever comes in: an answer, finite, one fix per user at most. `run` checks the numbers.
    #[test]
    fn any_input_gets_a_finite_answer(
        rows in prop::collection::vec(
            (0u32..4, 0u16..2, wild(), prop::collection::vec((0u16..6, wild(), wild(), wild(), wild()), 0..4)), 0..40),
        model in 0..3,
    ) {
        let occasions: Vec<Occasion> = rows.iter().map(|(user, group, time_s, captures)| {
            let captures: Vec<_> = captures.iter().take(3).map(|&(d, x, y, z, toa)| (d, [x, y, z], toa)).collect();
            Occasion { clock_group: *group, ..occasion(*user, *time_s, &captures) }
        }).collect();
        let clock = [ClockModel::Synchronised, ClockModel::SharedConstant, WANDER][model as usize];
        let cfg = LocalizeConfig { clock, ..LocalizeConfig::default() };
        let found = run(&occasions, &cfg);
        prop_assert!(found.users.is_sorted_by_key(|fix| fix.user));
        let late = vec![[false; 3]; occasions.len()];
        let truth = found.users.iter().map(|fix| (fix.user, fix.pos_m)).collect();
        for cov in crlb(&occasions, &late, &truth, &cfg).expect("good").values() {
            prop_assert!(cov.as_flattened().iter().all(|c| c.is_finite()));
        }
    }
}

/// Numbers from tame to absurd.
fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -500.0..500.0f64,
        1 => Just(0.0),
        1 => -1e9..1e9f64,
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(1e300), Just(-1e300), Just(1e-300)],
    ]
}
