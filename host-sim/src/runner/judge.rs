//! Holds the flight against the truth: figures for the summary, records for the report.

use super::{
    Flight, MissionArea, MissionInput, Outcome, RunError, drone::Drone, setup::Setup, watch::FleetWatch,
};
use crate::{
    control::{
        airspace::is_in_the_way,
        localize::{FixStatus, LocalizeConfig, Occasion, UserFix, crlb, crlb_ratio},
        mission::{
            Replan,
            drone::{HeldBack, Traffic},
            plan::PlannedFleet,
        },
        place::{Fleet, Objective, PlaceUser, Placement, place, place_joint},
        sweep::SplitMode,
    },
    fleet::BoardReport,
    geometry::{
        V2,
        coverage::covered_region,
        region::{Part, Region},
    },
    recording::{PlacementRecord, Recording, SubAreaRecord, UserRecord},
    report::{
        figures::{quantile, status_name},
        summary::{
            BoardSummary, HeldBackSummary, LinkSummary, LocalizationSummary, LostDrone, PlacedDrone,
            PlacementSummary, PunctualitySummary, RateSummary, ReplanSummary, SafetySummary, SrsSummary,
            Summary, SweepSummary,
        },
    },
    world::link::Carried,
};
use skyroost_firmware::{counters::Counters, supervisor::Condition};
use skyroost_protocol::{
    message::{EventCode, TdoaCounts},
    units::{OccasionId, TimePs, UserId},
};
use std::collections::BTreeMap;

/// The joint optimum of more users takes its time; the greedy bound is close for so many.
const MOST_JUDGED_TOGETHER: usize = 20_000;

/// A capture that was flagged late in truth is left out of the bound.
type Late = Vec<[bool; 3]>;

/// Everything that the flight amounts to.
pub(super) fn outcome(
    input: &MissionInput,
    setup: &Setup,
    backend: &str,
    flight: Flight,
) -> Result<Outcome, RunError> {
    let scenario = &input.scenario;
    let (sweep, uncovered_m) = sweep(scenario, setup, &flight);
    let users = Users::new(&flight);
    let localization = users.summary(setup, &flight)?;
    let sites = sites(setup, &flight);
    let placement = users.placement(setup, &flight, &sites)?;
    let counters = flight.link_counters();
    let refusals = flight.control.refusals();
    let [rejected_on_board, forged_on_board] = flight.refused_on_board();
    let (squares_m2, samples) =
        flight.fleets.iter().map(FleetWatch::errors).fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    let warnings = warnings(input, &flight, &sweep);
    let summary = Summary {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        backend: backend.to_owned(),
        drones: scenario.fleet.drones,
        fleets: scenario.fleets(),
        sweep,
        srs: srs(&flight),
        localization,
        placement,
        safety: SafetySummary {
            min_separation_m: flight.separation.least_m(),
            violations: flight.separation.violations(),
            min_obstacle_distance_m: flight.clearance.least_m(),
            min_fence_distance_m: flight.clearance.within_fence_m(),
            formation_error_rms_m: if samples == 0 { 0.0 } else { (squares_m2 / samples as f64).sqrt() },
            formation_error_max_m: flight.fleets.iter().map(FleetWatch::max_error_m).fold(0.0, f64::max),
            manoeuvres_s: flight.fleets.iter().map(FleetWatch::manoeuvres_s).sum(),
        },
        link: LinkSummary {
            frames: counters.sent,
            bytes: counters.bytes,
            lost: counters.lost + counters.dropped_overflow,
            overflowed: counters.dropped_overflow,
            rejected: refusals.rejected + flight.control.counters().frames_of_strangers + rejected_on_board,
            forged: refusals.forged + forged_on_board,
            authenticated: setup.plan.keys.is_sealed(),
            up: busiest(&flight, |drone| drone.uplink.carried()),
            down: busiest(&flight, |drone| drone.downlink.carried()),
            mates: busiest(&flight, |drone| &drone.to_mates),
            bytes_for: bytes_for(&flight.control.traffic()),
            held_back: held_back(&flight),
        },
        attack: flight.attack(),
        lost: flight
            .control
            .lost()
            .map(|(id, at)| LostDrone { drone: id.0, at_s: at.0 as f64 * 1e-12 })
            .collect(),
        boards: boards(&flight.reports),
        digest: flight.digest(),
        warnings,
        ..Summary::default()
    };
    let recording = Recording {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        radius_m: scenario.fleet.radius_m,
        swath_m: setup.sweep.swath_m,
        area_m: setup.region.parts().iter().flat_map(Part::borders_m).map(|ring| points(&ring)).collect(),
        no_fly_m: in_the_way(setup, scenario),
        fence_m: points(setup.plan.airspace.fence().vertices_m()),
        origin_lon_lat_deg: input.area.origin_lon_lat_deg,
        sub_areas: sub_areas(setup, &flight),
        uncovered_m,
        placements: sites.iter().map(|s| s.record).collect(),
        users: users.records(setup, &flight, &sites),
        events: flight.events(),
        phases: flight.phases,
        drones: flight.tracks,
    };
    Ok(Outcome { summary, recording, shares: Vec::new(), boards: Vec::new() })
}

