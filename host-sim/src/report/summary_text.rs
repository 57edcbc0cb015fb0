//! A [`Summary`] for people: the same facts as the JSON, aligned, with units and the verdict of
//! every limit.

use super::limits::Bound;
use super::summary::{
    BoardSummary, HeldBackSummary, LinkSummary, LocalizationSummary, LostDrone, PlacementSummary,
    PunctualitySummary, RateSummary, ReplanSummary, SafetySummary, SrsSummary, Summary, SweepSummary, Timing,
};
use std::fmt;

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scenario, seed, backend, drones, fleets, .. } = self;
        writeln!(f, "Mission {scenario}, seed {seed}: {drones} drones in {fleets} fleets ({backend})")?;
        sweep(f, &self.sweep)?;
        srs(f, &self.srs)?;
        localization(f, &self.localization)?;
        placement(f, &self.placement)?;
        safety(f, &self.safety)?;
        for LostDrone { drone, at_s } in &self.lost {
            row(f, "lost", format!("drone {drone}, silent in the air at {at_s:.1} s"))?;
        }
        link(f, &self.link)?;
        boards(f, &self.boards)?;
        timing(f, &self.timing)?;
        row(f, "digest", &self.digest)?;
        limits(f, self)?;
        self.warnings.iter().try_for_each(|warning| writeln!(f, "\nWarning: {warning}"))
    }
}

fn sweep(f: &mut fmt::Formatter<'_>, sweep: &SweepSummary) -> fmt::Result {
    writeln!(f, "\nSweep")?;
    row(f, "coverage", format!("{} of the area", percent(sweep.coverage_fraction)))?;
    row(f, "duration", minutes(sweep.duration_s))?;
    row(f, "mission time", minutes(sweep.mission_time_s))?;
    let lengths: Vec<String> = sweep.length_m.iter().map(|length_m| format!("{length_m:.0} m")).collect();
    row(f, "lanes", format!("{}, split by {}", lengths.join(" + "), sweep.split))?;
    sweep.replans.iter().try_for_each(|it| row(f, "planned anew", replan(it)))
}

fn replan(replan: &ReplanSummary) -> String {
    let ReplanSummary { at_s, broken_by, users_gone, fleets, left_m2, delay_s } = replan;
    let numbers: Vec<String> = broken_by.iter().map(ToString::to_string).collect();
    let why = match numbers.as_slice() {
        [] if *users_gone > 0 => format!("for {users_gone} users that have walked on"),
        [] => "for drones that came back or lanes that were cut off".to_owned(),
        [one] => format!("without drone {one}"),
        several => format!("without drones {}", several.join(", ")),
    };
    let left = format!("{:.2} km2 left", left_m2 * 1e-6);
    match (fleets, delay_s) {
        (0, _) => format!("at {at_s:.0} s {why}: {left} and nobody to fly it"),
        (_, Some(delay_s)) => format!("at {at_s:.0} s {why}: {left} for {fleets} fleets, {delay_s:+.0} s"),
        (_, None) => format!("at {at_s:.0} s {why}: {left} for {fleets} fleets"),
    }
}

fn srs(f: &mut fmt::Formatter<'_>, srs: &SrsSummary) -> fmt::Result {
    let SrsSummary { hits, misses, stale, duplicates, evicted, gated, saturated, refused, pulses_rejected } =
        srs;
    writeln!(f, "\nArrival times")?;
    row(f, "differences", format!("{hits} formed, {misses} lacked a capture"))?;
    for (count, what) in [
        (gated, "differences beyond any place of a user"),
        (saturated, "differences beyond 32 bits"),
        (stale, "captures without the serving drone's"),
        (duplicates, "captures that came twice"),
        (evicted, "occasions without room"),
        (refused, "captures refused"),
        (pulses_rejected, "pulses refused"),
    ] {
        if *count > 0 {
            row(f, "", format!("{count} {what}"))?;
        }
    }
    Ok(())
}

