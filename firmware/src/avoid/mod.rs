//! Collision avoidance by point of closest approach (paper section 3.3 with its misprints mended).
//!
//! Each neighbour becomes a half-plane of allowed velocities whose normal is the pass distance vector
//! `l_p` of PCA ([`pca`]); the command is the wanted velocity plus the least sum of such normals that
//! satisfies all of them ([`halfplanes`]). That is the paper's vector sum (16) with solved weights: the
//! printed pairwise shares, added up over several neighbours, push a drone out of one conflict into
//! the next. A second half-plane asks the same of paths on which both brake ([`braking`]), and the
//! [`gate`] lets nothing pass that could not be stopped in time.

pub mod braking;
pub mod gate;
pub mod halfplanes;
mod literal;
pub mod pca;

use crate::{
    Vec3,
    guidance::limited,
    peers::{MAX_PEERS, PeerTable},
};
use halfplanes::{HalfPlane, MAX_ROWS};
use heapless::Vec;
use pca::Mover;
use skyroost_protocol::units::TimePs;

/// How conflicts are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// All neighbours at once.
    #[default]
    HalfPlanes,
    /// The paper's pairwise shares (13) to (17), for comparison: it breaks the separation in four of ten crossings.
    LiteralPca,
}

/// What avoidance must keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Separation {
    /// Separation of true centres to keep from everybody, metres (the paper's `d_safe`).
    pub d_safe_m: f32,
    /// Own position error radius, metres (the paper's `r_s`).
    pub own_error_m: f32,
    /// Greatest speed that may be commanded, metres a second.
    pub max_speed_mps: f32,
}

/// Beyond this distance two drones at full speed do not meet within the horizon of [`pca`], the age of a
/// shared state and their braking ways, metres.
const REACH_M: f32 = 320.0;
/// Planned beyond `d_safe` and both error radii, metres: tracking error of the velocity loop, and what several
/// neighbours at once make of it.
const PLAN_SLACK_M: f32 = 2.0;
/// Kept at rest beyond `d_safe` and [`KEEP_ERRORS`], metres.
const KEEP_SLACK_M: f32 = 1.0;
/// Share of the error radii that the stop gate keeps: whole ones would have to point at each other.
const KEEP_ERRORS: f32 = 0.5;

/// A neighbour that may matter, and the distances to keep from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Neighbour {
    /// Where it is and how it moves.
    pub mover: Mover,
    /// Distance that passing each other is planned with, metres.
    pub plan_m: f32,
    /// Distance to be kept when both have braked, metres.
    pub keep_m: f32,
}

impl Separation {
    /// Distance that passing a neighbour is planned with (`d_plan`), metres.
    #[must_use]
    pub fn plan_m(&self, other_error_m: f32) -> f32 {
        self.d_safe_m + self.own_error_m + other_error_m + PLAN_SLACK_M
    }

    /// Distance to be kept from a neighbour when both have braked, metres.
    #[must_use]
    pub fn keep_m(&self, other_error_m: f32) -> f32 {
        self.d_safe_m + (self.own_error_m + other_error_m) * KEEP_ERRORS + KEEP_SLACK_M
    }
}

/// What avoidance made of the wanted velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Avoided {
    /// Velocity to command.
    pub vel_enu_mps: Vec3,
    /// Whether it differs from the wanted one.
    pub active: bool,
}

/// The velocity nearest to `wanted` that keeps the separation from every neighbour in `peers`.
#[must_use]
pub fn avoid(
    now: TimePs,
    own: &Mover,
    wanted: Vec3,
    peers: &PeerTable,
    separation: &Separation,
    rule: Rule,
) -> Avoided {
    match rule {
        Rule::HalfPlanes => by_halfplanes(now, own, wanted, peers, separation),
        Rule::LiteralPca => {
            let shares = literal::displacement_mps(now, own, peers, separation);
            let active = shares.norm_squared() > 0.0;
            Avoided { vel_enu_mps: limited(wanted + shares, separation.max_speed_mps), active }
        }
    }
}

fn by_halfplanes(
    now: TimePs,
    own: &Mover,
    wanted: Vec3,
    peers: &PeerTable,
    separation: &Separation,
) -> Avoided {
    let mut neighbours: Vec<Neighbour, MAX_PEERS> = Vec::new();
    for peer in peers.iter() {
        // Whatever either does within the horizon, they cannot come near: most neighbours end here.
        if (peer.heard_at_m() - own.pos_enu_m).norm_squared() > REACH_M * REACH_M {
            continue;
        }
        let error_m = peer.error_radius_m(now);
        let (plan_m, keep_m) = (separation.plan_m(error_m), separation.keep_m(error_m));
        // As many as there are peers.
        let _ = neighbours.push(Neighbour { mover: peer.predicted(now), plan_m, keep_m });
    }
    let planned = planned(own, wanted, &neighbours, separation.max_speed_mps);
    let vel_enu_mps = gate::passing(own, planned, &neighbours);
    Avoided { vel_enu_mps, active: vel_enu_mps != wanted }
}

/// The velocity nearest to `wanted` that the half-planes of all neighbours allow.
#[inline(never)] // a board has no room for the rows beside what the gate needs
fn planned(own: &Mover, wanted: Vec3, neighbours: &[Neighbour], max_speed_mps: f32) -> Vec3 {
    let mut rows: Vec<HalfPlane, MAX_ROWS> = Vec::new();
    for neighbour in neighbours {
        pca::rows(own, neighbour, |row| {
            // Two rows a neighbour and 32 neighbours fit MAX_ROWS.
            let _ = rows.push(row);
        });
    }
    if rows.iter().all(|row| row.allows(&wanted)) {
        return wanted;
    }
    limited(halfplanes::nearest(wanted, &rows), max_speed_mps)
}
