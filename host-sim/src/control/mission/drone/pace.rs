//! What may be said to a drone when, where its link takes less than there is to say, and what was said and heard in bytes.
//!
//! Commands and answers are said whatever they cost. Relayed states have three quarters of the link to themselves, so that neither they nor
//! requests and lanes are ever without a share; requests and lanes ask for room before.

use skyroost_protocol::{
    budget::Budget,
    message::{Down, Up},
    stream::FRAMING,
    units::TimePs,
};
use std::ops::AddAssign;

/// Bytes of relayed states that are said at once, as the time that they take of their share: whoever is farther away than those that fit is not
/// told of, so that the nearest are, twice a second and more.
const RELAYED_AT_ONCE: TimePs = TimePs::from_ms(200);

/// What found no room on a link of limited rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeldBack {
    /// Times that the states of neighbours were not relayed when they were due, but later.
    pub relays: u64,
    /// Times that only the nearest neighbours' states were relayed.
    pub neighbours: u64,
    /// Times that pieces of lanes waited.
    pub pieces: u64,
    /// Requests for SRS that were not said, to any drone of the fleet.
    pub requests: u64,
    /// Copies of requests that were not said.
    pub copies: u64,
}

impl AddAssign for HeldBack {
    fn add_assign(&mut self, other: Self) {
        let Self { relays, neighbours, pieces, requests, copies } = other;
        self.relays += relays;
        self.neighbours += neighbours;
        self.pieces += pieces;
        self.requests += requests;
        self.copies += copies;
    }
}

/// Bytes of frames said and heard, by what they are for, with what frames them on a byte link. What was not believed is not in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Heard: its shared states.
    pub states: u64,
    /// Heard: differences of arrival times.
    pub differences: u64,
    /// Heard: users that its cell hears.
    pub pages: u64,
    /// Heard: telemetry.
    pub telemetry: u64,
    /// Heard: hellos, acknowledgements, events.
    pub answers: u64,
    /// Said: states of neighbours, and that the link lives.
    pub relayed: u64,
    /// Said: requests for SRS.
    pub requests: u64,
    /// Said: pieces of lanes.
    pub lanes: u64,
    /// Said: commands and welcomes.
    pub commands: u64,
}

impl Traffic {
    /// A message came in a frame of so many bytes.
    pub(super) fn heard(&mut self, message: &Up, frame_len: usize) {
        *match message {
            Up::SharedState(_) => &mut self.states,
            Up::Tdoa(_) => &mut self.differences,
            Up::Attached(_) => &mut self.pages,
            Up::Telemetry(_) => &mut self.telemetry,
            Up::Hello { .. } | Up::CommandAck { .. } | Up::Heartbeat | Up::Event { .. } => &mut self.answers,
        } += (frame_len + FRAMING) as u64;
    }

    fn said(&mut self, message: &Down, frame_len: usize) {
        *match message {
            Down::Peers(_) | Down::Heartbeat => &mut self.relayed,
            Down::SrsRequest(_) => &mut self.requests,
            Down::LanePiece(_) => &mut self.lanes,
            Down::Welcome { .. } | Down::Command { .. } => &mut self.commands,
        } += (frame_len + FRAMING) as u64;
    }
}

impl AddAssign for Traffic {
    fn add_assign(&mut self, other: Self) {
        self.states += other.states;
        self.differences += other.differences;
        self.pages += other.pages;
        self.telemetry += other.telemetry;
        self.answers += other.answers;
        self.relayed += other.relayed;
        self.requests += other.requests;
        self.lanes += other.lanes;
        self.commands += other.commands;
    }
}

/// What may be said to one drone when.
#[derive(Clone, Copy, Debug)]
pub(in crate::control) struct Pace {
    all: Budget,
    relays: Budget,
    /// Within which distance neighbours were due whose states were not relayed yet, metres.
    owed_within_m: f64,
    pub(in crate::control) held_back: HeldBack,
    pub(in crate::control) traffic: Traffic,
}

impl Pace {
    pub(super) fn new(bytes_per_s: u32) -> Self {
        // Never to 0, which is no limit.
        let relays = bytes_per_s - bytes_per_s / 4;
        Self {
            all: Budget::new(bytes_per_s),
            relays: Budget::new(relays),
            owed_within_m: 0.0,
            held_back: HeldBack::default(),
            traffic: Traffic::default(),
        }
    }

