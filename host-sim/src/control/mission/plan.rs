//! What the control center is told before a mission: who flies, from where, along which lanes.

use crate::{
    control::{
        airspace::Airspace,
        assemble::{Assembly, slot_m},
        keys::LinkKeys,
        localize::LocalizeConfig,
        srs_schedule::SrsConfig,
        sweep::{SweepPlan, SweepRequest},
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
    /// Which users that walk are looked for again.
    pub revisit: Revisit,
    /// Every so often shared states are relayed.
    pub relay_period: TimePs,
    /// Bytes a second that can be said to each drone; 0 for any number.
    pub link_bytes_per_s: u32,
    /// What a sweep is planned from anew when drones fall out; none to go on as planned, whatever happens.
    pub resweep: Option<Resweep>,
    /// What the mission was planned from, as a number: tells missions apart whose plans are alike.
    pub origin: u64,
    /// What seals the links.
    pub keys: LinkKeys,
    /// Every so often the keys of the links are changed, if ever.
    pub rekey_period: Option<TimePs>,
}

/// Users that have walked on since they were located.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Revisit {
    /// Those are looked for again who matter to the placement and whose 95 % radius has grown beyond this when the lanes are flown, metres.
    pub r95_m: f64,
    /// How often at most.
    pub most: u16,
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

impl MissionPlan {
    /// Way of the fleet that flies farthest, metres.
    #[must_use]
    pub fn longest_m(&self) -> f64 {
        self.fleets.iter().map(PlannedFleet::length_m).fold(0.0, f64::max)
    }
}

impl PlannedFleet {
    /// The fleet of that number in a sweep, from where it gets into formation over its approach to its lanes.
    #[must_use]
    pub fn along(
        sweep: &SweepPlan,
        fleet: usize,
        centre_m: V2,
        mates: [DroneId; 3],
        clock_group: u16,
    ) -> Self {
        let own = || sweep.sub_areas.iter().filter(move |sub| sub.fleet == fleet);
        let mut waypoints_m = vec![centre_m];
        waypoints_m.extend(own().flat_map(|sub| &sub.approach_m));
        let transit = waypoints_m.len();
        waypoints_m.extend(own().flat_map(|sub| &sub.path_m));
        Self { mates, waypoints_m, clock_group, transit }
    }

    /// Its slots around the first waypoint as it sets out, in triangles of such a side.
    #[must_use]
    pub fn slots_m(&self, heading: Heading, orientation_rad: f64, spacing_m: f64) -> [V2; 3] {
        let centre_m = self.waypoints_m.first().copied().unwrap_or_default();
        let first_leg = self.waypoints_m.get(1).map_or(V2::x(), |next| next - centre_m);
        let turned = match heading {
            Heading::Fixed => orientation_rad,
            Heading::AlongTrack => orientation_rad + first_leg.y.atan2(first_leg.x),
        };
        [0, 1, 2].map(|slot| centre_m + slot_m(turned, slot, spacing_m))
    }

    /// All of its way in formation, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.waypoints_m.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum()
    }

    /// Way in formation to the first lane, metres.
    #[must_use]
    pub fn transit_m(&self) -> f64 {
        let to_lane = self.waypoints_m.get(..=self.transit).unwrap_or(&self.waypoints_m);
        to_lane.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }
}
