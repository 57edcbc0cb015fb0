//! Frames over a byte link such as a UART.
//!
//! On the link a frame is a zero, then COBS (Cheshire and Baker 1999) over the frame and its CRC-32
//! (ISO-HDLC, little-endian), then a zero. COBS leaves no zero within, so that a receiver finds the
//! next frame after whatever happened to this one; and with a zero on both sides, noise between frames
//! or a lost delimiter cannot join two of them.

use crate::codec::MAX_FRAME;
use crate::error::StreamError;
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use heapless::Vec;

/// Bytes of the checksum.
const CRC_LEN: usize = 4;
/// Bytes of the longest frame with its checksum.
const MAX_PAYLOAD: usize = MAX_FRAME + CRC_LEN;
/// Bytes of the longest payload, stuffed.
const MAX_BLOCK: usize = 1 + MAX_PAYLOAD;
/// Bytes of the longest frame on the link: two delimiters and one byte of COBS more.
pub const MAX_STREAM: usize = 1 + 1 + MAX_PAYLOAD + 1;
/// Bytes that the link adds to every frame: delimiters, checksum, and one byte of COBS.
pub const FRAMING: usize = MAX_STREAM - MAX_FRAME;

const _: () = assert!(MAX_PAYLOAD <= 254, "every run of non-zero bytes is one COBS block");
const _: () = assert!(MAX_STREAM <= 256, "a frame fits the usual 256-byte buffers of radios and DMA");

/// One frame as it goes over the link.
pub type StreamFrame = Vec<u8, MAX_STREAM>;

/// Bytes that a step of the checksum takes: 16 need 16 KiB of tables, which a chip has better uses for.
/// CRC-32 (ISO-HDLC) of these bytes.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

const CRC_LANES: usize = if cfg!(feature = "fast-crc") { 16 } else { 1 };
const CRC: Crc<u32, Table<CRC_LANES>> = Crc::<u32, Table<CRC_LANES>>::new(&CRC_32_ISO_HDLC);

/// Replaces `out` by `frame` as it goes over the link.
///
/// # Errors
/// [`StreamError::Overflow`] where `frame` is longer than [`MAX_FRAME`], [`StreamError::Runt`] where it
/// is empty; `out` is then empty.
pub fn encode_stream(frame: &[u8], out: &mut StreamFrame) -> Result<(), StreamError> {
    if frame.is_empty() {
        out.clear();
        return Err(StreamError::Runt);
    }
    encode_stream_with(out, |out| out.extend_from_slice(frame))
}

/// Replaces `out` by what `fill` appends to it, as it goes over the link: saves a copy where the frame is made
/// on the spot. `fill` must leave alone what is in `out` already.
///
/// # Errors
/// [`StreamError::Overflow`] where `fill` fails or its frame is longer than [`MAX_FRAME`]; `out` is then empty.
pub fn encode_stream_with<E>(
    out: &mut StreamFrame,
    fill: impl FnOnce(&mut StreamFrame) -> Result<(), E>,
) -> Result<(), StreamError> {
    let written = write_stream(out, fill);
    if written.is_none() {
        out.clear();
    }
    written.ok_or(StreamError::Overflow)
}

/// The delimiter in front, and the place of the first code byte.
const HEAD: [u8; 2] = [0, 0];

fn write_stream<E>(
    out: &mut StreamFrame,
    fill: impl FnOnce(&mut StreamFrame) -> Result<(), E>,
) -> Option<()> {
    out.clear();
    out.extend_from_slice(&HEAD).ok()?;
    fill(out).ok()?;
    let frame = out.get(HEAD.len()..).filter(|frame| frame.len() <= MAX_FRAME)?;
    let crc = CRC.checksum(frame);
    out.extend_from_slice(&crc.to_le_bytes()).ok()?;
    // Byte-stuffing in place: each run of a payload this short is one block, so that every zero, and the
    // place in front, becomes the distance to the next one. Seen from the end, that is the last distance.
    let mut distance = 1_u8;
    for byte in out.get_mut(1..)?.iter_mut().rev() {
        if *byte == 0 {
            *byte = distance;
            distance = 0;
        }
        distance = distance.wrapping_add(1);
    }
    out.push(0).ok()
}

/// What arrived on a byte link so far; every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounters {
    /// Frames delivered.
    pub frames: u32,
    /// Dropped: the checksum did not match.
    pub crc_errors: u32,
    /// Dropped: a byte-stuffing block pointed beyond the frame.
    pub cobs_errors: u32,
    /// Dropped: longer than any frame.
    pub overflow: u32,
    /// Dropped: too short to hold anything but a checksum.
    pub runt: u32,
}

