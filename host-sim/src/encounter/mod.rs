//! Encounters: the flight code's collision avoidance against itself, on given vehicles.
//!
//! Every vehicle is a point that accelerates by at most a limit. Fifty times a second the flight code's `goto` and `avoid`
//! make a velocity of what the vehicle measures and what it has heard of the others; in between, the physics goes on in its own
//! steps. Separation is that of true centres over continuous time, among pairs of which one at least cooperates.

mod body;
mod families;
mod noise;
#[cfg(test)]
mod safety;
mod scenario;
#[cfg(test)]
mod tests;

pub use families::{Family, draw};
pub use noise::NoiseModel;
pub use scenario::{Encounter, EncounterError, VehicleSpec};

use skyroost_firmware::avoid::{self, Rule, Separation, pca::Mover};
use skyroost_firmware::counters::Counters;
use skyroost_firmware::guidance::goto;
use skyroost_firmware::peers::PeerTable;
use skyroost_firmware::{STEP_US, Vec3};
pub use skyroost_protocol::message::Vertical;
use skyroost_protocol::message::{PeerState, SharedState};
use skyroost_protocol::units::{DroneId, PosEnuMm, TimePs, VelEnuMmps};

use crate::geometry::V3;
use body::{Ability, Body, VERTICAL_MPS, least_distance_m};
use noise::Noise;

/// A goal counts as reached within this distance, metres.
const ARRIVED_M: f64 = 5.0;

/// What a vehicle knows when it decides.
pub struct Knowledge<'a> {
    /// The time.
    pub now: TimePs,
    /// Itself, as it measures.
    pub own: Mover,
    /// The velocity to its goal, were it alone, m/s.
    pub wanted_mps: Vec3,
    /// What it has heard of the others.
    pub peers: &'a PeerTable,
    /// What it must keep.
    pub separation: Separation,
}

/// Any way to avoid others.
pub trait Steering {
    /// The velocity to command, m/s.
    fn steer(&self, known: &Knowledge<'_>) -> Vec3;
}

/// What a vehicle does about others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Avoidance {
    /// The flight code's avoidance.
    On,
    /// Straight on.
    Off,
    /// The paper's pairwise rule (13) to (17), its signs mended.
    LiteralPca,
}

impl Steering for Avoidance {
    fn steer(&self, known: &Knowledge<'_>) -> Vec3 {
        let Knowledge { now, own, wanted_mps, peers, separation } = known;
        let rule = match self {
            Self::Off => return *wanted_mps,
            Self::On => Rule::HalfPlanes,
            Self::LiteralPca => Rule::LiteralPca,
        };
        avoid::avoid(*now, own, *wanted_mps, peers, core::iter::empty(), separation, rule).vel_enu_mps
    }
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Least distance of a pair of which one cooperates; none without such a pair.
    pub min_separation_m: Option<f64>,
    /// Such pairs that were below `d_safe_m`.
    pub violations: usize,
    /// When each vehicle was first at its goal.
    pub arrival_s: Vec<Option<f64>>,
    /// By how much longer those that cooperate and arrived took than alone, on average.
    pub overhead_fraction: f64,
}

/// Where everybody is at a time.
pub type Watch<'a> = dyn FnMut(f64, &[(u16, V3)]) + 'a;

/// Flies an encounter. Those that do not cooperate fly straight on, whatever the steering.
///
/// # Errors
/// [`EncounterError`] names what cannot be flown.
pub fn fly(
    encounter: &Encounter,
    steering: &dyn Steering,
    watch: &mut Watch<'_>,
) -> Result<Outcome, EncounterError> {
    encounter.check()?;
    let mut flight = Flight::new(encounter, steering);
    flight.run(watch);
    Ok(flight.outcome())
}

/// A state under way to one receiver.
struct Packet {
    usable_s: f64,
    state: PeerState,
}

/// One vehicle and its flight code.
struct Pilot<'a> {
    spec: &'a VehicleSpec,
    body: Body,
    noise: Noise,
    peers: PeerTable,
    counters: Counters,
    inbox: Vec<Packet>,
    command_mps: V3,
    arrived_s: Option<f64>,
}

struct Flight<'a> {
    encounter: &'a Encounter,
    steering: &'a dyn Steering,
    pilots: Vec<Pilot<'a>>,
    /// Least distance of every pair, by its first and second.
    least_m: Vec<f64>,
}