/// The rate of the drone whose link carries most.
fn busiest(flight: &Flight, carried: fn(&Drone) -> &Carried) -> RateSummary {
    let all = || flight.islands.iter().flat_map(|island| &island.drones).map(carried);
    let mean = |one: &Carried| one.mean_bits_per_s(flight.now_s());
    RateSummary {
        mean_bits_per_s: all().map(mean).fold(0.0, f64::max),
        most_bits_per_s: all().map(Carried::most_bits_per_s).max().unwrap_or_default(),
    }
}

/// What the control center heard and said, by what it is for.
fn bytes_for(traffic: &Traffic) -> BTreeMap<&'static str, u64> {
    let Traffic { states, differences, pages, telemetry, answers, relayed, requests, lanes, commands } =
        *traffic;
    [
        ("up_states", states),
        ("up_differences", differences),
        ("up_users_heard", pages),
        ("up_telemetry", telemetry),
        ("up_answers", answers),
        ("down_states", relayed),
        ("down_requests", requests),
        ("down_lanes", lanes),
        ("down_commands", commands),
    ]
    .into()
}

/// What found no room on the links.
fn held_back(flight: &Flight) -> HeldBackSummary {
    let on_board = |count: fn(&Counters) -> u32| {
        flight.reports.iter().map(|report| u64::from(count(&report.counters))).sum()
    };
    let HeldBack { relays, neighbours, pieces, requests, copies } = flight.control.held_back();
    HeldBackSummary {
        frames_put_off: on_board(|counters| counters.frames_put_off),
        pages_dropped: on_board(|counters| counters.pages_dropped),
        relays_put_off: relays,
        relays_cut: neighbours,
        lanes_put_off: pieces,
        requests_dropped: requests,
        copies_dropped: copies,
    }
}

/// What became of arrival times, as the drones' last telemetry and boards say.
fn srs(flight: &Flight) -> SrsSummary {
    let mut sum = SrsSummary::default();
    for counts in flight.control.tdoa_counts() {
        let TdoaCounts { hits, misses, stale, duplicates, evicted, gated, saturated } = counts;
        for (sum, count) in [
            (&mut sum.hits, hits),
            (&mut sum.misses, misses),
            (&mut sum.stale, stale),
            (&mut sum.duplicates, duplicates),
            (&mut sum.evicted, evicted),
            (&mut sum.gated, gated),
            (&mut sum.saturated, saturated),
        ] {
            *sum += u64::from(count);
        }
    }
    for Counters { captures_unknown, symbols_refused, symbols_excluded, pulses_rejected, .. } in
        flight.reports.iter().map(|report| report.counters)
    {
        let refused = [captures_unknown, symbols_refused, symbols_excluded];
        sum.refused += refused.into_iter().map(u64::from).sum::<u64>();
        sum.pulses_rejected += u64::from(pulses_rejected);
    }
    sum
}

