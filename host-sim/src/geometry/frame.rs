//! WGS84 longitude and latitude to local east and north metres, and back.

use libm::{asinh, atan, atan2, atanh, cos, cosh, hypot, sin, sinh, tan};

use super::V2;

/// Semi-major axis of the WGS84 ellipsoid, metres (NGA.STND.0036, table 3.1).
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Flattening of the WGS84 ellipsoid.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Third flattening, the small number of Kruger's series.
const N: f64 = FLATTENING / (2.0 - FLATTENING);

/// A transverse Mercator projection whose central meridian runs through the origin.
///
/// The map is conformal. At `x_m` east or west of the origin its scale is `1 + x_m^2 / (2 r^2)`, with r the
/// Earth's radius: distances inside an area 20 km wide around the origin are right to 1.3 parts in a
/// million, and a point 10 km away is placed to 5 mm. Heights play no part.
///
/// # References
/// Kruger's series as arranged by Karney, "Transverse Mercator with an accuracy of a few nanometers",
/// J. Geodesy 85 (2011), eqs. (7)-(36), to the fourth power of n (truncation below a micrometre here).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFrame {
    lon_deg: f64,
    lat_deg: f64,
    /// Distance of the origin from the equator along its meridian, in the projection.
    origin_north_m: f64,
}

impl LocalFrame {
    /// The frame with the given origin in WGS84 degrees.
    #[must_use]
    pub fn new(lon_deg: f64, lat_deg: f64) -> Self {
        let origin_north_m = project(0.0, lat_deg.to_radians()).y;
        Self { lon_deg, lat_deg, origin_north_m }
    }

    /// Longitude and latitude of the origin, WGS84 degrees.
    #[must_use]
    pub fn origin_lon_lat_deg(&self) -> [f64; 2] {
        [self.lon_deg, self.lat_deg]
    }

    /// East and north of the origin, metres, of a point in WGS84 degrees.
    #[must_use]
    pub fn to_local_m(&self, lon_deg: f64, lat_deg: f64) -> V2 {
        // The shorter way around, so that an area may lie across the date line.
        let dlon_deg = (lon_deg - self.lon_deg + 180.0).rem_euclid(360.0) - 180.0;
        project(dlon_deg.to_radians(), lat_deg.to_radians()) - V2::new(0.0, self.origin_north_m)
    }

    /// Longitude in [-180, 180) and latitude, WGS84 degrees, of a local point.
    #[must_use]
    pub fn to_lon_lat_deg(&self, pos_m: V2) -> [f64; 2] {
        let [dlon_rad, lat_rad] = unproject(pos_m + V2::new(0.0, self.origin_north_m));
        let lon_deg = (self.lon_deg + dlon_rad.to_degrees() + 180.0).rem_euclid(360.0) - 180.0;
        [lon_deg, lat_rad.to_degrees()]
    }
}

/// Karney (14): the radius whose circle is as long as a meridian.
fn rectifying_radius_m() -> f64 {
    let n2 = N * N;
    SEMI_MAJOR_M / (1.0 + N) * (1.0 + n2 / 4.0 + n2 * n2 / 64.0)
}

/// Karney (35): coefficients of the series from the conformal sphere to the plane.
fn alpha() -> [f64; 4] {
    let (n, n2) = (N, N * N);
    let (n3, n4) = (n2 * n, n2 * n2);
    [
        n / 2.0 - 2.0 / 3.0 * n2 + 5.0 / 16.0 * n3 + 41.0 / 180.0 * n4,
        13.0 / 48.0 * n2 - 3.0 / 5.0 * n3 + 557.0 / 1440.0 * n4,
        61.0 / 240.0 * n3 - 103.0 / 140.0 * n4,
        49561.0 / 161_280.0 * n4,
    ]
}

/// Karney (36): coefficients of the series from the plane to the conformal sphere.
fn beta() -> [f64; 4] {
    let (n, n2) = (N, N * N);
    let (n3, n4) = (n2 * n, n2 * n2);
    [
        n / 2.0 - 2.0 / 3.0 * n2 + 37.0 / 96.0 * n3 - 1.0 / 360.0 * n4,
        1.0 / 48.0 * n2 + 1.0 / 15.0 * n3 - 437.0 / 1440.0 * n4,
        17.0 / 480.0 * n3 - 37.0 / 840.0 * n4,
        4397.0 / 161_280.0 * n4,
    ]
}

fn eccentricity() -> f64 {
    (FLATTENING * (2.0 - FLATTENING)).sqrt()
}

/// Karney (7)-(9): tangent of the conformal latitude from the tangent of the geographic one.
fn conformal_tangent(tau: f64) -> f64 {
    let e = eccentricity();
    let sigma = sinh(e * atanh(e * tau / hypot(1.0, tau)));
    tau * hypot(1.0, sigma) - sigma * hypot(1.0, tau)
}

/// Longitude from the central meridian and latitude, radians, to metres east and north of the equator.
fn project(dlon_rad: f64, lat_rad: f64) -> V2 {
    let tau_c = conformal_tangent(tan(lat_rad));
    // Karney (10): coordinates of the spherical projection.
    let xi_s = atan2(tau_c, cos(dlon_rad));
    let eta_s = asinh(sin(dlon_rad) / hypot(tau_c, cos(dlon_rad)));
    // Karney (11).
    let (mut xi, mut eta) = (xi_s, eta_s);
    for (a, j) in alpha().into_iter().zip([2.0, 4.0, 6.0, 8.0]) {
        xi += a * sin(j * xi_s) * cosh(j * eta_s);
        eta += a * cos(j * xi_s) * sinh(j * eta_s);
    }
    V2::new(eta, xi) * rectifying_radius_m()
}