impl<'a> Flight<'a> {
    fn new(encounter: &'a Encounter, steering: &'a dyn Steering) -> Self {
        let pilot = |spec: &'a VehicleSpec| Pilot {
            spec,
            body: Body { pos_m: spec.pos_m.into(), vel_mps: spec.vel_mps.into() },
            noise: Noise::new(encounter.noise, encounter.seed, spec.id, encounter.r_s_m),
            peers: PeerTable::new(),
            counters: Counters::default(),
            inbox: Vec::new(),
            command_mps: spec.vel_mps.into(),
            arrived_s: None,
        };
        let pilots: Vec<Pilot<'a>> = encounter.vehicles.iter().map(pilot).collect();
        let least_m = vec![f64::INFINITY; pilots.len() * pilots.len()];
        Self { encounter, steering, pilots, least_m }
    }

    fn run(&mut self, watch: &mut Watch<'_>) {
        let encounter = self.encounter;
        let steps = (encounter.duration_s / encounter.dt_s).ceil() as u64;
        let period_s = STEP_US as f64 * 1e-6;
        let (mut decisions, mut shares) = (0u64, 0u64);
        for step in 0..=steps {
            let now_s = step as f64 * encounter.dt_s;
            self.mislead();
            if now_s + 1e-9 >= shares as f64 * encounter.share_period_s {
                self.share(now_s, shares == 0);
                shares += 1;
            }
            if now_s + 1e-9 >= decisions as f64 * period_s {
                self.decide(now_s);
                decisions += 1;
            }
            let places: Vec<(u16, V3)> =
                self.pilots.iter().map(|pilot| (pilot.spec.id, pilot.body.pos_m)).collect();
            watch(now_s, &places);
            if step < steps {
                self.advance((step + 1) as f64 * encounter.dt_s);
            }
            if self.pilots.iter().all(|pilot| pilot.arrived_s.is_some()) && self.at_rest() {
                break;
            }
        }
    }

    /// Whether nobody moves any more: nothing can happen after that.
    fn at_rest(&self) -> bool {
        self.pilots.iter().all(|pilot| pilot.body.vel_mps.norm() < 0.05)
    }

    /// Tells noise that depends on it who is nearest to whom.
    fn mislead(&mut self) {
        if self.encounter.noise == NoiseModel::Uniform {
            return;
        }
        let places_m: Vec<V3> = self.pilots.iter().map(|pilot| pilot.body.pos_m).collect();
        for (index, pilot) in self.pilots.iter_mut().enumerate() {
            let others = places_m.iter().enumerate().filter(|&(other, _)| other != index);
            let ways_m = others.map(|(_, other_m)| places_m[index] - other_m);
            pilot.noise.nearest(ways_m.min_by(|a, b| a.norm().total_cmp(&b.norm())));
        }
    }

    /// Everybody tells everybody. The first states are known at once.
    fn share(&mut self, now_s: f64, first: bool) {
        let encounter = self.encounter;
        for sender in 0..self.pilots.len() {
            let pilot = &mut self.pilots[sender];
            let pos_m = pilot.noise.shared_position(pilot.body.pos_m);
            let vel_mps = pilot.noise.velocity(pilot.body.vel_mps);
            let state = SharedState {
                time: time(now_s),
                pos: PosEnuMm(pos_m.map(|m| (m * 1e3).round() as i32).into()),
                vel: VelEnuMmps(vel_mps.map(|mps| (mps * 1e3).round() as i16).into()),
                error_radius_mm: (encounter.declared_m() * 1e3).round() as u16,
                manner: pilot.spec.manner(),
            };
            let told = PeerState { drone: DroneId(pilot.spec.id), state };
            for receiver in 0..self.pilots.len() {
                if receiver == sender {
                    continue;
                }
                let lost = self.pilots[sender].noise.unit() < encounter.share_loss;
                if first || !lost {
                    let usable_s = if first { now_s } else { now_s + encounter.share_delay_s };
                    self.pilots[receiver].inbox.push(Packet { usable_s, state: told });
                }
            }
        }
    }

    fn decide(&mut self, now_s: f64) {
        for pilot in &mut self.pilots {
            pilot.decide(now_s, self.encounter, self.steering);
        }
    }

    fn advance(&mut self, then_s: f64) {
        let encounter = self.encounter;
        let ability = Ability { accel_mps2: encounter.max_accel_mps2, speed_mps: encounter.max_speed_mps };
        let before: Vec<V3> = self.pilots.iter().map(|pilot| pilot.body.pos_m).collect();
        for pilot in &mut self.pilots {
            pilot.body.step(pilot.command_mps, ability, encounter.dt_s);
            let way_m = (pilot.body.pos_m - V3::from(pilot.spec.goal_m)).norm();
            if way_m <= ARRIVED_M && pilot.arrived_s.is_none() {
                pilot.arrived_s = Some(then_s);
            }
        }
        let count = self.pilots.len();
        for a in 0..count {
            for b in a + 1..count {
                if self.pilots[a].spec.cooperative || self.pilots[b].spec.cooperative {
                    let after = [self.pilots[a].body.pos_m, self.pilots[b].body.pos_m];
                    let least_m = &mut self.least_m[a * count + b];
                    *least_m = least_m.min(least_distance_m([before[a], before[b]], after));
                }
            }
        }
    }

    fn outcome(self) -> Outcome {
        let met: Vec<f64> = self.least_m.iter().copied().filter(|m| m.is_finite()).collect();
        let arrival_s: Vec<Option<f64>> = self.pilots.iter().map(|pilot| pilot.arrived_s).collect();
        let overheads: Vec<f64> = (self.encounter.vehicles.iter().zip(&arrival_s))
            .filter(|(spec, _)| spec.cooperative)
            .filter_map(|(spec, arrival_s)| Some((*arrival_s)? / alone_s(self.encounter, spec)? - 1.0))
            .collect();
        Outcome {
            min_separation_m: met.iter().copied().reduce(f64::min),
            violations: met.iter().filter(|&&m| m < self.encounter.d_safe_m).count(),
            arrival_s,
            overhead_fraction: overheads.iter().sum::<f64>() / overheads.len().max(1) as f64,
        }
    }
}

