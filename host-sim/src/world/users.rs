//! The users on the ground: drawn at random, or read from a file.

use crate::geometry::V2;
use crate::rng::{self, Stream};
use rand_core::Rng;
use rand_distr::{Distribution, Poisson};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// One user.
#[derive(Clone, Debug, PartialEq)]
pub struct User {
    /// Name, unique among the users.
    pub id: String,
    /// True position.
    pub pos_m: V2,
}

/// Why there are no users.
#[derive(Debug, thiserror::Error)]
pub enum UsersError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Nothing but a header, or not even that.
    #[error("{}: found no users, expected a header and a row for each user", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The first line is no header of a users file.
    #[error("{}: line 1: found header `{found}`, expected `id,x_m,y_m` or `x_m,y_m`", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// The first line.
        found: String,
    },
    /// A field is not what its column needs.
    #[error("{}: line {line}, column {column}: found `{found}`, expected {expected}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Name of the column.
        column: &'static str,
        /// The field.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// A row is too short, too long or no text at all.
    #[error("{}: line {line}: found {found}, expected {expected}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// What it holds.
        found: String,
        /// What it should hold.
        expected: String,
    },
    /// A density that draws no finite number of users.
    #[error(
        "density_per_km2: found {density_per_km2} over {area_km2} km2, expected zero or more, and at most {MAX_EXPECTED} users"
    )]
    Density {
        /// The density.
        density_per_km2: f64,
        /// The bounding box drawn over.
        area_km2: f64,
    },
}

/// More users than this on average are refused as a slip of the keyboard.
const MAX_EXPECTED: f64 = 1e7;

/// Local coordinates end here: a plane frame means nothing beyond a thousand kilometres.
const MAX_COORDINATE_M: f64 = 1e6;

/// A homogeneous Poisson point process in a region: the number in the bounding box is Poisson with mean density
/// times area, places are uniform, and those outside `contains` are thinned out, which leaves a Poisson
/// process of the same density inside (Kingman, *Poisson Processes*, 1993, 2.2 and 5.1).
/// Users are named `u1`, `u2`, ... in the order drawn. For one seed and box a smaller region keeps the same
/// users.
///
/// # Errors
/// [`UsersError::Density`] unless the mean number is finite, not negative and sane.
pub fn poisson_users(
    density_per_km2: f64,
    (low_m, high_m): (V2, V2),
    contains: impl Fn(V2) -> bool,
    seed: u64,
) -> Result<Vec<User>, UsersError> {
    let mut rng = rng::stream(seed, Stream::Users, 0);
    let places_m = poisson_places(density_per_km2, (low_m, high_m), contains, &mut rng)?;
    Ok(places_m
        .into_iter()
        .zip(1..)
        .map(|(pos_m, number)| User { id: format!("u{number}"), pos_m })
        .collect())
}

/// The places of [`poisson_users`], drawn from any stream.
///
/// # Errors
/// As [`poisson_users`].
pub fn poisson_places(
    density_per_km2: f64,
    (low_m, high_m): (V2, V2),
    contains: impl Fn(V2) -> bool,
    rng: &mut impl Rng,
) -> Result<Vec<V2>, UsersError> {
    let extent_m = high_m - low_m;
    let area_km2 = extent_m.x * extent_m.y * 1e-6;
    let expected = density_per_km2 * area_km2;
    let is_sane = extent_m.min() >= 0.0 && density_per_km2 >= 0.0 && expected <= MAX_EXPECTED;
    let refused = UsersError::Density { density_per_km2, area_km2 };
    if !is_sane {
        return Err(refused);
    }
    if expected <= 0.0 {
        return Ok(Vec::new());
    }
    let drawn = Poisson::new(expected).map_err(|_| refused)?.sample(rng) as u64;
    let mut place = || V2::new(rng::unit(rng), rng::unit(rng)).component_mul(&extent_m) + low_m;
    Ok((0..drawn).map(|_| place()).filter(|p| contains(*p)).collect())
}

/// Reads users from a CSV file with the header `id,x_m,y_m`, `id,x_m,y_m,r_e_m` (the radius is not used)
/// or `x_m,y_m` (the users are then named `u1`, `u2`, ... by row).
///
/// # Errors
/// Whatever is not exactly that: see [`UsersError`].
pub fn read_users(path: &Path) -> Result<Vec<User>, UsersError> {
    let file = File::open(path).map_err(|source| UsersError::Read { path: path.to_owned(), source })?;
    parse_users(file, path)
}

