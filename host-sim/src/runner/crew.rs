//! Threads that fly islands.
//!
//! A window of a few drones takes some ten microseconds, less than it takes to wake a thread. So who has nothing to do looks
//! out for a while, about as long as the control center needs for its part of most windows, and only then sleeps.

use super::{
    drone::Desk,
    island::{Island, Surroundings},
};
use crate::fleet::BoardError;
use std::{
    hint,
    sync::{
        Arc,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread::{self, JoinHandle},
};

/// Looks before sleep: some ten microseconds.
const LOOKS: u32 = 1000;
/// What a thread is sent before it has answered: never more than one thing.
const SENT: usize = 1;

/// The steps that islands are to fly, and whether they shall say where the time goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    pub(super) first: u64,
    pub(super) steps: u64,
    pub(super) timed: bool,
}

impl Window {
    fn fly(
        self,
        islands: &mut [Island],
        around: &Surroundings,
        desks: &mut Vec<Desk>,
    ) -> Result<(), BoardError> {
        let Self { first, steps, timed } = self;
        islands.iter_mut().try_for_each(|island| match timed {
            true => island.run::<true>(first, steps, around, desks),
            false => island.run::<false>(first, steps, around, desks),
        })
    }
}

/// This thread and those that help it.
pub(super) struct Crew {
    around: Arc<Surroundings>,
    desks: Vec<Desk>,
    hands: Vec<Hand>,
}

impl Crew {
    /// So many threads, this one among them, but not more than islands.
    pub(super) fn new(threads: usize, islands: usize, around: Surroundings) -> Self {
        let hands = (1..threads.min(islands)).map(|_| Hand::new());
        Self { hands: hands.collect(), around: Arc::new(around), desks: Vec::new() }
    }

    /// What all islands fly in.
    pub(super) fn around(&self) -> &Surroundings {
        &self.around
    }

    /// From the next window on they fly in this.
    pub(super) fn surround(&mut self, around: Surroundings) {
        self.around = Arc::new(around);
    }

    /// Flies all islands through a window; they keep their order. Fails as the first of them that does, whoever flew it.
    pub(super) fn fly(&mut self, window: Window, islands: &mut Vec<Island>) -> Result<(), BoardError> {
        let mut drones: usize = islands.iter().map(|island| island.drones.len()).sum();
        for (others, hand) in self.hands.iter_mut().enumerate().rev() {
            // An equal share of the drones that are left, from the end.
            let (mut from, mut share) = (islands.len(), 0);
            while from > 0 && share * (others + 2) < drones {
                from -= 1;
                share += islands[from].drones.len();
            }
            drones -= share;
            hand.give((window, Arc::clone(&self.around)), islands.drain(from..));
        }
        let mut result = window.fly(islands, &self.around, &mut self.desks);
        for hand in &mut self.hands {
            let flown = hand.take_back(islands);
            result = result.and(flown);
        }
        result
    }
}

/// What is to be flown, and in what.
type Order = (Window, Arc<Surroundings>);

/// A thread that helps. It ends once nobody can send it anything.
struct Hand {
    orders: Option<SyncSender<(Order, Vec<Island>)>>,
    flown: Receiver<(Vec<Island>, Result<(), BoardError>)>,
    /// Room for the next islands.
    room: Vec<Island>,
    thread: Option<JoinHandle<()>>,
}

impl Hand {
    fn new() -> Self {
        let (orders, to_fly) = sync_channel::<(Order, Vec<Island>)>(SENT);
        let (back, flown) = sync_channel(SENT);
        let thread = thread::spawn(move || {
            let mut desks = Vec::new();
            while let Some(((window, around), mut islands)) = wait(&to_fly) {
                let result = window.fly(&mut islands, &around, &mut desks);
                if back.send((islands, result)).is_err() {
                    break;
                }
            }
        });
        Self { orders: Some(orders), flown, room: Vec::new(), thread: Some(thread) }
    }

    fn give(&mut self, order: Order, islands: impl Iterator<Item = Island>) {
        let mut room = std::mem::take(&mut self.room);
        room.extend(islands);
        let orders = self.orders.as_ref().expect("it ends only with its owner");
        orders.send((order, room)).expect("a thread that panicked has been noticed at `take_back`");
    }

    fn take_back(&mut self, islands: &mut Vec<Island>) -> Result<(), BoardError> {
        let (mut flown, result) =
            wait(&self.flown).expect("the thread that flies these islands has panicked");
        islands.append(&mut flown);
        self.room = flown;
        result
    }
}

impl Drop for Hand {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take() {
            // A panic has shown itself where its result was wanted.
            let _ = thread.join();
        }
    }
}

/// What comes next, or none if nothing can come any more.
fn wait<T>(from: &Receiver<T>) -> Option<T> {
    for _ in 0..LOOKS {
        if let Ok(next) = from.try_recv() {
            return Some(next);
        }
        hint::spin_loop();
    }
    from.recv().ok()
}
