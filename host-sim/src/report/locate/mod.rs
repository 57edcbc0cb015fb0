//! Located users for scripts, maps, the next steps and people.
//!
//! - `json`: every figure, for scripts,
//! - `tables`: all users, and those that claim a position, for placing drones,
//! - `geojson`: users and their 95 % ellipses for other maps,
//! - `map`: a picture,
//! - `warnings`: what was lost on the way and what looks wrong,
//! - `text`: the figures that decide, for people.

mod geojson;
mod json;
mod map;
mod tables;
mod text;
mod warnings;

use crate::control::captures::{Captures, Prepared};
use crate::control::localize::{ClockModel, FixStatus, Localization, LocalizeConfig};
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;

/// What was located, from what, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct LocateReport {
    /// Where the captures come from, for people.
    pub source: String,
    /// What was assumed and demanded.
    pub config: LocalizeConfig,
    /// Where local coordinates lie on Earth, where that is known.
    pub frame: Option<LocalFrame>,
    /// All users of the file, in natural order of their names.
    pub users: Vec<LocatedUser>,
    /// All drones of the file; the first is the reference of the clocks.
    pub drones: Vec<DroneClock>,
    /// Epoch that the clocks' offsets belong to, seconds.
    pub reference_epoch_s: f64,
    /// First and last epoch of the file, seconds.
    pub epochs_s: [f64; 2],
    /// Occasions that two drones heard or more.
    pub occasions: usize,
    /// Captures that count.
    pub captures: usize,
    /// Where the drones heard users, in so many places as a picture shows, metres.
    pub track_m: Vec<V2>,
    /// What was dropped, divided or repeated, with counts, and what looks wrong.
    pub warnings: Vec<String>,
}

/// One user.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatedUser {
    /// Its name in the file.
    pub id: String,
    /// What the position is worth.
    pub status: FixStatus,
    /// Where it is. A best guess unless the status is [`FixStatus::Ok`]; none where there is nothing to guess from.
    pub position: Option<Position>,
    /// Occasions at which two drones or more heard it.
    pub occasions: u32,
    /// Its captures.
    pub captures: u32,
    /// Captures that the robust weights threw out.
    pub rejected: u32,
}

/// A position and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// East and north, metres.
    pub pos_m: [f64; 2],
    /// Covariance of `pos_m`, the uncertainty of the clocks included.
    pub cov_m2: [[f64; 2]; 2],
    /// Radius of the circle around it that holds 95 % of that Gaussian.
    pub r95_m: f64,
}

/// The clock of a drone against the reference drone's.
#[derive(Clone, Debug, PartialEq)]
pub struct DroneClock {
    /// Its name in the file.
    pub id: String,
    /// Offset in nanoseconds at [`LocateReport::reference_epoch_s`] and drift in nanoseconds per second; none where no
    /// occasion ties the clock to the reference.
    pub line: Option<[f64; 2]>,
}

impl LocateReport {
    /// What `localization` found in `captures`, which were `prepared` for it.
    #[must_use]
    pub fn new(
        source: String,
        captures: &Captures,
        prepared: &Prepared,
        config: LocalizeConfig,
        localization: &Localization,
        frame: Option<LocalFrame>,
    ) -> Self {
        let mut fixes = localization.users.iter().peekable();
        let users = (0..).zip(&captures.users).map(|(number, user)| {
            // Both are sorted by number; a user that the estimator could make nothing of is left out there.
            let fix = fixes.next_if(|fix| fix.user.0 == number);
            let status = fix.map_or(FixStatus::NotLocated, |fix| fix.status);
            let position = fix.filter(|_| status != FixStatus::NotLocated).map(|fix| Position {
                pos_m: fix.pos_m,
                cov_m2: fix.cov_m2,
                r95_m: fix.r95_m,
            });
            LocatedUser {
                id: user.id.clone(),
                status,
                position: position.filter(Position::is_finite),
                occasions: user.occasions,
                captures: user.captures,
                rejected: fix.map_or(0, |fix| fix.rejected),
            }
        });
        let users = users.collect();
        let drones = (1..).zip(captures.drones.iter().zip(&prepared.taken_out_ns)).map(
            |(number, (drone, &taken_out_ns))| {
                let found = localization.clocks.iter().find(|clock| clock.drone.0 == number);
                let line = match config.clock {
                    ClockModel::Synchronised => Some([0.0; 2]),
                    _ => found
                        .filter(|_| drone.tied)
                        .map(|clock| [taken_out_ns + clock.offset_ns, clock.drift_ns_per_s]),
                };
                DroneClock { id: drone.id.clone(), line }
            },
        );
        let drones = drones.collect();
        let reference_s = localization.clocks.first().map_or(0.0, |clock| clock.reference_time_s);
        Self {
            source,
            config,
            frame,
            users,
            drones,
            reference_epoch_s: captures.epochs_s[0] + reference_s,
            epochs_s: captures.epochs_s,
            occasions: prepared.heard_together,
            captures: captures.count(),
            track_m: captures.places_m(TRACK_PLACES),
            warnings: warnings::collect(captures, prepared, &config, localization),
        }
    }

