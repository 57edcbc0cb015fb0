//! Located users from a file, to be served.
//!
//! # Format
//! CSV with the columns `id,x_m,y_m` and, where they are known, `r_e_m` and `weight`, in any order:
//!
//! | column | meaning | range | default |
//! | --- | --- | --- | --- |
//! | `id` | a name of its own | 1 to 200 bytes, no control characters | |
//! | `x_m`, `y_m` | where the user is: east and north in metres | ±1e7 | |
//! | `r_e_m` | how far it may be from there | 0 to 1e7 | 0 |
//! | `weight` | what serving it is worth | 0 to 1e6 | 1 |
//!
//! Or GeoJSON (WGS84) of points, where `id`, `r_e_m` and `weight` are properties; local coordinates then count from the
//! middle of the points. At most a million users.

mod geojson;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use thiserror::Error;

pub use super::rows::{Fault, RowsError};
use super::rows::{Field, LineError, Lines, float, metres, name, split};
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;

/// The columns of a file; the first three must be there.
const COLUMNS: [&str; 5] = ["id", "x_m", "y_m", "r_e_m", "weight"];
const NEEDED: usize = 3;
/// A larger file is refused.
const MOST_BYTES: u64 = 1 << 28;
/// More than live in a city.
const MOST_USERS: usize = 1_000_000;
/// Numbers beyond these are slips.
const MOST_PLANE_M: f64 = 1e7;
const MOST_RADIUS_M: f64 = 1e7;
const MOST_WEIGHT: f64 = 1e6;

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
}

/// The users of a file, in its order.
#[derive(Clone, Debug)]
pub struct LocatedUsers {
    /// The users.
    pub users: Vec<Located>,
    /// Where local coordinates lie on Earth, where the file says so.
    pub frame: Option<LocalFrame>,
    /// Features that are no users with a position.
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
        let content = fs::read(file).map_err(|error| refused(LineError::Io(error)))?;
        let suffix = file.extension().map(|suffix| suffix.to_string_lossy().to_lowercase());
        match suffix.as_deref() {
            Some("geojson" | "json") => geojson::parse(file, &content),
            _ => Ok(Self::parse_csv(&content).map_err(refused)?),
        }
    }

    fn parse_csv(content: &[u8]) -> Result<Self, LineError> {
        let mut lines = Lines::new(content, MOST_BYTES);
        let (place, fields) = match lines.next()? {
            Some((number, line)) => header(number, line)?,
            None => return Err(Fault::line(lines.number(), "nothing", expected_header()).into()),
        };
        let mut users = Vec::new();
        let mut line_of: BTreeMap<String, u32> = BTreeMap::new();
        while let Some((number, line)) = lines.next()? {
            let user = row(number, line, &place, fields)?;
            if let Some(first) = line_of.insert(user.id.clone(), number) {
                let expected = format!("a name of its own, not that of line {first}");
                return Err(Fault::field(number, "id", user.id.as_bytes(), expected).into());
            }
            if users.len() == MOST_USERS {
                return Err(Fault::line(number, "one user more", format!("at most {MOST_USERS}")).into());
            }
            users.push(user);
        }
        Ok(Self { users, frame: None, left_out: 0 })
    }
}

fn expected_header() -> String {
    "the header \"id,x_m,y_m\", and r_e_m and weight where they are known".to_owned()
}

/// Where each of [`COLUMNS`] stands, and how many fields a row has.
fn header(number: u32, line: &[u8]) -> Result<([Option<usize>; 5], usize), Fault> {
    let (fields, count) = split::<5>(number, line)?;
    let mut place = [None; 5];
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
    Ok((place, count))
}

fn row(line: u32, text: &[u8], place: &[Option<usize>; 5], expected: usize) -> Result<Located, Fault> {
    let (fields, count) = split::<5>(line, text)?;
    if count != expected {
        let found = format!("{count} field{}", if count == 1 { "" } else { "s" });
        return Err(Fault::line(line, found, format!("the {expected} of the header")));
    }
    let [id, x_m, y_m, r_e_m, weight] = place.map(|at| at.map(|at| fields[at]));
    let [id, x_m, y_m] = [id, x_m, y_m].map(Option::unwrap_or_default);
    Ok(Located {
        id: name(line, "id", id)?,
        pos_m: V2::new(metres(line, "x_m", x_m, MOST_PLANE_M)?, metres(line, "y_m", y_m, MOST_PLANE_M)?),
        error_radius_m: r_e_m.map_or(Ok(0.0), |field| within(line, "r_e_m", field, MOST_RADIUS_M))?,
        weight: weight.map_or(Ok(1.0), |field| within(line, "weight", field, MOST_WEIGHT))?,
    })
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
        let expected =
            Located { id: "a, b".to_owned(), pos_m: V2::new(-3.5, 4.0), error_radius_m: 0.0, weight: 2.0 };
        assert_eq!(users, [expected]);
        assert_eq!(read("id,x_m,y_m\r\n\r\n").unwrap(), []);
        assert!((read("id,x_m,y_m,r_e_m\nu,0,0,8.5").unwrap()[0].error_radius_m - 8.5).abs() < 1e-15);
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
        ] {
            let fault = read(text).unwrap_err();
            assert!(fault.starts_with(told), "{text:?}: {fault}");
        }
    }
}
