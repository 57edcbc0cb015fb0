//! SRS occasions that were announced: when to listen, to whom, and what became of it.

use crate::{counters::Counters, io::SrsGate};
use heapless::Vec;
use skyroost_protocol::{
    message::{MAX_SRS_PER_REQUEST, SrsRequest},
    units::{DroneId, OccasionId, TimePs, UserId},
};

/// Most occasions known at a time: 100 a second, announced a second ahead, kept for another half.
pub const MAX_PENDING: usize = 192;
/// The gate is asked for this long before the transmission.
const GATE_LEAD: TimePs = TimePs::from_ms(40);
/// An occasion is remembered this long after its transmission, for captures of fleet mates.
const KEPT: TimePs = TimePs::from_ms(600);

/// An announced occasion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Announced {
    /// The occasion.
    pub occasion: OccasionId,
    /// Who transmits.
    pub user: UserId,
    /// Who grants the transmission and forms the differences.
    pub serving: DroneId,
    /// When.
    pub at: TimePs,
}

/// An [`Announced`] in 20 bytes; a time in its own type would pad it to 24.
#[derive(Clone, Debug)]
struct Pending {
    occasion: OccasionId,
    user: UserId,
    at: [u8; 8],
    serving: DroneId,
    gated: bool,
}

const _: () = assert!(size_of::<Pending>() == 20);
const _: () = assert!(MAX_SRS_PER_REQUEST <= 32, "a bit for each in `Occasions::known_from`");

impl Pending {
    const fn new(announced: &Announced) -> Self {
        let Announced { occasion, user, serving, at } = *announced;
        Self { occasion, user, at: at.0.to_ne_bytes(), serving, gated: false }
    }

    const fn at(&self) -> TimePs {
        TimePs(i64::from_ne_bytes(self.at))
    }

    const fn announced(&self) -> Announced {
        Announced { occasion: self.occasion, user: self.user, serving: self.serving, at: self.at() }
    }
}

/// The occasions announced to this drone.
#[derive(Clone, Debug, Default)]
pub struct Occasions {
    pending: Vec<Pending, MAX_PENDING>,
}

impl Occasions {
    /// Nothing announced.
    #[must_use]
    pub const fn new() -> Self {
        Self { pending: Vec::new() }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.pending.clear();
    }

    /// Takes in a request; entries whose time has passed or that do not fit are counted.
    pub fn announce(&mut self, now: TimePs, request: &SrsRequest, counters: &mut Counters) {
        let known = self.known_from(request.first_occasion);
        let (mut at, mut occasion) = (request.start, request.first_occasion);
        for (index, entry) in request.entries.iter().enumerate() {
            let announced = Announced { occasion, user: entry.user, serving: entry.serving, at };
            if at < now {
                Counters::count(&mut counters.srs_late);
            } else if known >> index & 1 == 0 && self.pending.push(Pending::new(&announced)).is_err() {
                Counters::count(&mut counters.srs_overflowed);
            }
            at = at.after(request.spacing);
            occasion = OccasionId(occasion.0.wrapping_add(1));
        }
    }

    /// Which of the occasions from `first` on are known, a bit for each: one look at the table for all
    /// entries of a request, whose occasions are distinct.
    fn known_from(&self, first: OccasionId) -> u32 {
        let offsets = self.pending.iter().map(|p| p.occasion.0.wrapping_sub(first.0));
        offsets
            .filter(|offset| *offset < MAX_SRS_PER_REQUEST as u32)
            .fold(0, |known, offset| known | 1 << offset)
    }

    /// Asks `open` for the gates that are due, until it has no more room, and forgets what is over.
    pub fn step(&mut self, now: TimePs, me: DroneId, mut open: impl FnMut(SrsGate) -> bool) {
        if self.pending.is_empty() {
            return;
        }
        let until = now.after(GATE_LEAD);
        for known in self.pending.iter_mut().filter(|p| !p.gated && p.at() <= until) {
            let gate = SrsGate {
                occasion: known.occasion,
                user: known.user,
                at: known.at(),
                grant: known.serving == me,
            };
            known.gated = open(gate);
        }
        self.pending.retain(|p| now.since(p.at()) <= KEPT);
    }

    /// What was announced as `occasion`.
    #[must_use]
    pub fn get(&self, occasion: OccasionId) -> Option<Announced> {
        // Occasions are numbered in the order in which they are announced: nearly always it lies where it would with
        // none missing.
        let first = self.pending.first()?.occasion.0;
        let there = self.pending.get(occasion.0.wrapping_sub(first) as usize);
        let found = there.filter(|p| p.occasion == occasion);
        found.or_else(|| self.pending.iter().find(|p| p.occasion == occasion)).map(Pending::announced)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skyroost_protocol::message::SrsRequestEntry;

    fn request(start_ms: i64, users: u32) -> SrsRequest {
        let entries =
            (0..users).map(|u| SrsRequestEntry { user: UserId(u), serving: DroneId(1 + (u % 3) as u16) });
        SrsRequest {
            start: TimePs::from_ms(start_ms),
            spacing: TimePs::from_ms(10),
            first_occasion: OccasionId(100),
            entries: entries.collect(),
        }
    }

    #[test]
    fn gates_open_once_and_in_time() {
        let (mut occasions, mut counters) = (Occasions::default(), Counters::default());
        occasions.announce(TimePs(0), &request(500, 4), &mut counters);
        occasions.announce(TimePs(0), &request(500, 4), &mut counters); // repeated frame
        let mut gates = std::vec::Vec::new();
        for ms in (0..1_200).step_by(20) {
            occasions.step(TimePs::from_ms(ms), DroneId(1), |gate| {
                gates.push((ms, gate));
                true
            });
        }
        assert_eq!(gates.len(), 4);
        assert!(gates.iter().all(|(ms, g)| {
            let ahead = g.at.since(TimePs::from_ms(*ms));
            ahead > TimePs(0) && ahead <= GATE_LEAD
        }));
        assert_eq!(gates.iter().filter(|(_, g)| g.grant).count(), 2);
        assert!(occasions.get(OccasionId(100)).is_none(), "forgotten");
        assert_eq!(counters.dropped(), 0);
    }

    #[test]
    fn late_and_surplus_requests_are_counted() {
        let (mut occasions, mut counters) = (Occasions::default(), Counters::default());
        occasions.announce(TimePs::from_ms(515), &request(500, 4), &mut counters);
        assert_eq!(counters.srs_late, 2);
        for batch in 0..30 {
            let mut more = request(1_000, 10);
            more.first_occasion = OccasionId(1_000 + 10 * batch);
            occasions.announce(TimePs(0), &more, &mut counters);
        }
        assert_eq!(counters.srs_overflowed as usize, 300 + 2 - MAX_PENDING);
    }
}
