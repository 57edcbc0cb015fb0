//! Flies a mission: the world, the flight code and the control center in step.
//!
//! Time goes in windows. At the start of each the control center takes in what has arrived and sends what it has to
//! say, every two steps of the window; then every island of drones (a fleet, or a reserve alone) runs through the
//! window on its own, on whatever core is free. No frame is faster than its link's least delay, which is what allows to look
//! ahead: nothing that the control center or another island does within a window depends on what an island does in it. So
//! the bytes that come out depend neither on the length of a window nor on the number of threads.

mod clear;
mod crew;
mod digest;
mod drone;
mod faults;
mod flights;
pub mod formation;
mod input;
mod island;
mod judge;
mod links;
mod search;
mod setup;
mod space;
mod survival;
mod watch;

pub use input::{
    InputError, JournalOptions, MissionArea, MissionInput, MissionKeys, Outcome, Progress, RunError,
    RunOptions, Sight, Witness,
};
pub use search::random_search;

use crate::{
    control::mission::{ControlCenter, Happening, MissionError, OperatorEvent, Stage},
    fleet::{BoardError, BoardReport, Hangar},
    geometry::{V2, V3},
    recording::{DroneRecord, EventRecord, PhaseRecord, TrackSample},
    report::summary::AttackSummary,
    scenario::FaultKind,
    world::{
        link::LinkCounters,
        walkers::{STRIDE_S, Walkers},
    },
};
use clear::Clearance;
use crew::{Crew, Window};
use digest::Digest;
use island::{Island, IslandTimes};
use links::Outbox;
use setup::Setup;
use skyroost_firmware::{STEP_US, counters::Counters, supervisor::Condition};
use skyroost_protocol::units::{DroneId, TimePs};
use std::{
    collections::BTreeSet,
    sync::atomic::Ordering,
    time::{Duration, Instant},
};
use survival::{Kill, Survival};
use watch::{FleetWatch, Separation};

/// Steps between two words of the control center: 40 ms.
const CONTROL_STEPS: u64 = 2;
/// Most words of the control center in a window. The longer a window, the more steps a drone flies while all that it
/// consists of is in the cache; progress and the end of a mission are looked at once a window.
const MOST_WORDS: u64 = 2;
/// The formation is measured once in so many steps: every 0.12 s, half the lag of an attitude.
const FORMATION_STEPS: u64 = 6;
/// Positions are recorded once in so many steps: every second.
const TRACK_STEPS: u64 = 50;
/// Time flown on after every drone serves, seconds.
const SERVE_FOR_S: f64 = 2.0;

/// Flies the mission.
///
/// # Errors
/// As [`RunError`] says; nothing is written in any case.
pub fn fly(input: &MissionInput, options: &RunOptions<'_>) -> Result<Outcome, RunError> {
    let started = Instant::now();
    let mut setup = Setup::new(input)?;
    let killed = input.scenario.faults.iter().filter(|fault| fault.kind == FaultKind::ControlKilled);
    let kills = killed.map(|fault| Kill::new(fault.at_s, fault.for_s)).collect();
    let survival = Survival::new(&options.journal, kills, &mut setup.plan)?;
    let hangar = options.backend.open(setup.plan.drones.len())?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads)
        .build()
        .map_err(|error| RunError::Link(format!("no threads to run on: {error}")))?;
    pool.install(|| {
        // Islands that wait for boards of their own wait side by side.
        let remote = if options.backend.is_remote() { setup.islands() } else { 1 };
        let mut flight = Flight::new(input, &setup, &hangar, rayon::current_num_threads().max(remote))?;
        flight.run(input, &setup, survival, options)?;
        flight.reports = flight.board_reports()?;
        let (simulated_s, shares, boards) = (flight.now_s(), flight.shares(), flight.reports.clone());
        let mut outcome = judge::outcome(input, &setup, options.backend.name(), flight)?;
        (outcome.shares, outcome.boards) = (shares, boards);
        outcome.finish(&input.scenario, simulated_s, started.elapsed());
        Ok(outcome)
    })
}

