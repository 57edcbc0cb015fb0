//! Assembly of a mission upload from pieces that may come in any order, twice, or not at all.

use crate::counters::Counters;
use heapless::Vec;
use skyroost_protocol::{
    message::{LanePiece, MAX_WAYPOINTS, MissionHeader, lanes_crc as checksum},
    units::MissionId,
};

/// Words of 32 waypoints in the map of what has arrived.
const MAP_WORDS: usize = MAX_WAYPOINTS.div_ceil(32);

/// An upload in progress.
#[derive(Clone, Debug, Default)]
pub(super) struct Upload {
    header: Option<MissionHeader>,
    waypoints_mm: Vec<[i32; 2], MAX_WAYPOINTS>,
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
    /// Announces a mission. The same one again keeps the pieces that have arrived.
    pub(super) fn begin(&mut self, header: &MissionHeader) -> bool {
        let count = usize::from(header.waypoints);
        if self.header.as_ref() != Some(header) {
            self.header = Some(*header);
            self.arrived = [0; MAP_WORDS];
            self.waypoints_mm.clear();
        }
        self.waypoints_mm.resize_default(count).is_ok()
    }

    /// Takes in a piece; one that does not belong to the announced mission is counted.
    pub(super) fn piece(&mut self, piece: &LanePiece, counters: &mut Counters) {
        let first = usize::from(piece.first);
        let room = self
            .waypoints_mm
            .get_mut(first..)
            .and_then(|rest| rest.get_mut(..piece.waypoints_mm.len()))
            .filter(|_| self.header.is_some_and(|h| h.mission == piece.mission));
        let Some(room) = room else {
            Counters::count(&mut counters.lanes_refused);
            return;
        };
        room.copy_from_slice(&piece.waypoints_mm);
        for index in first..first + piece.waypoints_mm.len() {
            if let Some(word) = self.arrived.get_mut(index >> 5) {
                *word |= 1 << (index & 31);
            }
        }
    }

    /// The announced mission and its lanes, once all have arrived.
    pub(super) fn complete(
        &mut self,
        mission: MissionId,
        lanes_crc: u32,
    ) -> Result<(MissionHeader, &[[i32; 2]]), Incomplete> {
        let header = self.header.filter(|h| h.mission == mission).ok_or(Incomplete::Unknown)?;
        for index in 0..self.waypoints_mm.len() {
            let there = self.arrived.get(index >> 5).is_some_and(|word| word >> (index & 31) & 1 == 1);
            if !there {
                return Err(Incomplete::Missing(index as u16));
            }
        }
        if checksum(&self.waypoints_mm) != lanes_crc {
            self.arrived = [0; MAP_WORDS];
            return Err(Incomplete::Checksum);
        }
        Ok((header, &self.waypoints_mm))
    }
}
