//! The order in which to fly lanes that lie anywhere: nearest neighbours, then 2-opt and or-opt.
//!
//! A lane may be flown either way, so an order is a list of lanes and directions; reversing part of an order also
//! turns each lane in it. The ends are free: no way leads back.

/// A lane of the order and whether it is flown from its second end to its first.
pub(super) type Leg = (usize, bool);

/// Starting points tried by the nearest-neighbour search.
const STARTS: usize = 24;

/// Most lanes moved together by or-opt.
const RUN: usize = 3;

/// Rounds of improvement; each is at least a metre better, and far fewer are needed.
const MOST_ROUNDS: usize = 200;

/// Less is no improvement, metres.
const GAIN_M: f64 = 1e-3;

/// Distances between ends of lanes: end `2 i` is the first and `2 i + 1` the second of lane `i`.
pub(super) struct Distances(pub(super) Vec<Vec<f64>>);

impl Distances {
    fn lanes(&self) -> usize {
        self.0.len() / 2
    }

    /// From the end of one leg to the beginning of the next.
    fn change_m(&self, from: Leg, to: Leg) -> f64 {
        self.0[2 * from.0 + usize::from(!from.1)][2 * to.0 + usize::from(to.1)]
    }

    /// Length of all changes of an order.
    pub(super) fn length_m(&self, order: &[Leg]) -> f64 {
        order.windows(2).fold(0.0, |sum, w| sum + self.change_m(w[0], w[1]))
    }
}

/// A short order of all lanes.
pub(super) fn order(distances: &Distances) -> Vec<Leg> {
    let n = distances.lanes();
    let step = (2 * n).div_ceil(STARTS).max(1);
    let starts = (0..2 * n).step_by(step).map(|end| (end / 2, end % 2 == 1));
    let mut best: Option<(f64, Vec<Leg>)> = None;
    for start in starts {
        let found = nearest(distances, start);
        let m = distances.length_m(&found);
        if best.as_ref().is_none_or(|(least, _)| m < *least) {
            best = Some((m, found));
        }
    }
    let mut order = best.map(|(_, order)| order).unwrap_or_default();
    improve(distances, &mut order);
    order
}

/// Each time the lane whose nearer end is nearest.
fn nearest(distances: &Distances, start: Leg) -> Vec<Leg> {
    let mut order = vec![start];
    let mut left: Vec<usize> = (0..distances.lanes()).filter(|i| *i != start.0).collect();
    let mut at = start;
    while !left.is_empty() {
        let legs = left.iter().enumerate().flat_map(|(k, &i)| [(k, (i, false)), (k, (i, true))]);
        let next = legs.min_by(|a, b| distances.change_m(at, a.1).total_cmp(&distances.change_m(at, b.1)));
        let Some((k, leg)) = next else { break };
        left.remove(k);
        order.push(leg);
        at = leg;
    }
    order
}

/// Takes every move that shortens the order, until none does.
pub(super) fn improve(distances: &Distances, order: &mut Vec<Leg>) {
    for _ in 0..MOST_ROUNDS {
        if !two_opt(distances, order) && !or_opt(distances, order) {
            break;
        }
    }
}

fn turned((lane, backwards): Leg) -> Leg {
    (lane, !backwards)
}

/// Reverses runs.
fn two_opt(distances: &Distances, order: &mut [Leg]) -> bool {
    let mut gained = false;
    for i in 0..order.len() {
        for j in i..order.len() {
            let mut gain_m = 0.0;
            if let Some(before) = i.checked_sub(1).map(|k| order[k]) {
                gain_m += distances.change_m(before, order[i]) - distances.change_m(before, turned(order[j]));
            }
            if let Some(&after) = order.get(j + 1) {
                gain_m += distances.change_m(order[j], after) - distances.change_m(turned(order[i]), after);
            }
            if gain_m > GAIN_M {
                order[i..=j].reverse();
                order[i..=j].iter_mut().for_each(|leg| *leg = turned(*leg));
                gained = true;
            }
        }
    }
    gained
}

/// Moves short runs elsewhere, turned or not.
fn or_opt(distances: &Distances, order: &mut Vec<Leg>) -> bool {
    let mut gained = false;
    for run in 1..=RUN.min(order.len().saturating_sub(1)) {
        let mut i = 0;
        while i + run <= order.len() {
            let piece: Vec<Leg> = order[i..i + run].to_vec();
            let mut rest: Vec<Leg> = order.clone();
            rest.drain(i..i + run);
            let link = |a: Option<&Leg>, b: Option<&Leg>| match (a, b) {
                (Some(a), Some(b)) => distances.change_m(*a, *b),
                _ => 0.0,
            };
            let cost_at = |k: usize, piece: &[Leg]| {
                let (before, after) = (k.checked_sub(1).and_then(|k| rest.get(k)), rest.get(k));
                link(before, piece.first()) + link(piece.last(), after) - link(before, after)
            };
            let here_m = cost_at(i, &piece);
            let back: Vec<Leg> = piece.iter().rev().map(|leg| turned(*leg)).collect();
            let best = (0..=rest.len())
                .flat_map(|k| [(cost_at(k, &piece), k, false), (cost_at(k, &back), k, true)])
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((m, k, reversed)) = best
                && here_m - m > GAIN_M
            {
                rest.splice(k..k, if reversed { back } else { piece });
                *order = rest;
                gained = true;
            }
            i += 1;
        }
    }
    gained
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::V2;

    fn distances(lanes: &[[V2; 2]]) -> Distances {
        let ends: Vec<V2> = lanes.concat();
        Distances(ends.iter().map(|a| ends.iter().map(|b| (a - b).norm()).collect()).collect())
    }

    #[test]
    fn parallel_lanes_become_a_zigzag() {
        let lanes: Vec<[V2; 2]> =
            [3, 0, 4, 1, 2].map(|k| [0.0, 5000.0].map(|x| V2::new(x, 900.0 * f64::from(k)))).to_vec();
        let distances = distances(&lanes);
        let found = order(&distances);
        assert!((distances.length_m(&found) - 4.0 * 900.0).abs() < 1e-6, "{found:?}");
    }

    /// All orders and directions.
    fn shortest_m(distances: &Distances, order: &mut Vec<Leg>, best: &mut f64) {
        let m = distances.length_m(order);
        if m >= *best {
            return;
        }
        if order.len() == distances.lanes() {
            *best = m;
            return;
        }
        for lane in 0..distances.lanes() {
            if order.iter().all(|leg| leg.0 != lane) {
                for backwards in [false, true] {
                    order.push((lane, backwards));
                    shortest_m(distances, order, best);
                    order.pop();
                }
            }
        }
    }

    proptest! {
        #[test]
        fn truth_few_lanes_are_ordered_almost_as_well_as_by_trying_all(
            ends in prop::collection::vec((0.0..5000.0f64, 0.0..5000.0f64, 0.0..3000.0f64), 1..6),
        ) {
            let lanes: Vec<[V2; 2]> = ends.iter().map(|&(x, y, m)| [V2::new(x, y), V2::new(x + m, y)]).collect();
            let distances = distances(&lanes);
            let found = order(&distances);
            let mut seen: Vec<usize> = found.iter().map(|leg| leg.0).collect();
            seen.sort_unstable();
            prop_assert_eq!(seen, (0..lanes.len()).collect::<Vec<_>>());
            let mut best = f64::INFINITY;
            shortest_m(&distances, &mut Vec::new(), &mut best);
            prop_assert!(distances.length_m(&found) <= 1.35 * best + 1e-6, "{} {}", distances.length_m(&found), best);
        }
    }
}
