//! What the whole-mission tests in `tests/tests/` share.
#![forbid(unsafe_code)]

pub mod boards;
pub mod faults;
pub mod flight_board;
pub mod fuzz;
pub mod line;
pub mod mission;
pub mod processes;
pub mod report_check;
pub mod webdriver;