/// The inverse of [`project`].
fn unproject(pos_m: V2) -> [f64; 2] {
    let (xi, eta) = (pos_m.y / rectifying_radius_m(), pos_m.x / rectifying_radius_m());
    // Karney (15).
    let (mut xi_s, mut eta_s) = (xi, eta);
    for (b, j) in beta().into_iter().zip([2.0, 4.0, 6.0, 8.0]) {
        xi_s -= b * sin(j * xi) * cosh(j * eta);
        eta_s -= b * cos(j * xi) * sinh(j * eta);
    }
    // Karney (18).
    let tau_c = sin(xi_s) / hypot(sinh(eta_s), cos(xi_s));
    let dlon_rad = atan2(sinh(eta_s), cos(xi_s));
    // Karney (19)-(21): Newton's method; two steps reach the last bit, the third costs nothing.
    let e2 = FLATTENING * (2.0 - FLATTENING);
    let mut tau = tau_c;
    for _ in 0..3 {
        let found = conformal_tangent(tau);
        let slope = (1.0 + (1.0 - e2) * tau * tau) / ((1.0 - e2) * hypot(1.0, tau));
        tau += (tau_c - found) / hypot(1.0, found) * slope;
        // A pole: the tangent is infinite and so is the answer's.
        if !tau.is_finite() {
            tau = tau_c;
        }
    }
    [dlon_rad, atan(tau)]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Origin, point (longitude, latitude), east, north, geodesic: printed by `truth_frame.py`.
    const PROJ: [[f64; 7]; 20] = [
        [13.7, 51.05, 13.79, 51.12, 6301.479867, 7791.346026, 10020.663092],
        [13.7, 51.05, 13.57, 51.07, -9111.958195, 2233.029964, 9381.585429],
        [13.7, 51.05, 13.71, 50.88, 703.785954, -18912.045453, 18925.136100],
        [13.7, 51.05, 15.20, 53.05, 100586.283543, 223588.888026, 245162.429239],
        [-58.4, -34.6, -58.31, -34.53, 8262.637515, 7761.605771, 11336.385261],
        [-58.4, -34.6, -58.53, -34.58, -11927.784648, 2210.981767, 12130.965131],
        [-58.4, -34.6, -58.39, -34.77, 915.428709, -18858.964742, 18881.169414],
        [-58.4, -34.6, -56.90, -32.60, 140815.735354, 220837.212937, 261891.143153],
        [179.95, -16.5, 180.04, -16.43, 9612.226079, 7744.311937, 12343.789594],
        [179.95, -16.5, 179.82, -16.48, -13880.775612, 2208.808725, 14055.406573],
        [179.95, -16.5, 179.96, -16.67, 1066.704322, -18813.043148, 18843.259996],
        [179.95, -16.5, 181.45, -14.50, 161710.752639, 220777.343350, 273636.371437],
        [25.0, 69.9, 25.09, 69.97, 3441.727339, 7811.823772, 8536.396821],
        [25.0, 69.9, 24.87, 69.92, -4983.271037, 2236.527404, 5462.146008],
        [25.0, 69.9, 25.01, 69.73, 386.801267, -18965.113365, 18969.057429],
        [25.0, 69.9, 26.50, 71.90, 52029.312662, 223793.604356, 229759.574197],
        [0.0, 0.0, 0.09, 0.07, 10018.750892, 7740.208960, 12660.413558],
        [0.0, 0.0, -0.13, 0.02, -14471.545428, 2211.491248, 14639.533816],
        [0.0, 0.0, 0.01, -0.17, 1113.190046, -18797.627732, 18830.560183],
        [0.0, 0.0, 1.50, 2.00, 166897.345063, 221225.710907, 277088.245643],
    ];

    #[test]
    fn truth_east_and_north_agree_with_proj() {
        for [lon0, lat0, lon, lat, x_m, y_m, _] in PROJ {
            let error_m = (LocalFrame::new(lon0, lat0).to_local_m(lon, lat) - V2::new(x_m, y_m)).norm();
            assert!(error_m < 2e-6, "{lon} {lat}: {error_m} m off");
        }
    }

    #[test]
    fn truth_distances_in_an_area_twenty_kilometres_wide_are_right_to_a_centimetre() {
        for [lon0, lat0, lon, lat, _, _, geodesic_m] in PROJ {
            let distance_m = LocalFrame::new(lon0, lat0).to_local_m(lon, lat).norm();
            if geodesic_m < 13_000.0 {
                assert!((distance_m - geodesic_m).abs() < 0.01, "{distance_m} m, truth {geodesic_m} m");
            }
        }
    }

    #[test]
    fn the_date_line_is_no_border() {
        let frame = LocalFrame::new(179.95, -16.5);
        let beyond = frame.to_local_m(-179.95, -16.5);
        assert!((beyond.x - 10_678.0).abs() < 10.0 && beyond.y.abs() < 10.0, "{beyond}");
        assert!((frame.to_lon_lat_deg(beyond)[0] + 179.95).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn there_and_back_again(lon0 in -180.0..180.0f64, lat0 in -89.0..89.0f64,
                                x_m in -20_000.0..20_000.0f64, y_m in -20_000.0..20_000.0f64) {
            let frame = LocalFrame::new(lon0, lat0);
            let [lon, lat] = frame.to_lon_lat_deg(V2::new(x_m, y_m));
            let error_m = (frame.to_local_m(lon, lat) - V2::new(x_m, y_m)).norm();
            prop_assert!(error_m < 1e-6, "{} m off", error_m);
        }
    }
}
