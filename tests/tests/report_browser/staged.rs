//! A mission that nobody flew but that looks like one: the paper's 10 km square, two fleets and a
//! reserve, eleven lanes shared in the middle of the sixth, and placements where users are dense.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use serde_json::{Value, json};
use skyroost_host_sim::recording::{
    DroneRecord, EventRecord, PhaseRecord, PlacementRecord, Recording, SubAreaRecord, TrackSample, UserRecord,
};

const SIDE_M: f64 = 10_000.0;
const RADIUS_M: f64 = 500.0;
const SWATH_M: f64 = 942.26;
const LANES: usize = 11;
const SPEED_MPS: f64 = 10.0;
const HEIGHT_M: f64 = 300.0;
const BASE_M: [f64; 2] = [5_000.0, -450.0];
const CLIMB_S: f64 = 100.0;
const PLANNING_S: f64 = 30.0;
const SERVICE_S: f64 = 300.0;
/// Corners of the formation around its centre, d = 50 m.
const CORNERS_M: [[f64; 2]; 3] = [[28.87, 0.0], [-14.43, 25.0], [-14.43, -25.0]];

/// The mission with so many users.
pub(crate) fn recording(users: usize) -> Recording {
    let mut random = Random(ChaCha8Rng::seed_from_u64(7));
    let paths = lanes();
    let sweep_s = paths.iter().map(|path| CLIMB_S + length([&[BASE_M], &path[..1]].concat()) / SPEED_MPS);
    let sweep_s = sweep_s.fold(f64::INFINITY, f64::min);
    let swept_s = paths.iter().map(|path| CLIMB_S + length([&[BASE_M], &path[..]].concat()) / SPEED_MPS);
    let swept_s = swept_s.fold(0.0, f64::max).ceil();
    let mut users: Vec<_> = (0..users).map(|i| user(i, &paths, &mut random)).collect();
    let placements = place(&users, 7);
    serve(&mut users, &placements);
    let drones: Vec<_> = (0..7_u16)
        .map(|i| {
            fly(i, paths.get(usize::from(i / 3)), placements[usize::from(i)].pos_m, swept_s + PLANNING_S)
        })
        .collect();
    let arrived_s = drones.iter().map(|drone| drone.1).fold(0.0, f64::max).ceil();
    let phase = |t_s: f64, name: &str| PhaseRecord { t_s, name: name.into() };
    let event = |t_s: f64, drone: Option<u16>, text: &str| EventRecord { t_s, drone, text: text.into() };
    let mut events = vec![
        event(0.0, None, "Plans sent to all drones"),
        event(sweep_s, None, "First fleet at its first lane, sweep starts"),
        event(2_311.0, Some(4), "Link lost for 3.2 s, went on with the plan"),
        event(3_977.0, Some(2), "Avoidance: gave way to drone 5 for 4 s"),
        event(swept_s, None, "Sweep complete, area covered"),
        event(swept_s + PLANNING_S, None, "Placements sent to all drones"),
    ];
    events.extend(drones.iter().map(|(drone, at_s)| event(*at_s, Some(drone.id), "On station")));
    events.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    Recording {
        scenario: "staged".into(),
        seed: 7,
        radius_m: RADIUS_M,
        swath_m: SWATH_M,
        area_m: vec![rectangle(0.0, SIDE_M)],
        no_fly_m: Vec::new(),
        fence_m: Vec::new(),
        origin_lon_lat_deg: Some([4.355_72, 51.998_85]),
        sub_areas: (0..2)
            .map(|fleet| SubAreaRecord {
                fleet: fleet as u16,
                polygon_m: Some(rectangle(fleet as f64 * SIDE_M / 2.0, (fleet as f64 + 1.0) * SIDE_M / 2.0)),
                path_m: paths[fleet].clone(),
            })
            .collect(),
        uncovered_m: Vec::new(),
        drones: drones.into_iter().map(|(drone, _)| with_service(drone, arrived_s + SERVICE_S)).collect(),
        users,
        placements,
        phases: vec![
            phase(0.0, "Take-off and transit"),
            phase(sweep_s, "Sweep"),
            phase(swept_s, "Planning"),
            phase(swept_s + PLANNING_S, "To placements"),
            phase(arrived_s, "Service"),
        ],
        events,
    }
}