    /// The answer as one JSON object, with a line's end.
    ///
    /// # Panics
    /// Never: every key is a string.
    #[must_use]
    pub fn to_json(&self) -> String {
        json::render(self)
    }

    /// Users and ellipses as GeoJSON; none where local coordinates have no place on Earth.
    #[must_use]
    pub fn to_geojson(&self) -> Option<String> {
        self.frame.as_ref().map(|frame| geojson::render(self, frame))
    }

    /// A picture of users and ellipses as a self-contained SVG with light and dark colours.
    #[must_use]
    pub fn to_svg(&self) -> String {
        map::render(self)
    }

    /// All users, a row each: `id,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2,r95_m,status,occasions,captures,rejected`.
    #[must_use]
    pub fn to_users_csv(&self) -> String {
        tables::users(self)
    }

    /// The users that claim a position, `id,x_m,y_m,r_e_m`: for placing drones.
    #[must_use]
    pub fn to_located_csv(&self) -> String {
        tables::located(self)
    }

    /// Users of one status.
    fn count(&self, status: FixStatus) -> usize {
        self.users.iter().filter(|user| user.status == status).count()
    }

    /// The users that claim a position, with it.
    fn located(&self) -> impl Iterator<Item = (&LocatedUser, &Position)> {
        let ok = self.users.iter().filter(|user| user.status == FixStatus::Ok);
        ok.filter_map(|user| Some((user, user.position.as_ref()?)))
    }

    /// The 95 % radii of the users that claim a position, sorted, metres.
    fn r95_m(&self) -> Vec<f64> {
        let mut r95_m: Vec<f64> = self.located().map(|(_, position)| position.r95_m).collect();
        r95_m.sort_unstable_by(f64::total_cmp);
        r95_m
    }
}

impl Position {
    fn is_finite(&self) -> bool {
        let numbers = self.pos_m.iter().chain(self.cov_m2.iter().flatten());
        numbers.chain([&self.r95_m]).all(|x| x.is_finite())
    }

    /// Corners of the ellipse that holds 95 % of the Gaussian, anticlockwise.
    fn ellipse_m(&self, corners: u32) -> Vec<V2> {
        /// Square root of the 95 % quantile of a chi-square with two degrees of freedom.
        const REACH: f64 = 2.447_746_830_680_816;
        let [[xx, xy], [_, yy]] = self.cov_m2;
        // Cholesky's factor takes the unit circle to the ellipse.
        let a = xx.max(0.0).sqrt();
        let b = if a > 0.0 { xy / a } else { 0.0 };
        let c = (yy - b * b).max(0.0).sqrt();
        (0..corners)
            .map(|k| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(corners)).sin_cos();
                V2::from(self.pos_m) + V2::new(a * cos, b * cos + c * sin) * REACH
            })
            .collect()
    }
}

/// Places of drones that a picture tells apart, along the longer of its sides.
const TRACK_PLACES: u16 = 250;

/// All statuses, the good one first.
const STATUSES: [FixStatus; 5] = [
    FixStatus::Ok,
    FixStatus::Ambiguous,
    FixStatus::PoorGeometry,
    FixStatus::Inconsistent,
    FixStatus::NotLocated,
];

/// What is unknown about the clocks, as the option takes it.
const fn clock_name(clock: ClockModel) -> &'static str {
    match clock {
        ClockModel::Synchronised => "none",
        ClockModel::SharedConstant => "shared-constant",
        ClockModel::SharedWander { .. } => "shared-linear",
    }
}

#[cfg(test)]
mod tests;