/// The boards that the flight code ran on.
fn boards(reports: &[BoardReport]) -> Vec<BoardSummary> {
    let summary = |(index, report): (usize, &BoardReport)| {
        let figures = report.board?;
        Some(BoardSummary {
            id: index as u16 + 1,
            steps: figures.steps,
            step_instructions_mean: figures.step_instructions_mean,
            step_instructions_worst: figures.step_instructions_worst,
            step_instructions_sum: figures.step_instructions_sum,
            stack_used_bytes: figures.stack_used,
            bus_damaged: figures.link.bus_damaged,
            radio_damaged: figures.link.radio_damaged,
            inputs_overflowed: figures.link.inputs_overflowed,
            punctuality: figures.punctuality.map(|late| PunctualitySummary {
                missed_deadlines: late.missed_deadlines,
                worst_answer_wall_s: late.worst_answer_ms * 1e-3,
                damaged: late.damaged,
                resent: late.resent,
            }),
        })
    };
    reports.iter().enumerate().filter_map(summary).collect()
}

/// An event for people.
pub(super) fn event_text(code: EventCode, value: u32) -> String {
    const PHASES: [&str; 8] = [
        "on the ground",
        "taking off",
        "holding",
        "sweeping",
        "flying to its placement",
        "serving",
        "returning home",
        "landing",
    ];
    let or_number = |name: Option<&str>| name.map_or_else(|| value.to_string(), str::to_owned);
    let condition = || or_number(Condition::numbered(value).map(Condition::name));
    match code {
        EventCode::PhaseEntered => or_number(PHASES.get(value as usize).copied()),
        EventCode::ConditionRaised => format!("{}: raised", condition()),
        EventCode::ConditionCleared => format!("{}: cleared", condition()),
        EventCode::SweepDone => format!("lanes flown after {value} s"),
        EventCode::GoalReached => format!("at its placement, {:.1} m off", f64::from(value) * 1e-3),
    }
}

fn sweep(
    scenario: &crate::scenario::Scenario,
    setup: &Setup,
    flight: &Flight,
) -> (SweepSummary, Vec<Vec<[f64; 2]>>) {
    let stadiums: Vec<_> = flight.fleets.iter().flat_map(FleetWatch::stadiums).collect();
    let coverage = covered_region(&setup.region, &stadiums);
    let duration_s = duration_s(flight);
    let summary = SweepSummary {
        split: if setup.sweep.split == SplitMode::Length { "length" } else { "area" }.to_owned(),
        coverage_fraction: coverage.covered_fraction,
        duration_s,
        length_m: setup.sweep.sub_areas.iter().map(|s| s.length_m).collect(),
        mission_time_s: scenario.mission.time_s,
        replans: flight.control.replans().iter().map(replan).collect(),
    };
    (summary, coverage.residue.iter().map(|ring| points(ring)).collect())
}

/// A plan that was made anew, for the summary.
fn replan(replan: &Replan) -> ReplanSummary {
    let s = |at: TimePs| at.0 as f64 * 1e-12;
    ReplanSummary {
        at_s: s(replan.at),
        users_gone: replan.users_gone as u32,
        broken_by: replan.broken_by.iter().map(|id| id.0).collect(),
        fleets: replan.fleets as u32,
        left_m2: replan.left_m2,
        delay_s: (replan.end_before.zip(replan.end_after)).map(|(before, after)| s(after) - s(before)),
    }
}

/// Of one plan the longest time that a fleet took for its lanes; of several the time from the first lane to the last, what lay between
/// them included. A fleet that did not come to the end of the last plan's lanes has swept until now.
fn duration_s(flight: &Flight) -> f64 {
    let (before, last) = flight.fleets.split_at(flight.flying);
    let first_s = before.iter().filter_map(|fleet| fleet.began_and_ended_s().0).fold(f64::INFINITY, f64::min);
    let took_s = |fleet: &FleetWatch| match fleet.began_and_ended_s() {
        (Some(began_s), Some(ended_s)) => ended_s - began_s.min(first_s),
        _ => flight.now_s(),
    };
    if last.is_empty() && first_s.is_finite() {
        return flight.now_s() - first_s; // nobody was left to fly the rest
    }
    last.iter().map(took_s).fold(0.0, f64::max)
}

