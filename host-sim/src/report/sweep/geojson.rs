//! A sweep for maps: GeoJSON (RFC 7946), WGS84.
//!
//! Every feature says what it is by `kind`: `sub_area` and `lanes` of a fleet, `no_fly`, `uncovered`, `pad`.

use serde_json::json;

use super::SweepReport;
use crate::geometry::frame::LocalFrame;
use crate::geometry::region::Part;
use crate::report::earth::{Earth, collection, feature};

/// See [`SweepReport::to_geojson`].
pub(super) fn render(report: &SweepReport, frame: &LocalFrame) -> String {
    let earth = Earth { frame };
    let mut features = Vec::new();
    for sub_area in &report.plan.sub_areas {
        let fleet = sub_area.fleet + 1;
        if let Some(region) = &sub_area.region {
            let parts = region.parts().iter().map(|part: &Part| part.borders_m().collect());
            let properties = json!({
                "kind": "sub_area", "fleet": fleet, "proportion": sub_area.proportion, "area_m2": sub_area.area_m2,
                "covered_fraction": sub_area.covered_fraction,
            });
            features.push(feature(earth.area(parts.collect()), properties));
        }
        let properties = json!({
            "kind": "lanes", "fleet": fleet, "length_m": sub_area.length_m, "turns": sub_area.turns,
            "duration_s": sub_area.duration_s, "altitude_m": report.altitude_m, "speed_mps": report.request.speed_mps,
        });
        features.push(feature(earth.line(&sub_area.path_m), properties));
        let pad = earth.point(report.pads.centre_m(sub_area.fleet));
        features.push(feature(pad, json!({ "kind": "pad", "fleet": fleet })));
    }
    for (zone, polygon) in (1..).zip(report.area.region.no_fly()) {
        let area = earth.area(vec![vec![polygon.vertices_m().to_vec()]]);
        features.push(feature(area, json!({ "kind": "no_fly", "zone": zone })));
    }
    if !report.plan.residue_m.is_empty() {
        let parts = report.plan.residue_m.iter().map(|ring_m| vec![ring_m.clone()]).collect();
        let properties = json!({ "kind": "uncovered", "covered_fraction": report.plan.covered_fraction });
        features.push(feature(earth.area(parts), properties));
    }
    collection(&features)
}
