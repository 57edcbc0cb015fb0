//! The control center as a state machine: frames in, frames out, no clock and no world of its own.
//!
//! Connect, upload, take off, assemble, sweep, locate, place, deploy, refine, serve. Whatever is commanded is repeated
//! until acknowledged ([`drone`]); measurements are not repeated, as the next occasion is a second away.

mod assembly;
pub mod drone;
mod goals;
pub mod plan;
mod refine;
mod stages;
mod watch;

use crate::{
    control::{
        localize::{
            Capture, Localization, LocalizeError, MAX_CAPTURES, Occasion, Running, RunningFix, localize,
        },
        place::{PlaceError, Placement},
        relay::Relay,
        srs_schedule::{FleetSchedule, Scheduled},
    },
    geometry::{V2, V3},
};
use assembly::Assembling;
use drone::{DroneFailure, DroneLink};
pub use goals::GoalConflict;
use plan::MissionPlan;
use refine::Refinement;
use skyroost_protocol::{
    MIN_PROTOCOL_VERSION, PROTOCOL_VERSION, SCHEMA_HASH,
    codec::{Message, decode},
    message::{Down, FlightPhase, MateTdoa, PeerState, TdoaCounts, TdoaEntry, TdoaFlags, Up},
    units::{DroneId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId},
};
use thiserror::Error;
pub use watch::{Happening, OperatorEvent};

/// Neighbours whose state is relayed to each drone.
pub const RELAYED_NEIGHBOURS: usize = 32;

/// Neighbours nearer than this are relayed every time; from beyond, two drones at full speed need three
/// quarters of a minute to meet, and hear of each other every [`NEIGHBOURS_PERIOD`].
const NEAR_M: f64 = 1_000.0;
/// Every so often it is looked up anew who is near whom.
const NEIGHBOURS_PERIOD: TimePs = TimePs::from_ms(1_000);

/// Everything is solved for the first time after so many occasions, and again when they have grown by as many and a half.
const FIRST_SOLUTION: usize = 256;

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
    /// A drone speaks another protocol.
    #[error(
        "drone {drone} speaks protocol {version_min} to {version_max} with schema {schema_hash:08x}, \
         expected {PROTOCOL_VERSION} with {SCHEMA_HASH:08x}"
    )]
    Incompatible {
        /// Which drone.
        drone: u16,
        /// Its oldest version.
        version_min: u8,
        /// Its newest version.
        version_max: u8,
        /// Its schema.
        schema_hash: u32,
    },
    /// A drone of a fleet left the sweep by itself: its supervisor had a reason.
    #[error("drone {drone} left the sweep: it is {phase:?}, conditions {conditions:#b}")]
    LeftSweep {
        /// Which drone.
        drone: u16,
        /// What it does instead.
        phase: FlightPhase,
        /// Its supervisor's conditions, one bit each.
        conditions: u16,
    },
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
    /// Frames that did not decode or came from nobody known.
    pub frames_rejected: u64,
    /// Frames seen before, or too old.
    pub frames_repeated: u64,
    /// TDOA reports of occasions that were never asked for, or of another user.
    pub tdoa_unknown: u64,
    /// TDOA reports seen before.
    pub tdoa_repeated: u64,
    /// Differences that did not fit their 32 bits.
    pub tdoa_saturated: u64,
    /// Differences that no place of the user explains: a capture behind each was left out as late.
    pub tdoa_gated: u64,
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
    reported: Vec<bool>,
    occasions: Vec<Occasion>,
    occasion_ids: Vec<OccasionId>,
    running: Running,
    /// Occasions at which everything is solved next.
    solve_at: usize,
    relay: Relay,
    relay_due: TimePs,
    neighbours_due: TimePs,
    relay_positions: Vec<V3>,
    relay_drones: Vec<usize>,
    assembling: Assembling,
    sweep_started: Option<TimePs>,
    localization: Localization,
    placement: Option<Placement>,
    targets: Vec<Target>,
    /// Where each drone was sent last in the second stage: its goal, or a corner on the way there.
    legs: Vec<Option<V2>>,
    refinement: Option<Refinement>,
    events: Vec<OperatorEvent>,
    counters: ControlCounters,
}

