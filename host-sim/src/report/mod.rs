//! What a run leaves for people to look at.

pub mod html;
pub mod limits;
pub mod summary;
mod summary_text;
pub mod sweep;
pub mod tables;
