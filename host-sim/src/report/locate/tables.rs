//! Located users as tables: `users.csv` and `located.csv`, metres in the file's own frame.

use super::{LocateReport, LocatedUser};
use crate::report::figures::status_name;
use crate::report::tables::{decimals, split};

const USERS_HEADER: [&str; 11] = [
    "id",
    "x_m",
    "y_m",
    "cov_xx_m2",
    "cov_xy_m2",
    "cov_yy_m2",
    "r95_m",
    "status",
    "occasions",
    "captures",
    "rejected",
];
/// What is read as users elsewhere; `r_e_m` is the radius of the error disk.
const LOCATED_HEADER: [&str; 4] = ["id", "x_m", "y_m", "r_e_m"];

/// See [`LocateReport::to_users_csv`]: what is not known stays empty.
pub(super) fn users(report: &LocateReport) -> String {
    table(&USERS_HEADER, report.users.iter().map(row))
}

/// See [`LocateReport::to_located_csv`]: radii are rounded up, so that none promises more than it did.
pub(super) fn located(report: &LocateReport) -> String {
    let row = |(user, position): (&LocatedUser, &super::Position)| {
        let [x_m, y_m] = position.pos_m.map(|coordinate_m| decimals(Some(coordinate_m), 3));
        [user.id.clone(), x_m, y_m, decimals(Some((position.r95_m * 1e3).ceil() / 1e3), 3)]
    };
    table(&LOCATED_HEADER, report.located().map(row))
}

fn row(user: &LocatedUser) -> [String; 11] {
    let [x_m, y_m] = split(user.position.map(|it| it.pos_m));
    let [cov_xx_m2, cov_xy_m2, cov_yy_m2] =
        split(user.position.map(|it| [it.cov_m2[0][0], it.cov_m2[0][1], it.cov_m2[1][1]]));
    [
        user.id.clone(),
        decimals(x_m, 3),
        decimals(y_m, 3),
        decimals(cov_xx_m2, 6),
        decimals(cov_xy_m2, 6),
        decimals(cov_yy_m2, 6),
        decimals(user.position.map(|it| it.r95_m), 3),
        status_name(user.status).to_owned(),
        user.occasions.to_string(),
        user.captures.to_string(),
        user.rejected.to_string(),
    ]
}

fn table<const N: usize>(header: &[&str; N], rows: impl Iterator<Item = [String; N]>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    // Neither can fail: memory is the file, and every row has as many fields as the header.
    let _ = writer.write_record(header);
    rows.for_each(|row| drop(writer.write_record(row)));
    String::from_utf8(writer.into_inner().unwrap_or_default()).unwrap_or_default()
}
