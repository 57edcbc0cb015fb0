//! From a scenario to a mission plan and a world to fly it in.

use super::{
    InputError, MissionInput, MissionKeys, RunError,
    drone::{Drone, Parts},
    faults::DroneFaults,
    flights::{Bases, Flights},
    formation,
    island::{Island, Surroundings},
    space,
    watch::FleetWatch,
};
use crate::{
    control::{
        airspace::{self, Airspace},
        assemble,
        keys::LinkKeys,
        localize::{ClockModel, LocalizeConfig, Motion},
        mission::plan::{MissionPlan, PlannedDrone, PlannedFleet, Resweep, Revisit},
        srs_schedule::SrsConfig,
        sweep::{self, SubArea, SweepPlan, SweepRequest},
    },
    fleet::{BoardError, Hangar},
    geometry::{V2, V3, region::Region},
    rng::{self, Stream},
    scenario::{ClockTable, GnssMode, Orientation, Scenario, SplitMode, UsersTable},
    world::{
        battery::{Battery, BatteryConfig},
        channel::{Channel, ChannelConfig},
        clock::{Clock, ClockConfig},
        gnss::{Gnss, GnssConfig},
        grid::PointGrid,
        link::{AdversityConfig, Link, LinkConfig},
        pps::{Pps, PpsConfig},
        users::{User, poisson_users},
        vehicle::{Vehicle, VehicleConfig},
        walkers::{STRIDE_S, Walkers},
        wind::{Wind, WindConfig},
    },
};
use rand_core::Rng;
use skyroost_firmware::{
    STEP_S,
    avoid::TRACKING_M,
    config::{AgentConfig, SupervisorConfig},
    guidance::{formation::Slot, lanes::Lanes},
    srs::{clock::TickRate, discipline::Oscillator},
};
use skyroost_protocol::{
    codec::MAX_FRAME,
    key::{KEY_LEN, Key},
    message::{Heading, MAX_WAYPOINTS},
    units::{DroneId, TimePs},
};
use std::f64::consts::SQRT_2;
use xxhash_rust::xxh3::xxh3_64;

/// Climb to the altitude of flight, metres a second.
const CLIMB_MPS: f64 = 2.5;
/// Placements are this much farther apart than avoidance plans with, metres.
const GOAL_SLACK_M: f64 = 0.5;

/// Everything ready to fly.
pub(super) struct Setup {
    pub(super) sweep: SweepPlan,
    pub(super) plan: MissionPlan,
    pub(super) users: Vec<User>,
    pub(super) region: Region,
}

impl Setup {
    /// Plans the mission.
    pub(super) fn new(input: &MissionInput) -> Result<Self, RunError> {
        let scenario = &input.scenario;
        let obstacles = space::obstacles(input);
        let region = space::region(input)?;
        let users = match &input.users {
            Some(users) => users.clone(),
            None => {
                let [low, high] = region.bbox_m();
                let density = scenario.users.density_per_km2;
                poisson_users(density, (low, high), |p| region.contains(p), scenario.seed)
                    .map_err(InputError::from)?
            }
        };
        let bases = Bases::new(input, &obstacles, &region)?;
        let (altitude_m, clearance_m) = (scenario.fleet.altitude_m, scenario.obstacles.clearance_m);
        let flown = region.around(airspace::zones(&obstacles, altitude_m, clearance_m));
        let sweep = sweep::plan(&flown, &request(scenario, &bases))
            .map_err(|source| InputError::Sweep { area: input.area.name.clone(), source })?;
        let flights = Flights::new(scenario, &sweep, &bases);
        let airspace = space::airspace(input, obstacles, &flights)?;
        let walls_mm = space::walls(&airspace, &flights)?;
        let resweep = space::meeting_room(scenario, &airspace).map(|room| Resweep {
            region: flown,
            request: request(scenario, &bases),
            room,
            passing_m: scenario.fleet.passing_m(),
        });
        let keys = link_keys(input, flights.drones.len());
        let plan = MissionPlan { resweep, ..mission_plan(scenario, flights, airspace, walls_mm, keys) };
        check_lanes(&sweep, &plan)?;
        check_endurance(scenario, &sweep, &plan)?;
        Ok(Self { sweep, plan, users, region })
    }

    /// Groups of drones that have direct links: a fleet, or a reserve alone.
    pub(super) fn islands(&self) -> usize {
        self.plan.fleets.len() + self.plan.drones.iter().filter(|drone| drone.fleet.is_none()).count()
    }
}

