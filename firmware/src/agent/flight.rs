//! Phases of the flight and the velocity each of them wants.

use crate::{
    Vec3, ZERO,
    config::FlightLimits,
    guidance::{Reference, formation::Slot, goto, lanes::Lanes, limited, steadying, track, zigzag::Zigzag},
    io::NavFix,
    scalar::greater,
    supervisor::{Action, low_ms},
};
use heapless::Vec;
use skyroost_protocol::{
    message::{EventCode, FlightPhase, Heading, MissionHeader},
    units::{DroneId, TimePs, m_from_mm},
};

/// Greatest speed of a slot around the triangle's centre where it turns with the track, m/s.
const SLOT_TURN_MPS: f32 = 1.5;
/// `1 / sqrt(3)`: from side to circumradius of an equilateral triangle.
const INV_SQRT_3: f32 = 0.577_350_26;
/// Descent above the pad, metres a second.
const LANDING_MPS: f32 = 1.5;
/// Descent without navigation, metres a second: nobody knows where the ground is.
const BLIND_LANDING_MPS: f32 = 1.0;
/// Below this height the landing is over, metres.
const LANDED_BELOW_M: f32 = 0.2;
/// Slower than this a drone has stopped, metres a second.
const STANDING_MPS: f32 = 0.5;
/// Height error at which the climb is over, metres.
const CLIMBED_WITHIN_M: f32 = 1.0;

/// A mission ready to fly.
#[derive(Clone, Debug)]
pub(super) struct Mission {
    pub(super) header: MissionHeader,
    /// The fleet by slot; none for a reserve.
    pub(super) mates: Option<[DroneId; 3]>,
    pub(super) d_safe_m: f32,
    slot: Slot,
    altitude_m: f32,
    speed_mps: f32,
    pub(super) home_m: Vec3,
}

impl Mission {
    /// Checks an upload, lays its lanes and raises its walls; none when it is not for drone `me` or cannot be flown.
    pub(super) fn new(me: DroneId, header: &MissionHeader, lanes: &mut Lanes) -> Option<Self> {
        let spacing_m = header.spacing_mm as f32 * 1e-3;
        let speed_mps = m_from_mm(i32::from(header.speed_mmps));
        if header.fleet.is_some() && header.mates.get(usize::from(header.slot)) != Some(&me) {
            return None;
        }
        let max_turn_radps = match header.heading {
            Heading::Fixed => f32::INFINITY,
            Heading::AlongTrack => SLOT_TURN_MPS / (spacing_m * INV_SQRT_3),
        };
        if header.fleet.is_some() {
            lanes.lay(speed_mps, max_turn_radps).ok()?;
        }
        lanes.raise_walls();
        let orientation_rad = f32::from(header.orientation_mrad) * 1e-3;
        Some(Self {
            header: *header,
            mates: header.fleet.map(|_| header.mates),
            d_safe_m: m_from_mm(i32::from(header.d_safe_mm)),
            slot: Slot::new(header.slot, spacing_m, orientation_rad, header.heading),
            altitude_m: header.altitude_mm as f32 * 1e-3,
            speed_mps,
            home_m: Vec3::from(header.home.0.map(m_from_mm)),
        })
    }
}

/// What the drone is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Grounded,
    TakeOff {
        above_m: Vec3,
    },
    /// Where, is unknown as long as a drone that started in the air has had no fix.
    Hold {
        at_m: Option<Vec3>,
    },
    Sweep {
        start: TimePs,
    },
    GoTo {
        goal_m: Vec3,
    },
    Serve {
        goal_m: Vec3,
    },
    ReturnHome,
    Landing {
        at_m: Option<Vec3>,
    },
}

/// The flight in progress.
#[derive(Clone, Debug)]
pub(super) struct Flight {
    mode: Mode,
    /// Whether the vehicle flies, as the autopilot says.
    in_air: bool,
    /// Whether it is settled that the drone started in the air or on the ground: from then on only its own flight decides.
    settled: bool,
    /// Since when a drone that started in the air looks for its place, in low milliseconds.
    since_ms: u32,
    pub(super) zigzag: Zigzag,
    /// Distance from the slot or goal, metres.
    pub(super) track_error_m: f32,
    /// How far off its slot the drone is, as far as the fleet should wait for it, metres.
    pub(super) lag_m: f32,
    /// From the formation's centre to the own slot, metres.
    arm_m: Vec3,
    /// Whether avoidance has its say, so that the drone cannot be quite where it should.
    pub(super) avoiding: bool,
    /// Where the supervisor made the drone hold.
    held_at_m: Option<Vec3>,
    /// Whether there was no fix in the last step.
    blind: bool,
    /// Velocity wanted in the last step, from which flights to a goal speed up gently.
    pub(super) last_wanted: Vec3,
    events: Vec<(EventCode, u32), 4>,
}

