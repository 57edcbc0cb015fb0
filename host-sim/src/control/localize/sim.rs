//! A small world of its own for tests and benches: fleets in zigzag over a square, wandering clocks, late captures.
#![allow(missing_docs, unreachable_pub, reason = "compiled into the tests and into the bench")]

use std::collections::BTreeMap;

use heapless::Vec as BoundedVec;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use skyroost_protocol::units::{DroneId, UserId};

use super::{C_M_PER_NS, Capture, Motion, Occasion};

/// What is simulated. Defaults are those of the mission.
#[derive(Clone, Debug)]
pub struct World {
    pub seed: u64,
    pub users_per_km2: f64,
    /// Side of the square.
    pub side_m: f64,
    /// Fleets share the lanes by length.
    pub fleets: u16,
    pub sigma_toa_ns: f64,
    pub late_fraction: f64,
    pub lost_fraction: f64,
    pub offset_ns: f64,
    pub drift_ns_per_s: f64,
    pub walk_ns_per_sqrt_s: f64,
    pub drone_pos_sigma_m: f64,
    pub grid_ns: f64,
    pub motion: Motion,
}

impl Default for World {
    fn default() -> Self {
        Self {
            seed: 1,
            users_per_km2: 5.0,
            side_m: 10_000.0,
            fleets: 2,
            sigma_toa_ns: 5.0,
            late_fraction: 0.05,
            lost_fraction: 0.1,
            offset_ns: 200.0,
            drift_ns_per_s: 5.0,
            walk_ns_per_sqrt_s: 0.1,
            drone_pos_sigma_m: 0.02,
            grid_ns: 1.017,
            motion: Motion::STILL,
        }
    }
}

/// What came of it.
pub struct Flown {
    pub occasions: Vec<Occasion>,
    pub late: Vec<[bool; 3]>,
    /// Where each user was at first.
    pub truth: BTreeMap<UserId, [f64; 2]>,
    /// Where each was second by second, if it walked.
    pub walks: BTreeMap<UserId, Vec<[f64; 2]>>,
}

impl Flown {
    /// Where a user was.
    pub fn at(&self, user: UserId, time_s: f64) -> [f64; 2] {
        let Some(walk) = self.walks.get(&user) else { return self.truth[&user] };
        let from = (time_s as usize).min(walk.len() - 2);
        let f = time_s - from as f64;
        std::array::from_fn(|k| walk[from][k] + f * (walk[from + 1][k] - walk[from][k]))
    }
}

const SPACING_M: f64 = 909.0;
const SPEED_MPS: f64 = 10.0;
const RADIUS_M: f64 = 471.0;
const HEIGHT_M: f64 = 300.0;
const FORMATION_M: f64 = 50.0;

struct Dice(ChaCha8Rng);

impl Dice {
    fn uniform(&mut self) -> f64 {
        StandardUniform.sample(&mut self.0)
    }
    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

impl World {
    /// Flies every fleet over its share of the lanes, one SRS per user and second.
    pub fn fly(&self) -> Flown {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(self.seed));
        let count = (self.users_per_km2 * self.side_m * self.side_m * 1e-6).round() as u32;
        let truth: BTreeMap<UserId, [f64; 2]> = (0..count)
            .map(|id| (UserId(id + 1), [dice.uniform() * self.side_m, dice.uniform() * self.side_m]))
            .collect();
        let track = self.track();
        let share = track.len().div_ceil(usize::from(self.fleets));
        let walks = self.walks(&truth, share + 2);
        let mut flown = Flown { occasions: Vec::new(), late: Vec::new(), truth, walks };
        for (fleet, path) in track.chunks(share).enumerate() {
            self.fly_fleet(fleet as u16, path, &mut dice, &mut flown);
        }
        flown
    }