fn request(scenario: &Scenario, bases: &Bases) -> SweepRequest {
    let fleet = &scenario.fleet;
    let fleets = scenario.fleets() as usize;
    SweepRequest {
        fleets,
        proportions: fleet.proportions.clone().unwrap_or_else(|| by_endurance(scenario, fleets)),
        split: match fleet.split {
            SplitMode::Auto => sweep::SplitMode::Auto,
            SplitMode::Area => sweep::SplitMode::Area,
            SplitMode::Length => sweep::SplitMode::Length,
        },
        radius_m: fleet.radius_m,
        spacing_m: fleet.spacing_m,
        speed_mps: fleet.speed_mps,
        corner: formation::corners(fleet.speed_mps),
        margin_m: fleet.margin_m,
        entry_m: Some((0..fleets).map(|f| bases.centre_m(f)).collect()),
    }
}

/// Charge of a drone's battery at the start, as a fraction.
fn charge(scenario: &Scenario, drone: DroneId) -> f64 {
    let charges = scenario.battery.charges.as_ref();
    charges.and_then(|charges| charges.get(usize::from(drone.0) - 1)).copied().unwrap_or(1.0)
}

/// Charge that a fleet can spend before the first of its drones has to return, as a fraction.
fn usable(scenario: &Scenario, fleet: usize) -> f64 {
    let low = f64::from(SupervisorConfig::default().battery_low_permille) * 1e-3;
    let members = (1..=3).map(|slot| DroneId((3 * fleet + slot) as u16));
    members.map(|drone| charge(scenario, drone) - low).fold(f64::INFINITY, f64::min).max(0.0)
}

/// The paper's p_i: what each fleet can fly, of what all can.
fn by_endurance(scenario: &Scenario, fleets: usize) -> Vec<f64> {
    let usable: Vec<f64> = (0..fleets).map(|fleet| usable(scenario, fleet)).collect();
    let sum: f64 = usable.iter().sum();
    // Where nobody can fly, or all as far, there is nothing to weigh.
    let alike = usable.iter().all(|one| one.to_bits() == usable[0].to_bits());
    if alike || sum <= 0.0 {
        return vec![1.0 / fleets as f64; fleets];
    }
    usable.iter().map(|one| one / sum).collect()
}

/// Refuses lanes that say too little about users, or that no drone has room for.
fn check_lanes(sweep: &SweepPlan, plan: &MissionPlan) -> Result<(), RunError> {
    for (sub, fleet) in sweep.sub_areas.iter().zip(&plan.fleets) {
        let (number, found) = (sub.fleet + 1, fleet.waypoints_m.len());
        // A fleet that moves by less than its own size hears users from one side only.
        if sub.length_m < plan.spacing_m {
            return Err(RunError::Infeasible(format!(
                "fleet {number} covers its part of the area from lanes of {:.0} m, and locating takes at least \
                 its spacing of {:.0} m; fewer fleets or a larger area would do",
                sub.length_m, plan.spacing_m
            )));
        }
        if found > MAX_WAYPOINTS {
            return Err(RunError::Infeasible(format!(
                "the lanes of fleet {number} have {found} waypoints, and a drone holds {MAX_WAYPOINTS}; more \
                 fleets, or an area with fewer corners and zones, would do"
            )));
        }
    }
    Ok(())
}

/// Refuses a mission that the batteries do not last for: climb, transit and sweep on the charge that
/// the supervisor allows, at cruise.
fn check_endurance(scenario: &Scenario, sweep: &SweepPlan, plan: &MissionPlan) -> Result<(), RunError> {
    let battery = BatteryConfig::default();
    let usable_s = |fleet: usize| {
        let full_s = scenario.battery.endurance_s * (1.0 - battery.spread_fraction) / battery.cruise_draw;
        full_s * usable(scenario, fleet)
    };
    let assembly_s = plan.assembly.as_ref().map_or(0.0, |assembly| {
        2.0 * assembly.height_m() / CLIMB_MPS + assembly.longest_m() / plan.speed_mps
    });
    let needed_s = |sub: &SubArea| {
        let transit_m = plan.fleets[sub.fleet].transit_m();
        plan.altitude_m / CLIMB_MPS + assembly_s + transit_m / plan.speed_mps + sub.duration_s
    };
    let spare_s = |sub: &&SubArea| usable_s(sub.fleet) - needed_s(sub);
    let Some(worst) = sweep.sub_areas.iter().min_by(|a, b| spare_s(a).total_cmp(&spare_s(b))) else {
        return Ok(());
    };
    if spare_s(&worst) >= 0.0 {
        return Ok(());
    }
    let (longest_s, usable_s) = (needed_s(worst), usable_s(worst.fleet));
    Err(RunError::Infeasible(format!(
        "the sweep takes {longest_s:.0} s with climb and transit, and the batteries last {usable_s:.0} s \
         (battery.endurance_s less the reserve to return); more drones or a longer endurance would do"
    )))
}

