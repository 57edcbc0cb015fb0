//! Whole missions to which random things happen: all from one seed each, watched second by second, and to be flown again by it.
//!
//! The missions are short: some square kilometres, six to nine drones. What must hold whatever happens is in `Watch`; what may happen
//! in [`scenario`].

use rand_core::Rng;
use skyroost_firmware::supervisor::Condition;
use skyroost_host_sim::{
    control::mission::{Happening, MissionError, Stage},
    fleet::Backend,
    geometry::V3,
    rng::{self, Stream},
    runner::{self, MissionInput, Outcome, RunError, RunOptions, Sight},
    scenario::{FaultKind, FaultTable, LossTable, PartitionTable, Scenario},
};
use skyroost_protocol::{
    message::{EventCode, FlightPhase},
    units::TimePs,
};
use std::sync::{
    Mutex,
    atomic::{AtomicBool, AtomicUsize, Ordering},
};

/// No mission takes longer, simulated seconds.
const MOST_S: f64 = 4_000.0;
/// A drone in the air that is not given up has been heard within this time, but for the time in which nobody listens.
const MOST_SILENT_S: f64 = 6.0;

/// How a mission ended.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// All that were left serve.
    Completed,
    /// It could not go on, said why, and nobody came to harm.
    EndedSafe(String),
    /// Something was not as it must be.
    Failed {
        /// What.
        invariant: String,
        /// Simulated seconds.
        at_s: f64,
    },
}

/// A mission and how it ended.
#[derive(Clone, Debug)]
pub struct Flown {
    /// What it follows from.
    pub seed: u64,
    /// How it ended.
    pub end: End,
    /// Hash over every output of the flight code, where it came to an end.
    pub digest: Option<String>,
}

/// Seed of a mission of a campaign.
#[must_use]
pub fn seed_of(campaign: u64, mission: u64) -> u64 {
    // As JSON's numbers go: what is printed can be read back.
    rng::stream(campaign, Stream::Faults, mission).next_u64() >> 12
}

/// The mission of a seed, and what happens to it.
#[must_use]
pub fn scenario(seed: u64) -> Scenario {
    let mut chance = rng::stream(seed, Stream::Scenario, 0);
    let chance = &mut chance;
    let mut s = Scenario { name: format!("faults-{seed}"), seed, ..Scenario::default() };
    s.area.width_m = rng::uniform(chance, 600.0, 1_400.0).round();
    s.area.height_m = rng::uniform(chance, 600.0, 1_400.0).round();
    s.fleet.drones = 6 + chance.next_u32() % 4;
    s.fleet.radius_m = rng::uniform(chance, 200.0, 350.0).round();
    s.fleet.altitude_m = rng::uniform(chance, 40.0, 70.0).round();
    s.users.density_per_km2 = rng::uniform(chance, 10.0, 40.0).round();
    s.wind.mean_mps = rng::uniform(chance, 0.0, 5.0);
    s.wind.direction_deg = rng::uniform(chance, 0.0, 360.0);
    s.wind.gust_sigma_mps = rng::uniform(chance, 0.0, 1.5);
    if rng::chance(chance, 0.5) {
        s.link.loss_fraction = rng::uniform(chance, 0.0, 0.2);
        s.link.jitter_s = rng::uniform(chance, 0.0, 0.2);
        s.link.duplicate_fraction = rng::uniform(chance, 0.0, 0.1);
    }
    if rng::chance(chance, 0.3) {
        s.link.rekey_s = Some(rng::uniform(chance, 5.0, 60.0));
    }
    for _ in 0..=chance.next_u32() % 5 {
        let at_s = rng::uniform(chance, 1.0, 400.0);
        happen(&mut s, at_s, chance);
    }
    // A stream of their own, so that missions without them are what they were before there were any.
    let chance = &mut rng::stream(seed, Stream::Scenario, 1);
    if rng::chance(chance, 0.25) {
        s.users.speed_mps = rng::uniform(chance, 0.1, 0.6);
        s.users.revisit_r95_m = rng::uniform(chance, 30.0, 120.0);
    }
    if rng::chance(chance, 0.25) {
        s.link.bits_per_s = Some(rng::uniform(chance, 8_000.0, 30_000.0));
    }
    s
}

