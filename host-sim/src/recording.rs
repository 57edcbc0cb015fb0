//! What a mission leaves behind for the report, the tables and any later reading: plain data, metres
//! in the local east-north-up frame, seconds since the start of the mission.

use serde::Serialize;

/// Everything worth looking at of one flown mission.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Recording {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// Coverage radius of one drone (the paper's `R_C`), metres.
    pub radius_m: f64,
    /// Diameter of the disk that a fleet's overlap region is guaranteed to contain, metres.
    pub swath_m: f64,
    /// Borders of the area: rings that do not cross, outer ones anticlockwise, holes clockwise.
    pub area_m: Vec<Vec<[f64; 2]>>,
    /// Where no drone may fly: anticlockwise rings, which may overlap each other and the area's borders.
    pub no_fly_m: Vec<Vec<[f64; 2]>>,
    /// What no drone may leave: an anticlockwise ring.
    pub fence_m: Vec<[f64; 2]>,
    /// Longitude and latitude of the local origin, when the area came in WGS84.
    pub origin_lon_lat_deg: Option<[f64; 2]>,
    /// What each fleet was told to sweep.
    pub sub_areas: Vec<SubAreaRecord>,
    /// What the track flown left uncovered, as polygons.
    pub uncovered_m: Vec<Vec<[f64; 2]>>,
    /// The drones and the way they flew.
    pub drones: Vec<DroneRecord>,
    /// The users, true and estimated.
    pub users: Vec<UserRecord>,
    /// Where each drone was placed.
    pub placements: Vec<PlacementRecord>,
    /// Phases of the mission in time order: start of each and its name.
    pub phases: Vec<PhaseRecord>,
    /// Events in time order.
    pub events: Vec<EventRecord>,
}

/// One fleet's share of the sweep.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SubAreaRecord {
    /// The fleet, from 0.
    pub fleet: u16,
    /// The sub-area; none when fleets share one zigzag by length.
    pub polygon_m: Option<Vec<[f64; 2]>>,
    /// Lanes planned for the centre of the formation.
    pub path_m: Vec<[f64; 2]>,
}

/// One drone and its track.
#[derive(Clone, Debug, Default, Serialize)]
pub struct DroneRecord {
    /// The drone, from 1.
    pub id: u16,
    /// Its fleet; none for a reserve.
    pub fleet: Option<u16>,
    /// True positions, once a second.
    pub track: Vec<TrackSample>,
}

/// A true position.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct TrackSample {
    /// When.
    pub t_s: f64,
    /// East, north, up.
    pub pos_enu_m: [f64; 3],
}

/// One user, true and estimated.
#[derive(Clone, Debug, Default, Serialize)]
pub struct UserRecord {
    /// The user.
    pub id: String,
    /// True position.
    pub truth_m: [f64; 2],
    /// Estimate, where one is claimed.
    pub estimate_m: Option<[f64; 2]>,
    /// Covariance of the estimate.
    pub cov_m2: Option<[[f64; 2]; 2]>,
    /// Radius of the circle around the estimate that holds the user with 95 % probability.
    pub r95_m: Option<f64>,
    /// `ok`, `ambiguous`, `poor_geometry`, `inconsistent` or `not_located`.
    pub status: &'static str,
    /// SRS occasions used.
    pub occasions: u32,
    /// When the user was last heard in the sweep.
    pub heard_s: Option<f64>,
    /// Drone whose coverage disk holds the whole error disk, if any.
    pub served_guaranteed_by: Option<u16>,
    /// Drone that truly covers the user, if any.
    pub served_actual_by: Option<u16>,
}

/// One drone's placement.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct PlacementRecord {
    /// The drone.
    pub drone: u16,
    /// East, north.
    pub pos_m: [f64; 2],
    /// Users counted for it at the planning.
    pub covered: u32,
}

/// Start of a phase of the mission.
#[derive(Clone, Debug, Default, Serialize)]
pub struct PhaseRecord {
    /// When.
    pub t_s: f64,
    /// Its name, for people.
    pub name: String,
}

/// Something that happened.
#[derive(Clone, Debug, Default, Serialize)]
pub struct EventRecord {
    /// When.
    pub t_s: f64,
    /// The drone it happened to; none for the control center.
    pub drone: Option<u16>,
    /// What, for people.
    pub text: String,
}
