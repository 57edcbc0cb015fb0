//! Captures from a file: arrivals of users' SRS at drones, as recorded by whatever flew.
//!
//! # Format
//! CSV with the header `user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns` and a row for each capture. Rows of one
//! user and epoch are one SRS occasion, one transmission at an unknown time.
//!
//! | column | meaning | range |
//! | --- | --- | --- |
//! | `user`, `drone` | names; numbers are names as well | 1 to 200 bytes, no control characters; 256 drones |
//! | `epoch_s` | when, in seconds since whatever | ±5e11 |
//! | `x_m`, `y_m`, `z_m` | where the drone was: east, north, up in metres | ±1e7, ±1e7, ±1e5 |
//! | `toa_ns` | arrival by the drone's own clock, in nanoseconds since whatever | ±1e21 |
//! | `sigma_ns` | standard deviation of `toa_ns` | 1e-6 to 1e6 |
//!
//! Columns are known by name and may stand in any order, rows as well. UTF-8, with or without a byte order mark; lines
//! end in LF or CR LF; blank lines do not count; names may be quoted as in RFC 4180 (a quoted name has no line
//! break). At most 1 GiB, 4096 bytes a line, 10 million rows.
//!
//! `epoch_s` and `toa_ns` are read exactly, to a billionth of their unit: epochs are equal when the numbers are, and
//! nanoseconds since 1970 (19 digits, more than a float has) lose nothing, because only differences become floats.
//!
//! # What is refused
//! Everything else, with its line: see [`RowsError`]. A row that repeats another one exactly counts once and is
//! counted in [`Captures::repeated`]; one that contradicts another (same user, epoch and drone) is refused.

mod decimal;
mod labels;
mod occasions;
mod rows;
#[cfg(test)]
mod tests;
mod ties;

use std::collections::HashSet;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use decimal::to_f64;
pub use occasions::Prepared;
use rows::Row;

use super::rows::LineError;
pub use super::rows::{Fault, RowsError};
use crate::geometry::V2;

/// A file's captures, sorted: nothing here depends on the order of its rows but the line in [`repeated`](Self::repeated).
#[derive(Clone, Debug, PartialEq)]
pub struct Captures {
    /// Every user named, in natural order (`u2` before `u10`); `UserId(i)` of the occasions is the i-th.
    pub users: Vec<HeardUser>,
    /// Every drone named, the reference of the clocks first; `DroneId(i + 1)` of the occasions is the i-th.
    pub drones: Vec<HeardDrone>,
    /// First and last epoch, seconds.
    pub epochs_s: [f64; 2],
    /// Rows that repeat another one, and the line of the first of them.
    pub repeated: Option<(usize, u32)>,
    /// By user, epoch and drone, repetitions left out.
    rows: Vec<Row>,
    first_epoch: i128,
}

/// A user as the file names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeardUser {
    /// Its name.
    pub id: String,
    /// Occasions at which two drones or more heard it.
    pub occasions: u32,
    /// Captures, alone or together with others.
    pub captures: u32,
}

/// A drone as the file names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeardDrone {
    /// Its name.
    pub id: String,
    /// Whether its clock can be compared with the reference: over occasions heard together, directly or by way of
    /// other drones.
    pub tied: bool,
    /// Clock against the reference, or against another drone it is tied to, as one occasion has it: right to some
    /// 100 ns. In billionths of a nanosecond.
    coarse: i128,
}

impl Captures {
    /// Reads a file.
    ///
    /// # Errors
    /// [`RowsError`] names the file, the line, the column, what was found and what is expected.
    pub fn read(file: &Path) -> Result<Self, RowsError> {
        let opened = File::open(file);
        let opened = opened.map_err(|error| RowsError::new(file, LineError::Io(error)))?;
        Self::parse(file, BufReader::with_capacity(1 << 16, opened))
    }

