//! The figures of one flown mission: what `skyroost mission --json` prints and `summary.json` holds.
//!
//! Names and nesting are a contract with scripts. Figures that cannot be known (an error of users of
//! whom none was located) are `None` and print as `null`, never as a number that looks like one.
//! Only [`Timing::wall_s`] and [`Timing::realtime_factor`] may differ between two runs of the same
//! build, scenario and seed.

use super::limits::LimitOutcome;
use serde::Serialize;
use std::collections::BTreeMap;

/// The figures of one mission.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// Where the flight code ran: `inproc`, `qemu` or `serial`.
    pub backend: String,
    /// Number of drones.
    pub drones: u32,
    /// Number of fleets of three.
    pub fleets: u32,
    /// The first stage: the sweep.
    pub sweep: SweepSummary,
    /// What became of the arrival times that drones captured.
    pub srs: SrsSummary,
    /// What the sweep found of the users.
    pub localization: LocalizationSummary,
    /// The second stage: where the drones serve.
    pub placement: PlacementSummary,
    /// How the drones kept apart and together.
    pub safety: SafetySummary,
    /// Drones that the control center lost in the air and never heard again.
    pub lost: Vec<LostDrone>,
    /// What crossed the radio between drones and control center.
    pub link: LinkSummary,
    /// What became of the frames of a simulated attacker; none without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attack: Option<AttackSummary>,
    /// The boards that the flight code ran on, by drone; empty where it ran in this process.
    pub boards: Vec<BoardSummary>,
    /// How long it took.
    pub timing: Timing,
    /// Hash over every flight-code output of every drone, in time order, hexadecimal.
    pub digest: String,
    /// The acceptance limits of the scenario and whether they hold.
    pub limits: Vec<LimitOutcome>,
    /// What the reader should know besides.
    pub warnings: Vec<String>,
}

/// Frames that a simulated attacker put in: recorded, damaged, cut, or made up; and those of them that were not refused. Recorded hellos and
/// questions who somebody is are answered whoever says them, and count as put in only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct AttackSummary {
    /// Put in on the way to drones.
    pub injected_down: u64,
    /// Put in on the way to the control center.
    pub injected_up: u64,
    /// Not refused by drones.
    pub believed_down: u64,
    /// Not refused by the control center.
    pub believed_up: u64,
}

/// The sweep as flown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SweepSummary {
    /// How the area was shared: `area` or `length`.
    pub split: String,
    /// Fraction of the area that some fleet's overlap region passed over, by the true tracks.
    pub coverage_fraction: f64,
    /// From the common start of the lanes until the last fleet flew them, seconds.
    pub duration_s: f64,
    /// Length of each fleet's lanes, metres.
    pub length_m: Vec<f64>,
    /// Time that the scenario gives the sweep, seconds: the paper's mission time (Table 3). `duration_s` is
    /// held against it; climb and transit are in neither.
    pub mission_time_s: f64,
    /// Every time that the rest of it was planned anew, as drones fell out or came back, or users had gone.
    pub replans: Vec<ReplanSummary>,
}

/// A sweep planned anew under way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplanSummary {
    /// When all were told to stop, simulated seconds.
    pub at_s: f64,
    /// Numbers of the drones by whom their fleets were broken; empty where drones that came back made up another.
    pub broken_by: Vec<u16>,
    /// Users that were looked for again, as they had walked on.
    pub users_gone: u32,
    /// Fleets that flew on; 0 where too few drones were left for one.
    pub fleets: u32,
    /// Area that was left, square metres.
    pub left_m2: f64,
    /// By how much later the sweep is to end than planned before, seconds: what stopping, assembling and fewer fleets cost. None
    /// where it does not go on, or had not begun.
    pub delay_s: Option<f64>,
}

