//! The flight agent: one drone's flight code as one function of time and inputs.

mod command;
mod flight;
mod receive;
mod transmit;
mod upload;
mod vitals;

use crate::{
    Vec3,
    avoid::{self, Rule, Separation, pca::Mover},
    config::AgentConfig,
    counters::Counters,
    guidance::{lanes::Lanes, limited},
    io::{Inputs, NavFix, Outputs, Setpoint},
    peers::PeerTable,
    scalar::within,
    srs::Srs,
    supervisor::{Action, Condition, Supervisor},
};
use flight::{Flight, Mission};
use receive::Links;
use skyroost_protocol::{
    key::Key,
    message::{FlightPhase, Manner},
    units::TimePs,
};
use transmit::Transmitter;
use upload::Upload;
use vitals::Vitals;

// A board holds one of each in static memory, of 48 KiB that the whole image may take.
#[cfg(target_pointer_width = "32")]
const _: () =
    assert!(size_of::<FlightAgent>() + size_of::<Inputs>() + size_of::<Outputs>() <= 26 * 1024 + 512);

/// The charge that is assumed until the first step says otherwise, per mille.
const FULL_PERMILLE: u16 = 1000;

/// The control center relays states ten times a second. After so long without a word of it a drone does not know where the others are
/// (`docs/safety.md`, condition 2),
const UNHEARD: TimePs = TimePs::from_ms(1_000);
/// nor after so many periods where they are seldom.
const UNHEARD_PERIODS: i64 = 3;

/// One drone's flight code.
///
/// ```
/// use skyroost_firmware::{agent::FlightAgent, config::AgentConfig, io::{Inputs, Outputs}};
/// use skyroost_protocol::units::{DroneId, TimePs};
///
/// let mut agent = FlightAgent::new(AgentConfig::new(DroneId(1)), None);
/// let (inputs, mut outputs) = (Inputs::default(), Outputs::default());
/// agent.step(TimePs(0), &inputs, &mut outputs);
/// assert!(!outputs.setpoint.motors, "on the ground until told otherwise");
/// assert_eq!(outputs.uplink.len(), 1, "it says hello");
/// ```
#[derive(Clone, Debug)]
pub struct FlightAgent {
    config: AgentConfig,
    links: Links,
    upload: Upload,
    mission: Option<Mission>,
    /// Those of the upload until it is committed, of the mission from then on.
    lanes: Lanes,
    flight: Flight,
    peers: PeerTable,
    srs: Srs,
    supervisor: Supervisor,
    vitals: Vitals,
    transmitter: Transmitter,
    counters: Counters,
    /// Last navigation solution and when it came.
    nav: Option<(TimePs, NavFix)>,
    battery_permille: u16,
    /// When avoidance last changed the velocity.
    avoided: Option<TimePs>,
}

impl FlightAgent {
    /// An agent on the ground that has heard nothing yet. `key` is the root key of its link to the control center; without
    /// one nothing is sealed and nothing sealed is heard.
    #[must_use]
    pub const fn new(config: AgentConfig, key: Option<Key>) -> Self {
        Self {
            config,
            links: Links::new(),
            upload: Upload::new(),
            mission: None,
            lanes: const { Lanes::empty() },
            flight: Flight::new(),
            peers: const { PeerTable::new() },
            srs: Srs::new(&config),
            supervisor: Supervisor::new(),
            vitals: Vitals::new(),
            transmitter: Transmitter::new(&config, key),
            counters: Counters::new(),
            nav: None,
            battery_permille: FULL_PERMILLE,
            avoided: None,
        }
    }

    /// Makes this agent the one that [`new`](Self::new) would give, in its place: there is no room for a second
    /// one on a board's stack.
    pub fn restart(&mut self, config: AgentConfig, key: Option<Key>) {
        // Taken apart, so that no part can be forgotten.
        let Self {
            config: own,
            links,
            upload,
            mission,
            lanes,
            flight,
            peers,
            srs,
            supervisor,
            vitals,
            transmitter,
            counters,
            nav,
            battery_permille,
            avoided,
        } = self;
        *own = config;
        *links = Links::new();
        *upload = Upload::new();
        *mission = None;
        lanes.clear();
        *flight = Flight::new();
        peers.clear();
        srs.restart(&config);
        *supervisor = Supervisor::new();
        *vitals = Vitals::new();
        *transmitter = Transmitter::new(&config, key);
        *counters = Counters::new();
        *nav = None;
        *battery_permille = FULL_PERMILLE;
        *avoided = None;
    }

