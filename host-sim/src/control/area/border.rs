//! Borders in degrees, each with its place in the file, and the polygons they are in metres.

use super::fault::Fault;
use super::{MAX_EXTENT_M, check_vertices};
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;
use crate::geometry::polygon::Polygon;

/// A ring counts as closed when its ends are this near, 0.1 mm on Earth: rounding of decimals.
const CLOSED_WITHIN_DEG: f64 = 1e-9;

/// How far the polygon that stands for a circle is from it at most.
const CIRCLE_ERROR_M: f64 = 0.25;

/// A degree of latitude at the poles of WGS84, where it is longest.
const DEGREE_AT_POLE_M: f64 = 111_694.0;

/// A closed line on Earth.
pub(super) enum Border {
    Ring(Ring),
    Circle(Circle),
}

/// A border of vertices.
pub(super) struct Ring {
    place: String,
    /// At least one; longitudes follow each other the shorter way around, beyond 180 degrees where need be.
    lon_lat_deg: Vec<[f64; 2]>,
}

/// A border at one distance of a centre.
pub(super) struct Circle {
    place: String,
    centre_lon_lat_deg: [f64; 2],
    radius_m: f64,
}

impl Ring {
    /// A ring whose last vertex has to repeat the first.
    pub(super) fn closed(place: String, lon_lat_deg: Vec<[f64; 2]>) -> Result<Self, Fault> {
        if let (Some(&[lon0, lat0]), Some(&[lon1, lat1])) = (lon_lat_deg.first(), lon_lat_deg.last())
            && !((lon1 - lon0).abs() <= CLOSED_WITHIN_DEG && (lat1 - lat0).abs() <= CLOSED_WITHIN_DEG)
        {
            let found = format!("an unclosed ring from ({lon0}, {lat0}) to ({lon1}, {lat1})");
            let place = format!("{place}, vertex {}", lon_lat_deg.len());
            return Err(Fault::content(place, found, "the last position to repeat the first"));
        }
        Self::open(place, lon_lat_deg)
    }

    /// A ring whose last vertex may or may not repeat the first.
    pub(super) fn open(place: String, mut lon_lat_deg: Vec<[f64; 2]>) -> Result<Self, Fault> {
        let Some(&[first_deg, _]) = lon_lat_deg.first() else {
            return Err(Fault::content(place, "a ring without a vertex", "at least 3 vertices"));
        };
        check_vertices(lon_lat_deg.len())?;
        let vertex = |i: usize| format!("{place}, vertex {}", i + 1);
        let next = |before_deg: f64, lon_deg: f64, i: usize| {
            let turned_deg = near(lon_deg, before_deg);
            if (turned_deg - before_deg).abs() > 180.0 - CLOSED_WITHIN_DEG {
                let found = "the end of an edge over half of all longitudes";
                return Err(Fault::content(vertex(i), found, "a shorter edge, and no pole on it"));
            }
            Ok(turned_deg)
        };
        let mut before_deg = first_deg;
        for (i, position) in lon_lat_deg.iter_mut().enumerate() {
            check_position(*position, || vertex(i))?;
            position[0] = next(before_deg, position[0], i)?;
            before_deg = position[0];
        }
        // Back where it began, but a turn further: the ring has gone around the Earth's axis.
        if (next(before_deg, first_deg, 0)? - first_deg).abs() > 180.0 {
            let pole = if lon_lat_deg[0][1] > 0.0 { "north" } else { "south" };
            return Err(Fault::content(
                place,
                format!("a ring around the {pole} pole"),
                "an area without a pole in it",
            ));
        }
        Ok(Self { place, lon_lat_deg })
    }

    fn points_m(&self, frame: &LocalFrame) -> Vec<V2> {
        self.lon_lat_deg.iter().map(|&[lon_deg, lat_deg]| frame.to_local_m(lon_deg, lat_deg)).collect()
    }
}

impl Circle {
    /// A circle that an area or a zone may be: not larger than areas are, and no pole in it.
    pub(super) fn new(place: String, centre_lon_lat_deg: [f64; 2], radius_m: f64) -> Result<Self, Fault> {
        check_position(centre_lon_lat_deg, || format!("{place}, center"))?;
        if !(radius_m > 0.0 && radius_m <= MAX_EXTENT_M / 2.0) {
            let expected = format!("more than 0 and at most {:.0} metres", MAX_EXTENT_M / 2.0);
            return Err(Fault::content(format!("{place}, radius"), format!("{radius_m}"), expected));
        }
        if (90.0 - centre_lon_lat_deg[1].abs()) * DEGREE_AT_POLE_M <= radius_m {
            return Err(Fault::content(place, "a circle around a pole", "an area without a pole in it"));
        }
        Ok(Self { place, centre_lon_lat_deg, radius_m })
    }