/// One more thing goes wrong, at about `at_s`.
fn happen(s: &mut Scenario, at_s: f64, chance: &mut impl Rng) {
    let drones = s.fleet.drones;
    let drone = 1 + chance.next_u32() % drones;
    let mut fault = |kind, drone, for_s| s.faults.push(FaultTable { kind, drone, at_s, for_s });
    match chance.next_u32() % 9 {
        0 => {
            if s.losses.iter().all(|loss| loss.drone != drone) {
                s.losses.push(LossTable { drone, at_s });
            }
        }
        1 => s.partitions.push(PartitionTable {
            drones: if rng::chance(chance, 0.3) { Vec::new() } else { vec![drone, 1 + drone % drones] },
            from_s: at_s,
            until_s: at_s + rng::uniform(chance, 1.0, 120.0),
        }),
        2 => fault(FaultKind::ClockJump, Some(drone), 0.0),
        3 => fault(FaultKind::CapturesStuck, Some(drone), rng::uniform(chance, 10.0, 200.0)),
        4 => fault(FaultKind::NavigationNan, Some(drone), rng::uniform(chance, 0.1, 3.0)),
        5 => fault(FaultKind::BoardReset, Some(drone), rng::uniform(chance, 0.2, 3.0)),
        6 => fault(FaultKind::Attack, Some(drone), rng::uniform(chance, 20.0, 300.0)),
        7 => {
            s.link.burst_every_s = Some(rng::uniform(chance, 20.0, 120.0));
            s.link.burst_s = rng::uniform(chance, 0.1, 1.0);
        }
        _ => fault(FaultKind::ControlKilled, None, rng::uniform(chance, 0.5, 8.0)),
    }
}

/// What is held against what was, second by second.
#[derive(Default)]
struct Watch {
    users: usize,
    occasions: usize,
    /// When the control center was last away, seconds.
    away_s: f64,
    /// Stage and events told so far and when, where they are told.
    told: Option<(Option<Stage>, usize, f64)>,
}

impl Watch {
    /// Tells what has happened since it was last told.
    fn tell(&mut self, sight: &Sight<'_>) {
        let Some((stage, events, told_s)) = &mut self.told else { return };
        let news = sight.control.events().len() != *events || *stage != Some(sight.control.stage());
        if news {
            *told_s = sight.t_s;
        } else if sight.t_s >= *told_s + 60.0 {
            *told_s = sight.t_s;
            let place =
                |(index, at): (usize, &V3)| format!("{}: {:.0} {:.0} {:.1}", index + 1, at.x, at.y, at.z);
            let places: Vec<String> = sight.positions_m.iter().enumerate().map(place).collect();
            println!("{:8.2} s  nothing new, drones at {} m", sight.t_s, places.join(", "));
        }
        for event in sight.control.events().get(*events..).unwrap_or_default() {
            println!(
                "{:8.2} s  drone {:2}  {}",
                event.time.0 as f64 * 1e-12,
                event.drone.0,
                said(&event.what)
            );
        }
        *events = sight.control.events().len();
        if stage.replace(sight.control.stage()) != Some(sight.control.stage()) {
            println!("{:8.2} s  {}", sight.t_s, sight.control.stage().name());
        }
    }

    fn look(&mut self, sight: &Sight<'_>, partitions: &[PartitionTable]) -> Result<(), String> {
        let Sight { t_s, control, .. } = *sight;
        self.tell(sight);
        if sight.violations > 0 {
            return Err(format!("separation: drones came as near as {:?} m", sight.least_separation_m));
        }
        if sight.within_fence_m.is_some_and(|within_m| within_m < 0.0) {
            return Err("geofence: a drone crossed the fence".to_owned());
        }
        if let Some(attack) = sight.attack.filter(|it| it.believed_down + it.believed_up > 0) {
            return Err(format!("forgery: {attack:?}"));
        }
        if !sight.control_is_alive {
            self.away_s = t_s;
            return Ok(());
        }
        let (users, occasions) = (control.users_heard(), control.occasions().len());
        if users < self.users || occasions < self.occasions {
            return Err(format!(
                "located users: {} users of {} occasions became {users} of {occasions}",
                self.users, self.occasions
            ));
        }
        (self.users, self.occasions) = (users, occasions);
        let silent_s = control.longest_silence(TimePs((t_s * 1e12) as i64)).0 as f64 * 1e-12;
        let is_cut = partitions.iter().any(|it| it.from_s - 1.0 <= t_s && t_s <= it.until_s + MOST_SILENT_S);
        if silent_s > MOST_SILENT_S && t_s > self.away_s + MOST_SILENT_S && !is_cut {
            return Err(format!(
                "accounts: a drone in the air was silent for {silent_s:.1} s and is not lost"
            ));
        }
        if t_s > MOST_S {
            return Err(format!("progress: still in the stage '{}'", control.stage().name()));
        }
        Ok(())
    }
}

