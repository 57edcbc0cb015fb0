//! A board in flight, without the hardware: edges and messages in, time and inputs of a step out.

use super::autopilot::{FromAutopilot, Status};
use super::ticks::TickCounter;
use super::triggers::{TriggerWindow, Triggers};
use crate::counters::Counters;
use crate::io::{Capture, Inputs, MAX_CAPTURES_PER_STEP, NavFix, Outputs, Pulse};
use crate::srs::discipline::{GnssClock, Oscillator};
use heapless::Vec;
use skyroost_protocol::message::{AttachedUser, MAX_ATTACHED_PER_FRAME};
use skyroost_protocol::units::{DroneId, TimePs};

/// A navigation solution serves this long, moved on by its velocity: autopilot and board both run at 50 Hz,
/// each on its own clock, so that a step without a new solution is common and two are not.
const NAV_SERVES: TimePs = TimePs::from_ms(60);

/// An edge that the timer captured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The receiver's pulse per second, at this value of the timer.
    Pulse(u32),
    /// The baseband's trigger, at this value of the timer.
    Trigger(u32),
}

/// Who the drone is and when its mission's time began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The drone.
    pub drone: DroneId,
    /// The mission's epoch, seconds of GPS time.
    pub epoch_gps_s: i64,
}

/// What was amiss in flight. Every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct InflightCounters {
    /// Messages that said the drone is another one, or its epoch another.
    pub contradicted: u32,
    /// Steps whose navigation solution was moved on from the step before.
    pub nav_reused: u32,
    /// Steps at which GNSS time was behind the time of the step before.
    pub time_backwards: u32,
    /// Steps whose time ran on by the oscillator alone, the clock knowing no more.
    pub time_free: u32,
    /// Users and captures that a step had no room for.
    pub overflowed: u32,
}

/// State of a board in flight.
#[derive(Clone, Debug)]
pub struct Inflight {
    oscillator: Oscillator,
    identity: Option<Identity>,
    counter: TickCounter,
    clock: GnssClock,
    triggers: Triggers,
    /// Ticks and time of the last step.
    last: Option<(i64, TimePs)>,
    /// The newest navigation solution, when it came, and whether a step has used it.
    nav: Option<(NavFix, i64, bool)>,
    /// Whether the vehicle flies, as last said.
    in_air: bool,
    battery_permille: u16,
    attached: Vec<AttachedUser, MAX_ATTACHED_PER_FRAME>,
    captures: Vec<Capture, MAX_CAPTURES_PER_STEP>,
    /// The last pulse on the grid of seconds, as the timer captured it, that no step has had.
    pulse: Option<u32>,
    counters: InflightCounters,
}

impl Inflight {
    /// A board whose timer reads `timer` and that has heard nothing.
    #[must_use]
    pub fn new(oscillator: Oscillator, timer: u32) -> Self {
        Self {
            oscillator,
            identity: None,
            counter: TickCounter::starting_at(timer),
            clock: GnssClock::new(oscillator),
            triggers: Triggers::new(TriggerWindow::default()),
            last: None,
            nav: None,
            in_air: false,
            battery_permille: 0,
            attached: Vec::new(),
            captures: Vec::new(),
            pulse: None,
            counters: InflightCounters::default(),
        }
    }

    /// Who the drone is, once said.
    #[must_use]
    pub const fn identity(&self) -> Option<Identity> {
        self.identity
    }

    /// What was amiss so far.
    #[must_use]
    pub const fn counters(&self) -> &InflightCounters {
        &self.counters
    }

    /// The clock.
    #[must_use]
    pub const fn clock(&self) -> &GnssClock {
        &self.clock
    }

    /// The triggers and their gates.
    #[must_use]
    pub const fn triggers(&self) -> &Triggers {
        &self.triggers
    }

    /// The timer reads `timer`. To be called at least every half wrap of it.
    pub fn read(&mut self, timer: u32) {
        self.counter.read(timer);
    }

