//! The bus in flight: what the board and the autopilot's side say to each other.
//!
//! On the same wires, in hardware-in-the-loop, the host says other things ([`bus`](super::bus)). Messages are
//! framed alike; here a first byte ([`FROM_AUTOPILOT`], [`TO_AUTOPILOT`]) stands before the message, which no
//! message of the host begins with, so that neither is ever taken for the other.

use super::bus::{WireGate, WireNav, WireSetpoint};
use super::triggers::TriggerCounters;
use heapless::Vec;
use serde::{Deserialize, Serialize};
use skyroost_protocol::{
    codec::MAX_FRAME,
    message::AttachedUser,
    stream::{StreamFrame, encode_stream},
    units::{DroneId, TimePs},
};

/// First byte of a message to the board; with it, the version of these messages.
pub const FROM_AUTOPILOT: u8 = 0xa2;
/// First byte of a message of the board.
pub const TO_AUTOPILOT: u8 = 0xb2;
/// Most users in one message.
pub const MAX_ATTACHED_PART: usize = 8;

/// Autopilot, navigation receiver and cell to board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromAutopilot {
    /// Who the drone is; said once a second, because the board may have started anew. What differs from
    /// the first one is counted and not obeyed.
    Configure {
        /// The drone.
        drone: DroneId,
        /// The mission's epoch, in seconds of GPS time.
        epoch_gps_s: i64,
    },
    /// Navigation solution and state of the vehicle, at 50 Hz.
    Nav {
        /// None while there is none.
        nav: Option<WireNav>,
        /// Whether the vehicle flies: what [`Inputs::in_air`](crate::io::Inputs::in_air) says.
        in_air: bool,
        /// Charge of the battery, per mille.
        battery_permille: u16,
    },
    /// The last pulse began this second of GPS time; at the latest half a second after it.
    Second {
        /// Seconds of GPS time.
        gps_s: i64,
    },
    /// Users that the cell hears.
    Attached(Vec<AttachedUser, MAX_ATTACHED_PART>),
}

/// Board to autopilot and cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToAutopilot {
    /// The board has started; said when it first hears the autopilot and every ten seconds.
    Started(Start),
    /// For the velocity loop, at 50 Hz while the board is well. When it stops coming, the autopilot's own
    /// failsafe takes over.
    Setpoint {
        /// GNSS time of the step, since the mission's epoch.
        now: TimePs,
        /// The setpoint.
        setpoint: WireSetpoint,
    },
    /// An SRS occasion to listen to.
    Gate(WireGate),
    /// How the board fares, once a second.
    Status(Status),
}

/// How and why the board has started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Start {
    /// What the board was given, and whether it can fly with it.
    pub given: Given,
    /// Why it was reset: bits of [`ResetCause`](super::boot::ResetCause).
    pub reset_cause: u8,
    /// Why it reset itself, if it did: a [`LastWords`](super::boot::LastWords).
    pub last_words: u8,
    /// Whether the crystal runs. Without it the board says so and commands nothing.
    pub crystal: bool,
}

/// What a board found where its identity and its key are kept ([`provision`](super::provision)).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Given {
    /// It has not looked: nobody has said yet who it is.
    #[default]
    Unread,
    /// Nothing: it was never provisioned, and flies for nobody.
    Nothing,
    /// Something that cannot be read; it flies for nobody.
    Damaged,
    /// A key.
    Key,
    /// An open link: whoever can send can command it.
    OpenLink,
    /// The key of another drone than the autopilot says; it flies for nobody.
    AnothersKey,
    /// A key all of whose boots are spent, or one whose boot could not be spent; it flies for nobody.
    Spent,
}

/// How the board fares. Counts saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// Bound of the error of GNSS time; none while it is unknown.
    pub time_uncertainty_ns: Option<u32>,
    /// Pulses used, refused, missed.
    pub pulses: [u32; 3],
    /// Edges of the baseband captured, outside of every gate, repeated, ambiguous, untimed; gates silent.
    pub triggers: [u32; 6],
    /// Captures lost: the register or the queue was overwritten.
    pub captures_lost: u32,
    /// Steps done, slots of the grid dropped, longest step in microseconds.
    pub steps: [u32; 3],
    /// Frames of the bus damaged or unknown, messages without room, frames for the radio without room.
    pub links: [u32; 3],
}

