//! From the capture of a sounding signal (SRS) to a difference of arrival times.
//!
//! The capture timer counts in 32 bits and wraps within seconds; [`capture`] extends its values to 64
//! bits, [`clock`] turns ticks into picoseconds, and [`tdoa`] pairs the arrivals of one transmission at
//! the serving drone with those at its fleet mates. All arithmetic is in integers and exact.

pub mod capture;
pub mod clock;
pub mod tdoa;

pub use capture::TickExtender;
pub use clock::{TickRate, ZeroTickRate};
pub use tdoa::{OwnCapture, Pairing, PairingCounters};