/// What became of arrival times, by the drones' own word, all together.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SrsSummary {
    /// Differences of arrival time formed.
    pub hits: u64,
    /// Differences not formed: the fleet mate's capture did not come in time.
    pub misses: u64,
    /// Captures of fleet mates dropped: the serving drone's own did not come in time.
    pub stale: u64,
    /// Captures dropped because they came twice.
    pub duplicates: u64,
    /// Occasions dropped for newer ones before they were reported.
    pub evicted: u64,
    /// Differences that no place of a user explains; the late capture behind each was left out.
    pub gated: u64,
    /// Differences that did not fit 32 bits and were left out.
    pub saturated: u64,
    /// Captures that the flight code refused or that did not agree with the others of their burst.
    pub refused: u64,
    /// Pulses per second off the grid of seconds.
    pub pulses_rejected: u64,
}

/// The users as located.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LocalizationSummary {
    /// Users in the area.
    pub users: u32,
    /// Users whose position is claimed (status `ok`).
    pub located: u32,
    /// Root mean square of the horizontal error of the located, metres.
    pub rmse_m: Option<f64>,
    /// Median of the 95 % radii of the located, metres.
    pub r95_median_m: Option<f64>,
    /// 95th percentile of the 95 % radii of the located, metres.
    pub r95_p95_m: Option<f64>,
    /// sqrt(mean(e' C^-1 e) / 2) with C the Cramer-Rao bound of the very measurements used: 1 is the
    /// best that any unbiased method can do.
    pub crlb_ratio: Option<f64>,
    /// Fraction of the located whose true position lies within their 95 % radius.
    pub in_r95_fraction: Option<f64>,
    /// Users by status.
    pub status_counts: BTreeMap<String, u32>,
}

/// The placement as planned and as it truly serves.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlacementSummary {
    /// How it was planned: `joint`, all drones together.
    pub method: String,
    /// Where each drone serves.
    pub drones: Vec<PlacedDrone>,
    /// Users whose whole error disk is covered (the paper's count).
    pub served_guaranteed: u32,
    /// Users whose true position is covered.
    pub served_actual: u32,
    /// No placement of these drones guarantees service to more users than this.
    pub upper_bound: u32,
    /// Whether `served_guaranteed` was proved to be the most that is possible.
    pub proved_optimal: bool,
    /// No placement that knew every true position would serve more users.
    pub optimum_on_truth: Option<u32>,
    /// `served_actual / optimum_on_truth`: the price of not knowing.
    pub served_ratio: Option<f64>,
}

/// A drone where it serves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PlacedDrone {
    /// The drone, from 1.
    pub id: u16,
    /// East, metres.
    pub x_m: f64,
    /// North, metres.
    pub y_m: f64,
}

/// How the drones kept apart and together, by their true positions.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SafetySummary {
    /// Least distance of two drones in flight, metres; none with fewer than two.
    pub min_separation_m: Option<f64>,
    /// Encounters of two drones nearer than the scenario's `d_safe_m`.
    pub violations: u32,
    /// Least distance of a drone from obstacles and no-fly zones, metres; none without any.
    pub min_obstacle_distance_m: Option<f64>,
    /// Least distance of a drone from the fence, metres: negative if it was left; none where nobody flew.
    pub min_fence_distance_m: Option<f64>,
    /// Root mean square of a drone's distance from its place in the formation on the lanes, outside of manoeuvres, metres.
    pub formation_error_rms_m: f64,
    /// Greatest such distance, metres.
    pub formation_error_max_m: f64,
    /// Manoeuvres: how long fleets on the lanes avoided somebody, or came back from that; of all fleets together.
    pub manoeuvres_s: f64,
}

/// A drone that fell silent in the air.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LostDrone {
    /// The drone, from 1.
    pub drone: u16,
    /// When the control center knew, simulated seconds.
    pub at_s: f64,
}

/// What crossed the radio between drones and control center.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LinkSummary {
    /// Frames sent, both ways.
    pub frames: u64,
    /// Bytes sent, both ways.
    pub bytes: u64,
    /// Frames that never arrived.
    pub lost: u64,
    /// Of the lost, those that found the transmitter's queue full.
    pub overflowed: u64,
    /// Frames that arrived and were refused by a decoder.
    pub rejected: u64,
    /// Frames that arrived and were not sealed with the key that they have to be sealed with.
    pub forged: u64,
    /// Whether links are sealed. Where they are not, whoever can send can command the drones.
    pub authenticated: bool,
    /// What drones say to the control center: the rate of the one that says most.
    pub up: RateSummary,
    /// What the control center says: the rate to the drone that it says most to.
    pub down: RateSummary,
    /// What drones say to their fleet mates: the rate of the one that says most.
    pub mates: RateSummary,
    /// Bytes that were heard of drones and said to them, by what they are for.
    pub bytes_for: BTreeMap<&'static str, u64>,
    /// What found no room on links of limited rate.
    pub held_back: HeldBackSummary,
}