    /// Reads what a file of that name holds.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(file: &Path, content: impl BufRead) -> Result<Self, RowsError> {
        (rows::read(content))
            .and_then(|table| Ok(Self::sorted(table)?))
            .map_err(|error| RowsError::new(file, error))
    }

    fn sorted(table: rows::Table) -> Result<Self, Fault> {
        let rows::Table { mut rows, users, drones } = table;
        let (users, user_rank) = users.sorted();
        let (drones, drone_rank) = drones.sorted();
        for row in &mut rows {
            row.user = user_rank[row.user as usize];
            row.drone = drone_rank[row.drone as usize];
        }
        rows.sort_unstable_by_key(|row| (row.user, row.epoch, row.drone, row.line));
        let repeated = refuse_contradictions(&mut rows, &users, &drones)?;

        let mut users: Vec<HeardUser> =
            users.into_iter().map(|id| HeardUser { id, occasions: 0, captures: 0 }).collect();
        for occasion in rows.chunk_by(Row::same_occasion) {
            let user = &mut users[occasion[0].user as usize];
            user.occasions += u32::from(occasion.len() >= 2);
            user.captures += occasion.len() as u32;
        }
        let drones = ties::tie(&mut rows, drones);
        let epochs = || rows.iter().map(|row| row.epoch);
        let first_epoch = epochs().min().unwrap_or_default();
        let last_epoch = epochs().max().unwrap_or_default();
        let epochs_s = [to_f64(first_epoch), to_f64(last_epoch)];
        Ok(Self { users, drones, epochs_s, repeated, rows, first_epoch })
    }

    /// Where drones heard users, east and north in metres: one place for each cell of a square grid that has `cells` along
    /// the longer side of what they flew over.
    #[must_use]
    pub fn places_m(&self, cells: u16) -> Vec<V2> {
        let at_m = |row: &Row| V2::new(row.pos_m[0], row.pos_m[1]);
        let boxes = self.rows.iter().map(|row| [at_m(row); 2]);
        let [low, high] = boxes.reduce(|[a, b], [c, d]| [a.inf(&c), b.sup(&d)]).unwrap_or_default();
        let per_m = f64::from(cells) / (high - low).amax().max(1.0);
        let cell = |row: &Row| {
            let [x, y] = ((at_m(row) - low) * per_m).into();
            (x as u32, y as u32)
        };
        let mut seen = HashSet::new();
        self.rows.iter().filter(|row| seen.insert(cell(row))).map(at_m).collect()
    }

    /// Captures that count.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rows.len()
    }
}

impl Row {
    fn same_occasion(&self, other: &Self) -> bool {
        (self.user, self.epoch) == (other.user, other.epoch)
    }

    /// The first column in which two rows of one user, epoch and drone differ.
    fn difference(&self, other: &Self) -> Option<&'static str> {
        let same = |axis: usize| self.pos_m[axis].to_bits() == other.pos_m[axis].to_bits();
        [
            ("x_m", same(0)),
            ("y_m", same(1)),
            ("z_m", same(2)),
            ("toa_ns", self.toa == other.toa),
            ("sigma_ns", self.sigma_ns.to_bits() == other.sigma_ns.to_bits()),
        ]
        .into_iter()
        .find_map(|(column, same)| (!same).then_some(column))
    }
}

/// Keeps one of rows that say the same, refuses the first in the file that says something else. `rows` are sorted.
fn refuse_contradictions(
    rows: &mut Vec<Row>,
    users: &[String],
    drones: &[String],
) -> Result<Option<(usize, u32)>, Fault> {
    let mut repeated: Option<(usize, u32)> = None;
    let mut contradiction: Option<(Row, Row, &'static str)> = None;
    rows.dedup_by(|row, kept| {
        if !row.same_occasion(kept) || row.drone != kept.drone {
            return false;
        }
        if let Some(column) = row.difference(kept) {
            if contradiction.is_none_or(|(first, ..)| row.line < first.line) {
                contradiction = Some((*row, *kept, column));
            }
        } else {
            let (count, line) = repeated.unwrap_or((0, u32::MAX));
            repeated = Some((count + 1, line.min(row.line)));
        }
        true
    });
    let Some((row, kept, column)) = contradiction else { return Ok(repeated) };
    let (user, drone) = (&users[row.user as usize], &drones[row.drone as usize]);
    Err(Fault {
        line: row.line,
        column: Some(column),
        found: format!(
            "another value than in line {} for the same user {user:?}, epoch and drone {drone:?}",
            kept.line
        ),
        expected: "one capture of each drone at each occasion".to_owned(),
    })
}
