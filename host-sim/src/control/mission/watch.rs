//! Who has fallen silent: a drone in the air is heard ten times a second, so that silence is told within two seconds.
//!
//! A lost drone is waited for no more and gets no goal; what it was told before is still repeated, as it may hear.
//! The others fly on: slots follow the lanes and nobody leads.

use super::{ControlCenter, Target, drone::DroneLink};
use skyroost_protocol::{
    message::EventCode,
    units::{DroneId, TimePs},
};

/// Something the operator should know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OperatorEvent {
    /// When: by the drone's word, or when the control center noticed.
    pub time: TimePs,
    /// Who said so, or of whom it is said.
    pub drone: DroneId,
    /// What.
    pub what: Happening,
}

/// What an [`OperatorEvent`] tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Happening {
    /// The drone said so.
    Said {
        /// What.
        code: EventCode,
        /// Its value.
        value: u32,
    },
    /// The drone is in the air and says nothing any more.
    Lost,
    /// A lost drone was heard again.
    HeardAgain,
    /// The control center was killed, and goes on with this drone.
    Resumed,
    /// The drone refuses a command that does not go with what it does.
    Refused {
        /// Which.
        command: &'static str,
    },
}

impl ControlCenter {
    /// Notes who fell silent in the air and who was heard again.
    pub(super) fn watch(&mut self, now: TimePs) {
        for drone in &mut self.drones {
            let Some(lost) = drone.watched(now, self.plan.relay_period) else { continue };
            let what = if lost { Happening::Lost } else { Happening::HeardAgain };
            self.events.push(OperatorEvent { time: now, drone: drone.id, what });
        }
    }

    /// Notes what a drone said, a condition only where telemetry has not told it yet.
    pub(super) fn said(&mut self, drone: usize, time: TimePs, code: EventCode, value: u32) {
        let drone = &mut self.drones[drone];
        if let (EventCode::ConditionRaised | EventCode::ConditionCleared, Some(bit)) =
            (code, 1_u32.checked_shl(value))
        {
            let (as_of, noted) = &mut drone.noted;
            let raised = code == EventCode::ConditionRaised;
            if (*noted & bit != 0) == raised {
                return;
            }
            // One that telemetry has overtaken is told, and over.
            if time >= *as_of {
                (*as_of, *noted) = (time, *noted ^ bit);
            }
        }
        self.events.push(OperatorEvent { time, drone: drone.id, what: Happening::Said { code, value } });
    }

    /// Notes the conditions that telemetry tells and whose events were lost on the way: nothing repeats an event.
    pub(super) fn conditions_are(&mut self, drone: usize, time: TimePs, conditions: u32) {
        let drone = &mut self.drones[drone];
        let (as_of, noted) = drone.noted;
        if time < as_of {
            return;
        }
        drone.noted = (time, conditions);
        for value in (0..u32::BITS).filter(|value| (noted ^ conditions) >> value & 1 != 0) {
            let raised = conditions >> value & 1 != 0;
            let code = if raised { EventCode::ConditionRaised } else { EventCode::ConditionCleared };
            self.events.push(OperatorEvent { time, drone: drone.id, what: Happening::Said { code, value } });
        }
    }

    /// Drones that are lost now, and since when.
    pub fn lost(&self) -> impl Iterator<Item = (DroneId, TimePs)> {
        self.drones.iter().filter_map(|drone| Some((drone.id, drone.lost?)))
    }

    /// Indices of the drones that can serve.
    pub(super) fn living(&self) -> Vec<usize> {
        (0..self.drones.len()).filter(|&drone| self.can_serve(drone)).collect()
    }

    /// Links of the drones in fleets.
    pub(super) fn every_member(&self) -> impl Iterator<Item = &DroneLink> {
        let drones = self.plan.drones.iter().zip(&self.drones);
        drones.filter(|(planned, _)| planned.fleet.is_some()).map(|(_, link)| link)
    }

    /// Links of the drones in fleets, those that are lost left out.
    pub(super) fn members(&self) -> impl Iterator<Item = &DroneLink> {
        self.every_member().filter(|link| link.lost.is_none())
    }