/// Results that fit the recording.
pub(crate) fn summary(recording: &Recording) -> Value {
    let count = |holds: fn(&UserRecord) -> bool| recording.users.iter().filter(|u| holds(u)).count();
    json!({
        "scenario": "staged", "seed": 7, "backend": "inproc", "drones": 7, "fleets": 2,
        "sweep": {"coverage_fraction": 1.0, "duration_s": 5818.2, "length_m": [58_182.0, 58_150.0]},
        "localization": {"users": recording.users.len(), "located": count(|u| u.status == "ok"), "rmse_m": 3.61,
            "r95_median_m": 6.13, "r95_p95_m": 9.87, "crlb_ratio": 1.04, "in_r95_fraction": 0.953},
        "placement": {"method": "joint", "served_guaranteed": count(|u| u.served_guaranteed_by.is_some()),
            "served_actual": count(|u| u.served_actual_by.is_some()), "upper_bound": 88, "proved_optimal": true},
        "safety": {"min_separation_m": 46.83, "violations": 0, "formation_error_rms_m": 0.412,
            "formation_error_max_m": 2.07},
        "link": {"frames": 1_048_221, "bytes": 61_240_118, "lost": 10_377, "rejected": 12},
        "timing": {"simulated_s": 7141.0, "wall_s": 18.4, "realtime_factor": 388.1},
        "digest": "5f0c6e21a4b7d98e4f1139ac02db77e1"
    })
}

/// The lanes of each fleet: every other lane runs back, and the sixth is shared half and half.
fn lanes() -> [Vec<[f64; 2]>; 2] {
    let y_m = |lane: usize| (lane as f64 + 0.5) * SIDE_M / LANES as f64;
    let ends = |lane: usize| if lane.is_multiple_of(2) { [350.0, 9650.0] } else { [9650.0, 350.0] };
    let whole = |lane: usize| ends(lane).map(|x_m| [x_m, y_m(lane)]);
    let middle = [SIDE_M / 2.0, y_m(LANES / 2)];
    let mut first: Vec<_> = (0..LANES / 2).flat_map(whole).collect();
    first.extend([[9650.0, middle[1]], middle]);
    let mut second: Vec<_> = (LANES / 2 + 1..LANES).rev().flat_map(whole).collect();
    second.extend([[350.0, middle[1]], middle]);
    [first, second]
}

fn rectangle(south_m: f64, north_m: f64) -> Vec<[f64; 2]> {
    vec![[0.0, south_m], [SIDE_M, south_m], [SIDE_M, north_m], [0.0, north_m]]
}

