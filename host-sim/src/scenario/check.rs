//! What the values of a scenario must satisfy, each alone and with the others.
//!
//! The bounds are those of the wire format (speeds and separations are 16-bit millimetres,
//! positions 32-bit millimetres) or plain physical sense; within them nothing in the program
//! overflows.

use super::error::ScenarioError;
use super::source::Source;
use super::tables::{FaultKind, FaultTable, Scenario};
use skyroost_protocol::units::MAX_DRONES;
use std::fmt::Display;
use std::ops::RangeInclusive;

/// Longest side, distance or coordinate, metres: half of what the wire can carry.
const MAX_LENGTH_M: f64 = 1e6;
/// Longest time of anything in a mission, seconds (eleven days).
const MAX_TIME_S: f64 = 1e6;
/// Greatest clock error, NLOS lateness or timing noise, nanoseconds: half of what a TDOA can carry.
const MAX_TIMING_NS: f64 = 1e6;
/// Greatest speed or separation in 16-bit millimetres, metres (a second).
const MAX_SHORT_M: f64 = 60.0;
/// Less does not carry what keeps drones apart: two states a second of a drone, and those of its five nearest neighbours to it.
const LEAST_BITS_PER_S: f64 = 4_000.0;

/// Checks every value and returns the first mistake.
pub(super) fn check(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    each_alone(scenario, source)?;
    formation(scenario, source)?;
    pads(scenario, source)?;
    losses(scenario, source)?;
    faults(scenario, source)?;
    partitions(scenario, source)?;
    proportions(scenario, source)?;
    charges(scenario, source)?;
    let Scenario { srs, users, fleet, .. } = scenario;
    require(srs.nlos_min_ns <= srs.nlos_max_ns, source, "srs.nlos_min_ns", srs.nlos_min_ns, || {
        format!("at most srs.nlos_max_ns = {}", srs.nlos_max_ns)
    })?;
    require(users.altitude_m < fleet.altitude_m, source, "users.altitude_m", users.altitude_m, || {
        format!("below fleet.altitude_m = {}", fleet.altitude_m)
    })
}

