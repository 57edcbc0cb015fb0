//! What can be wrong with a frame, one enum per operation.

use core::fmt;

/// Why a message could not be encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The output buffer is shorter than the frame.
    BufferTooSmall,
    /// All numbers of the session are used up: what is sealed next would have the number of another frame.
    Exhausted,
}

/// Why bytes are not a frame of this protocol. No bytes whatsoever make the decoder panic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// Fewer bytes than the header, or than the header announces.
    Truncated,
    /// The first two bytes are not this protocol's.
    Magic,
    /// A protocol version that is not spoken here.
    Version {
        /// The version of the frame.
        found: u8,
    },
    /// A kind of message that does not exist.
    Kind,
    /// A flag bit without a meaning.
    Flags,
    /// The header announces a body longer than any message.
    Length,
    /// The body is not an encoding of a message of its kind.
    Body,
    /// More bytes than the header announces.
    TrailingBytes,
    /// The frame is sealed, and there is no key here to open it.
    Sealed,
    /// The frame is not sealed, and no other is accepted here.
    Unsealed,
    /// The tag is not that of header and body: forged, damaged, or sealed by another key.
    Forged,
}

/// Why bytes between two delimiters of a byte link are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamError {
    /// The checksum does not match.
    Crc,
    /// A byte-stuffing block points beyond its frame.
    Cobs,
    /// Longer than any frame.
    Overflow,
    /// Too short to hold anything but a checksum.
    Runt,
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BufferTooSmall => f.write_str("the output buffer is shorter than the frame"),
            Self::Exhausted => f.write_str("no number is left for another sealed frame"),
        }
    }
}

impl fmt::Display for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated => f.write_str("the frame is cut short"),
            Self::Magic => f.write_str("not a skyroost frame: wrong magic bytes"),
            Self::Version { found } => write!(
                f,
                "the frame speaks protocol version {found}, expected {} to {}",
                crate::MIN_PROTOCOL_VERSION,
                crate::PROTOCOL_VERSION
            ),
            Self::Kind => f.write_str("unknown kind of message"),
            Self::Flags => f.write_str("unknown flag bits are set"),
            Self::Length => f.write_str("the announced body is longer than any message"),
            Self::Body => f.write_str("the body does not decode as a message of its kind"),
            Self::TrailingBytes => f.write_str("bytes follow the end of the frame"),
            Self::Sealed => f.write_str("the frame is sealed, and there is no key to open it"),
            Self::Unsealed => f.write_str("the frame is not sealed, expected a sealed one"),
            Self::Forged => f.write_str("the tag is not that of header and body"),
        }
    }
}

impl fmt::Display for StreamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Crc => "checksum mismatch",
            Self::Cobs => "byte stuffing points beyond the frame",
            Self::Overflow => "longer than any frame",
            Self::Runt => "shorter than a checksum",
        })
    }
}

impl core::error::Error for EncodeError {}
impl core::error::Error for DecodeError {}
impl core::error::Error for StreamError {}
