//! The flight code of skyroost: what runs on the companion board of every drone.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod board;
pub mod srs;
