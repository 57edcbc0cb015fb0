//! From stage to stage: what each waits for, what it begins with, how long it may take.

use super::{
    ControlCenter, MissionError, Stage, Station, Target,
    drone::{DroneLink, place_at},
    goals::{GoalConflict, conflict},
    refine::{Refinement, Seen},
};
use crate::{
    control::{
        airspace::KeepOut,
        assign::assign,
        localize::{FixStatus, localize},
        place::{Fleet, UserBelief, place_expected},
    },
    geometry::V2,
};
use nalgebra::Matrix2;
use skyroost_protocol::{
    message::{Attached, Command, FlightPhase, MissionHeader, WAYPOINTS_PER_WALL},
    units::{DroneId, FleetId, MissionId, PosEnuMm, TimePs, UserId, mm_from_m},
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

    /// Stage two of the paper: estimates of all users, then a placement for every drone.
    fn locate_and_place(&mut self, now: TimePs) -> Result<(), MissionError> {
        self.localization = localize(&self.occasions, &self.plan.localize)?;
        self.localization.grow(now.0 as f64 * 1e-12, &self.plan.localize);
        self.located_at = Some(now);
        let beliefs: Vec<UserBelief> = self.beliefs().map(|(_, belief)| belief).collect();
        let living = self.living();
        let drones = living.len();
        (self.placed_for, self.misplaced_since) = (living, None);
        self.legs.iter_mut().for_each(|leg| *leg = None);
        self.refinement = None;
        if drones == 0 {
            return Err(MissionError::NobodyLeft);
        }
        let fleet = Fleet { drones, min_separation_m: self.plan.min_goal_distance_m };
        let placement = place_expected(&beliefs, self.plan.radius_m, fleet)?;
        self.targets = self.assign_targets(now, &placement);
        self.check_goals()?;
        self.placement = Some(placement);
        Ok(())
    }

    /// Users that were located.
    fn beliefs(&self) -> impl Iterator<Item = (UserId, UserBelief)> {
        self.localization.users.iter().filter(|fix| fix.status == FixStatus::Ok).map(|fix| {
            let [[xx, xy], [yx, yy]] = fix.cov_m2;
            (fix.user, UserBelief { pos_m: fix.pos_m.into(), cov_m2: Matrix2::new(xx, xy, yx, yy) })
        })
    }

    /// Which drone flies where, so that the longest flight is the shortest possible.
    fn assign_targets(&self, now: TimePs, placement: &crate::control::place::Placement) -> Vec<Target> {
        let living = self.living();
        let from: Vec<V2> = living.iter().map(|&d| self.drone_pos_m(d)).collect();
        let planned = placement.sites.iter().enumerate();
        let planned = planned.filter_map(|(index, site)| Some((index, site.as_ref()?.pos_m)));
        let (indices, asked_m): (Vec<usize>, Vec<V2>) = planned.unzip();
        // A site where no drone may be is moved to the nearest place where one may.
        let apart_m = self.plan.min_goal_distance_m;
        let settled = |keep_out: &[KeepOut]| -> Vec<(usize, V2)> {
            let settled = self.plan.airspace.settled(&asked_m, apart_m, keep_out);
            indices.iter().copied().zip(settled).filter_map(|(index, at)| Some((index, at?))).collect()
        };
        let mut keep_out = self.lost_places(now);
        let mut sites = settled(&keep_out);
        let goals = |sites: &[(usize, V2)]| sites.iter().map(|(_, pos_m)| *pos_m).collect::<Vec<V2>>();
        let mut chosen = assign(&from, &goals(&sites));
        // Nobody serves above the pad that another one lands on: they would push each other down.
        let pad =
            |&drone: &usize| KeepOut { centre_m: self.plan.drones[drone].pad_m.xy(), radius_m: apart_m };
        let home = living.iter().enumerate().filter(|(place, _)| !chosen.contains(place));
        let pads: Vec<KeepOut> = home.map(|(_, drone)| pad(drone)).collect();
        if sites.iter().any(|(_, at)| pads.iter().any(|pad| !pad.allows(*at))) {
            keep_out.extend(living.iter().map(pad)); // whoever goes home then
            sites = settled(&keep_out);
            chosen = assign(&from, &goals(&sites));
        }
        let station_of = |place: usize| {
            let (site, pos_m) = sites[chosen.iter().position(|&d| d == place)?];
            Some(Station { site, pos_m })
        };
        let targets = living.iter().enumerate();
        targets.map(|(place, &drone)| Target { drone, station: station_of(place) }).collect()
    }

    /// Refuses goals that cannot all be held.
    fn check_goals(&self) -> Result<(), GoalConflict> {
        let goals: Vec<_> =
            self.stations().map(|(drone, pos_m)| (self.plan.drones[drone].id, pos_m)).collect();
        conflict(&goals, self.plan.d_plan_m).map_or(Ok(()), Err)
    }

    fn longest_flight_m(&self) -> f64 {
        let way_m = |t: &Target| t.station.map(|s| (s.pos_m - self.drone_pos_m(t.drone)).norm());
        self.targets.iter().filter_map(way_m).fold(0.0, f64::max) + 10_000.0
    }

    /// Sends every drone that is ready to its site, or home, from corner to corner around obstacles: reserves climb
    /// first.
    fn send_off(&mut self, now: TimePs) {
        let (plan, mut forgetful, mut stuck) = (&self.plan, Vec::new(), Vec::new());
        for target in &self.targets() {
            let from_m = self.drone_pos_m(target.drone);
            let (drone, leg) = (&mut self.drones[target.drone], &mut self.legs[target.drone]);
            let goal_m = target.station.map_or(plan.drones[target.drone].pad_m.xy(), |station| station.pos_m);
            if let Some(short_of) = drone.stays_short(now) {
                // Somebody keeps it from its place for good.
                if leg.is_some_and(|leg| (leg - short_of).norm() < 0.01) && target.station.is_some() {
                    stuck.push((target.drone, from_m));
                }
            }
            // Something keeps it from going on: there may be another way from where it stands.
            let barred = |leg: &Option<V2>| {
                drone.stands() && leg.is_some_and(|leg_m| !plan.airspace.is_free(from_m, leg_m))
            };
            let phase = drone.phase(now);
            // Its board started anew: it does not know where home is.
            if phase.is_some() && drone.telemetry.is_some_and(|t| t.mission.is_none()) {
                forgetful.push(target.drone);
                continue;
            }
            let ready = match phase {
                Some(FlightPhase::Grounded) if target.station.is_some() => {
                    drone.command(Command::TakeOff);
                    false
                }
                Some(FlightPhase::Hold) => true,
                Some(FlightPhase::Serve) => *leg != Some(goal_m),
                // Without a leg it is on a way that an earlier stage gave it, and need not get there.
                Some(FlightPhase::GoTo) => leg.is_none() || barred(leg),
                _ => false,
            };
            if ready {
                let next_m = plan.airspace.next_m(from_m, goal_m);
                *leg = Some(next_m);
                let home = target.station.is_none() && next_m == goal_m;
                drone.command(if home { Command::ReturnHome } else { place_at(next_m, plan.altitude_m) });
            }
        }
        for (drone, here_m) in stuck {
            self.serve_near(drone, here_m, now);
        }
        for drone in forgetful {
            self.plan.drones[drone].fleet = None;
            self.commission(drone, self.mission());
        }
    }

    /// Has a drone serve from the nearest place to where it is, rather than from its site, that leaves room for who else is there.
    fn serve_near(&mut self, drone: usize, here_m: V2, now: TimePs) {
        let apart_m = self.plan.min_goal_distance_m;
        let others =
            self.living().into_iter().filter(|&other| other != drone).map(|other| self.drone_pos_m(other));
        let stations = self.stations().filter(|&(other, _)| other != drone).map(|(_, pos_m)| pos_m);
        let mut keep_out: Vec<KeepOut> =
            others.chain(stations).map(|centre_m| KeepOut { centre_m, radius_m: apart_m }).collect();
        keep_out.extend(self.lost_places(now));
        let at_m = self.plan.airspace.settled(&[here_m], apart_m, &keep_out)[0].unwrap_or(here_m);
        let targets = self.targets.iter_mut().filter(|target| target.drone == drone);
        targets.filter_map(|target| target.station.as_mut()).for_each(|station| station.pos_m = at_m);
        let next_m = self.plan.airspace.next_m(here_m, at_m);
        self.legs[drone] = Some(next_m);
        self.drones[drone].command(place_at(next_m, self.plan.altitude_m));
    }

    fn deployed(&self, now: TimePs) -> bool {
        self.targets().iter().all(|target| {
            let phase = self.drones[target.drone].phase(now);
            match target.station {
                Some(station) => {
                    phase == Some(FlightPhase::Serve) && self.legs[target.drone] == Some(station.pos_m)
                }
                None => phase == Some(FlightPhase::Grounded),
            }
        })
    }

    /// Drones that serve and where, in the refinement's order.
    fn stations(&self) -> impl Iterator<Item = (usize, V2)> {
        self.targets.iter().filter_map(|t| Some((t.drone, t.station?.pos_m)))
    }

    fn begin_refining(&mut self, now: TimePs) {
        self.targets = self.targets();
        let sites_m: Vec<V2> = self.stations().map(|(_, pos_m)| pos_m).collect();
        let plan = &self.plan;
        let refinement =
            Refinement::new(now, &sites_m, self.beliefs(), plan.radius_m, plan.min_goal_distance_m);
        self.refinement = Some(refinement);
    }

    /// A page of users heard counts where its drone serves.
    pub(super) fn heard_at_station(&mut self, drone: usize, page: &Attached) {
        let station = self.stations().position(|(d, _)| d == drone);
        let at_m = self.drone_pos_m(drone);
        if let (Some(refinement), Some(station)) = (&mut self.refinement, station) {
            refinement.page(station, page, at_m);
        }
    }

    /// Moves drones where that promises more; true when there is nothing left to win.
    fn refined(&mut self, now: TimePs) -> Result<bool, GoalConflict> {
        let Some(mut refinement) = self.refinement.take() else { return Ok(true) };
        let seen = |(drone, _): (usize, V2)| match self.drones[drone].phase(now) {
            _ if self.drones[drone].lost.is_some() => Seen::Left,
            Some(FlightPhase::Serve) => Seen::Serving(self.drone_pos_m(drone)),
            Some(FlightPhase::GoTo) | None => Seen::UnderWay,
            Some(_) => Seen::Left,
        };
        let seen: Vec<Seen> = self.stations().map(seen).collect();
        let lost = self.lost_places(now);
        let mut stations: Vec<(usize, &mut Station)> =
            self.targets.iter_mut().filter_map(|t| Some((t.drone, t.station.as_mut()?))).collect();
        let airspace = &self.plan.airspace;
        let free = |from_m: V2, to_m: V2| {
            airspace.allows(to_m) && airspace.is_free(from_m, to_m) && lost.iter().all(|it| it.allows(to_m))
        };
        let done = refinement.step(now, &seen, free, |station, to_m| {
            let (drone, station) = &mut stations[station];
            station.pos_m = to_m;
            self.drones[*drone].command(place_at(to_m, self.plan.altitude_m));
        });
        if !done {
            self.refinement = Some(refinement);
        }
        self.check_goals()?;
        Ok(done)
    }
}