/// The rate of a transmitter, with what frames its messages on a byte link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RateSummary {
    /// In the mean over the mission, bits a second.
    pub mean_bits_per_s: f64,
    /// In its busiest second, bits a second.
    pub most_bits_per_s: u64,
}

/// What found no room on links of limited rate. Nothing of it was lost on the radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct HeldBackSummary {
    /// Times that differences of arrival times or telemetry waited on board.
    pub frames_put_off: u64,
    /// Pages of users heard that drones dropped.
    pub pages_dropped: u64,
    /// Times that states of neighbours were relayed later than they were due.
    pub relays_put_off: u64,
    /// Times that only the nearest neighbours' states were relayed.
    pub relays_cut: u64,
    /// Times that pieces of lanes waited.
    pub lanes_put_off: u64,
    /// Requests for SRS that were not said.
    pub requests_dropped: u64,
    /// Copies of such requests that were not said.
    pub copies_dropped: u64,
}

/// A board of its own that one drone's flight code ran on.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BoardSummary {
    /// The drone, from 1.
    pub id: u16,
    /// Steps of the flight code.
    pub steps: u32,
    /// Instructions of a step in the mean, of the flight code alone; where they are counted.
    pub step_instructions_mean: Option<f64>,
    /// Most instructions of a step.
    pub step_instructions_worst: Option<u64>,
    /// Instructions of all steps.
    pub step_instructions_sum: Option<u64>,
    /// Most bytes of stack ever in use, where that is measured.
    pub stack_used_bytes: Option<u32>,
    /// Frames of the bus that reached the board damaged; each was sent again.
    pub bus_damaged: u32,
    /// Frames of the radio that reached the board damaged.
    pub radio_damaged: u32,
    /// Frames, captures or users that the inputs of a step had no room for.
    pub inputs_overflowed: u32,
    /// How punctual the board was, where it runs in real time.
    pub punctuality: Option<PunctualitySummary>,
}

/// How punctual a board in real time was. Differs from run to run, as clocks on the wall do.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PunctualitySummary {
    /// Steps whose answer was not there when the next one was due.
    pub missed_deadlines: u32,
    /// Longest time from when a step was due to its answer, seconds.
    pub worst_answer_wall_s: f64,
    /// Frames of the bus that came damaged, either way.
    pub damaged: u64,
    /// Requests that had to be sent again.
    pub resent: u64,
}

/// How long it took.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Simulated time, seconds.
    pub simulated_s: f64,
    /// Real time, seconds.
    pub wall_s: f64,
    /// `simulated_s / wall_s`.
    pub realtime_factor: f64,
}

impl Timing {
    /// From simulated and real seconds.
    #[must_use]
    pub fn new(simulated_s: f64, wall_s: f64) -> Self {
        let realtime_factor = if wall_s > 0.0 { simulated_s / wall_s } else { 0.0 };
        Self { simulated_s, wall_s, realtime_factor }
    }
}

impl Summary {
    /// The figures as one JSON object, for `--json` and `summary.json`. Floats are written in the
    /// shortest form that reads back to the same number, so equal figures are equal bytes.
    ///
    /// # Panics
    /// Never: all keys are strings.
    #[must_use]
    pub fn to_json(&self) -> String {
        let mut json = serde_json::to_string_pretty(self).expect("a summary has only string keys");
        json.push('\n');
        json
    }

    /// Whether every acceptance limit holds.
    #[must_use]
    pub fn accepted(&self) -> bool {
        self.limits.iter().all(|limit| limit.ok)
    }
}
