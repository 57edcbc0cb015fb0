//! Who flies which lanes, and from where.

use super::{
    MissionInput, RunError,
    formation::{self, Pads},
    setup::heading,
    space,
};
use crate::{
    control::{
        area::Obstacle,
        assemble,
        mission::plan::{PlannedDrone, PlannedFleet},
        sweep::SweepPlan,
    },
    geometry::{V2, region::Region},
    scenario::{Orientation, Scenario},
};
use skyroost_protocol::units::DroneId;
use std::f64::consts::FRAC_PI_2;

/// Where the drones stand, and where their fleets begin in formation.
pub(super) enum Bases {
    /// Fleet by fleet on the ground as in the air: each begins where it stands.
    InFormation(Pads),
    /// Each drone on a pad of its own, anywhere.
    Anywhere {
        /// By the drones' numbers.
        pads_m: Vec<V2>,
        /// Where each fleet meets.
        centres_m: Vec<V2>,
    },
}

impl Bases {
    pub(super) fn new(
        input: &MissionInput,
        obstacles: &[Obstacle],
        region: &Region,
    ) -> Result<Self, RunError> {
        let table = &input.scenario.fleet;
        let Some(pads_m) = table.pads_m.as_deref() else {
            let base_m = table.base_m.map(V2::from);
            return Ok(Self::InFormation(Pads::new(base_m, table.pad_pitch_m(), region)));
        };
        let pads_m: Vec<V2> = pads_m.iter().copied().map(V2::from).collect();
        let (threes, _) = pads_m.as_chunks::<3>();
        let room = space::room(input, obstacles, &pads_m)?;
        let plan_m = table.passing_m();
        let centres_m = assemble::centres_m(&room, threes, table.spacing_m, plan_m, &[]).ok_or_else(|| {
            RunError::Infeasible(format!(
                "the airspace has no room for the triangles of {} fleets beside each other; a wider fence or \
                 fewer drones would do",
                threes.len()
            ))
        })?;
        Ok(Self::Anywhere { pads_m, centres_m })
    }

    /// Where a fleet begins in formation.
    pub(super) fn centre_m(&self, fleet: usize) -> V2 {
        match self {
            Self::InFormation(pads) => pads.centre_m(fleet),
            Self::Anywhere { centres_m, .. } => centres_m[fleet],
        }
    }
}

/// Who flies which lanes, and from where.
pub(super) struct Flights {
    pub(super) drones: Vec<PlannedDrone>,
    pub(super) fleets: Vec<PlannedFleet>,
    /// Drones that do not stand in formation: index, pad and slot.
    pub(super) assembled_m: Vec<(usize, V2, V2)>,
    pub(super) orientation_rad: f64,
}

impl Flights {
    pub(super) fn new(scenario: &Scenario, sweep: &SweepPlan, bases: &Bases) -> Self {
        let table = &scenario.fleet;
        let orientation_rad = orientation_rad(scenario, sweep);
        let mut fleets: Vec<PlannedFleet> = (0..scenario.fleets() as usize)
            .map(|f| {
                let mates = [1, 2, 3].map(|slot| DroneId((3 * f + slot) as u16));
                PlannedFleet::along(sweep, f, bases.centre_m(f), mates, f as u16)
            })
            .collect();
        let mut drones = Vec::new();
        let mut assembled_m = Vec::new();
        let mut stand = |pad: V2, fleet| {
            let id = DroneId(drones.len() as u16 + 1);
            drones.push(PlannedDrone { id, pad_m: pad.push(0.0), fleet });
        };
        for (f, fleet) in fleets.iter_mut().enumerate() {
            let slots_m = fleet.slots_m(heading(scenario), orientation_rad, table.spacing_m);
            let taken = match bases {
                Bases::InFormation(_) => {
                    (0u8..).zip(slots_m).for_each(|(slot, pad)| stand(pad, Some((f, slot))));
                    continue;
                }
                Bases::Anywhere { pads_m, .. } => {
                    let own_m = [0, 1, 2].map(|member| pads_m[3 * f + member]);
                    let taken = assemble::slots_taken(&own_m, &slots_m);
                    for (member, pad) in own_m.into_iter().enumerate() {
                        let slot = taken.iter().position(|&by| by == member).unwrap_or(member);
                        stand(pad, Some((f, slot as u8)));
                        assembled_m.push((3 * f + member, pad, slots_m[slot]));
                    }
                    taken
                }
            };
            fleet.mates = taken.map(|member| DroneId((3 * f + member + 1) as u16));
        }
        // Every reserve has a place of its own after the fleets.
        for reserve in 0..scenario.reserves() as usize {
            let pad = match bases {
                Bases::InFormation(pads) => pads.centre_m(fleets.len() + reserve),
                Bases::Anywhere { pads_m, .. } => pads_m[3 * fleets.len() + reserve],
            };
            stand(pad, None);
        }
        Self { drones, fleets, assembled_m, orientation_rad }
    }
}

/// Where slot 0 points: across the lanes; for a triangle that turns with the track, left of the track.
fn orientation_rad(scenario: &Scenario, sweep: &SweepPlan) -> f64 {
    match scenario.fleet.orientation {
        Orientation::Fixed => formation::fixed_orientation_rad(sweep.direction_rad),
        Orientation::AlongTrack => FRAC_PI_2,
    }
}
