//! Drones fall out and come back: who still flies the sweep, how far it has come, and when it is planned anew.
//!
//! A fleet is broken when one of its drones has been silent for 15 s, turned home by itself, lost its memory or
//! captures nothing any more. Then everybody stops, what is left of the area is [regrouped](crate::control::regroup), the new
//! lanes are uploaded, and the sweep goes on from wherever the drones are. Users located so far stay located.

use super::{ControlCenter, MissionError, Stage, drone::DroneLink, pos_m};
use crate::{
    control::{
        airspace::KeepOut,
        regroup::{self, Regrouped, Survivor},
        srs_schedule::FleetSchedule,
    },
    geometry::{V2, coverage::Stadium, region::Region},
};
use skyroost_protocol::{
    message::{Command, FlightPhase, Telemetry},
    units::{DroneId, MissionId, TimePs},
};

/// A drone of a fleet that has been silent for so long is flown on without. Longer silences are rare, and stopping all for
/// nothing costs a minute.
const GIVE_UP_AFTER: TimePs = TimePs::from_ms(15_000);
/// All that can stop have stopped by then.
const HALT_FOR: TimePs = TimePs::from_ms(60_000);
/// So long drones that were lost are waited for where too few are left for a fleet.
const WAIT_FOR: TimePs = TimePs::from_ms(180_000);
/// The sweep is planned anew so often at most for each drone, and some: whatever goes on breaking it will not stop.
const MOST_PLANS_PER_DRONE: u16 = 2;
const MOST_PLANS_MORE: u16 = 6;
/// Charge below which nobody joins a sweep or serves, per mille: some above the return.
pub(super) const LEAST_PERMILLE: u16 = 200;
/// Charge at which a drone's own supervisor has it return, per mille.
const RETURN_PERMILLE: u16 = 150;
/// Arrival times of a fleet in which one captured nothing say nothing for this long before it was told: the warning's and the
/// condition's own times (supervisor table), and a telemetry.
const UNHEARD_FOR: TimePs = TimePs::from_ms(65_000);

/// How long a silent neighbour is taken to fly on as it did, and then on until its own supervisor makes it hold, seconds.
const LOST_FRESH_S: f64 = 2.0;
const LOST_FLIES_S: f64 = 10.0;
/// By then its own supervisor has it return home.
const LOST_FOR: TimePs = TimePs::from_ms(75_000);
/// How far it may have drifted then, metres.
const LOST_DRIFTS_M: f64 = 20.0;
/// Beside all that some room, metres.
const LOST_ROOM_M: f64 = 3.0;

/// Bits of the supervisor's conditions, as `docs/supervisor.md` numbers them.
mod bit {
    pub(super) const LINK_LOST: u32 = 1 << 1;
    pub(super) const LINK_GONE: u32 = 1 << 2;
    pub(super) const NAVIGATION_LOST: u32 = 1 << 3;
    pub(super) const BATTERY_LOW: u32 = 1 << 4;
    pub(super) const BATTERY_CRITICAL: u32 = 1 << 5;
    pub(super) const CLOCK_USELESS: u32 = 1 << 9;
    pub(super) const NAVIGATION_GONE: u32 = 1 << 11;
    pub(super) const FENCE_CROSSED: u32 = 1 << 13;
    pub(super) const WIND_BEYOND: u32 = 1 << 15;
    pub(super) const CAPTURES_GONE: u32 = 1 << 17;
}

/// Under these a drone does as its supervisor says.
const UNFIT: u32 = bit::LINK_LOST
    | bit::LINK_GONE
    | bit::NAVIGATION_LOST
    | bit::NAVIGATION_GONE
    | bit::BATTERY_LOW
    | bit::BATTERY_CRITICAL
    | bit::FENCE_CROSSED
    | bit::WIND_BEYOND;
/// Under these it flies and serves, but what it measures is worth nothing.
const DEAF: u32 = bit::CLOCK_USELESS | bit::CAPTURES_GONE;

