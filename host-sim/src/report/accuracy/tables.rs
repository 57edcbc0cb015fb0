//! The tables that an operator chooses a formation by.

use super::table::{Table, wrapped};
use crate::control::accuracy::{Accuracy, Formation, OffsetRow, SYNC_USERS, Sync, TradeOff, USERS_PER_KM2};
use crate::control::localize::{ClockModel, LocalizeConfig};

/// What everything is computed for.
pub(super) fn formation(formation: &Formation) -> String {
    let Formation { spacing_m, altitude_m, speed_mps, radius_m, srs_period_s, sigma_toa_ns, .. } = formation;
    wrapped(&format!(
        "Side d = {spacing_m} m, altitude h = {altitude_m} m above the users, {speed_mps} m/s, radius R = {radius_m} m, \
         an SRS of every user each {srs_period_s} s, arrival times with noise of {sigma_toa_ns} ns: a swath of {:.0} m.",
        2.0 * formation.swath_radius_m()
    ))
}

/// All tables, in the order in which they are read.
pub(super) fn all(accuracy: &Accuracy) -> Vec<Table> {
    vec![
        passes(accuracy),
        noise(accuracy),
        clocks(accuracy),
        positions(accuracy),
        terrain(accuracy),
        trade_off(accuracy),
    ]
}

/// Three digits, two decimals at most; nothing where captures do not determine a position.
fn metres(radius_m: f64) -> String {
    match radius_m {
        r if !r.is_finite() => "-".to_owned(),
        r if r < 9.995 => format!("{r:.2}"),
        r if r < 99.95 => format!("{r:.1}"),
        r => format!("{r:.0}"),
    }
}

/// A table of radii against the distance from the lane.
fn against_offset(
    accuracy: &Accuracy,
    title: &'static str,
    note: String,
    name: &str,
    rows: Vec<(String, Vec<String>)>,
) -> Table {
    let offsets = accuracy.offset_m.iter().map(|offset_m| format!("{} m", round(*offset_m)));
    Table { title, note, heads: std::iter::once(name.to_owned()).chain(offsets).collect(), rows }
}

