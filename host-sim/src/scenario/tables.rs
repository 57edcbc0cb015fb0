//! The keys of a scenario and their defaults.

use serde::{Deserialize, Serialize};
use skyroost_protocol::message::Vertical;
use std::path::PathBuf;

/// A whole scenario. Lengths are in metres in the local east-north-up frame of the area.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scenario {
    /// Name in the results.
    pub name: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// Drones that break down.
    pub losses: Vec<LossTable>,
    /// What else goes wrong.
    pub faults: Vec<FaultTable>,
    /// When drones and control center do not hear each other.
    pub partitions: Vec<PartitionTable>,
    /// The area to sweep.
    pub area: AreaTable,
    /// What drones must not hit.
    pub obstacles: ObstaclesTable,
    /// What no drone leaves.
    pub fence: FenceTable,
    /// The drones and how they fly.
    pub fleet: FleetTable,
    /// Whom to find.
    pub users: UsersTable,
    /// Sounding reference signals (SRS): when users are asked and how well arrivals are captured.
    pub srs: SrsTable,
    /// The drones' capture clocks.
    pub clock: ClockTable,
    /// What the drones know of their own position.
    pub gnss: GnssTable,
    /// The wind.
    pub wind: WindTable,
    /// The links between control center and drones, and among drones.
    pub link: LinkTable,
    /// The drones' batteries.
    pub battery: BatteryTable,
    /// How long it may take.
    pub mission: MissionTable,
    /// What a good mission reaches; missed limits make the command exit with 1.
    pub limits: LimitsTable,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            name: "paper".to_owned(),
            seed: 1,
            losses: Vec::new(),
            faults: Vec::new(),
            partitions: Vec::new(),
            area: AreaTable::default(),
            obstacles: ObstaclesTable::default(),
            fence: FenceTable::default(),
            fleet: FleetTable::default(),
            users: UsersTable::default(),
            srs: SrsTable::default(),
            clock: ClockTable::default(),
            gnss: GnssTable::default(),
            wind: WindTable::default(),
            link: LinkTable::default(),
            battery: BatteryTable::default(),
            mission: MissionTable::default(),
            limits: LimitsTable::default(),
        }
    }
}

impl Scenario {
    /// Number of fleets of three: floor(m / 3). The paper's (1) prints m mod 3, which is the number
    /// of [`Scenario::reserves`].
    #[must_use]
    pub const fn fleets(&self) -> u32 {
        self.fleet.drones / 3
    }

    /// Drones left over from the fleets; they join in the second stage.
    #[must_use]
    pub const fn reserves(&self) -> u32 {
        self.fleet.drones % 3
    }
}

/// A drone that breaks down: its board goes dead, its motors stop, its links say nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossTable {
    /// Number of the drone, from 1.
    pub drone: u32,
    /// Simulated time from the start.
    pub at_s: f64,
}

/// Something that goes wrong for a while.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultTable {
    /// What.
    pub kind: FaultKind,
    /// Number of the drone that it happens to, from 1; none for the control center.
    #[serde(default)]
    pub drone: Option<u32>,
    /// Simulated time from the start.
    pub at_s: f64,
    /// For how long; how long a board or the control center takes to be back.
    #[serde(default = "a_second")]
    pub for_s: f64,
}

fn a_second() -> f64 {
    1.0
}

/// What can go wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The board of a drone starts anew and knows nothing; the autopilot holds the vehicle meanwhile.
    BoardReset,
    /// The capture clock of a drone jumps ahead by a tenth of a millisecond.
    ClockJump,
    /// The receiver of a drone captures nothing.
    CapturesStuck,
    /// The navigation solution of a drone is no number.
    NavigationNan,
    /// Somebody near a drone sends it, and in its name, frames that were recorded, forged, cut and damaged.
    Attack,
    /// The control center is killed, and started again with nothing but its journal.
    ControlKilled,
}

/// A time in which drones and the control center do not hear each other; fleet mates still do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartitionTable {
    /// Numbers of the drones, from 1; all where none is stated.
    #[serde(default)]
    pub drones: Vec<u32>,
    /// Simulated time from the start at which it begins.
    pub from_s: f64,
    /// When it ends.
    pub until_s: f64,
}

/// The area: a file, or a rectangle whose south-west corner is the local origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AreaTable {
    /// File with the polygon, relative to the scenario file.
    pub file: Option<PathBuf>,
    /// East-west side of the rectangle, without a file.
    pub width_m: f64,
    /// North-south side of the rectangle, without a file.
    pub height_m: f64,
}