/// The bounds of each value by itself.
fn each_alone(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let Scenario {
        name,
        seed: _,
        losses: _,
        faults: _,
        partitions: _,
        area,
        obstacles,
        fence,
        fleet,
        users,
        srs,
        clock,
        gnss,
        wind,
        link,
        battery,
        mission,
        limits: _,
    } = scenario;
    require(!name.trim().is_empty(), source, "name", "an empty name", || {
        "a name for the results".to_owned()
    })?;

    let whole = |field: &str, value: u64, bounds: RangeInclusive<u64>| {
        require(bounds.contains(&value), source, field, value, || {
            format!("{} to {}", bounds.start(), bounds.end())
        })
    };
    whole("fleet.drones", fleet.drones.into(), 1..=u64::from(MAX_DRONES))?;
    whole("srs.tick_hz", srs.tick_hz, 1_000_000..=10_000_000_000)?;
    require(matches!(srs.symbols, 1 | 2 | 4), source, "srs.symbols", srs.symbols, || "1, 2 or 4".to_owned())?;
    whole("users.revisits", users.revisits.into(), 0..=100)?;
    whole("srs.max_per_second", srs.max_per_second.into(), 1..=10_000)?;

    for (field, value, max) in [
        ("area.width_m", area.width_m, MAX_LENGTH_M),
        ("area.height_m", area.height_m, MAX_LENGTH_M),
        ("obstacles.clearance_m", obstacles.clearance_m, 1_000.0),
        ("fence.margin_m", fence.margin_m, MAX_LENGTH_M),
        ("fleet.spacing_m", fleet.spacing_m, MAX_LENGTH_M),
        ("fleet.radius_m", fleet.radius_m, MAX_LENGTH_M),
        ("fleet.speed_mps", fleet.speed_mps, MAX_SHORT_M),
        ("fleet.altitude_m", fleet.altitude_m, 10_000.0),
        ("fleet.pad_spacing_m", fleet.pad_pitch_m(), 10_000.0),
        ("fleet.d_safe_m", fleet.d_safe_m, MAX_SHORT_M),
        ("fleet.max_accel_mps2", fleet.max_accel_mps2, 50.0),
        ("users.turn_s", users.turn_s, MAX_TIME_S),
        ("users.revisit_r95_m", users.revisit_r95_m, MAX_LENGTH_M),
        ("srs.period_s", srs.period_s, 3600.0),
        ("wind.gust_time_s", wind.gust_time_s, 3600.0),
        ("link.share_period_s", link.share_period_s, 10.0),
        ("link.burst_every_s", link.burst_every_s.unwrap_or(1.0), MAX_TIME_S),
        ("link.rekey_s", link.rekey_s.unwrap_or(1.0), MAX_TIME_S),
        ("battery.endurance_s", battery.endurance_s, MAX_TIME_S),
        ("mission.time_s", mission.time_s, MAX_TIME_S),
        ("mission.duration_s", mission.duration_s.unwrap_or(1.0), MAX_TIME_S),
    ] {
        require(value > 0.0 && value <= max, source, field, value, || {
            format!("a number above 0 and up to {max}")
        })?;
    }

    let [base_east_m, base_north_m] = fleet.base_m.unwrap_or_default();
    for (field, value, bounds) in [
        ("fleet.base_m", base_east_m, -MAX_LENGTH_M..=MAX_LENGTH_M),
        ("fleet.base_m", base_north_m, -MAX_LENGTH_M..=MAX_LENGTH_M),
        ("fleet.r_s_m", fleet.r_s_m, 0.0..=MAX_SHORT_M),
        ("fleet.margin_m", fleet.margin_m, 0.0..=MAX_LENGTH_M),
        ("users.density_per_km2", users.density_per_km2, 0.0..=10_000.0),
        ("users.altitude_m", users.altitude_m, -1000.0..=10_000.0),
        ("users.speed_mps", users.speed_mps, 0.0..=10.0),
        ("srs.sigma_toa_ns", srs.sigma_toa_ns, 0.0..=MAX_TIMING_NS),
        ("srs.enough_r95_m", srs.enough_r95_m, 0.0..=MAX_LENGTH_M),
        ("srs.nlos_fraction", srs.nlos_fraction, 0.0..=1.0),
        ("srs.nlos_min_ns", srs.nlos_min_ns, 0.0..=MAX_TIMING_NS),
        ("srs.nlos_max_ns", srs.nlos_max_ns, 0.0..=MAX_TIMING_NS),
        ("clock.offset_ns", clock.offset_ns, 0.0..=MAX_TIMING_NS),
        ("clock.drift_ns_per_s", clock.drift_ns_per_s, 0.0..=100_000.0),
        ("clock.walk_ns_per_sqrt_s", clock.walk_ns_per_sqrt_s, 0.0..=10_000.0),
        ("clock.pps_sigma_ns", clock.pps_sigma_ns, 0.0..=10_000.0),
        ("clock.pps_loss_fraction", clock.pps_loss_fraction, 0.0..=1.0),
        ("clock.pps_outlier_fraction", clock.pps_outlier_fraction, 0.0..=1.0),
        ("gnss.sigma_m", gnss.sigma_m, 0.0..=100.0),
        ("wind.mean_mps", wind.mean_mps, 0.0..=MAX_SHORT_M),
        ("wind.direction_deg", wind.direction_deg, -360.0..=360.0),
        ("wind.gust_sigma_mps", wind.gust_sigma_mps, 0.0..=MAX_SHORT_M),
        ("link.delay_s", link.delay_s, 0.0..=10.0),
        ("link.jitter_s", link.jitter_s, 0.0..=10.0),
        ("link.loss_fraction", link.loss_fraction, 0.0..=1.0),
        ("link.duplicate_fraction", link.duplicate_fraction, 0.0..=1.0),
        ("link.reorder_fraction", link.reorder_fraction, 0.0..=1.0),
        ("link.peer_delay_s", link.peer_delay_s, 0.0..=10.0),
        ("link.burst_s", link.burst_s, 0.0..=3600.0),
        ("link.bits_per_s", link.bits_per_s.unwrap_or(LEAST_BITS_PER_S), LEAST_BITS_PER_S..=1e12),
    ] {
        in_bounds(source, field, value, bounds)?;
    }
    limits(scenario, source)
}

