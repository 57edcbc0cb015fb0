//! Located users from a file, to be served.
//!
//! # Format
//! CSV with the columns `id,x_m,y_m` and, where they are known, the others, in any order:
//!
//! | column | meaning | range | default |
//! | --- | --- | --- | --- |
//! | `id` | a name of its own | 1 to 200 bytes, no control characters | |
//! | `x_m`, `y_m` | where the user is: east and north in metres | ±1e7 | |
//! | `r_e_m` or `r95_m` | how far it may be from there | 0 to 1e7 | 0 |
//! | `weight` | what serving it is worth | 0 to 1e6 | 1 |
//! | `cov_xx_m2`, `cov_xy_m2`, `cov_yy_m2` | covariance of the position | all three, positive semidefinite | unknown |
//! | `status` | whether the position is claimed | rows other than `ok` are left out | `ok` |
//!
//! `occasions`, `captures` and `rejected` may be there and say nothing: `users.csv` of `skyroost locate` is such a file.
//!
//! Or GeoJSON (WGS84) of points with these names as properties; local coordinates then count from the
//! middle of the points. At most a million users.

mod geojson;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::Matrix2;
use thiserror::Error;

pub use super::rows::{Fault, RowsError};
use super::rows::{Field, LineError, Lines, float, metres, name, split};
use crate::control::place::UserBelief;
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;

/// The columns of a file; the first three must be there.
const COLUMNS: [&str; MOST_COLUMNS] = [
    "id",
    "x_m",
    "y_m",
    "r_e_m",
    "r95_m",
    "weight",
    "cov_xx_m2",
    "cov_xy_m2",
    "cov_yy_m2",
    "status",
    "occasions",
    "captures",
    "rejected",
];
const MOST_COLUMNS: usize = 13;
const NEEDED: usize = 3;
/// Of a position that is claimed.
const CLAIMED: &str = "ok";
/// A larger file is refused.
const MOST_BYTES: u64 = 1 << 28;
/// More than live in a city.
const MOST_USERS: usize = 1_000_000;
/// Numbers beyond these are slips.
const MOST_PLANE_M: f64 = 1e7;
const MOST_RADIUS_M: f64 = 1e7;
const MOST_WEIGHT: f64 = 1e6;
const MOST_VARIANCE_M2: f64 = 1e14;

/// A user as it was located.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// Its name.
    pub id: String,
    /// East and north, metres.
    pub pos_m: V2,
    /// How far it may be from there, metres.
    pub error_radius_m: f64,
    /// What serving it is worth.
    pub weight: f64,
    /// Covariance of its position, where that is known.
    pub cov_m2: Option<Matrix2<f64>>,
}

impl Located {
    /// Its position with its uncertainty. Without a covariance the error is taken as normal and the same in all directions,
    /// with `error_radius_m` as its 95 % radius.
    #[must_use]
    pub fn belief(&self) -> UserBelief {
        // 95 % of a round normal error lie within sqrt(-2 ln 0.05) sigma.
        let round = || Matrix2::identity() * (self.error_radius_m.powi(2) / (-2.0 * 0.05f64.ln()));
        UserBelief { pos_m: self.pos_m, cov_m2: self.cov_m2.unwrap_or_else(round) }
    }
}

/// The users of a file, in its order.
#[derive(Clone, Debug)]
pub struct LocatedUsers {
    /// The users.
    pub users: Vec<Located>,
    /// Where local coordinates lie on Earth, where the file says so.
    pub frame: Option<LocalFrame>,
    /// Rows or features that are no users with a position.
    pub left_out: usize,
}

/// Why a file is no list of users.
#[derive(Debug, Error)]
pub enum LocatedError {
    /// The file cannot be read, or a line is not what it should be.
    #[error(transparent)]
    Rows(#[from] RowsError),
    /// A feature is not what it should be.
    #[error("{}: {at}: found {found}, expected {expected}", file.display())]
    Feature {
        /// The file.
        file: PathBuf,
        /// Which part of it.
        at: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: &'static str,
    },
}

impl LocatedUsers {
    /// Reads a file: GeoJSON where its name says so, CSV otherwise.
    ///
    /// # Errors
    /// [`LocatedError`] names the file, the place in it, what was found and what is expected.
    pub fn read(file: &Path) -> Result<Self, LocatedError> {
        let refused = |error: LineError| RowsError::new(file, error);
        let size = fs::metadata(file).map_err(|error| refused(LineError::Io(error)))?.len();
        if size > MOST_BYTES {
            return Err(refused(
                Fault::line(1, format!("{size} bytes"), format!("at most {MOST_BYTES}")).into(),
            )
            .into());
        }
        Self::parse(file, &fs::read(file).map_err(|error| refused(LineError::Io(error)))?)
    }

    /// Reads what a file of that name holds.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(file: &Path, content: &[u8]) -> Result<Self, LocatedError> {
        let refused = |error: LineError| RowsError::new(file, error);
        let suffix = file.extension().map(|suffix| suffix.to_string_lossy().to_lowercase());
        match suffix.as_deref() {
            Some("geojson" | "json") => geojson::parse(file, content),
            _ => Ok(Self::parse_csv(content).map_err(refused)?),
        }
    }

