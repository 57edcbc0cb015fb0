//! Localization at its limit: thousands of fresh users against a bound computed here, and what must not be believed.
//!
//! The bound in this file is worked out on its own, from nothing but geometry: no code of the estimator.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use heapless::Vec as BoundedVec;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use skyroost_host_sim::control::localize::{
    C_M_PER_NS, Capture, ClockModel, FixStatus, Localization, LocalizeConfig, Occasion, Running, UserFix,
    crlb, crlb_ratio, localize,
};
use skyroost_protocol::units::{DroneId, UserId};

/// Every user gets a pass of its own over flat ground, a formation of three flying past it.
#[derive(Clone, Debug)]
struct Passes {
    seed: u64,
    users: u32,
    height_m: f64,
    sigma_ns: f64,
    late: f64,
    lost: f64,
    /// Constant offsets of the drones' clocks, the same for all users.
    offset_ns: [f64; 3],
    drift_ns_per_s: [f64; 3],
    /// Users lie this far beside the track at most, and at least.
    beside_m: [f64; 2],
    drones: usize,
    /// The drones fly one behind the other.
    in_line: bool,
    /// Standard deviation of the users' altitudes about 0.
    altitude_sigma_m: f64,
    /// Standard deviation of each coordinate of a drone's position, drawn anew for every pass.
    drone_bias_m: f64,
}

impl Default for Passes {
    fn default() -> Self {
        Self {
            seed: 1,
            users: 2_000,
            height_m: 300.0,
            sigma_ns: 5.0,
            late: 0.0,
            lost: 0.0,
            offset_ns: [0.0; 3],
            drift_ns_per_s: [0.0; 3],
            beside_m: [0.0, 450.0],
            drones: 3,
            in_line: false,
            altitude_sigma_m: 0.0,
            drone_bias_m: 0.0,
        }
    }
}

struct Flown {
    occasions: Vec<Occasion>,
    late: Vec<[bool; 3]>,
    truth: BTreeMap<UserId, [f64; 2]>,
}

struct Dice(ChaCha8Rng);

impl Dice {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let u: f64 = StandardUniform.sample(&mut self.0);
        low + (high - low) * u
    }
    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

const REACH_M: f64 = 471.0;

/// One occasion of a pass.
struct Fly {
    user: UserId,
    p: [f64; 3],
    bias_m: [[f64; 3]; 3],
    time_s: f64,
    centre: [f64; 2],
    heading: f64,
}

