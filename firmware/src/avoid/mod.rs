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
    peers::{MAX_PEERS, Peer, PeerTable},
    scalar::greater,
};
use halfplanes::{HalfPlane, MAX_ROWS};
use heapless::Vec;
use pca::Mover;
pub use skyroost_protocol::message::Vertical;
use skyroost_protocol::{
    message::Manner,
    units::{DroneId, TimePs},
};
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

/// Metres up that count as one to the side.
const fn stretch(vertical: Vertical) -> f32 {
    match vertical {
        Vertical::Level => 0.0,
        Vertical::Free => 1.0,
        Vertical::Preferred => 1.5,
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
    /// What the others are told of how this drone flies.
    pub manner: Manner,
    /// From the centre of the formation that this drone flies in to the drone itself, metres; zero for one that flies alone.
    pub arm_m: Vec3,
    /// Whether this drone stands still as nobody tells it of the others. Who is silent may be anywhere, and keeps clear of one that is:
    /// to flee from where it may be would only be to fly where nobody expects it.
    pub waits: bool,
}

/// Beyond this distance two drones at full speed do not meet within the horizon of [`pca`], the age of a
/// shared state and their braking ways, metres.
const REACH_M: f32 = 320.0;
/// No usual formation is wider than this about its centre, metres; of a wider one not all drones see another fleet at once.
const FLEET_RADIUS_M: f32 = 60.0;
/// Drones of a fleet.
const FLEET_DRONES: f32 = 3.0;
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
    /// Which part of the displacement is this drone's.
    pub part: Part,
}

/// A drone's part of the displacement that a pair needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Part {
    /// Its share, as the other takes its own.
    #[default]
    Share,
    /// All: the other cannot manoeuvre.
    All,
    /// Nothing as long as both can still brake: the other gives way, or both keep their slots.
    Nothing,
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

    /// Whether a peer flies in the same formation.
    fn is_mate(&self, peer: &Peer) -> bool {
        peer.manner().fleet().is_some_and(|fleet| self.manner.fleet() == Some(fleet))
    }

    /// A peer as a neighbour by itself.
    fn neighbour(&self, peer: &Peer, now: TimePs) -> Neighbour {
        let (error_m, keep_out_m) = (peer.error_radius_m(), peer.keep_out_m(now));
        Neighbour {
            mover: peer.predicted(now),
            plan_m: self.plan_m(error_m) + keep_out_m,
            keep_m: self.keep_m(error_m) + keep_out_m,
            part: self.part(peer.manner()),
        }
    }

    /// The part of the displacement that is this drone's.
    fn part(&self, others: Manner) -> Part {
        match (self.manner == Manner::UNABLE, others == Manner::UNABLE) {
            (false, true) => Part::All,
            (true, false) => Part::Nothing,
            // Two that both cannot do what they would have to do what they can.
            _ => Part::Share,
        }
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
    // Fleets plan as bodies; what may be flown is decided for every drone by itself.
    let passing = gate::passing(own, planned, || near.each(), &walls);
    // Beyond all bounds (a velocity of 1e20 m/s) numbers overflow: to stop is the answer then.
    let vel_enu_mps = if passing.iter().all(|x| x.is_finite()) { passing } else { Vec3::zeros() };
    Avoided { vel_enu_mps, active: vel_enu_mps != wanted }
}

/// The peers that may matter, the nearest first: so the answer does not depend on whom the drone heard first.
///
/// Distances are those to this drone or, for a fleet in formation, to its circle. They are worked out anew wherever they are needed: a board has the time for that, and not the memory to keep them.
struct Near<'a> {
    now: TimePs,
    own_m: Vec3,
    peers: &'a PeerTable,
    separation: &'a Separation,
    /// Square of the distance, and place in the table.
    order: Vec<(f32, u8), MAX_PEERS>,
}

impl<'a> Near<'a> {
    fn new(now: TimePs, own: &Mover, peers: &'a PeerTable, separation: &'a Separation) -> Self {
        let mut order: Vec<(f32, u8), MAX_PEERS> = Vec::new();
        let centre_m = own.pos_enu_m - separation.arm_m;
        for (index, peer) in peers.iter().enumerate() {
            // Whatever either does within the horizon, they cannot come near: most peers end here.
            if !is_in_reach(&centre_m, peer, peers) {
                continue;
            }
            if separation.waits && peer.keep_out_m(now) > 0.0 {
                continue;
            }
            let neighbour = separation.neighbour(peer, now);
            // A mate is only ever braked for, and in its slot it is too far away for that.
            let is_mate = separation.is_mate(peer);
            if is_mate && braking::is_clear(own, &neighbour, pca::STOP_SPARE_M, gate::REACHED_MPS) {
                continue;
            }
            let away_m2 = (neighbour.mover.pos_enu_m - own.pos_enu_m).norm_squared();
            // As many as there are peers.
            let _ = order.push((away_m2, index as u8));
            let mut sorted = order.as_mut_slice();
            while let [before @ .., last] = sorted {
                let Some(previous) = before.last_mut().filter(|previous| previous.0 > last.0) else { break };
                core::mem::swap(previous, last);
                sorted = before;
            }
        }
        Self { now, own_m: own.pos_enu_m, peers, separation, order }
    }