/// An event for people.
fn said(what: &Happening) -> String {
    match what {
        Happening::Said { code: EventCode::PhaseEntered, value } => {
            format!("{:?}", FlightPhase::numbered(*value))
        }
        Happening::Said { code, value } => {
            let name = Condition::numbered(*value).map_or("", Condition::name);
            format!("{code:?} {value} {name}")
        }
        other => format!("{other:?}"),
    }
}

/// Flies the mission of a seed, telling what happens.
///
/// # Panics
/// When the flight code or the control center does.
#[must_use]
pub fn fly_and_tell(seed: u64) -> Flown {
    fly_watched(seed, Watch { told: Some((None, 0, 0.0)), ..Watch::default() })
}

/// Flies the mission of a seed.
///
/// # Panics
/// When the flight code or the control center does.
#[must_use]
pub fn fly(seed: u64) -> Flown {
    fly_watched(seed, Watch::default())
}

fn fly_watched(seed: u64, watch: Watch) -> Flown {
    let scenario = scenario(seed);
    let partitions = scenario.partitions.clone();
    let watch = Mutex::new(watch);
    let last = Mutex::new(Stage::Connect);
    let witness = |sight: &Sight<'_>| {
        *last.lock().expect("nobody panics with it") = sight.control.stage();
        watch.lock().expect("nobody panics with it").look(sight, &partitions)
    };
    let cancel = AtomicBool::new(false);
    let options =
        RunOptions { witness: Some(&witness), ..RunOptions::new(1, Backend::InProc, &cancel, &|_| {}) };
    let flown = MissionInput::of_rectangle(scenario).map_err(RunError::from);
    let flown = flown.and_then(|input| runner::fly(&input, &options));
    let digest = flown.as_ref().ok().map(|outcome| outcome.summary.digest.clone());
    let end = match flown {
        Ok(outcome) => judged(&outcome),
        Err(RunError::Broken { invariant, at_s }) => End::Failed { invariant, at_s },
        Err(RunError::Ended(reason @ MissionError::NobodyLeft)) => End::EndedSafe(reason.to_string()),
        Err(other) => {
            let stage = last.lock().expect("nobody panics with it").name();
            End::Failed { invariant: format!("progress: in the stage '{stage}': {other}"), at_s: MOST_S }
        }
    };
    Flown { seed, end, digest }
}

/// What must hold in the end.
fn judged(outcome: &Outcome) -> End {
    let summary = &outcome.summary;
    let failed = |invariant: String| End::Failed { invariant, at_s: summary.timing.simulated_s };
    if summary.safety.violations > 0 {
        return failed(format!("separation: {:?} m", summary.safety.min_separation_m));
    }
    let gave_up = summary.sweep.replans.iter().any(|replan| replan.fleets == 0);
    // A formation whose mates do not hear each other's shared states for a while bends by metres, and leaves slivers.
    if summary.sweep.coverage_fraction < 0.998 {
        let covered = summary.sweep.coverage_fraction;
        if gave_up {
            return End::EndedSafe(format!("too few drones for a fleet, {:.1} % covered", 100.0 * covered));
        }
        return failed(format!("coverage: {covered} of the area, and nobody said why"));
    }
    End::Completed
}

/// Flies the missions of a campaign on all cores; tells `done` of each as it ends. The answer is in the order of the missions.
///
/// # Panics
/// When a mission does.
#[must_use]
pub fn campaign(missions: u64, seed: u64, done: &(dyn Fn(usize, &Flown) + Sync)) -> Vec<Flown> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let (next, ended) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let flown = Mutex::new(vec![None; missions as usize]);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let mission = next.fetch_add(1, Ordering::Relaxed);
                    if mission as u64 >= missions {
                        return;
                    }
                    let one = fly(seed_of(seed, mission as u64));
                    done(1 + ended.fetch_add(1, Ordering::Relaxed), &one);
                    flown.lock().expect("nobody panics with it")[mission] = Some(one);
                }
            });
        }
    });
    let flown = flown.into_inner().expect("nobody panics with it");
    flown.into_iter().map(|one| one.expect("every mission ends")).collect()
}

/// The command that flies a mission again.
#[must_use]
pub fn replay(seed: u64) -> String {
    format!("cargo xtask faults --replay {seed}")
}