impl Passes {
    fn fly(&self) -> Flown {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(self.seed));
        let mut flown = Flown { occasions: Vec::new(), late: Vec::new(), truth: BTreeMap::new() };
        for user in 1..=self.users {
            let side = if dice.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
            let beside_m = side * dice.uniform(self.beside_m[0], self.beside_m[1]);
            let heading = dice.uniform(0.0, TAU);
            let (sin, cos) = heading.sin_cos();
            let centre = [dice.uniform(0.0, 5e3), dice.uniform(0.0, 5e3)];
            let p = [
                centre[0] - beside_m * sin,
                centre[1] + beside_m * cos,
                self.altitude_sigma_m * dice.normal(),
            ];
            flown.truth.insert(UserId(user), [p[0], p[1]]);
            let bias_m: [[f64; 3]; 3] =
                std::array::from_fn(|_| std::array::from_fn(|_| self.drone_bias_m * dice.normal()));
            let half_m = (REACH_M.powi(2) - beside_m.powi(2)).max(250f64.powi(2)).sqrt();
            let seconds = (2.0 * half_m / 10.0) as u32;
            for second in 0..seconds {
                let along = 10.0 * f64::from(second) - half_m + dice.uniform(-5.0, 5.0);
                let time_s = 100.0 * f64::from(user) + f64::from(second);
                let centre = [centre[0] + along * cos, centre[1] + along * sin];
                let occasion = Fly { user: UserId(user), p, bias_m, time_s, centre, heading };
                self.occasion(&mut dice, &mut flown, &occasion);
            }
        }
        flown
    }

    fn occasion(&self, dice: &mut Dice, flown: &mut Flown, fly: &Fly) {
        let Fly { user, p, bias_m, time_s, centre, heading } = *fly;
        let emission_ns = dice.uniform(0.0, 1e5);
        let mut captures = BoundedVec::new();
        let mut late = [false; 3];
        for (drone, bias_m) in bias_m.iter().enumerate().take(self.drones) {
            let arm_m = 50.0 / 3f64.sqrt();
            let [ahead_m, left_m] = if self.in_line {
                [50.0 * (drone as f64 - 1.0), 0.0]
            } else {
                let angle = TAU * (drone as f64 / 3.0 + 0.25);
                [arm_m * angle.cos(), arm_m * angle.sin()]
            };
            let (sin, cos) = heading.sin_cos();
            let said = [
                centre[0] + ahead_m * cos - left_m * sin,
                centre[1] + ahead_m * sin + left_m * cos,
                self.height_m,
            ];
            let distance = (0..3).map(|k| (p[k] - said[k] - bias_m[k]).powi(2)).sum::<f64>().sqrt();
            let mut toa_ns = emission_ns + distance / C_M_PER_NS + self.sigma_ns * dice.normal();
            toa_ns += self.offset_ns[drone] + self.drift_ns_per_s[drone] * time_s;
            let is_late = dice.uniform(0.0, 1.0) < self.late;
            if is_late {
                toa_ns += dice.uniform(100.0, 1000.0);
            }
            if dice.uniform(0.0, 1.0) < self.lost {
                continue;
            }
            late[captures.len()] = is_late;
            let sigma_ns = Some(self.sigma_ns);
            let capture = Capture { drone: DroneId(drone as u16 + 1), pos_enu_m: said, toa_ns, sigma_ns };
            captures.push(capture).expect("three drones");
        }
        flown.occasions.push(Occasion { user, clock_group: 0, time_s, captures });
        flown.late.push(late);
    }
}

/// Inverse of the Cramer-Rao bound with known clocks, from the captures that are not late.
fn information(flown: &Flown) -> BTreeMap<UserId, [f64; 3]> {
    let mut sums: BTreeMap<UserId, [f64; 3]> = BTreeMap::new();
    for (occasion, late) in flown.occasions.iter().zip(&flown.late) {
        let p = flown.truth[&occasion.user];
        let rows: Vec<[f64; 2]> = occasion
            .captures
            .iter()
            .zip(late)
            .filter(|(_, late)| !**late)
            .map(|(c, _)| {
                let [x, y, z] = [p[0] - c.pos_enu_m[0], p[1] - c.pos_enu_m[1], c.pos_enu_m[2]];
                let per = c.sigma_ns.unwrap() * C_M_PER_NS * (x * x + y * y + z * z).sqrt();
                [x / per, y / per]
            })
            .collect();
        let n = rows.len() as f64;
        let mean: [f64; 2] = std::array::from_fn(|k| rows.iter().map(|r| r[k]).sum::<f64>() / n);
        let sum = sums.entry(occasion.user).or_default();
        for r in &rows {
            let [x, y] = [r[0] - mean[0], r[1] - mean[1]];
            sum[0] += x * x;
            sum[1] += x * y;
            sum[2] += y * y;
        }
    }
    sums
}

fn config(clock: ClockModel) -> LocalizeConfig {
    LocalizeConfig { clock, drone_pos_sigma_m: 0.0, ..LocalizeConfig::default() }
}

fn error_m(flown: &Flown, fix: &UserFix) -> [f64; 2] {
    let p = flown.truth[&fix.user];
    [fix.pos_m[0] - p[0], fix.pos_m[1] - p[1]]
}

#[derive(Debug)]
struct Score {
    /// sqrt(mean(e' C^-1 e) / 2) with the bound of the captures that are not late.
    ratio: f64,
    ok: f64,
    /// Share of truths within the 95 % ellipse, and within r95.
    in_ellipse: f64,
    in_r95: f64,
}

