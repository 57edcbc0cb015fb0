//! The flight code of skyroost.
//!
//! [`agent::FlightAgent::step`] is the whole of it: called 50 times a second with the time, what came
//! in since the last step and room for what goes out. It does no I/O, reads no clock, allocates
//! nothing and cannot panic, so the same code runs on a Cortex-M4F, in an emulator and in a simulation
//! of hundreds of drones, to the same bits.
//!
//! That it cannot panic is proved anew by every link of the image `step_proof` (`src/bin/step_proof.rs`): it
//! calls all of this on values unknown to the compiler, and its panic handler calls a function that does not
//! exist, `the_flight_code_can_panic`. One panic that the compiler cannot exclude, and there is no image. No
//! function calls itself, by whatever way, so the stack that a step takes is known too.
//!
//! Loop order: receive, estimate, command, avoid, supervise, transmit. The supervisor has the last word.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

pub mod agent;
pub mod avoid;
pub mod board;
pub mod config;
pub mod counters;
pub mod guidance;
pub mod io;
pub mod peers;
pub mod scalar;
pub mod srs;
pub mod supervisor;

/// A vector of metres, metres a second or metres a second squared: east, north, up.
pub type Vec3 = nalgebra::Vector3<f32>;
/// A vector in the horizontal plane: east, north.
pub type Vec2 = nalgebra::Vector2<f32>;

/// The zero vector, where the compiler needs it.
pub(crate) const ZERO: Vec3 = Vec3::new(0.0, 0.0, 0.0);

/// Rate of [`agent::FlightAgent::step`], steps a second.
pub const STEP_HZ: u32 = 50;
/// Time from one step to the next, seconds.
pub const STEP_S: f32 = 0.02;
/// Time from one step to the next, microseconds.
pub const STEP_US: i64 = 20_000;