/// The acceptance limits that are stated.
fn limits(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let limits = &scenario.limits;
    for (field, value, bounds) in [
        ("limits.coverage_fraction_min", limits.coverage_fraction_min, 0.0..=1.0),
        ("limits.located_fraction_min", limits.located_fraction_min, 0.0..=1.0),
        ("limits.in_r95_fraction_min", limits.in_r95_fraction_min, 0.0..=1.0),
        ("limits.sweep_duration_max_s", limits.sweep_duration_max_s, 0.0..=MAX_TIME_S),
        ("limits.r95_median_max_m", limits.r95_median_max_m, 0.0..=MAX_LENGTH_M),
        ("limits.obstacle_distance_min_m", limits.obstacle_distance_min_m, 0.0..=MAX_LENGTH_M),
        ("limits.fence_distance_min_m", limits.fence_distance_min_m, 0.0..=MAX_LENGTH_M),
        ("limits.crlb_ratio_max", limits.crlb_ratio_max, 0.0..=MAX_LENGTH_M),
        ("limits.formation_error_rms_max_m", limits.formation_error_rms_max_m, 0.0..=MAX_LENGTH_M),
        ("limits.formation_error_max_m", limits.formation_error_max_m, 0.0..=MAX_LENGTH_M),
    ] {
        if let Some(value) = value {
            in_bounds(source, field, value, bounds)?;
        }
    }
    Ok(())
}

/// The triangle: far enough for safety, near enough for three disks to overlap.
fn formation(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let fleet = &scenario.fleet;
    let least_m = fleet.d_safe_m + 2.0 * fleet.r_s_m;
    require(fleet.spacing_m > least_m, source, "fleet.spacing_m", fleet.spacing_m, || {
        format!("more than fleet.d_safe_m + 2 fleet.r_s_m = {least_m}")
    })?;
    let least_m = least_m + fleet.spacing_m;
    require(fleet.pad_pitch_m() > least_m, source, "fleet.pad_spacing_m", fleet.pad_pitch_m(), || {
        format!("more than fleet.spacing_m + fleet.d_safe_m + 2 fleet.r_s_m = {least_m}")
    })?;
    // Beyond sqrt(3) R_C the three disks have no point in common: the domain that (2) lacks.
    let most_m = 3_f64.sqrt() * fleet.radius_m;
    require(fleet.spacing_m <= most_m, source, "fleet.spacing_m", fleet.spacing_m, || {
        format!("at most sqrt(3) fleet.radius_m = {most_m:.3}, where the three disks still overlap")
    })?;
    let inscribed_m = fleet.radius_m - fleet.spacing_m / 3_f64.sqrt();
    require(fleet.margin_m < inscribed_m, source, "fleet.margin_m", fleet.margin_m, || {
        format!("less than the radius of the disk inside the overlap, {inscribed_m:.3}")
    })
}

/// A pad of its own for each drone, so far apart that all can climb and descend beside each other.
fn pads(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let field = "fleet.pads_m";
    let fleet = &scenario.fleet;
    let Some(pads_m) = &fleet.pads_m else { return Ok(()) };
    require(pads_m.len() == fleet.drones as usize, source, field, format!("{} pads", pads_m.len()), || {
        format!("{}, one for each drone", fleet.drones)
    })?;
    for &coordinate_m in pads_m.iter().flatten() {
        in_bounds(source, field, coordinate_m, -MAX_LENGTH_M..=MAX_LENGTH_M)?;
    }
    let least_m = fleet.passing_m();
    let why = "fleet.d_safe_m + 2 fleet.r_s_m + 3";
    let drones = || (1..).zip(pads_m);
    let pairs = drones().flat_map(|a| drones().skip(a.0).map(move |b| (a, b)));
    let apart_m = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let too_near = pairs.map(|((a, at), (b, by))| (apart_m(at, by), a, b)).filter(|(m, ..)| *m < least_m);
    if let Some((found_m, a, b)) = too_near.min_by(|one, other| one.0.total_cmp(&other.0)) {
        let found = format!("the pads of drones {a} and {b} at {found_m:.3} m from each other");
        return require(false, source, field, found, || format!("at least {why} = {least_m}"));
    }
    // Above their pads drones fly over others, and at the end side by side.
    for (field, value) in [("fleet.altitude_m", fleet.altitude_m), ("fleet.spacing_m", fleet.spacing_m)] {
        require(value >= least_m, source, field, value, || {
            format!("at least {why} = {least_m} where fleet.pads_m is stated")
        })?;
    }
    Ok(())
}