    fn parse_csv(content: &[u8]) -> Result<Self, LineError> {
        let mut lines = Lines::new(content, MOST_BYTES);
        let (place, fields) = match lines.next()? {
            Some((number, line)) => header(number, line)?,
            None => return Err(Fault::line(lines.number(), "nothing", expected_header()).into()),
        };
        let (mut users, mut left_out) = (Vec::new(), 0);
        let mut line_of: BTreeMap<String, u32> = BTreeMap::new();
        while let Some((number, line)) = lines.next()? {
            let row = Row::split(number, line, &place, fields)?;
            if row.column("status").is_some_and(|status| status.raw != CLAIMED.as_bytes()) {
                left_out += 1;
                continue;
            }
            let user = row.user()?;
            if let Some(first) = line_of.insert(user.id.clone(), number) {
                let expected = format!("a name of its own, not that of line {first}");
                return Err(Fault::field(number, "id", user.id.as_bytes(), expected).into());
            }
            if users.len() == MOST_USERS {
                return Err(Fault::line(number, "one user more", format!("at most {MOST_USERS}")).into());
            }
            users.push(user);
        }
        Ok(Self { users, frame: None, left_out })
    }
}

fn expected_header() -> String {
    "the header \"id,x_m,y_m\", and r_e_m, weight, cov_xx_m2, cov_xy_m2 and cov_yy_m2 where they are known"
        .to_owned()
}

/// Where each of [`COLUMNS`] stands.
type Places = [Option<usize>; MOST_COLUMNS];

/// Where the columns stand, and how many fields a row has.
fn header(number: u32, line: &[u8]) -> Result<(Places, usize), Fault> {
    let (fields, count) = split::<MOST_COLUMNS>(number, line)?;
    let mut place = [None; MOST_COLUMNS];
    for (at, field) in fields.iter().take(count).enumerate() {
        let Some(column) = COLUMNS.iter().position(|name| name.as_bytes() == field.raw) else {
            return Err(Fault::field(number, "the header", field.raw, expected_header()));
        };
        if place[column].replace(at).is_some() {
            return Err(Fault::line(number, format!("{} twice", COLUMNS[column]), expected_header()));
        }
    }
    if let Some(missing) = place[..NEEDED].iter().position(Option::is_none) {
        return Err(Fault::line(number, format!("no column {}", COLUMNS[missing]), expected_header()));
    }
    if count > COLUMNS.len() {
        return Err(Fault::line(number, format!("{count} columns"), expected_header()));
    }
    let there = |name: &str| place[column(name)].is_some();
    if there("r_e_m") && there("r95_m") {
        return Err(Fault::line(number, "both r_e_m and r95_m", "one of them"));
    }
    let covariance = ["cov_xx_m2", "cov_xy_m2", "cov_yy_m2"].map(there);
    if covariance.contains(&true) && covariance.contains(&false) {
        return Err(Fault::line(number, "a part of the covariance", "cov_xx_m2, cov_xy_m2 and cov_yy_m2"));
    }
    Ok((place, count))
}

/// Where a column stands in [`COLUMNS`].
fn column(name: &str) -> usize {
    COLUMNS.iter().position(|column| *column == name).expect("a column of the table above")
}

/// The fields of a row.
struct Row<'a> {
    line: u32,
    fields: [Field<'a>; MOST_COLUMNS],
    place: &'a Places,
}

impl<'a> Row<'a> {
    fn split(line: u32, text: &'a [u8], place: &'a Places, expected: usize) -> Result<Self, Fault> {
        let (fields, count) = split::<MOST_COLUMNS>(line, text)?;
        if count != expected {
            let found = format!("{count} field{}", if count == 1 { "" } else { "s" });
            return Err(Fault::line(line, found, format!("the {expected} of the header")));
        }
        Ok(Self { line, fields, place })
    }

    /// The field of a column; none where the file has no such column.
    fn column(&self, name: &str) -> Option<Field<'a>> {
        self.place[column(name)].map(|at| self.fields[at])
    }

    fn user(&self) -> Result<Located, Fault> {
        let line = self.line;
        let metres = |name| metres(line, name, self.column(name).unwrap_or_default(), MOST_PLANE_M);
        let positive = |name, most, otherwise| {
            self.column(name).map_or(Ok(otherwise), |field| within(line, name, field, most))
        };
        let radius = if self.column("r95_m").is_some() { "r95_m" } else { "r_e_m" };
        Ok(Located {
            id: name(line, "id", self.column("id").unwrap_or_default())?,
            pos_m: V2::new(metres("x_m")?, metres("y_m")?),
            error_radius_m: positive(radius, MOST_RADIUS_M, 0.0)?,
            weight: positive("weight", MOST_WEIGHT, 1.0)?,
            cov_m2: self.covariance()?,
        })
    }

    fn covariance(&self) -> Result<Option<Matrix2<f64>>, Fault> {
        let Some(xy) = self.column("cov_xy_m2") else { return Ok(None) };
        let variance =
            |name| within(self.line, name, self.column(name).unwrap_or_default(), MOST_VARIANCE_M2);
        let (xx, yy) = (variance("cov_xx_m2")?, variance("cov_yy_m2")?);
        let expected = || format!("a number of at most sqrt({xx} {yy}) either way");
        // Printed to some decimals, a singular covariance may be off by a rounding.
        let most = (xx * yy).sqrt() + 1e-6 * (1.0 + xx + yy);
        let xy_m2 = float(xy).filter(|value| value.abs() <= most);
        let xy_m2 = xy_m2.ok_or_else(|| Fault::field(self.line, "cov_xy_m2", xy.raw, expected()))?;
        let xy_m2 = xy_m2.clamp(-(xx * yy).sqrt(), (xx * yy).sqrt());
        Ok(Some(Matrix2::new(xx, xy_m2, xy_m2, yy)))
    }
}

