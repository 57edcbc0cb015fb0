//! The rows of a file, checked field by field.

use std::io::BufRead;

use super::decimal::billionths;
use super::labels::Labels;
use crate::control::rows::{Fault, Field, LineError, Lines, float, metres, name, split};

/// The columns of a file, in any order.
pub(super) const COLUMNS: [&str; 8] = ["user", "epoch_s", "drone", "x_m", "y_m", "z_m", "toa_ns", "sigma_ns"];

/// A larger file is refused.
const MOST_BYTES: u64 = 1 << 30;
/// What 30,000 users give in one sweep, and a gigabyte of memory.
const MOST_ROWS: usize = 10_000_000;
/// What the estimator can tell apart in one group of clocks.
const MOST_DRONES: usize = 256;
/// Numbers beyond these are slips: of a column, of a unit, or of a coordinate system (UTM northings reach 1e7).
const MOST_EPOCH_S: i128 = 500_000_000_000;
const MOST_PLANE_M: f64 = 1e7;
const MOST_HEIGHT_M: f64 = 1e5;
/// Nanoseconds since 1970 are 1.7e18.
const MOST_TOA_NS: i128 = 1_000_000_000_000_000_000_000;
const SIGMA_NS: [f64; 2] = [1e-6, 1e6];
const BILLION: i128 = 1_000_000_000;

/// One capture as the file has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Row {
    pub(super) line: u32,
    pub(super) user: u32,
    pub(super) drone: u32,
    /// In billionths of a second and of a nanosecond: exact, so that equal is equal and differences keep their digits.
    pub(super) epoch: i128,
    pub(super) toa: i128,
    pub(super) pos_m: [f64; 3],
    pub(super) sigma_ns: f64,
}

/// A whole file; `user` and `drone` of its rows count these names.
#[derive(Default)]
pub(super) struct Table {
    pub(super) rows: Vec<Row>,
    pub(super) users: Labels,
    pub(super) drones: Labels,
}

/// Reads the header and every row.
pub(super) fn read(reader: impl BufRead) -> Result<Table, LineError> {
    let mut lines = Lines::new(reader, MOST_BYTES);
    let place = match lines.next()? {
        Some((number, line)) => header(number, line)?,
        None => return Err(Fault::line(lines.number(), "nothing", expected_header()).into()),
    };
    let mut table = Table::default();
    while let Some((number, line)) = lines.next()? {
        if table.rows.len() == MOST_ROWS {
            return Err(Fault::line(number, "one row more", format!("at most {MOST_ROWS} rows")).into());
        }
        let row = table.row(number, line, &place)?;
        table.rows.push(row);
    }
    if table.rows.is_empty() {
        let expected = "a row for each capture";
        return Err(Fault::line(lines.number(), "nothing after the header", expected).into());
    }
    Ok(table)
}

fn expected_header() -> String {
    format!("the header \"{}\"", COLUMNS.join(","))
}

/// Where each of [`COLUMNS`] stands.
fn header(number: u32, line: &[u8]) -> Result<[usize; 8], Fault> {
    let (fields, count) = split::<8>(number, line)?;
    let expected = expected_header();
    let mut place = [usize::MAX; 8];
    for (at, field) in fields.iter().take(count).enumerate() {
        let Some(column) = COLUMNS.iter().position(|name| name.as_bytes() == field.raw) else {
            return Err(Fault::field(number, "the header", field.raw, expected));
        };
        if place[column] != usize::MAX {
            return Err(Fault::line(number, format!("{} twice", COLUMNS[column]), expected));
        }
        place[column] = at;
    }
    if let Some(missing) = place.iter().position(|&at| at == usize::MAX) {
        return Err(Fault::line(number, format!("no column {}", COLUMNS[missing]), expected));
    }
    if count > COLUMNS.len() {
        return Err(Fault::line(number, format!("{count} columns"), expected));
    }
    Ok(place)
}

impl Table {
    fn row(&mut self, line: u32, text: &[u8], place: &[usize; 8]) -> Result<Row, Fault> {
        let (fields, count) = split::<8>(line, text)?;
        if count != COLUMNS.len() {
            let found = format!("{count} field{}", if count == 1 { "" } else { "s" });
            return Err(Fault::line(line, found, format!("the {} of the header", COLUMNS.len())));
        }
        let [user, epoch_s, drone, x_m, y_m, z_m, toa_ns, sigma_ns] = place.map(|at| fields[at]);
        Ok(Row {
            line,
            user: label(line, "user", user, &mut self.users)?,
            epoch: exact(line, "epoch_s", epoch_s, MOST_EPOCH_S, "seconds")?,
            drone: self.drone(line, drone)?,
            pos_m: [
                metres(line, "x_m", x_m, MOST_PLANE_M)?,
                metres(line, "y_m", y_m, MOST_PLANE_M)?,
                metres(line, "z_m", z_m, MOST_HEIGHT_M)?,
            ],
            toa: exact(line, "toa_ns", toa_ns, MOST_TOA_NS, "nanoseconds")?,
            sigma_ns: sigma(line, sigma_ns)?,
        })
    }

    fn drone(&mut self, line: u32, field: Field<'_>) -> Result<u32, Fault> {
        let number = label(line, "drone", field, &mut self.drones)?;
        if self.drones.len() > MOST_DRONES {
            return Err(Fault::field(
                line,
                "drone",
                field.raw,
                format!("at most {MOST_DRONES} drones in a file"),
            ));
        }
        Ok(number)
    }
}

fn label(line: u32, column: &'static str, field: Field<'_>, labels: &mut Labels) -> Result<u32, Fault> {
    Ok(labels.number(&name(line, column, field)?))
}

fn exact(line: u32, column: &'static str, field: Field<'_>, most: i128, unit: &str) -> Result<i128, Fault> {
    let in_range = |value: &i128| value.abs() <= most * BILLION;
    billionths(field.raw.trim_ascii()).filter(in_range).ok_or_else(|| {
        Fault::field(line, column, field.raw, format!("a number of {unit} within ±{:e}", most as f64))
    })
}

fn sigma(line: u32, field: Field<'_>) -> Result<f64, Fault> {
    let [least, most] = SIGMA_NS;
    float(field).filter(|value| (least..=most).contains(value)).ok_or_else(|| {
        let expected = format!("a number of nanoseconds above 0, from {least:e} to {most:e}");
        Fault::field(line, "sigma_ns", field.raw, expected)
    })
}
