//! How far a drone reaches down to the ground, and from which altitude it reaches farthest.
//!
//! The model of Al-Hourani, Kandeepan and Lardner: a user either has line of sight (LoS) to the drone or has
//! not (NLoS), and only elevation and environment decide how likely that is. With elevation `theta` in degrees,
//! slant range `s` and frequency `f`,
//!
//! ```text
//! P_LoS(theta) = 1 / (1 + a exp(-b (theta - a)))
//! L(theta, s)  = 20 log10(4 pi f s / c) + P_LoS eta_LoS + (1 - P_LoS) eta_NLoS          dB
//! ```
//!
//! Seen from a user at distance `r` on the ground, `s = r / cos(theta)`. A threshold `L_max` is met up to
//!
//! ```text
//! r(theta) = cos(theta) c / (4 pi f) 10^((L_max - eta_NLoS + (eta_NLoS - eta_LoS) P_LoS) / 20)
//! ```
//!
//! and the elevation at the rim of the largest disk depends neither on `L_max` nor on `f`: there
//! `d ln r / d theta = 0`, which is
//!
//! ```text
//! tan(theta) = (ln 10 / 20) (eta_NLoS - eta_LoS) (180 / pi) P'_LoS(theta),   P'_LoS = b P_LoS (1 - P_LoS)
//! ```
//!
//! # Assumptions
//! Flat ground, users at height zero, isotropic antennas (gains belong in the threshold), mean loss without
//! fading. The excess losses are those of 2 GHz; the free-space part follows the frequency.
//!
//! # Source
//! A. Al-Hourani, S. Kandeepan, S. Lardner, "Optimal LAP Altitude for Maximum Coverage", IEEE Wireless
//! Communications Letters 3 (2014); parameters of its four environments at 2 GHz.

use std::f64::consts::{FRAC_PI_2, LN_10, PI};

use serde::Serialize;

/// Speed of light, metres a second.
const LIGHT_MPS: f64 = 299_792_458.0;
/// Elevations tried before the best one is refined: a tenth of a degree apart.
const ELEVATIONS: u32 = 900;
/// Halvings of an interval until it is rounding.
const HALVINGS: usize = 100;

/// What the drone flies over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Environment {
    /// Villages and suburbs.
    Suburban,
    /// A town.
    Urban,
    /// A city with tall houses.
    DenseUrban,
    /// A city of towers.
    Highrise,
}

/// What the model knows of an environment.
struct Parameters {
    /// The S-curve's `a`, degrees.
    a_deg: f64,
    /// Its `b`, per degree.
    b_per_deg: f64,
    /// Loss beyond that of free space with line of sight, dB.
    los_excess_db: f64,
    /// And without.
    nlos_excess_db: f64,
}

impl Environment {
    const fn parameters(self) -> Parameters {
        let [a_deg, b_per_deg, los_excess_db, nlos_excess_db] = match self {
            Self::Suburban => [4.88, 0.43, 0.1, 21.0],
            Self::Urban => [9.61, 0.16, 1.0, 20.0],
            Self::DenseUrban => [12.08, 0.11, 1.6, 23.0],
            Self::Highrise => [27.23, 0.08, 2.3, 34.0],
        };
        Parameters { a_deg, b_per_deg, los_excess_db, nlos_excess_db }
    }

    /// Probability that a user sees the drone at an elevation in radians, from 0 to a right angle.
    #[must_use]
    pub fn los_probability(self, elevation_rad: f64) -> f64 {
        let Parameters { a_deg, b_per_deg, .. } = self.parameters();
        1.0 / (1.0 + a_deg * (-b_per_deg * (elevation_rad.to_degrees() - a_deg)).exp())
    }

    /// Mean loss beyond that of free space at an elevation, dB.
    fn excess_db(self, elevation_rad: f64) -> f64 {
        let Parameters { los_excess_db, nlos_excess_db, .. } = self.parameters();
        let los = self.los_probability(elevation_rad);
        los * los_excess_db + (1.0 - los) * nlos_excess_db
    }