impl Status {
    /// The counts of triggers in this message's order.
    pub const fn set_triggers(&mut self, of: &TriggerCounters) {
        self.triggers = [of.captured, of.outside, of.repeated, of.ambiguous, of.untimed, of.silent];
    }
}

/// `message` as it goes over the bus; none if it is longer than any frame, which none is.
#[must_use]
pub fn encode<T: Serialize>(tag: u8, message: &T) -> Option<StreamFrame> {
    let mut payload = [0; MAX_FRAME];
    let (first, rest) = payload.split_first_mut()?;
    *first = tag;
    let len = 1 + postcard::to_slice(message, rest).ok()?.len();
    let mut frame = StreamFrame::new();
    encode_stream(payload.get(..len)?, &mut frame).ok()?;
    Some(frame)
}

/// The message in what a [`StreamDecoder`](skyroost_protocol::stream::StreamDecoder) found; none when it is
/// not one.
#[must_use]
pub fn decode<'a, T: Deserialize<'a>>(tag: u8, payload: &'a [u8]) -> Option<T> {
    let message = payload.strip_prefix(&[tag])?;
    match postcard::take_from_bytes(message) {
        Ok((message, [])) => Some(message),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::bus;
    use super::*;
    use proptest::{collection::vec, prelude::*};
    use skyroost_protocol::stream::StreamDecoder;
    use skyroost_protocol::units::UserId;

    fn payload(frame: &StreamFrame) -> std::vec::Vec<u8> {
        let mut decoder = StreamDecoder::new();
        let mut found = None;
        for &byte in frame {
            if let Some(payload) = decoder.push(byte) {
                found = Some(payload.expect("undamaged").to_vec());
            }
        }
        found.expect("a frame")
    }

    #[test]
    fn messages_arrive_and_are_not_the_host_s() {
        let user = AttachedUser { user: UserId(u32::MAX), timing_advance: u16::MAX };
        for message in [
            FromAutopilot::Configure { drone: DroneId(4096), epoch_gps_s: i64::MIN },
            FromAutopilot::Nav { nav: None, in_air: true, battery_permille: 1000 },
            FromAutopilot::Second { gps_s: i64::MAX },
            FromAutopilot::Attached([user; MAX_ATTACHED_PART].into()),
        ] {
            let payload = payload(&encode(FROM_AUTOPILOT, &message).expect("fits"));
            assert_eq!(decode::<FromAutopilot>(FROM_AUTOPILOT, &payload), Some(message));
            assert_eq!(bus::decode::<bus::ToBoard>(&payload), None);
        }
    }

    #[test]
    fn the_longest_status_fits() {
        let status = Status {
            time_uncertainty_ns: Some(u32::MAX),
            pulses: [u32::MAX; 3],
            triggers: [u32::MAX; 6],
            captures_lost: u32::MAX,
            steps: [u32::MAX; 3],
            links: [u32::MAX; 3],
        };
        let payload = payload(&encode(TO_AUTOPILOT, &ToAutopilot::Status(status)).expect("fits"));
        assert_eq!(decode::<ToAutopilot>(TO_AUTOPILOT, &payload), Some(ToAutopilot::Status(status)));
    }

    proptest! {
        /// No payload is both a message of the host and one of the autopilot.
        #[test]
        fn a_payload_has_one_meaning(payload in vec(any::<u8>(), 0..64), tagged: bool) {
            let mut payload = payload;
            if tagged {
                payload.insert(0, FROM_AUTOPILOT);
            }
            let both = decode::<FromAutopilot>(FROM_AUTOPILOT, &payload).is_some()
                && bus::decode::<bus::ToBoard>(&payload).is_some();
            prop_assert!(!both);
        }
    }
}
