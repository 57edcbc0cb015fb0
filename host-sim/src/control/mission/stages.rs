//! From stage to stage: what each waits for, what it begins with, how long it may take.

use super::{ControlCenter, MissionError, Stage, drone::DroneLink};
use crate::geometry::V2;
use skyroost_protocol::{
    message::{Command, FlightPhase, MissionHeader, WAYPOINTS_PER_WALL},
    units::{DroneId, FleetId, MissionId, PosEnuMm, TimePs, mm_from_m},
};

/// From the command to the common start of the lanes: time for two repetitions.
const START_LEAD: TimePs = TimePs::from_ms(2_000);
/// After the last lane reports of the last occasions still arrive.
const COLLECT_FOR: TimePs = TimePs::from_ms(1_500);
/// Drones that were not heard of by then are gone without, where others make up a fleet.
const CONNECT_FOR: TimePs = TimePs::from_ms(90_000);
/// So long somebody is waited for where all are lost.
const WAIT_FOR: TimePs = TimePs::from_ms(180_000);
/// Where a drone that serves falls out or one comes back, all are placed anew after so long.
const PLACE_AFTER: TimePs = TimePs::from_ms(15_000);

impl ControlCenter {
    /// Ends the stage when what it waits for is there.
    pub(super) fn advance(&mut self, now: TimePs) -> Result<(), MissionError> {
        let mends = matches!(self.stage, Stage::Upload | Stage::TakeOff | Stage::Assemble | Stage::Sweep);
        if mends && self.mend(now)? {
            return Ok(());
        }
        if self.progress.revision > 0 && self.stage < Stage::Halt {
            self.send_spare_home(now);
        }
        if matches!(self.stage, Stage::Deploy | Stage::Refine | Stage::Serve)
            && self.is_placed_for_others(now)
        {
            return self.enter(Stage::Deploy, now);
        }
        let next = match self.stage {
            Stage::Connect => self.all_connected(now).then_some(Stage::Upload),
            Stage::Upload => {
                (self.all_there() && self.members().all(DroneLink::idle)).then_some(Stage::TakeOff)
            }
            Stage::TakeOff => {
                // Fleets that stand in formation take off in it.
                let next = if self.plan.assembly.is_some() { Stage::Assemble } else { Stage::Sweep };
                (self.all_there() && self.fleets_in(FlightPhase::Hold, now)).then_some(next)
            }
            Stage::Assemble => {
                let stuck = self.stuck_in_assembly(now);
                if !stuck.is_empty() && self.may_replan() {
                    return self.halt(now, stuck);
                }
                (self.assembled(now) && self.all_there()).then_some(Stage::Sweep)
            }
            Stage::Sweep => {
                let started = self.sweep_started.is_some_and(|start| now > start);
                let flown = started && self.all_there() && self.swept(now);
                if flown && (self.is_something_left() || self.is_anybody_gone(now)?) {
                    return self.halt(now, Vec::new());
                }
                flown.then_some(Stage::Collect)
            }
            Stage::Halt => self.halted(now),
            Stage::Collect => {
                let waited = now.since(self.stage_since);
                // Where all are lost some may come back.
                let anybody = !self.living().is_empty() || waited >= WAIT_FOR;
                (waited >= COLLECT_FOR && anybody).then_some(Stage::Deploy)
            }
            Stage::Deploy => {
                self.send_off(now);
                (self.misplaced_since.is_none() && self.deployed(now)).then_some(Stage::Refine)
            }
            Stage::Refine => (self.refined(now)? && self.misplaced_since.is_none()).then_some(Stage::Serve),
            Stage::Serve => None,
        };
        match next {
            Some(stage) => self.enter(stage, now),
            None => self.check_patience(now),
        }
    }

