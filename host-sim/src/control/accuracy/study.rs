//! The figures to choose a formation by: radii of the circles that hold 95 %, in metres. Infinite where the captures
//! do not determine a position.

use rayon::prelude::*;

use super::pass::Heard;
use super::{AccuracyError, Formation};
use crate::control::localize::{ClockModel, LocalizeConfig};

/// What tables and curves compare.
const SIGMAS_NS: [f64; 6] = [1.0, 2.0, 5.0, 10.0, 20.0, 30.0];
const RESIDUALS_NS: [f64; 3] = [1.0, 3.0, 10.0];
const DRONE_BIASES_M: [f64; 3] = [0.0, 0.02, 1.5];
const TERRAIN_SIGMAS_M: [f64; 3] = [0.0, 10.0, 30.0];
const SPACINGS_M: [f64; 4] = [20.0, 50.0, 100.0, 200.0];
const ALTITUDES_M: [f64; 5] = [50.0, 100.0, 200.0, 300.0, 500.0];

/// What is known of the drones' clocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sync {
    /// Everything.
    Known,
    /// All but constant offsets, estimated from [`super::SYNC_USERS`] users.
    ConstantOffsets,
    /// What missions assume: offset, drift and walk unknown, estimated likewise.
    Mission,
    /// Taken as known, and each off by a constant of this standard deviation in nanoseconds.
    Residual(f64),
}

/// Radii at [`Accuracy::offset_m`].
#[derive(Clone, Debug, PartialEq)]
pub struct OffsetRow<T> {
    /// What sets this row apart.
    pub of: T,
    /// One for each offset.
    pub r95_m: Vec<f64>,
}

/// Radii as a curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// What sets this curve apart, in its unit.
    pub of: f64,
    /// Abscissa and radius.
    pub points: Vec<[f64; 2]>,
}

/// One formation of the table of sides and altitudes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TradeOff {
    /// Side of the triangle.
    pub spacing_m: f64,
    /// Height above the users.
    pub altitude_m: f64,
    /// Width of the swath.
    pub swath_m: f64,
    /// Median over users spread evenly from the lane to 95 % of half the swath.
    pub r95_median_m: f64,
    /// Greatest among them.
    pub r95_worst_m: f64,
}

/// How well users beside a lane can be located. Clocks are known, drones are where they say and the ground
/// is where it is assumed unless a field says otherwise. Of the two sides of the lane the worse one counts.
#[derive(Clone, Debug, PartialEq)]
pub struct Accuracy {
    /// Of which formation.
    pub formation: Formation,
    /// Distances from the lane that all rows have.
    pub offset_m: Vec<f64>,
    /// SRS of a pass, one number for each offset.
    pub srs: Vec<usize>,
    /// One SRS, with the fleet abreast.
    pub one_srs_m: Vec<f64>,
    /// A whole pass; as everything below.
    pub pass_m: Vec<f64>,
    /// By the noise of arrival times in nanoseconds, with the clocks of [`Sync::Mission`].
    pub sigma: Vec<OffsetRow<f64>>,
    /// By what is known of the clocks.
    pub sync: Vec<OffsetRow<Sync>>,
    /// By the error of each coordinate of a drone's position, constant over the pass: its standard deviation in metres.
    pub drone_bias: Vec<OffsetRow<f64>>,
    /// By the standard deviation of the users' altitude in metres.
    pub terrain: Vec<OffsetRow<f64>>,
    /// Sides and altitudes, side by side.
    pub trade_off: Vec<TradeOff>,
    /// Against the offset, one curve for each side of the triangle.
    pub spacing_curves: Vec<Curve>,
    /// Against the offset, one curve for each altitude.
    pub altitude_curves: Vec<Curve>,
    /// Against [`Sync::Residual`], one curve for each of some offsets.
    pub residual_curves: Vec<Curve>,
}

