//! Figures as tables in Markdown, which people can read as they are.

use std::fmt::Write as _;

use super::{CampaignReport, counted, distinct, distinct_comparisons, title};
use crate::campaign::figures::{Comparison, Count, Figure};
use crate::campaign::statistics::Estimate;

/// The page: a table and the crossovers of each figure.
pub(super) fn render(report: &CampaignReport) -> String {
    let mut page = String::new();
    for figure in &report.figures {
        let _ = writeln!(
            page,
            "### r_e = {} m, {} drones\n\n![users served against the density]({})\n",
            figure.r_e_m,
            figure.drones,
            report.picture_file(figure)
        );
        table(&mut page, figure);
        for comparison in distinct_comparisons(figure) {
            let _ = writeln!(page, "- {}", sentence(comparison, figure));
        }
        page.push('\n');
    }
    page.truncate(page.trim_end().len());
    page + "\n"
}

/// A row for each density, a column for each curve.
fn table(page: &mut String, figure: &Figure) {
    let curves: Vec<_> = distinct(figure).collect();
    let names = curves.iter().map(|curve| {
        let count = counted(curve.method, curve.count);
        if figure.r_e_m > 0.0 || curve.method == crate::campaign::plan::Method::Full {
            format!("{}, {count}", title(curve.method))
        } else {
            title(curve.method).to_owned()
        }
    });
    let _ = writeln!(page, "| users per km² | {} |", names.collect::<Vec<_>>().join(" | "));
    let _ = writeln!(page, "|---:|{}", "---:|".repeat(curves.len()));
    let rows = curves.first().map_or(0, |curve| curve.points.len());
    for row in 0..rows {
        let density = curves[0].points[row].0;
        let cells = curves.iter().filter_map(|curve| curve.points.get(row)).map(|(_, it)| estimate(it));
        let _ = writeln!(page, "| {density} | {} |", cells.collect::<Vec<_>>().join(" | "));
    }
    page.push('\n');
}

fn estimate(it: &Estimate) -> String {
    let digits = if it.mean.abs() < 1000.0 { 1 } else { 0 };
    if it.half_width.is_finite() {
        format!("{:.digits$} ± {:.1}", it.mean, it.half_width)
    } else {
        format!("{:.digits$}", it.mean)
    }
}

/// Where a curve meets that of random search.
fn sentence(it: &Comparison, figure: &Figure) -> String {
    let ours = format!("{} ({})", title(it.method), counted(it.method, it.count));
    let theirs = if figure.r_e_m > 0.0 || it.against == Count::Guaranteed {
        format!("random search ({})", counted(crate::campaign::plan::Method::Random, it.against))
    } else {
        "random search".to_owned()
    };
    let least = it.points.iter().map(|(_, estimate)| estimate.mean).fold(f64::INFINITY, f64::min);
    match it.crossover {
        Some(crossover) => {
            let [low, high] = crossover.interval;
            let high =
                if high.is_finite() { format!("{high:.0}") } else { "beyond the last density".to_owned() };
            format!(
                "{ours} falls below {theirs} at **{:.0} users/km²** (95 % interval {low:.0} to {high}).",
                crossover.at
            )
        }
        None if least > 0.0 => {
            format!("{ours} serves more than {theirs} at every density, by {least:.1} at least.")
        }
        None => format!(
            "{ours} does not fall from above {theirs} to below it; the least difference is {least:.1}."
        ),
    }
}
