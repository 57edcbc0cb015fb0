//! The velocity nearest to a wanted one in an intersection of half-planes.
//!
//! `min |v - v_w|^2 / 2` subject to `n_k . v >= b_k` has the answer `v = v_w + sum lambda_k n_k` with
//! `lambda >= 0`. Hildreth's dual coordinate ascent finds the weights: one row at a time, the weight
//! that satisfies this row exactly, never below zero (C. Hildreth, "A quadratic programming procedure",
//! Naval Research Logistics Quarterly 4 (1957) 79-85). The rows are soft (a small diagonal in the
//! dual), so that rows that contradict each other still get the best compromise, and the number of
//! sweeps is fixed, so that the time is.

use super::walls::MAX_WALL_ROWS;
use crate::{Vec3, scalar::greater};

/// Most rows: two for each of 32 neighbours, and those of walls.
pub const MAX_ROWS: usize = 64 + MAX_WALL_ROWS;
/// Sweeps over all rows.
const SWEEPS: usize = 16;
/// Softness of the rows: share of a violation that may remain per unit of weight.
const SOFTNESS: f32 = 0.01;

/// A normal of which stretching leaves less than this says nothing.
const LEAST_NORMAL: f32 = 0.1;

/// Velocities `v` with `normal . v >= at_least`; `normal` has length one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HalfPlane {
    /// Unit vector towards the allowed side.
    pub normal: Vec3,
    /// Least speed along it, metres a second.
    pub at_least: f32,
}

impl HalfPlane {
    /// Whether `v` is on the allowed side.
    #[must_use]
    pub fn allows(&self, v: &Vec3) -> bool {
        self.normal.dot(v) >= self.at_least
    }

    /// This half-plane where velocities up and down are measured in units `by` times as large; none where what is left of
    /// it is nearly upright on no velocity at all.
    pub(super) fn stretched(&self, by: f32) -> Option<Self> {
        let normal = Vec3::new(self.normal.x, self.normal.y, self.normal.z * by);
        let length = normal.norm();
        (length > LEAST_NORMAL).then(|| Self { normal: normal / length, at_least: self.at_least / length })
    }
}

/// The point nearest to `wanted` that all rows allow, or nearly allow where they contradict.
#[must_use]
pub fn nearest(wanted: Vec3, rows: &[HalfPlane]) -> Vec3 {
    let mut weights = [0.0f32; MAX_ROWS];
    let mut v = wanted;
    for _ in 0..SWEEPS {
        for (row, weight) in rows.iter().zip(&mut weights) {
            let short = row.at_least - row.normal.dot(&v) - SOFTNESS * *weight;
            let step = greater(short / (1.0 + SOFTNESS), -*weight);
            *weight += step;
            v += row.normal * step;
        }
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn row(x: f32, y: f32, z: f32, at_least: f32) -> HalfPlane {
        HalfPlane { normal: Vec3::new(x, y, z).normalize(), at_least }
    }

    #[test]
    fn contradicting_rows_meet_in_the_middle() {
        let v = nearest(Vec3::zeros(), &[row(1.0, 0.0, 0.0, 4.0), row(-1.0, 0.0, 0.0, 4.0)]);
        assert!(v.iter().all(|x| x.is_finite()));
        assert!(v.norm() < 5.0, "{v}");
    }

    proptest! {
        /// One row: the projection, up to the softness.
        #[test]
        fn one_row_projects(v in prop::array::uniform3(-10.0f32..10.0), n in prop::array::uniform3(-1.0f32..1.0), b in -10.0f32..10.0) {
            let n = Vec3::from(n);
            prop_assume!(n.norm() > 0.1);
            let (wanted, row) = (Vec3::from(v), HalfPlane { normal: n.normalize(), at_least: b });
            let found = nearest(wanted, &[row]);
            let expected = wanted + row.normal * greater(b - row.normal.dot(&wanted), 0.0);
            prop_assert!((found - expected).norm() < 0.02 * (1.0 + b.abs() + wanted.norm()));
        }

        /// Rows that a common point satisfies are satisfied, up to the softness, and the answer is no
        /// farther from the wanted velocity than that point.
        #[test]
        fn feasible_rows_are_kept(wanted in prop::array::uniform3(-10.0f32..10.0), inside in prop::array::uniform3(-5.0f32..5.0),
                                  normals in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 1..6)) {
            let inside = Vec3::from(inside);
            let rows: Vec<HalfPlane> = normals.iter().map(|n| Vec3::from(*n)).filter(|n| n.norm() > 0.1)
                .map(|n| { let normal = n.normalize(); HalfPlane { normal, at_least: normal.dot(&inside) - 1.0 } }).collect();
            let wanted = Vec3::from(wanted);
            let found = nearest(wanted, &rows);
            prop_assert!((found - wanted).norm() <= (inside - wanted).norm() + 0.5);
            for row in &rows {
                prop_assert!(row.normal.dot(&found) >= row.at_least - 1.0, "{:?} at {}", row, found);
            }
        }
    }
}
