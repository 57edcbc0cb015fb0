//! The control center: everything it knows of the world comes as protocol messages.

pub mod accuracy;
pub mod air_to_ground;
pub mod airspace;
pub mod area;
pub mod assemble;
pub mod assign;
pub mod captures;
pub mod journal;
pub mod keys;
pub mod localize;
pub mod located;
pub mod mission;
pub mod place;
mod quoted;
pub mod random_search;
pub mod regroup;
pub mod relay;
mod rows;
pub mod srs_schedule;
pub mod sweep;
