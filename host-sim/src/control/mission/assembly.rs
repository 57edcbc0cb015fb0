//! Flies the plan of [`assemble`](crate::control::assemble): phase by phase, and in each goal by goal, every drone at
//! its own pace; the next phase begins when all are through.

use super::{ControlCenter, drone::place_at};
use crate::{control::assemble::Phase, geometry::V3};
use skyroost_protocol::{message::FlightPhase, units::TimePs};

/// How far the assembly is.
#[derive(Clone, Debug, Default)]
pub(super) struct Assembling {
    /// Phases that all drones are through with.
    phases: usize,
    /// Of each way: goals of the phase reached, and where its drone was sent last.
    ways: Vec<(usize, Option<V3>)>,
}

impl ControlCenter {
    /// Sends every drone that has reached its goal on to the next; true when all fleets are in formation.
    pub(super) fn assembled(&mut self, now: TimePs) -> bool {
        let Some(assembly) = &self.plan.assembly else { return true };
        let Some(&phase) = Phase::ALL.get(self.assembling.phases) else { return true };
        self.assembling.ways.resize(assembly.ways.len(), (0, None));
        let mut through = true;
        for (way, (reached, sent)) in assembly.ways.iter().zip(&mut self.assembling.ways) {
            let at_m = self.drones[way.drone].state.map(|state| super::pos_m(&state.pos));
            let drone = &mut self.drones[way.drone];
            if drone.lost.is_some() {
                continue;
            }
            let goals_m = assembly.goals_m(way, phase);
            let said = drone.phase(now);
            if said == Some(FlightPhase::Serve) && sent.is_some() && goals_m.get(*reached) == sent.as_ref() {
                *reached += 1;
            }
            let Some(&goal_m) = goals_m.get(*reached) else { continue };
            through = false;
            // Blown off its way, something may bar it: there is another way around that.
            let free = |from_m: V3| self.plan.airspace.is_free(from_m.xy(), goal_m.xy());
            let next_m = match (said, at_m) {
                (Some(FlightPhase::Hold | FlightPhase::Serve), _) => goal_m,
                (Some(FlightPhase::GoTo), Some(at_m)) if drone.stands() && !free(at_m) => {
                    self.plan.airspace.next_m(at_m.xy(), goal_m.xy()).push(goal_m.z)
                }
                _ => continue,
            };
            if *sent != Some(next_m) {
                *sent = Some(next_m);
                drone.command(place_at(next_m.xy(), next_m.z));
            }
        }
        if through {
            self.assembling = Assembling { phases: self.assembling.phases + 1, ways: Vec::new() };
        }
        self.assembling.phases == Phase::ALL.len()
    }
}
