//! The exact kernel: what a few stadiums leave uncovered of a small ring.
//!
//! All borders are cut into curves that climb monotonically from south to north (straight pieces and arcs).
//! The latitudes where curves begin, end or meet cut the plane into slabs; within a slab the order of the
//! curves from west to east is fixed, so what is uncovered is read off along the slab's middle line, and
//! each uncovered piece, bounded by two curves, has an area in closed form. A crossing missed or misplaced
//! by rounding misjudges only a sliver of its own slab: nothing here can go wrong at a distance.

use super::super::V2;
use super::Stadium;

/// Slabs lower than this and gaps narrower than this are rounding errors of curves that coincide.
const ROUNDING_M: f64 = 1e-7;

/// Arcs of the residue are drawn with chords that stray by no more than about this.
const DRAWING_TOLERANCE_M: f64 = 0.05;

/// A curve that climbs from `low` to `high`: x as a function of y.
#[derive(Clone, Copy, Debug)]
struct Curve {
    low: f64,
    high: f64,
    /// The stadium it bounds, or none for the ring's border.
    owner: Option<usize>,
    shape: Shape,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    /// Through a point, with dx/dy.
    Line { through: V2, slope: f64 },
    /// West (-1) or east (+1) half of a circle.
    Arc { centre: V2, radius_m: f64, side: f64 },
}

impl Curve {
    fn x(&self, y: f64) -> f64 {
        match self.shape {
            Shape::Line { through, slope } => through.x + slope * (y - through.y),
            Shape::Arc { centre, radius_m, side } => {
                let t = y - centre.y;
                centre.x + side * (radius_m * radius_m - t * t).max(0.0).sqrt()
            }
        }
    }

    /// Integral of x - x0 over y in `[low, high]`.
    fn integral(&self, low: f64, high: f64, x0: f64) -> f64 {
        match self.shape {
            Shape::Line { .. } => (self.x((low + high) / 2.0) - x0) * (high - low),
            Shape::Arc { centre, radius_m, side } => {
                let primitive = |y: f64| {
                    let t = (y - centre.y).clamp(-radius_m, radius_m);
                    (t * (radius_m * radius_m - t * t).max(0.0).sqrt()
                        + radius_m * radius_m * (t / radius_m).asin())
                        / 2.0
                };
                (centre.x - x0) * (high - low) + side * (primitive(high) - primitive(low))
            }
        }
    }

    /// Least and greatest x over y in `[low, high]`.
    fn span_x(&self, low: f64, high: f64) -> [f64; 2] {
        let (a, b) = (self.x(low), self.x(high));
        let mut span = [a.min(b), a.max(b)];
        if let Shape::Arc { centre, radius_m, side } = self.shape
            && low < centre.y
            && centre.y < high
        {
            span[usize::from(side > 0.0)] = centre.x + side * radius_m;
        }
        span
    }
}

/// Reusable memory of the kernel.
#[derive(Default)]
pub(super) struct Kernel {
    ring: Vec<Curve>,
    sides: Vec<Curve>,
    levels: Vec<f64>,
    border: Vec<(f64, usize)>,
    chords: Vec<(f64, f64, usize, usize)>,
    open: Vec<Piece>,
    grown: Vec<Piece>,
}

/// A residue polygon under construction: its west and its east border, from south to north.
struct Piece {
    west: Vec<V2>,
    east: Vec<V2>,
}

impl Kernel {
    /// Adds to `residue` what the stadiums leave uncovered of a ring, and returns its area, m2.
    pub(super) fn uncovered(
        &mut self,
        ring_m: &[V2],
        stadiums: impl Iterator<Item = Stadium>,
        residue: &mut Vec<Vec<V2>>,
    ) -> f64 {
        self.take_curves(ring_m, stadiums);
        self.find_levels();
        let mut area_m2 = 0.0;
        let mut index = 0;
        while index + 1 < self.levels.len() {
            let (low, high) = (self.levels[index], self.levels[index + 1]);
            index += 1;
            area_m2 += self.slab(low, high, residue);
        }
        residue.extend(self.open.drain(..).map(Piece::finish));
        area_m2
    }

