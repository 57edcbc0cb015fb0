//! Which user sends its SRS when, and which drone serves it.
//!
//! A user is asked once a period while all three drones of a fleet hear it (paper section 2: the
//! common coverage), until it is located well enough. The occasions of a period are spread evenly over it, so that no
//! two users of a fleet transmit at once. Above the limit of occasions they go where they help most: to each user in
//! proportion to the variance of its estimate, spread over its pass.

use super::mission::asking::COPY_EVERY;
use skyroost_protocol::{
    message::{Attached, MAX_SRS_PER_REQUEST, SrsRequest, SrsRequestEntry},
    units::{DroneId, OccasionId, TimePs, UserId},
};
use std::collections::BTreeMap;

/// A user counts as heard by a drone for this long: two pages may be lost.
const HEARD_FOR: TimePs = TimePs::from_ms(2_500);
/// From the request to the first transmission at least: two ways of a good radio and the gate's lead.
const LEAD: TimePs = TimePs::from_ms(400);
/// And at most: a drone remembers so many occasions, and users move on.
const MOST_LEAD: TimePs = TimePs::from_ms(1_200);
/// The drone opens its gate so long before, and takes in frames once in a step.
const GATE_LEAD: TimePs = TimePs::from_ms(80);

/// A larger 95 % radius does not count for more.
const WORST_R95_M: f64 = 300.0;

/// How often users are asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SrsConfig {
    /// Time from one SRS of a user to its next.
    pub period: TimePs,
    /// Most occasions of one fleet in a period.
    pub max_per_period: usize,
    /// A user whose 95 % radius is no larger is not asked again, metres.
    pub enough_r95_m: f64,
}

impl Default for SrsConfig {
    fn default() -> Self {
        Self { period: TimePs::from_ms(1_000), max_per_period: 100, enough_r95_m: 2.0 }
    }
}

/// An occasion that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scheduled {
    /// Who transmits.
    pub user: UserId,
    /// The clocks that listen.
    pub clock_group: u16,
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

impl Hearing {
    /// What another occasion is worth: the variance to be lowered, more the longer ago the last one was. Nobody waits
    /// who was never asked.
    fn need(&self, now: TimePs, r95_m: f64) -> f64 {
        let since = self.last_asked.map_or(f64::INFINITY, |at| now.since(at).0 as f64 * 1e-12 + 1.0);
        // A user asked but not located yet is as good as one at the edge of what can be used.
        since * r95_m.min(WORST_R95_M).powi(2)
    }
}

/// A user that all three drones hear.
struct Candidate {
    user: UserId,
    advances: [u16; 3],
    need: f64,
}

/// Schedule of one fleet.
#[derive(Clone, Debug)]
pub struct FleetSchedule {
    clock_group: u16,
    mates: [DroneId; 3],
    config: SrsConfig,
    users: BTreeMap<UserId, Hearing>,
    next_period: Option<TimePs>,
    /// Whether there was no room for some of the last requests.
    crowded: bool,
}

impl FleetSchedule {
    /// Nobody heard yet.
    #[must_use]
    pub fn new(clock_group: u16, mates: [DroneId; 3], config: SrsConfig) -> Self {
        Self { clock_group, mates, config, users: BTreeMap::new(), next_period: None, crowded: false }
    }

    /// Who listens.
    #[must_use]
    pub fn mates(&self) -> [DroneId; 3] {
        self.mates
    }

    /// Whether a period begins.
    #[must_use]
    pub fn is_due(&self, now: TimePs) -> bool {
        self.next_period.is_none_or(|next| now >= next)
    }

    /// From a request to the first transmission, where a frame takes `delay` and is said so often.
    #[must_use]
    pub fn lead(&self, delay: TimePs, copies: usize) -> TimePs {
        let copied = TimePs(COPY_EVERY.0 * copies.saturating_sub(1) as i64);
        delay.after(copied).after(GATE_LEAD).clamp(LEAD, MOST_LEAD)
    }

    /// The latest that a request is of use whose first transmission is at `start`, where a frame takes `delay`.
    #[must_use]
    pub fn latest(start: TimePs, delay: TimePs) -> TimePs {
        start.since(delay).since(GATE_LEAD)
    }

