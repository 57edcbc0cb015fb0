//! The fixed header in front of every message.
//!
//! | offset | bytes | field |
//! |---|---|---|
//! | 0 | 2 | magic, `"SR"` |
//! | 2 | 1 | protocol version |
//! | 3 | 1 | kind |
//! | 4 | 1 | flags |
//! | 5 | 2 | sender, 0 for the control center |
//! | 7 | 2 | boot epoch of the sender |
//! | 9 | 4 | sequence number |
//! | 13 | 2 | length of the body |
//!
//! All integers are little-endian. This layout is the same in every version of the protocol, so that
//! versions can refuse each other by name; frames of version 0 are read by all ([`manage`](crate::manage)).

use crate::error::DecodeError;
use crate::units::DroneId;
use crate::{MIN_PROTOCOL_VERSION, PROTOCOL_VERSION};

/// First two bytes of every frame.
pub const MAGIC: [u8; 2] = *b"SR";
/// Bytes of the header.
pub const HEADER_LEN: usize = 15;
/// Bytes of the tag after the body of a sealed frame.
pub const TAG_LEN: usize = 16;
/// Flag: the frame is sealed: its body is encrypted, and a tag over header and body follows.
pub const FLAG_TAG: u8 = 1;
/// Flag of sealed frames: the sender does not know which boot of the receiver it talks to.
pub const FLAG_UNBOUND: u8 = 2;
/// Flag of sealed frames: the lowest bit of how often the key was changed in this session.
pub const FLAG_SLOT: u8 = 4;
/// Version of the management messages, which all versions understand.
pub const MANAGEMENT_VERSION: u8 = 0;
/// Flags that frames without a tag have none of.
const SEALED_FLAGS: u8 = FLAG_TAG | FLAG_UNBOUND | FLAG_SLOT;

/// Between whom a message goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// What all versions understand: see [`manage`](crate::manage).
    Management = 0,
    /// Drone to control center.
    Up = 1,
    /// Control center to drone.
    Down = 2,
    /// Drone to fleet mates.
    Peer = 3,
}

/// What stands in front of every message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Protocol version of the frame.
    pub version: u8,
    /// Between whom the message goes.
    pub kind: Kind,
    /// [`FLAG_TAG`] and what goes with it, or nothing.
    pub flags: u8,
    /// Who sent it.
    pub sender: DroneId,
    /// Boots of the sender so far, modulo 2^16: sequence numbers start anew with each.
    pub boot_epoch: u16,
    /// Counts the frames of one sender on one link, modulo 2^32.
    pub sequence: u32,
    /// Bytes of the body.
    pub body_len: u16,
}

impl Header {
    pub(crate) const fn to_bytes(self) -> [u8; HEADER_LEN] {
        let [m0, m1] = MAGIC;
        let [id0, id1] = self.sender.0.to_le_bytes();
        let [e0, e1] = self.boot_epoch.to_le_bytes();
        let [s0, s1, s2, s3] = self.sequence.to_le_bytes();
        let [l0, l1] = self.body_len.to_le_bytes();
        [m0, m1, self.version, self.kind as u8, self.flags, id0, id1, e0, e1, s0, s1, s2, s3, l0, l1]
    }

    /// The header at the start of `bytes`.
    ///
    /// # Errors
    /// [`DecodeError`] `Truncated`, `Magic`, `Version`, `Kind` or `Flags`.
    pub fn read(bytes: &[u8]) -> Result<Self, DecodeError> {
        let bytes = magic(bytes)?;
        let [_, _, version, kind, ..] = *bytes;
        if !(MIN_PROTOCOL_VERSION..=PROTOCOL_VERSION).contains(&version) {
            return Err(DecodeError::Version { found: version });
        }
        let kind = match kind {
            1 => Kind::Up,
            2 => Kind::Down,
            3 => Kind::Peer,
            _ => return Err(DecodeError::Kind),
        };
        Self::of_kind(kind, bytes)
    }

    /// The header of a management frame at the start of `bytes`.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_management(bytes: &[u8]) -> Result<Self, DecodeError> {
        let bytes = magic(bytes)?;
        match *bytes {
            [_, _, MANAGEMENT_VERSION, 0, ..] => Self::of_kind(Kind::Management, bytes),
            [_, _, MANAGEMENT_VERSION, ..] => Err(DecodeError::Kind),
            [_, _, found, ..] => Err(DecodeError::Version { found }),
        }
    }

    fn of_kind(kind: Kind, bytes: &[u8; HEADER_LEN]) -> Result<Self, DecodeError> {
        let [_, _, version, _, flags, id0, id1, e0, e1, s0, s1, s2, s3, l0, l1] = *bytes;
        if flags & !SEALED_FLAGS != 0 || (flags != 0 && flags & FLAG_TAG == 0) {
            return Err(DecodeError::Flags);
        }
        Ok(Self {
            version,
            kind,
            flags,
            sender: DroneId(u16::from_le_bytes([id0, id1])),
            boot_epoch: u16::from_le_bytes([e0, e1]),
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            body_len: u16::from_le_bytes([l0, l1]),
        })
    }
}

/// Enough bytes for a header, which begin as frames do.
fn magic(bytes: &[u8]) -> Result<&[u8; HEADER_LEN], DecodeError> {
    let head = bytes.first_chunk::<HEADER_LEN>().ok_or(DecodeError::Truncated)?;
    if head.starts_with(&MAGIC) { Ok(head) } else { Err(DecodeError::Magic) }
}
