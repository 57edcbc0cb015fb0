//! What a run leaves for people to look at.

pub mod accuracy;
pub mod campaign;
mod chart;
mod earth;
pub mod encounter;
pub(crate) mod figures;
pub mod html;
pub mod limits;
pub mod locate;
mod map;
pub mod place;
pub mod summary;
mod summary_text;
pub mod sweep;
pub mod tables;
