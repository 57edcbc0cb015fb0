//! The 50 Hz grid on which a board steps the flight code, and the account of how well it was kept.

/// Period of the guidance loop in microseconds (50 Hz).
pub const GUIDANCE_PERIOD_US: u32 = 20_000;

/// How punctual the guidance loop has been since start. Every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Punctuality {
    /// Steps done.
    pub steps: u32,
    /// Slots of the grid that passed without a step because an earlier step ran over them.
    pub dropped_slots: u32,
    /// Longest time from the moment a step was due to its start.
    pub worst_delay_us: u32,
    /// Longest time from the start of a step to its end.
    pub worst_step_us: u32,
}

/// Says when the next step is due.
///
/// Slots lie on a fixed grid, so a late step does not shift those after it. When a step runs over one
/// or more slots, the latest of them is done at once and the older ones are dropped and counted: old
/// slots worked off in a burst would integrate the same navigation fix several times.
///
/// Assumption: the board's clock never runs backwards; should it, times read as zero, never as huge.
///
/// ```
/// use skyroost_firmware::board::cadence::{Cadence, GUIDANCE_PERIOD_US};
///
/// let mut cadence = Cadence::starting_at(1_000_000);
/// let begun_us = cadence.due_us() + 3; // woken 3 us late
/// cadence.finished(begun_us, begun_us + 850);
/// assert_eq!(cadence.due_us(), 1_000_000 + u64::from(GUIDANCE_PERIOD_US));
/// assert_eq!(cadence.punctuality().worst_step_us, 850);
/// ```
#[derive(Clone, Debug)]
pub struct Cadence {
    due_us: u64,
    punctuality: Punctuality,
}

impl Cadence {
    /// A grid whose first slot is at `start_us` of the board's clock.
    #[must_use]
    pub const fn starting_at(start_us: u64) -> Self {
        let punctuality = Punctuality { steps: 0, dropped_slots: 0, worst_delay_us: 0, worst_step_us: 0 };
        Self { due_us: start_us, punctuality }
    }

    /// When the next step is due on the board's clock, in microseconds. May already be past.
    #[must_use]
    pub const fn due_us(&self) -> u64 {
        self.due_us
    }

    /// How the grid was kept so far.
    #[must_use]
    pub const fn punctuality(&self) -> &Punctuality {
        &self.punctuality
    }

    /// Enters the step that was due: when it began and ended on the board's clock, in microseconds.
    pub fn finished(&mut self, begun_us: u64, ended_us: u64) {
        let period_us = u64::from(GUIDANCE_PERIOD_US);
        let slots = (ended_us.saturating_sub(self.due_us) / period_us).max(1);
        let record = &mut self.punctuality;
        record.steps = record.steps.saturating_add(1);
        record.dropped_slots = record.dropped_slots.saturating_add(saturating_u32(slots - 1));
        record.worst_delay_us =
            record.worst_delay_us.max(saturating_u32(begun_us.saturating_sub(self.due_us)));
        record.worst_step_us = record.worst_step_us.max(saturating_u32(ended_us.saturating_sub(begun_us)));
        self.due_us = self.due_us.saturating_add(slots.saturating_mul(period_us));
    }
}

/// `value`, or the largest `u32` when it does not fit.
fn saturating_u32(value: u64) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD_US: u64 = GUIDANCE_PERIOD_US as u64;

    #[test]
    fn a_punctual_loop_drops_nothing() {
        let mut cadence = Cadence::starting_at(7);
        for slot in 0..1000 {
            assert_eq!(cadence.due_us(), 7 + slot * PERIOD_US);
            let begun_us = cadence.due_us() + slot % 5;
            cadence.finished(begun_us, begun_us + 400);
        }
        let expected = Punctuality { steps: 1000, dropped_slots: 0, worst_delay_us: 4, worst_step_us: 400 };
        assert_eq!(*cadence.punctuality(), expected);
    }

    #[test]
    fn a_step_that_ends_on_the_next_slot_is_in_time() {
        let mut cadence = Cadence::starting_at(0);
        cadence.finished(0, PERIOD_US);
        assert_eq!(cadence.due_us(), PERIOD_US);
        assert_eq!(cadence.punctuality().dropped_slots, 0);
    }

    #[test]
    fn an_overrun_leaves_the_latest_slot_to_do_and_counts_the_others() {
        let mut cadence = Cadence::starting_at(0);
        cadence.finished(10, 2 * PERIOD_US + 5); // over slots 1 and 2
        assert_eq!(cadence.due_us(), 2 * PERIOD_US);
        assert_eq!(cadence.punctuality().dropped_slots, 1);
    }

    #[test]
    fn a_clock_at_its_ends_neither_wraps_nor_panics() {
        let mut cadence = Cadence::starting_at(0);
        cadence.finished(0, u64::MAX);
        cadence.finished(0, 0); // a clock that went back
        cadence.finished(u64::MAX, u64::MAX);
        assert_eq!(cadence.punctuality().dropped_slots, u32::MAX);
        assert_eq!(cadence.punctuality().worst_step_us, u32::MAX);
    }

    proptest! {
        /// Every slot that has come is either done or counted as dropped, and the next stays on the grid.
        #[test]
        fn no_slot_is_lost(
            start_us in 0u64..1 << 40,
            steps in prop::collection::vec((0u64..30_000, 0u64..90_000), 1..200),
        ) {
            let mut cadence = Cadence::starting_at(start_us);
            let mut now_us = start_us;
            for (delay_us, duration_us) in steps {
                let begun_us = now_us.max(cadence.due_us()) + delay_us;
                now_us = begun_us + duration_us;
                let due_before_us = cadence.due_us();
                cadence.finished(begun_us, now_us);
                prop_assert!(cadence.due_us() > due_before_us);
                let late_us = now_us.saturating_sub(cadence.due_us());
                prop_assert!(late_us < PERIOD_US, "{late_us} us behind after the step");
                let record = cadence.punctuality();
                let slots = u64::from(record.steps) + u64::from(record.dropped_slots);
                prop_assert_eq!(cadence.due_us(), start_us + slots * PERIOD_US);
            }
        }
    }
}
