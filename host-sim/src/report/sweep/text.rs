//! A sweep for people: what it takes, what it covers, and whether it fits the time there is.

use std::fmt;

use super::{ModeTried, SweepReport, name, percent};
use crate::geometry::polygon::modulo_pi;
use crate::runner::formation::FLEET_DRONES;

impl fmt::Display for SweepReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { area_name, area, plan, .. } = self;
        let fleets = match plan.sub_areas.len() {
            1 => "1 fleet".to_owned(),
            fleets => format!("{fleets} fleets"),
        };
        let area = square_km(area.region.area_m2());
        writeln!(
            f,
            "Sweep of {area_name}: {area}, {fleets} of {FLEET_DRONES} drones, split by {}",
            name(plan.split)
        )?;
        self.plan(f)?;
        self.fleets(f)?;
        self.modes(f)?;
        let left_out = &self.area.left_out;
        left_out.iter().try_for_each(|it| writeln!(f, "\nLeft out of the file: {it}"))
    }
}

impl SweepReport {
    fn plan(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { request, plan, altitude_m, .. } = self;
        writeln!(f, "\nPlan")?;
        if let Some((link, disk)) = &self.link {
            let (mhz, loss_db) = (link.frequency_hz / 1e6, link.max_path_loss_db);
            row(
                f,
                "link",
                format!(
                    "{mhz} MHz, at most {loss_db} dB, met down to {:.2} degrees of elevation",
                    disk.elevation_deg
                ),
            )?;
        }
        row(
            f,
            "drones",
            format!("reach {:.1} m on the ground from {altitude_m:.1} m above it", request.radius_m),
        )?;
        let margin = match request.margin_m {
            margin_m if margin_m > 0.0 => format!(", less {margin_m} m of margin on either side"),
            _ => String::new(),
        };
        row(f, "swath", format!("{:.2} m under all three drones of a fleet{margin}", plan.swath_m))?;
        row(f, "coverage", format!("{} of the area", percent(plan.covered_fraction)))?;
        if plan.covered_fraction < 1.0 {
            row(f, "", "sweep.svg and sweep.geojson (--out) show what is left")?;
        }
        if let Some(separation_m) = plan.separation_m {
            row(
                f,
                "separation",
                format!("{separation_m:.0} m between fleets at least, when all begin their lanes at once"),
            )?;
        }
        Ok(())
    }

    fn fleets(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nFleets at {} m/s", self.request.speed_mps)?;
        writeln!(
            f,
            "  {:<6}{:>9}{:>13}{:>10}{:>13}{:>7}{:>11}{:>11}{:>11}",
            "fleet", "share", "area", "lanes at", "lanes", "turns", "time", "way there", "way back"
        )?;
        for sub_area in &self.plan.sub_areas {
            let [transit_m, return_m] = self.transits_m(sub_area);
            writeln!(
                f,
                "  {:<6}{:>9}{:>13}{:>10}{:>13}{:>7}{:>11}{:>11}{:>11}",
                sub_area.fleet + 1,
                percent(sub_area.proportion),
                square_km(sub_area.area_m2),
                format!("{:.1} deg", modulo_pi(sub_area.direction_rad).to_degrees()),
                metres(sub_area.length_m),
                sub_area.turns,
                minutes(sub_area.duration_s),
                metres(transit_m),
                metres(return_m),
            )?;
        }
        Ok(())
    }

    fn modes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nMission time {} for the lanes of every fleet", minutes(self.mission_time_s))?;
        for ModeTried { split, figures } in &self.modes {
            let label = format!("by {}", name(*split));
            let taken = if *split == self.plan.split { " (taken)" } else { "" };
            match figures {
                Ok(figures) => {
                    let over_s = figures.duration_s - self.mission_time_s;
                    let verdict = if self.meets(figures.duration_s) {
                        format!("meets it, {} to spare", minutes(-over_s))
                    } else {
                        format!("MISSES it by {}", minutes(over_s))
                    };
                    row(f, &label, format!("{:>10}  {verdict}{taken}", minutes(figures.duration_s)))?;
                }
                Err(why) => row(f, &label, format!("no such plan: {why}"))?,
            }
        }
        Ok(())
    }
}

/// One aligned line.
fn row(f: &mut fmt::Formatter<'_>, label: &str, value: impl fmt::Display) -> fmt::Result {
    writeln!(f, "  {label:<14} {value}")
}

fn metres(length_m: f64) -> String {
    format!("{length_m:.0} m")
}

fn minutes(time_s: f64) -> String {
    format!("{:.2} min", time_s / 60.0)
}

fn square_km(area_m2: f64) -> String {
    format!("{:.3} km2", area_m2 / 1e6)
}
