//! A placement for scripts, maps and people.

mod map;

use std::fmt;
use std::fmt::Write as _;

use serde::Serialize;
use serde_json::json;

use crate::control::located::Located;
use crate::control::place::{Placement, Site, served_by_any};
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;
use crate::report::earth::{Earth, collection, feature};

/// Corners of a circle.
const CORNERS: u32 = 72;

/// Drones placed for users.
#[derive(Clone, Debug)]
pub struct PlaceReport {
    /// Where the users come from, for people.
    pub source: String,
    /// How drones were placed.
    pub method: &'static str,
    /// What a drone covers.
    pub radius_m: f64,
    /// Where local coordinates lie on Earth, where that is known.
    pub frame: Option<LocalFrame>,
    /// The users, in the order of `placement`'s indices.
    pub users: Vec<Located>,
    /// Features of the file that are no users.
    pub left_out: usize,
    /// Where the drones hover, and for whom.
    pub placement: Placement,
    /// Users count as covered when they are in range with this probability; none: when their error disk is.
    pub confidence: Option<f64>,
    /// How long placing took.
    pub wall_s: f64,
}

#[derive(Serialize)]
struct Drone<'a> {
    x_m: f64,
    y_m: f64,
    covered: Vec<&'a str>,
    /// How far the drone may drift before it loses one of them; null where it covers nobody.
    margin_m: Option<f64>,
}

#[derive(Serialize)]
struct Answer<'a> {
    method: &'static str,
    radius_m: f64,
    drones: Vec<Drone<'a>>,
    covered: usize,
    value: f64,
    upper_bound: Number,
    proved_optimal: bool,
    never_coverable: usize,
    users: usize,
    confidence: Option<f64>,
    /// Users expected to be truly within the radius of a drone.
    expected_served: f64,
    margin_m: Option<f64>,
    wall_s: f64,
}

/// A whole number where it is one.
#[derive(Serialize)]
#[serde(untagged)]
enum Number {
    Whole(i64),
    Real(f64),
}

impl From<f64> for Number {
    fn from(x: f64) -> Self {
        if x.fract() == 0.0 && x.abs() < 1e15 { Self::Whole(x as i64) } else { Self::Real(x) }
    }
}

impl PlaceReport {
    /// The answer as one JSON object, with a line's end.
    ///
    /// # Panics
    /// Never: plain data serializes.
    #[must_use]
    pub fn to_json(&self) -> String {
        let Placement { sites, covered, value, upper_bound, proved_optimal, never_coverable } =
            &self.placement;
        let answer = Answer {
            method: self.method,
            radius_m: self.radius_m,
            drones: sites.iter().map(|site| self.drone(site.as_ref())).collect(),
            covered: *covered,
            value: *value,
            upper_bound: (*upper_bound).into(),
            proved_optimal: *proved_optimal,
            never_coverable: *never_coverable,
            users: self.users.len(),
            confidence: self.confidence,
            expected_served: self.expected_served(),
            margin_m: self.margin_m(),
            wall_s: self.wall_s,
        };
        serde_json::to_string(&answer).expect("plain data serializes") + "\n"
    }