    /// Elevation of the drone at the rim of the largest disk that it can serve, radians.
    ///
    /// `ln r` may have a second, lower summit close to the ground, where hardly anybody has line of sight, so the
    /// highest one is looked for first, and the root of the derivative then bracketed around it.
    #[must_use]
    pub fn optimum_elevation_rad(self) -> f64 {
        let step_rad = FRAC_PI_2 / f64::from(ELEVATIONS);
        let log_radius = |theta: f64| theta.cos().ln() - LN_10 / 20.0 * self.excess_db(theta);
        let tried = (0..ELEVATIONS).map(|k| f64::from(k) * step_rad);
        let best = tried.max_by(|x, y| log_radius(*x).total_cmp(&log_radius(*y))).unwrap_or_default();
        let Parameters { b_per_deg, los_excess_db, nlos_excess_db, .. } = self.parameters();
        let gain = LN_10 / 20.0 * (nlos_excess_db - los_excess_db) * b_per_deg * 180.0 / PI;
        let rises = |theta: f64| {
            let los = self.los_probability(theta);
            gain * los * (1.0 - los) > theta.tan()
        };
        bisect((best - step_rad).max(0.0), best + step_rad, rises)
    }
}

/// A link from a drone to users on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AirToGround {
    /// What lies between.
    pub environment: Environment,
    /// Carrier frequency, hertz, above 0.
    pub frequency_hz: f64,
    /// Greatest mean loss with which a user is served, dB.
    pub max_path_loss_db: f64,
}

/// The disk that a drone serves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ServedDisk {
    /// Height of the drone above ground, metres.
    pub altitude_m: f64,
    /// Radius of the disk on the ground, metres.
    pub radius_m: f64,
    /// Elevation of the drone at its rim, degrees.
    pub elevation_deg: f64,
}

impl AirToGround {
    /// Mean loss to a user at a distance on the ground, dB; the two lengths must not both be zero.
    #[must_use]
    pub fn path_loss_db(&self, altitude_m: f64, radius_m: f64) -> f64 {
        let range_m = altitude_m.hypot(radius_m);
        let free_space_db = 20.0 * (4.0 * PI * self.frequency_hz * range_m / LIGHT_MPS).log10();
        free_space_db + self.environment.excess_db(altitude_m.atan2(radius_m))
    }

    /// The largest disk that can be served from any altitude.
    #[must_use]
    pub fn largest(&self) -> ServedDisk {
        let theta = self.environment.optimum_elevation_rad();
        let left_db = self.max_path_loss_db - self.environment.excess_db(theta);
        let range_m = LIGHT_MPS / (4.0 * PI * self.frequency_hz) * 10f64.powf(left_db / 20.0);
        ServedDisk {
            altitude_m: range_m * theta.sin(),
            radius_m: range_m * theta.cos(),
            elevation_deg: theta.to_degrees(),
        }
    }

    /// The disk served from an altitude above 0; none where not even the user right below is served.
    ///
    /// Farther out the way is longer and the drone lower, so the loss grows with the distance on the ground.
    #[must_use]
    pub fn from_altitude(&self, altitude_m: f64) -> Option<ServedDisk> {
        let served = |radius_m: f64| self.path_loss_db(altitude_m, radius_m) <= self.max_path_loss_db;
        if !served(0.0) {
            return None;
        }
        // With line of sight all around free space would end here.
        let beyond_m = LIGHT_MPS / (4.0 * PI * self.frequency_hz) * 10f64.powf(self.max_path_loss_db / 20.0);
        let radius_m = bisect(0.0, beyond_m, served);
        Some(ServedDisk { altitude_m, radius_m, elevation_deg: altitude_m.atan2(radius_m).to_degrees() })
    }
}