/// Drones that exist, each lost at one time.
fn losses(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let (field, drones) = ("losses", scenario.fleet.drones);
    for (index, loss) in scenario.losses.iter().enumerate() {
        require((1..=drones).contains(&loss.drone), source, field, format!("drone {}", loss.drone), || {
            format!("drone 1 to {drones} (fleet.drones)")
        })?;
        let found = format!("at_s = {} of drone {}", loss.at_s, loss.drone);
        require((0.0..=MAX_TIME_S).contains(&loss.at_s), source, field, found, || {
            format!("a number from 0 to {MAX_TIME_S}")
        })?;
        let twice = scenario.losses[..index].iter().any(|before| before.drone == loss.drone);
        require(!twice, source, field, format!("drone {} twice", loss.drone), || {
            "each drone lost once".to_owned()
        })?;
    }
    Ok(())
}

/// Faults of drones that exist, and of the control center.
fn faults(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let (field, drones) = ("faults", scenario.fleet.drones);
    for FaultTable { kind, drone, at_s, for_s } in &scenario.faults {
        let of_control = *kind == FaultKind::ControlKilled;
        let found = drone
            .map_or_else(|| format!("{kind:?} of no drone"), |drone| format!("{kind:?} of drone {drone}"));
        let holds = drone.map_or(of_control, |drone| !of_control && (1..=drones).contains(&drone));
        require(holds, source, field, found, || {
            format!("control_killed without a drone, and all others with drone 1 to {drones} (fleet.drones)")
        })?;
        let holds = (0.0..=MAX_TIME_S).contains(at_s) && (0.0..=MAX_TIME_S).contains(for_s);
        require(holds, source, field, format!("at_s = {at_s}, for_s = {for_s}"), || {
            format!("numbers from 0 to {MAX_TIME_S}")
        })?;
    }
    Ok(())
}

/// Times that end after they begin, of drones that exist.
fn partitions(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let (field, drones) = ("partitions", scenario.fleet.drones);
    for partition in &scenario.partitions {
        for drone in &partition.drones {
            require((1..=drones).contains(drone), source, field, format!("drone {drone}"), || {
                format!("drone 1 to {drones} (fleet.drones)")
            })?;
        }
        let (from_s, until_s) = (partition.from_s, partition.until_s);
        let holds = 0.0 <= from_s && from_s < until_s && until_s <= MAX_TIME_S;
        require(holds, source, field, format!("from_s = {from_s}, until_s = {until_s}"), || {
            format!("from_s from 0 on, and until_s above it and up to {MAX_TIME_S}")
        })?;
    }
    Ok(())
}

/// One positive share for each fleet, summing to 1.
fn proportions(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    /// What shares written with a few decimals, such as three times 0.333333, may miss.
    const SUM_TOLERANCE: f64 = 1e-5;
    let field = "fleet.proportions";
    let (Some(shares), fleets) = (&scenario.fleet.proportions, scenario.fleets()) else {
        return Ok(());
    };
    require(shares.len() == fleets as usize, source, field, format!("{} shares", shares.len()), || {
        format!("{fleets}, one for each fleet of three drones")
    })?;
    for &share in shares {
        require(share > 0.0 && share <= 1.0, source, field, share, || {
            "shares above 0 and up to 1".to_owned()
        })?;
    }
    let sum: f64 = shares.iter().sum();
    require((sum - 1.0).abs() <= SUM_TOLERANCE, source, field, format!("a sum of {sum}"), || {
        "a sum of 1".to_owned()
    })
}

/// One charge for each drone.
fn charges(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let field = "battery.charges";
    let (Some(charges), drones) = (&scenario.battery.charges, scenario.fleet.drones) else { return Ok(()) };
    require(charges.len() == drones as usize, source, field, format!("{} charges", charges.len()), || {
        format!("{drones}, one for each drone")
    })?;
    charges.iter().try_for_each(|&charge| in_bounds(source, field, charge, 0.0..=1.0))
}

/// A number between two bounds; NaN is between none.
fn in_bounds(
    source: &Source,
    field: &str,
    value: f64,
    bounds: RangeInclusive<f64>,
) -> Result<(), ScenarioError> {
    require(bounds.contains(&value), source, field, value, || {
        format!("a number from {} to {}", bounds.start(), bounds.end())
    })
}

/// Complains about `field` unless `holds`.
fn require(
    holds: bool,
    source: &Source,
    field: &str,
    found: impl Display,
    expected: impl FnOnce() -> String,
) -> Result<(), ScenarioError> {
    if holds {
        return Ok(());
    }
    Err(ScenarioError::Value {
        place: source.place(field),
        field: field.to_owned(),
        found: found.to_string(),
        expected: expected(),
    })
}