    fn take_curves(&mut self, ring_m: &[V2], stadiums: impl Iterator<Item = Stadium>) {
        self.ring.clear();
        self.sides.clear();
        self.levels.clear();
        let [mut min, mut max] = [ring_m[0]; 2];
        for (&a, &b) in ring_m.iter().zip(ring_m.iter().cycle().skip(1)) {
            (min, max) = (min.inf(&a), max.sup(&a));
            push_line(&mut self.ring, a, b, None);
            self.levels.push(a.y);
        }
        for (owner, s) in stadiums.enumerate() {
            push_stadium(&mut self.sides, s, owner);
        }
        // A stadium that a slab does not reach has no chord there, and needs none.
        self.sides.retain(|c| c.high > min.y && c.low < max.y);
        for c in &self.sides {
            self.levels.extend([c.low, c.high].into_iter().filter(|&y| min.y < y && y < max.y));
        }
        let meets = |c: &Curve| {
            let [west, east] = c.span_x(c.low.max(min.y), c.high.min(max.y));
            west <= max.x && east >= min.x
        };
        let near: Vec<Curve> = self.sides.iter().copied().filter(meets).collect();
        for (i, c) in near.iter().enumerate() {
            for d in near[i + 1..].iter().filter(|d| d.owner != c.owner).chain(&self.ring) {
                let [low, high] = [c.low.max(d.low).max(min.y), c.high.min(d.high).min(max.y)];
                if low < high {
                    let found = crossings(&c.shape, &d.shape);
                    self.levels.extend(found.into_iter().flatten().filter(|&y| low < y && y < high));
                }
            }
        }
    }

    fn find_levels(&mut self) {
        self.levels.sort_by(f64::total_cmp);
        self.levels.dedup_by(|b, a| *b - *a <= ROUNDING_M);
    }

    /// Uncovered area of one slab; joins its pieces to those that end at its lower border.
    fn slab(&mut self, low: f64, high: f64, residue: &mut Vec<Vec<V2>>) -> f64 {
        let middle = (low + high) / 2.0;
        let spans = |c: &Curve| c.low < middle && middle < c.high;
        self.border.clear();
        self.border
            .extend(self.ring.iter().enumerate().filter(|(_, c)| spans(c)).map(|(i, c)| (c.x(middle), i)));
        self.border.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.chords.clear();
        // The sides of one stadium follow one another, its west side first.
        let mut west: Option<usize> = None;
        for (i, c) in self.sides.iter().enumerate().filter(|(_, c)| spans(c)) {
            match west {
                Some(w) if self.sides[w].owner == c.owner => {
                    self.chords.push((self.sides[w].x(middle), c.x(middle), w, i));
                    west = None;
                }
                _ => west = Some(i),
            }
        }
        self.chords.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut area_m2 = 0.0;
        for pair in self.border.chunks_exact(2) {
            let (mut from, end) = ((pair[0].0, self.ring[pair[0].1]), (pair[1].0, self.ring[pair[1].1]));
            for &(west, east, w, e) in &self.chords {
                if west >= end.0 || from.0 >= end.0 {
                    break;
                }
                let to = (west, self.sides[w]);
                area_m2 += join(&mut self.open, &mut self.grown, from, to, [low, high]);
                if east > from.0 {
                    from = (east, self.sides[e]);
                }
            }
            area_m2 += join(&mut self.open, &mut self.grown, from, end, [low, high]);
        }
        residue.extend(self.open.drain(..).map(Piece::finish));
        std::mem::swap(&mut self.open, &mut self.grown);
        area_m2
    }
}

/// Area between two curves over a slab; draws the piece on to an open one where it continues it.
fn join(
    open: &mut Vec<Piece>,
    grown: &mut Vec<Piece>,
    (x_west, west): (f64, Curve),
    (x_east, east): (f64, Curve),
    [low, high]: [f64; 2],
) -> f64 {
    if x_east - x_west <= ROUNDING_M {
        return 0.0;
    }
    let area_m2 = (east.integral(low, high, x_west) - west.integral(low, high, x_west)).max(0.0);
    let foot = [V2::new(west.x(low), low), V2::new(east.x(low), low)];
    let same = |p: Option<&V2>, q: V2| p.is_some_and(|p| (p - q).norm() <= 10.0 * ROUNDING_M);
    let continues = |p: &Piece| same(p.west.last(), foot[0]) && same(p.east.last(), foot[1]);
    let mut piece = match open.iter().position(continues) {
        Some(i) => open.swap_remove(i),
        None => Piece { west: vec![foot[0]], east: vec![foot[1]] },
    };
    draw(&mut piece.west, &west, low, high);
    draw(&mut piece.east, &east, low, high);
    grown.push(piece);
    area_m2
}