/// How long a vehicle takes with nobody about, and knowing where it is.
fn alone_s(encounter: &Encounter, spec: &VehicleSpec) -> Option<f64> {
    let alone = Encounter { vehicles: vec![spec.clone()], r_s_m: 0.0, ..encounter.clone() };
    let mut flight = Flight::new(&alone, &Avoidance::Off);
    flight.run(&mut |_, _| {});
    flight.pilots[0].arrived_s.filter(|&s| s > 0.0)
}

impl Pilot<'_> {
    fn decide(&mut self, now_s: f64, encounter: &Encounter, steering: &dyn Steering) {
        let now = time(now_s);
        let pos_m = self.noise.position(self.body.pos_m);
        let vel_mps = self.noise.velocity(self.body.vel_mps);
        let own = Mover { pos_enu_m: single(pos_m), vel_enu_mps: single(vel_mps) };
        let (peers, counters) = (&mut self.peers, &mut self.counters);
        self.inbox.retain(|packet| {
            let usable = packet.usable_s <= now_s + 1e-9;
            if usable {
                peers.update(&packet.state, &own.pos_enu_m, counters);
            }
            !usable
        });
        let cruise_mps = self.spec.cruise_mps(encounter.max_speed_mps);
        let goal = single(self.spec.goal_m.into());
        let wanted_mps = goto::velocity(&own.pos_enu_m, &goal, cruise_mps as f32, VERTICAL_MPS as f32);
        let separation = Separation {
            d_safe_m: encounter.d_safe_m as f32,
            own_error_m: encounter.declared_m() as f32,
            max_speed_mps: encounter.max_speed_mps as f32,
            vertical: encounter.vertical,
            manner: self.spec.manner(),
            arm_m: Vec3::zeros(),
            waits: false,
        };
        let known = Knowledge { now, own, wanted_mps, peers: &self.peers, separation };
        let command = if self.spec.cooperative { steering.steer(&known) } else { wanted_mps };
        self.command_mps = command.map(f64::from);
        self.command_mps.z = self.command_mps.z.clamp(-VERTICAL_MPS, VERTICAL_MPS);
    }
}

fn time(s: f64) -> TimePs {
    TimePs((s * 1e12).round() as i64)
}

fn single(v: V3) -> Vec3 {
    v.map(|x| x as f32)
}
