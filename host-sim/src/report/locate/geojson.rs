//! Located users for maps: GeoJSON, WGS84.
//!
//! Every feature says what it is by `kind`: a `user` (a point, with the status that says what it is worth; no
//! geometry where the user was not located) or the `ellipse` that holds a user's 95 %.

use serde_json::{Value, json};

use super::LocateReport;
use crate::control::localize::FixStatus;
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;
use crate::report::earth::{Earth, collection, feature};
use crate::report::figures::status_name;

/// Corners of an ellipse: within 0.4 % of its size.
const CORNERS: u32 = 36;

/// See [`LocateReport::to_geojson`].
pub(super) fn render(report: &LocateReport, frame: &LocalFrame) -> String {
    let earth = Earth { frame };
    let mut features = Vec::with_capacity(2 * report.users.len());
    for user in &report.users {
        let point = user.position.map_or(Value::Null, |it| earth.point(V2::from(it.pos_m)));
        let properties = json!({
            "kind": "user", "id": user.id, "status": status_name(user.status),
            "x_m": user.position.map(|it| it.pos_m[0]), "y_m": user.position.map(|it| it.pos_m[1]),
            "r95_m": user.position.map(|it| it.r95_m), "cov_m2": user.position.map(|it| it.cov_m2), "occasions": user.occasions, "captures": user.captures,
            "rejected": user.rejected,
        });
        features.push(feature(point, properties));
        if let (FixStatus::Ok, Some(position)) = (user.status, &user.position) {
            let ellipse = earth.area(vec![vec![position.ellipse_m(CORNERS)]]);
            let properties = json!({ "kind": "ellipse", "id": user.id, "r95_m": position.r95_m });
            features.push(feature(ellipse, properties));
        }
    }
    collection(&features)
}
