//! Requests for SRS: each to all three drones of a fleet or to none, as soon as all their links have room, and never when it is too late.

use super::{ControlCenter, drone::DroneLink};
use crate::control::srs_schedule::FleetSchedule;
use skyroost_protocol::{
    message::{Down, SrsRequest},
    units::{DroneId, TimePs},
};

/// Between two copies of what is said more than once: bursts of loss are short, and so is the time to an occasion.
pub(in crate::control) const COPY_EVERY: TimePs = TimePs::from_ms(80);

/// A request to be said.
#[derive(Debug)]
pub(super) struct Asking {
    /// Index of the fleet.
    fleet: usize,
    mates: [DroneId; 3],
    request: SrsRequest,
    copies: usize,
    /// Later the drones would not hear of it in time.
    latest: TimePs,
}

/// A request to be said once more.
#[derive(Debug)]
pub(super) struct Again {
    due: TimePs,
    mates: [DroneId; 3],
    message: Down,
}

impl ControlCenter {
    pub(super) fn ask_for_srs(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) {
        let fleets = self.schedules.iter_mut().zip(&self.plan.fleets).enumerate();
        for (index, (schedule, fleet)) in fleets.filter(|(_, (schedule, _))| schedule.is_due(now)) {
            let running = &self.running;
            let now_s = now.0 as f64 * 1e-12;
            let r95_m = |user| running.fix_at(user, now_s).map(|fix| fix.known_clocks_r95_m);
            let mates = || self.drones.iter().filter(|drone| fleet.mates.contains(&drone.id));
            // All three have to hear of an occasion, and before it: the worst link says when and how often.
            let delay = mates().map(|drone| drone.quality.delay()).max().unwrap_or_default();
            let copies = mates().map(|drone| drone.quality.copies()).max().unwrap_or(1);
            let lead = schedule.lead(delay, copies);
            schedule.step(now, lead, r95_m, &mut self.scheduled, |request| {
                let latest = now.max(FleetSchedule::latest(request.start, delay));
                self.asking.push(Asking { fleet: index, mates: fleet.mates, request, copies, latest });
            });
        }
        self.reported.resize(self.scheduled.len(), false);
        self.say_requests(now, send);
        self.say_again(now, send);
    }

    /// What is still to be said is of no use any more.
    pub(super) fn ask_no_more(&mut self) {
        self.counters.held_back.requests += self.asking.len() as u64;
        self.asking.clear();
        self.again.clear();
    }

    /// Says the requests that there is room for; the others wait until they would be too late.
    fn say_requests(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) {
        let (drones, again) = (&mut self.drones, &mut self.again);
        let (schedules, held_back) = (&mut self.schedules, &mut self.counters.held_back);
        self.asking.retain(|asking| {
            let Asking { fleet, mates, request, copies, latest } = asking;
            let is_mate = |drone: &&mut DroneLink| mates.contains(&drone.id);
            if !drones.iter_mut().filter(is_mate).all(|drone| drone.pace.has_room(now)) {
                if now >= *latest {
                    held_back.requests += 1;
                    if let Some(schedule) = schedules.get_mut(*fleet) {
                        schedule.not_asked(request);
                    }
                }
                return now < *latest;
            }
            let message = Down::SrsRequest(request.clone());
            drones.iter_mut().filter(is_mate).for_each(|drone| drone.say(now, &message, send));
            again.extend((1..*copies).map(|copy| Again {
                due: now.after(TimePs(COPY_EVERY.0 * copy as i64)),
                mates: *mates,
                message: message.clone(),
            }));
            false
        });
    }

    /// Says what is due to be said once more, to drones that may not have heard it and to whom there is room.
    fn say_again(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) {
        let (drones, held_back) = (&mut self.drones, &mut self.counters.held_back);
        for Again { mates, message, .. } in self.again.extract_if(.., |again| again.due <= now) {
            for drone in drones.iter_mut().filter(|drone| mates.contains(&drone.id)) {
                if drone.pace.has_room(now) {
                    drone.say(now, &message, send);
                } else {
                    held_back.copies += 1;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::mission::{drone::HeldBack, simple};
    use skyroost_protocol::units::OccasionId;

    const MATES: [DroneId; 3] = [DroneId(1), DroneId(2), DroneId(3)];

    fn at(ms: i64) -> TimePs {
        TimePs::from_ms(ms)
    }

    /// A control center that wants to ask drones 1 to 3 until `latest_ms`, and say so twice, on links of 1,000 bytes a second.
    fn asking(latest_ms: i64) -> ControlCenter {
        let mut control = simple::control(4, |plan| plan.link_bytes_per_s = 1_000);
        let request = SrsRequest {
            start: at(latest_ms + 200),
            spacing: at(10),
            first_occasion: OccasionId(0),
            entries: heapless::Vec::new(),
        };
        control.asking.push(Asking { fleet: 0, mates: MATES, request, copies: 2, latest: at(latest_ms) });
        control
    }

    /// To whom something is said, and when, as requests are looked after every 20 ms.
    fn said(control: &mut ControlCenter, until_ms: i64) -> Vec<(i64, u16)> {
        let mut said = Vec::new();
        for ms in (0..until_ms).step_by(20) {
            control.say_requests(at(ms), &mut |drone, _| said.push((ms, drone.0)));
            control.say_again(at(ms), &mut |drone, _| said.push((ms, drone.0)));
        }
        said
    }

    /// Fills the link to a drone with some 250 ms of something else.
    fn fill(control: &mut ControlCenter, drone: usize) {
        while control.drones[drone].pace.has_room(at(250)) {
            control.drones[drone].say(at(0), &Down::Heartbeat, &mut |_, _| {});
        }
    }

    #[test]
    fn a_request_is_said_to_all_three_and_once_more() {
        let mut control = asking(1_000);
        assert_eq!(said(&mut control, 2_000), [(0, 1), (0, 2), (0, 3), (80, 1), (80, 2), (80, 3)]);
        assert_eq!(control.counters.held_back, HeldBack::default());
    }

    #[test]
    fn where_one_link_is_full_all_three_wait() {
        let mut control = asking(1_000);
        fill(&mut control, 1);
        fill(&mut control, 3); // not of this fleet
        let said = said(&mut control, 2_000);
        let (first, rest) = said.split_at(3);
        let [(ms, 1), (same, 2), (again, 3)] = *first else { panic!("{said:?}") };
        assert!((260..1_000).contains(&ms) && ms == same && ms == again, "{said:?}");
        assert_eq!(rest.len(), 3, "{said:?}");
    }

    #[test]
    fn what_is_too_late_is_said_to_none_and_counted() {
        let mut control = asking(200);
        fill(&mut control, 2);
        assert_eq!(said(&mut control, 2_000), []);
        assert_eq!(control.counters.held_back.requests, 1);
    }

    #[test]
    fn what_is_not_said_when_asking_ends_is_counted() {
        let mut control = asking(1_000);
        fill(&mut control, 0);
        assert_eq!(said(&mut control, 100), []);
        control.ask_no_more();
        assert_eq!(said(&mut control, 2_000), []);
        assert_eq!(control.counters.held_back.requests, 1);
    }
}
