//! Which user sends its SRS when, and which drone serves it.
//!
//! A user is asked once a period while all three drones of a fleet hear it (paper section 2: the
//! common coverage). The occasions of a period are spread evenly over it, so that no two users of a
//! fleet transmit at once. Above the limit those asked longest ago come first.

use skyroost_protocol::{
    message::{Attached, MAX_SRS_PER_REQUEST, SrsRequest, SrsRequestEntry},
    units::{DroneId, OccasionId, TimePs, UserId},
};
use std::collections::BTreeMap;

/// A user counts as heard by a drone for this long: two pages may be lost.
const HEARD_FOR: TimePs = TimePs::from_ms(2_500);
/// From the request to the first transmission: two ways of the radio and the gate's lead.
const LEAD: TimePs = TimePs::from_ms(400);

/// How often users are asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SrsConfig {
    /// Time from one SRS of a user to its next.
    pub period: TimePs,
    /// Most occasions of one fleet in a period.
    pub max_per_period: usize,
}

impl Default for SrsConfig {
    fn default() -> Self {
        Self { period: TimePs::from_ms(1_000), max_per_period: 100 }
    }
}

/// An occasion that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scheduled {
    /// Who transmits.
    pub user: UserId,
    /// The fleet that listens.
    pub fleet: usize,
    /// When.
    pub at: TimePs,
}

/// What a fleet knows of a user.
#[derive(Clone, Copy, Debug, Default)]
struct Hearing {
    /// When each drone last heard it, and at which timing advance.
    by_slot: [Option<(TimePs, u16)>; 3],
    last_asked: Option<TimePs>,
}

/// Schedule of one fleet.
#[derive(Clone, Debug)]
pub struct FleetSchedule {
    fleet: usize,
    mates: [DroneId; 3],
    config: SrsConfig,
    users: BTreeMap<UserId, Hearing>,
    next_period: Option<TimePs>,
}

impl FleetSchedule {
    /// Nobody heard yet.
    #[must_use]
    pub fn new(fleet: usize, mates: [DroneId; 3], config: SrsConfig) -> Self {
        Self { fleet, mates, config, users: BTreeMap::new(), next_period: None }
    }

    /// Drone `drone` of this fleet hears these users.
    pub fn heard(&mut self, drone: DroneId, attached: &Attached) {
        let Some(slot) = self.mates.iter().position(|m| *m == drone) else { return };
        for user in &attached.users {
            self.users.entry(user.user).or_default().by_slot[slot] =
                Some((attached.time, user.timing_advance));
        }
    }

    /// When a period begins, calls `send` with its requests (each goes to all three drones). Occasion
    /// numbers are the indices of `scheduled`, which grows by them.
    ///
    /// # Panics
    /// Never: batches are cut to fit a request.
    pub fn step(&mut self, now: TimePs, scheduled: &mut Vec<Scheduled>, mut send: impl FnMut(SrsRequest)) {
        if now < *self.next_period.get_or_insert(now) {
            return;
        }
        self.next_period = Some(now.after(self.config.period));
        self.users.retain(|_, h| h.by_slot.iter().flatten().any(|(at, _)| now.since(*at) <= HEARD_FOR));
        let mut common: Vec<(Option<TimePs>, UserId, [u16; 3])> = Vec::new();
        for (user, hearing) in &self.users {
            let fresh = |slot: usize| {
                hearing.by_slot[slot].filter(|(at, _)| now.since(*at) <= HEARD_FOR).map(|(_, ta)| ta)
            };
            if let (Some(a), Some(b), Some(c)) = (fresh(0), fresh(1), fresh(2)) {
                common.push((hearing.last_asked, *user, [a, b, c]));
            }
        }
        if common.len() > self.config.max_per_period {
            common.sort();
            common.truncate(self.config.max_per_period);
        }
        let Some(spacing) = self.config.period.0.checked_div(common.len() as i64).map(TimePs) else { return };
        let mut at = now.after(LEAD);
        for batch in common.chunks(MAX_SRS_PER_REQUEST) {
            let first = scheduled.len();
            let start = at;
            let mut entries = heapless::Vec::new();
            for &(_, user, advances) in batch {
                let serving = self.mates[nearest(&advances, scheduled.len())];
                scheduled.push(Scheduled { user, fleet: self.fleet, at });
                entries.push(SrsRequestEntry { user, serving }).expect("a batch fits a request");
                self.users.entry(user).or_default().last_asked = Some(at);
                at = at.after(spacing);
            }
            send(SrsRequest { start, spacing, first_occasion: OccasionId(first as u32), entries });
        }
    }
}

/// Slot of the drone nearest by timing advance, whose step is coarser than the triangle: drones that
/// tie take turns.
fn nearest(advances: &[u16; 3], turn: usize) -> usize {
    let least = advances.iter().min().copied().unwrap_or_default();
    (0..3).map(|k| (turn + k) % 3).find(|&slot| advances[slot] == least).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use skyroost_protocol::message::AttachedUser;

    const MATES: [DroneId; 3] = [DroneId(1), DroneId(2), DroneId(3)];

    fn page(at_s: i64, users: std::ops::Range<u32>, advance: u16) -> Attached {
        let users = users.map(|u| AttachedUser { user: UserId(u), timing_advance: advance }).collect();
        Attached { time: TimePs::from_ms(at_s * 1000), users }
    }

    #[test]
    fn users_in_the_common_coverage_are_asked_once_a_period() {
        let mut schedule = FleetSchedule::new(0, MATES, SrsConfig::default());
        let (mut scheduled, mut requests) = (Vec::new(), Vec::new());
        for s in 0..3 {
            schedule.heard(MATES[0], &page(s, 0..20, 3));
            schedule.heard(MATES[1], &page(s, 0..20, 2));
            schedule.heard(MATES[2], &page(s, 0..15, 4)); // five users miss the third drone
            for ms in (0..1_000).step_by(40) {
                let now = TimePs::from_ms(s * 1000 + ms);
                schedule.step(now, &mut scheduled, |r| requests.push((now, r)));
            }
        }
        assert_eq!(scheduled.len(), 45);
        assert!(requests.iter().all(|(now, r)| r.start.since(*now) >= LEAD));
        assert!(requests.iter().flat_map(|(_, r)| &r.entries).all(|e| e.serving == MATES[1]));
        let mut times: Vec<_> = scheduled.iter().map(|s| s.at).collect();
        times.dedup();
        assert_eq!(times.len(), 45, "one at a time");
    }

    #[test]
    fn above_the_limit_users_take_turns() {
        let config = SrsConfig { max_per_period: 10, ..SrsConfig::default() };
        let mut schedule = FleetSchedule::new(0, MATES, config);
        let mut scheduled = Vec::new();
        for s in 0..4 {
            MATES.iter().for_each(|m| schedule.heard(*m, &page(s, 0..20, 1)));
            schedule.step(TimePs::from_ms(s * 1000), &mut scheduled, |_| {});
        }
        let mut asked = [0; 20];
        scheduled.iter().for_each(|s| asked[s.user.0 as usize] += 1);
        assert_eq!(asked, [2; 20]);
    }

    #[test]
    fn nobody_in_reach_is_no_request() {
        let mut schedule = FleetSchedule::new(0, MATES, SrsConfig::default());
        schedule.step(TimePs(0), &mut Vec::new(), |_| panic!("nobody to ask"));
    }
}