/// A number from 0 on.
fn within(line: u32, column: &'static str, field: Field<'_>, most: f64) -> Result<f64, Fault> {
    float(field)
        .filter(|value| (0.0..=most).contains(value))
        .map(|value| value + 0.0)
        .ok_or_else(|| Fault::field(line, column, field.raw, format!("a number from 0 to {most:e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Located>, String> {
        LocatedUsers::parse_csv(text.as_bytes()).map(|read| read.users).map_err(|error| match error {
            LineError::Fault(fault) => fault.to_string(),
            LineError::Io(error) => error.to_string(),
        })
    }

    #[test]
    fn columns_are_known_by_name() {
        let users = read("weight,y_m,id,x_m\n2,4,\"a, b\",-3.5\n").unwrap();
        let expected = Located {
            id: "a, b".to_owned(),
            pos_m: V2::new(-3.5, 4.0),
            error_radius_m: 0.0,
            weight: 2.0,
            cov_m2: None,
        };
        assert_eq!(users, [expected]);
        assert_eq!(read("id,x_m,y_m\r\n\r\n").unwrap(), []);
        assert!((read("id,x_m,y_m,r_e_m\nu,0,0,8.5").unwrap()[0].error_radius_m - 8.5).abs() < 1e-15);
    }

    #[test]
    fn the_table_of_locate_is_read_with_its_covariances() {
        let table = "id,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2,r95_m,status,occasions,captures,rejected\n\
                     u1,1,2,9,-3,4,7.5,ok,70,210,1\n\
                     u2,,,,,,,not_located,0,0,0\n";
        let read = LocatedUsers::parse_csv(table.as_bytes()).map_err(|_| ()).unwrap();
        assert_eq!((read.users.len(), read.left_out), (1, 1));
        assert_eq!(read.users[0].cov_m2, Some(Matrix2::new(9.0, -3.0, -3.0, 4.0)));
        assert!((read.users[0].error_radius_m - 7.5).abs() < 1e-12);
        // Without covariances the 95 % radius tells: a round error has 95 % within 2.4477 sigma.
        let round = Located { cov_m2: None, ..read.users[0].clone() }.belief();
        assert!((round.cov_m2.m11.sqrt() - 7.5 / 2.4477).abs() < 1e-3);
    }

    #[test]
    fn faults_name_line_and_column() {
        for (text, told) in [
            ("", "line 1: found nothing, expected the header"),
            ("id,x_m\n", "line 1: found no column y_m"),
            ("id,x_m,y_m,z_m\n", "line 1, the header: found \"z_m\""),
            ("id,x_m,y_m,x_m\n", "line 1: found x_m twice"),
            ("id,x_m,y_m\na,1\n", "line 2: found 2 fields, expected the 3 of the header"),
            (
                "id,x_m,y_m\na,1,2\n\na,3,4\n",
                "line 4, id: found \"a\", expected a name of its own, not that of line 2",
            ),
            ("id,x_m,y_m\na,nan,2\n", "line 2, x_m: found \"nan\""),
            ("id,x_m,y_m\na,1e300,2\n", "line 2, x_m: found \"1e300\""),
            ("id,x_m,y_m\n,1,2\n", "line 2, id: found \"\", expected a name"),
            ("id,x_m,y_m,r_e_m\na,1,2,-1\n", "line 2, r_e_m: found \"-1\", expected a number from 0"),
            ("id,x_m,y_m,weight\na,1,2,inf\n", "line 2, weight: found \"inf\""),
            ("id,x_m,y_m,r_e_m,r95_m\n", "line 1: found both r_e_m and r95_m"),
            ("id,x_m,y_m,cov_xx_m2\n", "line 1: found a part of the covariance"),
            (
                "id,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2\na,1,2,4,7,9\n",
                "line 2, cov_xy_m2: found \"7\", expected a number of at most sqrt(4 9) either way",
            ),
            ("id,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2\na,1,2,-4,0,9\n", "line 2, cov_xx_m2: found \"-4\""),
        ] {
            let fault = read(text).unwrap_err();
            assert!(fault.starts_with(told), "{text:?}: {fault}");
        }
    }
}
