//! Drones that talk to each other directly: a fleet, or one reserve alone.
//!
//! Between two words of the control center islands have nothing to do with each other, so they may
//! run on different cores; inside an island drones go in step.

use super::{
    CONTROL_STEPS,
    drone::{Desk, Drone, take_frames},
    links::Mail,
};
use crate::{
    fleet::BoardError,
    geometry::V3,
    world::{channel::Channel, grid::PointGrid, link::Link},
};
use skyroost_firmware::{
    STEP_S, STEP_US,
    io::{Inputs, Outputs, SrsGate},
};
use skyroost_protocol::{
    codec::MAX_FRAME,
    units::{DroneId, OccasionId, TimePs, UserId},
};
use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

/// What all islands share and none changes.
#[derive(Clone)]
pub(super) struct Surroundings {
    pub(super) channel: Channel,
    /// Where users are as of `at`.
    pub(super) users: PointGrid,
    pub(super) user_pos_m: Vec<V3>,
    /// Of users on foot the velocity from then on; empty where all stay.
    pub(super) user_vel_mps: Vec<V3>,
    pub(super) at: TimePs,
}

impl Surroundings {
    /// Where a user is at a time.
    fn user_m(&self, user: UserId, at: TimePs) -> Option<V3> {
        let index = user.0 as usize;
        let pos_m = *self.user_pos_m.get(index)?;
        let vel_mps = self.user_vel_mps.get(index).copied();
        Some(vel_mps.map_or(pos_m, |vel_mps| pos_m + vel_mps * (at.since(self.at).0 as f64 * 1e-12)))
    }
}

/// Drones with direct links among them.
pub(super) struct Island {
    pub(super) drones: Vec<Drone>,
    /// Link from drone `i` to drone `j` at `i * drones + j`; those from a drone to itself stay unused.
    pub(super) links: Vec<Link<MAX_FRAME>>,
    /// What the control center says in this window, to which drone of the island.
    pub(super) told: Mail,
    /// What arrives at the control center by its words of the next window, from which drone.
    pub(super) heard: Mail,
    /// The same, of somebody who only says that it is a drone.
    pub(super) forged: Mail,
    /// Granted transmissions to come.
    grants: Vec<SrsGate>,
    /// Captures that came late over a blocked path: the truth, for judging.
    pub(super) late: Vec<(OccasionId, DroneId)>,
    /// True positions after each step of the window, drone by drone.
    pub(super) positions_m: Vec<V3>,
    /// Where the time of timed windows went.
    pub(super) times: IslandTimes,
}

/// Where the wall-clock time of an island's timed windows went.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct IslandTimes {
    pub(super) world: Duration,
    pub(super) links: Duration,
    pub(super) agents: Duration,
}

impl IslandTimes {
    fn add(&mut self, other: Self) {
        self.world += other.world;
        self.links += other.links;
        self.agents += other.agents;
    }
}

/// Reads the clock only where that is wanted: a reading costs as much as a tenth of a step.
struct Stopwatch<const TIMED: bool> {
    last: Option<Instant>,
}

impl<const TIMED: bool> Stopwatch<TIMED> {
    fn start() -> Self {
        Self { last: TIMED.then(Instant::now) }
    }

    fn lap(&mut self, sum: &mut Duration) {
        if let Some(last) = &mut self.last {
            let now = Instant::now();
            *sum += now - *last;
            *last = now;
        }
    }
}

impl Island {
    pub(super) fn new(drones: Vec<Drone>, links: Vec<Link<MAX_FRAME>>) -> Self {
        assert_eq!(links.len(), drones.len() * drones.len(), "a link for every ordered pair");
        Self {
            drones,
            links,
            told: Mail::default(),
            heard: Mail::default(),
            forged: Mail::default(),
            grants: Vec::new(),
            late: Vec::new(),
            positions_m: Vec::new(),
            times: IslandTimes::default(),
        }
    }