/// What drones fly around.
fn in_the_way(setup: &Setup, scenario: &crate::scenario::Scenario) -> Vec<Vec<[f64; 2]>> {
    let (altitude_m, clearance_m) = (scenario.fleet.altitude_m, scenario.obstacles.clearance_m);
    let obstacles = setup.plan.airspace.obstacles().iter();
    let found = obstacles.filter(|it| is_in_the_way(it, altitude_m, clearance_m));
    found.map(|it| points(it.footprint.vertices_m())).collect()
}

fn points(ring_m: &[V2]) -> Vec<[f64; 2]> {
    ring_m.iter().map(|p| [p.x, p.y]).collect()
}

/// The parts as planned at first, and the lanes of the last plan where there was another.
fn sub_areas(setup: &Setup, flight: &Flight) -> Vec<SubAreaRecord> {
    let record = |sub: &crate::control::sweep::SubArea| SubAreaRecord {
        fleet: sub.fleet as u16,
        polygon_m: sub.region.as_ref().and_then(Region::as_polygon).map(|p| points(p.vertices_m())),
        path_m: points(&sub.path_m),
    };
    let again = |(fleet, planned): (usize, &PlannedFleet)| SubAreaRecord {
        fleet: fleet as u16,
        polygon_m: None,
        path_m: points(&planned.waypoints_m),
    };
    let plan = flight.control.plan();
    let regrouped = plan.fleets.iter().enumerate().filter(|_| flight.control.revision() > 0).map(again);
    setup.sweep.sub_areas.iter().map(record).chain(regrouped).collect()
}

fn warnings(input: &MissionInput, flight: &Flight, sweep: &SweepSummary) -> Vec<String> {
    let mut warnings = flight.control.localization().warnings.clone();
    let MissionArea { name, left_out, .. } = &input.area;
    warnings.extend(left_out.iter().map(|it| format!("{name}: left out {it}")));
    if sweep.duration_s > sweep.mission_time_s {
        let (took_s, given_s) = (sweep.duration_s, sweep.mission_time_s);
        warnings.push(format!("the sweep took {took_s:.0} s, the scenario gives it {given_s:.0} s"));
    }
    let saturated = flight.control.counters().tdoa_saturated;
    if saturated > 0 {
        warnings.push(format!("{saturated} time differences did not fit their 32 bits and were left out"));
    }
    let dropped: u64 = flight.islands.iter().flat_map(|i| &i.drones).map(|d| d.captures_dropped).sum();
    if dropped > 0 {
        warnings.push(format!("{dropped} captures found no room in a step of the flight code"));
    }
    warnings
}

/// A drone's final place.
struct DroneSite {
    record: PlacementRecord,
    pos_m: V2,
}

/// Where every drone was sent; one that nobody needed is at home and serves nobody.
fn sites(setup: &Setup, flight: &Flight) -> Vec<DroneSite> {
    let Some(placement) = flight.control.placement() else { return Vec::new() };
    let site_of = |target: &crate::control::mission::Target| {
        let station = target.station?;
        let site = placement.sites[station.site].as_ref()?;
        let drone = setup.plan.drones[target.drone].id.0;
        let record =
            PlacementRecord { drone, pos_m: station.pos_m.into(), covered: site.covered.len() as u32 };
        Some(DroneSite { record, pos_m: station.pos_m })
    };
    flight.control.targets().iter().filter_map(site_of).collect()
}

/// The users and what is claimed of them.
struct Users<'a> {
    fixes: BTreeMap<UserId, &'a UserFix>,
    /// Where they were when they were located last.
    truth: BTreeMap<UserId, [f64; 2]>,
    /// Where they are in the end.
    served: BTreeMap<UserId, [f64; 2]>,
}

