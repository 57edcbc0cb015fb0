//! Between the links' ends and the control center's state machines.

use super::island::Island;
use crate::control::{
    mission::{ControlCenter, MissionError},
    random_search::RandomSearch,
};
use rand_core::Rng;
use skyroost_protocol::units::{DroneId, TimePs};

/// What drones talk to: frames in, frames out.
pub(super) trait Center {
    /// Takes in a frame.
    fn receive(
        &mut self,
        now: TimePs,
        from: DroneId,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), MissionError>;

    /// Runs what is due.
    fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), MissionError>;
}

impl Center for ControlCenter {
    fn receive(
        &mut self,
        now: TimePs,
        from: DroneId,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), MissionError> {
        self.receive(now, from, bytes, send)
    }

    fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), MissionError> {
        self.step(now, send)
    }
}

impl<R: Rng> Center for RandomSearch<R> {
    fn receive(
        &mut self,
        now: TimePs,
        from: DroneId,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), MissionError> {
        self.receive(now, from, bytes, send)
    }

    fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), MissionError> {
        self.step(now, send)
    }
}

/// Frames of the control center to be put on the links.
#[derive(Default)]
pub(super) struct Outbox {
    bytes: Vec<u8>,
    /// Receiver and end in `bytes` of each frame.
    ends: Vec<(DroneId, usize)>,
}

impl Outbox {
    /// The control center takes in what has arrived by `now_us` and sends what it has to say.
    pub(super) fn exchange(
        &mut self,
        now_us: u64,
        center: &mut impl Center,
        islands: &mut [Island],
        place_of: &[(usize, usize)],
    ) -> Result<(), MissionError> {
        let now = TimePs::from_us(now_us as i64);
        for drone in islands.iter_mut().flat_map(|island| &mut island.drones) {
            while let Some(bytes) = drone.uplink.poll(now_us) {
                center.receive(now, drone.id, bytes, &mut |to, frame| self.push(to, frame))?;
            }
        }
        center.step(now, &mut |to, frame| self.push(to, frame))?;
        for (to, frame) in self.frames() {
            let (island, member) = place_of[usize::from(to.0) - 1];
            islands[island].drones[member].downlink.send(now_us, frame);
        }
        self.clear();
        Ok(())
    }

    fn push(&mut self, to: DroneId, frame: &[u8]) {
        self.bytes.extend_from_slice(frame);
        self.ends.push((to, self.bytes.len()));
    }

    fn frames(&self) -> impl Iterator<Item = (DroneId, &[u8])> {
        let starts = std::iter::once(0).chain(self.ends.iter().map(|(_, end)| *end));
        self.ends.iter().zip(starts).map(|((to, end), start)| (*to, &self.bytes[start..*end]))
    }

    fn clear(&mut self) {
        self.bytes.clear();
        self.ends.clear();
    }
}