/// Finds the frames in the bytes of a link, in any portions.
///
/// Every zero starts anew, so that damage costs no more than the frame it hits.
#[derive(Clone, Debug)]
pub struct StreamDecoder {
    /// What has come of the present frame, still stuffed; or the last frame, unstuffed.
    block: Vec<u8, MAX_BLOCK>,
    state: State,
    counters: StreamCounters,
}

/// What the block holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The beginning of a frame.
    Filling,
    /// A frame that has been handed out.
    Done,
    /// Nothing: the present frame was too long and is being skipped.
    Skipping,
}

impl Default for StreamDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl StreamDecoder {
    /// A decoder at the start of a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            block: Vec::new(),
            state: State::Filling,
            counters: StreamCounters { frames: 0, crc_errors: 0, cobs_errors: 0, overflow: 0, runt: 0 },
        }
    }

    /// What arrived so far.
    #[must_use]
    pub const fn counters(&self) -> &StreamCounters {
        &self.counters
    }

    /// Takes the next byte; yields a frame, or what is wrong with one, when it is complete.
    ///
    /// # Errors
    /// A [`StreamError`] for each damaged frame; the next frame is found regardless.
    #[inline]
    pub fn push(&mut self, byte: u8) -> Option<Result<&[u8], StreamError>> {
        self.take(&[byte]).1
    }

    /// Takes bytes up to the end of the first frame among them; returns how many it took, and the frame or
    /// what is wrong with it. Without a frame it takes all.
    pub fn take(&mut self, bytes: &[u8]) -> (usize, Option<Result<&[u8], StreamError>>) {
        let mut taken = 0;
        while let Some(rest) = bytes.get(taken..).filter(|rest| !rest.is_empty()) {
            let zero = rest.iter().position(|byte| *byte == 0);
            let piece = zero.and_then(|zero| rest.get(..zero)).unwrap_or(rest);
            taken += piece.len() + usize::from(zero.is_some());
            match (self.state, zero) {
                (State::Skipping, None) => continue,
                (State::Skipping, Some(_)) => {
                    self.state = State::Filling;
                    continue;
                }
                (State::Done, _) => {
                    self.block.clear();
                    self.state = State::Filling;
                }
                (State::Filling, _) => {}
            }
            if self.block.extend_from_slice(piece).is_err() {
                self.block.clear();
                self.state = if zero.is_none() { State::Skipping } else { State::Filling };
                return (taken, Some(Err(self.counters.refuse(StreamError::Overflow))));
            }
            // Two delimiters in a row have nothing between them.
            if zero.is_none() || self.block.is_empty() {
                continue;
            }
            self.state = State::Done;
            return (taken, Some(self.finish()));
        }
        (taken, None)
    }

    /// The frame in a whole block.
    fn finish(&mut self) -> Result<&[u8], StreamError> {
        match unstuff(&mut self.block).and_then(|()| check(self.block.get(1..).unwrap_or(&[]))) {
            Ok(()) => {
                self.counters.frames = self.counters.frames.saturating_add(1);
                let payload = self.block.get(1..).unwrap_or(&[]);
                Ok(payload.split_last_chunk::<CRC_LEN>().map_or(&[][..], |(frame, _)| frame))
            }
            Err(error) => Err(self.counters.refuse(error)),
        }
    }
}

/// Turns every code byte, which says how far it is to the next one, back into the zero that it stands for; the
/// first one stands for none.
fn unstuff(block: &mut [u8]) -> Result<(), StreamError> {
    let mut rest = block;
    while let Some((code, run)) = rest.split_first_mut() {
        let len = usize::from(*code).saturating_sub(1); // a block has no zeros
        *code = 0;
        rest = run.get_mut(len..).ok_or(StreamError::Cobs)?;
    }
    Ok(())
}

/// Whether a payload has the right checksum.
fn check(payload: &[u8]) -> Result<(), StreamError> {
    let (frame, crc) = payload.split_last_chunk::<CRC_LEN>().ok_or(StreamError::Runt)?;
    if frame.is_empty() {
        return Err(StreamError::Runt);
    }
    if CRC.checksum(frame) != u32::from_le_bytes(*crc) {
        return Err(StreamError::Crc);
    }
    Ok(())
}

impl StreamCounters {
    const fn refuse(&mut self, error: StreamError) -> StreamError {
        let counter = match error {
            StreamError::Crc => &mut self.crc_errors,
            StreamError::Cobs => &mut self.cobs_errors,
            StreamError::Overflow => &mut self.overflow,
            StreamError::Runt => &mut self.runt,
        };
        *counter = counter.saturating_add(1);
        error
    }
}
