//! Differences of arrival time, formed at the serving drone.

use super::{
    gate::{self, End},
    slots::Slots,
    words::Words,
};
use heapless::Vec;
use skyroost_protocol::message::{CaptureEntry, ClockState, MateTdoa, TdoaCounts, TdoaEntry, TdoaFlags};
use skyroost_protocol::units::{DroneId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId};

/// Most occasions remembered at a time.
pub const MAX_PENDING: usize = 32;
/// Fleet mates of a drone.
const MATES: usize = 2;

/// An arrival at this drone, of a user that it serves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OwnCapture {
    /// The occasion.
    pub occasion: OccasionId,
    /// The user that transmitted.
    pub user: UserId,
    /// Arrival by the own clock.
    pub time: TimePs,
    /// Own position at the arrival.
    pub pos: PosEnuMm,
    /// How well it was captured.
    pub sigma: ToaSigma,
    /// The own clock.
    pub clock: ClockState,
    /// Bound of the position's error, and of the mates', millimetres.
    pub error_mm: u16,
}

/// Pairs own captures with those of the fleet mates, in whatever order they come.
///
/// An occasion is reported once both mates have captured it, or after `max_age` with the one mate that
/// has. It is then remembered until that age, so that a capture repeated or late is known as such.
#[derive(Clone, Debug)]
pub struct Pairing {
    /// In order of first capture.
    pending: Slots<Pending, MAX_PENDING>,
    max_age: TimePs,
    counts: TdoaCounts,
}

/// What is known of one occasion.
#[derive(Clone, Copy, Debug)]
struct Pending {
    occasion: OccasionId,
    /// When its first capture came.
    since: Words,
    own: Option<Own>,
    /// By rising drone.
    mates: [Option<Mate>; MATES],
    reported: bool,
}

/// An [`OwnCapture`] but for its occasion.
#[derive(Clone, Copy, Debug)]
struct Own {
    user: UserId,
    time: Words,
    pos: PosEnuMm,
    sigma: ToaSigma,
    clock: ClockState,
    error_mm: u16,
}

/// A [`CaptureEntry`] but for its occasion, and whose it is.
#[derive(Clone, Copy, Debug)]
struct Mate {
    drone: DroneId,
    toa: Words,
    pos: PosEnuMm,
    sigma: ToaSigma,
    clock: ClockState,
}

#[cfg(target_pointer_width = "32")]
const _: () = assert!(size_of::<Pending>() <= 104, "a board has 32 of them");

impl Pairing {
    /// An empty table that waits for the last capture of an occasion until `max_age` after the first.
    #[must_use]
    pub const fn new(max_age: TimePs) -> Self {
        // Made by the compiler: a board that makes it in its place has no room for it on the stack.
        let pending = const { Slots::new(Pending::new(TimePs(0), OccasionId(0))) };
        Self { pending, max_age, counts: TdoaCounts::NONE }
    }

    /// Forgets everything, the counts included.
    pub const fn clear(&mut self) {
        self.pending.clear();
        self.counts = TdoaCounts::NONE;
    }

    /// What became of the captures so far.
    #[must_use]
    pub const fn counts(&self) -> &TdoaCounts {
        &self.counts
    }

    /// Takes an own capture.
    pub fn own(&mut self, now: TimePs, capture: OwnCapture) {
        let Some(pending) = self.entry(now, capture.occasion) else { return };
        if pending.own.is_some() {
            count(&mut self.counts.duplicates, 1);
        } else {
            let OwnCapture { user, time, pos, sigma, clock, error_mm, .. } = capture;
            pending.own = Some(Own { user, time: Words::new(time), pos, sigma, clock, error_mm });
        }
    }

    /// Takes a capture of a fleet mate.
    pub fn mate(&mut self, now: TimePs, drone: DroneId, capture: &CaptureEntry) {
        let Some(pending) = self.entry(now, capture.occasion) else { return };
        let CaptureEntry { toa, pos, sigma, clock, .. } = *capture;
        let mate = Mate { drone, toa: Words::new(toa), pos, sigma, clock };
        if !pending.hear(mate) {
            count(&mut self.counts.duplicates, 1);
        }
    }

    /// Whether an occasion with differences to report is complete or due.
    #[must_use]
    pub fn has_due(&self, now: TimePs) -> bool {
        let is_due = |it: &Pending| it.is_complete() || now.since(it.since.time()) >= self.max_age;
        let has_some = |it: &Pending| !it.reported && it.own.is_some() && matches!(it.mates, [Some(_), _]);
        self.pending.position(|it| has_some(it) && is_due(it)).is_some()
    }