fn draw(points: &mut Vec<V2>, curve: &Curve, low: f64, high: f64) {
    if let Shape::Arc { centre, radius_m, side } = curve.shape {
        let angle = |y: f64| ((y - centre.y) / radius_m).clamp(-1.0, 1.0).asin();
        let (from, to) = (angle(low), angle(high));
        // A chord over the angle a strays by r a^2 / 8.
        let chords = ((to - from) / (8.0 * DRAWING_TOLERANCE_M / radius_m).sqrt()).ceil();
        points.extend((1..chords as usize).map(|k| {
            let t = from + (to - from) * k as f64 / chords;
            centre + V2::new(side * t.cos(), t.sin()) * radius_m
        }));
    }
    points.push(V2::new(curve.x(high), high));
}

impl Piece {
    fn finish(self) -> Vec<V2> {
        let mut ring = self.east;
        ring.extend(self.west.into_iter().rev());
        ring.dedup_by(|b, a| (*b - *a).norm() <= ROUNDING_M);
        ring
    }
}

fn push_line(curves: &mut Vec<Curve>, a: V2, b: V2, owner: Option<usize>) {
    let (south, north) = if a.y <= b.y { (a, b) } else { (b, a) };
    if north.y > south.y {
        let slope = (north.x - south.x) / (north.y - south.y);
        curves.push(Curve {
            low: south.y,
            high: north.y,
            owner,
            shape: Shape::Line { through: south, slope },
        });
    }
}

/// Border of a stadium. With the axis climbing from a to b, each side climbs along the disk of a, the
/// straight side, and the disk of b; level by level the western curve comes right before the eastern one.
fn push_stadium(curves: &mut Vec<Curve>, s: Stadium, owner: usize) {
    let (a, b, r) = if s.a.y <= s.b.y { (s.a, s.b, s.radius_m) } else { (s.b, s.a, s.radius_m) };
    let length_m = (b - a).norm();
    let axis = if length_m > 0.0 { (b - a) / length_m } else { V2::new(0.0, 1.0) };
    for side in [-1.0, 1.0] {
        // Where the straight side touches the two disks: `axis` turned towards that side.
        let normal = V2::new(axis.y, -axis.x) * side;
        let (ya, yb) = (a.y + r * normal.y, b.y + r * normal.y);
        let arc = |centre, low, high| Curve {
            low,
            high,
            owner: Some(owner),
            shape: Shape::Arc { centre, radius_m: r, side },
        };
        curves.push(arc(a, a.y - r, ya));
        push_line(curves, a + normal * r, b + normal * r, Some(owner));
        curves.push(arc(b, yb, b.y + r));
    }
}

/// Latitudes where two curves, continued to whole lines and circles, meet.
fn crossings(c: &Shape, d: &Shape) -> [Option<f64>; 2] {
    match (*c, *d) {
        (Shape::Line { through: p, slope: m }, Shape::Line { through: q, slope: n }) => {
            let y = p.y + (q.x - p.x + n * (p.y - q.y)) / (m - n);
            [y.is_finite().then_some(y), None]
        }
        (Shape::Line { through, slope }, Shape::Arc { centre, radius_m, .. })
        | (Shape::Arc { centre, radius_m, .. }, Shape::Line { through, slope }) => {
            let along = V2::new(slope, 1.0).normalize();
            let foot = (centre - through).dot(&along);
            let off = (through + along * foot - centre).norm_squared();
            let half = radius_m * radius_m - off;
            if half < 0.0 {
                return [None; 2];
            }
            [-1.0, 1.0].map(|s| Some(through.y + along.y * (foot + s * half.sqrt())))
        }
        (Shape::Arc { centre: p, radius_m: r, .. }, Shape::Arc { centre: q, radius_m: s, .. }) => {
            let between = q - p;
            let distance2 = between.norm_squared();
            if distance2 <= 0.0 {
                return [None; 2];
            }
            // The chord of the lens stands across the line of centres, `t` of the way along it.
            let t = (distance2 + (r - s) * (r + s)) / (2.0 * distance2);
            let half = r * r - t * t * distance2;
            if half < 0.0 {
                return [None; 2];
            }
            let across = half.sqrt() / distance2.sqrt();
            [-1.0, 1.0].map(|sign| Some(p.y + t * between.y + sign * across * between.x))
        }
    }
}
