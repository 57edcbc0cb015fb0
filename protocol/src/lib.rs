//! What crosses the radio between the drones and the control center of skyroost, and nothing else:
//! messages with a fixed header in bounded frames, without allocation and without panics.
#![no_std]
#![forbid(unsafe_code)]

pub mod message;
pub mod units;

/// Version of the wire format. Raised whenever the bytes of a message change.
pub const PROTOCOL_VERSION: u8 = 1;
