//! The supervisor watches what the flight depends on and has the last word over it.
//!
//! Conditions are bits; each is raised and cleared with an event. The strongest action of all
//! conditions in force is taken: land, then return home, then hold.

use crate::config::SupervisorConfig;
use skyroost_protocol::units::TimePs;

/// What can be wrong; the discriminant is the bit number in telemetry and events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The control center has been silent for a while; nothing is done yet.
    LinkQuiet = 0,
    /// Silent for long: hold.
    LinkLost = 1,
    /// Silent for very long: return home.
    LinkGone = 2,
    /// No navigation solution: hold attitude and sink is all that is left; the velocity setpoint is zero.
    NavigationLost = 3,
    /// The battery gives just enough to return home.
    BatteryLow = 4,
    /// The battery gives just enough to land here.
    BatteryCritical = 5,
    /// A fleet mate on the lanes has been silent; nothing is done, the control center decides.
    MateLost = 6,
    /// Avoidance changed the velocity a moment ago: the drone is not where guidance wants it.
    Avoiding = 7,
}

/// A manoeuvre of avoidance goes on until avoidance has had nothing to say for this long.
const AVOIDED_LATELY: TimePs = TimePs::from_ms(2_000);

impl Condition {
    const ALL: [Self; 8] = [
        Self::LinkQuiet,
        Self::LinkLost,
        Self::LinkGone,
        Self::NavigationLost,
        Self::BatteryLow,
        Self::BatteryCritical,
        Self::MateLost,
        Self::Avoiding,
    ];

    /// Its bit.
    #[must_use]
    pub const fn bit(self) -> u16 {
        1 << self as u16
    }

    /// What it makes the drone do.
    const fn action(self) -> Action {
        match self {
            Self::LinkQuiet | Self::MateLost | Self::Avoiding => Action::None,
            Self::LinkLost | Self::NavigationLost => Action::Hold,
            Self::LinkGone | Self::BatteryLow => Action::ReturnHome,
            Self::BatteryCritical => Action::Land,
        }
    }
}

/// What the supervisor makes the drone do, weakest first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Action {
    /// Nothing: fly on.
    #[default]
    None,
    /// Stop and stay.
    Hold,
    /// Fly back to the pad and land.
    ReturnHome,
    /// Land here.
    Land,
}

/// What the supervisor looks at.
#[derive(Clone, Copy, Debug)]
pub struct Health {
    /// Last frame from the control center.
    pub link_heard: TimePs,
    /// Last navigation solution.
    pub nav_heard: TimePs,
    /// Charge left, per mille.
    pub battery_permille: u16,
    /// Last frame from the fleet mate that has been silent the longest; none off the lanes.
    pub mates_heard: Option<TimePs>,
    /// When avoidance last changed the velocity.
    pub avoided: Option<TimePs>,
    /// Whether the drone is in the air: on the ground nothing is overridden.
    pub airborne: bool,
}

/// State of the supervisor.
#[derive(Clone, Debug, Default)]
pub struct Supervisor {
    conditions: u16,
}

impl Supervisor {
    /// Nothing wrong so far.
    #[must_use]
    pub const fn new() -> Self {
        Self { conditions: 0 }
    }