    /// One step, [`STEP_HZ`](crate::STEP_HZ) times a second: takes `inputs`, fills `outputs` (which the
    /// caller has cleared). `now` is GNSS time since the mission's epoch and never runs backwards.
    #[inline(never)] // a function of its own in every image, whose calls and stack can be read there
    pub fn step(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) {
        self.receive(now, inputs, outputs);
        let fix = self.estimate(now, inputs, outputs);
        if self.flight.starts(now, inputs.in_air, fix.as_ref()) {
            // Nobody can have said anything yet.
            self.links.control_heard = now;
        }
        if self.mission.is_none() {
            self.flight.touches_down();
        }
        let action = self.supervise(now, fix.as_ref(), outputs);
        outputs.setpoint = match fix {
            _ if !self.flight.airborne() => Setpoint::REST,
            Some(nav) => self.command(now, &nav, action),
            None => Setpoint { motors: true, vel_enu_mps: self.flight.blind(action), ..Setpoint::REST },
        };
        let (transmitter, counters) = (&mut self.transmitter, &mut self.counters);
        self.flight.drain_events(|code, value| transmitter.event(now, code, value, outputs, counters));
        self.transmit(now, outputs);
    }

    /// Phase of the flight.
    #[must_use]
    pub fn phase(&self) -> FlightPhase {
        self.flight.phase()
    }

    /// Way flown along the lanes, micrometres.
    #[must_use]
    pub fn sweep_phase_um(&self) -> i64 {
        self.flight.zigzag.phase_um()
    }

    /// How others have to take this drone: one that lands where it is, on its last charge or blind, gives no way.
    fn manner(&self) -> Manner {
        if self.supervisor.is(Condition::BatteryCritical) || self.supervisor.is(Condition::NavigationGone) {
            return Manner::UNABLE;
        }
        let formation = self.mission.as_ref().filter(|_| self.flight.in_formation());
        formation.and_then(|mission| mission.header.fleet).map_or(Manner::ALONE, Manner::formation)
    }

    /// Counts of everything dropped, refused or clamped since boot.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Navigation, battery, arrival times; the fix of this step if there is a sound one.
    fn estimate(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) -> Option<NavFix> {
        self.battery_permille = inputs.battery_permille;
        let fix = inputs.nav.filter(|nav| {
            let sound = nav.pos_enu_m.iter().chain(nav.vel_enu_mps.iter()).all(|x| x.is_finite())
                && nav.error_radius_m.is_finite();
            if !sound {
                Counters::count(&mut self.counters.not_finite);
            }
            sound
        });
        if let Some(nav) = fix {
            self.nav = Some((now, nav));
        }
        self.srs.step(now, inputs, fix.as_ref(), self.config.id, outputs, &mut self.counters);
        self.vitals.listened(now, !inputs.captures.is_empty(), !outputs.srs_gates.is_empty());
        fix
    }

    /// Whether nobody has told it of drones outside its fleet for longer than their states are good for.
    fn is_unaware(&self, now: TimePs) -> bool {
        let periods = TimePs(self.config.share_period.0.saturating_mul(UNHEARD_PERIODS));
        now.since(self.links.control_heard) > periods.max(UNHEARD)
    }

    /// Guidance and avoidance after the supervisor's `action`, in the air and with a sound fix.
    fn command(&mut self, now: TimePs, nav: &NavFix, action: Action) -> Setpoint {
        self.flight.avoiding = self.supervisor.is(Condition::Avoiding);
        let limits = &self.config.limits;
        let mission = self.mission.as_ref();
        let unaware = self.is_unaware(now);
        let (wanted, accel) = self.flight.wanted(now, nav, mission, &self.lanes, limits, action, unaware);
        let separation = Separation {
            d_safe_m: mission.map_or(self.config.d_safe_m, |m| m.d_safe_m),
            own_error_m: nav.error_radius_m,
            max_speed_mps: limits.max_speed_mps,
            vertical: mission.map_or_else(Default::default, |m| m.header.vertical),
            manner: self.manner(),
            arm_m: self.flight.arm_m(),
            waits: unaware && self.flight.stands(),
        };
        let own = Mover { pos_enu_m: nav.pos_enu_m, vel_enu_mps: nav.vel_enu_mps };
        let avoided =
            avoid::avoid(now, &own, wanted, &self.peers, self.lanes.walls(), &separation, Rule::HalfPlanes);
        let mut vel = limited(avoided.vel_enu_mps, limits.max_speed_mps);
        vel.z = within(vel.z, -limits.max_vertical_mps, limits.max_vertical_mps);
        let accel_enu_mps2 = if avoided.active { Vec3::zeros() } else { accel };
        if avoided.active {
            self.avoided = Some(now);
        }
        Setpoint { motors: self.flight.airborne(), vel_enu_mps: vel, accel_enu_mps2 }
    }

    /// Has the supervisor look at everything, in the air and on the ground.
    #[inline(never)] // the step is long enough
    fn supervise(&mut self, now: TimePs, fix: Option<&NavFix>, outputs: &mut Outputs) -> Action {
        self.watch(now, fix);
        let health = self.health(now);
        let (transmitter, counters) = (&mut self.transmitter, &mut self.counters);
        self.supervisor.step(now, &health, &self.config.supervisor, |condition, raised| {
            transmitter.condition(now, condition, raised, outputs, counters);
        })
    }
}