/// A flight in progress and what was seen of it.
struct Flight {
    /// The first step of the window.
    step: u64,
    window_steps: u64,
    control: ControlCenter,
    islands: Vec<Island>,
    crew: Crew,
    /// Users on foot, if they are.
    walkers: Option<Walkers>,
    /// Where users truly were when they were located last, and when that was.
    located_m: Option<(TimePs, Vec<V2>)>,
    separation: Separation,
    clearance: Clearance,
    /// Drones whose distances nobody claims in this window, by id.
    excused: Vec<bool>,
    /// The fleets of all plans so far; those of the last one from `flying` on.
    fleets: Vec<FleetWatch>,
    flying: usize,
    control_is_alive: bool,
    /// Which plan the islands are made for.
    revision: u16,
    tracks: Vec<DroneRecord>,
    phases: Vec<PhaseRecord>,
    /// Positions of all drones by id, at the end of each step of the window.
    window_m: Vec<Vec<V3>>,
    outbox: Outbox,
    /// Island and place in it of each drone, by id.
    place_of: Vec<(usize, usize)>,
    /// How the boards fared, by id; after the flight.
    reports: Vec<BoardReport>,
    /// Wall-clock time of timed windows.
    control_time: Duration,
    watch_time: Duration,
}

/// When a step begins, seconds.
fn step_s(step: u64) -> f64 {
    (step as i64 * STEP_US) as f64 * 1e-6
}

/// Steps of a window with links that take so long at least: what the control center hears at its last word of the window must
/// have been sent before the window.
fn window_steps(delay_s: f64) -> u64 {
    let period_s = CONTROL_STEPS as f64 * step_s(1);
    let ahead = (delay_s / period_s - 1e-6).max(0.0) as u64;
    (1 + ahead).min(MOST_WORDS) * CONTROL_STEPS
}

/// One window in so many is timed; odd, so that it takes turns with what happens every so many windows.
const TIMED_WINDOW: u64 = 17;

impl Flight {
    fn new(input: &MissionInput, setup: &Setup, hangar: &Hangar, threads: usize) -> Result<Self, BoardError> {
        let scenario = &input.scenario;
        let islands =
            setup::islands(scenario, &setup.plan.drones, setup.plan.fleets.len(), &setup.plan.keys, hangar)?;
        let mut place_of = vec![(0, 0); setup.plan.drones.len()];
        for (index, island) in islands.iter().enumerate() {
            for (member, drone) in island.drones.iter().enumerate() {
                place_of[usize::from(drone.id.0) - 1] = (index, member);
            }
        }
        let pads_m = setup::pads_m(&setup.plan);
        let tracks = setup.plan.drones.iter().map(|d| DroneRecord {
            id: d.id.0,
            fleet: d.fleet.map(|(fleet, _)| fleet as u16),
            track: Vec::new(),
        });
        let window_steps = window_steps(scenario.link.delay_s);
        Ok(Self {
            step: 0,
            window_steps,
            control: ControlCenter::new(setup.plan.clone()),
            crew: Crew::new(threads, islands.len(), setup::surroundings(scenario, &setup.users)),
            walkers: setup::walkers(scenario, &setup.users),
            located_m: None,
            islands,
            separation: Separation::new(&pads_m, scenario.fleet.d_safe_m, 1.2 * scenario.fleet.speed_mps),
            excused: vec![false; pads_m.len()],
            clearance: Clearance::new(pads_m.len(), 1.2 * scenario.fleet.speed_mps),
            fleets: setup::fleet_watches(&setup.plan),
            flying: 0,
            control_is_alive: true,
            revision: 0,
            tracks: tracks.collect(),
            phases: Vec::new(),
            window_m: vec![pads_m.clone(); window_steps as usize],
            outbox: Outbox::default(),
            place_of,
            reports: Vec::new(),
            control_time: Duration::ZERO,
            watch_time: Duration::ZERO,
        })
    }

    fn now_s(&self) -> f64 {
        step_s(self.step)
    }