impl<'a> Users<'a> {
    fn new(flight: &'a Flight) -> Self {
        let fixes = flight.control.localization().users.iter().map(|fix| (fix.user, fix)).collect();
        let numbered = |pos_m: &[V2]| (0u32..).map(UserId).zip(pos_m.iter().map(|p| [p.x, p.y])).collect();
        let end_m = flight.users_m();
        let truth = numbered(flight.located_m.as_ref().map_or(&end_m, |(_, pos_m)| pos_m));
        Self { fixes, truth, served: numbered(&end_m) }
    }

    /// Fixes that claim a position.
    fn located(&self) -> impl Iterator<Item = (&'a UserFix, [f64; 2])> {
        let claimed = self.fixes.values().filter(|fix| fix.status == FixStatus::Ok);
        claimed.map(|fix| (*fix, self.truth[&fix.user]))
    }

    fn summary(&self, setup: &Setup, flight: &Flight) -> Result<LocalizationSummary, RunError> {
        let errors_m: Vec<f64> = self.located().map(|(fix, truth)| distance_m(fix.pos_m, truth)).collect();
        let mut r95_m: Vec<f64> = self.located().map(|(fix, _)| fix.r95_m).collect();
        r95_m.sort_by(f64::total_cmp);
        let count = errors_m.len();
        let within = self.located().filter(|(fix, truth)| distance_m(fix.pos_m, *truth) <= fix.r95_m).count();
        let mean = |sum: f64| (count > 0).then(|| sum / count as f64);
        let mut status_counts: BTreeMap<String, u32> = BTreeMap::new();
        for user in self.truth.keys() {
            *status_counts.entry(self.status(*user).to_owned()).or_default() += 1;
        }
        Ok(LocalizationSummary {
            users: setup.users.len() as u32,
            located: count as u32,
            rmse_m: mean(errors_m.iter().map(|e| e * e).sum()).map(f64::sqrt),
            r95_median_m: quantile(&r95_m, 0.5),
            r95_p95_m: quantile(&r95_m, 0.95),
            crlb_ratio: self.crlb_ratio(setup, flight)?,
            in_r95_fraction: mean(within as f64),
            status_counts,
        })
    }