pub(super) fn heading(scenario: &Scenario) -> Heading {
    match scenario.fleet.orientation {
        Orientation::Fixed => Heading::Fixed,
        Orientation::AlongTrack => Heading::AlongTrack,
    }
}

fn mission_plan(
    scenario: &Scenario,
    flights: Flights,
    airspace: Airspace,
    walls_mm: Vec<[i32; 2]>,
    keys: LinkKeys,
) -> MissionPlan {
    let table = &scenario.fleet;
    let Flights { drones, fleets, assembled_m, orientation_rad } = flights;
    let gnss = gnss(scenario);
    let d_plan_m = table.d_safe_m + 2.0 * table.r_s_m + f64::from(TRACKING_M);
    let assembly = (!assembled_m.is_empty())
        .then(|| assemble::assembly(&airspace, &assembled_m, table.altitude_m, table.passing_m()));
    MissionPlan {
        drones,
        fleets,
        assembly,
        airspace,
        walls_mm,
        spacing_m: table.spacing_m,
        heading: heading(scenario),
        orientation_rad,
        speed_mps: table.speed_mps,
        altitude_m: table.altitude_m,
        radius_m: table.radius_m,
        d_safe_m: table.d_safe_m,
        d_plan_m,
        min_goal_distance_m: d_plan_m + GOAL_SLACK_M,
        vertical: table.vertical,
        srs: SrsConfig {
            period: TimePs((scenario.srs.period_s * 1e12) as i64),
            max_per_period: (f64::from(scenario.srs.max_per_second) * scenario.srs.period_s) as usize,
            enough_r95_m: scenario.srs.enough_r95_m,
        },
        localize: LocalizeConfig {
            // Of the mean of all symbols; the tick's own noise remains.
            sigma_toa_ns: (scenario.srs.sigma_toa_ns / f64::from(scenario.srs.symbols).sqrt()).max(0.3),
            clock: clock_model(&scenario.clock),
            user_altitude_m: scenario.users.altitude_m,
            drone_pos_sigma_m: (gnss.sigma_m * gnss.white_fraction.sqrt()).max(0.001),
            drone_bias_sigma_m: gnss.sigma_m * (1.0 - gnss.white_fraction).sqrt(),
            expected_radius_m: table.radius_m - table.spacing_m / 3f64.sqrt(),
            motion: Motion { speed_mps: scenario.users.speed_mps, turn_s: scenario.users.turn_s },
            ..LocalizeConfig::default()
        },
        revisit: Revisit { r95_m: scenario.users.revisit_r95_m, most: scenario.users.revisits },
        relay_period: TimePs((scenario.link.share_period_s * 1e12) as i64),
        link_bytes_per_s: scenario.link.bytes_per_s(),
        resweep: None,
        origin: origin(scenario),
        keys,
        rekey_period: scenario.link.rekey_s.map(|period_s| TimePs((period_s * 1e12) as i64)),
    }
}

/// A scenario as a number, wherever it is cut off.
fn origin(scenario: &Scenario) -> u64 {
    let mut scenario = scenario.clone();
    scenario.mission.duration_s = None;
    xxh3_64(format!("{scenario:?}").as_bytes())
}

/// What seals the links of so many drones.
fn link_keys(input: &MissionInput, drones: usize) -> LinkKeys {
    match &input.keys {
        MissionKeys::Simulated => simulated_keys(input.scenario.seed, drones),
        MissionKeys::Given(keys) => LinkKeys::clone(keys),
        MissionKeys::Unauthenticated => LinkKeys::none(),
    }
}

/// Keys that follow from the seed, as everything in a simulation does.
pub(super) fn simulated_keys(seed: u64, drones: usize) -> LinkKeys {
    let key = |index| {
        let mut bytes = [0; KEY_LEN];
        rng::stream(seed, Stream::Keys, index).fill_bytes(&mut bytes);
        Key::new(bytes)
    };
    // The control center's own chance has the number that no drone has.
    LinkKeys::new((1..=drones as u64).map(key).collect(), 1, &key(0))
}