impl Flight {
    /// On the ground, until the first inputs say otherwise.
    pub(super) const fn new() -> Self {
        Self {
            mode: Mode::Grounded,
            in_air: false,
            settled: false,
            since_ms: 0,
            zigzag: Zigzag::new(),
            track_error_m: 0.0,
            lag_m: 0.0,
            arm_m: ZERO,
            avoiding: false,
            held_at_m: None,
            blind: false,
            last_wanted: ZERO,
            events: Vec::new(),
        }
    }

    pub(super) fn phase(&self) -> FlightPhase {
        match self.mode {
            Mode::Grounded => FlightPhase::Grounded,
            Mode::TakeOff { .. } => FlightPhase::TakeOff,
            Mode::Hold { .. } => FlightPhase::Hold,
            Mode::Sweep { .. } => FlightPhase::Sweep,
            Mode::GoTo { .. } => FlightPhase::GoTo,
            Mode::Serve { .. } => FlightPhase::Serve,
            Mode::ReturnHome => FlightPhase::ReturnHome,
            Mode::Landing { .. } => FlightPhase::Landing,
        }
    }

    /// When the lanes begin or began, as long as the drone flies them.
    pub(super) fn sweeping_since(&self) -> Option<TimePs> {
        if let Mode::Sweep { start } = self.mode { Some(start) } else { None }
    }

    /// Whether the drone keeps its slot.
    pub(super) fn in_formation(&self) -> bool {
        self.sweeping_since().is_some() && self.held_at_m.is_none()
    }

    /// From the formation's centre to the own slot, metres; zero out of formation.
    pub(super) fn arm_m(&self) -> Vec3 {
        if self.in_formation() { self.arm_m } else { ZERO }
    }

    /// Whether it is made to stay where it is.
    pub(super) fn stands(&self) -> bool {
        self.held_at_m.is_some()
    }

    pub(super) fn airborne(&self) -> bool {
        self.mode != Mode::Grounded
    }

    /// Takes in whether the vehicle flies. A drone that starts in the air, as its board was reset, holds where it is: nobody else
    /// keeps its motors running. True in the step in which it finds itself there.
    ///
    /// Once it has started, what it did by itself counts: one that has landed stays on the ground though the autopilot needs a
    /// moment to see it.
    pub(super) fn starts(&mut self, now: TimePs, in_air: bool, fix: Option<&NavFix>) -> bool {
        self.in_air = in_air;
        if self.settled || !(in_air || fix.is_some()) {
            return false;
        }
        (self.settled, self.since_ms) = (true, low_ms(now));
        if in_air {
            self.enter(Mode::Hold { at_m: None });
            self.blind = true; // until now
        }
        in_air
    }

    /// For how long a drone that has not had a fix yet looks for its place, milliseconds.
    pub(super) fn searching_ms(&self, now: TimePs) -> u32 {
        low_ms(now).wrapping_sub(self.since_ms)
    }

    pub(super) fn take_off(&mut self, nav: &NavFix, mission: &Mission) {
        self.enter(Mode::TakeOff {
            above_m: Vec3::new(nav.pos_enu_m.x, nav.pos_enu_m.y, mission.altitude_m),
        });
    }

    pub(super) fn hold(&mut self, at_m: Vec3) {
        self.enter(Mode::Hold { at_m: Some(at_m) });
    }

    pub(super) fn start_sweep(&mut self, start: TimePs) {
        self.zigzag = Zigzag::new();
        self.enter(Mode::Sweep { start });
    }

    pub(super) fn go_to(&mut self, goal_m: Vec3) {
        self.enter(Mode::GoTo { goal_m });
    }

    pub(super) fn return_home(&mut self) {
        self.enter(Mode::ReturnHome);
    }

    /// Events since the last call.
    pub(super) fn drain_events(&mut self, mut emit: impl FnMut(EventCode, u32)) {
        self.events.iter().for_each(|(code, value)| emit(*code, *value));
        self.events.clear();
    }

    fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.held_at_m = None;
        self.report(EventCode::PhaseEntered, self.phase() as u32);
    }

    fn report(&mut self, code: EventCode, value: u32) {
        // Emptied every step, and no step reports more than it holds.
        let _ = self.events.push((code, value));
    }

    /// Velocity wanted now and the acceleration known ahead, after the supervisor's `action`; `unaware` where nobody tells of the
    /// others.
    #[expect(
        clippy::too_many_arguments,
        reason = "all of the drone that guidance looks at, from its one caller"
    )]
    pub(super) fn wanted(
        &mut self,
        now: TimePs,
        nav: &NavFix,
        mission: Option<&Mission>,
        lanes: &Lanes,
        limits: &FlightLimits,
        action: Action,
        unaware: bool,
    ) -> (Vec3, Vec3) {
        if core::mem::take(&mut self.blind) {
            self.sees_again(nav, limits);
        }
        // Without a mission nobody knows where home is.
        let action = match action {
            Action::ReturnHome if mission.is_none() => Action::Land,
            action => action,
        };
        self.submit(nav, action, unaware);
        let (wanted, accel) = match self.held_at_m {
            None => self.by_mode(now, nav, mission, lanes, limits),
            Some(at_m) => (
                goto::velocity(&nav.pos_enu_m, &at_m, limits.max_speed_mps, limits.max_vertical_mps),
                Vec3::zeros(),
            ),
        };
        let wanted = match self.mode {
            Mode::Sweep { .. } if self.held_at_m.is_none() => wanted,
            _ => self.last_wanted + limited(wanted - self.last_wanted, limits.max_accel_mps2 * crate::STEP_S),
        };
        self.last_wanted = wanted;
        (wanted, accel)
    }

    /// Velocity wanted without a fix: to stand, or to sink where the supervisor says so. The autopilot holds the
    /// attitude and feels the ground; the motors run on, as nobody here knows that it is reached.
    pub(super) fn blind(&mut self, action: Action) -> Vec3 {
        if action == Action::Land && !matches!(self.mode, Mode::Landing { .. }) {
            self.enter(Mode::Landing { at_m: Some(ZERO) }); // where, is known when it sees again
        }
        self.blind = true;
        let wanted = if action == Action::Land { Vec3::new(0.0, 0.0, -BLIND_LANDING_MPS) } else { ZERO };
        // After a step or two without a fix the flight goes on as it was.
        if action != Action::None {
            self.last_wanted = wanted;
        }
        wanted
    }

    /// A landing on the spot goes on here: nobody knows how far the drone drifted. One that started in the air holds here, slowing
    /// down gently from what it flew.
    fn sees_again(&mut self, nav: &NavFix, limits: &FlightLimits) {
        match &mut self.mode {
            Mode::Landing { at_m: Some(at_m) } => *at_m = nav.pos_enu_m,
            Mode::Hold { at_m: at_m @ None } => {
                *at_m = Some(nav.pos_enu_m);
                self.last_wanted = limited(nav.vel_enu_mps, limits.max_speed_mps);
            }
            _ => {}
        }
    }

    /// A landing without a mission, which would know the ground's height, ends when the autopilot no longer says that the vehicle flies.
    pub(super) fn touches_down(&mut self) {
        if matches!(self.mode, Mode::Landing { .. }) && !self.in_air {
            self.enter(Mode::Grounded);
        }
    }

    /// The supervisor's last word.
    ///
    /// Ways to goals and home cross. Who is on one and `unaware` of the others stops straight, as they take it to have stopped or flown
    /// on; unless it is the supervisor that wants it home. Nor does one come back that had given way: others may stand there.
    fn submit(&mut self, nav: &NavFix, action: Action, unaware: bool) {
        let pos_m = &nav.pos_enu_m;
        let waits = unaware
            && matches!(
                self.mode,
                Mode::GoTo { .. } | Mode::ReturnHome | Mode::Hold { .. } | Mode::Serve { .. }
            );
        if waits && nav.vel_enu_mps.norm() > STANDING_MPS {
            self.held_at_m = None; // it stays where it comes to stand
        }
        let bound_home = matches!(self.mode, Mode::ReturnHome | Mode::Landing { .. });
        match action {
            Action::Land => match self.mode {
                // Somebody stands on the pad, or else below: beside is as good as here.
                Mode::Landing { .. } if self.avoiding => self.mode = Mode::Landing { at_m: Some(*pos_m) },
                Mode::Landing { .. } => {}
                _ => self.enter(Mode::Landing { at_m: Some(*pos_m) }),
            },
            Action::ReturnHome if !bound_home => self.enter(Mode::ReturnHome),
            Action::None | Action::Hold if waits || (action == Action::Hold && !bound_home) => {
                self.held_at_m.get_or_insert(*pos_m);
            }
            Action::None | Action::Hold | Action::ReturnHome => self.held_at_m = None,
        }
    }

    fn by_mode(
        &mut self,
        now: TimePs,
        nav: &NavFix,
        mission: Option<&Mission>,
        lanes: &Lanes,
        limits: &FlightLimits,
    ) -> (Vec3, Vec3) {
        let pos_m = &nav.pos_enu_m;
        let speed_mps = mission.map_or(limits.max_speed_mps, |mission| mission.speed_mps);
        let fly = |goal_m: &Vec3| goto::velocity(pos_m, goal_m, speed_mps, limits.max_vertical_mps);
        let still = |v: Vec3| (v, Vec3::zeros());
        match self.mode {
            Mode::Grounded => still(Vec3::zeros()),
            Mode::TakeOff { above_m } => {
                if libm::fabsf(above_m.z - pos_m.z) < CLIMBED_WITHIN_M {
                    self.hold(above_m);
                }
                self.track_error_m = (above_m - pos_m).norm();
                still(fly(&above_m))
            }
            Mode::Hold { at_m } => {
                let at_m = at_m.unwrap_or(*pos_m);
                self.track_error_m = (at_m - pos_m).norm();
                still(fly(&at_m))
            }
            Mode::Sweep { start } => match mission {
                Some(mission) => self.sweep(now, nav, mission, lanes, start),
                None => still(Vec3::zeros()),
            },
            Mode::GoTo { goal_m } | Mode::Serve { goal_m } => {
                self.track_error_m = (goal_m - pos_m).norm();
                if matches!(self.mode, Mode::GoTo { .. }) && goto::arrived(pos_m, &nav.vel_enu_mps, &goal_m) {
                    self.enter(Mode::Serve { goal_m });
                    self.report(EventCode::GoalReached, (self.track_error_m * 1e3) as u32);
                }
                still(fly(&goal_m))
            }
            Mode::ReturnHome => {
                let above_m = mission.map_or(*pos_m, |m| Vec3::new(m.home_m.x, m.home_m.y, m.altitude_m));
                self.track_error_m = (above_m - pos_m).norm();
                if goto::arrived(pos_m, &nav.vel_enu_mps, &above_m) {
                    self.enter(Mode::Landing { at_m: None });
                }
                still(fly(&above_m))
            }
            Mode::Landing { at_m } => {
                let home_m = mission.map(|mission| mission.home_m);
                let pad_m = at_m.or(home_m).unwrap_or(*pos_m);
                let below = Vec3::new(pad_m.x, pad_m.y, pos_m.z);
                let mut v = fly(&below);
                v.z = -LANDING_MPS;
                if home_m.is_some_and(|home_m| pos_m.z - home_m.z < LANDED_BELOW_M) {
                    self.enter(Mode::Grounded);
                }
                still(v)
            }
        }
    }

    fn sweep(
        &mut self,
        now: TimePs,
        nav: &NavFix,
        mission: &Mission,
        lanes: &Lanes,
        start: TimePs,
    ) -> (Vec3, Vec3) {
        let point = if now < start {
            self.zigzag.look_up(lanes)
        } else {
            self.zigzag.advance(now, lanes, self.lag_m)
        };
        let Some(point) = point else { return (Vec3::zeros(), Vec3::zeros()) };
        let reference: Reference = mission.slot.reference(
            &point,
            self.zigzag.speed_mps(),
            self.zigzag.accel_mps2(),
            mission.altitude_m,
        );
        let error = reference.pos_enu_m - nav.pos_enu_m;
        self.track_error_m = error.norm();
        // What avoidance shifts aside comes back by itself, and waiting would keep the fleet in front of what it avoids.
        let ahead = point.along.push(0.0);
        self.lag_m = if self.avoiding { greater(ahead.dot(&error), 0.0) } else { self.track_error_m };
        self.arm_m = (reference.pos_enu_m.xy() - point.pos_m).push(0.0);
        if self.zigzag.done(lanes) {
            self.hold(reference.pos_enu_m);
            self.report(EventCode::SweepDone, now.since(start).as_secs_f32() as u32);
        }
        (track(nav, &reference), reference.accel_enu_mps2 + steadying(nav, &reference))
    }
}