    /// Conditions in force, one bit each.
    #[must_use]
    pub fn conditions(&self) -> u16 {
        self.conditions
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
        let silent_for = |heard: TimePs, ms: u32| now.since(heard) > TimePs::from_ms(i64::from(ms));
        let mut action = Action::None;
        for condition in Condition::ALL {
            let on = health.airborne
                && match condition {
                    Condition::LinkQuiet => silent_for(health.link_heard, config.link_warn_ms),
                    Condition::LinkLost => silent_for(health.link_heard, config.link_hold_ms),
                    Condition::LinkGone => silent_for(health.link_heard, config.link_return_ms),
                    Condition::NavigationLost => silent_for(health.nav_heard, config.nav_lost_ms),
                    Condition::BatteryLow => health.battery_permille < config.battery_low_permille,
                    Condition::BatteryCritical => health.battery_permille < config.battery_critical_permille,
                    Condition::MateLost => {
                        health.mates_heard.is_some_and(|heard| silent_for(heard, config.mate_lost_ms))
                    }
                    Condition::Avoiding => health.avoided.is_some_and(|at| now.since(at) < AVOIDED_LATELY),
                };
            let was = self.conditions & condition.bit() != 0;
            if on != was {
                self.conditions ^= condition.bit();
                changed(condition, on);
            }
            if on {
                action = action.max(condition.action());
            }
        }
        action
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn healthy() -> Health {
        Health {
            link_heard: TimePs(0),
            nav_heard: TimePs(0),
            battery_permille: 1000,
            mates_heard: None,
            avoided: None,
            airborne: true,
        }
    }

    #[test]
    fn link_loss_warns_then_holds_then_returns_and_clears() {
        let (mut supervisor, config) = (Supervisor::default(), SupervisorConfig::default());
        let mut events = Vec::new();
        let mut at = |s: i64, heard_s: i64| {
            let now = TimePs::from_ms(s * 1000);
            let health = Health { link_heard: TimePs::from_ms(heard_s * 1000), nav_heard: now, ..healthy() };
            supervisor.step(now, &health, &config, |c, on| events.push((s, c, on)))
        };
        assert_eq!(at(1, 0), Action::None);
        assert_eq!(at(3, 0), Action::None);
        assert_eq!(at(11, 0), Action::Hold);
        assert_eq!(at(61, 0), Action::ReturnHome);
        assert_eq!(at(62, 62), Action::None);
        use Condition::{LinkGone, LinkLost, LinkQuiet};
        assert_eq!(
            events,
            [
                (3, LinkQuiet, true),
                (11, LinkLost, true),
                (61, LinkGone, true),
                (62, LinkQuiet, false),
                (62, LinkLost, false),
                (62, LinkGone, false)
            ]
        );
    }

    #[test]
    fn a_silent_mate_and_a_manoeuvre_are_told_and_nothing_is_done() {
        let (mut supervisor, config) = (Supervisor::default(), SupervisorConfig::default());
        let mut told = Vec::new();
        for ms in (0..5_000).step_by(100) {
            let now = TimePs::from_ms(ms);
            let health = Health {
                link_heard: now,
                nav_heard: now,
                mates_heard: Some(TimePs::from_ms(if ms < 3_000 { 500 } else { ms })),
                avoided: (ms >= 1_000).then(|| TimePs::from_ms(ms.min(1_500))),
                ..healthy()
            };
            let action = supervisor.step(now, &health, &config, |c, on| told.push((ms, c, on)));
            assert_eq!(action, Action::None);
        }
        use Condition::{Avoiding, MateLost};
        let expected = [
            (1_000, Avoiding, true),
            (2_200, MateLost, true),
            (3_000, MateLost, false),
            (3_500, Avoiding, false),
        ];
        assert_eq!(told, expected);
    }

    proptest! {
        /// Any combination: the strongest action wins, and nothing is overridden on the ground.
        #[test]
        fn the_strongest_action_wins(link_s in 0i64..100, nav_ms in 0i64..1000, battery in 0u16..=1000, airborne: bool) {
            let now = TimePs::from_ms(200_000);
            let health = Health {
                link_heard: TimePs::from_ms(200_000 - link_s * 1000),
                nav_heard: TimePs::from_ms(200_000 - nav_ms),
                battery_permille: battery,
                airborne,
                ..healthy()
            };
            let action = Supervisor::default().step(now, &health, &SupervisorConfig::default(), |_, _| {});
            let expected = if !airborne { Action::None }
                else if battery < 50 { Action::Land }
                else if battery < 150 || link_s > 60 { Action::ReturnHome }
                else if link_s > 10 || nav_ms > 500 { Action::Hold }
                else { Action::None };
            prop_assert_eq!(action, expected);
        }
    }
}