    /// Flies until every drone serves, or to the scenario's cut-off.
    fn run(
        &mut self,
        input: &MissionInput,
        setup: &Setup,
        mut survival: Survival,
        options: &RunOptions<'_>,
    ) -> Result<(), RunError> {
        let cut_off_s = input.scenario.mission.duration_s.unwrap_or(f64::INFINITY);
        let expected_s = self.expected_s();
        let mut serving_since_s = None;
        self.note_phase(0);
        self.record_tracks(0, 0);
        while self.now_s() < cut_off_s {
            let timed = (self.step / self.window_steps).is_multiple_of(TIMED_WINDOW);
            let clock = timed.then(Instant::now);
            for at in (self.step..self.step + self.window_steps).step_by(CONTROL_STEPS as usize) {
                let stage = self.control.stage();
                let now = TimePs::from_us(at as i64 * STEP_US);
                self.control_is_alive = survival.is_alive(now, &mut self.control, &setup.plan)?;
                if !self.control_is_alive {
                    continue; // what drones say meanwhile nobody hears
                }
                self.run_control(at, &mut survival)?;
                if self.control.stage() != stage {
                    self.note_phase(at);
                }
            }
            if self.control.revision() != self.revision {
                self.regroup(input);
            }
            self.note_located();
            self.walk(input);
            let controlled = clock.map(|clock| clock.elapsed());
            self.run_islands(timed)?;
            let flown = clock.map(|clock| clock.elapsed());
            self.watch();
            if let (Some(clock), Some(controlled), Some(flown)) = (clock, controlled, flown) {
                self.control_time += controlled;
                self.watch_time += clock.elapsed() - flown;
            }
            if self.step % TRACK_STEPS < self.window_steps {
                let fraction = (self.now_s() / expected_s).min(0.99);
                let phase = self.control.stage().name();
                (options.progress)(Progress { phase, simulated_s: self.now_s(), fraction });
                self.ask(options)?;
                if options.cancel.load(Ordering::Relaxed) {
                    return Err(RunError::Interrupted);
                }
            }
            if self.control.stage() == Stage::Serve
                && self.now_s() - *serving_since_s.get_or_insert(self.now_s()) >= SERVE_FOR_S
            {
                break;
            }
        }
        Ok(())
    }

    /// Users go on.
    fn walk(&mut self, input: &MissionInput) {
        let Some(walkers) = &mut self.walkers else { return };
        let next = self.crew.around().at.after(TimePs((STRIDE_S * 1e12) as i64));
        if self.step == 0 {
            let radius_m = input.scenario.fleet.radius_m;
            self.crew.surround(setup::walked(self.crew.around(), walkers, TimePs(0), radius_m));
        } else if TimePs::from_us(self.step as i64 * STEP_US) >= next {
            walkers.advance();
            let radius_m = input.scenario.fleet.radius_m;
            self.crew.surround(setup::walked(self.crew.around(), walkers, next, radius_m));
        }
    }

    /// Notes where users are when they are located: that is what their places are held against.
    fn note_located(&mut self) {
        let at = self.control.located_at();
        if let Some(at) = at.filter(|at| self.located_m.as_ref().is_none_or(|(before, _)| before != at)) {
            self.located_m = Some((at, self.users_m()));
        }
    }

    /// Where users truly are.
    fn users_m(&self) -> Vec<V2> {
        self.crew.around().user_pos_m.iter().map(nalgebra::Matrix::xy).collect()
    }

    /// How long the mission will take, roughly: for the progress display only.
    fn expected_s(&self) -> f64 {
        let plan = self.control.plan();
        let longest_m = plan.longest_m();
        plan.altitude_m / 2.5 + 1.02 * longest_m / plan.speed_mps + 0.05 * longest_m / plan.speed_mps + 60.0
    }

    /// What the control center takes in and says at a step of the window.
    fn run_control(&mut self, step: u64, survival: &mut Survival) -> Result<(), MissionError> {
        let Self { control, islands, outbox, place_of, .. } = self;
        outbox.exchange(step * STEP_US as u64, &mut survival.journalled(control), islands, place_of)
    }

