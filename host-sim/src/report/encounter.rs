//! An encounter for scripts and people.

use std::fmt;

use serde::Serialize;

use crate::encounter::Outcome;

/// What came of an encounter.
#[derive(Clone, Debug)]
pub struct EncounterReport {
    /// Where it comes from, for people.
    pub source: String,
    /// Separation that was to be kept, metres.
    pub d_safe_m: f64,
    /// What avoided.
    pub avoidance: &'static str,
    /// What came of it.
    pub outcome: Outcome,
}

#[derive(Serialize)]
struct Answer<'a> {
    /// Null where there is no pair of which one cooperates.
    min_separation_m: Option<f64>,
    violations: usize,
    vehicles: usize,
    arrived: usize,
    /// Null for one that did not arrive.
    arrival_s: &'a [Option<f64>],
    overhead_fraction: f64,
    d_safe_m: f64,
    avoidance: &'static str,
}

impl EncounterReport {
    fn arrived(&self) -> usize {
        self.outcome.arrival_s.iter().flatten().count()
    }

    /// The answer as one JSON object, with a line's end.
    ///
    /// # Panics
    /// Never: plain data serializes.
    #[must_use]
    pub fn to_json(&self) -> String {
        let Outcome { min_separation_m, violations, arrival_s, overhead_fraction } = &self.outcome;
        let answer = Answer {
            min_separation_m: *min_separation_m,
            violations: *violations,
            vehicles: arrival_s.len(),
            arrived: self.arrived(),
            arrival_s,
            overhead_fraction: *overhead_fraction,
            d_safe_m: self.d_safe_m,
            avoidance: self.avoidance,
        };
        serde_json::to_string(&answer).expect("plain data serializes") + "\n"
    }
}

impl fmt::Display for EncounterReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Outcome { min_separation_m, violations, arrival_s, overhead_fraction } = &self.outcome;
        writeln!(f, "{} vehicles of {}, avoidance {}", arrival_s.len(), self.source, self.avoidance)?;
        if let Some(least_m) = min_separation_m {
            let kept =
                if *violations == 0 { "kept".to_owned() } else { format!("broken by {violations} pairs") };
            writeln!(f, "  separation   {least_m:.2} m at least; {} m {kept}", self.d_safe_m)?;
        }
        let last_s = arrival_s.iter().flatten().copied().fold(0.0, f64::max);
        writeln!(
            f,
            "  arrived      {} of {}, the last after {last_s:.1} s",
            self.arrived(),
            arrival_s.len()
        )?;
        writeln!(f, "  overhead     {:.2} % more time than alone", 100.0 * overhead_fraction)
    }
}
