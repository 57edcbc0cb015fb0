//! Lanes over a convex polygon, in the sweep frame: x along the lanes, y across them.
//!
//! A lane serves a strip no higher than a swath. Strips of equal height are the plain choice; where the
//! polygon's height is no whole number of swaths, there is slack to distribute, and a polygon that is wider at
//! one side than at the other gains by high strips where it is wide. The heights are found by dynamic
//! programming over the length of the lanes alone, then refined on the length of the whole way.

use crate::geometry::V2;
use crate::geometry::polygon::Polygon;

/// Share of a swath that a polygon may be wider than a whole number of swaths: rounding, not another lane.
const WIDTH_SLACK: f64 = 1e-9;

/// Lanes tried beyond the least number: shorter lanes, as lower strips let them end earlier.
const EXTRA_LANES: usize = 1;

/// Heights at which a border between two strips is tried first.
const HEIGHTS: usize = 17;

/// Rounds of the refinement; the gain of further ones is below a metre in ten kilometres.
const ROUNDS: usize = 3;

/// Steps of a golden-section search: 0.618^18 of the slack is some centimetres.
const GOLDEN_STEPS: usize = 18;

/// One lane: a straight leg that covers a strip of the polygon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lane {
    /// Height of the strip's southern border.
    pub(super) low_m: f64,
    /// Height of its northern border.
    pub(super) high_m: f64,
    /// Its western end.
    pub(super) west_m: V2,
    /// Its eastern end, equal to the western one where a single position covers the strip.
    pub(super) east_m: V2,
}

impl Lane {
    fn length_m(&self) -> f64 {
        self.east_m.x - self.west_m.x
    }

    /// Where it begins when flown eastwards, or westwards.
    fn start_m(&self, eastwards: bool) -> V2 {
        if eastwards { self.west_m } else { self.east_m }
    }

    /// From its end to the beginning of the next lane, which runs the other way.
    fn change_m(&self, next: &Self, eastwards: bool) -> f64 {
        (next.start_m(!eastwards) - self.start_m(!eastwards)).norm()
    }
}

/// A convex polygon as its western and its eastern border, each from south to north.
pub(super) struct Chains {
    west: Vec<V2>,
    east: Vec<V2>,
}

impl Chains {
    pub(super) fn new(polygon: &Polygon) -> Self {
        let v = polygon.vertices_m();
        let n = v.len();
        // The vertices run anticlockwise: from the south end the eastern border comes first.
        let lower = |a: &V2, b: &V2| a.y.total_cmp(&b.y);
        let south = (0..n).min_by(|&i, &j| lower(&v[i], &v[j])).unwrap_or_default();
        let north = (0..n).max_by(|&i, &j| lower(&v[i], &v[j])).unwrap_or_default();
        let steps = (north + n - south) % n;
        let mut east: Vec<V2> = (0..=steps).map(|k| v[(south + k) % n]).collect();
        let mut west: Vec<V2> = (0..=n - steps).map(|k| v[(south + n - k) % n]).collect();
        // A level edge belongs to neither: each border begins and ends at its own corner of it.
        for chain in [&mut east, &mut west] {
            while let [first, second, ..] = chain[..]
                && first.y >= second.y
            {
                chain.remove(0);
            }
            while let [.., before, last] = chain[..]
                && before.y >= last.y
            {
                chain.pop();
            }
        }
        Self { west, east }
    }

    fn south_m(&self) -> f64 {
        self.west.first().map_or(0.0, |p| p.y)
    }

    fn north_m(&self) -> f64 {
        self.west.last().map_or(0.0, |p| p.y)
    }

    /// The shortest leg halfway up a strip whose points, each with a disk of radius r, cover the strip.
    ///
    /// A stadium is convex, so it covers the strip when it covers the strip's vertices. The leg comes within r
    /// of the vertex (x_k, y_k) when it meets the interval `x_k -+ sqrt(r^2 - (y_k - y)^2)`: it has to begin
    /// before the first of these intervals ends and end after the last of them begins. The first end is that
    /// of a western vertex, the last beginning that of an eastern one.
    fn lane(&self, low_m: f64, high_m: f64, radius_m: f64) -> Lane {
        let y_m = f64::midpoint(low_m, high_m);
        let half = |p: V2| (radius_m * radius_m - (p.y - y_m).powi(2)).max(0.0).sqrt();
        let mut west = Span::default();
        let mut first_end = f64::INFINITY;
        in_strip(&self.west, low_m, high_m, |p| {
            west.take(p.x);
            first_end = first_end.min(p.x + half(p));
        });
        let mut east = Span::default();
        let mut last_begin = f64::NEG_INFINITY;
        in_strip(&self.east, low_m, high_m, |p| {
            east.take(p.x);
            last_begin = last_begin.max(p.x - half(p));
        });
        if first_end > last_begin {
            // All intervals have points in common: any of them will do, the middle of those over the strip.
            let x_m = f64::midpoint(last_begin.max(west.low), first_end.min(east.high));
            (first_end, last_begin) = (x_m, x_m);
        }
        Lane { low_m, high_m, west_m: V2::new(first_end, y_m), east_m: V2::new(last_begin, y_m) }
    }