/// What is unknown about the clocks that arrivals are read off.
fn clock_model(clock: &ClockTable) -> ClockModel {
    if clock.pps_sigma_ns <= 0.0 {
        return ClockModel::SharedWander {
            // The drawing limits as standard deviations: wider than the uniform's a / sqrt(3), on purpose.
            offset_sigma_ns: clock.offset_ns.max(1.0),
            drift_sigma_ns_per_s: clock.drift_ns_per_s.max(0.01),
            walk_ns_per_sqrt_s: clock.walk_ns_per_sqrt_s.max(1e-3),
        };
    }
    // What the discipline leaves: in its steady state the square root of walk times pulse noise, and before that a
    // least-squares line's 2 sigma / sqrt(n) after n pulses; some 100 by the first occasion.
    let (walk, pulse) = (clock.walk_ns_per_sqrt_s, clock.pps_sigma_ns);
    ClockModel::SharedWander {
        offset_sigma_ns: (walk * pulse).sqrt().hypot(0.2 * pulse).max(0.1),
        // Estimated on board.
        drift_sigma_ns_per_s: 0.01,
        // The discipline follows the walk by steps as large as its own; before the steady state its variance falls by
        // 4 sigma^2 / n^2 a second, some 250 pulses into the mission on the lanes.
        walk_ns_per_sqrt_s: (walk * SQRT_2).hypot(2.0 * pulse / 250.0).max(1e-3),
    }
}

/// The watches over the fleets of a plan.
pub(super) fn fleet_watches(plan: &MissionPlan) -> Vec<FleetWatch> {
    let watch = |fleet: &PlannedFleet| {
        let mm: Vec<[i32; 2]> = fleet
            .waypoints_m
            .iter()
            .map(|p| [(p.x * 1e3).round() as i32, (p.y * 1e3).round() as i32])
            .collect();
        let lanes = Lanes::new(&mm, plan.speed_mps as f32, f32::INFINITY).expect("a plan has lanes");
        let transit_m = fleet.transit_m();
        let slots = [0, 1, 2]
            .map(|slot| Slot::new(slot, plan.spacing_m as f32, plan.orientation_rad as f32, plan.heading));
        FleetWatch::new(lanes, (transit_m * 1e6) as i64, slots, plan.altitude_m, plan.radius_m)
    };
    plan.fleets.iter().map(watch).collect()
}

/// The receivers of all drones.
fn gnss(scenario: &Scenario) -> GnssConfig {
    let mode = match scenario.gnss.mode {
        GnssMode::Rtk => GnssConfig::rtk(),
        GnssMode::Standalone => GnssConfig::standalone(),
    };
    GnssConfig {
        sigma_m: scenario.gnss.sigma_m,
        sigma_up_m: 1.5 * scenario.gnss.sigma_m,
        error_bound_m: scenario.fleet.r_s_m,
        ..mode
    }
}

/// What all drones fly in.
pub(super) fn surroundings(scenario: &Scenario, users: &[User]) -> Surroundings {
    let srs = &scenario.srs;
    let channel = ChannelConfig {
        radius_m: scenario.fleet.radius_m,
        toa_sigma_ns: srs.sigma_toa_ns,
        symbols: srs.symbols,
        nlos_probability: srs.nlos_fraction,
        nlos_min_ns: srs.nlos_min_ns,
        nlos_max_ns: srs.nlos_max_ns,
        ..ChannelConfig::default()
    };
    let plane_m: Vec<V2> = users.iter().map(|u| u.pos_m).collect();
    Surroundings {
        channel: Channel::new(channel, scenario.seed),
        users: PointGrid::new(&plane_m, scenario.fleet.radius_m),
        user_pos_m: plane_m.iter().map(|p| p.push(scenario.users.altitude_m)).collect(),
        user_vel_mps: Vec::new(),
        at: TimePs(0),
    }
}

/// Users on foot; none where all stay.
pub(super) fn walkers(scenario: &Scenario, users: &[User]) -> Option<Walkers> {
    let UsersTable { speed_mps, turn_s, .. } = scenario.users;
    let pos_m = || users.iter().map(|user| user.pos_m).collect();
    (speed_mps > 0.0).then(|| Walkers::new(pos_m(), speed_mps, turn_s, scenario.seed))
}

