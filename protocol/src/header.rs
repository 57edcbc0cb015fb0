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
//! versions can refuse each other by name.

use crate::error::DecodeError;
use crate::units::DroneId;
use crate::wire::{Full, Malformed, Reader, Wire, Writer};
use crate::{MIN_PROTOCOL_VERSION, PROTOCOL_VERSION};

/// First two bytes of every frame.
pub const MAGIC: [u8; 2] = *b"SR";
/// Bytes of the header.
pub const HEADER_LEN: usize = 15;
/// Bytes of the authentication tag after the body, for which room is reserved.
pub const TAG_LEN: usize = 16;
/// Flag: an authentication tag follows the body.
pub const FLAG_TAG: u8 = 1;

/// Between whom a message goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
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
    /// [`FLAG_TAG`] or nothing.
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
    pub(crate) fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
        out.put(MAGIC)?;
        out.put([self.version, self.kind as u8, self.flags])?;
        self.sender.write(out)?;
        self.boot_epoch.write(out)?;
        self.sequence.write(out)?;
        self.body_len.write(out)
    }

    /// The header at the start of `bytes`.
    ///
    /// # Errors
    /// [`DecodeError`] `Truncated`, `Magic`, `Version`, `Kind` or `Flags`.
    pub fn read(bytes: &[u8]) -> Result<Self, DecodeError> {
        let bytes = bytes.first_chunk::<HEADER_LEN>().ok_or(DecodeError::Truncated)?;
        let mut input = Reader::new(bytes);
        let cut = |_: Malformed| DecodeError::Truncated; // cannot happen: the chunk is long enough
        let magic: [u8; 2] = input.take().map_err(cut)?;
        if magic != MAGIC {
            return Err(DecodeError::Magic);
        }
        let [version, kind, flags] = input.take().map_err(cut)?;
        if !(MIN_PROTOCOL_VERSION..=PROTOCOL_VERSION).contains(&version) {
            return Err(DecodeError::Version { found: version });
        }
        let kind = match kind {
            1 => Kind::Up,
            2 => Kind::Down,
            3 => Kind::Peer,
            _ => return Err(DecodeError::Kind),
        };
        if flags & !FLAG_TAG != 0 {
            return Err(DecodeError::Flags);
        }
        Ok(Self {
            version,
            kind,
            flags,
            sender: Wire::read(&mut input).map_err(cut)?,
            boot_epoch: Wire::read(&mut input).map_err(cut)?,
            sequence: Wire::read(&mut input).map_err(cut)?,
            body_len: Wire::read(&mut input).map_err(cut)?,
        })
    }
}