fn localization(f: &mut fmt::Formatter<'_>, found: &LocalizationSummary) -> fmt::Result {
    writeln!(f, "\nLocalization")?;
    row(f, "located", format!("{} of {} users", found.located, found.users))?;
    for (status, count) in found.status_counts.iter().filter(|(status, _)| *status != "ok") {
        row(f, "", format!("{count} {}", status.replace('_', " ")))?;
    }
    row(f, "error (rms)", metres(found.rmse_m))?;
    row(
        f,
        "95 % radius",
        format!("median {}, 95th percentile {}", metres(found.r95_median_m), metres(found.r95_p95_m)),
    )?;
    row(f, "truly within", found.in_r95_fraction.map_or_else(unknown, percent))?;
    row(f, "against bound", found.crlb_ratio.map_or_else(unknown, |ratio| format!("{ratio:.3} x Cramer-Rao")))
}

fn placement(f: &mut fmt::Formatter<'_>, placement: &PlacementSummary) -> fmt::Result {
    writeln!(f, "\nPlacement ({})", placement.method)?;
    row(f, "guaranteed", format!("{} users (whole error disk covered)", placement.served_guaranteed))?;
    row(f, "actual", format!("{} users (true position covered)", placement.served_actual))?;
    let proof = if placement.proved_optimal { "proved optimal" } else { "optimum not proved" };
    row(f, "upper bound", format!("{} users, {proof}", placement.upper_bound))?;
    if let (Some(most), Some(ratio)) = (placement.optimum_on_truth, placement.served_ratio) {
        row(f, "knowing all", format!("{most} users at most; reached {}", percent(ratio)))?;
    }
    for drone in &placement.drones {
        row(
            f,
            &format!("drone {}", drone.id),
            format!("{:9.1} m east {:9.1} m north", drone.x_m, drone.y_m),
        )?;
    }
    Ok(())
}

fn safety(f: &mut fmt::Formatter<'_>, safety: &SafetySummary) -> fmt::Result {
    writeln!(f, "\nSafety")?;
    row(
        f,
        "separation",
        format!("least {}, {} violations", metres(safety.min_separation_m), safety.violations),
    )?;
    if safety.min_obstacle_distance_m.is_some() {
        row(f, "obstacles", format!("least {}", metres(safety.min_obstacle_distance_m)))?;
    }
    row(f, "fence", format!("{} within at least", metres(safety.min_fence_distance_m)))?;
    let (rms, max) = (Some(safety.formation_error_rms_m), Some(safety.formation_error_max_m));
    row(f, "formation", format!("error {} rms, {} at most", metres(rms), metres(max)))?;
    if safety.manoeuvres_s > 0.0 {
        row(
            f,
            "manoeuvres",
            format!("{:.0} s of avoiding on the lanes, not counted above", safety.manoeuvres_s),
        )?;
    }
    Ok(())
}

fn link(f: &mut fmt::Formatter<'_>, link: &LinkSummary) -> fmt::Result {
    let LinkSummary { frames, bytes, lost, overflowed, rejected, forged, authenticated, .. } = link;
    writeln!(f, "\nLink")?;
    if !authenticated {
        row(f, "UNAUTHENTICATED", "whoever can send can command the drones")?;
    }
    row(f, "frames", format!("{frames} ({bytes} bytes), {lost} lost, {rejected} rejected, {forged} forged"))?;
    let busiest = [("up", link.up), ("down", link.down), ("to mates", link.mates)];
    let rate = |(way, rate): (&str, RateSummary)| {
        format!(
            "{way} {:.1} (at most {:.1})",
            rate.mean_bits_per_s * 1e-3,
            rate.most_bits_per_s as f64 * 1e-3
        )
    };
    row(f, "busiest drone", format!("{} kbit/s", busiest.map(rate).join(", ")))?;
    if *overflowed > 0 {
        row(f, "", format!("{overflowed} of the lost found the transmitter busy for too long"))?;
    }
    let HeldBackSummary {
        frames_put_off,
        pages_dropped,
        relays_put_off,
        relays_cut,
        lanes_put_off,
        requests_dropped,
        copies_dropped,
    } = link.held_back;
    let held_back: Vec<String> = [
        (frames_put_off, "frames put off on board"),
        (pages_dropped, "pages of users dropped"),
        (relays_put_off, "relays put off"),
        (relays_cut, "relays of the nearest only"),
        (lanes_put_off, "waits for lanes"),
        (requests_dropped, "SRS requests dropped"),
        (copies_dropped, "copies dropped"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, what)| format!("{count} {what}"))
    .collect();
    if held_back.is_empty() { Ok(()) } else { row(f, "held back", held_back.join(", ")) }
}