/// A sweep that was planned anew.
#[derive(Clone, Debug, PartialEq)]
pub struct Replan {
    /// When all were told to stop.
    pub at: TimePs,
    /// Whose fleets were broken, and by whom.
    pub broken_by: Vec<DroneId>,
    /// Users that are looked for again, as they have walked on.
    pub users_gone: usize,
    /// Fleets that fly on; none where nobody could.
    pub fleets: usize,
    /// What was left of the area, square metres.
    pub left_m2: f64,
    /// When the lanes would have been flown without it, as far as planned.
    pub end_before: Option<TimePs>,
    /// When they will be, from the start of the new lanes on.
    pub end_after: Option<TimePs>,
}

/// How a sweep fares.
#[derive(Debug, Default)]
pub(super) struct Progress {
    /// How often it was planned anew.
    pub(super) revision: u16,
    /// What earlier plans covered.
    swept: Vec<Stadium>,
    /// Of each fleet: how far all three of it had come along its lanes, and when; millimetres.
    came_mm: Vec<Vec<(TimePs, i64)>>,
    /// When the lanes will be flown.
    pub(super) ends: Option<TimePs>,
    /// Drones told to stop for the plan to come.
    told: Vec<bool>,
    /// Drones that the present plan could count on, whether it has a place for them or not.
    counted: Vec<usize>,
    /// Something is left over even when all lanes are flown.
    cut_off: bool,
    /// All plans but the first.
    pub(super) replans: Vec<Replan>,
    /// How often users that walk were looked for again, how many the next time, and where: of the area what has been flown
    /// too long ago for them.
    pub(super) revisits: u16,
    pub(super) gone: usize,
    pub(super) expired: Option<Region>,
}

impl Progress {
    /// How far the fleets have come along their lanes, and when.
    pub(super) fn came_mm(&self) -> &[Vec<(TimePs, i64)>] {
        &self.came_mm
    }

    /// Whatever was covered is to be covered again.
    pub(super) fn forget_swept(&mut self) {
        self.came_mm.clear();
        self.swept.clear();
    }
}

impl ControlCenter {
    /// The number of the mission that drones have now: every plan is one of its own.
    pub(super) fn mission(&self) -> MissionId {
        MissionId(1 + self.progress.revision)
    }

    /// How often the sweep was planned anew.
    #[must_use]
    pub fn revision(&self) -> u16 {
        self.progress.revision
    }

    /// All plans of the sweep but the first.
    #[must_use]
    pub fn replans(&self) -> &[Replan] {
        &self.progress.replans
    }

    /// A drone's link; mostly drones are numbered as they are listed.
    fn link(&self, id: DroneId) -> Option<&DroneLink> {
        let listed = self.drones.get(usize::from(id.0).wrapping_sub(1)).filter(|link| link.id == id);
        listed.or_else(|| self.drones.iter().find(|link| link.id == id))
    }

    /// Whether no drone of a fleet has left its lanes, by their last words; at their end they hold.
    #[must_use]
    pub fn is_whole(&self, fleet: usize) -> bool {
        let mates = self.plan.fleets[fleet].mates;
        mates.iter().all(|mate| {
            let link = self.link(*mate);
            let stays = |phase| matches!(phase, FlightPhase::Sweep | FlightPhase::Hold | FlightPhase::Serve);
            link.is_some_and(|link| link.lost.is_none() && link.said_phase.is_some_and(stays))
        })
    }

    /// Notes how far a fleet has come, as its drones' telemetry says.
    pub(super) fn came(&mut self, drone: usize, now: TimePs) {
        let (Some((fleet, _)), Some(started)) = (self.plan.drones[drone].fleet, self.sweep_started) else {
            return;
        };
        if self.stage != Stage::Sweep {
            return;
        }
        let mission = self.mission();
        let way_mm = |link: &DroneLink| {
            let known = link.telemetry.filter(|t| t.mission == Some(mission) && t.time >= started);
            known.map(|t| i64::from(t.sweep_phase_mm))
        };
        let mates = self.plan.fleets[fleet].mates;
        let [Some(a), Some(b), Some(c)] = mates.map(|mate| self.link(mate).and_then(way_mm)) else { return };
        let least_mm = a.min(b).min(c);
        self.progress.came_mm.resize(self.plan.fleets.len(), Vec::new());
        let came = &mut self.progress.came_mm[fleet];
        if came.last().is_none_or(|(_, before_mm)| *before_mm < least_mm) {
            came.push((now, least_mm));
        }
    }