fn length(path: impl AsRef<[[f64; 2]]>) -> f64 {
    path.as_ref().windows(2).map(|leg| distance(leg[0], leg[1])).sum()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The point after so many metres of a path.
fn along(path: &[[f64; 2]], mut way_m: f64) -> [f64; 2] {
    for leg in path.windows(2) {
        let leg_m = distance(leg[0], leg[1]);
        if way_m < leg_m {
            return [0, 1].map(|i| leg[0][i] + (leg[1][i] - leg[0][i]) * way_m / leg_m);
        }
        way_m -= leg_m;
    }
    path[path.len() - 1]
}

/// Flies one drone (from 0; the seventh is the reserve) up to its placement, and says when it is there.
fn fly(i: u16, path: Option<&Vec<[f64; 2]>>, goal_m: [f64; 2], leave_s: f64) -> (DroneRecord, f64) {
    let way: Vec<[f64; 2]> = [BASE_M].into_iter().chain(path.into_iter().flatten().copied()).collect();
    let corner = path.map_or([0.0, -60.0], |_| CORNERS_M[usize::from(i % 3)]);
    let mut track = Vec::new();
    let mut t_s = 0.0;
    let mut pos_m = BASE_M;
    while t_s < leave_s || distance(pos_m, goal_m) > 1e-9 {
        if t_s < leave_s {
            let centre_m = along(&way, SPEED_MPS * (t_s - CLIMB_S).max(0.0));
            let shake_m = |rate: f64| 0.6 * (t_s * rate + f64::from(i)).sin();
            pos_m = [centre_m[0] + corner[0] + shake_m(0.21), centre_m[1] + corner[1] + shake_m(0.34)];
        } else {
            let part = (SPEED_MPS / distance(pos_m, goal_m)).min(1.0);
            pos_m = [0, 1].map(|k| pos_m[k] + part * (goal_m[k] - pos_m[k]));
        }
        let climbed = if path.is_some() { t_s / CLIMB_S } else { (t_s - leave_s) / CLIMB_S };
        let up_m = HEIGHT_M * climbed.clamp(0.0, 1.0);
        track.push(TrackSample { t_s, pos_enu_m: [pos_m[0], pos_m[1], up_m] });
        t_s += 1.0;
    }
    let fleet = path.map(|_| i / 3);
    (DroneRecord { id: i + 1, fleet, track }, t_s)
}

/// Hovers at the last position.
fn with_service(mut drone: DroneRecord, end_s: f64) -> DroneRecord {
    while let Some(last) = drone.track.last().copied().filter(|last| last.t_s < end_s) {
        drone.track.push(TrackSample { t_s: last.t_s + 1.0, ..last });
    }
    drone
}

/// A user somewhere in the square, located as well as its luck has it.
fn user(i: usize, paths: &[Vec<[f64; 2]>; 2], random: &mut Random) -> UserRecord {
    let truth_m = [random.uniform() * SIDE_M, random.uniform() * SIDE_M];
    let luck = random.uniform();
    let status = match luck {
        x if x < 0.01 => "not_located",
        x if x < 0.02 => "inconsistent",
        x if x < 0.03 => "poor_geometry",
        x if x < 0.04 => "ambiguous",
        _ => "ok",
    };
    let (major_m, minor_m) = (1.0 + 3.0 * random.uniform(), 0.6 + random.uniform());
    let turn_rad = std::f64::consts::PI * random.uniform();
    let (sin, cos) = turn_rad.sin_cos();
    let (p_m, q_m) = (major_m * random.normal(), minor_m * random.normal());
    let cov_m2 = [
        [(major_m * cos).powi(2) + (minor_m * sin).powi(2), (major_m.powi(2) - minor_m.powi(2)) * sin * cos],
        [(major_m.powi(2) - minor_m.powi(2)) * sin * cos, (major_m * sin).powi(2) + (minor_m * cos).powi(2)],
    ];
    let claimed = status != "not_located";
    UserRecord {
        id: format!("u{}", i + 1),
        truth_m,
        estimate_m: claimed
            .then_some([truth_m[0] + p_m * cos - q_m * sin, truth_m[1] + p_m * sin + q_m * cos]),
        cov_m2: claimed.then_some(cov_m2),
        r95_m: claimed.then_some(2.1 * major_m.hypot(0.6 * minor_m)),
        status,
        occasions: 20 + (luck * 80.0) as u32,
        heard_s: heard_s(truth_m, paths),
        served_guaranteed_by: None,
        served_actual_by: None,
    }
}

/// When a fleet's centre was last within the swath of a point.
fn heard_s(point_m: [f64; 2], paths: &[Vec<[f64; 2]>; 2]) -> Option<f64> {
    let passes = paths.iter().flat_map(|path| {
        let transit_m = distance(BASE_M, path[0]);
        let steps = (length(path) / 20.0) as usize;
        let near = (0..=steps).map(|k| 20.0 * k as f64);
        let near = near.filter(move |&way_m| distance(along(path, way_m), point_m) < SWATH_M / 2.0);
        near.map(move |way_m| CLIMB_S + (transit_m + way_m) / SPEED_MPS)
    });
    passes.reduce(f64::max)
}

/// Greedy placements over users, good enough to look at.
fn place(users: &[UserRecord], drones: u16) -> Vec<PlacementRecord> {
    let mut left: Vec<[f64; 2]> = users.iter().filter_map(|u| u.estimate_m).collect();
    let near =
        |at_m: [f64; 2], left: &[[f64; 2]]| left.iter().filter(|&&p| distance(p, at_m) <= RADIUS_M).count();
    let mut placements = Vec::new();
    for drone in 1..=drones {
        let candidates = left.iter().take(400).copied();
        let pos_m =
            candidates.max_by_key(|&at_m| near(at_m, &left)).unwrap_or([1_000.0 * f64::from(drone), 500.0]);
        placements.push(PlacementRecord { drone, pos_m, covered: near(pos_m, &left) as u32 });
        left.retain(|&p| distance(p, pos_m) > RADIUS_M);
    }
    placements
}

fn serve(users: &mut [UserRecord], placements: &[PlacementRecord]) {
    for user in users {
        let covers = |at_m: Option<[f64; 2]>, reach_m: f64| {
            let found =
                placements.iter().find(|p| at_m.is_some_and(|at_m| distance(at_m, p.pos_m) <= reach_m));
            found.map(|placement| placement.drone)
        };
        user.served_actual_by = covers(Some(user.truth_m), RADIUS_M);
        let ok = user.status == "ok";
        user.served_guaranteed_by =
            covers(user.estimate_m.filter(|_| ok), RADIUS_M - user.r95_m.unwrap_or(0.0));
    }
}

/// Variates of a ChaCha stream.
struct Random(ChaCha8Rng);

impl Random {
    fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (2.0 * std::f64::consts::PI * self.uniform()).cos()
    }
}
