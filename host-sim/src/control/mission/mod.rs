//! The control center as a state machine: frames in, frames out, no clock and no world of its own.
//!
//! Connect, upload, take off, assemble, sweep, locate, place, deploy, refine, serve. Whatever is commanded is repeated
//! until acknowledged ([`drone`]); measurements are not repeated, as the next occasion is a second away.

pub(in crate::control) mod asking;
mod assembly;
mod deploy;
pub mod drone;
mod goals;
pub mod plan;
mod quality;
mod refine;
pub(in crate::control) mod relaying;
pub mod replan;
mod revisit;
#[cfg(test)]
mod simple;
mod stages;
mod watch;

use crate::{
    control::{
        localize::{
            Capture, Localization, LocalizeError, MAX_CAPTURES, Occasion, Running, RunningFix, localize,
        },
        place::{PlaceError, Placement},
        srs_schedule::{FleetSchedule, Scheduled},
    },
    geometry::{V2, V3},
};
use asking::{Again, Asking};
use assembly::Assembling;
use drone::{DroneFailure, DroneLink, HeldBack, Refusals, Traffic};
pub use goals::GoalConflict;
use plan::{MissionPlan, PlannedFleet};
use refine::Refinement;
pub use relaying::RELAYED_NEIGHBOURS;
use relaying::Relaying;
use replan::Progress;
pub use replan::Replan;
use skyroost_protocol::{
    message::{AckStatus, FlightPhase, MateTdoa, TdoaCounts, TdoaEntry, TdoaFlags, Up},
    units::{DroneId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId},
};
use thiserror::Error;
pub use watch::{Happening, OperatorEvent};

/// Everything is solved for the first time after so many occasions for each fleet, and again when they have grown by as
/// many and a half: a fleet of few users is the dearest to solve for, each being tried from all sides.
const FIRST_SOLUTION: usize = 128;

/// What the control center is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Waiting for every drone's hello.
    Connect,
    /// Uploading the lanes.
    Upload,
    /// Waiting until all fleets hold above their pads.
    TakeOff,
    /// Flying from the pads into formation.
    Assemble,
    /// Flying the lanes and collecting arrival times.
    Sweep,
    /// Stopping, as a drone of a fleet is gone or somebody came back, before the rest is planned anew.
    Halt,
    /// Taking in the last reports before users are located.
    Collect,
    /// Flying to the placements.
    Deploy,
    /// Serving, and moving by metres where what is heard promises to serve more.
    Refine,
    /// Every drone is where it should be.
    Serve,
}

impl Stage {
    /// Its name, for people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Connect => "connect",
            Self::Upload => "upload",
            Self::TakeOff => "take off",
            Self::Assemble => "assemble",
            Self::Sweep => "sweep",
            Self::Halt => "stop and plan anew",
            Self::Collect => "locate and place",
            Self::Deploy => "deploy",
            Self::Refine => "refine",
            Self::Serve => "serve",
        }
    }
}

