//! Who speaks on a board's bus: the autopilot in flight, or the host of hardware-in-the-loop.
//!
//! The first message decides, and nothing but a reset changes it: in flight nothing on the bus can make
//! the board a simulated one, and on the bench nothing makes it fly.

use super::autopilot::{FROM_AUTOPILOT, FromAutopilot, decode};
use super::bus::{self, ToBoard};
use crate::counters::Counters;
use skyroost_protocol::stream::{StreamDecoder, StreamFrame, encode_stream};

/// What the board is for, since its reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusMode {
    /// Nobody has spoken.
    #[default]
    Undecided,
    /// The autopilot has spoken first.
    Flight,
    /// The host has spoken first: every byte from here on is for [`Lockstep`](super::lockstep::Lockstep).
    Bench,
}

/// What a byte of the bus completed.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// A message of the autopilot.
    Autopilot(FromAutopilot),
    /// The host's first message, as it crossed the bus. All bytes after it are the host's.
    Host(StreamFrame),
}

/// Finds out who speaks, and understands the autopilot.
#[derive(Clone, Debug, Default)]
pub struct BusIntake {
    mode: BusMode,
    decoder: StreamDecoder,
    unknown: u32,
}

impl BusIntake {
    /// Nobody has spoken.
    #[must_use]
    pub const fn new() -> Self {
        Self { mode: BusMode::Undecided, decoder: StreamDecoder::new(), unknown: 0 }
    }

    /// What the board is for.
    #[must_use]
    pub const fn mode(&self) -> BusMode {
        self.mode
    }

    /// Frames that came damaged, or undamaged and meant nothing.
    #[must_use]
    pub const fn unknown(&self) -> u32 {
        self.unknown
    }

    /// Takes the next byte, as long as the host has not spoken first.
    pub fn push(&mut self, byte: u8) -> Option<Heard> {
        let heard = match self.decoder.push(byte)? {
            Ok(payload) => understand(self.mode, payload),
            Err(_) => None,
        };
        match heard {
            Some(Heard::Autopilot(_)) => self.mode = BusMode::Flight,
            Some(Heard::Host(_)) => self.mode = BusMode::Bench,
            None => Counters::count(&mut self.unknown),
        }
        heard
    }
}

fn understand(mode: BusMode, payload: &[u8]) -> Option<Heard> {
    if let Some(message) = decode(FROM_AUTOPILOT, payload) {
        return Some(Heard::Autopilot(message));
    }
    if mode == BusMode::Undecided && bus::decode::<ToBoard>(payload).is_some() {
        let mut frame = StreamFrame::new();
        encode_stream(payload, &mut frame).ok()?;
        return Some(Heard::Host(frame));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::super::autopilot;
    use super::*;

    fn nav() -> FromAutopilot {
        FromAutopilot::Nav { nav: None, in_air: false, battery_permille: 5 }
    }

    /// A message of the host.
    fn report() -> StreamFrame {
        let mut frame = StreamFrame::new();
        assert!(bus::encode(&ToBoard::Report, &mut frame), "fits");
        frame
    }

    fn push_all(intake: &mut BusIntake, bytes: &[u8]) -> Vec<Heard> {
        bytes.iter().filter_map(|byte| intake.push(*byte)).collect()
    }

    #[test]
    fn the_host_is_heard_to_the_byte() {
        let mut intake = BusIntake::new();
        let frame = report();
        assert_eq!(push_all(&mut intake, &frame), [Heard::Host(frame)]);
        assert_eq!(intake.mode(), BusMode::Bench);
    }

    #[test]
    fn in_flight_the_host_is_not_obeyed() {
        let mut intake = BusIntake::new();
        let frame = autopilot::encode(FROM_AUTOPILOT, &nav()).expect("fits");
        assert_eq!(push_all(&mut intake, &frame), [Heard::Autopilot(nav())]);
        assert_eq!(push_all(&mut intake, &report()), []);
        assert_eq!((intake.mode(), intake.unknown()), (BusMode::Flight, 1));
    }

    #[test]
    fn noise_decides_nothing() {
        let mut intake = BusIntake::new();
        let mut frame = report();
        let at = frame.len() / 2;
        frame[at] ^= 4;
        push_all(&mut intake, &frame);
        assert_eq!((intake.mode(), intake.unknown()), (BusMode::Undecided, 1));
    }
}
