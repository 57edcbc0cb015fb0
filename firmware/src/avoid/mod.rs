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
#[cfg(test)]
mod laws;
mod literal;
pub mod pca;
pub mod walls;

use crate::{
    Vec3,
    guidance::limited,
    peers::{MAX_PEERS, PeerTable},
};
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

/// How gladly drones give way up and down, rather than to the side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Vertical {
    /// Never: the altitude is left to guidance.
    Level,
    /// As gladly as to the side.
    Free,
    /// More gladly: a metre to the side counts for one and a half up or down.
    #[default]
    Preferred,
}

impl Vertical {
    /// Metres up that count as one to the side.
    const fn stretch(self) -> f32 {
        match self {
            Self::Level => 0.0,
            Self::Free => 1.0,
            Self::Preferred => 1.5,
        }
    }
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
    /// Whether to give way up and down.
    pub vertical: Vertical,
}

/// Beyond this distance two drones at full speed do not meet within the horizon of [`pca`], the age of a
/// shared state and their braking ways, metres.
const REACH_M: f32 = 320.0;
/// Planned beyond `d_safe` and both error radii, metres: tracking error of the velocity loop, and what several
/// neighbours at once make of it.
const PLAN_SLACK_M: f32 = 3.0;
/// Kept at rest beyond `d_safe` and [`KEEP_ERRORS`], metres.
const KEEP_SLACK_M: f32 = 2.0;
/// Share of the error radii that the stop gate keeps: whole ones would have to point at each other.
const KEEP_ERRORS: f32 = 0.3;
/// Kept from walls beyond the own error radius, and of goals beyond `d_safe` and both error radii, metres: tracking error
/// of the velocity loop.
pub const TRACKING_M: f32 = 0.5;

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
    let near = Near::new(now, own, peers, separation);
    let walls = walls::rows(own, walls, separation.own_error_m + TRACKING_M);
    let planned = planned(own, wanted, &near, &walls);
    let passing = gate::passing(own, planned, || near.iter(), &walls);
    // Beyond all bounds (a velocity of 1e20 m/s) numbers overflow: to stop is the answer then.
    let vel_enu_mps = if passing.iter().all(|x| x.is_finite()) { passing } else { Vec3::zeros() };
    Avoided { vel_enu_mps, active: vel_enu_mps != wanted }
}

/// The peers that may matter, the nearest first: so the answer does not depend on whom the drone heard first.
///
/// They are worked out anew wherever they are needed: a board has the time for that, and not the memory to keep them.
struct Near<'a> {
    now: TimePs,
    peers: &'a PeerTable,
    separation: &'a Separation,
    /// Square of the distance, and place in the table.
    order: Vec<(f32, u8), MAX_PEERS>,
}

impl<'a> Near<'a> {
    fn new(now: TimePs, own: &Mover, peers: &'a PeerTable, separation: &'a Separation) -> Self {
        let mut order: Vec<(f32, u8), MAX_PEERS> = Vec::new();
        for (index, peer) in peers.iter().enumerate() {
            // Whatever either does within the horizon, they cannot come near: most peers end here.
            if (peer.heard_at_m() - own.pos_enu_m).norm_squared() > REACH_M * REACH_M {
                continue;
            }
            let away_m2 = (peer.predicted(now).pos_enu_m - own.pos_enu_m).norm_squared();
            // As many as there are peers.
            let _ = order.push((away_m2, index as u8));
            let mut sorted = order.as_mut_slice();
            while let [before @ .., last] = sorted {
                let Some(previous) = before.last_mut().filter(|previous| previous.0 > last.0) else { break };
                core::mem::swap(previous, last);
                sorted = before;
            }
        }
        Self { now, peers, separation, order }
    }

    fn iter(&self) -> impl Iterator<Item = Neighbour> {
        self.order.iter().filter_map(|&(_, index)| self.peers.get(usize::from(index))).map(|peer| {
            let (error_m, keep_out_m) = (peer.error_radius_m(), peer.keep_out_m(self.now));
            Neighbour {
                mover: peer.predicted(self.now),
                plan_m: self.separation.plan_m(error_m) + keep_out_m,
                keep_m: self.separation.keep_m(error_m) + keep_out_m,
            }
        })
    }
}

/// The velocity nearest to `wanted` that the half-planes of all neighbours and walls allow.
#[inline(never)] // a board has no room for the rows beside what the gate needs
fn planned(own: &Mover, wanted: Vec3, near: &Near<'_>, walls: &[HalfPlane]) -> Vec3 {
    let separation = near.separation;
    let stretch = separation.vertical.stretch();
    let mut rows: Vec<HalfPlane, MAX_ROWS> = Vec::new();
    let mut clear = true;
    for neighbour in near.iter() {
        pca::rows(own, &neighbour, |row| {
            clear &= row.allows(&wanted);
            // Two rows a neighbour, 32 neighbours and the walls fit MAX_ROWS. What no level flight can keep is left to the gate.
            let _ = row.stretched(stretch).map(|row| rows.push(row));
        });
    }
    // Last, so that every sweep over the rows ends with what does not give way. They are upright: nothing stretches them.
    let _ = rows.extend_from_slice(walls);
    if clear && walls.iter().all(|row| row.allows(&wanted)) {
        return wanted;
    }
    // In units of velocity in which up and down are as dear as they are to be.
    let up = if stretch > 0.0 { wanted.z / stretch } else { 0.0 };
    let found = halfplanes::nearest(Vec3::new(wanted.x, wanted.y, up), &rows);
    let up = if stretch > 0.0 { found.z * stretch } else { wanted.z };
    limited(Vec3::new(found.x, found.y, up), separation.max_speed_mps)
}
