//! Everything that was lost between the file and the answer, and what looks wrong about the file.

use crate::control::captures::{Captures, Prepared};
use crate::control::localize::{ClockModel, Localization, LocalizeConfig, MAX_CAPTURES};

/// Late captures make some occasions implausible, and clocks that differ most of them.
const SUSPICIOUS_SHARE: f64 = 1.0 / 3.0;

/// One line for each.
pub(super) fn collect(
    captures: &Captures,
    prepared: &Prepared,
    config: &LocalizeConfig,
    localization: &Localization,
) -> Vec<String> {
    let synchronised = config.clock == ClockModel::Synchronised;
    let mut warnings = Vec::new();
    if let Some((count, line)) = captures.repeated {
        warnings.push(format!(
            "rows that repeat an earlier one exactly, left out: {count}, the first in line {line}"
        ));
    }
    if prepared.heard_alone > 0 {
        let occasions = occasions(prepared.heard_alone);
        warnings.push(format!("{occasions} heard by one drone alone: no difference of arrivals, not used"));
    }
    if prepared.divided > 0 {
        let (occasions, lost) = (occasions(prepared.divided), prepared.differences_lost);
        warnings.push(format!(
            "{occasions} heard by more than {MAX_CAPTURES} drones: divided among them, at the cost of {lost} of their \
             differences of arrivals"
        ));
    }
    let most = SUSPICIOUS_SHARE * prepared.heard_together as f64;
    if synchronised && prepared.implausible > 0 && prepared.implausible as f64 >= most {
        let (implausible, all) = (occasions(prepared.implausible), prepared.heard_together);
        warnings.push(format!(
            "{implausible} of {all} have arrivals further apart than the way between the drones allows: where the drones' \
             clocks differ, say --clock shared-constant or --clock shared-linear"
        ));
    }
    let untied: Vec<&str> =
        captures.drones.iter().filter(|drone| !drone.tied).map(|drone| drone.id.as_str()).collect();
    if let (false, Some(reference)) = (untied.is_empty(), captures.drones.first()) {
        let consequence =
            if synchronised { "nothing checks their clocks" } else { "their clocks stay unknown" };
        warnings.push(format!(
            "drones never heard anyone together with {:?} or those tied to it, {consequence}: {}",
            reference.id,
            listed(&untied)
        ));
    }
    warnings.extend(localization.warnings.iter().cloned());
    warnings
}

fn occasions(count: usize) -> String {
    if count == 1 { "1 occasion".to_owned() } else { format!("{count} occasions") }
}

/// Names in quotes, the first few of them.
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = names.iter().take(SHOWN).map(|name| format!("{name:?}")).collect();
    let more = names.len().saturating_sub(SHOWN);
    if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
}