    /// Takes islands apart and puts their drones together anew, by `members` (drones by id); every drone is in one of them. Pairs that
    /// stay together keep their links and others get `link` of their ids; what drones were told and have not heard yet goes
    /// with them. Between windows nothing else is under way but transmissions that were granted, which all hear that listen for them.
    pub(super) fn regrouped(
        islands: Vec<Self>,
        members: &[Vec<DroneId>],
        mut link: impl FnMut(DroneId, DroneId) -> Link<MAX_FRAME>,
    ) -> Vec<Self> {
        let (mut drones, mut links) = (BTreeMap::new(), BTreeMap::new());
        let (mut told, mut granted, mut late) = (Vec::new(), Vec::new(), Vec::new());
        let mut times = IslandTimes::default();
        for island in islands {
            let ids: Vec<DroneId> = island.drones.iter().map(|drone| drone.id).collect();
            let pairs = ids.iter().flat_map(|from| ids.iter().map(move |to| (*from, *to)));
            links.extend(pairs.zip(island.links));
            let mail = island.told.frames();
            told.extend(mail.map(|(at_us, to, frame)| (at_us, ids[usize::from(to)], frame.to_vec())));
            granted.extend(island.grants.iter().map(|gate| (ids.clone(), *gate)));
            late.extend(island.late);
            times.add(island.times);
            drones.extend(ids.into_iter().zip(island.drones));
        }
        let mut regrouped = Vec::with_capacity(members.len());
        for ids in members {
            let own = ids.iter().map(|id| drones.remove(id).expect("a drone is in one island")).collect();
            let pairs = ids.iter().flat_map(|from| ids.iter().map(move |to| (*from, *to)));
            let own_links = pairs.map(|pair| links.remove(&pair).unwrap_or_else(|| link(pair.0, pair.1)));
            let mut island = Self::new(own, own_links.collect());
            for (at_us, to, frame) in &told {
                if let Some(member) = ids.iter().position(|id| id == to) {
                    island.told.push(*at_us, member as u16, frame);
                }
            }
            let hears = |before: &Vec<DroneId>| before.iter().any(|id| ids.contains(id));
            island.grants.extend(granted.iter().filter(|(before, _)| hears(before)).map(|(_, gate)| *gate));
            regrouped.push(island);
        }
        assert!(drones.is_empty(), "every drone is in an island");
        if let Some(first) = regrouped.first_mut() {
            (first.late, first.times) = (late, times);
        }
        regrouped
    }

    /// Steps `first..first + count`, on these desks or as many as it takes, and takes off the links what is due in as many after; with `TIMED` says where the
    /// time goes.
    pub(super) fn run<const TIMED: bool>(
        &mut self,
        first: u64,
        count: u64,
        around: &Surroundings,
        desks: &mut Vec<Desk>,
    ) -> Result<(), BoardError> {
        let members = self.drones.len();
        desks.resize_with(members.max(desks.len()), Desk::default);
        let desks = &mut desks[..members];
        self.positions_m.clear();
        let mut watch = Stopwatch::<TIMED>::start();
        for (at_us, to, frame) in self.told.frames() {
            self.drones[usize::from(to)].downlink.send(at_us, frame);
        }
        self.told.clear();
        watch.lap(&mut self.times.links);
        for step in first..first + count {
            let now_us = step * STEP_US as u64;
            for (drone, desk) in self.drones.iter_mut().zip(&mut *desks) {
                drone.sense(step, &around.users, &around.user_pos_m, &mut desk.inputs);
            }
            watch.lap(&mut self.times.world);
            for (receiver, desk) in desks.iter_mut().enumerate() {
                self.drones[receiver].receive(now_us, &mut desk.inputs);
                self.deliver(receiver, now_us, &mut desk.inputs);
            }
            watch.lap(&mut self.times.links);
            // All begin before any ends: boards of their own work at the same time.
            for (drone, desk) in self.drones.iter_mut().zip(&mut *desks) {
                drone.begin_step(step, desk)?;
            }
            for (drone, desk) in self.drones.iter_mut().zip(&mut *desks) {
                drone.end_step(&mut desk.outputs)?;
            }
            watch.lap(&mut self.times.agents);
            for (sender, desk) in desks.iter().enumerate() {
                self.drones[sender].send(now_us, &desk.outputs);
                self.broadcast(sender, now_us, &desk.outputs);
            }
            watch.lap(&mut self.times.links);
            self.transmit(now_us, around);
            for (drone, desk) in self.drones.iter_mut().zip(&*desks) {
                drone.fly(&desk.outputs.setpoint);
                self.positions_m.push(drone.vehicle.pos_enu_m());
            }
            watch.lap(&mut self.times.world);
        }
        self.listen(first + count, count);
        watch.lap(&mut self.times.links);
        Ok(())
    }