    /// Every neighbour for itself.
    fn each(&self) -> impl Iterator<Item = Neighbour> {
        self.near().map(|peer| self.separation.neighbour(peer, self.now))
    }

    /// Neighbours, with a fleet in formation as one body: its circle keeps clear of others, so that its drones shift alike and
    /// keep their triangle, and others keep clear of it. Whoever is within a circle already is avoided by each for itself.
    fn bodies(&self) -> impl Iterator<Item = Neighbour> {
        self.near().filter_map(|peer| match self.formation(peer) {
            Some((formation, nearest)) => (nearest == peer.drone()).then_some(formation),
            None => {
                let mut neighbour = self.separation.neighbour(peer, self.now);
                if self.separation.is_mate(peer) {
                    // Its slot keeps it where it is: gusts that push two mates towards each other are no course to pass on.
                    neighbour.part = Part::Nothing;
                } else {
                    self.keep_clear(&mut neighbour);
                }
                Some(neighbour)
            }
        })
    }

    fn near(&self) -> impl Iterator<Item = &'a Peer> {
        self.order.iter().filter_map(|&(_, index)| self.peers.get(usize::from(index)))
    }

    /// Another fleet in formation as one neighbour, and the nearest of its drones: their mean, with a circle around all
    /// three. None unless all are heard of lately, and the circle is still clear of this drone or of its own circle.
    fn formation(&self, of: &Peer) -> Option<(Neighbour, DroneId)> {
        let fleet = of.manner().fleet()?;
        if self.separation.is_mate(of) {
            return None;
        }
        let members = || self.peers.iter().filter(move |peer| peer.manner().fleet() == Some(fleet));
        let nearest = self.near().find(|peer| peer.manner().fleet() == Some(fleet))?.drone();
        let (mut count, mut error_m) = (0_u8, 0.0);
        let mut mean = Mover::default();
        for peer in members() {
            if peer.keep_out_m(self.now) > 0.0 {
                return None;
            }
            let mover = peer.predicted(self.now);
            mean.pos_enu_m += mover.pos_enu_m / FLEET_DRONES;
            mean.vel_enu_mps += mover.vel_enu_mps / FLEET_DRONES;
            error_m = greater(error_m, peer.error_radius_m());
            count += 1;
        }
        if f32::from(count) != FLEET_DRONES {
            return None;
        }
        let mut radius_m = 0.0;
        for peer in members() {
            radius_m = greater(radius_m, (peer.predicted(self.now).pos_enu_m - mean.pos_enu_m).norm());
        }
        let mut neighbour = Neighbour {
            mover: mean,
            plan_m: self.separation.plan_m(error_m) + radius_m,
            keep_m: self.separation.keep_m(error_m) + radius_m,
            part: self.separation.part(of.manner()),
        };
        self.keep_clear(&mut neighbour).then_some((neighbour, nearest))
    }

    /// Keeps the circle of the own formation away from a neighbour, as seen from this drone: as seen from the circle's
    /// centre, the circle's radius farther away. False, and nothing done, where the neighbour is within already.
    fn keep_clear(&self, neighbour: &mut Neighbour) -> bool {
        let arm_m = self.separation.arm_m;
        let radius_m = arm_m.norm();
        let away_m = neighbour.mover.pos_enu_m - (self.own_m - arm_m);
        let least_m = radius_m + neighbour.keep_m;
        let is_clear = away_m.norm_squared() > least_m * least_m;
        if is_clear {
            neighbour.mover.pos_enu_m += arm_m;
            neighbour.plan_m += radius_m;
            neighbour.keep_m += radius_m;
        }
        is_clear
    }
}

/// Whether a peer, by where it was last heard, may matter to a drone or to the formation that has its centre there.
///
/// Fleets are looked for from centre to centre, so that all of a fleet see another one at once.
fn is_in_reach(centre_m: &Vec3, peer: &Peer, peers: &PeerTable) -> bool {
    let away_m2 = |from_m: Vec3| (from_m - centre_m).norm_squared();
    let own_m2 = away_m2(peer.heard_at_m());
    let Some(fleet) = peer.manner().fleet() else { return own_m2 <= REACH_M * REACH_M };
    let (surely_m, hardly_m) = (REACH_M - FLEET_RADIUS_M, REACH_M + FLEET_RADIUS_M);
    // Few are where their mates have to be asked for.
    if own_m2 <= surely_m * surely_m || own_m2 > hardly_m * hardly_m {
        return own_m2 <= surely_m * surely_m;
    }
    let members = || peers.iter().filter(|other| other.manner().fleet() == Some(fleet));
    let sum_m = members().fold(Vec3::zeros(), |sum_m, other| sum_m + other.heard_at_m());
    away_m2(sum_m / members().count() as f32) <= REACH_M * REACH_M
}

/// The velocity nearest to `wanted` that the half-planes of all neighbours and walls allow.
#[inline(never)] // a board has no room for the rows beside what the gate needs
fn planned(own: &Mover, wanted: Vec3, near: &Near<'_>, walls: &[HalfPlane]) -> Vec3 {
    let separation = near.separation;
    let stretch = stretch(separation.vertical);
    let mut rows: Vec<HalfPlane, MAX_ROWS> = Vec::new();
    let mut clear = true;
    for neighbour in near.bodies() {
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
