//! What the drone knows of its neighbours: the last shared state of each, aged.

use crate::{
    Vec3,
    avoid::pca::Mover,
    counters::Counters,
    scalar::{greater, lesser},
};
use heapless::Vec;
use skyroost_protocol::{
    message::PeerState,
    units::{DroneId, TimePs, m_from_mm},
};

/// Most neighbours kept: what the control center relays.
pub const MAX_PEERS: usize = 32;
/// A state older than this begins to lose its worth.
const FRESH: TimePs = TimePs::from_ms(1_000);
/// A neighbour silent for this long is forgotten (and counted).
const FORGOTTEN: TimePs = TimePs::from_ms(60_000);
/// Growth of the error radius of a silent neighbour, metres a second.
const SILENCE_GROWTH_MPS: f32 = 1.0;
/// Most that silence adds, metres.
const SILENCE_LIMIT_M: f32 = 20.0;

/// A neighbour's last shared state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peer {
    drone: DroneId,
    time: TimePs,
    state: Mover,
    error_radius_m: f32,
}

impl Peer {
    /// Where the neighbour was when it was last heard, metres.
    #[must_use]
    pub fn heard_at_m(&self) -> Vec3 {
        self.state.pos_enu_m
    }

    /// Where the neighbour is now if it kept its velocity.
    #[must_use]
    pub fn predicted(&self, now: TimePs) -> Mover {
        let age_s = now.since(self.time).min(FRESH).as_secs_f32();
        Mover { pos_enu_m: self.state.pos_enu_m + self.state.vel_enu_mps * age_s, ..self.state }
    }

    /// Declared error radius, grown by silence.
    #[must_use]
    pub fn error_radius_m(&self, now: TimePs) -> f32 {
        let silent_s = greater(now.since(self.time).since(FRESH).as_secs_f32(), 0.0);
        self.error_radius_m + lesser(SILENCE_GROWTH_MPS * silent_s, SILENCE_LIMIT_M)
    }
}

/// All neighbours heard of.
#[derive(Clone, Debug, Default)]
pub struct PeerTable {
    peers: Vec<Peer, MAX_PEERS>,
}

impl PeerTable {
    /// Nobody heard of.
    #[must_use]
    pub const fn new() -> Self {
        Self { peers: Vec::new() }
    }

    /// Forgets everybody.
    pub fn clear(&mut self) {
        self.peers.clear();
    }

    /// Takes in a relayed state; an older one than known is ignored. A full table gives up the
    /// neighbour that was last heard farthest from `own_m`, be it the new one.
    pub fn update(&mut self, relayed: &PeerState, own_m: &Vec3, counters: &mut Counters) {
        let state = relayed.state;
        let peer = Peer {
            drone: relayed.drone,
            time: state.time,
            state: Mover {
                pos_enu_m: Vec3::from(state.pos.0.map(m_from_mm)),
                vel_enu_mps: Vec3::from(state.vel.mps()),
            },
            error_radius_m: m_from_mm(i32::from(state.error_radius_mm)),
        };
        if let Some(known) = self.peers.iter_mut().find(|p| p.drone == peer.drone) {
            if known.time < peer.time {
                *known = peer;
            }
            return;
        }
        if let Err(peer) = self.peers.push(peer) {
            Counters::count(&mut counters.peers_evicted);
            let distance = |p: &Peer| (p.state.pos_enu_m - own_m).norm_squared();
            if let Some(farthest) = self.peers.iter_mut().max_by(|a, b| distance(a).total_cmp(&distance(b)))
                && distance(farthest) > distance(&peer)
            {
                *farthest = peer;
            }
        }
    }

    /// Forgets neighbours long silent.
    pub fn expire(&mut self, now: TimePs, counters: &mut Counters) {
        let before = self.peers.len();
        self.peers.retain(|p| now.since(p.time) <= FORGOTTEN);
        let gone = before - self.peers.len();
        counters.peers_expired = counters.peers_expired.saturating_add(gone as u32);
    }

    /// The neighbours, in the order first heard.
    pub fn iter(&self) -> impl Iterator<Item = &Peer> {
        self.peers.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skyroost_protocol::{
        message::SharedState,
        units::{PosEnuMm, VelEnuMmps},
    };

    fn heard(drone: u16, ms: i64) -> PeerState {
        let state = SharedState {
            time: TimePs::from_ms(ms),
            pos: PosEnuMm([1000, 0, 0]),
            vel: VelEnuMmps([2000, 0, 0]),
            error_radius_mm: 2000,
        };
        PeerState { drone: DroneId(drone), state }
    }

    #[test]
    fn states_age_and_silence_grows_the_keep_out() {
        let (mut table, mut counters) = (PeerTable::default(), Counters::default());
        table.update(&heard(7, 500), &Vec3::zeros(), &mut counters);
        table.update(&heard(7, 100), &Vec3::zeros(), &mut counters); // out of order
        let peer = *table.iter().next().unwrap();
        assert!((peer.predicted(TimePs::from_ms(1_000)).pos_enu_m.x - 2.0).abs() < 1e-4);
        assert!((peer.error_radius_m(TimePs::from_ms(1_000)) - 2.0).abs() < 1e-6);
        assert!((peer.error_radius_m(TimePs::from_ms(4_500)) - 5.0).abs() < 1e-3);
        table.expire(TimePs::from_ms(61_000), &mut counters);
        assert_eq!((table.iter().count(), counters.peers_expired), (0, 1));
    }

    #[test]
    fn a_full_table_gives_up_the_farthest_and_says_so() {
        let (mut table, mut counters) = (PeerTable::default(), Counters::default());
        let mut hear = |drone: u16, east_m: i32| {
            let mut told = heard(drone, 0);
            told.state.pos = PosEnuMm([east_m * 1000, 0, 0]);
            table.update(&told, &Vec3::zeros(), &mut counters);
        };
        (1..=MAX_PEERS as u16).for_each(|drone| hear(drone, 10 * i32::from(drone)));
        hear(100, 5);
        hear(101, 5_000);
        assert_eq!((table.iter().count(), counters.peers_evicted), (MAX_PEERS, 2));
        let known = |drone: u16| table.iter().any(|p| p.drone == DroneId(drone));
        assert!(known(100) && known(1) && !known(101) && !known(MAX_PEERS as u16));
    }
}