fn score(flown: &Flown, found: &Localization) -> Score {
    let info = information(flown);
    let ok: Vec<&UserFix> = found.users.iter().filter(|f| f.status == FixStatus::Ok).collect();
    let n = ok.len() as f64;
    let square =
        |e: [f64; 2], [xx, xy, yy]: [f64; 3]| e[0] * e[0] * xx + 2.0 * e[0] * e[1] * xy + e[1] * e[1] * yy;
    let sum: f64 = ok.iter().map(|f| square(error_m(flown, f), info[&f.user])).sum();
    let inside = |f: &&&UserFix| {
        let [[xx, xy], [_, yy]] = f.cov_m2;
        let det = xx * yy - xy * xy;
        square(error_m(flown, f), [yy / det, -xy / det, xx / det]) <= 5.991_464_547
    };
    let near = |f: &&&UserFix| {
        let [x, y] = error_m(flown, f);
        x.hypot(y) <= f.r95_m
    };
    Score {
        ratio: (sum / (2.0 * n)).sqrt(),
        ok: n / flown.truth.len() as f64,
        in_ellipse: ok.iter().filter(inside).count() as f64 / n,
        in_r95: ok.iter().filter(near).count() as f64 / n,
    }
}

fn solve(flown: &Flown, cfg: &LocalizeConfig) -> Localization {
    localize(&flown.occasions, cfg).expect("a good configuration")
}

/// Clean passes attain the bound, and the ellipses hold what they claim.
#[test]
fn truth_clean_passes_attain_the_bound() {
    for (height_m, sigma_ns) in
        [(100.0, 1.0), (100.0, 10.0), (100.0, 30.0), (300.0, 1.0), (300.0, 5.0), (300.0, 30.0)]
    {
        let flown = Passes { seed: 11, height_m, sigma_ns, ..Passes::default() }.fly();
        let found = solve(&flown, &config(ClockModel::Synchronised));
        let score = score(&flown, &found);
        let good = (score.ratio - 1.0).abs() <= 0.03
            && (0.937..=0.963).contains(&score.in_ellipse)
            && (0.937..=0.963).contains(&score.in_r95)
            && score.ok >= 0.98;
        assert!(good, "h {height_m} m, sigma {sigma_ns} ns: {score:?}");
    }
}

/// Late captures cost next to nothing against an oracle that knows which they are, lost ones nothing but themselves.
#[test]
fn truth_late_and_lost_captures() {
    for (height_m, late, lost, allowed) in
        [(300.0, 0.05, 0.0, 1.03), (100.0, 0.05, 0.0, 1.03), (300.0, 0.05, 0.25, 1.05)]
    {
        let flown = Passes { seed: 12, height_m, late, lost, ..Passes::default() }.fly();
        let found = solve(&flown, &config(ClockModel::Synchronised));
        let score = score(&flown, &found);
        assert!(
            score.ratio <= allowed && score.ok >= 0.999,
            "h {height_m} m, late {late}, lost {lost}: {score:?}"
        );
        assert!((0.937..=0.963).contains(&score.in_ellipse), "{score:?}");
    }
}

/// A hundred users that share three clocks lose little against clocks that are known.
#[test]
fn truth_shared_offsets_cost_little() {
    let (mut unknown, mut known) = (0.0, 0.0);
    for seed in 0..20 {
        let passes = Passes { seed: 100 + seed, users: 100, ..Passes::default() };
        let squares = |offset_ns: [f64; 3], clock| {
            let flown = Passes { offset_ns, ..passes.clone() }.fly();
            let found = solve(&flown, &config(clock));
            assert!(
                found.users.iter().all(|f| f.status == FixStatus::Ok),
                "seed {seed}: {:?}",
                found.warnings
            );
            found.users.iter().map(|f| error_m(&flown, f)).map(|[x, y]| x * x + y * y).sum::<f64>()
        };
        unknown += squares([180.0, -200.0, 77.0], ClockModel::SharedConstant);
        known += squares([0.0; 3], ClockModel::Synchronised);
    }
    let ratio = (unknown / known).sqrt();
    assert!(ratio <= 1.06, "{ratio}");
}