    fn lanes(&self, borders_m: &[f64], radius_m: f64) -> Vec<Lane> {
        borders_m.windows(2).map(|w| self.lane(w[0], w[1], radius_m)).collect()
    }
}

struct Span {
    low: f64,
    high: f64,
}

impl Default for Span {
    fn default() -> Self {
        Self { low: f64::INFINITY, high: f64::NEG_INFINITY }
    }
}

impl Span {
    fn take(&mut self, x: f64) {
        (self.low, self.high) = (self.low.min(x), self.high.max(x));
    }
}

/// The points of a border that decide about a strip: where it enters and leaves, and the vertices between.
fn in_strip(chain: &[V2], low_m: f64, high_m: f64, mut take: impl FnMut(V2)) {
    let above = |y: f64| chain.partition_point(|p| p.y <= y);
    let at = |y: f64, next: usize| {
        let next = next.clamp(1, chain.len() - 1);
        let (a, b) = (chain[next - 1], chain[next]);
        let share = ((y - a.y) / (b.y - a.y)).clamp(0.0, 1.0);
        V2::new(a.x + (b.x - a.x) * share, y)
    };
    let (first, last) = (above(low_m), above(high_m));
    take(at(low_m, first));
    chain[first.min(last)..last].iter().for_each(|&p| take(p));
    take(at(high_m, last));
}

/// The least number of equal strips no higher than a swath: plain lanes, from south to north.
pub(super) fn plain_lanes(chains: &Chains, swath_m: f64) -> Vec<Lane> {
    let (south, north) = (chains.south_m(), chains.north_m());
    let count = least_count(north - south, swath_m);
    chains.lanes(&equal_borders_m(south, north, count), swath_m / 2.0)
}

/// The shortest sets of lanes found with the least number of strips, and with one more.
pub(super) fn good_lanes(chains: &Chains, swath_m: f64) -> Vec<Vec<Lane>> {
    let (south, north) = (chains.south_m(), chains.north_m());
    let least = least_count(north - south, swath_m);
    let mut sets = Vec::new();
    for count in least.max(2)..=(least + EXTRA_LANES).max(2) {
        let slack_m = count as f64 * swath_m - (north - south);
        let tried = Borders { chains, swath_m, south_m: south, north_m: north, count, slack_m }.optimised();
        sets.extend(tried);
    }
    sets
}

fn least_count(height_m: f64, swath_m: f64) -> usize {
    (height_m / swath_m - WIDTH_SLACK).ceil().max(1.0) as usize
}

fn equal_borders_m(south_m: f64, north_m: f64, count: usize) -> Vec<f64> {
    (0..=count).map(|k| south_m + (north_m - south_m) * k as f64 / count as f64).collect()
}

/// The search for the heights of the borders between strips.
struct Borders<'a> {
    chains: &'a Chains,
    swath_m: f64,
    south_m: f64,
    north_m: f64,
    count: usize,
    /// Height that the strips could cover beyond the polygon's.
    slack_m: f64,
}

