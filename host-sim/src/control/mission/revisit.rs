//! Users on foot who have gone on since they were heard: where fleets look once more before drones are placed.
//!
//! What is known of a user on foot is lost with time, and a sweep takes its time: flown once more as a whole it would find the
//! first users and lose the last. So only those are looked for again for whom it matters: when the lanes are flown, drones are placed
//! tentatively, and where they would serve users that may have walked too far for anybody to count on, the fleets fly there,
//! as they fly the rest of a sweep that was planned anew ([`super::replan`]). Nobody flies on a charge that the second
//! stage needs.

use super::{ControlCenter, MissionError, plan::Revisit, replan::LEAST_PERMILLE};
use crate::{
    control::{
        localize::{FixStatus, localize},
        place::{Fleet, UserBelief, place_expected},
        regroup,
    },
    geometry::{V2, coverage::Stadium, polygon::Polygon},
};
use nalgebra::Matrix2;
use skyroost_protocol::units::TimePs;
use std::f64::consts::TAU;

/// Charge that has to be left for the second stage beside what a drone needs to join it, per mille.
const TO_SERVE_PERMILLE: f64 = 100.0;
/// Corners of what is flown over for a site: a polygon around its circle of coverage.
const CORNERS: u32 = 16;

impl ControlCenter {
    /// Whether there are users to be looked for again; then what is left of the sweep is where they were.
    ///
    /// # Errors
    /// As where users are located and drones are placed in the end.
    pub(super) fn is_anybody_gone(&mut self, now: TimePs) -> Result<bool, MissionError> {
        let Revisit { r95_m, most } = self.plan.revisit;
        let cfg = self.plan.localize;
        let Some(again) = self.plan.resweep.as_ref() else { return Ok(false) };
        let drones = self.living().len();
        if cfg.motion.is_still() || self.progress.revisits >= most || !self.may_replan() || drones == 0 {
            return Ok(false);
        }
        let mut found = localize(&self.occasions, &cfg)?;
        found.grow(now.0 as f64 * 1e-12, &cfg);
        let located = found.users.iter().filter(|fix| fix.status == FixStatus::Ok);
        let belief = |[[xx, xy], [yx, yy]]: [[f64; 2]; 2]| Matrix2::new(xx, xy, yx, yy);
        let beliefs: Vec<UserBelief> = located
            .clone()
            .map(|fix| UserBelief { pos_m: fix.pos_m.into(), cov_m2: belief(fix.cov_m2) })
            .collect();
        let fleet = Fleet { drones, min_separation_m: self.plan.min_goal_distance_m };
        let placement = place_expected(&beliefs, self.plan.radius_m, fleet)?;
        let sites_m: Vec<V2> = placement.sites.iter().flatten().map(|site| site.pos_m).collect();
        let served = |at: &V2| sites_m.iter().any(|site| (site - at).norm() <= self.plan.radius_m);
        let gone_m: Vec<V2> =
            located.filter(|fix| fix.r95_m > r95_m).map(|fix| fix.pos_m.into()).filter(served).collect();
        let rounds: Vec<Polygon> =
            sites_m.iter().filter_map(|site| around(*site, self.plan.radius_m)).collect();
        let fresh = self.swept_since(now.since(TimePs((1e12 * cfg.motion.known_for_s(r95_m)) as i64)));
        let expired = again
            .region
            .within(&rounds)
            .and_then(|region| regroup::left(&region, &fresh, again.request.margin_m))
            .and_then(|region| region.keep(|part| gone_m.iter().any(|at| part.contains(*at))))
            .filter(|region| self.is_charged_for(region.area_m2() / again.region.area_m2()));
        let Some(expired) = expired else { return Ok(false) };
        self.progress.revisits += 1;
        self.progress.gone = gone_m.len();
        self.progress.expired = Some(expired);
        self.progress.forget_swept();
        Ok(true)
    }

    /// What the fleets have covered since then, of the plan that they fly.
    fn swept_since(&self, since: TimePs) -> Vec<Stadium> {
        let way_m = |(_, mm): &(TimePs, i64)| *mm as f64 * 1e-3;
        let radius_m = self.swept_radius_m();
        let fleets = self.plan.fleets.iter().zip(self.progress.came_mm());
        fleets
            .flat_map(|(fleet, came)| {
                let before = came.partition_point(|(at, _)| *at < since);
                let from_m = before.checked_sub(1).map_or(0.0, |last| way_m(&came[last]));
                let to_m = came.last().map_or(0.0, way_m);
                regroup::swept(&fleet.waypoints_m, from_m..to_m, radius_m)
            })
            .collect()
    }

    /// Whether every drone of a fleet can fly such a share of the area again, at twice what its area has cost so far for the
    /// ways between, and serve after it.
    fn is_charged_for(&self, share: f64) -> bool {
        self.every_member().all(|link| {
            let Some(telemetry) = link.telemetry else { return false };
            let charge = f64::from(telemetry.battery_permille);
            charge - 2.0 * share * (1_000.0 - charge) >= f64::from(LEAST_PERMILLE) + TO_SERVE_PERMILLE
        })
    }
}

/// A polygon around a circle.
fn around(centre_m: V2, radius_m: f64) -> Option<Polygon> {
    let step = TAU / f64::from(CORNERS);
    let corner_m = radius_m / (0.5 * step).cos();
    let corner = |k: u32| {
        let (sin, cos) = (f64::from(k) * step).sin_cos();
        centre_m + corner_m * V2::new(cos, sin)
    };
    Polygon::new(&(0..CORNERS).map(corner).collect::<Vec<_>>()).ok()
}
