//! What the control center is told before a mission: who flies, from where, along which lanes.

use crate::{
    control::{
        airspace::Airspace, assemble::Assembly, keys::LinkKeys, localize::LocalizeConfig,
        srs_schedule::SrsConfig, sweep::SweepRequest,
    },
    geometry::{V2, V3, region::Region},
};
use skyroost_protocol::{
    message::{Heading, Vertical},
    units::{DroneId, TimePs},
};

/// A mission to fly.
#[derive(Clone, Debug)]
pub struct MissionPlan {
    /// All drones; those of a fleet and the reserves.
    pub drones: Vec<PlannedDrone>,
    /// The fleets with their lanes.
    pub fleets: Vec<PlannedFleet>,
    /// How the fleets get into formation; none where they stand in it on the ground.
    pub assembly: Option<Assembly>,
    /// Where drones may be, and the ways there.
    pub airspace: Airspace,
    /// The walls that every drone holds, as waypoints of its mission.
    pub walls_mm: Vec<[i32; 2]>,
    /// Side of the triangle (the paper's `d`), metres.
    pub spacing_m: f64,
    /// How the triangle turns.
    pub heading: Heading,
    /// Direction of slot 0 from the triangle's centre, radians from east.
    pub orientation_rad: f64,
    /// Cruise speed, metres a second.
    pub speed_mps: f64,
    /// Altitude of flight, metres.
    pub altitude_m: f64,
    /// Coverage radius (the paper's `R_C`), metres.
    pub radius_m: f64,
    /// Separation of true centres (the paper's `d_safe`), metres.
    pub d_safe_m: f64,
    /// What avoidance plans with: goals that are nearer to each other cannot both be held, metres.
    pub d_plan_m: f64,
    /// Least distance of two placements, some more than `d_plan_m`, metres.
    pub min_goal_distance_m: f64,
    /// Whether drones give way up and down.
    pub vertical: Vertical,
    /// How often users are asked.
    pub srs: SrsConfig,
    /// How users are located.
    pub localize: LocalizeConfig,
    /// Every so often shared states are relayed.
    pub relay_period: TimePs,
    /// What a sweep is planned from anew when drones fall out; none to go on as planned, whatever happens.
    pub resweep: Option<Resweep>,
    /// What the mission was planned from, as a number: tells missions apart whose plans are alike.
    pub origin: u64,
    /// What seals the links.
    pub keys: LinkKeys,
    /// Every so often the keys of the links are changed, if ever.
    pub rekey_period: Option<TimePs>,
}

/// What the rest of a sweep is planned from.
#[derive(Clone, Debug)]
pub struct Resweep {
    /// All that is to be covered, and what is flown around.
    pub region: Region,
    /// How; fleets, proportions and entry points are those of the first plan.
    pub request: SweepRequest,
    /// Where fleets may meet: the airspace less the room of a triangle.
    pub room: Airspace,
    /// Distance that drones keep on ways that cross, metres.
    pub passing_m: f64,
}

/// A drone of the mission.
#[derive(Clone, Copy, Debug)]
pub struct PlannedDrone {
    /// Who.
    pub id: DroneId,
    /// Where it stands.
    pub pad_m: V3,
    /// Index of its fleet and its slot; none for a reserve.
    pub fleet: Option<(usize, u8)>,
}

/// A fleet of the mission.
#[derive(Clone, Debug)]
pub struct PlannedFleet {
    /// Its drones by slot.
    pub mates: [DroneId; 3],
    /// Lanes of the triangle's centre, transit included.
    pub waypoints_m: Vec<V2>,
    /// The clocks that its arrival times are measured by: its own, and never another three's.
    pub clock_group: u16,
    /// Waypoints before the first lane: where it begins in formation, and corners on the way around no-fly zones.
    pub transit: usize,
}

impl PlannedFleet {
    /// Way in formation to the first lane, metres.
    #[must_use]
    pub fn transit_m(&self) -> f64 {
        let to_lane = self.waypoints_m.get(..=self.transit).unwrap_or(&self.waypoints_m);
        to_lane.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }
}