impl Accuracy {
    /// Computes everything for a formation.
    ///
    /// # Errors
    /// What [`Formation::check`] finds.
    pub fn of(formation: Formation) -> Result<Self, AccuracyError> {
        formation.check()?;
        let offset_m = formation.round_offsets_m();
        let known = formation.known();
        let pass_m = formation.radii_m(&offset_m, Heard::WholePass, &known)?;
        let one_srs_m = formation.radii_m(&offset_m, Heard::Once, &known)?;
        let mission = LocalizeConfig::default().clock;
        let sigma = rows(&with(&SIGMAS_NS, formation.sigma_toa_ns), |sigma_toa_ns| {
            Formation { sigma_toa_ns, ..formation }.shared_m(&offset_m, mission)
        })?;
        let mut sync = vec![
            OffsetRow { of: Sync::Known, r95_m: pass_m.clone() },
            OffsetRow {
                of: Sync::ConstantOffsets,
                r95_m: formation.shared_m(&offset_m, ClockModel::SharedConstant)?,
            },
        ];
        let own = sigma.iter().find(|row| same(row.of, formation.sigma_toa_ns));
        sync.extend(own.map(|row| OffsetRow { of: Sync::Mission, r95_m: row.r95_m.clone() }));
        let residuals = rows(&RESIDUALS_NS, |ns| formation.with_residual_m(&offset_m, ns))?;
        sync.extend(
            residuals.into_iter().map(|row| OffsetRow { of: Sync::Residual(row.of), r95_m: row.r95_m }),
        );
        let drone_bias = rows(&DRONE_BIASES_M, |bias_m| formation.with_drone_bias_m(&offset_m, bias_m))?;
        let terrain = rows(&TERRAIN_SIGMAS_M, |user_altitude_sigma_m| {
            let uncertain = LocalizeConfig { user_altitude_sigma_m, ..known };
            formation.radii_m(&offset_m, Heard::WholePass, &uncertain)
        })?;
        let spacings: Vec<Formation> = with(&SPACINGS_M, formation.spacing_m)
            .into_iter()
            .map(|spacing_m| Formation { spacing_m, ..formation })
            .filter(|other| other.check().is_ok())
            .collect();
        let at_altitudes = |it: Formation| {
            with(&ALTITUDES_M, it.altitude_m)
                .into_iter()
                .map(move |altitude_m| Formation { altitude_m, ..it })
        };
        let altitudes: Vec<Formation> = at_altitudes(formation).collect();
        let all: Vec<Formation> = spacings.iter().copied().flat_map(at_altitudes).collect();
        let residual_curves = (0..3)
            .filter_map(|third| offset_m.get(shown_offset(third, offset_m.len())))
            .map(|&offset_m| formation.residual_curve(offset_m))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            trade_off: all.par_iter().map(Formation::trade_off).collect::<Result<_, _>>()?,
            spacing_curves: curves(&spacings, |it| it.spacing_m)?,
            altitude_curves: curves(&altitudes, |it| it.altitude_m)?,
            residual_curves,
            srs: offset_m.iter().map(|&offset_m| formation.srs_of_pass(offset_m)).collect(),
            formation,
            offset_m,
            one_srs_m,
            pass_m,
            sigma,
            sync,
            drone_bias,
            terrain,
        })
    }
}

impl Formation {
    /// How well missions locate: offsets from the lane and 95 % radii, with the clocks of [`Sync::Mission`]. As
    /// [`Accuracy::sigma`] has it for one's own noise, without everything else.
    ///
    /// # Errors
    /// What [`Formation::check`] finds.
    pub fn mission_radii_m(&self) -> Result<Vec<[f64; 2]>, AccuracyError> {
        self.check()?;
        let offset_m = self.round_offsets_m();
        let r95_m = self.shared_m(&offset_m, LocalizeConfig::default().clock)?;
        Ok(offset_m.into_iter().zip(r95_m).map(<[f64; 2]>::from).collect())
    }
}

/// A row for each value.
fn rows(
    values: &[f64],
    row_m: impl Fn(f64) -> Result<Vec<f64>, AccuracyError>,
) -> Result<Vec<OffsetRow<f64>>, AccuracyError> {
    values.iter().map(|&of| Ok(OffsetRow { of, r95_m: row_m(of)? })).collect()
}

/// A curve for each formation.
fn curves(formations: &[Formation], of: impl Fn(&Formation) -> f64) -> Result<Vec<Curve>, AccuracyError> {
    formations.iter().map(|formation| Ok(Curve { of: of(formation), points: formation.curve()? })).collect()
}

/// Which of `offsets` is drawn against the residual error of clocks: near, middle and far.
#[must_use]
pub(super) fn shown_offset(third: usize, offsets: usize) -> usize {
    (4 * third * offsets.saturating_sub(1)) / 9
}

/// Whether two positive numbers would be written alike.
fn same(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.max(b)
}

/// Sorted values, with one's own among them.
fn with(values: &[f64], own: f64) -> Vec<f64> {
    let mut all = values.to_vec();
    if !all.iter().any(|value| same(*value, own)) {
        all.push(own);
    }
    all.sort_by(f64::total_cmp);
    all
}