/// Without the noise of its last digits.
fn round(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

fn row(name: impl Into<String>, radii_m: &[f64]) -> (String, Vec<String>) {
    (name.into(), radii_m.iter().map(|&radius_m| metres(radius_m)).collect())
}

fn rows<T>(rows: &[OffsetRow<T>], name: impl Fn(&T) -> String) -> Vec<(String, Vec<String>)> {
    rows.iter().map(|it| row(name(&it.of), &it.r95_m)).collect()
}

fn passes(accuracy: &Accuracy) -> Table {
    let sigma_ns = accuracy.formation.sigma_toa_ns;
    let per_ns = |radii_m: &[f64]| radii_m.iter().map(|radius_m| radius_m / sigma_ns).collect::<Vec<f64>>();
    let note = format!(
        "r95 in metres by the user's distance from the lane: of one SRS with the fleet abreast, and of all SRS while \
         the fleet passes. Clocks, the drones' positions and the height of the ground are known; radii are then \
         proportional to the noise ({sigma_ns} ns, and for one nanosecond)."
    );
    let rows = vec![
        ("SRS of a pass".to_owned(), accuracy.srs.iter().map(usize::to_string).collect()),
        row("one SRS", &accuracy.one_srs_m),
        row("whole pass", &accuracy.pass_m),
        row("one SRS, per ns", &per_ns(&accuracy.one_srs_m)),
        row("whole pass, per ns", &per_ns(&accuracy.pass_m)),
    ];
    against_offset(accuracy, "One SRS and a whole pass", note, "from the lane", rows)
}

fn noise(accuracy: &Accuracy) -> Table {
    let note = format!(
        "r95 of a whole pass by the noise of arrival times. The clocks are unknown as in missions, {}.",
        estimated()
    );
    let rows = rows(&accuracy.sigma, |ns| format!("{ns} ns"));
    against_offset(accuracy, "Noise of arrival times", note, "noise", rows)
}

/// How unknown clocks get known.
fn estimated() -> String {
    format!("and estimated with {SYNC_USERS} users along the lane ({USERS_PER_KM2} per km2)")
}

fn clocks(accuracy: &Accuracy) -> Table {
    let mission = match LocalizeConfig::default().clock {
        ClockModel::SharedWander { offset_sigma_ns, drift_sigma_ns_per_s, walk_ns_per_sqrt_s } => format!(
            "an offset ({offset_sigma_ns} ns), a drift ({drift_sigma_ns_per_s} ns/s) and a random walk \
             ({walk_ns_per_sqrt_s} ns after a second)"
        ),
        ClockModel::SharedConstant => "a constant offset".to_owned(),
        ClockModel::Synchronised => "nothing".to_owned(),
    };
    let note = format!(
        "r95 of a whole pass by what is known of the drones' clocks. Unknown are a constant offset of any size or, as in \
         missions, {mission} of each drone, {}. Trusted clocks are taken as synchronised; each is off by \
         a constant of that standard deviation, which the captures of a user hardly show.",
        estimated()
    );
    let name = |sync: &Sync| match sync {
        Sync::Known => "known".to_owned(),
        Sync::ConstantOffsets => "constant offsets, estimated".to_owned(),
        Sync::Mission => "as in missions, estimated".to_owned(),
        Sync::Residual(ns) => format!("trusted, off by {ns} ns"),
    };
    against_offset(accuracy, "Clocks", note, "clocks", rows(&accuracy.sync, name))
}

fn positions(accuracy: &Accuracy) -> Table {
    let note = "r95 of a whole pass by the error of each coordinate of each drone's position, constant over the pass: RTK is \
                good to about 0.02 m, a standalone receiver to 1.5 m. Clocks are known."
        .to_owned();
    let rows = rows(&accuracy.drone_bias, |bias_m| match bias_m {
        0.0 => "exact".to_owned(),
        _ => format!("{bias_m} m"),
    });
    against_offset(accuracy, "Positions of the drones", note, "error", rows)
}

fn terrain(accuracy: &Accuracy) -> Table {
    let note = "r95 of a whole pass by how well the height of the ground is known (standard deviation). Where it is not, \
                it is estimated with the position. Clocks are known."
        .to_owned();
    let rows = rows(&accuracy.terrain, |sigma_m| match sigma_m {
        0.0 => "known".to_owned(),
        _ => format!("{sigma_m} m"),
    });
    against_offset(accuracy, "Height of the ground", note, "height", rows)
}

fn trade_off(accuracy: &Accuracy) -> Table {
    let Accuracy { formation, trade_off, .. } = accuracy;
    let note = format!(
        "r95 of a whole pass by side d and altitude h, {} ns, clocks known: median / worst of users spread evenly from \
         the lane to 95 % of half the swath. A larger side makes the swath, 2 (R - d / sqrt(3)), narrower.",
        formation.sigma_toa_ns
    );
    let by_spacing: Vec<&[TradeOff]> =
        trade_off.chunk_by(|a, b| a.spacing_m.to_bits() == b.spacing_m.to_bits()).collect();
    let altitudes = by_spacing.first().copied().unwrap_or_default();
    let heads = ["d".to_owned(), "swath".to_owned()].into_iter();
    let heads = heads.chain(altitudes.iter().map(|cell| format!("h = {} m", cell.altitude_m)));
    let row = |cells: &&[TradeOff]| {
        let first = cells.first()?;
        let radii = |cell: &TradeOff| format!("{} / {}", metres(cell.r95_median_m), metres(cell.r95_worst_m));
        let swath = std::iter::once(format!("{:.0} m", first.swath_m));
        Some((format!("{} m", first.spacing_m), swath.chain(cells.iter().map(radii)).collect()))
    };
    Table {
        title: "Side and altitude",
        note,
        heads: heads.collect(),
        rows: by_spacing.iter().filter_map(row).collect(),
    }
}
