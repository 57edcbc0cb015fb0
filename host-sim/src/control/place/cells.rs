//! A grid of squares that serves twice: as buckets of users, and as the first squares of centres,
//! each with an upper bound on what a drone in it can gain.

use crate::geometry::V2;

/// Squares per longest reach, where the area is small enough to afford it.
const SQUARES_PER_REACH: f64 = 4.0;

/// How far the circumscribed disk of a square sticks out of it, in sides, rounded up.
const BULGE: f64 = 0.25;

/// Users bucketed in squares, and per square the weight that lies within reach of it.
#[derive(Debug)]
pub(super) struct Cells {
    origin_m: V2,
    side_m: f64,
    columns: usize,
    rows: usize,
    /// `members[start[c]..start[c + 1]]` are the users of square `c`.
    start: Vec<u32>,
    members: Vec<u32>,
    home: Vec<u32>,
    /// Squares within the longest reach of a square, as (column, row) differences. Symmetric.
    neighbours: Vec<(i32, i32)>,
    /// Upper bound of the gain of any centre in the square.
    ceiling: Vec<f64>,
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
        let affordable = (4096 + 16 * positions_m.len()) as f64;
        let squares = |side_m: f64| (high - low).map(|extent| (extent / side_m).floor() + 1.0);
        let mut side_m = reach_m / SQUARES_PER_REACH;
        while squares(side_m).product() > affordable {
            side_m *= 2.0;
        }
        let (columns, rows) = (squares(side_m).x as usize, squares(side_m).y as usize);

        let mut grid = Self {
            origin_m: low,
            side_m,
            columns,
            rows,
            start: vec![0; columns * rows + 1],
            members: vec![0; positions_m.len()],
            home: Vec::new(),
            neighbours: neighbours(reach_m / side_m),
            ceiling: vec![0.0; columns * rows],
        };
        grid.home = positions_m.iter().map(|&p| grid.square_of(p) as u32).collect();
        for &square in &grid.home {
            grid.start[square as usize + 1] += 1;
        }
        for square in 0..columns * rows {
            grid.start[square + 1] += grid.start[square];
        }
        let mut next = grid.start.clone();
        for (user, &square) in grid.home.iter().enumerate() {
            grid.members[next[square as usize] as usize] = user as u32;
            next[square as usize] += 1;
        }
        grid
    }

    /// Changes the weight of `user` by `difference` in every square within reach of it.
    pub(super) fn add_weight(&mut self, user: usize, difference: f64) {
        let home = self.home[user] as usize;
        for &offset in &self.neighbours {
            if let Some(square) = step(home, offset, self.columns, self.rows) {
                self.ceiling[square] += difference;
            }
        }
    }

    /// Squares by falling ceiling, ties by index; those below `least` left out.
    pub(super) fn by_ceiling(&self, least: f64) -> Vec<(f64, usize)> {
        let mut order: Vec<_> =
            self.ceiling.iter().enumerate().filter(|&(_, &c)| c >= least).map(|(i, &c)| (c, i)).collect();
        order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        order
    }

    /// Middle and half side of a square.
    pub(super) fn square(&self, square: usize) -> (V2, f64) {
        let corner = V2::new((square % self.columns) as f64, (square / self.columns) as f64);
        (self.origin_m + (corner + V2::repeat(0.5)) * self.side_m, 0.5 * self.side_m)
    }

    /// Users within the longest reach of the circumscribed disk of the square, and some more.
    pub(super) fn within_reach(&self, square: usize) -> impl Iterator<Item = u32> + '_ {
        self.neighbours
            .iter()
            .filter_map(move |&offset| step(square, offset, self.columns, self.rows))
            .flat_map(|s| &self.members[self.start[s] as usize..self.start[s + 1] as usize])
            .copied()
    }

    /// The square that holds `at`; centres outside the grid belong to the nearest square.
    pub(super) fn square_of(&self, at: V2) -> usize {
        let place = (at - self.origin_m) / self.side_m;
        let index = |x: f64, count: usize| (x.max(0.0) as usize).min(count - 1);
        index(place.y, self.rows) * self.columns + index(place.x, self.columns)
    }
}

fn step(square: usize, (dx, dy): (i32, i32), columns: usize, rows: usize) -> Option<usize> {
    let x = (square % columns).checked_add_signed(dx as isize).filter(|&x| x < columns)?;
    let y = (square / columns).checked_add_signed(dy as isize).filter(|&y| y < rows)?;
    Some(y * columns + x)
}

/// Differences of squares whose least distance is within `reach` (in sides) of the bulging square.
fn neighbours(reach: f64) -> Vec<(i32, i32)> {
    let reach = reach + BULGE;
    let most = reach.ceil() as i32 + 1;
    let gap = |d: i32| f64::from((d.abs() - 1).max(0));
    (-most..=most)
        .flat_map(|dy| (-most..=most).map(move |dx| (dx, dy)))
        .filter(|&(dx, dy)| gap(dx).hypot(gap(dy)) <= reach)
        .collect()
}
