//! Collision avoidance by point of closest approach (paper section 3.3 with its misprints mended).
//!
//! Each neighbour becomes a half-plane of allowed velocities whose normal is the pass distance vector
//! `l_p` of PCA ([`pca`]); the command is the wanted velocity plus the least sum of such normals that
//! satisfies all of them ([`halfplanes`]). That is the paper's vector sum (16) with solved weights: the
//! printed pairwise shares, added up over several neighbours, push a drone out of one conflict into
//! the next.

pub mod halfplanes;
pub mod pca;

use crate::{Vec3, guidance::limited, peers::PeerTable};
use halfplanes::{HalfPlane, MAX_ROWS};
use heapless::Vec;
use pca::Mover;
use skyroost_protocol::units::TimePs;

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
const PLAN_SLACK_M: f32 = 0.5;

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
pub fn avoid(now: TimePs, own: &Mover, wanted: Vec3, peers: &PeerTable, separation: &Separation) -> Avoided {
    let mut rows: Vec<HalfPlane, MAX_ROWS> = Vec::new();
    for peer in peers.iter() {
        // Whatever either does within the horizon, they cannot come near: most neighbours end here.
        if (peer.heard_at_m() - own.pos_enu_m).norm_squared() > REACH_M * REACH_M {
            continue;
        }
        let other = peer.predicted(now);
        let d_plan_m = separation.d_safe_m + separation.own_error_m + peer.error_radius_m(now) + PLAN_SLACK_M;
        pca::rows(own, &other, d_plan_m, |row| {
            // Two rows a neighbour and 32 neighbours fit MAX_ROWS.
            let _ = rows.push(row);
        });
    }
    if rows.iter().all(|row| row.allows(&wanted)) {
        return Avoided { vel_enu_mps: wanted, active: false };
    }
    let vel_enu_mps = limited(halfplanes::nearest(wanted, &rows), separation.max_speed_mps);
    Avoided { vel_enu_mps, active: true }
}
