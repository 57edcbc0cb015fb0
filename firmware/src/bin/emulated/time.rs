//! embassy's time, moved on by the host and by nothing else.

use core::cell::RefCell;
use core::task::Waker;
use critical_section::Mutex;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;
use skyroost_protocol::units::TimePs;

struct HostTime {
    state: Mutex<RefCell<State>>,
}

struct State {
    now_us: u64,
    timers: Queue,
}

embassy_time_driver::time_driver_impl!(static TIME: HostTime = HostTime {
    state: Mutex::new(RefCell::new(State { now_us: 0, timers: Queue::new() })),
});

impl Driver for HostTime {
    fn now(&self) -> u64 {
        critical_section::with(|cs| self.state.borrow_ref(cs).now_us)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            let state = &mut *self.state.borrow_ref_mut(cs);
            if state.timers.schedule_wake(at, waker) {
                // Wakes what is due already; the others wait for the host.
                state.timers.next_expiration(state.now_us);
            }
        });
    }
}

/// It is now `now`: wakes the timers that are due. Time never goes back.
pub(crate) fn advance_to(now: TimePs) {
    critical_section::with(|cs| {
        let state = &mut *TIME.state.borrow_ref_mut(cs);
        state.now_us = state.now_us.max(u64::try_from(now.as_us()).unwrap_or(0));
        state.timers.next_expiration(state.now_us);
    });
}
