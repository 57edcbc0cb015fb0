//! When guidance wakes and when it steps: the 50 Hz grid on GNSS time.

use super::cadence::{Cadence, GUIDANCE_PERIOD_US, Punctuality};
use skyroost_protocol::units::TimePs;

/// Whole microseconds of pause are never too short for the clock's own rounding.
const ROUNDING_US: u64 = 1;

/// The grid of slots at whole multiples of the period since the mission's epoch, the same for all drones.
///
/// The board sleeps by one clock (its oscillator's) and steps by another (GNSS); the grid says how long
/// to sleep and, on waking, whether it is time. It keeps its slots when GNSS time is corrected a little, and
/// counts as dropped what a correction by seconds jumps over.
///
/// ```
/// use skyroost_firmware::board::grid::{Grid, Waking};
/// use skyroost_protocol::units::TimePs;
///
/// let mut grid = Grid::default();
/// assert_eq!(grid.wake(TimePs::from_us(1_005_000)), Waking::Sleep { us: 15_001 });
/// assert_eq!(grid.wake(TimePs::from_us(1_020_001)), Waking::Step);
/// assert_eq!(grid.stepped(TimePs::from_us(1_020_001), 900), 19_100);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Grid {
    cadence: Option<Cadence>,
}

/// What to do on waking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waking {
    /// A slot is due.
    Step,
    /// Sleep so many microseconds.
    Sleep {
        /// Never more than a period and what rounding adds.
        us: u64,
    },
}

impl Grid {
    /// Guidance is awake at `now`. The first time lays the grid.
    pub fn wake(&mut self, now: TimePs) -> Waking {
        let now_us = board_us(now);
        let cadence = self.cadence.get_or_insert_with(|| Cadence::starting_at(next_slot_us(now_us)));
        let ahead_us = cadence.due_us().saturating_sub(now_us);
        if ahead_us == 0 { Waking::Step } else { Waking::Sleep { us: pause_us(ahead_us) } }
    }

    /// The step begun at `begun` took so long. Returns the microseconds to sleep.
    pub fn stepped(&mut self, begun: TimePs, took_us: u64) -> u64 {
        let begun_us = board_us(begun);
        let ended_us = begun_us.saturating_add(took_us);
        let Some(cadence) = &mut self.cadence else { return u64::from(GUIDANCE_PERIOD_US) };
        cadence.finished(begun_us, ended_us);
        pause_us(cadence.due_us().saturating_sub(ended_us))
    }

    /// How the grid was kept so far.
    #[must_use]
    pub fn punctuality(&self) -> Punctuality {
        self.cadence.as_ref().map(|cadence| *cadence.punctuality()).unwrap_or_default()
    }
}

/// Microseconds since the mission's epoch; before it there is no grid, and all is zero.
fn board_us(time: TimePs) -> u64 {
    u64::try_from(time.as_us()).unwrap_or(0)
}

fn next_slot_us(now_us: u64) -> u64 {
    let period_us = u64::from(GUIDANCE_PERIOD_US);
    (now_us / period_us + 1) * period_us
}

fn pause_us(ahead_us: u64) -> u64 {
    ahead_us.min(u64::from(GUIDANCE_PERIOD_US)) + ROUNDING_US
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection::vec, prelude::*};

    /// Runs the grid over true time with an oscillator `ppm` fast. Every waking comes `late_us` later than
    /// asked for, every step takes `step_us`. Returns the times of the steps, in true microseconds.
    fn run(grid: &mut Grid, from_us: i64, ppm: i64, wakings: &[(i64, u64)]) -> Vec<i64> {
        let mut true_ns = from_us * 1000;
        let mut steps = Vec::new();
        let sleep = |ns: &mut i64, us: u64, late_us: i64| {
            *ns += us as i64 * (1_000_000 - ppm) / 1000 + late_us * 1000;
        };
        for &(late_us, step_us) in wakings {
            let now = TimePs(true_ns * 1000);
            let us = match grid.wake(now) {
                Waking::Sleep { us } => us,
                Waking::Step => {
                    steps.push(true_ns / 1000);
                    true_ns += step_us as i64 * 1000;
                    grid.stepped(now, step_us)
                }
            };
            sleep(&mut true_ns, us, late_us);
        }
        steps
    }

    proptest! {
        /// Whatever the oscillator, there is one step in every slot, soon after it began.
        #[test]
        fn truth_a_step_in_every_slot(
            from_us in 0..100_000_000_i64,
            ppm in -50..=50_i64,
            wakings in vec((0..30_i64, 0..6_000_u64), 50..400),
        ) {
            let mut grid = Grid::default();
            let steps = run(&mut grid, from_us, ppm, &wakings);
            prop_assert!(steps.len() * 2 >= wakings.len() - 1, "{} of {}", steps.len(), wakings.len());
            for (slot, at_us) in (from_us / 20_000 + 1..).zip(&steps) {
                let after_us = at_us - slot * 20_000;
                prop_assert!((0..=64).contains(&after_us), "{after_us} us after slot {slot}");
            }
            prop_assert_eq!(grid.punctuality().dropped_slots, 0);
        }
    }

    #[test]
    fn a_jump_of_time_is_dropped_slots() {
        let mut grid = Grid::default();
        grid.wake(TimePs::from_ms(0));
        grid.stepped(TimePs::from_ms(20), 100);
        assert_eq!(grid.wake(TimePs::from_ms(1_040)), Waking::Step);
        grid.stepped(TimePs::from_ms(1_040), 100);
        assert_eq!(grid.punctuality().dropped_slots, 49);
    }

    #[test]
    fn time_before_the_epoch_sleeps() {
        let mut grid = Grid::default();
        assert_eq!(grid.wake(TimePs::from_ms(-5_000)), Waking::Sleep { us: 20_001 });
    }
}