    /// Whether a drone can be told to fly.
    fn is_fit(link: &DroneLink) -> bool {
        let sound = |t: &Telemetry| t.conditions & UNFIT == 0 && t.battery_permille >= LEAST_PERMILLE;
        link.connected && link.lost.is_none() && link.telemetry.as_ref().is_some_and(sound)
    }

    /// Whether a drone can serve.
    pub(super) fn can_serve(&self, drone: usize) -> bool {
        Self::is_fit(&self.drones[drone])
    }

    /// Whether a drone can fly a sweep.
    fn can_sweep(&self, drone: usize) -> bool {
        self.can_serve(drone) && !self.drones[drone].deaf
    }

    /// Drones by whom their fleets are broken.
    fn breakers(&self, now: TimePs) -> Vec<DroneId> {
        let aloft = self.stage >= Stage::Assemble;
        let mission = self.mission();
        let breaks = |link: &&DroneLink| {
            if let Some(since) = link.lost {
                return now.since(since) >= GIVE_UP_AFTER || !link.in_the_air();
            }
            if link.deaf {
                return true;
            }
            if !link.idle() || self.stage == Stage::Upload {
                return false;
            }
            let Some(telemetry) = link.telemetry.filter(|t| t.time > link.accepted()) else { return false };
            let left = match telemetry.phase {
                FlightPhase::ReturnHome | FlightPhase::Landing => true,
                FlightPhase::Grounded => aloft,
                // It was not ready for the start, and refused it.
                FlightPhase::TakeOff | FlightPhase::GoTo | FlightPhase::Serve => {
                    self.stage == Stage::Sweep && self.sweep_started.is_some_and(|at| telemetry.time > at)
                }
                FlightPhase::Hold | FlightPhase::Sweep => false,
            };
            left || telemetry.mission != Some(mission)
        };
        self.every_member().filter(breaks).map(|link| link.id).collect()
    }

    /// The lanes begin at `at`: when they will be flown.
    pub(super) fn book_start(&mut self, at: TimePs) {
        let longest_m = self.plan.longest_m();
        let ends = at.after(TimePs((1e12 * longest_m / self.plan.speed_mps) as i64));
        self.progress.ends = Some(ends);
        if let Some(replan) = self.progress.replans.last_mut().filter(|it| it.end_after.is_none()) {
            replan.end_after = Some(ends);
        }
    }

    /// Has everybody stop for a new plan where a fleet is broken.
    ///
    /// # Errors
    /// Where the plan cannot be made anew: a drone that left by itself ends the mission.
    pub(super) fn mend(&mut self, now: TimePs) -> Result<bool, MissionError> {
        for link in self.drones.iter_mut().filter(|link| !link.deaf && link.conditions() & DEAF != 0) {
            (link.deaf, link.deaf_since) = (true, Some(now));
        }
        let broken_by = self.breakers(now);
        if broken_by.is_empty() && !self.has_company(now) {
            return Ok(false);
        }
        if self.plan.resweep.is_none() {
            return self.check_sweepers(now).map(|()| false);
        }
        if !self.may_replan() {
            // Whatever keeps breaking fleets will not stop: what is known is used.
            self.note_replan(now, broken_by);
            self.plan.drones.iter_mut().for_each(|planned| planned.fleet = None);
            return self.enter(Stage::Collect, now).map(|()| true);
        }
        self.halt(now, broken_by)?;
        Ok(true)
    }

    /// Whether the sweep can be planned anew once more.
    pub(super) fn may_replan(&self) -> bool {
        let most = MOST_PLANS_PER_DRONE * self.drones.len() as u16 + MOST_PLANS_MORE;
        self.plan.resweep.is_some() && self.progress.revision < most
    }