/// What drones fly in once users have gone on, at `at`.
pub(super) fn walked(around: &Surroundings, walkers: &Walkers, at: TimePs, radius_m: f64) -> Surroundings {
    let altitudes_m = around.user_pos_m.iter().map(|pos| pos.z);
    Surroundings {
        channel: around.channel.clone(),
        users: PointGrid::new(walkers.pos_m(), radius_m),
        user_pos_m: walkers.pos_m().iter().zip(altitudes_m).map(|(at, z)| at.push(z)).collect(),
        user_vel_mps: walkers.stride_m().iter().map(|stride| (stride / STRIDE_S).push(0.0)).collect(),
        at,
    }
}

/// The drones on their pads: one island for each fleet and one for each reserve.
pub(super) fn islands(
    scenario: &Scenario,
    drones: &[PlannedDrone],
    fleets: usize,
    keys: &LinkKeys,
    hangar: &Hangar,
) -> Result<Vec<Island>, BoardError> {
    let members = members(drones, fleets);
    let of = |id: &DroneId| &drones[usize::from(id.0) - 1];
    let mut islands = Vec::with_capacity(members.len());
    for ids in members {
        let own = ids.iter().map(|id| drone(scenario, of(id), keys, hangar));
        let own = own.collect::<Result<_, _>>()?;
        let pairs = ids.iter().flat_map(|from| ids.iter().map(move |to| (*from, *to)));
        let links = pairs.map(|(from, to)| peer_link(scenario, drones.len(), from, to)).collect();
        islands.push(Island::new(own, links));
    }
    Ok(islands)
}

/// The same drones by the fleets of a later plan.
pub(super) fn regrouped(scenario: &Scenario, plan: &MissionPlan, islands: Vec<Island>) -> Vec<Island> {
    let members = members(&plan.drones, plan.fleets.len());
    let count = plan.drones.len();
    Island::regrouped(islands, &members, |from, to| peer_link(scenario, count, from, to))
}

/// Who talks to whom directly: each fleet, and each of the others alone.
fn members(drones: &[PlannedDrone], fleets: usize) -> Vec<Vec<DroneId>> {
    let mut members: Vec<Vec<DroneId>> = vec![Vec::new(); fleets];
    for planned in drones {
        match planned.fleet {
            Some((fleet, _)) => members[fleet].push(planned.id),
            None => members.push(vec![planned.id]),
        }
    }
    members
}

/// The link between two fleet mates.
fn peer_link(scenario: &Scenario, drones: usize, from: DroneId, to: DroneId) -> Link<MAX_FRAME> {
    let config = LinkConfig {
        min_delay_us: (scenario.link.peer_delay_s * 1e6) as u64,
        jitter_us: 0,
        ..link_config(scenario)
    };
    let [from, to] = [from, to].map(|id| usize::from(id.0) - 1);
    let pair = (from * drones + to) as u64;
    Link::new(config, scenario.seed, Stream::LinkPeer, pair).with(&weather(scenario))
}

fn link_config(scenario: &Scenario) -> LinkConfig {
    let link = &scenario.link;
    LinkConfig {
        min_delay_us: (link.delay_s * 1e6) as u64,
        jitter_us: (link.jitter_s * 1e6) as u64,
        loss: link.loss_fraction,
        duplication: link.duplicate_fraction,
        reordering: link.reorder_fraction,
        ..LinkConfig::default()
    }
}

/// What comes over the links between a drone and the control center.
fn adversity(scenario: &Scenario, drone: u32) -> AdversityConfig {
    let us = |s: f64| 1e6 * s;
    let of_drone = scenario.partitions.iter().filter(|it| it.drones.is_empty() || it.drones.contains(&drone));
    AdversityConfig {
        partitions_us: of_drone.map(|it| (us(it.from_s) as u64, us(it.until_s) as u64)).collect(),
        ..weather(scenario)
    }
}

/// What comes over any link: bursts, and the rate of its transmitter.
fn weather(scenario: &Scenario) -> AdversityConfig {
    let link = &scenario.link;
    AdversityConfig {
        burst_every_us: 1e6 * link.burst_every_s.unwrap_or_default(),
        burst_us: 1e6 * link.burst_s,
        bits_per_s: link.bits_per_s.unwrap_or_default(),
        ..AdversityConfig::default()
    }
}

/// The longest that a frame takes which is not held up, seconds.
pub(super) fn link_delay_s(scenario: &Scenario) -> f64 {
    scenario.link.delay_s + scenario.link.jitter_s
}

