//! A grid of squares that serves twice: as buckets of users, and as the first squares of centres,
//! each with an upper bound on what a drone in it can gain.

use std::ops::Range;

use super::queue::Queue;
use crate::geometry::V2;

/// Squares per longest reach, where the area is small enough to afford it: measured optimum.
const SQUARES_PER_REACH: f64 = 24.0;

/// How far the circumscribed disk of a square sticks out of it, in sides, rounded up.
const BULGE: f64 = 0.25;

/// Users bucketed in squares, and per square the weight that lies within reach of it.
#[derive(Debug)]
pub(super) struct Cells {
    origin_m: V2,
    side_m: f64,
    layout: Layout,
    /// `members[start[c]..start[c + 1]]` are the users of square `c`.
    start: Vec<u32>,
    members: Vec<u32>,
    /// Upper bound of the gain of any centre in the square.
    ceiling: Vec<f64>,
}

/// Squares are numbered row by row.
#[derive(Debug)]
struct Layout {
    columns: usize,
    rows: usize,
    /// The squares within the longest reach of a square: `half_widths[|dy|]` columns to either side.
    half_widths: Vec<usize>,
}

impl Cells {
    /// Grid over `positions_m`, widened by `reach_m`, so that every centre that gains anything lies in it.
    ///
    /// Needs at least one position and a positive reach.
    pub(super) fn new(positions_m: &[V2], reach_m: f64) -> Self {
        assert!(!positions_m.is_empty() && reach_m > 0.0, "a grid needs users and a reach");
        let low = positions_m.iter().fold(positions_m[0], |a, p| a.inf(p)) - V2::repeat(reach_m);
        let high = positions_m.iter().fold(positions_m[0], |a, p| a.sup(p)) + V2::repeat(reach_m);
        // Wide and thinly peopled areas get larger squares; branch and bound splits those it needs.
        let affordable = (2048 + 8 * positions_m.len()) as f64;
        let squares = |side_m: f64| (high - low).map(|extent| (extent / side_m).floor() + 1.0);
        let mut side_m = reach_m / SQUARES_PER_REACH;
        while squares(side_m).product() > affordable {
            side_m *= 2.0;
        }
        let (columns, rows) = (squares(side_m).x as usize, squares(side_m).y as usize);

        let mut grid = Self {
            origin_m: low,
            side_m,
            layout: Layout { columns, rows, half_widths: half_widths(reach_m / side_m + BULGE) },
            start: vec![0; columns * rows + 1],
            members: vec![0; positions_m.len()],
            ceiling: vec![0.0; columns * rows],
        };
        let home: Vec<usize> = positions_m.iter().map(|&p| grid.square_of(p)).collect();
        for &square in &home {
            grid.start[square + 1] += 1;
        }
        for square in 0..columns * rows {
            grid.start[square + 1] += grid.start[square];
        }
        let mut next = grid.start.clone();
        for (user, &square) in home.iter().enumerate() {
            grid.members[next[square] as usize] = user as u32;
            next[square] += 1;
        }
        grid
    }

    /// Changes the weight of a user at `position_m` in every square within `reach_m` of it.
    pub(super) fn add_weight(&mut self, position_m: V2, reach_m: f64, difference: f64) {
        // In sides from the corner. Distances are rounded: a hair more reach keeps the bound on the safe side.
        let at = (position_m - self.origin_m) / self.side_m;
        let reach = reach_m / self.side_m + 1e-9;
        let within = |from: f64, to: f64, count: usize| {
            from.max(0.0) as usize..((to.max(0.0) as usize).saturating_add(1)).min(count)
        };
        for row in within(at.y - reach, at.y + reach, self.layout.rows) {
            let gap = (row as f64 - at.y).max(at.y - (row + 1) as f64).max(0.0);
            let half = (reach * reach - gap * gap).max(0.0).sqrt();
            let columns = within(at.x - half, at.x + half, self.layout.columns);
            let first = row * self.layout.columns;
            for ceiling in &mut self.ceiling[first + columns.start..first + columns.end] {
                *ceiling += difference;
            }
        }
    }

    /// The square with the highest ceiling, the first of equals.
    pub(super) fn highest(&self) -> usize {
        let ceilings = self.ceiling.iter().enumerate();
        ceilings.fold((0, f64::NEG_INFINITY), |a, (square, &c)| if c > a.1 { (square, c) } else { a }).0
    }

    /// Squares whose ceiling is at least `least`, to be popped by falling ceiling, ties by index.
    pub(super) fn by_ceiling(&self, least: f64) -> Queue<usize> {
        let above = self.ceiling.iter().enumerate().filter(|&(_, &ceiling)| ceiling >= least);
        above.map(|(square, &ceiling)| (ceiling, square)).collect()
    }

    /// Middle and half side of a square.
    pub(super) fn square(&self, square: usize) -> (V2, f64) {
        let corner = V2::new((square % self.layout.columns) as f64, (square / self.layout.columns) as f64);
        (self.origin_m + (corner + V2::repeat(0.5)) * self.side_m, 0.5 * self.side_m)
    }

    /// Users within the longest reach of the circumscribed disk of the square, and some more.
    pub(super) fn within_reach(&self, square: usize) -> impl Iterator<Item = u32> + '_ {
        self.layout
            .rows_near(square)
            .flat_map(|row| &self.members[self.start[row.start] as usize..self.start[row.end] as usize])
            .copied()
    }

    /// The square that holds `at`; centres outside the grid belong to the nearest square.
    pub(super) fn square_of(&self, at: V2) -> usize {
        let place = (at - self.origin_m) / self.side_m;
        let index = |x: f64, count: usize| (x.max(0.0) as usize).min(count - 1);
        index(place.y, self.layout.rows) * self.layout.columns + index(place.x, self.layout.columns)
    }
}

impl Layout {
    /// The squares within the longest reach of a square, row by row.
    fn rows_near(&self, square: usize) -> impl Iterator<Item = Range<usize>> {
        let (x, y) = (square % self.columns, square / self.columns);
        let most = self.half_widths.len() - 1;
        (y.saturating_sub(most)..=(y + most).min(self.rows - 1)).map(move |row| {
            let half = self.half_widths[row.abs_diff(y)];
            row * self.columns + x.saturating_sub(half)..row * self.columns + (x + half + 1).min(self.columns)
        })
    }
}

/// By rows up or down, how many columns to either side hold squares within `reach` sides of a square.
fn half_widths(reach: f64) -> Vec<usize> {
    // Squares d rows or columns apart leave a gap of d - 1 sides.
    let rows = reach.floor() as usize + 1;
    (0..=rows)
        .map(|dy| {
            let gap = dy.saturating_sub(1) as f64;
            (reach * reach - gap * gap).max(0.0).sqrt().floor() as usize + 1
        })
        .collect()
}
