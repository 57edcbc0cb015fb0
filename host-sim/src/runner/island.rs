//! Drones that talk to each other directly: a fleet, or one reserve alone.
//!
//! Between two words of the control center islands have nothing to do with each other, so they may
//! run on different cores; inside an island drones go in step.

use super::drone::Drone;
use crate::{
    fleet::{Board, BoardError},
    geometry::V3,
    world::{channel::Channel, grid::PointGrid, link::Link},
};
use skyroost_firmware::{STEP_US, io::SrsGate};
use skyroost_protocol::{
    codec::{Frame, MAX_FRAME},
    units::{DroneId, OccasionId, TimePs},
};

/// What all islands share and none changes.
pub(super) struct Surroundings {
    pub(super) channel: Channel,
    pub(super) users: PointGrid,
    pub(super) user_pos_m: Vec<V3>,
}

/// Drones with direct links among them.
pub(super) struct Island<B> {
    pub(super) drones: Vec<Drone<B>>,
    /// Link from drone `i` to drone `j` at `i * drones + j`; those from a drone to itself stay unused.
    pub(super) links: Vec<Link<MAX_FRAME>>,
    /// Granted transmissions to come.
    grants: Vec<SrsGate>,
    /// Captures that came late over a blocked path: the truth, for judging.
    pub(super) late: Vec<(OccasionId, DroneId)>,
    /// True positions after each step of the window, drone by drone.
    pub(super) positions_m: Vec<V3>,
}

impl<B: Board> Island<B> {
    pub(super) fn new(drones: Vec<Drone<B>>, links: Vec<Link<MAX_FRAME>>) -> Self {
        assert_eq!(links.len(), drones.len() * drones.len(), "a link for every ordered pair");
        Self { drones, links, grants: Vec::new(), late: Vec::new(), positions_m: Vec::new() }
    }

    /// Steps `first..first + count`.
    pub(super) fn run(&mut self, first: u64, count: u64, around: &Surroundings) -> Result<(), BoardError> {
        self.positions_m.clear();
        for step in first..first + count {
            let now_us = step * STEP_US as u64;
            for receiver in 0..self.drones.len() {
                self.drones[receiver].sense(step, &around.users, &around.user_pos_m);
                self.deliver(receiver, now_us);
            }
            for sender in 0..self.drones.len() {
                self.drones[sender].think(step)?;
                self.broadcast(sender, now_us);
            }
            self.transmit(now_us, around);
            for drone in &mut self.drones {
                drone.fly();
                self.positions_m.push(drone.vehicle.pos_enu_m());
            }
        }
        Ok(())
    }

    /// Frames of the mates that are due at `receiver`.
    fn deliver(&mut self, receiver: usize, now_us: u64) {
        let count = self.drones.len();
        let inputs = &mut self.drones[receiver].inputs;
        for sender in (0..count).filter(|&s| s != receiver) {
            let link = &mut self.links[sender * count + receiver];
            while !inputs.frames.is_full()
                && let Some(bytes) = link.poll(now_us)
            {
                let frame = Frame::from_slice(bytes).expect("a link carries frames");
                inputs.frames.push(frame).expect("there was room");
            }
        }
    }

    fn broadcast(&mut self, sender: usize, now_us: u64) {
        let count = self.drones.len();
        let outputs = &self.drones[sender].outputs;
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
            let Some(&user_m) = around.user_pos_m.get(gate.user.0 as usize) else { continue };
            let emission_ps = around.channel.emission_ps(occasion, gate.at.0);
            for drone in &mut self.drones {
                let Some(open) = drone.gate(&gate).copied() else { continue };
                // Half a step of flight at constant velocity: millimetres from the truth.
                let ahead_s = (emission_ps - from.0) as f64 * 1e-12;
                let pos_m = drone.vehicle.pos_enu_m() + drone.vehicle.vel_enu_mps() * ahead_s;
                let reception =
                    around.channel.receive(occasion, u32::from(drone.id.0), emission_ps, user_m, pos_m);
                if let Some(arrival) = reception.captured() {
                    drone.capture(&open, arrival.true_ps);
                    if arrival.late {
                        self.late.push((gate.occasion, drone.id));
                    }
                }
            }
        }
    }
}
