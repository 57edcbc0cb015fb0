//! Frames of messages, and messages of frames.
//!
//! A frame is [`Header`] and body. The body is the message in
//! [postcard](https://postcard.jamesmunns.com/wire-format). A [`Sender`] numbers the frames of one link;
//! [`decode`] takes any bytes and accepts only complete frames, each of which encodes back to the same bytes.
//!
//! Where a link is sealed, the body is encrypted and a tag over header and body follows it ([`key`](crate::key));
//! [`parse`] takes such a frame apart, and [`Parcel::open`] opens it.

use crate::PROTOCOL_VERSION;
use crate::error::{DecodeError, EncodeError};
use crate::header::{FLAG_TAG, HEADER_LEN, Header, Kind, TAG_LEN};
use crate::key::{Room, SessionKey};
use crate::message::{Down, Layout, Peer, SharedState, Up, longest};
use crate::units::DroneId;
use postcard::ser_flavors::Size;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Bytes of the longest message.
pub const MAX_BODY: usize = longest(&[Up::MAX_LEN, Down::MAX_LEN, Peer::MAX_LEN]);
/// Bytes of the longest frame.
pub const MAX_FRAME: usize = HEADER_LEN + MAX_BODY + TAG_LEN;
/// Bytes of the longest frame with a [`SharedState`].
pub const MAX_STATE_FRAME: usize = HEADER_LEN + 1 + SharedState::MAX_LEN + TAG_LEN;

const _: () = assert!(MAX_BODY <= u16::MAX as usize, "the header counts the body in 16 bits");

/// One frame.
pub type Frame = heapless::Vec<u8, MAX_FRAME>;

/// A message of any kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Drone to control center.
    Up(Up),
    /// Control center to drone.
    Down(Down),
    /// Drone to fleet mates.
    Peer(Peer),
}

/// What can stand in a frame: [`Up`], [`Down`] and [`Peer`].
pub trait Body: Serialize + DeserializeOwned {
    /// The kind that says so in the header.
    const KIND: Kind;
}

impl Body for Up {
    const KIND: Kind = Kind::Up;
}

impl Body for Down {
    const KIND: Kind = Kind::Down;
}

impl Body for Peer {
    const KIND: Kind = Kind::Peer;
}

/// Who sends a frame, and its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// The sender.
    pub sender: DroneId,
    /// Boots of the sender so far.
    pub boot_epoch: u16,
    /// Number of the frame on its link.
    pub sequence: u32,
}

/// Writes a frame to the start of `out` and returns its length.
///
/// # Errors
/// [`EncodeError::BufferTooSmall`]; [`MAX_FRAME`] bytes are always enough. What `out` then holds is
/// no frame.
pub fn encode_into<B: Body>(stamp: &Stamp, body: &B, out: &mut [u8]) -> Result<usize, EncodeError> {
    write(stamp, body, None, out)
}

/// How the frames of a sender are sealed.
#[derive(Clone, Debug, PartialEq)]
struct Seal {
    key: SessionKey,
    /// Flags besides [`FLAG_TAG`].
    flags: u8,
}

fn write<B: Body>(
    stamp: &Stamp,
    body: &B,
    seal: Option<&Seal>,
    out: &mut [u8],
) -> Result<usize, EncodeError> {
    // The body goes first: the header counts its bytes.
    let tail = out.get_mut(HEADER_LEN..).ok_or(EncodeError::BufferTooSmall)?;
    let body_len = postcard::to_slice(body, tail).map_err(|_| EncodeError::BufferTooSmall)?.len();
    finish(stamp, B::KIND, body_len, seal, out).ok_or(EncodeError::BufferTooSmall)
}

/// Puts the header before a body and seals it; returns the frame's length, none where `out` is too short.
#[inline(never)] // once for all kinds: a board has little room
fn finish(stamp: &Stamp, kind: Kind, body_len: usize, seal: Option<&Seal>, out: &mut [u8]) -> Option<usize> {
    let (head, tail) = out.split_first_chunk_mut()?;
    let header = Header {
        version: PROTOCOL_VERSION,
        kind,
        flags: seal.map_or(0, |seal| FLAG_TAG | seal.flags),
        sender: stamp.sender,
        boot_epoch: stamp.boot_epoch,
        sequence: stamp.sequence,
        body_len: body_len as u16,
    };
    *head = header.to_bytes();
    let Some(Seal { key, .. }) = seal else { return Some(HEADER_LEN + body_len) };
    let (body, rest) = tail.split_at_mut_checked(body_len)?;
    let tag = rest.first_chunk_mut()?;
    *tag = key.seal(stamp.sequence, head, body)?;
    Some(HEADER_LEN + body_len + TAG_LEN)
}