/// As [`read_users`], from anything readable; `path` is only for the messages.
///
/// # Errors
/// As [`read_users`].
pub fn parse_users(input: impl Read, path: &Path) -> Result<Vec<User>, UsersError> {
    // Flexible, because the messages on short and long rows are ours.
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).has_headers(false).from_reader(input);
    let mut records = reader.records();
    let empty = || UsersError::Empty { path: path.to_owned() };
    let header = records.next().ok_or_else(empty)?.map_err(|error| unreadable(error, path))?;
    let header: Vec<&str> = header.iter().collect();
    let has_id = match header[..] {
        ["id", "x_m", "y_m"] | ["id", "x_m", "y_m", "r_e_m"] => true,
        ["x_m", "y_m"] => false,
        _ => return Err(UsersError::Header { path: path.to_owned(), found: header.join(",") }),
    };

    let mut users = Vec::new();
    let mut line_of_id = BTreeMap::new();
    for record in records {
        let record = record.map_err(|error| unreadable(error, path))?;
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != header.len() {
            let found = format!("{} fields", record.len());
            let expected = format!("the {} of the header", header.len());
            return Err(UsersError::Row { path: path.to_owned(), line, found, expected });
        }
        let refuse = |column, found: &str, expected: String| UsersError::Field {
            path: path.to_owned(),
            line,
            column,
            found: found.to_owned(),
            expected,
        };
        let coordinate = |column, at: usize| {
            let found = record.get(at).unwrap_or_default();
            match found.parse::<f64>() {
                Ok(value) if value.abs() <= MAX_COORDINATE_M => Ok(value),
                _ => Err(refuse(column, found, format!("a number of metres within ±{MAX_COORDINATE_M}"))),
            }
        };
        let id = match record.get(0) {
            Some(id) if has_id => id.to_owned(),
            _ => format!("u{}", users.len() + 1),
        };
        if id.is_empty() {
            return Err(refuse("id", "", "a name".to_owned()));
        }
        if let Some(first) = line_of_id.insert(id.clone(), line) {
            return Err(refuse("id", &id, format!("a name not used before (it is in line {first})")));
        }
        let first = usize::from(has_id);
        users.push(User { id, pos_m: V2::new(coordinate("x_m", first)?, coordinate("y_m", first + 1)?) });
    }
    if users.is_empty() { Err(empty()) } else { Ok(users) }
}

