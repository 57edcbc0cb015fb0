//! The supervisor watches what the flight depends on and has the last word over it.
//!
//! Conditions are bits; each is raised and cleared with an event. The [`table`] says when, and what they come to.

mod health;
pub mod table;
#[cfg(test)]
mod tests;

use crate::config::SupervisorConfig;
pub use health::{FenceRoom, Health, ago_ms, low_ms};
use skyroost_protocol::units::TimePs;
pub use table::{Action, Condition};
use table::{CONDITIONS, Demands, TABLE};

/// What conditions that turn are timed in.
const TICK: TimePs = TimePs::from_ms(32);

/// So many milliseconds, rounded up, and a tick more as the first one has begun; 8 s at most.
const fn ticks(ms: u16) -> u8 {
    let ticks = if ms == 0 { 0 } else { ms.div_ceil(32) + 1 };
    if ticks > 250 { 250 } else { ticks as u8 }
}

/// State of the supervisor.
#[derive(Clone, Debug, Default)]
pub struct Supervisor {
    /// Those in force.
    conditions: u32,
    /// Those that are about to change: in force and well again, or not yet in force and wrong.
    turning: u32,
    /// Since when, in ticks that wrap after 8 s, longer than [`Limit::for_ms`](table::Limit::for_ms) can be.
    since: [u8; CONDITIONS],
}

impl Supervisor {
    /// Nothing wrong so far.
    #[must_use]
    pub const fn new() -> Self {
        Self { conditions: 0, turning: 0, since: [0; CONDITIONS] }
    }

    /// Conditions in force, one bit each.
    #[must_use]
    pub const fn conditions(&self) -> u32 {
        self.conditions
    }

    /// Whether `condition` is in force.
    #[must_use]
    pub const fn is(&self, condition: Condition) -> bool {
        self.conditions & condition.bit() != 0
    }

    /// Looks at `health`, tells `changed` every condition that came up (true) or cleared (false), and
    /// returns what must be done.
    pub fn step(
        &mut self,
        now: TimePs,
        health: &Health,
        config: &SupervisorConfig,
        mut changed: impl FnMut(Condition, bool),
    ) -> Action {
        let tick = (now.0 / TICK.0) as u8;
        let mut demands = Demands::NONE;
        for (row, since) in TABLE.iter().zip(&mut self.since) {
            let (bit, limit) = (row.condition.bit(), row.condition.limit(config));
            let in_force = self.conditions & bit != 0;
            let is_wrong = health.airborne && limit.is_beyond(health.measure(row.condition), in_force);
            if is_wrong == in_force {
                self.turning &= !bit;
            } else {
                if self.turning & bit == 0 {
                    self.turning |= bit;
                    *since = tick;
                }
                let after_ms = if in_force { row.clears_after_ms } else { limit.for_ms };
                // A flight that is over takes its conditions along.
                if tick.wrapping_sub(*since) >= ticks(after_ms) || !health.airborne {
                    self.conditions ^= bit;
                    self.turning &= !bit;
                    changed(row.condition, is_wrong);
                }
            }
            if self.conditions & bit != 0 {
                demands = demands.and(row.demands);
            }
        }
        demands.action()
    }
}