    /// Asks the witness, if there is one.
    fn ask(&self, options: &RunOptions<'_>) -> Result<(), RunError> {
        let Some(witness) = options.witness else { return Ok(()) };
        let mut dead = vec![false; self.place_of.len()];
        for drone in self.islands.iter().flat_map(|island| &island.drones) {
            dead[usize::from(drone.id.0) - 1] = drone.is_lost();
        }
        let sight = Sight {
            t_s: self.now_s(),
            control: &self.control,
            control_is_alive: self.control_is_alive,
            violations: self.separation.violations(),
            least_separation_m: self.separation.least_m(),
            within_fence_m: self.clearance.within_fence_m(),
            attack: self.attack(),
            positions_m: self.window_m.last().map_or(&[], Vec::as_slice),
            dead: &dead,
        };
        witness(&sight).map_err(|invariant| RunError::Broken { invariant, at_s: self.now_s() })
    }

    /// The control center has put the drones together anew: so are their direct links, and what is watched.
    fn regroup(&mut self, input: &MissionInput) {
        self.revision = self.control.revision();
        let plan = self.control.plan();
        let islands = setup::regrouped(&input.scenario, plan, std::mem::take(&mut self.islands));
        for (index, island) in islands.iter().enumerate() {
            for (member, drone) in island.drones.iter().enumerate() {
                self.place_of[usize::from(drone.id.0) - 1] = (index, member);
            }
        }
        self.islands = islands;
        self.flying = self.fleets.len();
        self.fleets.extend(setup::fleet_watches(plan));
    }

    fn run_islands(&mut self, timed: bool) -> Result<(), RunError> {
        let window = Window { first: self.step, steps: self.window_steps, timed };
        self.crew.fly(window, &mut self.islands)?;
        self.step += self.window_steps;
        Ok(())
    }

    /// Measures the window just flown.
    fn watch(&mut self) {
        for island in &self.islands {
            let members = island.drones.len();
            for (row, position_m) in island.positions_m.iter().enumerate() {
                let drone = usize::from(island.drones[row % members].id.0) - 1;
                self.window_m[row / members][drone] = *position_m;
            }
        }
        for drone in self.islands.iter().flat_map(|island| &island.drones) {
            let (index, excused) = (usize::from(drone.id.0) - 1, drone.is_excused());
            self.separation.excuse(index, excused);
            self.excused[index] = excused;
        }
        let started_s = self.control.sweep_started().map_or(f64::INFINITY, |at| at.0 as f64 * 1e-12);
        let sweeping = self.control.stage() == Stage::Sweep;
        for row in 0..self.window_m.len() {
            // A row is the end of its step.
            let step = self.step - self.window_steps + row as u64 + 1;
            let t_s = step_s(step);
            let positions_m = &self.window_m[row];
            self.separation.moved(t_s, positions_m);
            self.clearance
                .moved(t_s, positions_m, &self.control.plan().airspace, |drone| self.excused[drone]);
            if sweeping && step.is_multiple_of(FORMATION_STEPS) && t_s > started_s {
                self.watch_formations(t_s, row);
            }
            if step.is_multiple_of(TRACK_STEPS) {
                self.record_tracks(step, row);
            }
        }
    }

    /// Measures all fleets that are whole; two drones are no triangle: what they fly over is not covered.
    fn watch_formations(&mut self, t_s: f64, row: usize) {
        let Self { fleets, flying, control, islands, place_of, window_m, .. } = self;
        let is_dead = |id: &DroneId| {
            let (island, member) = place_of[usize::from(id.0) - 1];
            islands[island].drones[member].is_lost()
        };
        let avoids = |id: &DroneId| control.conditions(*id) & Condition::Avoiding.bit() != 0;
        for (index, (watch, fleet)) in fleets[*flying..].iter_mut().zip(&control.plan().fleets).enumerate() {
            if watch.has_ended() || fleet.mates.iter().any(is_dead) || !control.is_whole(index) {
                continue;
            }
            let avoiding = fleet.mates.iter().any(avoids);
            watch.sweeping(t_s, fleet.mates.map(|id| window_m[row][usize::from(id.0) - 1]), avoiding);
        }
    }

    fn note_phase(&mut self, step: u64) {
        let name = self.control.stage().name().to_owned();
        self.phases.push(PhaseRecord { t_s: step_s(step), name });
    }

