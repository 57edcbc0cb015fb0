//! From estimates to drones at their places: who serves where, how they get there, and what is better a few metres off.

use super::{
    ControlCenter, MissionError, Station, Target,
    drone::place_at,
    goals::{GoalConflict, conflict},
    refine::{Refinement, Seen},
};
use crate::{
    control::{
        airspace::KeepOut,
        assign::assign,
        localize::{FixStatus, localize},
        place::{Fleet, Placement, UserBelief, place_expected},
    },
    geometry::V2,
};
use nalgebra::Matrix2;
use skyroost_protocol::{
    message::{Attached, Command, FlightPhase},
    units::{TimePs, UserId},
};

impl ControlCenter {
    /// Stage two of the paper: estimates of all users, then a placement for every drone.
    pub(super) fn locate_and_place(&mut self, now: TimePs) -> Result<(), MissionError> {
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
    fn assign_targets(&self, now: TimePs, placement: &Placement) -> Vec<Target> {
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

    pub(super) fn longest_flight_m(&self) -> f64 {
        let way_m = |t: &Target| t.station.map(|s| (s.pos_m - self.drone_pos_m(t.drone)).norm());
        self.targets.iter().filter_map(way_m).fold(0.0, f64::max) + 10_000.0
    }

    /// Sends every drone that is ready to its site, or home, from corner to corner around obstacles: reserves climb
    /// first.
    pub(super) fn send_off(&mut self, now: TimePs) {
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

    pub(super) fn deployed(&self, now: TimePs) -> bool {
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

    pub(super) fn begin_refining(&mut self, now: TimePs) {
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
    pub(super) fn refined(&mut self, now: TimePs) -> Result<bool, GoalConflict> {
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

#[cfg(test)]
mod tests;