impl ControlCenter {
    /// Before the first word of any drone.
    #[must_use]
    pub fn new(plan: MissionPlan) -> Self {
        let schedules = plan.fleets.iter().enumerate();
        let schedules = schedules.map(|(f, fleet)| FleetSchedule::new(f, fleet.mates, plan.srs)).collect();
        let groups = plan.fleets.iter().zip(0u16..).map(|(fleet, group)| (group, fleet.mates.to_vec()));
        let running = Running::new(plan.localize, groups);
        Self {
            drones: plan.drones.iter().map(|d| DroneLink::new(d.id)).collect(),
            legs: vec![None; plan.drones.len()],
            schedules,
            running,
            solve_at: FIRST_SOLUTION,
            plan,
            stage: Stage::Connect,
            stage_since: TimePs(0),
            scheduled: Vec::new(),
            reported: Vec::new(),
            occasions: Vec::new(),
            occasion_ids: Vec::new(),
            relay: Relay::new(RELAYED_NEIGHBOURS),
            relay_due: TimePs(0),
            neighbours_due: TimePs(0),
            relay_positions: Vec::new(),
            relay_drones: Vec::new(),
            assembling: Assembling::default(),
            sweep_started: None,
            localization: Localization::default(),
            placement: None,
            targets: Vec::new(),
            refinement: None,
            events: Vec::new(),
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
    pub fn conditions(&self, drone: DroneId) -> u16 {
        let known = self.drones.iter().find(|known| known.id == drone).and_then(|known| known.telemetry);
        known.map_or(0, |telemetry| telemetry.conditions)
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
        let index = self.drones.iter().position(|d| d.id == from);
        let (Some(index), Ok((header, Message::Up(message)))) = (index, decode(bytes)) else {
            self.counters.frames_rejected += 1;
            return Ok(());
        };
        let drone = &mut self.drones[index];
        if header.sender != from || !drone.receiver().accept(&header).is_accepted() {
            self.counters.frames_repeated += 1;
            return Ok(());
        }
        drone.hears(now, &message);
        match message {
            Up::Hello { version_min, version_max, schema_hash, .. } => {
                let version = PROTOCOL_VERSION.min(version_max);
                if schema_hash != SCHEMA_HASH || version < version_min.max(MIN_PROTOCOL_VERSION) {
                    let drone = from.0;
                    return Err(MissionError::Incompatible { drone, version_min, version_max, schema_hash });
                }
                drone.connected = true;
                drone.say(&Down::Welcome { version, schema_hash: SCHEMA_HASH }, send);
            }
            Up::CommandAck { command, status } => {
                drone.acknowledged(now, command, status, send)?;
            }
            Up::Heartbeat => {}
            Up::SharedState(state) => {
                if drone.state.is_none_or(|known| known.time < state.time) {
                    drone.state = Some(state);
                }
            }
            Up::Telemetry(telemetry) => {
                if drone.telemetry.is_none_or(|known| known.time < telemetry.time) {
                    drone.telemetry = Some(telemetry);
                }
            }
            Up::Attached(page) => {
                if let Some((fleet, _)) = self.plan.drones[index].fleet {
                    self.schedules[fleet].heard(from, &page);
                }
                self.heard_at_station(index, &page);
            }
            Up::Tdoa(entries) => entries.iter().for_each(|entry| self.measured(from, entry)),
            Up::Event { code, time, value } => {
                self.events.push(OperatorEvent { time, drone: from, what: Happening::Said { code, value } });
            }
        }
        Ok(())
    }

    /// Runs what is due at `now`: commands, relays, requests, and the next stage.
    ///
    /// # Errors
    /// When the mission cannot go on.
    pub fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), MissionError> {
        self.watch(now);
        for drone in &mut self.drones {
            drone.step(now, send)?;
        }
        if now >= self.relay_due {
            self.relay_due = now.after(self.plan.relay_period);
            let far_too = now >= self.neighbours_due;
            if far_too {
                self.neighbours_due = now.after(NEIGHBOURS_PERIOD);
                self.find_neighbours();
            }
            self.relay_states(far_too, send);
        }
        if self.stage == Stage::Sweep {
            self.ask_for_srs(now, send);
            self.solve_now_and_then()?;
        }
        self.advance(now)
    }

    fn ask_for_srs(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) {
        for (schedule, fleet) in self.schedules.iter_mut().zip(&self.plan.fleets) {
            let drones = &mut self.drones;
            let running = &self.running;
            let r95_m = |user| running.fix(user).map(|fix| fix.known_clocks_r95_m);
            schedule.step(now, r95_m, &mut self.scheduled, |request| {
                let message = Down::SrsRequest(request);
                for drone in drones.iter_mut().filter(|d| fleet.mates.contains(&d.id)) {
                    drone.say(&message, send);
                }
            });
        }
        self.reported.resize(self.scheduled.len(), false);
    }

    /// Solves for all users and clocks together whenever the occasions have grown by a share, so that every
    /// occasion is solved for a bounded number of times, however long the sweep.
    fn solve_now_and_then(&mut self) -> Result<(), MissionError> {
        if self.occasions.len() >= self.solve_at {
            self.solve_at = self.occasions.len() + self.occasions.len() / 2 + FIRST_SOLUTION;
            self.localization = localize(&self.occasions, &self.plan.localize)?;
            self.running.calibrate(&self.localization.clocks);
        }
        Ok(())
    }

    /// Who is near whom: looked up anew once a second, in which two drones come 24 m closer at most.
    fn find_neighbours(&mut self) {
        self.relay_positions.clear();
        self.relay_drones.clear();
        for (index, drone) in self.drones.iter().enumerate() {
            if let Some(state) = drone.state {
                self.relay_positions.push(pos_m(&state.pos));
                self.relay_drones.push(index);
            }
        }
        self.relay.update(&self.relay_positions);
    }

    /// Relays to each drone the states of its nearest neighbours (paper section 3.3: drones share
    /// location and velocity through the control center); of those beyond [`NEAR_M`] only now and then.
    fn relay_states(&mut self, far_too: bool, send: &mut impl FnMut(DroneId, &[u8])) {
        for (row, &index) in self.relay_drones.iter().enumerate() {
            let here_m = self.relay_positions[row];
            let mut states = heapless::Vec::new();
            for &other in self.relay.neighbours(row) {
                let other = usize::from(other);
                let near = (self.relay_positions[other] - here_m).norm_squared() < NEAR_M * NEAR_M;
                let neighbour = &self.drones[self.relay_drones[other]];
                let Some(state) = neighbour.state.filter(|_| near || far_too) else { continue };
                let relayed = PeerState { drone: neighbour.id, state };
                if states.is_full() {
                    self.drones[index].say(&Down::Peers(std::mem::take(&mut states)), send);
                }
                states.push(relayed).expect("emptied when full");
            }
            // Without neighbours the frame is empty, and says that the link lives.
            self.drones[index].say(&Down::Peers(states), send);
        }
        // Whoever hears no relay must still hear that the link lives.
        for drone in self.drones.iter_mut().filter(|d| d.connected && d.state.is_none()) {
            drone.say(&Down::Heartbeat, send);
        }
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
            clock_group: asked.fleet as u16,
            time_s: asked.at.0 as f64 * 1e-12,
            captures,
        };
        self.running.add(&occasion);
        self.occasion_ids.push(entry.occasion);
        self.occasions.push(occasion);
    }
}

/// Metres from wire millimetres.
fn pos_m(pos: &PosEnuMm) -> V3 {
    V3::from(pos.0.map(|mm| f64::from(mm) * 1e-3))
}