impl Borders<'_> {
    /// The best borders found for a way that begins in the west, and in the east.
    fn optimised(&self) -> Vec<Vec<Lane>> {
        if self.slack_m <= WIDTH_SLACK * self.swath_m || self.count < 2 {
            return Vec::new();
        }
        let radius_m = self.swath_m / 2.0;
        let starts = [equal_borders_m(self.south_m, self.north_m, self.count), self.by_length_of_lanes()];
        [true, false]
            .into_iter()
            .flat_map(|from_west| starts.iter().map(move |borders_m| (from_west, borders_m.clone())))
            .map(|(from_west, mut borders_m)| {
                let mut lanes = self.chains.lanes(&borders_m, radius_m);
                for _ in 0..ROUNDS {
                    for k in 1..self.count {
                        self.refine(&mut borders_m, &mut lanes, k, from_west);
                    }
                }
                // With more than a swath of slack a strip may have shrunk to nothing.
                lanes.retain(|lane| lane.high_m - lane.low_m > WIDTH_SLACK * self.swath_m);
                lanes
            })
            .collect()
    }

    /// Highest allowed position of the border `k` above the south end, less `slack_m` times `1 - u`: with
    /// u from 1 to 0 the border takes all positions that leave no strip higher than a swath, and strips are
    /// no higher than that exactly when u never grows from one border to the next.
    fn border_m(&self, k: usize, u: f64) -> f64 {
        (self.south_m + k as f64 * self.swath_m - self.slack_m * (1.0 - u)).clamp(self.south_m, self.north_m)
    }

    /// Borders with the least length of all lanes, changes between them left out, by dynamic programming.
    fn by_length_of_lanes(&self) -> Vec<f64> {
        let radius_m = self.swath_m / 2.0;
        let u = |step: usize| 1.0 - step as f64 / (HEIGHTS - 1) as f64;
        let mut best = vec![f64::INFINITY; HEIGHTS];
        best[0] = 0.0;
        let mut choices: Vec<Vec<usize>> = Vec::with_capacity(self.count);
        for k in 1..=self.count {
            let last = k == self.count;
            let step = |to: usize| {
                let reached = best[..=to]
                    .iter()
                    .enumerate()
                    .filter(|(_, cost_m)| cost_m.is_finite() && (!last || to == HEIGHTS - 1));
                let costs_m = reached.map(|(from, cost_m)| {
                    let (low, high) = (self.border_m(k - 1, u(from)), self.border_m(k, u(to)));
                    (cost_m + self.chains.lane(low, high, radius_m).length_m(), from)
                });
                costs_m.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, 0))
            };
            let (costs_m, choice) = (0..HEIGHTS).map(step).unzip();
            best = costs_m;
            choices.push(choice);
        }
        let mut borders_m = vec![self.north_m; self.count + 1];
        let mut at = HEIGHTS - 1;
        for k in (1..=self.count).rev() {
            at = choices[k - 1][at];
            borders_m[k - 1] = self.border_m(k - 1, u(at));
        }
        borders_m[0] = self.south_m;
        borders_m
    }

    /// Moves one border to where the way is shortest, the others staying.
    fn refine(&self, borders_m: &mut [f64], lanes: &mut [Lane], k: usize, from_west: bool) {
        let radius_m = self.swath_m / 2.0;
        let (mut low, mut high) = (
            borders_m[k - 1].max(borders_m[k + 1] - self.swath_m),
            borders_m[k + 1].min(borders_m[k - 1] + self.swath_m),
        );
        let pair = |y: f64| {
            [self.chains.lane(borders_m[k - 1], y, radius_m), self.chains.lane(y, borders_m[k + 1], radius_m)]
        };
        let eastwards = |lane: usize| from_west == lane.is_multiple_of(2);
        let around = |[first, second]: &[Lane; 2]| {
            let before = k.checked_sub(2).map_or(0.0, |b| lanes[b].change_m(first, eastwards(b)));
            let after = lanes.get(k + 1).map_or(0.0, |next| second.change_m(next, eastwards(k)));
            before + after + first.length_m() + second.length_m() + first.change_m(second, eastwards(k - 1))
        };
        let golden = (5f64.sqrt() - 1.0) / 2.0;
        let mut inner = [high - golden * (high - low), low + golden * (high - low)];
        let mut cost = inner.map(|y| around(&pair(y)));
        for _ in 0..GOLDEN_STEPS {
            if cost[0] <= cost[1] {
                high = inner[1];
                inner = [high - golden * (high - low), inner[0]];
                cost = [around(&pair(inner[0])), cost[0]];
            } else {
                low = inner[0];
                inner = [inner[1], low + golden * (high - low)];
                cost = [cost[1], around(&pair(inner[1]))];
            }
        }
        let y = f64::midpoint(low, high);
        let found = pair(y);
        if around(&found) < around(&[lanes[k - 1], lanes[k]]) {
            borders_m[k] = y;
            lanes[k - 1..=k].copy_from_slice(&found);
        }
    }
}

/// The way along all lanes in turn, back and forth, the first one from its western or its eastern end.
pub(super) fn zigzag(lanes: &[Lane], from_west: bool) -> Vec<V2> {
    let mut path_m: Vec<V2> = Vec::with_capacity(2 * lanes.len());
    for (i, lane) in lanes.iter().enumerate() {
        let eastwards = from_west == i.is_multiple_of(2);
        let (start, end) = (lane.start_m(eastwards), lane.start_m(!eastwards));
        path_m.push(start);
        if end != start {
            path_m.push(end);
        }
    }
    path_m
}
