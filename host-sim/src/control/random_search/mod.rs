//! The paper's baseline as a state machine (section 4): drones fly straight on, and whose coverage disk meets another's or
//! the border is given a new heading at random.
//!
//! Connect, upload, take off, search. Once a second it looks at where drones are by their own word, and who will have
//! met something before a turn told a second later would help: there lies what the radio and turning take. A heading
//! is told as a goal beyond the border, so that drones fly at cruise speed until told otherwise.
//!
//! - `legs`: the rule's geometry, which the paper's closed model shares.

pub mod legs;
#[cfg(test)]
mod tests;

use crate::{
    control::{
        keys::LinkKeys,
        mission::{
            MissionError,
            drone::{DroneFailure, DroneLink, place_at},
            pos_m,
            relaying::Relaying,
        },
    },
    geometry::V2,
};
use legs::{Contact, Ground, Leg, MOST_HEADINGS};
use rand_core::Rng;
use skyroost_protocol::{
    message::{Command, EventCode, FlightPhase, Heading, MissionHeader, Up, Vertical},
    units::{DroneId, MissionId, PosEnuMm, TimePs},
};

/// Every so often it is decided who turns; who stays, stays for as long.
const DECIDE_EVERY: TimePs = TimePs::from_ms((legs::STAY_S * 1e3) as i64);
/// Longest wait for hellos and for uploads, seconds; a climb gets a second a metre beside it.
const PATIENCE_S: f64 = 120.0;

/// Who searches, where and how.
#[derive(Clone, Debug)]
pub struct SearchPlan {
    /// Where each drone stands and begins; drone 1 first.
    pub starts_m: Vec<V2>,
    /// What is searched.
    pub ground: Ground,
    /// Altitude of flight, metres.
    pub altitude_m: f64,
    /// Separation of true centres (the paper's `d_safe`), metres.
    pub d_safe_m: f64,
    /// Whether drones give way up and down.
    pub vertical: Vertical,
    /// Every so often shared states are relayed.
    pub relay_period: TimePs,
    /// Bytes a second that can be said to each drone; 0 for any number.
    pub link_bytes_per_s: u32,
    /// What seals the links.
    pub keys: LinkKeys,
    /// Acceleration in turns, metres a second squared.
    pub accel_mps2: f64,
    /// From a decision until it is flown: the radio's way and the vehicle's lag, seconds.
    pub delay_s: f64,
    /// How far before its goal a drone begins to brake, metres.
    pub brake_m: f64,
}

impl SearchPlan {
    /// How long before it meets something a drone is turned, at the latest a decision before that: half of the longest
    /// turn, as the way there is that of so long straight on, and what passes until it turns at all.
    #[must_use]
    pub fn ahead_s(&self) -> f64 {
        legs::STAY_S + self.delay_s + self.ground.speed_mps / self.accel_mps2
    }
}

/// What is going on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Connect,
    Upload,
    TakeOff,
    Search,
}

/// What a drone was told last.
#[derive(Clone, Copy, Debug)]
struct Told {
    velocity_mps: V2,
    at: TimePs,
    /// Whether it flies home, or is there: its supervisor had a reason.
    home: bool,
}

/// Lets drones search at random.
#[derive(Debug)]
pub struct RandomSearch<R> {
    plan: SearchPlan,
    rng: R,
    stage: Stage,
    stage_since: TimePs,
    drones: Vec<DroneLink>,
    told: Vec<Told>,
    /// The lines that drones are on or turn into, as of the last decision; none for those that do not search.
    legs: Vec<Option<Leg>>,
    decide_due: TimePs,
    relaying: Relaying,
}

impl<R: Rng> RandomSearch<R> {
    /// Before the first word of any drone; headings come of `rng`.
    #[must_use]
    pub fn new(plan: SearchPlan, rng: R) -> Self {
        let link = |(id, _)| DroneLink::new(DroneId(id), &plan.keys, plan.link_bytes_per_s);
        let drones: Vec<DroneLink> = (1..).zip(&plan.starts_m).map(link).collect();
        let told = Told { velocity_mps: V2::zeros(), at: TimePs(0), home: false };
        Self {
            told: vec![told; drones.len()],
            legs: vec![None; drones.len()],
            relaying: Relaying::new(plan.relay_period),
            plan,
            rng,
            stage: Stage::Connect,
            stage_since: TimePs(0),
            drones,
            decide_due: TimePs(0),
        }
    }

    /// When the search began: once all drones were up.
    #[must_use]
    pub fn started(&self) -> Option<TimePs> {
        (self.stage == Stage::Search).then_some(self.stage_since)
    }

    /// Whether a drone searches, by its index: not one that flies home, and not one that is lost.
    #[must_use]
    pub fn searches(&self, drone: usize) -> bool {
        let link = &self.drones[drone];
        self.stage == Stage::Search && !self.told[drone].home && link.lost.is_none() && link.state.is_some()
    }