/// Share of users that are refused, or within their r95.
fn flagged_or_covered(flown: &Flown, found: &Localization) -> f64 {
    let honest = |f: &&UserFix| {
        let [x, y] = error_m(flown, f);
        f.status != FixStatus::Ok || x.hypot(y) <= f.r95_m
    };
    found.users.iter().filter(honest).count() as f64 / found.users.len() as f64
}

/// What must not be believed: users whom nothing vouches for, far away, behind clocks that are not as declared.
#[test]
fn truth_wrong_answers_are_never_confident() {
    let few = Passes { users: 300, ..Passes::default() };
    let none = ClockModel::Synchronised;
    let mut cases = vec![
        ("two drones", Passes { drones: 2, ..few.clone() }, none),
        ("two drones, near the track", Passes { drones: 2, beside_m: [0.0, 60.0], ..few.clone() }, none),
        ("two drones, clocks unknown", Passes { drones: 2, ..few.clone() }, ClockModel::SharedConstant),
        ("drones in line with their flight", Passes { in_line: true, ..few.clone() }, none),
    ];
    for far_m in [600.0, 1_000.0, 2_000.0, 5_000.0] {
        cases.push(("far away", Passes { beside_m: [far_m, far_m + 100.0], ..few.clone() }, none));
    }
    for offset in [5.0, 20.0, 200.0, 1_000.0] {
        let offset_ns = [0.0, offset, -0.6 * offset];
        cases.push(("undeclared offset", Passes { offset_ns, ..few.clone() }, none));
    }
    for drift in [0.01, 0.1, 5.0] {
        let passes = Passes { drift_ns_per_s: [0.0, drift, -drift], ..few.clone() };
        cases.push(("undeclared drift", passes.clone(), none));
        cases.push(("undeclared drift", passes, ClockModel::SharedConstant));
    }
    for (name, passes, clock) in cases {
        let flown = passes.fly();
        let honest = flagged_or_covered(&flown, &solve(&flown, &config(clock)));
        assert!(honest >= 0.96, "{name}: {honest} of {passes:?}");
    }
}

/// The same of users alone in their file.
#[test]
fn truth_alone_with_undeclared_offsets() {
    for offset in [20.0, 50.0, 200.0] {
        let offset_ns = [0.0, offset, -0.6 * offset];
        let honest: f64 = (0..100)
            .map(|seed| {
                let flown = Passes { seed, users: 1, offset_ns, ..Passes::default() }.fly();
                flagged_or_covered(&flown, &solve(&flown, &config(ClockModel::Synchronised)))
            })
            .sum();
        assert!(honest >= 96.0, "{offset} ns: {honest}");
    }
}

/// Ground whose altitude is known to 20 m: estimating it keeps the promise, ignoring it does not.
#[test]
fn truth_uncertain_terrain() {
    let passes = Passes { altitude_sigma_m: 20.0, ..Passes::default() };
    let flown = passes.fly();
    let ignorant = score(&flown, &solve(&flown, &config(ClockModel::Synchronised)));
    let cfg = LocalizeConfig { user_altitude_sigma_m: 20.0, ..config(ClockModel::Synchronised) };
    let found = solve(&flown, &cfg);
    let aware = score(&flown, &found);
    assert!(ignorant.in_ellipse < 0.7, "{ignorant:?}");
    assert!((0.937..=0.963).contains(&aware.in_ellipse) && aware.ok >= 0.99, "{aware:?}");
    let bound = crlb(&flown.occasions, &flown.late, &flown.truth, &cfg).expect("good input");
    let ratio = crlb_ratio(&found.users, &flown.truth, &bound).expect("users");
    assert!((ratio - 1.0).abs() <= 0.03, "{ratio}");
}

/// Positions of drones that are off by the same for a whole pass.
#[test]
fn truth_biased_drones() {
    let flown = Passes { drone_bias_m: 1.5, ..Passes::default() }.fly();
    let ignorant = score(&flown, &solve(&flown, &config(ClockModel::Synchronised)));
    let cfg = LocalizeConfig { drone_bias_sigma_m: 1.5, ..config(ClockModel::Synchronised) };
    let aware = score(&flown, &solve(&flown, &cfg));
    assert!(ignorant.in_ellipse < 0.5, "{ignorant:?}");
    assert!((0.93..=0.97).contains(&aware.in_ellipse) && aware.ok >= 0.99, "{aware:?}");
}

