//! How well a formation locates, for scripts: metres and nanoseconds, null where captures do not determine a position.

use serde::Serialize;

use crate::control::accuracy::{Accuracy, Formation, OffsetRow, SYNC_USERS, Sync, USERS_PER_KM2};

#[derive(Serialize)]
struct Study<'a> {
    spacing_m: f64,
    altitude_m: f64,
    sigma_ns: f64,
    speed_mps: f64,
    radius_m: f64,
    srs_period_s: f64,
    swath_m: f64,
    sync_users: usize,
    sync_users_per_km2: f64,
    offset_m: &'a [f64],
    srs: &'a [usize],
    one_srs: Radii<'a>,
    pass: Radii<'a>,
    sigma: Vec<Noise<'a>>,
    sync: Vec<Clocks<'a>>,
    drone_bias: Vec<DroneBias<'a>>,
    terrain: Vec<Terrain<'a>>,
    trade_off: Vec<TradeOff>,
}

/// One radius for each of `offset_m`; JSON has no infinity, and serde writes null for it.
#[derive(Serialize)]
struct Radii<'a> {
    r95_m: &'a [f64],
}

#[derive(Serialize)]
struct Noise<'a> {
    sigma_ns: f64,
    r95_m: &'a [f64],
}

#[derive(Serialize)]
struct Clocks<'a> {
    clocks: &'static str,
    /// Of trusted clocks.
    #[serde(skip_serializing_if = "Option::is_none")]
    residual_ns: Option<f64>,
    r95_m: &'a [f64],
}

#[derive(Serialize)]
struct DroneBias<'a> {
    drone_bias_sigma_m: f64,
    r95_m: &'a [f64],
}

#[derive(Serialize)]
struct Terrain<'a> {
    user_altitude_sigma_m: f64,
    r95_m: &'a [f64],
}

#[derive(Serialize)]
struct TradeOff {
    spacing_m: f64,
    altitude_m: f64,
    swath_m: f64,
    r95_median_m: f64,
    r95_worst_m: f64,
}

/// See [`super::AccuracyReport::to_json`].
pub(super) fn render(accuracy: &Accuracy) -> String {
    let Formation { spacing_m, altitude_m, speed_mps, radius_m, srs_period_s, sigma_toa_ns, .. } =
        accuracy.formation;
    let study = Study {
        spacing_m,
        altitude_m,
        sigma_ns: sigma_toa_ns,
        speed_mps,
        radius_m,
        srs_period_s,
        swath_m: 2.0 * accuracy.formation.swath_radius_m(),
        sync_users: SYNC_USERS,
        sync_users_per_km2: USERS_PER_KM2,
        offset_m: &accuracy.offset_m,
        srs: &accuracy.srs,
        one_srs: Radii { r95_m: &accuracy.one_srs_m },
        pass: Radii { r95_m: &accuracy.pass_m },
        sigma: rows(&accuracy.sigma, |sigma_ns, r95_m| Noise { sigma_ns, r95_m }),
        sync: rows(&accuracy.sync, |sync, r95_m| match sync {
            Sync::Known => Clocks { clocks: "known", residual_ns: None, r95_m },
            Sync::ConstantOffsets => Clocks { clocks: "shared-constant", residual_ns: None, r95_m },
            Sync::Mission => Clocks { clocks: "mission", residual_ns: None, r95_m },
            Sync::Residual(ns) => Clocks { clocks: "trusted", residual_ns: Some(ns), r95_m },
        }),
        drone_bias: rows(&accuracy.drone_bias, |drone_bias_sigma_m, r95_m| DroneBias {
            drone_bias_sigma_m,
            r95_m,
        }),
        terrain: rows(&accuracy.terrain, |user_altitude_sigma_m, r95_m| Terrain {
            user_altitude_sigma_m,
            r95_m,
        }),
        trade_off: (accuracy.trade_off.iter())
            .map(|it| TradeOff {
                spacing_m: it.spacing_m,
                altitude_m: it.altitude_m,
                swath_m: it.swath_m,
                r95_median_m: it.r95_median_m,
                r95_worst_m: it.r95_worst_m,
            })
            .collect(),
    };
    serde_json::to_string_pretty(&study).expect("plain data serializes") + "\n"
}

fn rows<'a, T: Copy, R>(rows: &'a [OffsetRow<T>], row: impl Fn(T, &'a [f64]) -> R) -> Vec<R> {
    rows.iter().map(|it| row(it.of, &it.r95_m)).collect()
}