/// A frame of its own.
///
/// # Errors
/// None in practice: a [`Frame`] holds every message.
pub fn encode<B: Body>(stamp: &Stamp, body: &B) -> Result<Frame, EncodeError> {
    let mut frame = Frame::new();
    frame.resize_default(MAX_FRAME).map_err(|_| EncodeError::BufferTooSmall)?;
    let len = encode_into(stamp, body, &mut frame)?;
    frame.truncate(len);
    Ok(frame)
}

/// The message of a complete frame.
///
/// # Errors
/// [`DecodeError`] says what is wrong with the bytes.
pub fn decode(bytes: &[u8]) -> Result<(Header, Message), DecodeError> {
    let (header, body) = split(bytes)?;
    let message = match header.kind {
        Kind::Up => Message::Up(decode_body(body)?),
        Kind::Down => Message::Down(decode_body(body)?),
        Kind::Peer => Message::Peer(decode_body(body)?),
        Kind::Management => return Err(DecodeError::Kind),
    };
    Ok((header, message))
}

/// Header and body of a complete frame that is not sealed. For receivers that want some kinds of message only, and
/// spare themselves the decoders of the others.
///
/// # Errors
/// [`DecodeError`] says what is wrong with the bytes, the body's own left aside.
pub fn split(bytes: &[u8]) -> Result<(Header, &[u8]), DecodeError> {
    let parcel = parse(bytes)?;
    Ok((parcel.header, parcel.plain()?))
}

/// A frame taken apart.
#[derive(Clone, Copy, Debug)]
pub struct Parcel<'a> {
    /// Its header: nothing vouches for it but the tag.
    pub header: Header,
    head: &'a [u8; HEADER_LEN],
    body: &'a [u8],
    tag: Option<&'a [u8; TAG_LEN]>,
}

/// Takes a complete frame apart, sealed or not.
///
/// # Errors
/// [`DecodeError`] says what is wrong with header and lengths.
pub fn parse(bytes: &[u8]) -> Result<Parcel<'_>, DecodeError> {
    take_apart(Header::read(bytes)?, bytes)
}

pub(crate) fn take_apart(header: Header, bytes: &[u8]) -> Result<Parcel<'_>, DecodeError> {
    let body_len = usize::from(header.body_len);
    if body_len > MAX_BODY {
        return Err(DecodeError::Length);
    }
    let (head, rest) = bytes.split_first_chunk().ok_or(DecodeError::Truncated)?;
    let (body, rest) = rest.split_at_checked(body_len).ok_or(DecodeError::Truncated)?;
    let (tag, rest) = if header.flags & FLAG_TAG == 0 {
        (None, rest)
    } else {
        let (tag, rest) = rest.split_first_chunk().ok_or(DecodeError::Truncated)?;
        (Some(tag), rest)
    };
    if rest.is_empty() { Ok(Parcel { header, head, body, tag }) } else { Err(DecodeError::TrailingBytes) }
}

impl<'a> Parcel<'a> {
    /// The body of a frame that is not sealed.
    ///
    /// # Errors
    /// [`DecodeError::Sealed`].
    pub fn plain(&self) -> Result<&'a [u8], DecodeError> {
        if self.tag.is_some() { Err(DecodeError::Sealed) } else { Ok(self.body) }
    }

    /// The body of a frame that was sealed with this key, opened in `room`.
    ///
    /// # Errors
    /// [`DecodeError::Unsealed`] and [`DecodeError::Forged`].
    pub fn open<'r>(&self, key: &SessionKey, room: &'r mut Room) -> Result<&'r [u8], DecodeError> {
        let tag = self.tag.ok_or(DecodeError::Unsealed)?;
        key.open(self.header.sequence, self.head, self.body, tag, room).ok_or(DecodeError::Forged)
    }
}