    pub(super) fn enter(&mut self, stage: Stage, now: TimePs) -> Result<(), MissionError> {
        self.stage = stage;
        self.stage_since = now;
        match stage {
            Stage::Connect | Stage::Assemble | Stage::Collect | Stage::Serve => {}
            Stage::Upload => self.upload(),
            Stage::TakeOff => self.take_off(),
            Stage::Halt => self.begin_halt(),
            Stage::Sweep => {
                let at = now.after(START_LEAD);
                self.sweep_started = Some(at);
                self.book_start(at);
                self.command_fleets(&Command::StartSweep { at });
            }
            Stage::Deploy => self.locate_and_place(now)?,
            Stage::Refine => self.begin_refining(now),
        }
        Ok(())
    }

    /// A stage that outlasts all reason ends the mission, naming who is waited for.
    fn check_patience(&self, now: TimePs) -> Result<(), MissionError> {
        let climb_s = self.plan.altitude_m; // at a third of the climb rate
        let flight_s = |way_m: f64| 2.0 * way_m / self.plan.speed_mps;
        let limit_s =
            match self.stage {
                Stage::Serve => return Ok(()),
                Stage::Connect | Stage::Upload | Stage::Collect => 120.0,
                Stage::Halt => 300.0,
                Stage::TakeOff => 120.0 + climb_s,
                Stage::Assemble => self.plan.assembly.as_ref().map_or(0.0, |assembly| {
                    600.0 + 2.0 * assembly.height_m() + flight_s(assembly.longest_m())
                }),
                Stage::Sweep => {
                    let longest = self.plan.longest_m();
                    600.0 + flight_s(longest)
                }
                Stage::Deploy => 600.0 + climb_s + flight_s(self.longest_flight_m()),
                Stage::Refine => 1_200.0,
            };
        if now.since(self.stage_since).0 as f64 * 1e-12 <= limit_s {
            return Ok(());
        }
        let waiting: Vec<String> = self
            .drones
            .iter()
            .map(|d| format!("drone {} {:?}", d.id.0, d.telemetry.map(|t| t.phase)))
            .collect();
        Err(MissionError::Stuck { stage: self.stage.name(), limit_s, waiting: waiting.join(", ") })
    }

    /// Whether every drone of a fleet has done what it was told and says that it is in `phase` now; lost ones do not
    /// count.
    fn fleets_in(&self, phase: FlightPhase, now: TimePs) -> bool {
        self.members().all(|link| link.phase(now) == Some(phase))
    }

    /// Whether nobody sweeps any more: all hold, but for drones that were lost when the lanes began.
    fn swept(&self, now: TimePs) -> bool {
        self.members().all(|link| link.phase(now).is_some_and(|phase| phase != FlightPhase::Sweep))
    }

    /// Whether all drones speak to this control center, or those have had time to that do not.
    fn all_connected(&mut self, now: TimePs) -> bool {
        if self.drones.iter().all(|link| link.connected) {
            return true;
        }
        let enough = self.drones.iter().filter(|link| link.connected).count() >= 3;
        if self.plan.resweep.is_none() || !enough || now.since(self.stage_since) < CONNECT_FOR {
            return false;
        }
        self.drones.iter_mut().filter(|link| !link.connected).for_each(|link| link.give_up(now));
        true
    }

    /// Whether every drone of a fleet is heard. Whoever is not is waited for until the rest is planned without it, where it can be.
    fn all_there(&self) -> bool {
        self.plan.resweep.is_none()
            || !self.may_replan()
            || self.every_member().all(|link| link.lost.is_none())
    }

    /// Whether drones that can serve have no place, or drones that have one cannot serve, and have not for a while.
    fn is_placed_for_others(&mut self, now: TimePs) -> bool {
        let living = self.living();
        let misses = living != self.placed_for;
        if !misses {
            self.misplaced_since = None;
            return false;
        }
        let since = *self.misplaced_since.get_or_insert(now);
        !living.is_empty() && self.plan.resweep.is_some() && now.since(since) >= PLACE_AFTER
    }