    fn status(&self, user: UserId) -> &'static str {
        status_name(self.fixes.get(&user).map_or(FixStatus::NotLocated, |fix| fix.status))
    }

    /// The errors against the bound of the very measurements used.
    fn crlb_ratio(&self, setup: &Setup, flight: &Flight) -> Result<Option<f64>, RunError> {
        let config: &LocalizeConfig = &setup.plan.localize;
        if !config.motion.is_still() {
            return Ok(None); // the bound is one of users that stay
        }
        let occasions = flight.control.occasions();
        let late = self.late(flight, occasions);
        let bounds = crlb(occasions, &late, &self.truth, config)
            .map_err(|error| RunError::Link(format!("the bound cannot be computed: {error}")))?;
        Ok(crlb_ratio(&flight.control.localization().users, &self.truth, &bounds))
    }

    /// Which captures of which occasion came late in truth.
    fn late(&self, flight: &Flight, occasions: &[Occasion]) -> Late {
        let late = flight.late();
        let marks = |(occasion, id): (&Occasion, &OccasionId)| {
            let mut row = [false; 3];
            for (mark, capture) in row.iter_mut().zip(&occasion.captures) {
                *mark = late.contains(&(id.0, capture.drone.0));
            }
            row
        };
        occasions.iter().zip(flight.control.occasion_ids()).map(marks).collect()
    }

    fn placement(
        &self,
        setup: &Setup,
        flight: &Flight,
        sites: &[DroneSite],
    ) -> Result<PlacementSummary, RunError> {
        let radius_m = setup.plan.radius_m;
        let planned = flight.control.placement().is_some();
        // Who is lost serves nobody, and no optimum counts on it.
        let drones = if planned { flight.control.targets().len() } else { setup.plan.drones.len() };
        let fleet = Fleet { drones, min_separation_m: setup.plan.min_goal_distance_m };
        let solved = |users: Vec<PlaceUser>| -> Result<Placement, RunError> {
            // A mission that ended before is not measured against the optimum, which takes its time.
            let found = if users.len() > MOST_JUDGED_TOGETHER || !planned {
                place(Objective::Guaranteed(&users), fleet)
            } else {
                place_joint(&users, fleet, None)
            };
            found.map_err(|error| RunError::Link(format!("the placement cannot be judged: {error}")))
        };
        let user = |pos: [f64; 2], radius_m: f64| PlaceUser { pos_m: V2::from(pos), radius_m, weight: 1.0 };
        let guaranteed =
            solved(self.located().map(|(fix, _)| user(fix.pos_m, radius_m - fix.r95_m)).collect())?;
        let optimum_on_truth = if planned {
            let on_truth = solved(self.served.values().map(|pos| user(*pos, radius_m)).collect())?;
            Some(on_truth.upper_bound.floor() as u32)
        } else {
            None
        };
        let served = |by: &dyn Fn(UserId) -> Option<u16>| {
            self.truth.keys().filter(|u| by(**u).is_some()).count() as u32
        };
        let served_guaranteed = served(&|u| self.guaranteed_by(u, radius_m, sites));
        let served_actual = served(&|u| self.actually_by(u, radius_m, sites));
        let upper_bound = guaranteed.upper_bound.floor() as u32;
        Ok(PlacementSummary {
            method: "joint".to_owned(),
            drones: sites
                .iter()
                .map(|s| PlacedDrone { id: s.record.drone, x_m: s.pos_m.x, y_m: s.pos_m.y })
                .collect(),
            served_guaranteed,
            served_actual,
            upper_bound,
            proved_optimal: planned && served_guaranteed == upper_bound,
            optimum_on_truth,
            served_ratio: (optimum_on_truth.filter(|&optimum| optimum > 0))
                .map(|optimum| f64::from(served_actual) / f64::from(optimum)),
        })
    }

    /// The drone whose coverage disk holds the user's whole error disk.
    fn guaranteed_by(&self, user: UserId, radius_m: f64, sites: &[DroneSite]) -> Option<u16> {
        let fix = self.fixes.get(&user).filter(|fix| fix.status == FixStatus::Ok)?;
        nearest_within(V2::from(fix.pos_m), radius_m - fix.r95_m, sites)
    }

    /// The drone that covers the user's true position.
    fn actually_by(&self, user: UserId, radius_m: f64, sites: &[DroneSite]) -> Option<u16> {
        nearest_within(V2::from(self.served[&user]), radius_m, sites)
    }

    fn records(&self, setup: &Setup, _flight: &Flight, sites: &[DroneSite]) -> Vec<UserRecord> {
        let radius_m = setup.plan.radius_m;
        let record = |(user, truth): (&UserId, &[f64; 2])| {
            let fix = self.fixes.get(user);
            let claimed = fix.filter(|fix| fix.status == FixStatus::Ok);
            UserRecord {
                id: setup.users[user.0 as usize].id.clone(),
                truth_m: *truth,
                estimate_m: claimed.map(|fix| fix.pos_m),
                cov_m2: claimed.map(|fix| fix.cov_m2),
                r95_m: claimed.map(|fix| fix.r95_m),
                status: self.status(*user),
                occasions: fix.map_or(0, |fix| fix.occasions),
                heard_s: fix.map(|fix| fix.last_heard_s),
                served_guaranteed_by: self.guaranteed_by(*user, radius_m, sites),
                served_actual_by: self.actually_by(*user, radius_m, sites),
            }
        };
        self.truth.iter().map(record).collect()
    }
}

fn nearest_within(pos_m: V2, radius_m: f64, sites: &[DroneSite]) -> Option<u16> {
    let distance = |site: &DroneSite| (site.pos_m - pos_m).norm();
    let nearest = sites.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) <= radius_m + crate::control::place::TOLERANCE_M).then_some(nearest.record.drone)
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
