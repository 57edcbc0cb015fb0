//! What the drone knows of its neighbours: the last shared state of each, aged.

use crate::{Vec3, avoid::pca::Mover, counters::Counters, scalar::lesser};
use heapless::Vec;
use skyroost_protocol::{
    message::{Manner, PeerState},
    units::{DroneId, TimePs, m_from_mm},
};

/// Most neighbours kept: what the control center relays.
pub const MAX_PEERS: usize = 32;
/// A state older than this tells where a neighbour was: it is silent, and may have stopped or flown on.
pub const FRESH: TimePs = TimePs::from_ms(2_000);
/// How long a silent neighbour may fly on: by then its own supervisor has made it hold, as its link is lost.
pub const FLIES_ON: TimePs = TimePs::from_ms(10_000);
/// A neighbour that has been silent for so long is not there any more: a while before, its own supervisor made it return home, or it
/// has fallen.
pub const GONE: TimePs = TimePs::from_ms(75_000);
/// Growth of the keep-out around the way of a silent neighbour, metres a second: drift, and turns.
const DRIFT_MPS: f32 = 1.0;
/// Most that drift adds, metres.
pub const DRIFT_LIMIT_M: f32 = 20.0;

/// A neighbour's last shared state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peer {
    drone: DroneId,
    time: TimePs,
    state: Mover,
    error_radius_m: f32,
    manner: Manner,
}

impl Peer {
    /// Who it is.
    #[must_use]
    pub fn drone(&self) -> DroneId {
        self.drone
    }

    /// How it flies.
    #[must_use]
    pub fn manner(&self) -> Manner {
        self.manner
    }

    /// Where the neighbour was when it was last heard, metres.
    #[must_use]
    pub fn heard_at_m(&self) -> Vec3 {
        self.state.pos_enu_m
    }

    /// Where the neighbour is now if it kept its velocity; of a silent one the middle of the way on which it may be.
    #[must_use]
    pub fn predicted(&self, now: TimePs) -> Mover {
        let Mover { pos_enu_m, vel_enu_mps } = self.state;
        let (heard_s, silent_s) = self.ages_s(now);
        if silent_s <= 0.0 {
            return Mover { pos_enu_m: pos_enu_m + vel_enu_mps * heard_s, vel_enu_mps };
        }
        let moves = if silent_s < FLIES_ON.as_secs_f32() { 0.5 } else { 0.0 };
        let middle_s = heard_s + 0.5 * lesser(silent_s, FLIES_ON.as_secs_f32());
        Mover { pos_enu_m: pos_enu_m + vel_enu_mps * middle_s, vel_enu_mps: vel_enu_mps * moves }
    }

    /// Declared error radius of its position, metres.
    #[must_use]
    pub fn error_radius_m(&self) -> f32 {
        self.error_radius_m
    }

    /// By how much a silent neighbour may be off the [predicted](Self::predicted) place: half the way on which it may
    /// be, and drift; metres. It grows while the neighbour is silent, until it is [forgotten](PeerTable::forget_gone).
    #[must_use]
    pub fn keep_out_m(&self, now: TimePs) -> f32 {
        let (_, silent_s) = self.ages_s(now);
        if silent_s <= 0.0 {
            return 0.0;
        }
        let half_way_m = 0.5 * self.state.vel_enu_mps.norm() * lesser(silent_s, FLIES_ON.as_secs_f32());
        half_way_m + lesser(DRIFT_MPS * silent_s, DRIFT_LIMIT_M)
    }

    /// Age of the state as long as it is fresh, and for how long the neighbour has been silent since, seconds.
    fn ages_s(&self, now: TimePs) -> (f32, f32) {
        let age = now.since(self.time);
        if age <= FRESH {
            return (age.as_secs_f32(), 0.0);
        }
        (FRESH.as_secs_f32(), age.since(FRESH).as_secs_f32())
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

    /// Forgets who has been silent for so long that it cannot be where it was. Whoever hears nobody forgets nobody: the silence may be
    /// its own, so this is to be asked for when somebody was heard.
    pub fn forget_gone(&mut self, now: TimePs) {
        self.peers.retain(|peer| now.since(peer.time) < GONE);
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
            manner: state.manner,
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

    /// The neighbour at a place in the table.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<&Peer> {
        self.peers.get(index)
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
            manner: Manner::ALONE,
        };
        PeerState { drone: DroneId(drone), state }
    }

    #[test]
    fn states_age_and_silence_makes_a_keep_out_that_grows() {
        let (mut table, mut counters) = (PeerTable::default(), Counters::default());
        table.update(&heard(7, 500), &Vec3::zeros(), &mut counters);
        table.update(&heard(7, 100), &Vec3::zeros(), &mut counters); // out of order
        let peer = *table.iter().next().unwrap();
        assert!((peer.predicted(TimePs::from_ms(1_000)).pos_enu_m.x - 2.0).abs() < 1e-4);
        assert!(peer.keep_out_m(TimePs::from_ms(1_000)) < 1e-6);
        // At 2 m/s east, silent from 2.5 s on: stopped there or flown on for ten seconds, it is within the keep-out.
        for silent_s in [0.5, 3.0, 10.0, 100.0] {
            let now = TimePs::from_ms(2_500 + (silent_s * 1e3) as i64);
            let (middle, keep_out_m) = (peer.predicted(now).pos_enu_m.x, peer.keep_out_m(now));
            let flown_on_s = if silent_s < 10.0 { silent_s } else { 10.0 };
            for may_be_m in [5.0, 5.0 + 2.0 * flown_on_s] {
                assert!((middle - may_be_m).abs() <= keep_out_m, "{silent_s} s: {middle} {keep_out_m}");
            }
            assert!(keep_out_m <= 30.0 + 1e-3);
        }
        assert_eq!(table.iter().count(), 1);
    }

    #[test]
    fn who_is_gone_is_forgotten_and_nobody_else() {
        let (mut table, mut counters) = (PeerTable::default(), Counters::default());
        table.update(&heard(7, 1_000), &Vec3::zeros(), &mut counters);
        table.update(&heard(8, 2_000), &Vec3::zeros(), &mut counters);
        let known = |table: &PeerTable| table.iter().map(|peer| peer.drone.0).collect::<Vec<u16, 4>>();
        table.forget_gone(TimePs::from_ms(75_999));
        assert_eq!(known(&table), [7, 8]);
        table.forget_gone(TimePs::from_ms(76_000));
        assert_eq!(known(&table), [8]);
        table.forget_gone(TimePs::from_ms(77_000));
        assert_eq!(known(&table), []);
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