    /// Velocities by their exact recursion once a second, ways by the trapezoidal rule.
    fn walks(&self, from: &BTreeMap<UserId, [f64; 2]>, seconds: usize) -> BTreeMap<UserId, Vec<[f64; 2]>> {
        let mut walks = BTreeMap::new();
        if self.motion.is_still() {
            return walks;
        }
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(!self.seed));
        let sigma_mps = self.motion.velocity_m2ps2().sqrt();
        let kept = (-1.0 / self.motion.turn_s).exp();
        for (&user, &at) in from {
            let mut velocity: [f64; 2] = std::array::from_fn(|_| sigma_mps * dice.normal());
            let mut walk = vec![at];
            for _ in 1..seconds {
                let before = velocity;
                velocity =
                    velocity.map(|v| kept * v + sigma_mps * (1.0 - kept * kept).sqrt() * dice.normal());
                let last = walk[walk.len() - 1];
                walk.push(std::array::from_fn(|k| last[k] + 0.5 * (before[k] + velocity[k])));
            }
            walks.insert(user, walk);
        }
        walks
    }

    /// Fleet centre and heading (+1, -1 or 0 along north) second by second, over all lanes.
    fn track(&self) -> Vec<[f64; 2]> {
        let lanes = (self.side_m / SPACING_M).round().max(1.0) as usize;
        let mut corners = Vec::new();
        for lane in 0..lanes {
            let y = (lane as f64 + 0.5) * self.side_m / lanes as f64;
            let ends = if lane % 2 == 0 { [0.0, self.side_m] } else { [self.side_m, 0.0] };
            corners.extend(ends.map(|x| [x, y]));
        }
        let mut track = Vec::new();
        for leg in corners.windows(2) {
            let (dx, dy) = (leg[1][0] - leg[0][0], leg[1][1] - leg[0][1]);
            let steps = (dx.hypot(dy) / SPEED_MPS).round() as usize;
            track.extend((0..steps).map(|k| {
                let f = k as f64 / steps as f64;
                [leg[0][0] + f * dx, leg[0][1] + f * dy]
            }));
        }
        track
    }

    fn fly_fleet(&self, fleet: u16, path: &[[f64; 2]], dice: &mut Dice, flown: &mut Flown) {
        let mut offset_ns: [f64; 3] = std::array::from_fn(|_| self.offset_ns * (2.0 * dice.uniform() - 1.0));
        let drift: [f64; 3] = std::array::from_fn(|_| self.drift_ns_per_s * (2.0 * dice.uniform() - 1.0));
        let phases: Vec<f64> = flown.truth.keys().map(|_| dice.uniform()).collect();
        for (second, centre) in path.iter().enumerate() {
            for ((&user, start), phase) in flown.truth.iter().zip(&phases) {
                let time_s = second as f64 + phase;
                let p = if flown.walks.is_empty() { *start } else { flown.at(user, time_s) };
                let reach = (p[0] - centre[0]).hypot(p[1] - centre[1]);
                if reach > RADIUS_M {
                    continue;
                }
                let emission_ns = 1e5 * dice.uniform();
                let mut captures = BoundedVec::new();
                let mut late = [false; 3];
                for drone in 0..3 {
                    let angle = std::f64::consts::TAU * (drone as f64 / 3.0 + 0.25);
                    let side = FORMATION_M / 3f64.sqrt();
                    let at = [centre[0] + side * angle.cos(), centre[1] + side * angle.sin(), HEIGHT_M];
                    let distance =
                        ((p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2) + HEIGHT_M.powi(2)).sqrt();
                    let mut toa_ns =
                        emission_ns + distance / C_M_PER_NS + offset_ns[drone] + drift[drone] * phase;
                    toa_ns += self.sigma_toa_ns * dice.normal();
                    let is_late = dice.uniform() < self.late_fraction;
                    if is_late {
                        toa_ns += 100.0 + 900.0 * dice.uniform();
                    }
                    if self.grid_ns > 0.0 {
                        toa_ns = (toa_ns / self.grid_ns).round() * self.grid_ns;
                    }
                    if dice.uniform() < self.lost_fraction {
                        continue;
                    }
                    late[captures.len()] = is_late;
                    let capture = Capture {
                        drone: DroneId(fleet * 3 + drone as u16 + 1),
                        pos_enu_m: at.map(|x| x + self.drone_pos_sigma_m * dice.normal()),
                        toa_ns,
                        sigma_ns: None,
                    };
                    captures.push(capture).expect("three drones");
                }
                flown.occasions.push(Occasion { user, clock_group: fleet, time_s, captures });
                flown.late.push(late);
            }
            for i in 0..3 {
                offset_ns[i] += drift[i] + self.walk_ns_per_sqrt_s * dice.normal();
            }
        }
    }
}
