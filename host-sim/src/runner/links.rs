//! Between the links' ends and the control center's state machines.

use super::island::Island;
use crate::control::{
    mission::{ControlCenter, MissionError, drone::Refusals},
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

    /// Frames so far that it did not believe.
    fn refused(&self) -> u64;
}

impl Center for ControlCenter {
    fn refused(&self) -> u64 {
        let Refusals { rejected, forged, repeated } = self.refusals();
        rejected + forged + repeated
    }

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
    fn refused(&self) -> u64 {
        0 // nobody attacks it
    }

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

/// Frames in a row.
#[derive(Default)]
pub(super) struct Mail {
    bytes: Vec<u8>,
    /// When, whose, and where in `bytes` it ends, of each frame.
    ends: Vec<(u64, u16, usize)>,
}

impl Mail {
    pub(super) fn push(&mut self, at_us: u64, whose: u16, frame: &[u8]) {
        self.bytes.extend_from_slice(frame);
        self.ends.push((at_us, whose, self.bytes.len()));
    }

    /// When, whose, and its bytes, of each frame in the order of [`push`](Self::push).
    pub(super) fn frames(&self) -> impl Iterator<Item = (u64, u16, &[u8])> {
        let starts = std::iter::once(0).chain(self.ends.iter().map(|(.., end)| *end));
        self.ends
            .iter()
            .zip(starts)
            .map(|(&(at_us, whose, end), start)| (at_us, whose, &self.bytes[start..end]))
    }

    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.ends.clear();
    }
}

/// Takes the control center's words to the islands.
#[derive(Default)]
pub(super) struct Outbox {
    mail: Mail,
    /// Forgeries that the control center believed.
    pub(super) believed: u64,
}

impl Outbox {
    /// The control center takes in what has arrived by `now_us` and sends what it has to say. Islands have taken the
    /// one off their links at the end of the window before, and put the other on at the start of this one: links are
    /// touched only by whoever flies their drone.
    pub(super) fn exchange(
        &mut self,
        now_us: u64,
        center: &mut impl Center,
        islands: &mut [Island],
        place_of: &[(usize, usize)],
    ) -> Result<(), MissionError> {
        let now = TimePs::from_us(now_us as i64);
        let mail = &mut self.mail;
        let mut send = |to: DroneId, frame: &[u8]| mail.push(now_us, to.0, frame);
        for island in &*islands {
            for (_, from, bytes) in island.heard.frames().filter(|(at_us, ..)| *at_us == now_us) {
                center.receive(now, DroneId(from), bytes, &mut send)?;
            }
            for (_, from, bytes) in island.forged.frames().filter(|(at_us, ..)| *at_us == now_us) {
                let before = center.refused();
                center.receive(now, DroneId(from), bytes, &mut send)?;
                self.believed += u64::from(center.refused() == before);
            }
        }
        center.step(now, &mut send)?;
        for (_, to, frame) in self.mail.frames() {
            let (island, member) = place_of[usize::from(to) - 1];
            islands[island].told.push(now_us, member as u16, frame);
        }
        self.mail.clear();
        Ok(())
    }
}