    /// The oldest occasion that is complete or due, for a caller whose room is bounded: the others wait.
    pub fn pop(&mut self, now: TimePs) -> Option<TdoaEntry> {
        let Self { pending, max_age, counts } = self;
        let mut entry = None;
        pending.retain_mut(|pending| {
            if entry.is_some() {
                return true;
            }
            let due = now.since(pending.since.time()) >= *max_age;
            if !pending.reported && (due || pending.is_complete()) {
                entry = pending.settle(counts);
            }
            !due
        });
        entry
    }

    /// The entry of an occasion, new if need be.
    fn entry(&mut self, now: TimePs, occasion: OccasionId) -> Option<&mut Pending> {
        if let Some(age) = self.pending.position(|pending| pending.occasion == occasion) {
            return self.pending.get_mut(age);
        }
        if self.pending.is_full() {
            self.evict();
        }
        self.pending.push(Pending::new(now, occasion))
    }

    /// Makes room: the oldest occasion goes, of those already reported if there is one.
    fn evict(&mut self) {
        let reported = self.pending.position(|pending| pending.reported);
        if reported.is_none() {
            count(&mut self.counts.evicted, 1);
        }
        self.pending.remove(reported.unwrap_or(0));
    }
}

impl Pending {
    const fn new(now: TimePs, occasion: OccasionId) -> Self {
        Self { occasion, since: Words::new(now), own: None, mates: [None; MATES], reported: false }
    }

    /// Takes a mate's capture; false when it has captured this before, or both mates have.
    fn hear(&mut self, mate: Mate) -> bool {
        match &mut self.mates {
            [first @ None, _] => *first = Some(mate),
            [Some(first), second @ None] if first.drone < mate.drone => *second = Some(mate),
            [Some(first), second @ None] if first.drone > mate.drone => {
                *second = Some(core::mem::replace(first, mate));
            }
            _ => return false,
        }
        true
    }

    const fn is_complete(&self) -> bool {
        self.own.is_some() && matches!(self.mates, [Some(_), Some(_)])
    }

    /// Forms the differences there are and counts those there are not. Nothing to report without a
    /// single one.
    fn settle(&mut self, counts: &mut TdoaCounts) -> Option<TdoaEntry> {
        self.reported = true;
        let formed = self.mates.iter().flatten().count() as u32;
        let Some(own) = self.own else {
            count(&mut counts.stale, formed);
            return None;
        };
        count(&mut counts.hits, formed);
        count(&mut counts.misses, MATES as u32 - formed);
        let mut mates = Vec::new();
        for mate in self.mates.iter().flatten() {
            let (tdoa, flags) = difference(&own, mate);
            count(&mut counts.saturated, u32::from(flags.contains(TdoaFlags::SATURATED)));
            count(&mut counts.gated, u32::from(flags.contains(TdoaFlags::GATED)));
            let Mate { drone, pos, sigma, .. } = *mate;
            mates.push(MateTdoa { drone, tdoa, pos, sigma, flags }).ok()?;
        }
        if mates.is_empty() {
            return None;
        }
        let Own { user, time, pos, sigma, .. } = own;
        Some(TdoaEntry { occasion: self.occasion, user, time: time.time(), pos, sigma, mates })
    }
}

/// Arrival time at a mate less that at the serving drone: differenced in 64 bits first, judged, converted to 32
/// after, and clamped and flagged where it does not fit.
fn difference(own: &Own, mate: &Mate) -> (TdoaPs, TdoaFlags) {
    let wide = mate.toa.time().since(own.time.time()).0;
    let serving = End { pos: own.pos, sigma: own.sigma, clock: own.clock };
    let mates = End { pos: mate.pos, sigma: mate.sigma, clock: mate.clock };
    let flags = gate::judge(wide, &serving, &mates, own.error_mm);
    match i32::try_from(wide) {
        Ok(tdoa) => (TdoaPs(tdoa), flags),
        Err(_) if wide < 0 => (TdoaPs(i32::MIN), flags | TdoaFlags::SATURATED),
        Err(_) => (TdoaPs(i32::MAX), flags | TdoaFlags::SATURATED),
    }
}