    /// Drones that do not get to where they are to assemble.
    pub(super) fn stuck_in_assembly(&mut self, now: TimePs) -> Vec<DroneId> {
        let drones =
            self.plan.drones.iter().zip(&mut self.drones).filter(|(planned, _)| planned.fleet.is_some());
        drones.filter_map(|(_, link)| link.stays_short(now).map(|_| link.id)).collect()
    }

    /// Whether three drones that sweep nothing could.
    fn has_company(&self, now: TimePs) -> bool {
        let idle = |&drone: &usize| {
            let link = &self.drones[drone];
            let ready = matches!(
                link.phase(now),
                Some(FlightPhase::Grounded | FlightPhase::Hold | FlightPhase::Serve)
            );
            self.plan.drones[drone].fleet.is_none() && ready && self.can_sweep(drone)
        };
        let spare: Vec<usize> = (0..self.drones.len()).filter(idle).collect();
        // Those that the plan has no place for are no company; with one that came back they are.
        let came_back = |drone: &usize| !self.progress.counted.contains(drone);
        self.progress.revision > 0 && spare.len() >= 3 && spare.iter().any(came_back)
    }

    /// Plans anew for what the lanes did not hold, once they are flown.
    pub(super) fn is_something_left(&self) -> bool {
        self.progress.cut_off && self.may_replan()
    }

    pub(super) fn halt(&mut self, now: TimePs, broken_by: Vec<DroneId>) -> Result<(), MissionError> {
        self.note_replan(now, broken_by);
        self.enter(Stage::Halt, now)
    }

    /// Nobody flies on before there is a plan.
    fn note_replan(&mut self, at: TimePs, broken_by: Vec<DroneId>) {
        let (users_gone, end_before) = (std::mem::take(&mut self.progress.gone), self.progress.ends);
        let none = Replan { at, broken_by, users_gone, fleets: 0, left_m2: 0.0, end_before, end_after: None };
        self.progress.replans.push(none);
    }

    /// Tells all that fly to stop, once each.
    pub(super) fn begin_halt(&mut self) {
        self.progress.told = vec![false; self.drones.len()];
        self.ask_no_more();
        for link in &mut self.drones {
            // What the drones of a plan that is no more were to do.
            link.forget_commands();
        }
    }

    /// Once all that can have stopped: the rest is planned, and what comes next.
    pub(super) fn halted(&mut self, now: TimePs) -> Option<Stage> {
        let waited = now.since(self.stage_since);
        let mut all_stand = true;
        for drone in 0..self.drones.len() {
            if !self.can_sweep(drone) {
                continue;
            }
            let link = &mut self.drones[drone];
            match link.said_phase {
                None | Some(FlightPhase::Grounded | FlightPhase::Landing) => {}
                Some(FlightPhase::Hold) if link.idle() => {}
                _ if !self.progress.told[drone] => {
                    self.progress.told[drone] = true;
                    link.command(Command::Hold);
                    all_stand = false;
                }
                _ => all_stand = false,
            }
        }
        if !all_stand && waited < HALT_FOR {
            return None;
        }
        let ready = |&drone: &usize| {
            let link = &self.drones[drone];
            self.can_sweep(drone)
                && link.idle()
                && matches!(link.said_phase, Some(FlightPhase::Grounded | FlightPhase::Hold))
        };
        let survivors: Vec<Survivor> = (0..self.drones.len())
            .filter(ready)
            .map(|drone| Survivor {
                drone,
                pos_m: self.drone_pos_m(drone),
                charge_permille: self.drones[drone]
                    .telemetry
                    .map_or(0, |t| t.battery_permille.saturating_sub(RETURN_PERMILLE)),
            })
            .collect();
        let anybody_lost = self.drones.iter().any(|link| link.lost.is_some());
        if survivors.len() < 3 && anybody_lost && waited < WAIT_FOR {
            return None;
        }
        Some(self.replan(now, &survivors))
    }