    /// Whether there is room for what can wait.
    pub(in crate::control) fn has_room(&self, now: TimePs) -> bool {
        self.all.allows(now, TimePs(0))
    }

    pub(super) fn pay(&mut self, now: TimePs, frame_len: usize) {
        self.all.pay(now, frame_len);
    }

    /// A message is said in a frame of so many bytes.
    pub(super) fn says(&mut self, now: TimePs, message: &Down, frame_len: usize) {
        self.pay(now, frame_len);
        self.traffic.said(message, frame_len);
        if matches!(message, Down::Peers(_) | Down::Heartbeat) {
            self.relays.pay(now, frame_len);
        }
    }

    /// The distance within which neighbours are to be told of now, where they are due within `within_m`: farther where some are owed. None where
    /// there is no room yet.
    pub(in crate::control) fn relays_within_m(&mut self, now: TimePs, within_m: f64) -> Option<f64> {
        let within_m = self.owed_within_m.max(within_m);
        let has_room = self.relays.allows(now, TimePs(0));
        self.owed_within_m = if has_room { 0.0 } else { within_m };
        self.held_back.relays += u64::from(!has_room);
        has_room.then_some(within_m)
    }

    /// Whether no more neighbours can be told of now, some having been.
    pub(in crate::control) fn has_relayed_enough(&mut self, now: TimePs) -> bool {
        let enough = !self.relays.allows(now, RELAYED_AT_ONCE);
        self.held_back.neighbours += u64::from(enough);
        enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every 100 ms `sizes` bytes of relayed states are due, for `seconds`; how often they are said, and how often there was room for something
    /// else afterwards.
    fn relayed(bytes_per_s: u32, frames: &[usize], seconds: i64) -> (Vec<i64>, usize) {
        let (mut pace, mut said, mut room) = (Pace::new(bytes_per_s), Vec::new(), 0);
        for ms in (0..1_000 * seconds).step_by(20) {
            let now = TimePs::from_ms(ms);
            if ms % 100 == 0 && pace.relays_within_m(now, 1_000.0).is_some() {
                said.push(ms);
                for frame in frames {
                    pace.says(now, &Down::Heartbeat, *frame);
                    if pace.has_relayed_enough(now) {
                        break;
                    }
                }
            }
            if pace.has_room(now) {
                room += 1;
                pace.says(now, &Down::Welcome { version: 1, schema_hash: 0, resumes: false }, 150);
            }
        }
        (said, room)
    }

    #[test]
    fn neighbours_are_told_of_as_often_as_their_share_holds_and_the_rest_has_its_own() {
        let (said, room) = relayed(100_000, &[200, 200], 10);
        assert_eq!((said.len(), room), (100, 500), "an ample link");
        // 414 bytes of 1,500 a second.
        let (said, room) = relayed(2_000, &[200, 200], 60);
        assert!((200..=220).contains(&said.len()), "{}", said.len());
        // A quarter of it in frames of 157 bytes.
        assert!((150..=230).contains(&room), "{room}");
        // Many neighbours: the nearest only, and no less than twice a second.
        let (said, room) = relayed(1_000, &[200; 6], 60);
        let longest = said.windows(2).map(|pair| pair[1] - pair[0]).max();
        assert!(longest <= Some(500), "{longest:?}");
        assert!(room > 60, "{room}");
    }

    #[test]
    fn who_is_owed_a_state_gets_it_with_the_next() {
        let mut pace = Pace::new(1_000);
        let at = TimePs::from_ms;
        assert_eq!(pace.relays_within_m(at(0), 1_000.0), Some(1_000.0));
        pace.says(at(0), &Down::Heartbeat, 200);
        assert_eq!(pace.relays_within_m(at(100), 3_000.0), None);
        assert_eq!(pace.relays_within_m(at(200), 1_000.0), Some(3_000.0));
        assert_eq!((pace.relays_within_m(at(300), 1_000.0), pace.held_back.relays), (Some(1_000.0), 1));
    }

    #[test]
    fn without_a_limit_nothing_is_held_back() {
        let (said, room) = relayed(0, &[200; 40], 10);
        assert_eq!((said.len(), room), (100, 500));
        let mut pace = Pace::new(0);
        assert!(!pace.has_relayed_enough(TimePs(0)));
    }
}