    /// Who was sent where, of those that are not lost.
    #[must_use]
    pub fn targets(&self) -> Vec<Target> {
        self.targets.iter().filter(|target| self.drones[target.drone].lost.is_none()).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::mission::simple;
    use skyroost_protocol::{
        codec::{MAX_FRAME, Sender},
        message::{FlightPhase, Manner, SharedState, Telemetry, Up},
        units::{PosEnuMm, VelEnuMmps},
    };

    /// A control center of one drone that is to be told of others so often.
    fn control(relay_ms: i64) -> ControlCenter {
        simple::control(1, |plan| plan.relay_period = TimePs::from_ms(relay_ms))
    }

    fn at(ms: i64) -> TimePs {
        TimePs::from_ms(ms)
    }

    struct Drone {
        sender: Sender,
    }

    impl Drone {
        fn says(&mut self, control: &mut ControlCenter, ms: i64, message: &Up) {
            let mut frame = [0; MAX_FRAME];
            let length = self.sender.encode_into(message, &mut frame).unwrap();
            control.receive(at(ms), DroneId(1), &frame[..length], &mut |_, _| {}).unwrap();
        }

        fn flies(&mut self, control: &mut ControlCenter, ms: i64) {
            let (pos, vel) = (PosEnuMm([0, 0, 100_000]), VelEnuMmps([0; 3]));
            self.says(
                control,
                ms,
                &Up::SharedState(SharedState {
                    time: at(ms),
                    pos,
                    vel,
                    error_radius_mm: 0,
                    manner: Manner::ALONE,
                }),
            );
        }
    }

    /// When it was lost and heard again, milliseconds, if all it says is `said` at the time it stands at.
    fn told(
        control: &mut ControlCenter,
        until_ms: i64,
        mut said: impl FnMut(&mut ControlCenter, i64),
    ) -> Vec<(i64, Happening)> {
        for ms in (0..until_ms).step_by(20) {
            said(control, ms);
            control.watch(at(ms));
        }
        let noticed = control.events().iter().filter(|event| !matches!(event.what, Happening::Said { .. }));
        noticed.map(|event| (event.time.0 / at(1).0, event.what)).collect()
    }

    fn drone() -> Drone {
        Drone { sender: Sender::new(DroneId(1), 1) }
    }

    #[test]
    fn silence_in_the_air_is_told_within_two_seconds_and_so_is_its_end() {
        let (mut control, mut drone) = (control(100), drone());
        let events = told(&mut control, 9_000, |control, ms| {
            if ms % 100 == 0 && !(4_000..7_000).contains(&ms) {
                drone.flies(control, ms);
            }
        });
        assert_eq!(events, [(5_400, Happening::Lost), (7_000, Happening::HeardAgain)]);
        assert_eq!(control.lost().count(), 0);
    }

    #[test]
    fn silence_on_the_ground_is_nobodys_business() {
        let (mut control, mut drone) = (control(100), drone());
        let events = told(&mut control, 9_000, |control, ms| match ms {
            0..3_000 if ms % 100 == 0 => drone.flies(control, ms),
            3_000 => {
                let (code, value) = (EventCode::PhaseEntered, FlightPhase::Grounded as u32);
                drone.says(control, ms, &Up::Event { code, time: at(ms), value });
            }
            _ => {}
        });
        assert_eq!(events, []);
        // Others hear that it stands there.
        assert_eq!(control.drones[0].state.map(|state| state.time), Some(at(3_000)));
    }

    #[test]
    fn where_states_are_seldom_silence_takes_longer() {
        let (mut control, mut drone) = (control(1_000), drone());
        let events = told(&mut control, 9_000, |control, ms| {
            if ms % 1_000 == 0 && ms < 5_000 {
                drone.flies(control, ms);
            }
        });
        assert_eq!(events, [(7_000, Happening::Lost)]);
        assert_eq!(control.lost().map(|(id, _)| id).collect::<Vec<_>>(), [DroneId(1)]);
    }

    #[test]
    fn a_condition_is_noted_once_whether_its_event_arrives_or_not() {
        let (mut control, mut drone) = (control(100), drone());
        let telemetry = |ms: i64, conditions: u32| {
            Up::Telemetry(Telemetry { conditions, ..simple::telemetry(at(ms), FlightPhase::Hold) })
        };
        let event = |ms: i64, code: EventCode, value: u32| Up::Event { code, time: at(ms), value };
        const LINK_QUIET: u32 = 0;
        const BATTERY_LOW: u32 = 4;
        const WIND_STRONG: u32 = 14;
        const MATE_GONE: u32 = 19;
        use EventCode::{ConditionCleared, ConditionRaised};
        for (ms, message) in [
            (1_100, event(1_000, ConditionRaised, LINK_QUIET)),
            (1_200, telemetry(1_100, 1 << LINK_QUIET)),
            // Lost: that it cleared, and what came instead.
            (2_200, telemetry(2_100, 1 << BATTERY_LOW | 1 << MATE_GONE)),
            // Late: what telemetry told already, and what was over by then.
            (2_300, event(2_050, ConditionRaised, BATTERY_LOW)),
            (2_400, event(2_060, ConditionRaised, WIND_STRONG)),
            (3_200, telemetry(3_100, 1 << BATTERY_LOW)),
        ] {
            drone.says(&mut control, ms, &message);
        }
        let noted = control.events().iter().map(|event| (event.time.0 / at(1).0, event.what));
        let said = |ms, code, value: u32| (ms, Happening::Said { code, value });
        let expected = [
            said(1_000, ConditionRaised, LINK_QUIET),
            said(2_100, ConditionCleared, LINK_QUIET),
            said(2_100, ConditionRaised, BATTERY_LOW),
            said(2_100, ConditionRaised, MATE_GONE),
            said(2_060, ConditionRaised, WIND_STRONG),
            said(3_100, ConditionCleared, MATE_GONE),
        ];
        assert_eq!(noted.collect::<Vec<_>>(), expected);
    }
}