impl Default for AreaTable {
    fn default() -> Self {
        Self { file: None, width_m: 10_000.0, height_m: 10_000.0 }
    }
}

/// What drones must not hit, beside the area's no-fly zones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObstaclesTable {
    /// File with buildings, masts and no-fly zones, relative to the scenario file.
    pub file: Option<PathBuf>,
    /// What ways keep from obstacles, the area's no-fly zones and the fence, and from the tops of obstacles.
    pub clearance_m: f64,
}

impl Default for ObstaclesTable {
    fn default() -> Self {
        Self { file: None, clearance_m: 10.0 }
    }
}

/// What no drone leaves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FenceTable {
    /// File with a convex polygon, relative to the scenario file.
    pub file: Option<PathBuf>,
    /// Without a file: from area, pads and lanes to the fence around them all.
    pub margin_m: f64,
}

impl Default for FenceTable {
    fn default() -> Self {
        Self { file: None, margin_m: 100.0 }
    }
}

/// What avoidance plans with beyond the separation and both error radii (`firmware::avoid`), metres.
const PASSING_ROOM_M: f64 = 3.0;

/// The drones and how they fly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FleetTable {
    /// Number of drones (the paper's m): fleets of three, the rest in reserve.
    pub drones: u32,
    /// Side of a fleet's triangle (the paper's d).
    pub spacing_m: f64,
    /// Coverage radius of a drone on the ground (the paper's `R_C`).
    pub radius_m: f64,
    /// Cruise speed (the paper's v).
    pub speed_mps: f64,
    /// Altitude of flight above the local origin.
    pub altitude_m: f64,
    /// How a fleet's triangle turns with the track.
    pub orientation: Orientation,
    /// Share of each fleet, summing to 1; equal shares without it.
    pub proportions: Option<Vec<f64>>,
    /// How the area is shared among the fleets.
    pub split: SplitMode,
    /// East and north of the first take-off pad; without it the area's corner furthest to the
    /// south-west (least east + north).
    pub base_m: Option<[f64; 2]>,
    /// Distance between the places where neighbouring fleets, or reserves, take off, each fleet in its
    /// triangle; three times `spacing_m` without it.
    pub pad_spacing_m: Option<f64>,
    /// East and north of each drone's own pad, instead of `base_m` and `pad_spacing_m`: the drones of a fleet (the
    /// first three, the next three and so on) may stand anywhere, and fly into formation before the sweep.
    pub pads_m: Option<Vec<[f64; 2]>>,
    /// Separation that is never to be broken (the paper's `d_safe`).
    pub d_safe_m: f64,
    /// Error radius of a shared position (the paper's `r_s`).
    pub r_s_m: f64,
    /// Largest acceleration.
    pub max_accel_mps2: f64,
    /// Whether drones give way up and down.
    pub vertical: Vertical,
    /// What the sweep leaves of the overlap region's radius to the formation's flying error.
    pub margin_m: f64,
}

impl Default for FleetTable {
    fn default() -> Self {
        Self {
            drones: 6,
            spacing_m: 50.0,
            radius_m: 500.0,
            speed_mps: 10.0,
            altitude_m: 300.0,
            orientation: Orientation::Fixed,
            proportions: None,
            split: SplitMode::Auto,
            base_m: None,
            pad_spacing_m: None,
            pads_m: None,
            d_safe_m: 10.0,
            r_s_m: 2.0,
            max_accel_mps2: 3.0,
            vertical: Vertical::default(),
            margin_m: 3.0,
        }
    }
}

impl FleetTable {
    /// Distance between neighbouring take-off places, metres.
    #[must_use]
    pub fn pad_pitch_m(&self) -> f64 {
        self.pad_spacing_m.unwrap_or(3.0 * self.spacing_m)
    }

    /// The distance that avoidance plans to pass others with, metres: drones that are farther apart do not give way.
    #[must_use]
    pub fn passing_m(&self) -> f64 {
        self.d_safe_m + 2.0 * self.r_s_m + PASSING_ROOM_M
    }
}

/// How a fleet's triangle turns with the track.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Orientation {
    /// It keeps its orientation, so that no drone flies a longer way in a turn.
    #[default]
    Fixed,
    /// It turns with the track.
    AlongTrack,
}

/// How the area is shared among the fleets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplitMode {
    /// Whichever of the other two is flown sooner.
    #[default]
    Auto,
    /// A convex sub-area of its own for each fleet (the paper's).
    Area,
    /// One zigzag over the whole area, cut by length.
    Length,
}

