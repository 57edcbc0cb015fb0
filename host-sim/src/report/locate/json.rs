//! Located users for scripts: metres in the file's own frame (east, north), a line for each user.

use serde::{Serialize, Serializer};

use super::{LocateReport, LocatedUser, STATUSES, clock_name};
use crate::control::localize::{LocalizeConfig, Robust};
use crate::report::figures::{quantile, status_name};

#[derive(Serialize)]
struct User<'a> {
    id: &'a str,
    /// Position, covariance and radius are null where there is nothing to guess from.
    x_m: Option<f64>,
    y_m: Option<f64>,
    cov_m2: Option<[[f64; 2]; 2]>,
    r95_m: Option<f64>,
    status: &'static str,
    occasions: u32,
    captures: u32,
    rejected: u32,
}

#[derive(Serialize)]
struct Clock<'a> {
    model: &'static str,
    reference_drone: Option<&'a str>,
    reference_epoch_s: f64,
    #[serde(serialize_with = "in_order")]
    offset_ns: Vec<(&'a str, Option<f64>)>,
    #[serde(serialize_with = "in_order")]
    drift_ns_per_s: Vec<(&'a str, Option<f64>)>,
}

#[derive(Serialize)]
struct Summary {
    users: usize,
    #[serde(serialize_with = "in_order")]
    statuses: Vec<(&'static str, usize)>,
    /// Of the users that are `ok`.
    r95_median_m: Option<f64>,
    r95_p95_m: Option<f64>,
    occasions: usize,
    captures: usize,
    first_epoch_s: f64,
    last_epoch_s: f64,
}

#[derive(Serialize)]
struct Options {
    user_altitude_m: f64,
    drone_pos_sigma_m: f64,
    robust: &'static str,
    max_r95_m: f64,
}

#[derive(Serialize)]
struct Origin {
    lon_deg: f64,
    lat_deg: f64,
}

/// See [`LocateReport::to_json`].
pub(super) fn render(report: &LocateReport) -> String {
    let users: Vec<String> = report.users.iter().map(|located| text(&user(located))).collect();
    let origin = report.frame.map(|frame| frame.origin_lon_lat_deg());
    format!(
        "{{\"users\":[\n{}\n],\n\"clock\":{},\n\"summary\":{},\n\"options\":{},\n\"origin\":{},\n\"warnings\":{}}}\n",
        users.join(",\n"),
        text(&clock(report)),
        text(&summary(report)),
        text(&options(&report.config)),
        text(&origin.map(|[lon_deg, lat_deg]| Origin { lon_deg, lat_deg })),
        text(&report.warnings),
    )
}

fn text(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain data serializes")
}

fn user(located: &LocatedUser) -> User<'_> {
    let LocatedUser { id, status, position, occasions, captures, rejected } = located;
    User {
        id,
        x_m: position.map(|it| it.pos_m[0]),
        y_m: position.map(|it| it.pos_m[1]),
        cov_m2: position.map(|it| it.cov_m2),
        r95_m: position.map(|it| it.r95_m),
        status: status_name(*status),
        occasions: *occasions,
        captures: *captures,
        rejected: *rejected,
    }
}

fn clock(report: &LocateReport) -> Clock<'_> {
    let of_drones = |k: usize| {
        let drones = report.drones.iter();
        drones.map(|drone| (drone.id.as_str(), drone.line.map(|line| line[k]))).collect()
    };
    Clock {
        model: clock_name(report.config.clock),
        reference_drone: report.drones.first().map(|drone| drone.id.as_str()),
        reference_epoch_s: report.reference_epoch_s,
        offset_ns: of_drones(0),
        drift_ns_per_s: of_drones(1),
    }
}

fn summary(report: &LocateReport) -> Summary {
    let r95_m = report.r95_m();
    let [first_epoch_s, last_epoch_s] = report.epochs_s;
    Summary {
        users: report.users.len(),
        statuses: STATUSES.into_iter().map(|status| (status_name(status), report.count(status))).collect(),
        r95_median_m: quantile(&r95_m, 0.5),
        r95_p95_m: quantile(&r95_m, 0.95),
        occasions: report.occasions,
        captures: report.captures,
        first_epoch_s,
        last_epoch_s,
    }
}

fn options(config: &LocalizeConfig) -> Options {
    Options {
        user_altitude_m: config.user_altitude_m,
        drone_pos_sigma_m: config.drone_pos_sigma_m,
        robust: match config.robust {
            Robust::Tukey { .. } => "tukey",
            Robust::None => "none",
        },
        max_r95_m: config.max_r95_m,
    }
}

/// As an object with its members in this order.
fn in_order<T, S>(members: &[(&str, T)], serializer: S) -> Result<S::Ok, S::Error>
where
    T: Copy + Serialize,
    S: Serializer,
{
    serializer.collect_map(members.iter().copied())
}
