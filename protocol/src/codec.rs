//! Frames of messages, and messages of frames.
//!
//! A frame is [`Header`], body and, where its flag is set, an authentication tag. The body is the message
//! in [postcard](https://postcard.jamesmunns.com/wire-format). A [`Sender`] numbers the frames of one
//! link; [`decode`] takes any bytes and accepts only complete frames, each of which encodes back to the
//! same bytes.

use crate::PROTOCOL_VERSION;
use crate::error::{DecodeError, EncodeError};
use crate::header::{FLAG_TAG, HEADER_LEN, Header, Kind, TAG_LEN};
use crate::message::{Down, Layout, Peer, Up, longest};
use crate::units::DroneId;
use postcard::ser_flavors::Size;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Bytes of the longest message.
pub const MAX_BODY: usize = longest(&[Up::MAX_LEN, Down::MAX_LEN, Peer::MAX_LEN]);
/// Bytes of the longest frame.
pub const MAX_FRAME: usize = HEADER_LEN + MAX_BODY + TAG_LEN;

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
    // The body goes first: the header counts its bytes.
    let (head, tail) = out.split_first_chunk_mut().ok_or(EncodeError::BufferTooSmall)?;
    let body_len = postcard::to_slice(body, tail).map_err(|_| EncodeError::BufferTooSmall)?.len();
    let header = Header {
        version: PROTOCOL_VERSION,
        kind: B::KIND,
        flags: 0,
        sender: stamp.sender,
        boot_epoch: stamp.boot_epoch,
        sequence: stamp.sequence,
        body_len: body_len as u16,
    };
    *head = header.to_bytes();
    Ok(HEADER_LEN + body_len)
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
    };
    Ok((header, message))
}

/// Header and body of a complete frame. For receivers that want some kinds of message only, and spare
/// themselves the decoders of the others.
///
/// # Errors
/// [`DecodeError`] says what is wrong with the bytes, the body's own left aside.
pub fn split(bytes: &[u8]) -> Result<(Header, &[u8]), DecodeError> {
    let header = Header::read(bytes)?;
    let body_len = usize::from(header.body_len);
    if body_len > MAX_BODY {
        return Err(DecodeError::Length);
    }
    let tagged = header.flags & FLAG_TAG != 0;
    let frame_len = HEADER_LEN + body_len + if tagged { TAG_LEN } else { 0 };
    if bytes.len() > frame_len {
        return Err(DecodeError::TrailingBytes);
    }
    if bytes.len() < frame_len {
        return Err(DecodeError::Truncated);
    }
    if tagged {
        return Err(DecodeError::TagUnsupported);
    }
    Ok((header, bytes.get(HEADER_LEN..).ok_or(DecodeError::Truncated)?))
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

/// Numbers the frames of one sender on one link.
///
/// Every link has a sender of its own, whatever the kinds of message on it, because the receiver counts
/// gaps in the sequence as losses.
#[derive(Clone, Debug)]
pub struct Sender {
    id: DroneId,
    boot_epoch: u16,
    next_sequence: u32,
}

impl Sender {
    /// The first frame will have number 0. `boot_epoch` must rise with every boot of the sender.
    #[must_use]
    pub const fn new(id: DroneId, boot_epoch: u16) -> Self {
        Self { id, boot_epoch, next_sequence: 0 }
    }

    /// Who sends.
    #[must_use]
    pub const fn id(&self) -> DroneId {
        self.id
    }

    /// Number of the next frame.
    #[must_use]
    pub const fn next_sequence(&self) -> u32 {
        self.next_sequence
    }

    /// Next frame, drone to control center.
    ///
    /// # Errors
    /// None in practice: a [`Frame`] holds every message.
    pub fn up(&mut self, message: &Up) -> Result<Frame, EncodeError> {
        self.frame(message)
    }

    /// Next frame, control center to drone.
    ///
    /// # Errors
    /// None in practice: a [`Frame`] holds every message.
    pub fn down(&mut self, message: &Down) -> Result<Frame, EncodeError> {
        self.frame(message)
    }

    /// Next frame, drone to fleet mates.
    ///
    /// # Errors
    /// None in practice: a [`Frame`] holds every message.
    pub fn peer(&mut self, message: &Peer) -> Result<Frame, EncodeError> {
        self.frame(message)
    }

    /// Next frame, written to the start of `out`; returns its length.
    ///
    /// # Errors
    /// [`EncodeError::BufferTooSmall`]; the number is then not used up.
    pub fn encode_into<B: Body>(&mut self, message: &B, out: &mut [u8]) -> Result<usize, EncodeError> {
        let len = encode_into(&self.stamp(), message, out)?;
        self.next_sequence = self.next_sequence.wrapping_add(1);
        Ok(len)
    }

    fn frame<B: Body>(&mut self, message: &B) -> Result<Frame, EncodeError> {
        let frame = encode(&self.stamp(), message)?;
        self.next_sequence = self.next_sequence.wrapping_add(1);
        Ok(frame)
    }

    const fn stamp(&self) -> Stamp {
        Stamp { sender: self.id, boot_epoch: self.boot_epoch, sequence: self.next_sequence }
    }
}
