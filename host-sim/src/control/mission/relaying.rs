//! Relaying shared states: drones hear of each other through the control center (paper, section 3.3).

use super::{drone::DroneLink, pos_m};
use crate::{control::relay::Relay, geometry::V3};
use skyroost_protocol::{
    message::{Down, PeerState},
    units::{DroneId, TimePs},
};

/// Neighbours whose state is relayed to each drone.
pub const RELAYED_NEIGHBOURS: usize = 32;

/// Neighbours nearer than this are relayed every time; from beyond, two drones at full speed need three
/// quarters of a minute to meet, and hear of each other every [`NEIGHBOURS_PERIOD`].
const NEAR_M: f64 = 1_000.0;
/// Every so often it is looked up anew who is near whom.
const NEIGHBOURS_PERIOD: TimePs = TimePs::from_ms(1_000);
/// Beyond this two need two minutes, and hear of each other once in [`FAR_PERIODS`].
const FAR_M: f64 = 3_000.0;
/// How many [`NEIGHBOURS_PERIOD`]s go by from one state of somebody far to the next; drones take turns.
const FAR_PERIODS: usize = 5;

/// Who is near whom, and when that is told next.
#[derive(Debug)]
pub(in crate::control) struct Relaying {
    period: TimePs,
    due: TimePs,
    neighbours_due: TimePs,
    /// How often neighbours were looked up.
    lookups: usize,
    relay: Relay,
    positions_m: Vec<V3>,
    /// Whose positions these are.
    drones: Vec<usize>,
}

impl Relaying {
    /// Relays every `period`, from now on.
    pub(in crate::control) fn new(period: TimePs) -> Self {
        Self {
            period,
            due: TimePs(0),
            neighbours_due: TimePs(0),
            lookups: 0,
            relay: Relay::new(RELAYED_NEIGHBOURS),
            positions_m: Vec::new(),
            drones: Vec::new(),
        }
    }

    /// Relays what is due.
    pub(in crate::control) fn step(
        &mut self,
        now: TimePs,
        links: &mut [DroneLink],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) {
        if now < self.due {
            return;
        }
        self.due = now.after(self.period);
        let far_too = now >= self.neighbours_due;
        if far_too {
            self.neighbours_due = now.after(NEIGHBOURS_PERIOD);
            self.lookups += 1;
            self.find_neighbours(links);
        }
        self.relay_states(now, links, far_too, send);
    }

    /// Who is near whom: looked up anew once a second, in which two drones come 24 m closer at most.
    fn find_neighbours(&mut self, links: &[DroneLink]) {
        self.positions_m.clear();
        self.drones.clear();
        for (index, link) in links.iter().enumerate() {
            if let Some(state) = link.state {
                self.positions_m.push(pos_m(&state.pos));
                self.drones.push(index);
            }
        }
        self.relay.update(&self.positions_m);
    }

    /// Relays to each drone the states of its nearest neighbours; of those beyond [`NEAR_M`] only now and then, of those
    /// beyond [`FAR_M`] seldom. Where the link takes less than that, of all a while later, and of the nearest only.
    fn relay_states(
        &self,
        now: TimePs,
        links: &mut [DroneLink],
        far_too: bool,
        send: &mut impl FnMut(DroneId, &[u8]),
    ) {
        'drones: for (row, &index) in self.drones.iter().enumerate() {
            let here_m = self.positions_m[row];
            let all = far_too && (self.lookups + row).is_multiple_of(FAR_PERIODS);
            let within_m = match (far_too, all) {
                (_, true) => f64::INFINITY,
                (true, _) => FAR_M,
                _ => NEAR_M,
            };
            let Some(within_m) = links[index].pace.relays_within_m(now, within_m) else { continue };
            let mut states = heapless::Vec::new();
            for &other in self.relay.neighbours(row) {
                let other = usize::from(other);
                if (self.positions_m[other] - here_m).norm_squared() >= within_m * within_m {
                    break; // the nearest come first
                }
                let neighbour = &links[self.drones[other]];
                let Some(state) = neighbour.state else { continue };
                let relayed = PeerState { drone: neighbour.id, state };
                if states.is_full() {
                    links[index].say(now, &Down::Peers(std::mem::take(&mut states)), send);
                    if links[index].pace.has_relayed_enough(now) {
                        continue 'drones;
                    }
                }
                states.push(relayed).expect("emptied when full");
            }
            // Without neighbours the frame is empty, and says that the link lives.
            links[index].say(now, &Down::Peers(states), send);
        }
        // Whoever hears no relay must still hear that the link lives.
        for link in links.iter_mut().filter(|link| link.connected && link.state.is_none()) {
            if link.pace.relays_within_m(now, 0.0).is_some() {
                link.say(now, &Down::Heartbeat, send);
            }
        }
    }
}