    /// Plans the rest of the sweep for the survivors: what comes next.
    fn replan(&mut self, now: TimePs, survivors: &[Survivor]) -> Stage {
        self.book_swept();
        self.progress.counted = survivors.iter().map(|it| it.drone).collect();
        let Some(again) = self.plan.resweep.take() else { return Stage::Collect };
        let region = self.progress.expired.as_ref().unwrap_or(&again.region);
        let left = regroup::left(region, &self.progress.swept, again.request.margin_m);
        let whole: Vec<[usize; 3]> =
            self.plan.fleets.iter().filter_map(|fleet| self.indices(fleet.mates)).collect();
        let threes = regroup::threes(&whole, survivors);
        let lost = self.lost_places(now);
        let regrouped =
            left.as_ref().and_then(|left| regroup::regroup(&self.plan, &again, left, threes, &lost));
        self.plan.resweep = Some(again);
        let left_m2 = left.as_ref().map_or(0.0, Region::area_m2);
        // Who fell out meanwhile, or before it was noticed that all three did.
        let stayed = |link: &DroneLink| survivors.iter().any(|it| self.drones[it.drone].id == link.id);
        let gone: Vec<DroneId> =
            self.every_member().filter(|link| !stayed(link)).map(|link| link.id).collect();
        if let Some(replan) = self.progress.replans.last_mut() {
            replan.broken_by.extend(gone);
            replan.broken_by.sort_unstable();
            replan.broken_by.dedup();
            (replan.left_m2, replan.fleets) = (left_m2, regrouped.as_ref().map_or(0, |it| it.fleets.len()));
        }
        self.plan.drones.iter_mut().for_each(|planned| planned.fleet = None);
        self.progress.revision += 1;
        let Some(regrouped) = regrouped else {
            self.progress.cut_off = false;
            return Stage::Collect;
        };
        let Regrouped { fleets, members, assembly, cut_off } = regrouped;
        for (drone, place) in members {
            self.plan.drones[drone].fleet = Some(place);
        }
        for fleet in &fleets {
            self.running.group(fleet.clock_group, fleet.mates.to_vec());
        }
        let mut before: Vec<FleetSchedule> = std::mem::take(&mut self.schedules);
        self.schedules = fleets
            .iter()
            .map(|fleet| {
                // Three that stay together still know whom they hear.
                let known = before.iter().position(|it| it.mates() == fleet.mates);
                known.map_or_else(
                    || FleetSchedule::new(fleet.clock_group, fleet.mates, self.plan.srs),
                    |index| before.swap_remove(index),
                )
            })
            .collect();
        self.plan.fleets = fleets;
        self.plan.assembly = Some(assembly);
        self.assembling = super::assembly::Assembling::default();
        self.sweep_started = None;
        self.progress.cut_off = cut_off;
        Stage::Upload
    }

    /// How far from its centre a fleet hears everybody with all three drones, metres.
    pub(super) fn swept_radius_m(&self) -> f64 {
        self.plan.radius_m - self.plan.spacing_m / 3f64.sqrt()
    }

    /// What the fleets have covered of the plan that is over.
    fn book_swept(&mut self) {
        let radius_m = self.swept_radius_m();
        let came_mm = std::mem::take(&mut self.progress.came_mm);
        for (fleet, came) in self.plan.fleets.iter().zip(came_mm) {
            let links = fleet.mates.iter().filter_map(|mate| self.link(*mate));
            let heard_until = links.filter_map(|link| link.deaf_since).min();
            let counts = |at: TimePs| heard_until.is_none_or(|deaf| at.after(UNHEARD_FOR) < deaf);
            let Some((_, way_mm)) = came.iter().rev().find(|(at, _)| counts(*at)) else { continue };
            let way_m = 0.0..*way_mm as f64 * 1e-3;
            self.progress.swept.extend(regroup::swept(&fleet.waypoints_m, way_m, radius_m));
        }
    }

