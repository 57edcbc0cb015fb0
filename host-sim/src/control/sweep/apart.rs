//! How near the fleets come to each other on their lanes.

use crate::geometry::V2;

/// A flight as the times at which its corners are passed, from 0 on, seconds.
pub(super) type Flight = Vec<(f64, V2)>;

/// Distance that the centres of two fleets should keep: their triangles fit circles of `d / sqrt(3)`, and a
/// spacing more lies between those.
pub(super) fn clearance_m(spacing_m: f64) -> f64 {
    spacing_m * (2.0 / 3f64.sqrt() + 1.0)
}

/// Least distance between any two of some flights; none of a single one.
pub(super) fn separation_m(flights: &[Flight]) -> Option<f64> {
    let pairs = flights.iter().enumerate().flat_map(|(i, a)| flights[i + 1..].iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| closest_m(a, b)).reduce(f64::min)
}

/// Least distance between two flights that begin at once; who has ended waits.
///
/// Between two times at which neither passes a corner both fly straight on, and so does the one as the other
/// sees it: the distance is least at the foot of the perpendicular, or at an end.
pub(super) fn closest_m(a: &Flight, b: &Flight) -> f64 {
    let mut times_s: Vec<f64> = a.iter().chain(b).map(|(t, _)| *t).collect();
    times_s.sort_by(f64::total_cmp);
    times_s.dedup();
    let apart = |t: f64| at(a, t) - at(b, t);
    let Some(&first) = times_s.first() else { return f64::INFINITY };
    let mut from = apart(first);
    let mut least_m = from.norm();
    for &t in &times_s[1..] {
        let to = apart(t);
        let moved = to - from;
        let share = if moved.norm_squared() > 0.0 {
            (-from.dot(&moved) / moved.norm_squared()).clamp(0.0, 1.0)
        } else {
            0.0
        };
        least_m = least_m.min((from + moved * share).norm());
        from = to;
    }
    least_m
}

fn at(flight: &Flight, t_s: f64) -> V2 {
    let next = flight.partition_point(|(t, _)| *t <= t_s);
    match (next.checked_sub(1).and_then(|i| flight.get(i)), flight.get(next)) {
        (Some(&(t0, p)), Some(&(t1, q))) => p + (q - p) * ((t_s - t0) / (t1 - t0)),
        (Some(&(_, p)), None) | (None, Some(&(_, p))) => p,
        (None, None) => V2::zeros(),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn flight(points: &[[f64; 3]]) -> Flight {
        points.iter().map(|&[t, x, y]| (t, V2::new(x, y))).collect()
    }

    #[test]
    fn truth_two_that_cross_and_one_that_waits() {
        let east = flight(&[[0.0, 0.0, 0.0], [10.0, 100.0, 0.0]]);
        let north = flight(&[[0.0, 50.0, -50.0], [10.0, 50.0, 50.0]]);
        assert!(closest_m(&east, &north).abs() < 1e-12, "both are in the middle after 5 s");
        let late = flight(&[[0.0, 50.0, -150.0], [10.0, 50.0, -50.0]]);
        // (50 - 10 t, 10 t - 150 ...) apart: least at the end of either.
        assert!((closest_m(&east, &late) - 50f64.hypot(50.0)).abs() < 1e-9);
        let early = flight(&[[0.0, 130.0, 0.0], [1.0, 130.0, 0.0]]);
        assert!((closest_m(&east, &early) - 30.0).abs() < 1e-12);
        assert_eq!(separation_m(std::slice::from_ref(&east)), None);
        assert!((separation_m(&[east, late, early]).unwrap_or_default() - 30.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn truth_no_sample_is_nearer(
            steps in prop::collection::vec((0.1..20.0f64, -500.0..500.0f64, -500.0..500.0f64), 2..8),
            others in prop::collection::vec((0.1..20.0f64, -500.0..500.0f64, -500.0..500.0f64), 2..8),
        ) {
            let flight = |steps: &[(f64, f64, f64)]| -> Flight {
                let mut t = -steps[0].0;
                steps.iter().map(|&(dt, x, y)| { t += dt; (t, V2::new(x, y)) }).collect()
            };
            let (a, b) = (flight(&steps), flight(&others));
            let end = a.last().unwrap().0.max(b.last().unwrap().0);
            let sampled = (0..=20_000)
                .map(|k| end * f64::from(k) / 20_000.0)
                .map(|t| (at(&a, t) - at(&b, t)).norm())
                .fold(f64::INFINITY, f64::min);
            let found = closest_m(&a, &b);
            prop_assert!(found <= sampled + 1e-9 && found >= sampled - 5.0, "{} {}", found, sampled);
        }
    }
}