fn count(counter: &mut u32, by: u32) {
    *counter = counter.saturating_add(by);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    const MAX_AGE: TimePs = TimePs::from_ms(500);

    fn own(occasion: u32, ps: i64) -> OwnCapture {
        OwnCapture {
            occasion: OccasionId(occasion),
            user: UserId(7 * occasion),
            time: TimePs(ps),
            pos: PosEnuMm([1, 2, 3]),
            sigma: ToaSigma(600),
            clock: ClockState::Free,
            error_mm: 0,
        }
    }

    fn capture(occasion: u32, ps: i64) -> CaptureEntry {
        CaptureEntry {
            occasion: OccasionId(occasion),
            toa: TimePs(ps),
            pos: PosEnuMm([4, 5, 6]),
            sigma: ToaSigma(500),
            clock: ClockState::Free,
        }
    }

    fn drained(pairing: &mut Pairing, now: TimePs) -> std::vec::Vec<TdoaEntry> {
        let mut entries = std::vec::Vec::new();
        entries.extend(core::iter::from_fn(|| pairing.pop(now)));
        entries
    }

    fn values(entry: &TdoaEntry) -> std::vec::Vec<(u16, i32)> {
        entry.mates.iter().map(|mate| (mate.drone.0, mate.tdoa.0)).collect()
    }

    #[test]
    fn a_complete_occasion_is_reported_at_once_and_once() {
        let mut pairing = Pairing::new(MAX_AGE);
        pairing.mate(TimePs(0), DroneId(9), &capture(1, 150));
        pairing.own(TimePs(0), own(1, 100));
        assert!(drained(&mut pairing, TimePs(0)).is_empty());
        pairing.mate(TimePs(1), DroneId(4), &capture(1, 30));
        let entries = drained(&mut pairing, TimePs(1));
        assert_eq!(entries.len(), 1);
        assert_eq!((entries[0].user, entries[0].time), (UserId(7), TimePs(100)));
        assert_eq!(values(&entries[0]), [(4, -70), (9, 50)], "by drone, whatever came first");

        pairing.mate(TimePs(2), DroneId(9), &capture(1, 150));
        pairing.own(TimePs(2), own(1, 100));
        assert!(drained(&mut pairing, TimePs::from_ms(499)).is_empty());
        assert!(drained(&mut pairing, MAX_AGE).is_empty());
        let expected = TdoaCounts { hits: 2, duplicates: 2, ..Default::default() };
        assert_eq!(*pairing.counts(), expected);
    }

    #[test]
    fn an_incomplete_occasion_is_reported_when_due() {
        let mut pairing = Pairing::new(MAX_AGE);
        pairing.own(TimePs(0), own(1, 100));
        pairing.mate(TimePs(5), DroneId(4), &capture(1, 30));
        pairing.own(TimePs(5), own(2, 100));
        pairing.mate(TimePs(5), DroneId(4), &capture(3, 30));
        assert!(drained(&mut pairing, TimePs(MAX_AGE.0 - 1)).is_empty());
        let entries = drained(&mut pairing, MAX_AGE.after(TimePs(5)));
        assert_eq!(entries.iter().map(values).collect::<std::vec::Vec<_>>(), [[(4, -70)]]);
        // Occasion 1 lacked one mate, occasion 2 both, occasion 3 the own capture.
        let expected = TdoaCounts { hits: 1, misses: 3, stale: 1, ..Default::default() };
        assert_eq!(*pairing.counts(), expected);
    }

    #[test]
    fn a_full_table_drops_the_oldest_and_says_so() {
        let mut pairing = Pairing::new(MAX_AGE);
        pairing.mate(TimePs(0), DroneId(4), &capture(0, 10));
        pairing.mate(TimePs(0), DroneId(5), &capture(0, 10));
        pairing.own(TimePs(0), own(0, 0));
        pairing.own(TimePs(0), own(1, 0));
        assert_eq!(drained(&mut pairing, TimePs(0)).len(), 1);
        for occasion in 2..MAX_PENDING as u32 + 1 {
            pairing.own(TimePs(0), own(occasion, 0));
        }
        assert_eq!(pairing.counts().evicted, 0, "only the reported occasion went");
        pairing.own(TimePs(0), own(100, 0));
        assert_eq!(pairing.counts().evicted, 1);
        pairing.mate(TimePs(0), DroneId(4), &capture(2, 10));
        pairing.mate(TimePs(0), DroneId(5), &capture(2, 10));
        assert_eq!(drained(&mut pairing, TimePs(0)).len(), 1, "the second oldest is still there");
    }

    #[test]
    fn a_bounded_caller_loses_nothing() {
        let mut pairing = Pairing::new(MAX_AGE);
        for occasion in 0..10 {
            pairing.own(TimePs(0), own(occasion, 0));
            pairing.mate(TimePs(0), DroneId(4), &capture(occasion, 10));
        }
        for occasion in 0..10 {
            assert!(pairing.has_due(MAX_AGE));
            let entry = pairing.pop(MAX_AGE).expect("due");
            assert_eq!(entry.occasion, OccasionId(occasion));
        }
        assert_eq!((pairing.pop(MAX_AGE), pairing.has_due(MAX_AGE)), (None, false));
    }

    /// A capture on its way to the table: `None` is the own one.
    type Arrival = (u32, Option<u16>, i64);

    /// Arrivals of distinct occasions and drones in any order.
    fn arrivals() -> impl Strategy<Value = std::vec::Vec<Arrival>> {
        let toa = prop_oneof![-5_000_000_i64..5_000_000, any::<i64>()];
        vec((toa.clone(), vec(toa, 2), 1..8_u8), 1..=MAX_PENDING)
            .prop_map(|occasions| {
                let mut arrivals = std::vec::Vec::new();
                for (occasion, (own, mates, heard)) in (0_u32..).zip(occasions) {
                    let all = [(None, own), (Some(4), mates[0]), (Some(9), mates[1])];
                    let heard = all.into_iter().enumerate().filter(|(bit, _)| heard >> bit & 1 == 1);
                    arrivals.extend(heard.map(|(_, (drone, ps))| (occasion, drone, ps)));
                }
                arrivals
            })
            .prop_shuffle()
    }

    proptest! {
        /// In any order and with repetitions, the differences are those of an i128 model, and every
        /// capture is accounted for.
        #[test]
        fn truth_agrees_with_the_model(
            arrivals in arrivals(), repeat in vec(any::<bool>(), 3 * MAX_PENDING), drain_early: bool,
        ) {
            let mut pairing = Pairing::new(MAX_AGE);
            let mut found = std::vec::Vec::new();
            let mut repeated = 0;
            for (arrival, again) in arrivals.iter().zip(&repeat) {
                for _ in 0..=u8::from(*again) {
                    match *arrival {
                        (occasion, None, ps) => pairing.own(TimePs(0), own(occasion, ps)),
                        (occasion, Some(drone), ps) => {
                            pairing.mate(TimePs(0), DroneId(drone), &capture(occasion, ps));
                        }
                    }
                }
                repeated += u32::from(*again);
                if drain_early {
                    found.extend(drained(&mut pairing, TimePs(0)));
                }
            }
            found.extend(drained(&mut pairing, MAX_AGE));

            let mut model: BTreeMap<u32, (Option<i64>, BTreeMap<u16, i64>)> = BTreeMap::new();
            for (occasion, drone, ps) in &arrivals {
                let entry = model.entry(*occasion).or_default();
                match drone {
                    None => entry.0 = Some(*ps),
                    Some(drone) => drop(entry.1.insert(*drone, *ps)),
                }
            }
            let mut expected = TdoaCounts { duplicates: repeated, ..Default::default() };
            let mut entries = BTreeMap::new();
            for (occasion, (own, mates)) in model {
                let Some(own) = own else {
                    expected.stale += mates.len() as u32;
                    continue;
                };
                expected.hits += mates.len() as u32;
                expected.misses += 2 - mates.len() as u32;
                let differences: std::vec::Vec<(u16, i32)> = mates
                    .into_iter()
                    .map(|(drone, ps)| {
                        let wide = i128::from(ps) - i128::from(own);
                        let clamped = wide.clamp(i128::from(i32::MIN), i128::from(i32::MAX));
                        expected.saturated += u32::from(clamped != wide);
                        (drone, clamped as i32)
                    })
                    .collect();
                if !differences.is_empty() {
                    entries.insert(occasion, differences);
                }
            }
            found.sort_by_key(|entry| entry.occasion);
            let found: BTreeMap<u32, _> = found.iter().map(|entry| (entry.occasion.0, values(entry))).collect();
            prop_assert_eq!(found, entries);
            prop_assert_eq!(*pairing.counts(), expected);
        }

        /// Nothing is too much for the table, times that jump included.
        #[test]
        fn survives_anything(
            steps in vec((any::<i64>(), 0..64_u32, proptest::option::of(0..5_u16), any::<i64>()), 0..400)
        ) {
            let mut pairing = Pairing::new(MAX_AGE);
            for (now, occasion, drone, ps) in steps {
                let now = TimePs(now);
                match drone {
                    None => pairing.own(now, own(occasion, ps)),
                    Some(drone) => pairing.mate(now, DroneId(drone), &capture(occasion, ps)),
                }
                prop_assert!(drained(&mut pairing, now).iter().all(|entry| !entry.mates.is_empty()));
                prop_assert!(pairing.pending.len() <= MAX_PENDING);
            }
        }
    }
}