/// Whom to find: a file, or users strewn at random.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UsersTable {
    /// File with the users' true positions, relative to the scenario file.
    pub file: Option<PathBuf>,
    /// Mean number of users per square kilometre, without a file.
    pub density_per_km2: f64,
    /// Altitude of every user above the local origin.
    pub altitude_m: f64,
    /// Root mean square speed over ground of users on foot, who walk on from where they are at first; 0 for users that stay. The control
    /// center is told.
    pub speed_mps: f64,
    /// Time after which a user on foot has forgotten where it went.
    pub turn_s: f64,
    /// Users who matter to the placement and whose 95 % radius has grown beyond this when the lanes are flown are looked for again.
    pub revisit_r95_m: f64,
    /// How often at most.
    pub revisits: u16,
}

impl Default for UsersTable {
    fn default() -> Self {
        Self {
            file: None,
            density_per_km2: 5.0,
            altitude_m: 0.0,
            speed_mps: 0.0,
            turn_s: 60.0,
            revisit_r95_m: 200.0,
            revisits: 1,
        }
    }
}

/// SRS: when users are asked and how well arrivals are captured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SrsTable {
    /// Time between two requests to one user.
    pub period_s: f64,
    /// Standard deviation of a captured arrival time, of each symbol by itself.
    pub sigma_toa_ns: f64,
    /// Symbols that an SRS is repeated over: 1, 2 or 4 (TS 38.214 6.2.1). Each is captured by itself, and the drone
    /// averages them.
    pub symbols: u8,
    /// Ticks a second of the capture timer; 983.04 MHz is a tick of 2 T_c (TS 38.211 4.1).
    pub tick_hz: u64,
    /// Fraction of captures that are late because the direct path was blocked (NLOS).
    pub nlos_fraction: f64,
    /// Least lateness of such a capture.
    pub nlos_min_ns: f64,
    /// Greatest lateness of such a capture.
    pub nlos_max_ns: f64,
    /// Most requests that a fleet's serving drone makes in a second.
    pub max_per_second: u32,
    /// A user whose 95 % radius is no larger is not asked again; 0 asks everybody for as long as it is heard.
    pub enough_r95_m: f64,
}

impl Default for SrsTable {
    fn default() -> Self {
        Self {
            period_s: 1.0,
            sigma_toa_ns: 5.0,
            symbols: 1,
            tick_hz: 983_040_000,
            nlos_fraction: 0.05,
            nlos_min_ns: 100.0,
            nlos_max_ns: 1000.0,
            max_per_second: 100,
            enough_r95_m: 2.0,
        }
    }
}

/// The drones' capture clocks against GNSS time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockTable {
    /// Offsets at the start are drawn evenly from plus or minus this.
    pub offset_ns: f64,
    /// Drifts are drawn evenly from plus or minus this.
    pub drift_ns_per_s: f64,
    /// Random walk of the offset.
    pub walk_ns_per_sqrt_s: f64,
    /// Standard deviation of the pulse per second that disciplines the clocks; 0 for none, and clocks that run free.
    pub pps_sigma_ns: f64,
    /// Fraction of pulses that fail.
    pub pps_loss_fraction: f64,
    /// Fraction of pulses that come off by up to a millisecond.
    pub pps_outlier_fraction: f64,
}

impl Default for ClockTable {
    fn default() -> Self {
        Self {
            offset_ns: 200.0,
            drift_ns_per_s: 5.0,
            walk_ns_per_sqrt_s: 0.1,
            pps_sigma_ns: 0.0,
            pps_loss_fraction: 0.0,
            pps_outlier_fraction: 0.0,
        }
    }
}

/// What the drones know of their own position.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GnssTable {
    /// How the error behaves.
    pub mode: GnssMode,
    /// Standard deviation of each coordinate.
    pub sigma_m: f64,
}

impl Default for GnssTable {
    fn default() -> Self {
        Self { mode: GnssMode::Rtk, sigma_m: 0.02 }
    }
}

/// How the GNSS error behaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GnssMode {
    /// Carrier phase with corrections: centimetres, new at every fix.
    #[default]
    Rtk,
    /// Code phase alone: metres, constant over a pass.
    Standalone,
}

/// The wind: a mean and gusts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindTable {
    /// Mean speed.
    pub mean_mps: f64,
    /// Direction the mean wind blows from, clockwise from north.
    pub direction_deg: f64,
    /// Standard deviation of the gusts in each horizontal direction.
    pub gust_sigma_mps: f64,
    /// Time over which a gust persists (correlation time).
    pub gust_time_s: f64,
}

