//! 95 % radii of users beside the lane, by what is known and what is not.

use rayon::prelude::*;

use super::pass::{Covariance, Heard};
use super::trusted::{Gains, widened};
use super::{AccuracyError, Curve, Formation, TradeOff};
use crate::control::localize::{ClockModel, LocalizeConfig, Robust, r95};
use crate::geometry::V2;

/// Users who share the clocks where these are unknown.
pub const SYNC_USERS: usize = 20;
/// How densely they live along the lane: as in the paper's scenario.
pub const USERS_PER_KM2: f64 = 5.0;

/// Most offsets of a table; they lie a round number of metres apart.
const MOST_OFFSETS: usize = 10;
/// Clocks are followed as finely as this noise needs, 0.8 s at the missions' walk, and not more finely: the walk in between
/// is 0.06 ns.
const FINEST_SIGMA_NS: f64 = 1.0;
/// Parts of half a swath that medians are taken over, and that curves are drawn by.
const PARTS: usize = 20;
const CURVE_PARTS: usize = 40;

/// One user's pass: what the noise does to its fix, and what errors do that stay the same.
struct Pass {
    bound: Covariance,
    gains: Gains,
}

impl Pass {
    fn with_clocks_off(&self, sigma_ns: f64) -> Covariance {
        widened(self.bound, self.gains.clock_m_per_ns, sigma_ns)
    }

    fn with_drones_off(&self, sigma_m: f64) -> Covariance {
        widened(self.bound, self.gains.position.into_iter().flatten(), sigma_m)
    }
}

/// The wider circle of each user's two sides.
fn widest_m(users: &[Option<Pass>], covariance: impl Fn(&Pass) -> Covariance) -> Vec<f64> {
    let covariances: Vec<_> = users.iter().map(|pass| pass.as_ref().map(&covariance)).collect();
    covariances.chunks(2).map(worse).collect()
}

/// The wider of two circles; without a bound there is none.
fn worse(bounds: &[Option<Covariance>]) -> f64 {
    bounds.iter().map(|bound| bound.map_or(f64::INFINITY, r95)).fold(0.0, f64::max)
}

fn sides(offset_m: f64) -> [V2; 2] {
    [V2::new(0.0, offset_m), V2::new(0.0, -offset_m)]
}

impl Formation {
    /// Clocks, drones and ground as they are assumed.
    pub(super) fn known(&self) -> LocalizeConfig {
        LocalizeConfig {
            // Captures bring their own; this sets how finely walking clocks are followed.
            sigma_toa_ns: self.sigma_toa_ns.max(FINEST_SIGMA_NS),
            clock: ClockModel::Synchronised,
            drone_pos_sigma_m: 0.0,
            robust: Robust::None,
            ..LocalizeConfig::default()
        }
    }