    /// Where lost drones may be, with the room that avoidance takes around them: as its own table of neighbours has it once they have
    /// been silent for long, half the way that they may have flown on, and drift (`firmware::peers`). In the end their own supervisors
    /// have taken them away from there.
    pub(super) fn lost_places(&self, now: TimePs) -> Vec<KeepOut> {
        let place = |link: &DroneLink| {
            let state = link.state.filter(|_| link.lost.is_some() && link.in_the_air())?;
            if now.since(state.time) >= LOST_FOR {
                return None;
            }
            let vel_mps = V2::new(f64::from(state.vel.0[0]), f64::from(state.vel.0[1])) * 1e-3;
            let radius_m =
                0.5 * vel_mps.norm() * LOST_FLIES_S + LOST_DRIFTS_M + self.plan.min_goal_distance_m;
            let centre_m = pos_m(&state.pos).xy() + vel_mps * (LOST_FRESH_S + 0.5 * LOST_FLIES_S);
            Some(KeepOut { centre_m, radius_m: radius_m + LOST_ROOM_M })
        };
        self.drones.iter().filter_map(place).collect()
    }

    fn indices(&self, mates: [DroneId; 3]) -> Option<[usize; 3]> {
        let of = |mate: DroneId| self.plan.drones.iter().position(|planned| planned.id == mate);
        match mates.map(of) {
            [Some(a), Some(b), Some(c)] => Some([a, b, c]),
            _ => None,
        }
    }

    /// Drones that are left over from the fleets wait at home for the second stage: standing in the air costs as much as flying.
    /// Those that lost their memory get a mission of their own first.
    pub(super) fn send_spare_home(&mut self, now: TimePs) {
        let mission = self.mission();
        for drone in 0..self.drones.len() {
            if self.plan.drones[drone].fleet.is_some() || !self.can_serve(drone) {
                continue;
            }
            let Some(phase) = self.drones[drone].phase(now) else { continue };
            let knows_home = self.drones[drone].telemetry.is_some_and(|t| t.mission.is_some());
            if matches!(
                phase,
                FlightPhase::Hold | FlightPhase::Serve | FlightPhase::GoTo | FlightPhase::Sweep
            ) {
                if knows_home && phase != FlightPhase::Sweep {
                    self.drones[drone].command(Command::ReturnHome);
                } else if phase == FlightPhase::Sweep {
                    self.drones[drone].command(Command::Hold);
                } else {
                    self.commission(drone, mission);
                }
            }
        }
    }

    /// Where a drone is; one that never flew is on its pad.
    pub(super) fn drone_pos_m(&self, drone: usize) -> V2 {
        self.drones[drone].state.map_or(self.plan.drones[drone].pad_m, |s| pos_m(&s.pos)).xy()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skyroost_firmware::{config::SupervisorConfig, peers, supervisor::Condition};

    /// The control center knows of the flight code what crosses the wire: numbers, which have to be the same.
    #[test]
    fn what_is_known_of_the_flight_code_is_so() {
        for (known, condition) in [
            (bit::LINK_LOST, Condition::LinkLost),
            (bit::LINK_GONE, Condition::LinkGone),
            (bit::NAVIGATION_LOST, Condition::NavigationLost),
            (bit::BATTERY_LOW, Condition::BatteryLow),
            (bit::BATTERY_CRITICAL, Condition::BatteryCritical),
            (bit::CLOCK_USELESS, Condition::ClockUseless),
            (bit::NAVIGATION_GONE, Condition::NavigationGone),
            (bit::FENCE_CROSSED, Condition::FenceCrossed),
            (bit::WIND_BEYOND, Condition::WindBeyond),
            (bit::CAPTURES_GONE, Condition::CapturesGone),
        ] {
            assert_eq!(known, condition.bit(), "{condition:?}");
        }
        assert_eq!(RETURN_PERMILLE, SupervisorConfig::USUAL.battery_low_permille);
        assert!((LOST_FRESH_S as f32 - peers::FRESH.as_secs_f32()).abs() < 1e-6);
        assert!((LOST_FLIES_S as f32 - peers::FLIES_ON.as_secs_f32()).abs() < 1e-6);
        assert_eq!(LOST_FOR, peers::GONE);
        assert!((LOST_DRIFTS_M as f32 - peers::DRIFT_LIMIT_M).abs() < 1e-6);
    }
}