    fn drone(&self, site: Option<&Site>) -> Drone<'_> {
        // A drone at stand-by waits where users are.
        let [x_m, y_m] = site.map_or_else(|| self.middle_m(), |site| site.pos_m).into();
        let covered = site.map_or(&[][..], |site| &site.covered);
        let covered = covered.iter().map(|&user| self.users[user].id.as_str()).collect();
        Drone { x_m, y_m, covered, margin_m: site.map(|site| site.margin_m) }
    }

    /// Middle of all users.
    fn middle_m(&self) -> V2 {
        let sum: V2 = self.users.iter().map(|user| user.pos_m).sum();
        sum / self.users.len().max(1) as f64
    }

    /// Users expected to be truly within the radius of a drone, given how well each is known.
    fn expected_served(&self) -> f64 {
        let sites_m: Vec<V2> = self.placement.sites.iter().flatten().map(|site| site.pos_m).collect();
        self.users.iter().map(|user| served_by_any(&user.belief(), &sites_m, self.radius_m)).sum()
    }

    /// The least margin of all drones that cover somebody.
    fn margin_m(&self) -> Option<f64> {
        self.placement.sites.iter().flatten().map(|site| site.margin_m).reduce(f64::min)
    }

    /// A row for each drone: `drone,x_m,y_m,covered,weight,margin_m`.
    #[must_use]
    pub fn to_sites_csv(&self) -> String {
        let mut text = "drone,x_m,y_m,covered,weight,margin_m\n".to_owned();
        for (number, site) in (1..).zip(&self.placement.sites) {
            let Drone { x_m, y_m, covered, margin_m } = self.drone(site.as_ref());
            let (covered, weight) = (covered.len(), site.as_ref().map_or(0.0, |site| site.expected));
            let margin_m = margin_m.map(|m| format!("{m:.6}")).unwrap_or_default();
            let _ = writeln!(text, "{number},{x_m:.6},{y_m:.6},{covered},{weight},{margin_m}");
        }
        text
    }

    /// Sites, their circles and the users as GeoJSON; none where local coordinates have no place on Earth.
    #[must_use]
    pub fn to_geojson(&self) -> Option<String> {
        let earth = Earth { frame: self.frame.as_ref()? };
        let served_by = self.served_by();
        let mut features = Vec::new();
        for (number, site) in (1..).zip(&self.placement.sites) {
            let Some(site) = site else { continue };
            let ids: Vec<&str> = site.covered.iter().map(|&user| self.users[user].id.as_str()).collect();
            let drone =
                json!({ "kind": "drone", "drone": number, "covered": ids, "margin_m": site.margin_m });
            features.push(feature(earth.point(site.pos_m), drone));
            let disk = json!({ "kind": "coverage", "drone": number, "radius_m": self.radius_m });
            features.push(feature(earth.area(vec![vec![circle_m(site.pos_m, self.radius_m)]]), disk));
        }
        for (user, served_by) in self.users.iter().zip(served_by) {
            let properties =
                json!({ "kind": "user", "id": user.id, "r_e_m": user.error_radius_m, "drone": served_by });
            features.push(feature(earth.point(user.pos_m), properties));
        }
        Some(collection(&features))
    }

    /// A picture as a self-contained SVG with light and dark colours.
    #[must_use]
    pub fn to_svg(&self) -> String {
        map::render(self)
    }

    /// Number of the drone that serves each user.
    fn served_by(&self) -> Vec<Option<u32>> {
        let mut served_by = vec![None; self.users.len()];
        for (number, site) in (1..).zip(&self.placement.sites) {
            for &user in site.iter().flat_map(|site| &site.covered) {
                served_by[user] = Some(number);
            }
        }
        served_by
    }
}

/// Corners of a circle, anticlockwise.
fn circle_m(at_m: V2, radius_m: f64) -> Vec<V2> {
    let corner = |k: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS)).sin_cos();
        at_m + V2::new(cos, sin) * radius_m
    };
    (0..CORNERS).map(corner).collect()
}

impl fmt::Display for PlaceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Placement { sites, covered, value, upper_bound, proved_optimal, never_coverable } =
            &self.placement;
        let users = self.users.len();
        writeln!(
            f,
            "{covered} of {users} users of {} within {} m of {} drones",
            self.source,
            self.radius_m,
            sites.len()
        )?;
        let weighted = self.users.iter().any(|user| (user.weight - 1.0).abs() > f64::EPSILON);
        let unit = if weighted { "worth" } else { "users" };
        if weighted {
            writeln!(f, "  worth          {value}")?;
        }
        if *proved_optimal {
            writeln!(f, "  optimal        no placement serves more, proved in {:.2} s", self.wall_s)?;
        } else {
            writeln!(
                f,
                "  not proved     no placement serves more than {upper_bound} ({unit}); {:.2} s",
                self.wall_s
            )?;
        }
        if let Some(confidence) = self.confidence {
            writeln!(f, "  confidence     {} % that each of them is in range", 100.0 * confidence)?;
        }
        if self.users.iter().any(|user| user.error_radius_m > 0.0 || user.cov_m2.is_some()) {
            writeln!(f, "  expected       {:.1} users truly in range", self.expected_served())?;
        }
        if *never_coverable > 0 {
            writeln!(f, "  out of reach   {never_coverable} users that may be farther off than the radius")?;
        }
        writeln!(
            f,
            "\n  {:>5}  {:>12}  {:>12}  {:>7}  {:>9}",
            "drone", "east, m", "north, m", "users", "margin, m"
        )?;
        for (number, site) in (1..).zip(sites) {
            match site {
                Some(Site { pos_m, covered, margin_m, .. }) => writeln!(
                    f,
                    "  {number:>5}  {:>12.2}  {:>12.2}  {:>7}  {margin_m:>9.2}",
                    pos_m.x,
                    pos_m.y,
                    covered.len()
                )?,
                None => writeln!(f, "  {number:>5}  {:>12}", "stand-by")?,
            }
        }
        Ok(())
    }
}