impl Default for WindTable {
    fn default() -> Self {
        Self { mean_mps: 3.0, direction_deg: 270.0, gust_sigma_mps: 1.0, gust_time_s: 10.0 }
    }
}

/// The links: control center to drone and back, and between drones of a fleet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LinkTable {
    /// Least delay of a frame.
    pub delay_s: f64,
    /// Further delay, drawn evenly from 0 to this.
    pub jitter_s: f64,
    /// Fraction of frames lost.
    pub loss_fraction: f64,
    /// Fraction of frames that arrive twice.
    pub duplicate_fraction: f64,
    /// Fraction of frames held back so that later ones overtake them.
    pub reorder_fraction: f64,
    /// Time between two states that a drone shares for collision avoidance.
    pub share_period_s: f64,
    /// Delay of a frame between drones of a fleet.
    pub peer_delay_s: f64,
    /// Mean time from one burst of loss to the next; none where it is not stated.
    pub burst_every_s: Option<f64>,
    /// Mean length of a burst, in which nothing arrives.
    pub burst_s: f64,
    /// Bits that a drone or, to each drone, the control center sends in a second at most, with what frames them on a byte link; any number
    /// where it is not stated. Both keep to it: what keeps drones apart goes first.
    pub bits_per_s: Option<f64>,
    /// Every so often the keys of the links are changed; never where it is not stated.
    pub rekey_s: Option<f64>,
}

impl LinkTable {
    /// [`bits_per_s`](Self::bits_per_s) in bytes; 0 for any number.
    #[must_use]
    pub fn bytes_per_s(&self) -> u32 {
        // A rate beyond 32 bits is no limit worth counting.
        self.bits_per_s.map_or(0, |bits_per_s| ((bits_per_s / 8.0) as u32).max(1))
    }
}

impl Default for LinkTable {
    fn default() -> Self {
        Self {
            delay_s: 0.08,
            jitter_s: 0.04,
            loss_fraction: 0.0,
            duplicate_fraction: 0.0,
            reorder_fraction: 0.0,
            share_period_s: 0.1,
            peer_delay_s: 0.02,
            burst_every_s: None,
            burst_s: 1.0,
            bits_per_s: None,
            rekey_s: Some(1_800.0),
        }
    }
}

/// The drones' batteries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BatteryTable {
    /// Time of flight on a full charge.
    pub endurance_s: f64,
    /// Charge of each drone's battery at the start, as a fraction; all full where none is stated.
    pub charges: Option<Vec<f64>>,
}

impl Default for BatteryTable {
    fn default() -> Self {
        Self { endurance_s: 21_600.0, charges: None }
    }
}

/// How long it may take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MissionTable {
    /// Time that the sweep may take (the paper's mission time, 100 minutes).
    pub time_s: f64,
    /// Simulated time at which the mission is cut off wherever it stands.
    pub duration_s: Option<f64>,
}

impl Default for MissionTable {
    fn default() -> Self {
        Self { time_s: 6000.0, duration_s: None }
    }
}

/// Acceptance limits; one that is not stated is not judged.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsTable {
    /// Least fraction of the area that the track flown covered.
    pub coverage_fraction_min: Option<f64>,
    /// Longest sweep.
    pub sweep_duration_max_s: Option<f64>,
    /// Least fraction of the users located.
    pub located_fraction_min: Option<f64>,
    /// Least fraction of the located users that truly lie within their `r95_m`.
    pub in_r95_fraction_min: Option<f64>,
    /// Greatest median of `r95_m`.
    pub r95_median_max_m: Option<f64>,
    /// Greatest error against the Cramer-Rao bound.
    pub crlb_ratio_max: Option<f64>,
    /// Least number of users served although their position is uncertain.
    pub served_guaranteed_min: Option<u32>,
    /// Most separations below `fleet.d_safe_m`.
    pub violations_max: Option<u32>,
    /// Least distance of a drone from obstacles and no-fly zones.
    pub obstacle_distance_min_m: Option<f64>,
    /// Least distance of a drone from the fence, from within.
    pub fence_distance_min_m: Option<f64>,
    /// Greatest root mean square of a drone's distance from its place in the formation.
    pub formation_error_rms_max_m: Option<f64>,
    /// Greatest distance of a drone from its place in the formation.
    pub formation_error_max_m: Option<f64>,
}
