//! Points of the plane by place: who is within a radius?
//!
//! A square grid in compressed rows: points sorted by cell, one array of cell starts. Neighbouring cells of a row are
//! neighbours in memory, so a query reads one contiguous slice per row of cells.

use crate::geometry::V2;

/// More cells than this would cost more than they save; the cells grow instead.
const MAX_CELLS_PER_SIDE: f64 = 512.0;

/// A fixed set of points, indexed by place.
#[derive(Clone, Debug)]
pub struct PointGrid {
    corner_m: V2,
    cells_per_m: f64,
    columns: usize,
    rows: usize,
    /// Points of cell c: `starts[c]..starts[c + 1]`.
    starts: Vec<u32>,
    /// Position and index of each point, by cell, then by index.
    points: Vec<(V2, u32)>,
}

impl PointGrid {
    /// Indexes `points_m`. A cell of about the query radius serves well; the answers never depend on it.
    ///
    /// # Panics
    /// If a coordinate is not finite, the cell is not positive, or there are 2^32 points or more.
    #[must_use]
    pub fn new(points_m: &[V2], cell_m: f64) -> Self {
        assert!(cell_m > 0.0, "cells have an extent: {cell_m}");
        assert!(u32::try_from(points_m.len()).is_ok(), "too many points: {}", points_m.len());
        assert!(points_m.iter().all(|p| p.x.is_finite() && p.y.is_finite()), "points are finite");
        let low = points_m.iter().copied().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let high = points_m.iter().copied().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let extent = high - low;
        let cells_per_m = 1.0 / cell_m.max(extent.max() / MAX_CELLS_PER_SIDE);
        let count = |length_m: f64| (length_m * cells_per_m) as usize + 1;
        let (columns, rows) = (count(extent.x), count(extent.y));
        let mut grid = Self {
            corner_m: low,
            cells_per_m,
            columns,
            rows,
            starts: vec![0; columns * rows + 1],
            points: vec![],
        };

        let cell_of = |p: &V2| grid.row(p.y) * grid.columns + grid.column(p.x);
        let mut by_cell: Vec<(usize, u32)> = points_m.iter().map(cell_of).zip(0..).collect();
        by_cell.sort_unstable();
        grid.points = by_cell.iter().map(|&(_, index)| (points_m[index as usize], index)).collect();
        for &(cell, _) in &by_cell {
            grid.starts[cell + 1] += 1;
        }
        for cell in 1..grid.starts.len() {
            grid.starts[cell] += grid.starts[cell - 1];
        }
        grid
    }