fn boards(f: &mut fmt::Formatter<'_>, boards: &[BoardSummary]) -> fmt::Result {
    if boards.is_empty() {
        return Ok(());
    }
    writeln!(f, "\nBoards")?;
    let worst = boards.iter().filter_map(|board| board.step_instructions_worst).max();
    let means: Vec<f64> = boards.iter().filter_map(|board| board.step_instructions_mean).collect();
    if let Some(worst) = worst {
        let mean = means.iter().sum::<f64>() / means.len().max(1) as f64;
        row(f, "a step", format!("{mean:.0} instructions in the mean, {worst} at most"))?;
    }
    if let Some(stack) = boards.iter().filter_map(|board| board.stack_used_bytes).max() {
        row(f, "stack", format!("{stack} bytes at most"))?;
    }
    for board in boards {
        if let Some(late) = &board.punctuality {
            let PunctualitySummary { missed_deadlines, worst_answer_wall_s, damaged, resent } = late;
            let (steps, worst_ms) = (board.steps, worst_answer_wall_s * 1e3);
            let label = format!("drone {}", board.id);
            row(
                f,
                &label,
                format!("{missed_deadlines} of {steps} deadlines missed, answers within {worst_ms:.1} ms"),
            )?;
            row(f, "", format!("{damaged} frames damaged on the bus, {resent} requests sent again"))?;
        }
    }
    let sum =
        |count: fn(&BoardSummary) -> u32| boards.iter().map(|board| u64::from(count(board))).sum::<u64>();
    let (damaged, overflowed) = (sum(|b| b.radio_damaged), sum(|b| b.inputs_overflowed));
    row(f, "dropped", format!("{damaged} damaged frames of the radio, {overflowed} inputs without room"))
}

fn timing(f: &mut fmt::Formatter<'_>, timing: &Timing) -> fmt::Result {
    writeln!(f, "\nTiming")?;
    row(f, "simulated", minutes(timing.simulated_s))?;
    row(f, "took", format!("{:.1} s, {:.0} x real time", timing.wall_s, timing.realtime_factor))
}

fn limits(f: &mut fmt::Formatter<'_>, summary: &Summary) -> fmt::Result {
    let limits = &summary.limits;
    if limits.is_empty() {
        return writeln!(f, "\nThe scenario states no limits.");
    }
    writeln!(f, "\nLimits")?;
    for limit in limits {
        let verdict = if limit.ok { "pass" } else { "FAIL" };
        let sign = match limit.bound {
            Bound::AtLeast => ">=",
            Bound::AtMost => "<=",
        };
        let value = limit.value.map_or_else(unknown, plain);
        writeln!(f, "  {verdict}  {:<26} {value:>12} {sign} {}", limit.name, plain(limit.limit))?;
    }
    let kept = limits.iter().filter(|limit| limit.ok).count();
    writeln!(f, "  {kept} of {} limits hold.", limits.len())
}

/// One aligned line.
fn row(f: &mut fmt::Formatter<'_>, label: &str, value: impl fmt::Display) -> fmt::Result {
    writeln!(f, "  {label:<14} {value}")
}

fn unknown() -> String {
    "-".to_owned()
}

fn metres(value_m: Option<f64>) -> String {
    value_m.map_or_else(unknown, |value_m| format!("{value_m:.2} m"))
}