    fn record_tracks(&mut self, step: u64, row: usize) {
        let t_s = step_s(step);
        for (record, position_m) in self.tracks.iter_mut().zip(&self.window_m[row]) {
            record.track.push(TrackSample { t_s, pos_enu_m: (*position_m).into() });
        }
    }

    /// What drones reported, for the recording.
    fn events(&self) -> Vec<EventRecord> {
        let text = |event: &OperatorEvent| EventRecord {
            t_s: event.time.0 as f64 * 1e-12,
            drone: Some(event.drone.0),
            text: match event.what {
                Happening::Said { code, value } => judge::event_text(code, value),
                Happening::Lost => "lost: not heard any more".to_owned(),
                Happening::HeardAgain => "heard again".to_owned(),
                Happening::Resumed => "the control center is back".to_owned(),
                Happening::Refused { command } => format!("refused {command}"),
            },
        };
        let mut events: Vec<EventRecord> = self.control.events().iter().map(text).collect();
        events.sort_by(|a, b| a.t_s.total_cmp(&b.t_s).then(a.drone.cmp(&b.drone)));
        events
    }

    /// Counters of all links between control center and drones, both ways.
    fn link_counters(&self) -> LinkCounters {
        let mut sum = LinkCounters::default();
        for drone in self.islands.iter().flat_map(|island| &island.drones) {
            sum.add(drone.uplink.counters());
            sum.add(drone.downlink.counters());
        }
        sum
    }

    /// Asks every board how it fared.
    fn board_reports(&mut self) -> Result<Vec<BoardReport>, BoardError> {
        let drones = self.islands.iter_mut().flat_map(|island| &mut island.drones);
        let mut reports = drones
            .map(|drone| Ok((drone.id, drone.board.report()?)))
            .collect::<Result<Vec<_>, BoardError>>()?;
        reports.sort_by_key(|(id, _)| *id);
        Ok(reports.into_iter().map(|(_, report)| report).collect())
    }

    /// Frames that the flight code could not read, and those that were not sealed as they have to be.
    fn refused_on_board(&self) -> [u64; 2] {
        let sum = |count: fn(&Counters) -> u32| {
            self.reports.iter().map(|report| u64::from(count(&report.counters))).sum()
        };
        [sum(|counters| counters.frames_rejected), sum(|counters| counters.frames_forged)]
    }

    /// What became of an attacker's frames.
    fn attack(&self) -> Option<AttackSummary> {
        let mut sum = AttackSummary { believed_up: self.outbox.believed, ..AttackSummary::default() };
        for drone in self.islands.iter().flat_map(|island| &island.drones) {
            let ([down, up], believed) = drone.attacked();
            sum.injected_down += down;
            sum.injected_up += up;
            sum.believed_down += believed;
        }
        (sum.injected_down + sum.injected_up > 0).then_some(sum)
    }

    /// Captures that came late, by occasion and drone.
    fn late(&self) -> BTreeSet<(u32, u16)> {
        self.islands.iter().flat_map(|island| &island.late).map(|(o, d)| (o.0, d.0)).collect()
    }

    /// Where the time of the flight went, as shares of the timed windows.
    fn shares(&self) -> Vec<(&'static str, f64)> {
        let islands = |part: fn(&IslandTimes) -> Duration| self.islands.iter().map(|i| part(&i.times)).sum();
        let parts: [(&'static str, Duration); 5] = [
            ("world", islands(|t| t.world)),
            ("agents", islands(|t| t.agents)),
            ("link", islands(|t| t.links)),
            ("control center", self.control_time),
            ("measuring", self.watch_time),
        ];
        let total: Duration = parts.iter().map(|(_, time)| time).sum();
        let share = |time: Duration| time.as_secs_f64() / total.as_secs_f64().max(f64::MIN_POSITIVE);
        parts.map(|(name, time)| (name, share(time))).to_vec()
    }

    /// Digest over all drones in order of id.
    fn digest(&self) -> String {
        let mut drones: Vec<_> = self.islands.iter().flat_map(|island| &island.drones).collect();
        drones.sort_by_key(|drone| drone.id);
        Digest::combined(drones.iter().map(|drone| &drone.digest))
    }
}