    /// Indices of the points within `radius_m` of `centre_m`, border included, by cell, then by index: an order
    /// that depends on nothing but the points and the cell size. Nothing for a negative radius.
    pub fn within(&self, centre_m: V2, radius_m: f64) -> impl Iterator<Item = usize> + '_ {
        let radius_squared = if radius_m >= 0.0 { radius_m * radius_m } else { -1.0 };
        let columns = self.column(centre_m.x - radius_m)..=self.column(centre_m.x + radius_m);
        let rows = self.row(centre_m.y - radius_m)..=self.row(centre_m.y + radius_m);
        rows.flat_map(move |row| {
            let first = self.starts[row * self.columns + columns.start()] as usize;
            let end = self.starts[row * self.columns + columns.end() + 1] as usize;
            // A negative radius may leave the range reversed.
            self.points[first.min(end)..end].iter()
        })
        .filter(move |(point, _)| (point - centre_m).norm_squared() <= radius_squared)
        .map(|&(_, index)| index as usize)
    }

    /// How many points lie within `radius_m` of `centre_m`, border included: as many as [`PointGrid::within`] finds.
    ///
    /// Of each row of cells the middle ones lie in the disk as a whole and are counted by their starts; only points of
    /// the outer ones are looked at. So small cells serve well, a twentieth of the radius say.
    #[must_use]
    pub fn count_within(&self, centre_m: V2, radius_m: f64) -> usize {
        // Of a cell: more than coordinates lose to rounding where a cell begins or ends.
        const ROUNDING: f64 = 1e-6;
        if radius_m.is_nan() || radius_m < 0.0 {
            return 0;
        }
        let radius_squared = radius_m * radius_m;
        let at = (centre_m - self.corner_m) * self.cells_per_m;
        let reach_squared = (radius_m * self.cells_per_m + ROUNDING).powi(2);
        let inner_squared = (radius_m * self.cells_per_m - ROUNDING).max(0.0).powi(2);
        let mut count = 0;
        for row in self.row(centre_m.y - radius_m)..=self.row(centre_m.y + radius_m) {
            let (bottom, top) = (row as f64 - at.y, (row + 1) as f64 - at.y);
            let nearest = bottom.max(-top).max(0.0) - ROUNDING;
            let farthest = top.max(-bottom) + ROUNDING;
            let reach = (reach_squared - nearest.max(0.0).powi(2)).max(0.0).sqrt();
            let index = |column: f64| (column.max(0.0) as usize).min(self.columns);
            let outer =
                index(at.x - reach - ROUNDING)..(index(at.x + reach + ROUNDING) + 1).min(self.columns);
            let inner_half = (inner_squared - farthest * farthest).max(0.0).sqrt();
            // The columns that lie between the ends of the shorter of the two chords.
            let inner =
                index((at.x - inner_half + ROUNDING).ceil())..index((at.x + inner_half - ROUNDING).floor());
            let first = row * self.columns;
            let start = |column: usize| self.starts[first + column] as usize;
            let near = |range: std::ops::Range<usize>| {
                let points = self.points[range].iter();
                points.filter(|(point, _)| (point - centre_m).norm_squared() <= radius_squared).count()
            };
            if inner.start < inner.end && inner.start >= outer.start && inner.end <= outer.end {
                count += start(inner.end) - start(inner.start);
                count += near(start(outer.start)..start(inner.start));
                count += near(start(inner.end)..start(outer.end));
            } else if outer.start < outer.end {
                count += near(start(outer.start)..start(outer.end));
            }
        }
        count
    }

    /// Column of an abscissa, the nearest one if outside.
    fn column(&self, x_m: f64) -> usize {
        // The cast takes negative numbers to zero.
        (((x_m - self.corner_m.x) * self.cells_per_m) as usize).min(self.columns - 1)
    }

    /// Row of an ordinate, the nearest one if outside.
    fn row(&self, y_m: f64) -> usize {
        (((y_m - self.corner_m.y) * self.cells_per_m) as usize).min(self.rows - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_border_counts_and_nothing_is_found_in_nothing() {
        let points = [V2::new(3.0, 4.0), V2::new(-3.0, -4.0), V2::new(5.1, 0.0)];
        let grid = PointGrid::new(&points, 2.0);
        let mut found: Vec<usize> = grid.within(V2::zeros(), 5.0).collect();
        found.sort_unstable();
        assert_eq!(found, [0, 1]);
        assert_eq!(grid.within(V2::new(3.0, 4.0), 0.0).collect::<Vec<_>>(), [0]);
        assert_eq!(grid.within(V2::new(3.0, 4.0), -1.0).count(), 0);
        assert_eq!(PointGrid::new(&[], 2.0).within(V2::zeros(), 1e9).count(), 0);
    }

    #[test]
    fn far_apart_points_do_not_make_many_cells() {
        let points = [V2::new(-1e9, 0.0), V2::new(1e9, 1e9), V2::new(0.0, 0.0)];
        let grid = PointGrid::new(&points, 1.0);
        assert!(grid.starts.len() < 300_000);
        assert_eq!(grid.within(V2::new(1.0, 0.0), 1.0).collect::<Vec<_>>(), [2]);
    }

    proptest! {
        #[test]
        fn truth_finds_what_brute_force_finds(
            points in prop::collection::vec((-100.0..100.0_f64, -50.0..300.0_f64), 0..200),
            centre in (-150.0..150.0_f64, -100.0..400.0_f64),
            radius_m in 0.0..200.0_f64,
            cell_m in 0.5..400.0_f64,
        ) {
            let points: Vec<V2> = points.into_iter().map(|(x, y)| V2::new(x, y)).collect();
            let centre = V2::new(centre.0, centre.1);
            let mut found: Vec<usize> = PointGrid::new(&points, cell_m).within(centre, radius_m).collect();
            found.sort_unstable();
            let near = |i: &usize| (points[*i] - centre).norm_squared() <= radius_m * radius_m;
            prop_assert_eq!(found, (0..points.len()).filter(near).collect::<Vec<_>>());
        }

        /// On whole metres, so that points lie on the borders of cells and of the disk.
        #[test]
        fn truth_counts_what_brute_force_counts(
            points in prop::collection::vec((-40..40_i32, -20..60_i32), 0..400),
            centre in (-60..60_i32, -60..80_i32),
            radius in -1..60_i32,
            cells_per_10_m in 1..40_u32,
        ) {
            let at = |(x, y): (i32, i32)| V2::new(f64::from(x), f64::from(y));
            let points: Vec<V2> = points.into_iter().map(at).collect();
            let grid = PointGrid::new(&points, 10.0 / f64::from(cells_per_10_m));
            let (centre, radius_m) = (at(centre), f64::from(radius));
            let near = |p: &&V2| radius >= 0 && (*p - centre).norm_squared() <= radius_m * radius_m;
            prop_assert_eq!(grid.count_within(centre, radius_m), points.iter().filter(near).count());
        }
    }
}