/// While captures arrive, estimates improve, keep what they promise, and end near the solution of everything. At low
/// altitude, too, where a plain filter diverges.
#[test]
fn truth_running_estimates() {
    for (height_m, late) in [(300.0, 0.05), (100.0, 0.05), (100.0, 0.0)] {
        let flown = Passes { seed: 5, users: 500, height_m, late, ..Passes::default() }.fly();
        let cfg = config(ClockModel::Synchronised);
        let mut running = Running::new(cfg, [(0, vec![DroneId(1), DroneId(2), DroneId(3)])]);
        let mut halfway: BTreeMap<UserId, f64> = BTreeMap::new();
        let mut misses = [0usize; 2];
        for (i, occasion) in flown.occasions.iter().enumerate() {
            running.add(occasion);
            let fix = running.fix(occasion.user).expect("just heard");
            let p = flown.truth[&occasion.user];
            let miss = (fix.pos_m[0] - p[0]).hypot(fix.pos_m[1] - p[1]) > fix.r95_m;
            let last = flown.occasions.get(i + 1).is_none_or(|next| next.user != occasion.user);
            if fix.occasions == 30 {
                halfway.insert(occasion.user, fix.r95_m);
                misses[0] += usize::from(miss);
            } else if last {
                misses[1] += usize::from(miss);
                let before = halfway.get(&occasion.user).copied().unwrap_or(f64::INFINITY);
                assert!(fix.r95_m < before, "{} m after {before} m", fix.r95_m);
            }
        }
        assert_eq!(running.len(), flown.truth.len());
        let share = misses.map(|n| n as f64 / flown.truth.len() as f64);
        assert!(share[0] < 0.08 && share[1] < 0.08, "h {height_m} m, late {late}: {share:?}");
        let whole = solve(&flown, &cfg);
        let mut worse: Vec<f64> =
            whole.users.iter().map(|f| running.fix(f.user).expect("heard").r95_m / f.r95_m).collect();
        worse.sort_by(f64::total_cmp);
        assert!(worse[250] < 1.3 && worse[499] < 2.0, "{} {}", worse[250], worse[499]);
    }
}

/// Before the clocks are solved a running estimate claims next to nothing; afterwards it is as good as any.
#[test]
fn truth_running_estimates_with_unknown_clocks() {
    let passes = Passes {
        users: 60,
        offset_ns: [0.0, 180.0, -150.0],
        drift_ns_per_s: [0.0, 4.0, -3.0],
        ..Passes::default()
    };
    let flown = passes.fly();
    let clock = ClockModel::SharedWander {
        offset_sigma_ns: 200.0,
        drift_sigma_ns_per_s: 5.0,
        walk_ns_per_sqrt_s: 0.1,
    };
    let cfg = config(clock);
    let mut running = Running::new(cfg, [(0, vec![DroneId(1), DroneId(2), DroneId(3)])]);
    let (before, after) = flown.occasions.split_at(flown.occasions.len() / 2);
    before.iter().for_each(|occasion| running.add(occasion));
    let early = running.fix(before[before.len() - 1].user).expect("heard");
    assert!(early.r95_m > 300.0 && early.known_clocks_r95_m < 30.0, "{early:?}");
    running.calibrate(&localize(before, &cfg).expect("good").clocks);
    after.iter().for_each(|occasion| running.add(occasion));
    let late: Vec<UserId> = (40..=60).map(UserId).collect();
    for user in &late {
        let fix = running.fix(*user).expect("heard");
        let p = flown.truth[user];
        let error_m = (fix.pos_m[0] - p[0]).hypot(fix.pos_m[1] - p[1]);
        assert!(error_m < 1.5 * fix.r95_m && fix.r95_m < 200.0, "{error_m} m, {fix:?}");
    }
}