    /// From 0 to the last one within the swath, in equal round steps.
    pub(super) fn round_offsets_m(&self) -> Vec<f64> {
        let half_m = self.swath_radius_m();
        let power = 10f64.powf((half_m / MOST_OFFSETS as f64).log10().floor());
        let fits = |step_m: &f64| half_m / step_m < MOST_OFFSETS as f64;
        let step_m = [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(fits).unwrap_or(20.0 * power);
        let offsets = (0..MOST_OFFSETS).map(|k| k as f64 * step_m);
        offsets.take_while(|offset_m| *offset_m < half_m).collect()
    }

    /// That many, from the lane to just within the edge of the swath.
    fn even_offsets_m(&self, parts: usize) -> Vec<f64> {
        (0..parts).map(|k| self.swath_radius_m() * k as f64 / parts as f64).collect()
    }

    /// Radii of users who have nothing in common that is unknown.
    pub(super) fn radii_m(
        &self,
        offset_m: &[f64],
        heard: Heard,
        cfg: &LocalizeConfig,
    ) -> Result<Vec<f64>, AccuracyError> {
        let users_m: Vec<V2> = offset_m.iter().flat_map(|&offset_m| sides(offset_m)).collect();
        Ok(self.bounds(&users_m, heard, cfg)?.chunks(2).map(worse).collect())
    }

    /// Radii of users of whom each shares unknown clocks with others along the lane, on the side that would be worse with
    /// known clocks.
    pub(super) fn shared_m(&self, offset_m: &[f64], clock: ClockModel) -> Result<Vec<f64>, AccuracyError> {
        let cfg = LocalizeConfig { clock, ..self.known() };
        let radius_m = |&offset_m: &f64| {
            let both_m = sides(offset_m);
            let known = self.bounds(&both_m, Heard::WholePass, &self.known())?;
            let [left, right] = [0, 1].map(|side| worse(&known[side..=side]));
            let at_m = both_m[usize::from(right > left)];
            let users_m: Vec<V2> = std::iter::once(at_m).chain(self.others_m()).collect();
            Ok(worse(&self.bounds(&users_m, Heard::WholePass, &cfg)?[..1]))
        };
        offset_m.par_iter().map(radius_m).collect()
    }

    /// Everybody else along the lane: evenly along it, and from side to side by the golden section, so that
    /// neighbours lie apart.
    fn others_m(&self) -> impl Iterator<Item = V2> {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let half_m = self.swath_radius_m();
        let stretch_m = SYNC_USERS as f64 / (USERS_PER_KM2 * 1e-6 * 2.0 * half_m);
        let others = SYNC_USERS - 1;
        (0..others).map(move |k| {
            let along = (k as f64 + 0.5) / others as f64 - 0.5;
            let across = 2.0 * (GOLDEN * (k as f64 + 0.5)).fract() - 1.0;
            V2::new(along * stretch_m, 0.95 * across * half_m)
        })
    }

    /// Users of a whole pass at both sides of the lane, with the clocks known.
    fn passes(&self, offset_m: &[f64]) -> Result<Vec<Option<Pass>>, AccuracyError> {
        let users_m: Vec<V2> = offset_m.iter().flat_map(|&offset_m| sides(offset_m)).collect();
        let bounds = self.bounds(&users_m, Heard::WholePass, &self.known())?;
        let pass = |(&user_m, bound): (&V2, Option<Covariance>)| {
            bound.map(|bound| Pass { bound, gains: self.gains(user_m, bound) })
        };
        Ok(users_m.iter().zip(bounds).map(pass).collect())
    }

    /// Radii with the clocks taken as known and off by constants.
    pub(super) fn with_residual_m(
        &self,
        offset_m: &[f64],
        residual_ns: f64,
    ) -> Result<Vec<f64>, AccuracyError> {
        Ok(widest_m(&self.passes(offset_m)?, |pass| pass.with_clocks_off(residual_ns)))
    }

    /// Radii with the drones off by constants from where they say.
    pub(super) fn with_drone_bias_m(&self, offset_m: &[f64], bias_m: f64) -> Result<Vec<f64>, AccuracyError> {
        Ok(widest_m(&self.passes(offset_m)?, |pass| pass.with_drones_off(bias_m)))
    }

    /// Median and worst of a whole pass over the swath.
    pub(super) fn trade_off(&self) -> Result<TradeOff, AccuracyError> {
        let mut r95_m = self.radii_m(&self.even_offsets_m(PARTS), Heard::WholePass, &self.known())?;
        r95_m.sort_by(f64::total_cmp);
        Ok(TradeOff {
            spacing_m: self.spacing_m,
            altitude_m: self.altitude_m,
            swath_m: 2.0 * self.swath_radius_m(),
            r95_median_m: 0.5 * (r95_m[PARTS / 2 - 1] + r95_m[PARTS / 2]),
            r95_worst_m: r95_m[PARTS - 1],
        })
    }

    /// Whole passes against the offset.
    pub(super) fn curve(&self) -> Result<Vec<[f64; 2]>, AccuracyError> {
        let offset_m = self.even_offsets_m(CURVE_PARTS);
        let r95_m = self.radii_m(&offset_m, Heard::WholePass, &self.known())?;
        Ok(offset_m.into_iter().zip(r95_m).map(<[f64; 2]>::from).collect())
    }

    /// Whole passes against the residual error of clocks, from 0.1 to 10 ns.
    pub(super) fn residual_curve(&self, offset_m: f64) -> Result<Curve, AccuracyError> {
        let users = self.passes(&[offset_m])?;
        let points = (0..=CURVE_PARTS).flat_map(|k| {
            let residual_ns = 10f64.powf(2.0 * k as f64 / CURVE_PARTS as f64 - 1.0);
            let widened = |pass: &Pass| pass.with_clocks_off(residual_ns);
            widest_m(&users, widened).into_iter().map(move |r95_m| [residual_ns, r95_m])
        });
        Ok(Curve { of: offset_m, points: points.collect() })
    }
}
