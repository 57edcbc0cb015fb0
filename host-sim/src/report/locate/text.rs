//! Located users for people: how many, how well, the worst of them, the clocks, and what was lost.

use std::fmt;

use super::{LocateReport, LocatedUser, STATUSES, clock_name};
use crate::control::localize::{ClockModel, FixStatus};
use crate::report::figures::{quantile, status_name};

/// Up to this many users are all listed.
const LISTED: usize = 20;
/// Of more users these many are.
const WORST: usize = 10;

impl fmt::Display for LocateReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { source, users, drones, occasions, captures, epochs_s, .. } = self;
        let (located, all) = (self.count(FixStatus::Ok), users.len());
        writeln!(f, "Located {located} of {all} users of {source}")?;
        writeln!(
            f,
            "{captures} captures of {} drones over {:.1} s, {occasions} occasions heard by two or more",
            drones.len(),
            epochs_s[1] - epochs_s[0]
        )?;
        self.statuses(f)?;
        self.list(f)?;
        self.clocks(f)?;
        self.warnings.iter().try_for_each(|warning| writeln!(f, "\nWarning: {warning}"))
    }
}

impl LocateReport {
    fn statuses(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nUsers")?;
        let r95_m = self.r95_m();
        for status in STATUSES {
            let count = self.count(status);
            let radii = match (quantile(&r95_m, 0.5), quantile(&r95_m, 0.95), r95_m.last()) {
                (Some(median), Some(p95), Some(most)) if status == FixStatus::Ok => {
                    format!(
                        "  95 % radius {median:.1} m median, {p95:.1} m 95th percentile, {most:.1} m at most"
                    )
                }
                _ => String::new(),
            };
            if count > 0 || status == FixStatus::Ok {
                writeln!(f, "  {:<14}{count:>7}{radii}", status_name(status))?;
            }
        }
        Ok(())
    }

    /// All users where they are few, otherwise those that claim no position and the widest circles.
    fn list(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut listed: Vec<&LocatedUser> = self.users.iter().collect();
        if listed.len() > LISTED {
            let radius_m = |user: &LocatedUser| user.position.map_or(f64::INFINITY, |it| it.r95_m);
            listed.sort_by(|a, b| {
                let ok = |user: &LocatedUser| user.status == FixStatus::Ok;
                ok(a).cmp(&ok(b)).then(radius_m(b).total_cmp(&radius_m(a)))
            });
            listed.truncate(WORST);
            writeln!(f, "\nThe {WORST} worst of them")?;
        } else {
            writeln!(f)?;
        }
        let width = listed.iter().map(|user| user.id.chars().count()).fold("user".len(), usize::max).min(40);
        writeln!(
            f,
            "  {:<width$}  {:<14}{:>13}{:>13}{:>10}{:>11}{:>10}",
            "user", "status", "east", "north", "r95", "occasions", "rejected"
        )?;
        for user in listed {
            let metres = |value: Option<f64>, places: usize| {
                value.map_or_else(|| "-".to_owned(), |value| format!("{value:.places$} m"))
            };
            writeln!(
                f,
                "  {:<width$}  {:<14}{:>13}{:>13}{:>10}{:>11}{:>10}",
                user.id,
                status_name(user.status),
                metres(user.position.map(|it| it.pos_m[0]), 1),
                metres(user.position.map(|it| it.pos_m[1]), 1),
                metres(user.position.map(|it| it.r95_m), 1),
                user.occasions,
                user.rejected
            )?;
        }
        Ok(())
    }

    fn clocks(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let model = clock_name(self.config.clock);
        let Some(reference) = self.drones.first() else { return Ok(()) };
        if self.config.clock == ClockModel::Synchronised {
            return writeln!(f, "\nClocks: taken as synchronised (--clock {model})");
        }
        writeln!(
            f,
            "\nClocks ({model}) against drone {:?} at epoch {:.3} s",
            reference.id, self.reference_epoch_s
        )?;
        let width =
            self.drones.iter().map(|drone| drone.id.chars().count()).fold("drone".len(), usize::max).min(40);
        let with_drift = matches!(self.config.clock, ClockModel::SharedWander { .. });
        let drift = if with_drift { format!("{:>18}", "drift") } else { String::new() };
        writeln!(f, "  {:<width$}{:>18}{drift}", "drone", "offset")?;
        for drone in &self.drones {
            let offset = drone
                .line
                .map_or_else(|| "unknown".to_owned(), |[offset_ns, _]| format!("{offset_ns:.2} ns"));
            let drift = match drone.line {
                Some([_, drift]) if with_drift => format!("{:>18}", format!("{drift:.4} ns/s")),
                _ => String::new(),
            };
            writeln!(f, "  {:<width$}{offset:>18}{drift}", drone.id)?;
        }
        Ok(())
    }
}
