//! Tests of whole plans.

mod any_shape;
mod convex;

use super::{CornerModel, SplitMode, SweepError, SweepPlan, SweepRequest};
use crate::geometry::V2;
use crate::geometry::polygon::Polygon;
use crate::geometry::region::Region;

/// The plan of an area that is one polygon.
pub(super) fn plan(polygon: &Polygon, request: &SweepRequest) -> Result<SweepPlan, SweepError> {
    super::plan(&Region::from(polygon.clone()), request)
}

pub(super) fn request(fleets: usize, split: SplitMode) -> SweepRequest {
    SweepRequest {
        fleets,
        proportions: vec![1.0 / fleets as f64; fleets],
        split,
        radius_m: 500.0,
        spacing_m: 50.0,
        speed_mps: 10.0,
        corner: CornerModel { max_accel_mps2: 3.0, corner_speed_mps: 10.0 },
        margin_m: 0.0,
        entry_m: None,
    }
}

pub(super) fn rectangle(width_m: f64, height_m: f64) -> Polygon {
    let corners = [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]];
    Polygon::new(&corners.map(|[x, y]| V2::new(x, y))).unwrap()
}