    /// What arrives at the control center by its words in steps `first..first + count`.
    fn listen(&mut self, first: u64, count: u64) {
        self.heard.clear();
        self.forged.clear();
        for word in (first..first + count).step_by(CONTROL_STEPS as usize) {
            let now_us = word * STEP_US as u64;
            for drone in &mut self.drones {
                let from = self.heard.len();
                while let Some(bytes) = drone.uplink.poll(now_us) {
                    self.heard.push(now_us, drone.id.0, bytes);
                }
                if drone.is_attacked() {
                    self.heard.frames().skip(from).for_each(|(.., frame)| drone.overheard(frame));
                    if let Some(forgery) = drone.forgery(CONTROL_STEPS as f64 * f64::from(STEP_S)) {
                        let mail = if forgery.is_harmless { &mut self.heard } else { &mut self.forged };
                        mail.push(now_us, drone.id.0, &forgery.frame);
                    }
                }
            }
        }
    }

    /// Frames of the mates that are due at `receiver`.
    fn deliver(&mut self, receiver: usize, now_us: u64, inputs: &mut Inputs) {
        let count = self.drones.len();
        for sender in (0..count).filter(|&s| s != receiver) {
            take_frames(&mut self.links[sender * count + receiver], now_us, inputs);
        }
    }

    fn broadcast(&mut self, sender: usize, now_us: u64, outputs: &Outputs) {
        let count = self.drones.len();
        for frame in &outputs.peer {
            for receiver in (0..count).filter(|&r| r != sender) {
                self.links[sender * count + receiver].send(now_us, frame);
            }
        }
        self.grants.extend(outputs.srs_gates.iter().filter(|gate| gate.grant));
    }

    /// Users transmit what was granted for the time until the next step.
    fn transmit(&mut self, now_us: u64, around: &Surroundings) {
        if self.grants.is_empty() {
            return;
        }
        let from = TimePs::from_us(now_us as i64);
        let until = from.after(TimePs::from_us(STEP_US));
        let due: Vec<SrsGate> = self.grants.extract_if(.., |gate| gate.at < until).collect();
        for gate in due {
            let occasion = u64::from(gate.occasion.0);
            let emission_ps = around.channel.emission_ps(occasion, gate.at.0);
            let Some(user_m) = around.user_m(gate.user, gate.at) else { continue };
            for drone in &mut self.drones {
                let Some(open) = drone.gate(&gate).copied() else { continue };
                // Half a step of flight at constant velocity: millimetres from the truth.
                let ahead_s = (emission_ps - from.0) as f64 * 1e-12;
                let pos_m = drone.vehicle.pos_enu_m() + drone.vehicle.vel_enu_mps() * ahead_s;
                let reception =
                    around.channel.receive(occasion, u32::from(drone.id.0), emission_ps, user_m, pos_m);
                if let Some(arrival) = reception.captured() {
                    for (symbol, at_ps) in (0..).zip(arrival.symbols_ps()) {
                        drone.capture(&open, symbol, at_ps);
                    }
                    if arrival.late {
                        self.late.push((gate.occasion, drone.id));
                    }
                }
            }
        }
    }
}