    /// A drone that turned home on its own ends the mission where nothing can be planned anew: its fleet cannot locate anybody.
    pub(super) fn check_sweepers(&self, now: TimePs) -> Result<(), MissionError> {
        for link in self.members() {
            if let (Some(phase), Some(telemetry)) = (link.phase(now), link.telemetry)
                && matches!(phase, FlightPhase::ReturnHome | FlightPhase::Landing | FlightPhase::Grounded)
            {
                let conditions = telemetry.conditions;
                return Err(MissionError::LeftSweep { drone: link.id.0, phase, conditions });
            }
        }
        Ok(())
    }

    fn command_fleets(&mut self, command: &Command) {
        for (planned, link) in self.plan.drones.iter().zip(&mut self.drones) {
            if planned.fleet.is_some() && link.lost.is_none() {
                link.command(command.clone());
            }
        }
    }

    /// Those of the fleets that stand on the ground take off.
    fn take_off(&mut self) {
        for (planned, link) in self.plan.drones.iter().zip(&mut self.drones) {
            if planned.fleet.is_some() && link.lost.is_none() && !link.in_the_air() {
                link.command(Command::TakeOff);
            }
        }
    }

    /// Gives the mission to the fleets, and to all others while they have none.
    fn upload(&mut self) {
        let mission = self.mission();
        for drone in 0..self.drones.len() {
            let needs = self.plan.drones[drone].fleet.is_some() || self.progress.revision == 0;
            if needs && self.drones[drone].lost.is_none() {
                self.commission(drone, mission);
            }
        }
        // Not before: the key makes mates forget whom they heard in a place of the fleet that another has now.
        self.hand_out_fleet_keys();
    }

    /// Uploads what a drone has to know: its home and the walls, and with a fleet its lanes.
    pub(super) fn commission(&mut self, drone: usize, mission: MissionId) {
        let (plan, planned) = (&self.plan, &self.plan.drones[drone]);
        let fleet = planned.fleet.map(|(index, _)| &plan.fleets[index]);
        let point_mm = |p: &V2| [(p.x * 1e3).round() as i32, (p.y * 1e3).round() as i32];
        let mut waypoints: Vec<[i32; 2]> =
            fleet.map_or_else(Vec::new, |f| f.waypoints_m.iter().map(point_mm).collect());
        waypoints.extend(&plan.walls_mm);
        let header = MissionHeader {
            mission,
            fleet: planned.fleet.map(|(index, _)| FleetId(index as u16)),
            mates: fleet.map_or([DroneId::CONTROL; 3], |f| f.mates),
            slot: planned.fleet.map_or(0, |(_, slot)| slot),
            spacing_mm: (plan.spacing_m * 1e3) as u32,
            heading: plan.heading,
            orientation_mrad: (plan.orientation_rad * 1e3).round() as i16,
            speed_mmps: (plan.speed_mps * 1e3) as u16,
            altitude_mm: (plan.altitude_m * 1e3) as u32,
            home: PosEnuMm(planned.pad_m.map(|m| mm_from_m(m as f32)).into()),
            waypoints: waypoints.len() as u16,
            d_safe_mm: (plan.d_safe_m * 1e3) as u16,
            walls: (plan.walls_mm.len() / WAYPOINTS_PER_WALL) as u16,
            vertical: plan.vertical,
        };
        self.drones[drone].upload(header, waypoints);
    }

    /// Drones of a fleet talk to each other under a key of their own.
    fn hand_out_fleet_keys(&mut self) {
        if !self.plan.keys.is_sealed() {
            return;
        }
        for fleet in &self.plan.fleets {
            let key = self.plan.keys.fresh();
            let mates = self.drones.iter_mut().filter(|drone| fleet.mates.contains(&drone.id));
            for drone in mates.filter(|drone| drone.lost.is_none()) {
                drone.command(Command::PeerKey(key.clone()));
            }
        }
    }
}