    /// There was no room to ask for these: they come first the next time.
    pub fn not_asked(&mut self, request: &SrsRequest) {
        self.crowded = true;
        for entry in &request.entries {
            if let Some(hearing) = self.users.get_mut(&entry.user) {
                hearing.last_asked = None;
            }
        }
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
    /// numbers are the indices of `scheduled`, which grows by them. The first transmission is `lead` from now. `r95_m` is the 95 % radius that further occasions
    /// of a user can improve; none of one never located.
    ///
    /// # Panics
    /// Never: batches are cut to fit a request.
    pub fn step(
        &mut self,
        now: TimePs,
        lead: TimePs,
        r95_m: impl Fn(UserId) -> Option<f64>,
        scheduled: &mut Vec<Scheduled>,
        mut send: impl FnMut(SrsRequest),
    ) {
        if !self.is_due(now) {
            return;
        }
        self.next_period = Some(now.after(self.config.period));
        self.users.retain(|_, h| h.by_slot.iter().flatten().any(|(at, _)| now.since(*at) <= HEARD_FOR));
        let mut common: Vec<Candidate> = Vec::new();
        for (&user, hearing) in &self.users {
            let fresh = |slot: usize| {
                hearing.by_slot[slot].filter(|(at, _)| now.since(*at) <= HEARD_FOR).map(|(_, ta)| ta)
            };
            let (Some(a), Some(b), Some(c)) = (fresh(0), fresh(1), fresh(2)) else { continue };
            let r95_m = r95_m(user).unwrap_or(f64::INFINITY);
            if r95_m > self.config.enough_r95_m {
                common.push(Candidate { user, advances: [a, b, c], need: hearing.need(now, r95_m) });
            }
        }
        if common.len() > self.config.max_per_period || std::mem::take(&mut self.crowded) {
            common.sort_by(|a, b| b.need.total_cmp(&a.need).then(a.user.cmp(&b.user)));
            common.truncate(self.config.max_per_period);
        }
        let Some(spacing) = self.config.period.0.checked_div(common.len() as i64).map(TimePs) else { return };
        let mut at = now.after(lead);
        for batch in common.chunks(MAX_SRS_PER_REQUEST) {
            let first = scheduled.len();
            let start = at;
            let mut entries = heapless::Vec::new();
            for &Candidate { user, advances, .. } in batch {
                let serving = self.mates[nearest(&advances, scheduled.len())];
                scheduled.push(Scheduled { user, clock_group: self.clock_group, at });
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
                schedule.step(now, LEAD, |_| None, &mut scheduled, |r| requests.push((now, r)));
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
            schedule.step(TimePs::from_ms(s * 1000), LEAD, |_| None, &mut scheduled, |_| {});
        }
        let mut asked = [0; 20];
        scheduled.iter().for_each(|s| asked[s.user.0 as usize] += 1);
        assert_eq!(asked, [2; 20]);
    }

    /// A link that takes one request a second of two is no reason to ask the same users all the time.
    #[test]
    fn who_was_not_asked_for_lack_of_room_comes_first_the_next_time() {
        let mut schedule = FleetSchedule::new(0, MATES, SrsConfig::default());
        let mut asked = [0; 24];
        for s in 0..10 {
            MATES.iter().for_each(|m| schedule.heard(*m, &page(s, 0..24, 1)));
            let mut requests = Vec::new();
            schedule.step(
                TimePs::from_ms(s * 1000),
                LEAD,
                |_| Some(10.0),
                &mut Vec::new(),
                |r| requests.push(r),
            );
            let [said, unsaid] = &requests[..] else { panic!("{} requests", requests.len()) };
            said.entries.iter().for_each(|entry| asked[entry.user.0 as usize] += 1);
            schedule.not_asked(unsaid);
        }
        assert_eq!(asked, [5; 24]);
    }

    #[test]
    fn nobody_in_reach_is_no_request() {
        let mut schedule = FleetSchedule::new(0, MATES, SrsConfig::default());
        schedule.step(TimePs(0), LEAD, |_| None, &mut Vec::new(), |_| panic!("nobody to ask"));
    }

    /// How often each user is asked in `seconds`, with 95 % radii that stay as they are.
    fn asked(config: SrsConfig, r95_m: &[f64], seconds: i64) -> Vec<usize> {
        let mut schedule = FleetSchedule::new(0, MATES, config);
        let mut scheduled = Vec::new();
        let users = r95_m.len() as u32;
        for s in 0..seconds {
            MATES.iter().for_each(|m| schedule.heard(*m, &page(s, 0..users, 1)));
            let r95_m = |user: UserId| Some(r95_m[user.0 as usize]);
            schedule.step(TimePs::from_ms(s * 1000), LEAD, r95_m, &mut scheduled, |_| {});
        }
        let of = |user: u32| scheduled.iter().filter(|s| s.user.0 == user).count();
        (0..users).map(of).collect()
    }

    #[test]
    fn scarce_occasions_go_where_the_variance_is() {
        let config = SrsConfig { max_per_period: 2, ..SrsConfig::default() };
        let asked = asked(config, &[5.0, 5.0, 5.0, 10.0, 10.0, 20.0], 300);
        assert_eq!(asked.iter().sum::<usize>(), 600);
        assert!(asked.iter().all(|n| *n > 20), "nobody is left out: {asked:?}");
        assert!(asked[5] > asked[4] && asked[4] > 2 * asked[0], "{asked:?}");
    }

    #[test]
    fn users_located_well_enough_are_left_in_peace() {
        let asked = asked(SrsConfig::default(), &[1.9, 2.1], 50);
        assert_eq!(asked, [0, 50]);
    }
}