    /// An edge, captured within half a wrap of the last reading.
    pub fn edge(&mut self, edge: Edge) {
        match edge {
            Edge::Pulse(timer) => {
                if self.clock.edge(self.counter.extend(timer)) {
                    self.pulse = Some(timer);
                }
            }
            Edge::Trigger(timer) => {
                let at = self.clock.time_at(self.counter.extend(timer));
                if let Some(capture) = self.triggers.edge(timer, at)
                    && self.captures.push(capture).is_err()
                {
                    Counters::count(&mut self.counters.overflowed);
                }
            }
        }
    }

    /// A message that came when the timer read `timer`.
    pub fn hear(&mut self, message: FromAutopilot, timer: u32) {
        match message {
            FromAutopilot::Configure { drone, epoch_gps_s } => {
                let said = Identity { drone, epoch_gps_s };
                if *self.identity.get_or_insert(said) != said {
                    Counters::count(&mut self.counters.contradicted);
                }
            }
            FromAutopilot::Nav { nav, in_air, battery_permille } => {
                self.nav = nav.map(|fix| (fix.into(), self.counter.extend(timer), false));
                self.in_air = in_air;
                self.battery_permille = battery_permille;
            }
            FromAutopilot::Second { gps_s } => {
                if let Some(identity) = self.identity {
                    self.clock.label(gps_s.saturating_sub(identity.epoch_gps_s), self.counter.extend(timer));
                }
            }
            FromAutopilot::Attached(users) => {
                for user in users {
                    if self.attached.push(user).is_err() {
                        Counters::count(&mut self.counters.overflowed);
                    }
                }
            }
        }
    }

    /// Time of a step when the timer reads `timer`: GNSS time since the mission's epoch, which never runs
    /// backwards. None until it was known for the first time; from then on it goes on by the oscillator
    /// alone if need be, and half as fast where it has to wait for the clock.
    pub fn step_time(&mut self, timer: u32) -> Option<TimePs> {
        let ticks = self.counter.read(timer);
        self.identity?;
        let told = self.clock.time_at(ticks).map(|reading| reading.time);
        let now = match (self.last, told) {
            (None, None) => return None,
            (None, Some(now)) => now,
            (Some((last_ticks, last)), told) => {
                let elapsed = self.oscillator.rate.time_of(ticks.saturating_sub(last_ticks));
                match told {
                    Some(now) if now > last => now,
                    Some(_) => {
                        Counters::count(&mut self.counters.time_backwards);
                        last.after(TimePs(elapsed.0 / 2))
                    }
                    None => {
                        Counters::count(&mut self.counters.time_free);
                        last.after(elapsed)
                    }
                }
            }
        };
        self.last = Some((ticks, now));
        Some(now)
    }

    /// Puts into `inputs` what has come since the last step, but for the radio's frames.
    pub fn sense(&mut self, inputs: &mut Inputs) {
        let Some((ticks, _)) = self.last else { return };
        inputs.timer_ticks = ticks as u32;
        inputs.in_air = self.in_air;
        inputs.battery_permille = self.battery_permille;
        inputs.nav = self.nav_at(ticks);
        // Captures and pulses are of the same timer, so the same pulses discipline both clocks.
        inputs.pulse = self.pulse.take().and_then(|timer| self.numbered(timer));
        // Both lists are cleared at every step and have the same room here and there.
        inputs.captures.clone_from(&self.captures);
        inputs.attached.clone_from(&self.attached);
        self.captures.clear();
        self.attached.clear();
    }

    /// A pulse with the number of its second; none before that is known.
    fn numbered(&self, timer: u32) -> Option<Pulse> {
        let time = self.clock.time_at(self.counter.extend(timer))?.time;
        let second = time.after(TimePs::from_ms(500)).as_us().div_euclid(1_000_000);
        Some(Pulse { ticks: timer, second: i32::try_from(second).ok()? })
    }

