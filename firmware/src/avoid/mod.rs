//! Collision avoidance by point of closest approach (paper section 3.3 with its misprints mended).
//!
//! Each neighbour becomes a half-plane of allowed velocities whose normal is the pass distance vector
//! `l_p` of PCA ([`pca`]); the command is the wanted velocity plus the least sum of such normals that
//! satisfies all of them ([`halfplanes`]). That is the paper's vector sum (16) with solved weights: the
//! printed pairwise shares, added up over several neighbours, push a drone out of one conflict into
//! the next.

pub mod gate;
pub mod halfplanes;
mod literal;
pub mod pca;
pub mod walls;

use crate::{
    Vec3,
    guidance::limited,
    peers::{MAX_PEERS, PeerTable},
};
use gate::Neighbour;
use halfplanes::{HalfPlane, MAX_ROWS};
use heapless::Vec;
use pca::Mover;
use skyroost_protocol::units::TimePs;
use walls::Wall;

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
/// Beyond `d_safe` and both error radii, metres: tracking error of the velocity loop.
pub const PLAN_SLACK_M: f32 = 0.5;

/// The gate keeps less than the plan, so that it speaks where the plan fails, metres.
const GATE_LESS_M: f32 = 1.5;

/// What avoidance made of the wanted velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Avoided {
    /// Velocity to command.
    pub vel_enu_mps: Vec3,
    /// Whether it differs from the wanted one.
    pub active: bool,
}

/// The velocity nearest to `wanted` that keeps the separation from every neighbour in `peers` and meets none of the
/// `walls`, which the paper's rule knows nothing of.
#[must_use]
pub fn avoid(
    now: TimePs,
    own: &Mover,
    wanted: Vec3,
    peers: &PeerTable,
    walls: impl Iterator<Item = Wall>,
    separation: &Separation,
    rule: Rule,
) -> Avoided {
    match rule {
        Rule::HalfPlanes => by_halfplanes(now, own, wanted, peers, walls, separation),
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
    walls: impl Iterator<Item = Wall>,
    separation: &Separation,
) -> Avoided {
    let mut rows: Vec<HalfPlane, MAX_ROWS> = Vec::new();
    let mut neighbours: Vec<Neighbour, MAX_PEERS> = Vec::new();
    for peer in peers.iter() {
        // Whatever either does within the horizon, they cannot come near: most neighbours end here.
        if (peer.heard_at_m() - own.pos_enu_m).norm_squared() > REACH_M * REACH_M {
            continue;
        }
        let other = peer.predicted(now);
        let d_plan_m = separation.d_safe_m + separation.own_error_m + peer.error_radius_m(now) + PLAN_SLACK_M;
        let keep_m = d_plan_m - GATE_LESS_M;
        let _ = neighbours.push(Neighbour { mover: other, keep_m });
        pca::rows(own, &other, d_plan_m, |row| {
            // Two rows a neighbour, 32 neighbours and the walls fit MAX_ROWS.
            let _ = rows.push(row);
        });
    }
    // Last, so that every sweep over the rows ends with what does not give way.
    let first_wall = walls::add_rows(own, walls, separation.own_error_m + PLAN_SLACK_M, &mut rows);
    let clear = rows.iter().all(|row| row.allows(&wanted));
    let nearest =
        if clear { wanted } else { limited(halfplanes::nearest(wanted, &rows), separation.max_speed_mps) };
    let vel_enu_mps = gate::passing(own, nearest, &neighbours, rows.get(first_wall..).unwrap_or_default());
    Avoided { vel_enu_mps, active: vel_enu_mps != wanted }
}