/// Why a mission cannot go on.
#[derive(Debug, Error)]
pub enum MissionError {
    /// A drone does not do what it is told.
    #[error(transparent)]
    Drone(#[from] DroneFailure),
    /// A drone of a fleet left the sweep by itself: its supervisor had a reason.
    #[error("drone {drone} left the sweep: it is {phase:?}, conditions {conditions:#b}")]
    LeftSweep {
        /// Which drone.
        drone: u16,
        /// What it does instead.
        phase: FlightPhase,
        /// Its supervisor's conditions, one bit each.
        conditions: u32,
    },
    /// What the control center was told could not be written down.
    #[error("{0}")]
    Journal(String),
    /// Nobody is left to go on with.
    #[error("every drone is lost")]
    NobodyLeft,
    /// A stage took longer than it can.
    #[error("stage '{stage}' did not end within {limit_s} s: {waiting}")]
    Stuck {
        /// Which stage.
        stage: &'static str,
        /// How long it was given, seconds.
        limit_s: f64,
        /// Who is waited for.
        waiting: String,
    },
    /// Two drones cannot both be where they are wanted.
    #[error(transparent)]
    Goals(#[from] GoalConflict),
    /// A measurement that no estimator can use came through every check.
    #[error(transparent)]
    Localize(#[from] LocalizeError),
    /// A placement problem that no solver can take came out of localization.
    #[error(transparent)]
    Place(#[from] PlaceError),
}

/// What came in from the drones and could not be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ControlCounters {
    /// Frames that came from nobody known.
    pub frames_of_strangers: u64,
    /// TDOA reports of occasions that were never asked for, or of another user.
    pub tdoa_unknown: u64,
    /// TDOA reports seen before.
    pub tdoa_repeated: u64,
    /// Differences that did not fit their 32 bits.
    pub tdoa_saturated: u64,
    /// Differences that no place of the user explains: a capture behind each was left out as late.
    pub tdoa_gated: u64,
    /// Requests that no link of a fleet had room for in time, and copies of requests.
    pub held_back: HeldBack,
}

/// What a drone is for in the second stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Index of the drone in the plan.
    pub drone: usize,
    /// Where it serves; none for a drone that nobody needs and that flies home.
    pub station: Option<Station>,
}

/// Where a drone serves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// Index of the site in the placement.
    pub site: usize,
    /// Where the drone was sent last: the site, or metres from it where the refinement moved it.
    pub pos_m: V2,
}

/// The control center.
#[derive(Debug)]
pub struct ControlCenter {
    plan: MissionPlan,
    stage: Stage,
    stage_since: TimePs,
    drones: Vec<DroneLink>,
    schedules: Vec<FleetSchedule>,
    scheduled: Vec<Scheduled>,
    /// Requests that are still to be said.
    asking: Vec<Asking>,
    /// Requests that are said more than once.
    again: Vec<Again>,
    reported: Vec<bool>,
    occasions: Vec<Occasion>,
    occasion_ids: Vec<OccasionId>,
    running: Running,
    /// Occasions at which everything is solved next.
    solve_at: usize,
    relaying: Relaying,
    assembling: Assembling,
    sweep_started: Option<TimePs>,
    progress: Progress,
    localization: Localization,
    /// When users were located for the placement, which is the time that their places are as of.
    located_at: Option<TimePs>,
    placement: Option<Placement>,
    targets: Vec<Target>,
    /// Drones that the placement counts on.
    placed_for: Vec<usize>,
    /// Since when that are not those that can serve.
    misplaced_since: Option<TimePs>,
    /// Where each drone was sent last in the second stage: its goal, or a corner on the way there.
    legs: Vec<Option<V2>>,
    refinement: Option<Refinement>,
    events: Vec<OperatorEvent>,
    /// When keys are changed next.
    rekey_due: Option<TimePs>,
    counters: ControlCounters,
}

impl ControlCenter {
    /// Before the first word of any drone.
    #[must_use]
    pub fn new(plan: MissionPlan) -> Self {
        let schedule = |fleet: &PlannedFleet| FleetSchedule::new(fleet.clock_group, fleet.mates, plan.srs);
        let schedules = plan.fleets.iter().map(schedule).collect();
        let groups = plan.fleets.iter().map(|fleet| (fleet.clock_group, fleet.mates.to_vec()));
        let running = Running::new(plan.localize, groups);
        Self {
            drones: plan
                .drones
                .iter()
                .map(|d| DroneLink::new(d.id, &plan.keys, plan.link_bytes_per_s))
                .collect(),
            legs: vec![None; plan.drones.len()],
            schedules,
            running,
            solve_at: FIRST_SOLUTION * plan.fleets.len(),
            relaying: Relaying::new(plan.relay_period),
            plan,
            stage: Stage::Connect,
            stage_since: TimePs(0),
            scheduled: Vec::new(),
            asking: Vec::new(),
            again: Vec::new(),
            reported: Vec::new(),
            occasions: Vec::new(),
            occasion_ids: Vec::new(),
            assembling: Assembling::default(),
            sweep_started: None,
            progress: Progress::default(),
            localization: Localization::default(),
            located_at: None,
            placement: None,
            targets: Vec::new(),
            placed_for: Vec::new(),
            misplaced_since: None,
            refinement: None,
            events: Vec::new(),
            rekey_due: None,
            counters: ControlCounters::default(),
        }
    }

    /// What it is doing.
    #[must_use]
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// The mission.
    #[must_use]
    pub fn plan(&self) -> &MissionPlan {
        &self.plan
    }

    /// Common start of the lanes, once commanded.
    #[must_use]
    pub fn sweep_started(&self) -> Option<TimePs> {
        self.sweep_started
    }

    /// SRS occasions asked for so far; the index is the occasion's number.
    #[must_use]
    pub fn scheduled(&self) -> &[Scheduled] {
        &self.scheduled
    }

    /// Occasions reported so far, in order of arrival.
    #[must_use]
    pub fn occasions(&self) -> &[Occasion] {
        &self.occasions
    }

    /// Number of each of the [`occasions`](Self::occasions).
    #[must_use]
    pub fn occasion_ids(&self) -> &[OccasionId] {
        &self.occasion_ids
    }

