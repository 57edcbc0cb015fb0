//! For tests: a control center in the simplest of worlds, and what a drone tells it.

use super::{
    ControlCenter,
    plan::{MissionPlan, PlannedDrone, Revisit},
};
use crate::{
    control::{airspace::Airspace, keys::LinkKeys, localize::LocalizeConfig, srs_schedule::SrsConfig},
    geometry::{V2, V3, polygon::Polygon},
};
use skyroost_protocol::{
    message::{ClockState, FlightPhase, Heading, TdoaCounts, Telemetry, Vertical},
    units::{DroneId, TimePs},
};

/// With so many drones and no fleet, above a square of 2 km, on open links that carry all; `change` is made to its plan.
pub(super) fn control(drones: u16, change: impl FnOnce(&mut MissionPlan)) -> ControlCenter {
    let corners = [[-1e3, -1e3], [1e3, -1e3], [1e3, 1e3], [-1e3, 1e3]].map(V2::from);
    let drone = |id| PlannedDrone { id: DroneId(id), pad_m: V3::zeros(), fleet: None };
    let mut plan = MissionPlan {
        drones: (1..=drones).map(drone).collect(),
        fleets: vec![],
        assembly: None,
        airspace: Airspace::new(vec![], Polygon::new(&corners).unwrap(), 100.0, 10.0).unwrap(),
        walls_mm: vec![],
        spacing_m: 50.0,
        heading: Heading::Fixed,
        orientation_rad: 0.0,
        speed_mps: 10.0,
        altitude_m: 100.0,
        radius_m: 500.0,
        d_safe_m: 10.0,
        d_plan_m: 14.5,
        min_goal_distance_m: 15.0,
        vertical: Vertical::default(),
        srs: SrsConfig::default(),
        localize: LocalizeConfig::default(),
        revisit: Revisit { r95_m: 200.0, most: 1 },
        relay_period: TimePs::from_ms(100),
        link_bytes_per_s: 0,
        resweep: None,
        origin: 0,
        keys: LinkKeys::none(),
        rekey_period: None,
    };
    change(&mut plan);
    ControlCenter::new(plan)
}

/// Of a drone that nothing is wrong with and that has no mission.
pub(super) fn telemetry(time: TimePs, phase: FlightPhase) -> Telemetry {
    Telemetry {
        time,
        phase,
        mission: None,
        sweep_phase_mm: 0,
        track_error_mm: 0,
        battery_permille: 900,
        conditions: 0,
        frames_lost: 0,
        frames_rejected: 0,
        dropped: 0,
        clock: ClockState::Free,
        tdoa: TdoaCounts::NONE,
    }
}