    /// Takes in a frame that came at `now` on the link of `from`; one that does not decode is left.
    ///
    /// # Errors
    /// When the drone refuses a command on the way up, or speaks another protocol.
    pub fn receive(
        &mut self,
        now: TimePs,
        from: DroneId,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), MissionError> {
        let index = usize::from(from.0).wrapping_sub(1);
        let Some(drone) = self.drones.get_mut(index) else { return Ok(()) };
        let (refused, message) = match drone.hear(now, bytes, send) {
            Ok(Some(message)) => (false, message),
            Ok(None) => return Ok(()),
            // On its way home a drone takes no goals.
            Err(DroneFailure::Refused { .. }) if self.stage == Stage::Search => (true, Up::Heartbeat),
            Err(failure) => return Err(failure.into()),
        };
        let homeward = [FlightPhase::ReturnHome, FlightPhase::Landing, FlightPhase::Grounded];
        let (time, homeward) = match message {
            Up::Telemetry(telemetry) => (telemetry.time, homeward.contains(&telemetry.phase)),
            Up::Event { code: EventCode::PhaseEntered, time, value } => {
                (time, homeward.iter().any(|&phase| value == phase as u32))
            }
            _ => (now, false),
        };
        let searching = self.started().is_some_and(|started| time > started);
        self.told[index].home |= refused || searching && homeward;
        Ok(())
    }