/// Where what holds at `low` ceases to, below `high`.
fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        *(if holds(middle) { &mut low } else { &mut high }) = middle;
    }
    low
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const ALL: [Environment; 4] =
        [Environment::Suburban, Environment::Urban, Environment::DenseUrban, Environment::Highrise];

    #[test]
    fn truth_the_optimum_elevations_are_those_published() {
        for (environment, published_deg) in ALL.into_iter().zip([20.34, 42.44, 54.62, 75.52]) {
            let found_deg = environment.optimum_elevation_rad().to_degrees();
            assert!((found_deg - published_deg).abs() < 0.006, "{environment:?}: {found_deg}");
        }
    }

    /// Environment, threshold, frequency, best altitude, radius there and from 300 m: printed by
    /// `truth_air_to_ground.py`.
    #[rustfmt::skip]
    const SCIPY: [(Environment, f64, f64, f64, f64, f64); 16] = [
        (Environment::Suburban, 100.0, 2.0e9, 403.689, 1089.050563, 1036.214711),
        (Environment::Suburban, 110.0, 2.0e9, 1276.576, 3443.880267, 1663.167419),
        (Environment::Suburban, 95.0, 7.0e8, 648.602, 1749.766106, 1320.710367),
        (Environment::Suburban, 105.0, 5.8e9, 247.542, 667.805584, 655.949818),
        (Environment::Urban, 100.0, 2.0e9, 646.040, 706.548767, 516.137935),
        (Environment::Urban, 110.0, 2.0e9, 2042.958, 2234.303383, 800.786715),
        (Environment::Urban, 95.0, 7.0e8, 1037.986, 1135.204486, 618.602915),
        (Environment::Urban, 105.0, 5.8e9, 396.152, 433.255560, 406.630804),
        (Environment::DenseUrban, 100.0, 2.0e9, 630.949, 448.074864, 337.764592),
        (Environment::DenseUrban, 110.0, 2.0e9, 1995.236, 1416.937131, 544.980247),
        (Environment::DenseUrban, 95.0, 7.0e8, 1013.739, 719.917179, 411.735286),
        (Environment::DenseUrban, 105.0, 5.8e9, 386.898, 274.759415, 260.989036),
        (Environment::Highrise, 100.0, 2.0e9, 234.904, 60.668129, 57.844507),
        (Environment::Highrise, 110.0, 2.0e9, 742.830, 191.849469, 146.970621),
        (Environment::Highrise, 95.0, 7.0e8, 377.417, 97.474846, 94.933427),
        (Environment::Highrise, 105.0, 5.8e9, 144.043, 37.201684, 9.320200),
    ];

    #[test]
    fn truth_scipy_finds_the_same_disks() {
        for (environment, max_path_loss_db, frequency_hz, altitude_m, radius_m, from_300_m) in SCIPY {
            let link = AirToGround { environment, frequency_hz, max_path_loss_db };
            let largest = link.largest();
            assert!((largest.radius_m - radius_m).abs() < 1e-5, "{link:?}: {largest:?}");
            // At a summit the radius hardly depends on the altitude, so a search finds that less well.
            assert!((largest.altitude_m / altitude_m - 1.0).abs() < 1e-4, "{link:?}: {largest:?}");
            let found_m = link.from_altitude(300.0).map_or(0.0, |disk| disk.radius_m);
            assert!((found_m - from_300_m).abs() < 1e-5, "{link:?}: {found_m}");
        }
    }

    proptest! {
        #[test]
        fn no_altitude_serves_more_than_the_optimum(
            which in 0..4usize, max_path_loss_db in 80.0..130.0f64, frequency_hz in 5e8..6e9f64, share in 0.01..5.0f64,
        ) {
            let link = AirToGround { environment: ALL[which], frequency_hz, max_path_loss_db };
            let largest = link.largest();
            let at_rim_db = link.path_loss_db(largest.altitude_m, largest.radius_m);
            prop_assert!((at_rim_db - max_path_loss_db).abs() < 1e-9);
            if let Some(other) = link.from_altitude(largest.altitude_m * share) {
                prop_assert!(other.radius_m <= largest.radius_m * (1.0 + 1e-9), "{:?} {:?}", other, largest);
                let at_rim_db = link.path_loss_db(other.altitude_m, other.radius_m);
                prop_assert!((at_rim_db - max_path_loss_db).abs() < 1e-6);
            }
            let same = link.from_altitude(largest.altitude_m).map_or(0.0, |disk| disk.radius_m);
            prop_assert!((same / largest.radius_m - 1.0).abs() < 1e-6, "{} {:?}", same, largest);
        }
    }
}
