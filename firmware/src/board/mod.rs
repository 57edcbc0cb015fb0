//! What the boards' shells share. A shell owns the drivers and the clock of one board and calls the
//! flight code, which has neither; what can be decided without hardware is decided here, where the
//! host can test it. The shells themselves are the images under `bin/`.

pub mod autopilot;
pub mod boot;
pub mod bus;
pub mod bus_mode;
pub mod cadence;
#[cfg(all(target_arch = "arm", target_os = "none", feature = "shell"))]
pub mod fly;
pub mod grid;
pub mod inflight;
pub mod lockstep;
pub mod provision;
#[cfg(all(target_arch = "arm", target_os = "none", feature = "shell"))]
pub mod shell;
pub mod ticks;
pub mod triggers;