fn drone(
    scenario: &Scenario,
    planned: &PlannedDrone,
    keys: &LinkKeys,
    hangar: &Hangar,
) -> Result<Drone, BoardError> {
    let (seed, index) = (scenario.seed, u64::from(planned.id.0));
    let number = u32::from(planned.id.0);
    let dt_s = f64::from(STEP_S);
    let wind = WindConfig {
        mean_mps: scenario.wind.mean_mps,
        // A bearing that the wind comes from, clockwise from north, to the angle it blows to from east.
        towards_rad: -(scenario.wind.direction_deg + 90.0).to_radians(),
        gust_sigma_mps: scenario.wind.gust_sigma_mps,
        gust_sigma_up_mps: 0.5 * scenario.wind.gust_sigma_mps,
        gust_tau_s: scenario.wind.gust_time_s,
        ..WindConfig::default()
    };
    let gnss = gnss(scenario);
    let clock = ClockConfig {
        offset_ns: scenario.clock.offset_ns,
        drift_ns_per_s: scenario.clock.drift_ns_per_s,
        walk_ns_per_sqrt_s: scenario.clock.walk_ns_per_sqrt_s,
    };
    let pps = PpsConfig {
        sigma_ns: scenario.clock.pps_sigma_ns,
        loss: scenario.clock.pps_loss_fraction,
        outlier: scenario.clock.pps_outlier_fraction,
    };
    let vehicle = VehicleConfig {
        max_speed_mps: scenario.fleet.speed_mps,
        max_accel_mps2: scenario.fleet.max_accel_mps2,
        ..VehicleConfig::default()
    };
    let adversity = adversity(scenario, number);
    let battery = BatteryConfig { endurance_s: scenario.battery.endurance_s, ..BatteryConfig::default() };
    let born = (agent_config(scenario, planned.id), keys.root(planned.id).cloned());
    let drone = Drone::new(
        planned.id,
        Parts {
            board: hangar.start(born.0, born.1.clone())?,
            vehicle: Vehicle::new(vehicle, dt_s, planned.pad_m),
            uplink: Link::new(link_config(scenario), seed, Stream::LinkUp, index).with(&adversity),
            downlink: Link::new(link_config(scenario), seed, Stream::LinkDown, index).with(&adversity),
            clock: Clock::new(&clock, seed, index),
            pps: Pps::new(pps, seed, index),
            wind: Wind::new(&wind, dt_s, seed, index),
            gnss: Gnss::new(&gnss, dt_s, seed, index),
            battery: Battery::new(&battery, seed, index).charged(charge(scenario, planned.id)),
            tick_hz: scenario.srs.tick_hz,
            toa_sigma_ns: scenario.srs.sigma_toa_ns,
            error_radius_m: scenario.fleet.r_s_m,
            radius_m: scenario.fleet.radius_m,
            faults: DroneFaults::new(scenario, number),
            born,
            lost_at_s: scenario.losses.iter().find(|loss| loss.drone == number).map(|loss| loss.at_s),
        },
    );
    Ok(drone)
}

/// What a drone of the scenario is born with.
fn agent_config(scenario: &Scenario, id: DroneId) -> AgentConfig {
    let mut config = AgentConfig::new(id);
    let ps = |ns: f64| (1e3 * ns).round() as u32;
    config.oscillator = Oscillator {
        rate: TickRate::new(scenario.srs.tick_hz).expect("the scenario was checked"),
        // A nanosecond a second is a part in 10^9.
        tolerance_ppb: (1.25 * scenario.clock.drift_ns_per_s).ceil().max(100.0) as u32,
        walk_ps: ps(scenario.clock.walk_ns_per_sqrt_s),
        // Simulated rates are constant; no real one is.
        wander_fs_per_s2: 100,
        pulse_ps: ps(scenario.clock.pps_sigma_ns),
    };
    config.srs_symbols = scenario.srs.symbols;
    config.share_period = TimePs((scenario.link.share_period_s * 1e12) as i64);
    config.uplink_bytes_per_s = scenario.link.bytes_per_s();
    config.d_safe_m = scenario.fleet.d_safe_m as f32;
    config.limits.max_speed_mps = 1.2 * scenario.fleet.speed_mps as f32;
    config.limits.max_accel_mps2 = scenario.fleet.max_accel_mps2 as f32;
    config
}

/// Pads of a plan, in order of the drones.
pub(super) fn pads_m(plan: &MissionPlan) -> Vec<V3> {
    plan.drones.iter().map(|d| d.pad_m).collect()
}