    /// Vertices of the polygon that stands for it.
    fn vertices(&self) -> usize {
        let half_turns = (self.radius_m / (2.0 * CIRCLE_ERROR_M)).sqrt();
        ((std::f64::consts::PI * half_turns).ceil() as usize).max(16)
    }

    /// A regular polygon in it, or around it.
    fn points_m(&self, frame: &LocalFrame, around: bool) -> Vec<V2> {
        let [lon_deg, lat_deg] = self.centre_lon_lat_deg;
        let centre_m = frame.to_local_m(lon_deg, lat_deg);
        let n = self.vertices();
        let step_rad = std::f64::consts::TAU / n as f64;
        let mut radius_m = self.radius_m;
        if around {
            // Far from the frame's middle the projection stretches the circle by 1 + x^2 / (2 r^2).
            let off = (centre_m.x.abs() + radius_m) / 6.3e6;
            radius_m *= (1.0 + off * off / 2.0) / (step_rad / 2.0).cos();
        }
        let corner = |i: usize| {
            centre_m + radius_m * V2::new((i as f64 * step_rad).cos(), (i as f64 * step_rad).sin())
        };
        (0..n).map(corner).collect()
    }
}

impl From<Ring> for Border {
    fn from(ring: Ring) -> Self {
        Self::Ring(ring)
    }
}

impl Border {
    /// Where it is in the file.
    pub(super) fn place(&self) -> &str {
        match self {
            Self::Ring(Ring { place, .. }) | Self::Circle(Circle { place, .. }) => place,
        }
    }

    pub(super) fn vertices(&self) -> usize {
        match self {
            Self::Ring(ring) => ring.lon_lat_deg.len(),
            Self::Circle(circle) => circle.vertices(),
        }
    }

    /// Its vertices, or its centre; at least one.
    pub(super) fn positions(&self) -> &[[f64; 2]] {
        match self {
            Self::Ring(ring) => &ring.lon_lat_deg,
            Self::Circle(circle) => std::slice::from_ref(&circle.centre_lon_lat_deg),
        }
    }

    /// Turns it by whole circles to the side of the date line that a longitude is on.
    pub(super) fn turn_near(&mut self, lon_deg: f64) {
        let positions = match self {
            Self::Ring(ring) => ring.lon_lat_deg.as_mut_slice(),
            Self::Circle(circle) => std::slice::from_mut(&mut circle.centre_lon_lat_deg),
        };
        let turn_deg = positions.first().map_or(0.0, |first| near(first[0], lon_deg) - first[0]);
        positions.iter_mut().for_each(|position| position[0] += turn_deg);
    }

    /// The polygon in the frame; that of a circle to fly in lies in it, that of one to keep out of around it.
    pub(super) fn polygon(&self, frame: &LocalFrame, use_as: Use) -> Result<Polygon, Fault> {
        let points_m = match self {
            Self::Ring(ring) => ring.points_m(frame),
            Self::Circle(circle) => circle.points_m(frame, use_as == Use::Zone),
        };
        let reach_m = match use_as {
            Use::Area => MAX_EXTENT_M / 2.0,
            Use::Zone => MAX_EXTENT_M,
        };
        // Not written as `>`: what lies on the other side of the Earth has no finite place in the frame.
        let near = |p: &V2| p.x.abs() <= reach_m && p.y.abs() <= reach_m;
        if let Some(i) = points_m.iter().position(|p| !near(p)) {
            let far_km = points_m[i].norm() / 1000.0;
            return Err(Fault::content(
                format!("{}, vertex {}", self.place(), i + 1),
                format!("a point {far_km:.0} km from the middle of the area"),
                format!("at most {:.0} km to each side", reach_m / 1000.0),
            ));
        }
        Polygon::new(&points_m).map_err(|source| Fault::Polygon { place: self.place().to_owned(), source })
    }
}

/// What a polygon is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Use {
    /// To be swept.
    Area,
    /// Not to be entered.
    Zone,
}

/// The longitude that is the same modulo 360 degrees and nearest to another one; 180 and -180 become
/// exactly equal, so that parts cut there meet exactly.
fn near(lon_deg: f64, other_deg: f64) -> f64 {
    lon_deg + 360.0 * ((other_deg - lon_deg) / 360.0).round()
}

fn check_position([lon_deg, lat_deg]: [f64; 2], place: impl Fn() -> String) -> Result<(), Fault> {
    let found = || format!("longitude {lon_deg}, latitude {lat_deg}");
    if !(lon_deg.abs() <= 180.0 && lat_deg.abs() <= 90.0) {
        return Err(Fault::content(
            place(),
            found(),
            "longitude within +-180 and latitude within +-90 degrees",
        ));
    }
    if lat_deg.abs() > 90.0 - CLOSED_WITHIN_DEG {
        return Err(Fault::content(place(), found(), "an area that does not touch a pole"));
    }
    Ok(())
}
