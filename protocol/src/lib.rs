//! What crosses the radio between the drones and the control center of skyroost, and nothing else:
//! messages with a fixed header in bounded frames, without allocation and without panics.
//!
//! - [`message`] says what can be said; [postcard](https://postcard.jamesmunns.com/wire-format) writes it
//!   as bytes, each value in the shortest of its encodings and no other;
//! - [`header`] and [`codec`] make frames of messages and messages of frames;
//! - [`key`] seals frames, so that nobody reads or forges them;
//! - [`session`] tells a receiver which frames are new, and how many were lost;
//! - [`budget`] says what may be said on a link of limited rate;
//! - [`end`] is either end of the link between a drone and the control center, which agrees on keys;
//! - [`manage`] is what all versions understand of each other;
//! - [`stream`] carries frames over byte links such as a UART.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod budget;
pub mod codec;
pub mod end;
pub mod error;
pub mod header;
pub mod key;
pub mod manage;
pub mod message;
pub mod session;
pub mod stream;
pub mod units;

pub use codec::{Body, Frame, MAX_BODY, MAX_FRAME, Message, Sender, Stamp, decode};
pub use end::{LinkEnd, LinkFault, Opened};
pub use error::{DecodeError, EncodeError, StreamError};
pub use header::{HEADER_LEN, Header, Kind, TAG_LEN};
pub use key::{Key, Purpose, SessionKey};
pub use message::SCHEMA_HASH;
pub use session::{Receiver, Verdict};
pub use stream::{MAX_STREAM, StreamDecoder, StreamFrame, encode_stream, encode_stream_with};

/// Version of the wire format. Raised whenever the bytes of a message change.
pub const PROTOCOL_VERSION: u8 = 5;
/// Oldest version whose frames are still decoded.
pub const MIN_PROTOCOL_VERSION: u8 = 5;