fn minutes(time_s: f64) -> String {
    format!("{time_s:.1} s ({:.1} min)", time_s / 60.0)
}

/// Rounded down, so that 100 % is said only of the whole, up to the rounding of its computation.
fn percent(fraction: f64) -> String {
    const ROUNDING: f64 = 1e-9;
    format!("{:.2} %", ((fraction + ROUNDING) * 1e4).floor() / 1e2)
}

/// A number as short as it is exact to nine decimals.
fn plain(value: f64) -> String {
    let text = format!("{value:.9}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use crate::report::limits::judge;
    use crate::report::summary::{LostDrone, PlacedDrone, ReplanSummary, SrsSummary, Summary, Timing};
    use crate::scenario::LoadedScenario;

    /// A mission of the paper's scenario with one limit missed.
    fn example() -> Summary {
        let mut summary = Summary {
            scenario: "paper".to_owned(),
            seed: 1,
            backend: "inproc".to_owned(),
            drones: 6,
            fleets: 2,
            timing: Timing::new(6300.0, 42.0),
            digest: "00112233445566778899aabbccddeeff".to_owned(),
            warnings: vec!["drone 3 was late".to_owned()],
            ..Summary::default()
        };
        summary.sweep.split = "length".to_owned();
        summary.sweep.coverage_fraction = 1.0 - 1e-10;
        summary.sweep.duration_s = 5820.0;
        summary.sweep.mission_time_s = 5950.0;
        summary.sweep.length_m = vec![58_182.0, 58_182.0];
        summary.sweep.replans = vec![ReplanSummary {
            at_s: 916.6,
            broken_by: vec![2],
            users_gone: 0,
            fleets: 1,
            left_m2: 81.5e6,
            delay_s: Some(4_711.4),
        }];
        summary.lost = vec![LostDrone { drone: 2, at_s: 901.64 }];
        summary.srs = SrsSummary { hits: 143_210, misses: 1_234, gated: 3_456, ..SrsSummary::default() };
        let found = &mut summary.localization;
        (found.users, found.located) = (500, 499);
        found.rmse_m = Some(3.25);
        (found.r95_median_m, found.r95_p95_m) = (Some(6.0), Some(11.5));
        (found.crlb_ratio, found.in_r95_fraction) = (Some(1.04), Some(0.951));
        found.status_counts = [("ok".to_owned(), 499), ("poor_geometry".to_owned(), 1)].into();
        let placement = &mut summary.placement;
        placement.method = "joint".to_owned();
        placement.drones = vec![PlacedDrone { id: 1, x_m: 1234.56, y_m: 9876.5 }];
        (placement.served_guaranteed, placement.served_actual, placement.upper_bound) = (61, 63, 61);
        placement.proved_optimal = true;
        (placement.optimum_on_truth, placement.served_ratio) = (Some(64), Some(63.0 / 64.0));
        summary.safety.min_separation_m = Some(21.5);
        summary.safety.min_obstacle_distance_m = Some(12.25);
        summary.safety.min_fence_distance_m = Some(110.0);
        summary.safety.formation_error_rms_m = 0.4;
        summary.safety.formation_error_max_m = 5.2;
        summary.limits = judge(&LoadedScenario::paper().scenario.limits, &summary);
        summary
    }

    #[test]
    fn text_for_people() {
        insta::assert_snapshot!(example());
    }

    #[test]
    fn json_for_scripts() {
        insta::assert_snapshot!(example().to_json());
    }

    #[test]
    fn nearly_all_is_not_all() {
        assert_eq!(super::percent(0.999_99), "99.99 %");
        assert_eq!(super::percent(1.0 - 1e-10), "100.00 %");
        assert_eq!(super::percent(0.29), "29.00 %");
    }

    #[test]
    fn numbers_are_short_and_exact() {
        assert_eq!(super::plain(15.0), "15");
        assert_eq!(super::plain(0.999_999_999), "0.999999999");
        assert_eq!(super::plain(0.0), "0");
    }
}
