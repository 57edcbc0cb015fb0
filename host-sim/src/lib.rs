//! The std side of skyroost: the control center, a simulated world, and the runner that lets the
//! flight code of `skyroost-firmware` fly whole missions between the two.
//!
//! Rooms and their imports (one way only): `geometry` <- `control`; `world` knows the flight code and
//! the protocol but never `control`; `runner` ties the two together; `campaign` runs many; `report` and `cli` sit on top.
#![forbid(unsafe_code)]

pub mod campaign;
pub mod cli;
pub mod control;
pub mod encounter;
pub mod fleet;
pub mod geometry;
pub mod recording;
pub mod report;
pub mod rng;
pub mod runner;
pub mod scenario;
pub mod world;
