//! Assembly of a mission upload from pieces that may come in any order, twice, or not at all.
//!
//! The lanes are assembled in the place where they will be flown from: a mission that is announced takes
//! the room of the one before, which can then not be swept any more.

use crate::{counters::Counters, guidance::lanes::Lanes};
use skyroost_protocol::{
    message::{LanePiece, MAX_WAYPOINTS, MissionHeader, lanes_crc as checksum},
    units::MissionId,
};

/// Words of 32 waypoints in the map of what has arrived.
const MAP_WORDS: usize = MAX_WAYPOINTS.div_ceil(32);

/// An upload in progress.
#[derive(Clone, Debug)]
pub(super) struct Upload {
    header: Option<MissionHeader>,
    arrived: [u32; MAP_WORDS],
}

/// Why an upload is not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Incomplete {
    /// Another mission was announced, or none.
    Unknown,
    /// This waypoint has not arrived.
    Missing(u16),
    /// All arrived, but they are not the ones sent: start over.
    Checksum,
}

impl Upload {
    /// Nothing announced.
    pub(super) const fn new() -> Self {
        Self { header: None, arrived: [0; MAP_WORDS] }
    }

    /// Announces a mission; false when it is too long, or has more walls than waypoints for them. The same one again keeps the pieces that have
    /// arrived.
    pub(super) fn begin(&mut self, header: &MissionHeader, lanes: &mut Lanes) -> bool {
        let count = usize::from(header.waypoints);
        if self.header.as_ref() == Some(header) {
            return lanes.waypoints_mm().len() == count;
        }
        self.header = Some(*header);
        self.arrived = [0; MAP_WORDS];
        lanes.open(count, usize::from(header.walls)).is_ok()
    }

    /// Takes in a piece; one that does not belong to the announced mission is counted.
    pub(super) fn piece(&mut self, piece: &LanePiece, lanes: &mut Lanes, counters: &mut Counters) {
        let first = usize::from(piece.first);
        let announced = self.header.is_some_and(|h| h.mission == piece.mission);
        if !(announced && lanes.write(first, &piece.waypoints_mm)) {
            Counters::count(&mut counters.lanes_refused);
            return;
        }
        for index in first..first + piece.waypoints_mm.len() {
            if let Some(word) = self.arrived.get_mut(index >> 5) {
                *word |= 1 << (index & 31);
            }
        }
    }

    /// The announced mission, once all of its lanes have arrived.
    pub(super) fn complete(
        &mut self,
        mission: MissionId,
        lanes_crc: u32,
        lanes: &mut Lanes,
    ) -> Result<MissionHeader, Incomplete> {
        let header = self.header.filter(|h| h.mission == mission).ok_or(Incomplete::Unknown)?;
        for index in 0..lanes.waypoints_mm().len() {
            let there = self.arrived.get(index >> 5).is_some_and(|word| word >> (index & 31) & 1 == 1);
            if !there {
                return Err(Incomplete::Missing(index as u16));
            }
        }
        if checksum(lanes.waypoints_mm()) != lanes_crc {
            self.arrived = [0; MAP_WORDS];
            lanes.reopen();
            return Err(Incomplete::Checksum);
        }
        Ok(header)
    }
}