    /// The navigation solution, moved on to `ticks`.
    fn nav_at(&mut self, ticks: i64) -> Option<NavFix> {
        let (fix, came, used) = self.nav.as_mut()?;
        let age = self.oscillator.rate.time_of(ticks.saturating_sub(*came));
        if age > NAV_SERVES {
            self.nav = None;
            return None;
        }
        if *used {
            Counters::count(&mut self.counters.nav_reused);
        }
        *used = true;
        Some(NavFix { pos_enu_m: fix.pos_enu_m + fix.vel_enu_mps * age.as_secs_f32(), ..*fix })
    }

    /// Takes the gates out of the outputs of the step at `now`.
    pub fn act(&mut self, now: TimePs, outputs: &Outputs) {
        self.triggers.close(now);
        for gate in &outputs.srs_gates {
            self.triggers.open(*gate);
        }
    }

    /// Fills in what this part knows of how the board fares.
    pub fn describe(&self, status: &mut Status) {
        let clock = self.clock.counters();
        status.time_uncertainty_ns =
            self.last.and_then(|(ticks, _)| self.clock.time_at(ticks)).map(|now| now.bound_ns());
        status.pulses = [clock.accepted, clock.rejected, clock.missed];
        status.set_triggers(self.triggers.counters());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::io::SrsGate;
    use crate::srs::clock::TickRate;
    use skyroost_protocol::units::{OccasionId, UserId};

    const HZ: i64 = 84_000_000;
    const EPOCH_GPS_S: i64 = 1_400_000_000;

    fn board() -> Inflight {
        let rate = TickRate::new(HZ as u64).expect("not zero");
        let oscillator = Oscillator {
            rate,
            tolerance_ppb: 50_000,
            walk_ps: 0,
            wander_fs_per_s2: 5_000_000,
            pulse_ps: 60_000,
        };
        Inflight::new(oscillator, timer(0))
    }

    /// The timer at a time since the mission's epoch, milliseconds; it wraps in the first second.
    fn timer(ms: i64) -> u32 {
        (u64::from(u32::MAX) - 40_000_000).wrapping_add((ms * HZ / 1000) as u64) as u32
    }

    fn nav(east_m: f32) -> FromAutopilot {
        let fix = NavFix {
            pos_enu_m: Vec3::new(east_m, 0.0, 0.0),
            vel_enu_mps: Vec3::new(10.0, 0.0, 0.0),
            error_radius_m: 1.0,
        };
        FromAutopilot::Nav { nav: Some(fix.into()), in_air: true, battery_permille: 900 }
    }

    /// Runs a board up to `seconds`, all well, and returns it.
    fn flown(seconds: i64) -> Inflight {
        let mut board = board();
        board.hear(FromAutopilot::Configure { drone: DroneId(3), epoch_gps_s: EPOCH_GPS_S }, timer(0));
        for ms in (0..seconds * 1000).step_by(20) {
            second(&mut board, ms, 0);
        }
        board
    }

    /// One step of 20 ms, with the second's pulse and its number, `off_s` wrong.
    fn second(board: &mut Inflight, ms: i64, off_s: i64) -> Option<TimePs> {
        board.read(timer(ms));
        if ms % 1000 == 0 {
            board.edge(Edge::Pulse(timer(ms)));
        }
        if ms % 1000 == 200 {
            board.hear(FromAutopilot::Second { gps_s: EPOCH_GPS_S + ms / 1000 + off_s }, timer(ms));
        }
        board.hear(nav(ms as f32 / 100.0), timer(ms));
        board.step_time(timer(ms))
    }

    #[test]
    fn there_is_no_step_before_there_is_time() {
        let mut board = board();
        assert_eq!(second(&mut board, 0, 0), None);
        let mut board = flown(5);
        assert_eq!(board.clock().counters().labels_set, 0);
        assert!(board.step_time(timer(5_000)).is_none());
        let mut board = flown(10);
        assert_eq!(board.step_time(timer(10_000)), Some(TimePs::from_ms(10_000)));
        assert_eq!(board.identity().map(|identity| identity.drone), Some(DroneId(3)));
    }

    #[test]
    fn a_step_without_a_new_solution_moves_the_last_one_on() {
        let mut board = flown(10);
        let mut inputs = Inputs::default();
        board.hear(nav(100.0), timer(10_000));
        for (ms, east_m) in [(10_010, Some(100.1)), (10_050, Some(100.5)), (10_070, None)] {
            board.step_time(timer(ms));
            board.sense(&mut inputs);
            let found = inputs.nav.map(|fix| fix.pos_enu_m.x);
            match (found, east_m) {
                (Some(found), Some(east_m)) => assert!((found - east_m).abs() < 1e-3_f32),
                (found, east_m) => assert_eq!(found, east_m),
            }
        }
        // What flies does not land because its autopilot is quiet.
        assert_eq!((inputs.in_air, inputs.battery_permille), (true, 900));
        assert_eq!(board.counters().nav_reused, 1);
    }

    #[test]
    fn a_trigger_becomes_a_capture_of_its_gate() {
        let mut board = flown(10);
        let gate =
            SrsGate { occasion: OccasionId(9), user: UserId(1), at: TimePs::from_ms(10_030), grant: true };
        let mut outputs = Outputs::default();
        outputs.srs_gates.push(gate).expect("room");
        board.act(TimePs::from_ms(10_000), &outputs);
        board.read(timer(10_040));
        let at = timer(10_030) + 84 * 5; // five microseconds: 1.5 km
        board.edge(Edge::Trigger(at));
        board.step_time(timer(10_040));
        let mut inputs = Inputs::default();
        board.sense(&mut inputs);
        let sigma = TriggerWindow::default().sigma;
        let expected = Capture { occasion: OccasionId(9), ticks: at, symbol: 0, sigma };
        assert_eq!(inputs.captures.as_slice(), [expected]);
        board.sense(&mut inputs);
        assert!(inputs.captures.is_empty(), "once");
    }

    #[test]
    fn pulses_reach_the_flight_code_once_with_their_numbers() {
        let mut board = flown(10);
        let mut inputs = Inputs::default();
        for ms in (10_000..12_000).step_by(20) {
            second(&mut board, ms, 0);
            inputs.clear();
            board.sense(&mut inputs);
            let expected = (ms % 1000 == 0).then_some(Pulse { ticks: timer(ms), second: (ms / 1000) as i32 });
            assert_eq!(inputs.pulse, expected, "at {ms} ms");
        }
        board.edge(Edge::Pulse(timer(12_010))); // ten milliseconds off
        board.step_time(timer(12_020));
        inputs.clear();
        board.sense(&mut inputs);
        assert_eq!(inputs.pulse, None);
    }

    #[test]
    fn time_goes_on_without_pulses_and_never_back() {
        let mut board = flown(20);
        let mut last = TimePs::from_ms(19_980);
        // A receiver that is a second late for good is believed after half a minute.
        for ms in (20_000..60_000).step_by(20) {
            let now = second(&mut board, ms, -1).expect("known");
            assert!(now > last, "{now:?} after {last:?} at {ms} ms");
            last = now;
        }
        assert_eq!(last, TimePs::from_ms(58_980), "and has been waited for");
        assert!((99..=101).contains(&board.counters().time_backwards));
        // Far beyond what a clock holds over.
        for ms in (60_000..2_000_000).step_by(500) {
            let now = board.step_time(timer(ms)).expect("known");
            assert!(now > last, "{now:?} after {last:?} at {ms} ms");
            last = now;
        }
        assert!(board.counters().time_free > 0);
        assert_eq!(last.as_us().div_euclid(1_000_000), 1_998);
    }

    #[test]
    fn another_identity_is_not_obeyed() {
        let mut board = flown(1);
        board.hear(FromAutopilot::Configure { drone: DroneId(4), epoch_gps_s: EPOCH_GPS_S }, timer(1_000));
        assert_eq!(board.identity().map(|identity| identity.drone), Some(DroneId(3)));
        assert_eq!(board.counters().contradicted, 1);
    }
}