/// A record that the CSV reader gave up on: text that is no UTF-8, or a file that broke off.
fn unreadable(error: csv::Error, path: &Path) -> UsersError {
    let line = error.position().map_or(1, csv::Position::line);
    let path = path.to_owned();
    match error.into_kind() {
        csv::ErrorKind::Io(source) => UsersError::Read { path, source },
        _ => UsersError::Row { path, line, found: "bytes that are no text".into(), expected: "UTF-8".into() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::moments;
    use proptest::prelude::*;

    fn parse(text: impl AsRef<[u8]>) -> Result<Vec<User>, String> {
        parse_users(text.as_ref(), Path::new("users.csv")).map_err(|error| error.to_string())
    }

    fn square(side_m: f64) -> (V2, V2) {
        (V2::zeros(), V2::new(side_m, side_m))
    }

    #[test]
    fn truth_counts_are_poisson_with_and_without_thinning() {
        // A triangle is half of its box: mean = variance = 10 / km2 * 4 km2 / 2 = 20.
        for (share, contains) in [(1.0, (|_| true) as fn(V2) -> bool), (0.5, |p| p.x > p.y)] {
            let n = 4000;
            let draw = |seed| poisson_users(10.0, square(2000.0), contains, seed).unwrap().len() as f64;
            let (mean, variance) = moments((0..n).map(draw).collect::<Vec<_>>().into_iter());
            let expected = 40.0 * share;
            assert!((mean - expected).abs() < 4.0 * (expected / n as f64).sqrt(), "{mean}");
            // Var(s^2) / lambda^2 = (2 + 1 / lambda) / n.
            assert!((variance / expected - 1.0).abs() < 4.0 * (2.05 / n as f64).sqrt(), "{variance}");
        }
    }

    #[test]
    fn truth_places_are_uniform() {
        let users =
            poisson_users(1000.0, (V2::new(-500.0, 2000.0), V2::new(9500.0, 12_000.0)), |_| true, 1).unwrap();
        let n = users.len() as f64;
        assert!((n - 100_000.0).abs() < 4.0 * 316.2);
        // Chi-square over 10 x 10 cells: 99 degrees of freedom, standard deviation sqrt(198).
        let mut counts = [0.0_f64; 100];
        for user in &users {
            let cell = (user.pos_m - V2::new(-500.0, 2000.0)) / 1000.0;
            counts[cell.x as usize + 10 * cell.y as usize] += 1.0;
        }
        let chi_square: f64 = counts.iter().map(|c| (c - n / 100.0).powi(2) / (n / 100.0)).sum();
        assert!((chi_square - 99.0).abs() < 4.0 * 198.0_f64.sqrt(), "{chi_square}");
    }

    #[test]
    fn no_density_no_users_and_nonsense_is_refused() {
        assert_eq!(poisson_users(0.0, square(1e4), |_| true, 1).unwrap(), []);
        for density in [-1.0, f64::NAN, f64::INFINITY, 1e9] {
            assert!(poisson_users(density, square(1e4), |_| true, 1).is_err(), "{density}");
        }
        assert!(poisson_users(1.0, (V2::new(1.0, 1.0), V2::zeros()), |_| true, 1).is_err());
    }

    #[test]
    fn reads_the_three_headers() {
        let named = parse("id,x_m,y_m\nanna, 1.5,-2e1\n\"b,c\",0,0\n").unwrap();
        assert_eq!(named[0], User { id: "anna".into(), pos_m: V2::new(1.5, -20.0) });
        assert_eq!(named[1].id, "b,c");
        assert_eq!(parse("id,x_m,y_m,r_e_m\nu9,1,2,30\n").unwrap()[0].id, "u9");
        let unnamed = parse("\u{feff}x_m,y_m\r\n1,2\r\n\r\n3,4\r\n").unwrap();
        assert_eq!(unnamed.iter().map(|u| u.id.as_str()).collect::<Vec<_>>(), ["u1", "u2"]);
    }

    #[test]
    fn names_the_place_of_every_mistake() {
        for (text, message) in [
            ("", "users.csv: found no users, expected a header and a row for each user"),
            ("x_m,y_m\n", "users.csv: found no users, expected a header and a row for each user"),
            ("x,y\n1,2\n", "users.csv: line 1: found header `x,y`, expected `id,x_m,y_m` or `x_m,y_m`"),
            ("1,2\n", "users.csv: line 1: found header `1,2`, expected `id,x_m,y_m` or `x_m,y_m`"),
            ("x_m,y_m\n1,2\n3\n", "users.csv: line 3: found 1 fields, expected the 2 of the header"),
            (
                "x_m,y_m\n1,nan\n",
                "users.csv: line 2, column y_m: found `nan`, expected a number of metres within ±1000000",
            ),
            (
                "x_m,y_m\n1e999,0\n",
                "users.csv: line 2, column x_m: found `1e999`, expected a number of metres within ±1000000",
            ),
            (
                "id,x_m,y_m\na,0,\n",
                "users.csv: line 2, column y_m: found ``, expected a number of metres within ±1000000",
            ),
            ("id,x_m,y_m\n,0,0\n", "users.csv: line 2, column id: found ``, expected a name"),
            (
                "id,x_m,y_m\na,0,0\nb,0,0\na,1,1\n",
                "users.csv: line 4, column id: found `a`, expected a name not used before (it is in line 2)",
            ),
        ] {
            assert_eq!(parse(text).unwrap_err(), message, "{text:?}");
        }
        let no_text = parse(b"x_m,y_m\n1,2\n\xff,3\n").unwrap_err();
        assert_eq!(no_text, "users.csv: line 3: found bytes that are no text, expected UTF-8");
        let missing = read_users(Path::new("no/such/file.csv")).unwrap_err().to_string();
        assert!(missing.starts_with("no/such/file.csv: "), "{missing}");
    }

    proptest! {
        #[test]
        fn never_panics(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse(bytes);
        }

        #[test]
        fn never_panics_on_rows(rows in "id,x_m,y_m\n([a-c]?,[-0-9.e]{0,6},[-0-9naif]{0,5}\n){0,6}") {
            if let Ok(users) = parse(rows) {
                prop_assert!(users.iter().all(|u| u.pos_m.iter().all(|c| c.is_finite())));
            }
        }

        #[test]
        fn what_is_written_is_read(points in prop::collection::vec((-1e6..1e6_f64, -1e6..1e6_f64), 1..20)) {
            let rows: String = points.iter().map(|(x, y)| format!("{x},{y}\n")).collect();
            let users = parse(format!("x_m,y_m\n{rows}")).unwrap();
            let read: Vec<(f64, f64)> = users.iter().map(|u| (u.pos_m.x, u.pos_m.y)).collect();
            prop_assert_eq!(read, points);
        }
    }
}