    /// Where a user is by what was heard of it so far.
    #[must_use]
    pub fn running_fix(&self, user: UserId) -> Option<RunningFix> {
        self.running.fix(user)
    }

    /// Where the users are: all together by the occasions of the last solution, after the sweep by all.
    #[must_use]
    pub fn localization(&self) -> &Localization {
        &self.localization
    }

    /// When users were located for the placement; where they are is as of then.
    #[must_use]
    pub fn located_at(&self) -> Option<TimePs> {
        self.located_at
    }

    /// The placement, once planned.
    #[must_use]
    pub fn placement(&self) -> Option<&Placement> {
        self.placement.as_ref()
    }

    /// Events that drones reported and that were noticed here, in order of arrival.
    #[must_use]
    pub fn events(&self) -> &[OperatorEvent] {
        &self.events
    }

    /// What became of the captures of the users that each drone serves, by its last telemetry.
    pub fn tdoa_counts(&self) -> impl Iterator<Item = TdoaCounts> {
        self.drones.iter().filter_map(|drone| drone.telemetry).map(|telemetry| telemetry.tdoa)
    }

    /// Conditions of a drone's supervisor that are in force, one bit each, by its last telemetry.
    #[must_use]
    pub fn conditions(&self, drone: DroneId) -> u32 {
        let known = self.drones.iter().find(|known| known.id == drone).and_then(|known| known.telemetry);
        known.map_or(0, |telemetry| telemetry.conditions)
    }

    /// Frames that were not taken in, of all drones.
    #[must_use]
    pub fn refusals(&self) -> Refusals {
        let mut sum = Refusals::default();
        self.drones.iter().for_each(|drone| sum.add(drone.refusals));
        sum
    }

    /// What found no room on the links, of all drones.
    #[must_use]
    pub fn held_back(&self) -> HeldBack {
        let mut sum = self.counters.held_back;
        self.drones.iter().for_each(|drone| sum += drone.pace.held_back);
        sum
    }

    /// Bytes said and heard, of all drones.
    #[must_use]
    pub fn traffic(&self) -> Traffic {
        let mut sum = Traffic::default();
        self.drones.iter().for_each(|drone| sum += drone.pace.traffic);
        sum
    }

    /// What could not be used.
    #[must_use]
    pub fn counters(&self) -> &ControlCounters {
        &self.counters
    }

    /// Takes in a frame that came at `now` on the link of `from`.
    ///
    /// # Errors
    /// When the drone refuses a command or speaks another protocol.
    pub fn receive(
        &mut self,
        now: TimePs,
        from: DroneId,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), MissionError> {
        let Some(index) = self.drones.iter().position(|d| d.id == from) else {
            self.counters.frames_of_strangers += 1;
            return Ok(());
        };
        let message = match self.drones[index].hear(now, bytes, send) {
            Ok(Some(message)) => message,
            Ok(None) => return Ok(()),
            // Its supervisor was faster; what the drone does instead is seen by its telemetry.
            Err(DroneFailure::Refused { command, status: AckStatus::WrongPhase, .. }) => {
                let what = Happening::Refused { command };
                self.events.push(OperatorEvent { time: now, drone: from, what });
                return Ok(());
            }
            Err(failure) => return Err(failure.into()),
        };
        match message {
            Up::Attached(page) => {
                if let Some((fleet, _)) = self.plan.drones[index].fleet {
                    self.schedules[fleet].heard(from, &page);
                }
                self.heard_at_station(index, &page);
            }
            Up::Tdoa(entries) => entries.iter().for_each(|entry| self.measured(from, entry)),
            Up::Event { code, time, value } => self.said(index, time, code, value),
            Up::Telemetry(telemetry) => {
                self.conditions_are(index, telemetry.time, telemetry.conditions);
                self.came(index, now);
            }
            // What it says of itself only.
            Up::Hello { .. } | Up::CommandAck { .. } | Up::Heartbeat | Up::SharedState(_) => {}
        }
        Ok(())
    }

    /// Runs what is due at `now`: commands, relays, requests, and the next stage.
    ///
    /// # Errors
    /// When the mission cannot go on.
    pub fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), MissionError> {
        self.watch(now);
        self.change_keys(now);
        for drone in &mut self.drones {
            match drone.step(now, send) {
                Ok(()) => {}
                // Others go on without it.
                Err(DroneFailure::Unreachable { .. }) if self.plan.resweep.is_some() => {
                    drone.give_up(now);
                    self.events.push(OperatorEvent { time: now, drone: drone.id, what: Happening::Lost });
                }
                Err(failure) => return Err(failure.into()),
            }
        }
        self.relaying.step(now, &mut self.drones, send);
        if self.stage == Stage::Sweep {
            self.ask_for_srs(now, send);
            self.solve_now_and_then()?;
        }
        self.drones.iter_mut().for_each(|drone| drone.say_lanes(now, send));
        self.advance(now)
    }

