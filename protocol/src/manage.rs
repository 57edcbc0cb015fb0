//! Version 0: the management messages, frozen for good. Whatever version two ends speak, they understand these, and so
//! can say why they do not understand each other.
//!
//! A frame is the header of every version with version 0 and kind 0, a body of fixed layout, and a tag where the link is
//! sealed: ChaCha20-Poly1305 under the key of [`Purpose::Management`]. Integers are little-endian.
//!
//! | message | bytes of the body |
//! |---|---|
//! | identify | `1` |
//! | identity | `2`, oldest version, newest version, schema hash (4), release (3) |
//!
//! Bytes after those are of later versions and are left aside. Management frames carry no proof of when they were said:
//! whoever acts on one must not mind doing so twice.

use crate::codec::{Stamp, take_apart};
use crate::error::{DecodeError, EncodeError};
use crate::header::{FLAG_TAG, HEADER_LEN, Header, Kind, MANAGEMENT_VERSION, TAG_LEN};
use crate::key::{Key, Purpose, ROOM};
use crate::{MIN_PROTOCOL_VERSION, PROTOCOL_VERSION, SCHEMA_HASH};

/// Bytes of the longest management frame.
pub const MAX_MANAGEMENT: usize = HEADER_LEN + IDENTITY_LEN + TAG_LEN;
const IDENTITY_LEN: usize = 10;

/// What all versions can say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Management {
    /// Who are you?
    Identify,
    /// The answer.
    Identity(Identity),
}

/// What an end is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Oldest protocol version that it speaks.
    pub version_min: u8,
    /// Newest protocol version that it speaks.
    pub version_max: u8,
    /// Hash over the shapes of its messages.
    pub schema_hash: u32,
    /// Release of its software: major, minor, patch.
    pub release: [u8; 3],
}

impl Identity {
    /// Of this build.
    pub const OWN: Self = Self {
        version_min: MIN_PROTOCOL_VERSION,
        version_max: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        release: [
            number(env!("CARGO_PKG_VERSION_MAJOR")),
            number(env!("CARGO_PKG_VERSION_MINOR")),
            number(env!("CARGO_PKG_VERSION_PATCH")),
        ],
    };
}

/// A decimal number, at compile time.
const fn number(digits: &str) -> u8 {
    let (bytes, mut i, mut value) = (digits.as_bytes(), 0, 0);
    while i < bytes.len() {
        value = 10 * value + (bytes[i] - b'0');
        i += 1;
    }
    value
}

/// Writes a frame to the start of `out` and returns its length; sealed where there is a key.
///
/// # Errors
/// [`EncodeError::BufferTooSmall`]; [`MAX_MANAGEMENT`] bytes are always enough.
pub fn encode_into(
    stamp: &Stamp,
    message: &Management,
    root: Option<&Key>,
    out: &mut [u8],
) -> Result<usize, EncodeError> {
    let identity;
    let body: &[u8] = match message {
        Management::Identify => &[1],
        Management::Identity(Identity { version_min, version_max, schema_hash, release: [r0, r1, r2] }) => {
            let [h0, h1, h2, h3] = schema_hash.to_le_bytes();
            identity = [2, *version_min, *version_max, h0, h1, h2, h3, *r0, *r1, *r2];
            &identity
        }
    };
    let (head, rest) = out.split_first_chunk_mut().ok_or(EncodeError::BufferTooSmall)?;
    let header = Header {
        version: MANAGEMENT_VERSION,
        kind: Kind::Management,
        flags: if root.is_some() { FLAG_TAG } else { 0 },
        sender: stamp.sender,
        boot_epoch: stamp.boot_epoch,
        sequence: stamp.sequence,
        body_len: body.len() as u16,
    };
    *head = header.to_bytes();
    let (room, rest) = rest.split_at_mut_checked(body.len()).ok_or(EncodeError::BufferTooSmall)?;
    room.copy_from_slice(body);
    let Some(root) = root else { return Ok(HEADER_LEN + body.len()) };
    let key = root.session(Purpose::Management, stamp.sender, stamp.boot_epoch, 0);
    let tag = rest.first_chunk_mut().ok_or(EncodeError::BufferTooSmall)?;
    *tag = key.seal(stamp.sequence, head, room).ok_or(EncodeError::BufferTooSmall)?;
    Ok(HEADER_LEN + body.len() + TAG_LEN)
}

/// The message of a management frame, sealed where there is a key.
///
/// # Errors
/// [`DecodeError`]: `Version` for frames of other versions.
pub fn decode(bytes: &[u8], root: Option<&Key>) -> Result<(Header, Management), DecodeError> {
    let header = Header::read_management(bytes)?;
    let parcel = take_apart(header, bytes)?;
    let mut room = ROOM;
    let body = match root {
        Some(root) => {
            let key = root.session(Purpose::Management, header.sender, header.boot_epoch, 0);
            parcel.open(&key, &mut room)?
        }
        None => parcel.plain()?,
    };
    let message = match *body {
        [1, ..] => Management::Identify,
        [2, version_min, version_max, h0, h1, h2, h3, r0, r1, r2, ..] => Management::Identity(Identity {
            version_min,
            version_max,
            schema_hash: u32::from_le_bytes([h0, h1, h2, h3]),
            release: [r0, r1, r2],
        }),
        _ => return Err(DecodeError::Body),
    };
    Ok((header, message))
}
