//! Errors that stay the same over a pass and that nobody estimates: of clocks taken as synchronised, and of positions.
//!
//! Averaging does not help against these, and they hardly show in the residuals of one user: the fix moves. By how much follows
//! from the linearised estimator. With the unit vector `u` from drone to user, its mean over an occasion's drones
//! taken off (`v = u - mean u`, which projects out the emission time), and the covariance `C` of the fix,
//! an error of a distance by `e` in every capture of a drone moves the fix by `C sum(v e) / (c sigma)^2`.

use super::Formation;
use super::pass::{Covariance, Heard};
use crate::control::localize::C_M_PER_NS;
use crate::geometry::V2;

/// By how much a fix moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gains {
    /// For a nanosecond of each drone's clock.
    pub(super) clock_m_per_ns: [V2; 3],
    /// For a metre of each drone's position: east, north, up.
    pub(super) position: [[V2; 3]; 3],
}

impl Formation {
    /// Gains of a user heard for a whole pass. `cov_m2` is its bound with the clocks known.
    pub(super) fn gains(&self, user_m: V2, cov_m2: Covariance) -> Gains {
        let (mut clock, mut position) = ([V2::zeros(); 3], [[V2::zeros(); 3]; 3]);
        for along_m in self.asked_along_m(user_m, Heard::WholePass) {
            let units = self.drones_m(along_m).map(|[x, y, z]| {
                let way_m = [user_m.x - x, user_m.y - y, -z];
                let distance_m = way_m[0].hypot(way_m[1]).hypot(way_m[2]);
                way_m.map(|way_m| way_m / distance_m)
            });
            let mean: [f64; 2] = [0, 1].map(|axis| units.iter().map(|u| u[axis]).sum::<f64>() / 3.0);
            for (drone, unit) in units.iter().enumerate() {
                let slope = V2::new(unit[0] - mean[0], unit[1] - mean[1]);
                clock[drone] += slope * C_M_PER_NS;
                for (gain, unit) in position[drone].iter_mut().zip(unit) {
                    *gain += slope * *unit;
                }
            }
        }
        let info = (C_M_PER_NS * self.sigma_toa_ns).powi(-2);
        let solved = |sum: V2| {
            info * V2::new(
                cov_m2[0][0] * sum.x + cov_m2[0][1] * sum.y,
                cov_m2[1][0] * sum.x + cov_m2[1][1] * sum.y,
            )
        };
        Gains { clock_m_per_ns: clock.map(solved), position: position.map(|axes| axes.map(solved)) }
    }
}

/// `cov_m2` and what independent errors of standard deviation `sigma` add to it.
pub(super) fn widened(cov_m2: Covariance, gains: impl IntoIterator<Item = V2>, sigma: f64) -> Covariance {
    gains
        .into_iter()
        .map(|gain| gain * sigma)
        .fold(cov_m2, |cov, shift| [0, 1].map(|i| [0, 1].map(|j| cov[i][j] + shift[i] * shift[j])))
}