    /// Goes on at `now` in a new boot, after having been killed and made again of its [journal](crate::control::journal).
    pub fn resume(&mut self, now: TimePs, boot_epoch: u16) {
        self.plan.keys = self.plan.keys.at_boot(boot_epoch);
        for drone in &mut self.drones {
            drone.resume(now, &self.plan.keys);
            self.events.push(OperatorEvent { time: now, drone: drone.id, what: Happening::Resumed });
        }
        self.ask_no_more();
        (self.rekey_due, self.misplaced_since) = (None, None);
    }

    /// Users located so far, however well.
    #[must_use]
    pub fn users_heard(&self) -> usize {
        self.running.len()
    }

    /// The longest that a drone in the air has been silent which does not count as lost.
    #[must_use]
    pub fn longest_silence(&self, now: TimePs) -> TimePs {
        let aloft = self.drones.iter().filter(|link| link.lost.is_none() && link.in_the_air());
        aloft.map(|link| link.silence(now)).max().unwrap_or_default()
    }

    /// Changes the keys of all links every so often.
    fn change_keys(&mut self, now: TimePs) {
        let Some(period) = self.plan.rekey_period else { return };
        let due = *self.rekey_due.get_or_insert(now.after(period));
        if now < due {
            return;
        }
        self.rekey_due = Some(now.after(period));
        for drone in self.drones.iter_mut().filter(|drone| drone.connected) {
            drone.rekey(self.plan.keys.fresh());
        }
    }

    /// Solves for all users and clocks together whenever the occasions have grown by a share, so that every
    /// occasion is solved for a bounded number of times, however long the sweep.
    fn solve_now_and_then(&mut self) -> Result<(), MissionError> {
        if self.occasions.len() >= self.solve_at {
            self.solve_at =
                self.occasions.len() + self.occasions.len() / 2 + FIRST_SOLUTION * self.plan.fleets.len();
            self.localization = localize(&self.occasions, &self.plan.localize)?;
            self.running.calibrate(&self.localization.clocks);
        }
        Ok(())
    }

    /// A TDOA report becomes an occasion of its user, once.
    fn measured(&mut self, serving: DroneId, entry: &TdoaEntry) {
        let number = entry.occasion.0 as usize;
        let Some(asked) = self.scheduled.get(number).filter(|s| s.user == entry.user) else {
            self.counters.tdoa_unknown += 1;
            return;
        };
        if std::mem::replace(&mut self.reported[number], true) {
            self.counters.tdoa_repeated += 1;
            return;
        }
        let sigma_ns = |sigma: ToaSigma| Some(f64::from(sigma.ps()) * 1e-3);
        let own = Capture {
            drone: serving,
            pos_enu_m: pos_m(&entry.pos).into(),
            toa_ns: 0.0,
            sigma_ns: sigma_ns(entry.sigma),
        };
        let gated = |mate: &&MateTdoa| mate.flags.contains(TdoaFlags::GATED);
        self.counters.tdoa_gated += entry.mates.iter().filter(gated).count() as u64;
        // Of a difference that cannot be, the later capture came by a detour.
        let own_is_late = entry.mates.iter().filter(gated).any(|mate| mate.tdoa.0 < 0);
        let mut captures: heapless::Vec<Capture, MAX_CAPTURES> = heapless::Vec::new();
        captures.extend((!own_is_late).then_some(own));
        for mate in &entry.mates {
            if mate.flags.contains(TdoaFlags::SATURATED) {
                self.counters.tdoa_saturated += 1;
                continue;
            }
            if gated(&mate) && mate.tdoa.0 > 0 {
                continue;
            }
            let capture = Capture {
                drone: mate.drone,
                pos_enu_m: pos_m(&mate.pos).into(),
                toa_ns: f64::from(mate.tdoa.0) * 1e-3,
                sigma_ns: sigma_ns(mate.sigma),
            };
            captures.push(capture).expect("one serving drone and two mates");
        }
        let occasion = Occasion {
            user: entry.user,
            clock_group: asked.clock_group,
            time_s: asked.at.0 as f64 * 1e-12,
            captures,
        };
        self.running.add(&occasion);
        self.occasion_ids.push(entry.occasion);
        self.occasions.push(occasion);
    }
}

/// Metres from wire millimetres.
pub(in crate::control) fn pos_m(pos: &PosEnuMm) -> V3 {
    V3::from(pos.0.map(|mm| f64::from(mm) * 1e-3))
}