/// The message that is exactly `body`.
///
/// Postcard itself also reads varints padded with zeros, and lengths padded further on a 64-bit host than
/// on a board. Padding makes the encoding longer and nothing else does, so the length tells: host and
/// board accept the same bytes, and only those they would send.
///
/// # Errors
/// [`DecodeError::Body`].
pub fn decode_body<B: Body>(body: &[u8]) -> Result<B, DecodeError> {
    let Ok((message, [])) = postcard::take_from_bytes(body) else {
        return Err(DecodeError::Body);
    };
    match postcard::serialize_with_flavor(&message, Size::default()) {
        Ok(len) if len == body.len() => Ok(message),
        _ => Err(DecodeError::Body),
    }
}

/// Numbers the frames of one sender on one link, and seals them where it has a key.
///
/// Every link has a sender of its own, whatever the kinds of message on it, because the receiver counts
/// gaps in the sequence as losses.
#[derive(Clone, Debug)]
pub struct Sender {
    id: DroneId,
    boot_epoch: u16,
    next_sequence: u32,
    seal: Option<Seal>,
}

impl Sender {
    /// The first frame will have number 0. `boot_epoch` must rise with every boot of the sender.
    #[must_use]
    pub const fn new(id: DroneId, boot_epoch: u16) -> Self {
        Self { id, boot_epoch, next_sequence: 0, seal: None }
    }

    /// Who sends.
    #[must_use]
    pub const fn id(&self) -> DroneId {
        self.id
    }

    /// Boots of the sender so far.
    #[must_use]
    pub const fn boot_epoch(&self) -> u16 {
        self.boot_epoch
    }

    /// Number of the next frame.
    #[must_use]
    pub const fn next_sequence(&self) -> u32 {
        self.next_sequence
    }

    /// Seals frames from now on, with these flags besides that of the tag. Numbers go on.
    pub fn seal_with(&mut self, key: SessionKey, flags: u8) {
        self.seal = Some(Seal { key, flags });
    }

    /// Flags of its frames besides that of the tag; none where they are not sealed.
    pub(crate) fn seal_flags(&self) -> Option<u8> {
        self.seal.as_ref().map(|seal| seal.flags)
    }

    /// Next frame, drone to control center.
    ///
    /// # Errors
    /// [`EncodeError::Exhausted`] after 2^32 sealed ones; a [`Frame`] holds every message.
    pub fn up(&mut self, message: &Up) -> Result<Frame, EncodeError> {
        self.frame(message)
    }

    /// Next frame, control center to drone.
    ///
    /// # Errors
    /// [`EncodeError::Exhausted`] after 2^32 sealed ones; a [`Frame`] holds every message.
    pub fn down(&mut self, message: &Down) -> Result<Frame, EncodeError> {
        self.frame(message)
    }

    /// Next frame, drone to fleet mates.
    ///
    /// # Errors
    /// [`EncodeError::Exhausted`] after 2^32 sealed ones; a [`Frame`] holds every message.
    pub fn peer(&mut self, message: &Peer) -> Result<Frame, EncodeError> {
        self.frame(message)
    }

    /// Next frame, written to the start of `out`; returns its length.
    ///
    /// # Errors
    /// [`EncodeError::BufferTooSmall`], [`EncodeError::Exhausted`]; the number is then not used up.
    pub fn encode_into<B: Body>(&mut self, message: &B, out: &mut [u8]) -> Result<usize, EncodeError> {
        if self.seal.is_some() && self.next_sequence == u32::MAX {
            return Err(EncodeError::Exhausted);
        }
        let len = write(&self.stamp(), message, self.seal.as_ref(), out)?;
        self.next_sequence = self.next_sequence.wrapping_add(1);
        Ok(len)
    }

    /// The stamp of a frame that is written by other means; its number is used up.
    pub(crate) fn take_stamp(&mut self) -> Stamp {
        let stamp = self.stamp();
        self.next_sequence = self.next_sequence.wrapping_add(1);
        stamp
    }

    fn frame<B: Body>(&mut self, message: &B) -> Result<Frame, EncodeError> {
        let mut frame = Frame::new();
        frame.resize_default(MAX_FRAME).map_err(|_| EncodeError::BufferTooSmall)?;
        let len = self.encode_into(message, &mut frame)?;
        frame.truncate(len);
        Ok(frame)
    }

    const fn stamp(&self) -> Stamp {
        Stamp { sender: self.id, boot_epoch: self.boot_epoch, sequence: self.next_sequence }
    }
}
