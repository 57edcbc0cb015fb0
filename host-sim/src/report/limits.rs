//! Judges a mission by the acceptance limits of its scenario.

use super::summary::Summary;
use crate::scenario::LimitsTable;
use serde::Serialize;

/// One acceptance limit and whether it holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LimitOutcome {
    /// The key of the scenario's `[limits]`: ends in `_min` or `_max` and a unit.
    pub name: &'static str,
    /// What the mission reached; none where there was nothing to measure.
    pub value: Option<f64>,
    /// The limit.
    pub limit: f64,
    /// Whether the value keeps the limit.
    pub ok: bool,
    /// Whether the limit is the least or the most.
    #[serde(skip)]
    pub bound: Bound,
}

/// Which side of the limit is good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// The value must reach the limit.
    AtLeast,
    /// The value must not exceed the limit.
    AtMost,
}

/// Judges every limit that the scenario states, in the order of the scenario's table.
///
/// A figure that could not be measured fails its limit, unless there were no users: then limits on
/// users hold, as nothing was left undone.
#[must_use]
pub fn judge(limits: &LimitsTable, summary: &Summary) -> Vec<LimitOutcome> {
    let Summary { sweep, localization: found, placement, safety, .. } = summary;
    let no_users = found.users == 0;
    let located_fraction = (!no_users).then(|| f64::from(found.located) / f64::from(found.users));
    let mut outcomes = Vec::new();
    let mut at = |name, bound, limit: Option<f64>, value: Option<f64>| {
        let Some(limit) = limit else { return };
        let ok = value.map_or(no_users, |value| match bound {
            Bound::AtLeast => value >= limit,
            Bound::AtMost => value <= limit,
        });
        outcomes.push(LimitOutcome { name, value, limit, ok, bound });
    };
    let (least, most) = (Bound::AtLeast, Bound::AtMost);
    let of = |count: Option<u32>| count.map(f64::from);

    at("coverage_fraction_min", least, limits.coverage_fraction_min, Some(sweep.coverage_fraction));
    at("sweep_duration_max_s", most, limits.sweep_duration_max_s, Some(sweep.duration_s));
    at("located_fraction_min", least, limits.located_fraction_min, located_fraction);
    at("in_r95_fraction_min", least, limits.in_r95_fraction_min, found.in_r95_fraction);
    at("r95_median_max_m", most, limits.r95_median_max_m, found.r95_median_m);
    at("crlb_ratio_max", most, limits.crlb_ratio_max, found.crlb_ratio);
    at(
        "served_guaranteed_min",
        least,
        of(limits.served_guaranteed_min),
        of(Some(placement.served_guaranteed)),
    );
    at("violations_max", most, of(limits.violations_max), of(Some(safety.violations)));
    // Where nothing stands there is nothing to keep away from.
    let obstacles = limits.obstacle_distance_min_m.filter(|_| safety.min_obstacle_distance_m.is_some());
    at("obstacle_distance_min_m", least, obstacles, safety.min_obstacle_distance_m);
    at("fence_distance_min_m", least, limits.fence_distance_min_m, safety.min_fence_distance_m);
    at(
        "formation_error_rms_max_m",
        most,
        limits.formation_error_rms_max_m,
        Some(safety.formation_error_rms_m),
    );
    at("formation_error_max_m", most, limits.formation_error_max_m, Some(safety.formation_error_max_m));
    outcomes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_that_fail(limits: &LimitsTable, summary: &Summary) -> Vec<&'static str> {
        judge(limits, summary).into_iter().filter(|outcome| !outcome.ok).map(|outcome| outcome.name).collect()
    }

    #[test]
    fn an_unstated_limit_is_not_judged() {
        assert!(judge(&LimitsTable::default(), &Summary::default()).is_empty());
    }

    #[test]
    fn a_limit_itself_is_kept_and_the_next_number_is_not() {
        let limits = LimitsTable {
            coverage_fraction_min: Some(0.9),
            violations_max: Some(1),
            ..LimitsTable::default()
        };
        let mut summary = Summary::default();
        summary.sweep.coverage_fraction = 0.9;
        summary.safety.violations = 1;
        assert!(names_that_fail(&limits, &summary).is_empty());
        summary.sweep.coverage_fraction = 0.9_f64.next_down();
        summary.safety.violations = 2;
        assert_eq!(names_that_fail(&limits, &summary), ["coverage_fraction_min", "violations_max"]);
    }

    #[test]
    fn what_could_not_be_measured_fails() {
        let limits = LimitsTable { r95_median_max_m: Some(15.0), ..LimitsTable::default() };
        let mut summary = Summary::default();
        summary.localization.users = 10;
        assert_eq!(names_that_fail(&limits, &summary), ["r95_median_max_m"]);
    }

    #[test]
    fn without_obstacles_there_is_no_distance_to_keep() {
        let limits = LimitsTable {
            obstacle_distance_min_m: Some(5.0),
            fence_distance_min_m: Some(0.0),
            ..LimitsTable::default()
        };
        let mut summary = Summary::default();
        summary.localization.users = 10;
        summary.safety.min_fence_distance_m = Some(0.0);
        assert!(names_that_fail(&limits, &summary).is_empty());
        summary.safety.min_obstacle_distance_m = Some(4.9);
        summary.safety.min_fence_distance_m = Some(-0.1);
        assert_eq!(names_that_fail(&limits, &summary), ["obstacle_distance_min_m", "fence_distance_min_m"]);
    }

    #[test]
    fn a_nan_fails_either_way() {
        let limits = LimitsTable {
            coverage_fraction_min: Some(0.5),
            formation_error_max_m: Some(5.0),
            ..LimitsTable::default()
        };
        let mut summary = Summary::default();
        summary.sweep.coverage_fraction = f64::NAN;
        summary.safety.formation_error_max_m = f64::NAN;
        assert_eq!(names_that_fail(&limits, &summary).len(), 2);
    }

    #[test]
    fn an_area_without_users_leaves_nothing_undone() {
        let limits = LimitsTable {
            located_fraction_min: Some(0.99),
            r95_median_max_m: Some(15.0),
            ..LimitsTable::default()
        };
        assert!(names_that_fail(&limits, &Summary::default()).is_empty());
    }
}
