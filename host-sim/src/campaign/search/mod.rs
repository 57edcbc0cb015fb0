//! The paper's baseline: drones that search at random and keep the best deployment they came by (section 4).
//!
//! - `motion`: how they move,
//! - `readings`: what of all they came by is the answer.

mod motion;
mod readings;

pub use crate::control::random_search::legs::Ground;
pub use motion::Motion;
pub use readings::Track;
pub(super) use readings::{grid, served_together};