    /// Runs what is due at `now`: headings, commands, relays, and the next stage.
    ///
    /// # Errors
    /// When a drone does not come up, or does not answer.
    pub fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), MissionError> {
        for link in &mut self.drones {
            link.watched(now, self.plan.relay_period);
        }
        self.advance(now)?;
        if self.stage == Stage::Search && now >= self.decide_due {
            self.decide_due = now.after(DECIDE_EVERY);
            self.decide(now);
        }
        for link in &mut self.drones {
            link.step(now, send)?;
        }
        self.relaying.step(now, &mut self.drones, send);
        self.drones.iter_mut().for_each(|link| link.say_lanes(now, send));
        Ok(())
    }

    /// Ends the stage when what it waits for is there.
    fn advance(&mut self, now: TimePs) -> Result<(), MissionError> {
        let living = || self.drones.iter().filter(|link| link.lost.is_none());
        let (next, limit_s) = match self.stage {
            Stage::Connect => (living().all(|link| link.connected).then_some(Stage::Upload), PATIENCE_S),
            Stage::Upload => (living().all(DroneLink::idle).then_some(Stage::TakeOff), PATIENCE_S),
            Stage::TakeOff => {
                let up = living().all(|link| link.phase(now) == Some(FlightPhase::Hold));
                (up.then_some(Stage::Search), PATIENCE_S + self.plan.altitude_m)
            }
            Stage::Search => return Ok(()),
        };
        let Some(next) = next else {
            if seconds(now) - seconds(self.stage_since) <= limit_s {
                return Ok(());
            }
            let waiting = living().map(|link| format!("drone {} {:?}", link.id.0, link.phase(now)));
            let waiting = waiting.collect::<Vec<_>>().join(", ");
            return Err(MissionError::Stuck { stage: "random search", limit_s, waiting });
        };
        (self.stage, self.stage_since, self.decide_due) = (next, now, now);
        match next {
            Stage::Upload => self.upload(),
            Stage::TakeOff => self.drones.iter_mut().for_each(|link| link.command(Command::TakeOff)),
            Stage::Connect | Stage::Search => {}
        }
        Ok(())
    }

    /// Drones without a fleet, as reserves of a mission are.
    fn upload(&mut self) {
        let plan = &self.plan;
        for (link, start_m) in self.drones.iter_mut().zip(&plan.starts_m) {
            let [x, y] = [start_m.x, start_m.y].map(|m| (m * 1e3).round() as i32);
            let header = MissionHeader {
                mission: MissionId(1),
                fleet: None,
                mates: [DroneId::CONTROL; 3],
                slot: 0,
                spacing_mm: 0,
                heading: Heading::Fixed,
                orientation_mrad: 0,
                speed_mmps: (plan.ground.speed_mps * 1e3) as u16,
                altitude_mm: (plan.altitude_m * 1e3) as u32,
                home: PosEnuMm([x, y, 0]),
                waypoints: 0,
                d_safe_mm: (plan.d_safe_m * 1e3) as u16,
                walls: 0,
                vertical: plan.vertical,
            };
            link.upload(header, Vec::new());
        }
    }

    /// New headings for all that meet something, the first to meet first; whoever stayed tries again.
    fn decide(&mut self, now: TimePs) {
        let count = self.drones.len();
        self.legs = (0..count).map(|drone| self.leg_as_told(drone, now)).collect();
        let mut turned = vec![false; count];
        for (drone, turned) in turned.iter_mut().enumerate() {
            *turned = self.legs[drone].is_some_and(|leg| leg.velocity_mps == V2::zeros());
            if *turned {
                self.turn(&[drone], now);
            }
        }
        let until_s = seconds(now) + self.plan.ahead_s();
        while let Some((drone, contact)) = self.first_contact(&turned, now).filter(|it| it.1.at_s <= until_s)
        {
            let all: &[usize] = if let Some(other) = contact.with { &[drone, other] } else { &[drone] };
            self.turn(all, now);
            all.iter().for_each(|&drone| turned[drone] = true);
        }
    }

    /// The first contact of those that have not all turned just now; of two at once, the drone with the lower number.
    fn first_contact(&self, turned: &[bool], now: TimePs) -> Option<(usize, Contact)> {
        let now_s = seconds(now);
        let legs = || self.legs.iter().enumerate().filter_map(|(drone, leg)| Some((drone, (*leg)?)));
        let mut first: Option<(usize, Contact)> = None;
        let mut meets = |drone: usize, contact: Contact| {
            if first.is_none_or(|(_, known)| contact.at_s < known.at_s) {
                first = Some((drone, contact));
            }
        };
        for (drone, leg) in legs() {
            if !turned[drone] {
                let at_s = leg.border_s(&self.plan.ground).max(now_s);
                meets(drone, Contact { at_s, with: None });
            }
            for (other, its) in legs().skip_while(|&(other, _)| other <= drone) {
                if !(turned[drone] && turned[other]) {
                    let at_s = leg.meets_s(&its, now_s, &self.plan.ground);
                    meets(drone, Contact { at_s, with: Some(other) });
                }
            }
        }
        first
    }

    /// New headings for drones that meet something: away from all that they meet, and free of all else for a while.
    fn turn(&mut self, drones: &[usize], now: TimePs) {
        let before = self.legs.clone();
        let from_s = seconds(now) + self.plan.delay_s;
        let free = (0..MOST_HEADINGS).any(|_| {
            for &drone in drones {
                let velocity_mps = self.plan.ground.heading_mps(&mut self.rng);
                self.legs[drone] = self.leg(drone, velocity_mps, from_s);
            }
            drones.iter().all(|&drone| self.is_free(drone, &before, now))
        });
        for &drone in drones {
            if !free {
                self.legs[drone] = self.leg(drone, V2::zeros(), from_s);
            }
            let Some(leg) = self.legs[drone] else { continue };
            let goal_m = if free {
                let end_m = leg.at(leg.border_s(&self.plan.ground));
                end_m + leg.velocity_mps / self.plan.ground.speed_mps * self.plan.brake_m
            } else {
                leg.from_m
            };
            self.told[drone] = Told { velocity_mps: leg.velocity_mps, at: now, ..self.told[drone] };
            self.drones[drone].command(place_at(goal_m, self.plan.altitude_m));
        }
    }

    /// Whether a drone's new leg leads away from all that it met by the legs `before`, and meets nothing else soon.
    fn is_free(&self, drone: usize, before: &[Option<Leg>], now: TimePs) -> bool {
        let (Some(leg), Some(old)) = (self.legs[drone], before[drone]) else { return true };
        let (ground, now_s) = (&self.plan.ground, seconds(now));
        let until_s = now_s + self.plan.ahead_s();
        let (low, high, ahead_m) = (ground.low_m(), ground.high_m(), old.at(until_s));
        let inward = (0..2).all(|axis| {
            !(ahead_m[axis] < low[axis] && leg.velocity_mps[axis] < 0.0
                || ahead_m[axis] > high[axis] && leg.velocity_mps[axis] > 0.0)
        });
        inward
            && leg.border_s(ground) > until_s
            && (0..self.legs.len()).filter(|&other| other != drone).all(|other| {
                let (Some(its), Some(its_old)) = (self.legs[other], before[other]) else { return true };
                let met = old.meets_s(&its_old, now_s, ground) <= until_s;
                (!met || leg.apart(&its, now_s).closing() >= 0.0)
                    && leg.meets_s(&its, now_s, ground) > until_s
            })
    }

    /// The line that a drone is on, or turns into as it was told.
    fn leg_as_told(&self, drone: usize, now: TimePs) -> Option<Leg> {
        let Told { velocity_mps, at, .. } = self.told[drone];
        // What was not acknowledged may have been lost.
        let begun = if self.drones[drone].idle() { at } else { now };
        self.searches(drone).then(|| self.leg(drone, velocity_mps, seconds(begun) + self.plan.delay_s))?
    }

    /// The line that a drone comes to fly on which takes on a velocity from `from_s` on: until then it flies as it says,
    /// and turns at constant acceleration. Before the turn is over the line is where the drone would have to have been.
    fn leg(&self, drone: usize, velocity_mps: V2, from_s: f64) -> Option<Leg> {
        let state = self.drones[drone].state?;
        let reported_mps = V2::new(f64::from(state.vel.0[0]), f64::from(state.vel.0[1])) * 1e-3;
        let since_s = from_s.max(seconds(state.time));
        let begins_m = pos_m(&state.pos).xy() + reported_mps * (since_s - seconds(state.time));
        let change_mps = velocity_mps - reported_mps;
        let turning_s = change_mps.norm() / self.plan.accel_mps2;
        Some(Leg { from_m: begins_m - change_mps * (turning_s / 2.0), velocity_mps, since_s })
    }
}

fn seconds(at: TimePs) -> f64 {
    at.0 as f64 * 1e-12
}
