//! Which drone flies to which site: the longest flight as short as possible, then the sum of squares.
//!
//! A bottleneck assignment. The least longest flight is the least threshold under which every site can
//! be matched with a drone (binary search over the distances, Hopcroft and Karp 1973 for the matching).
//! Among the assignments within that threshold the Hungarian method (Kuhn 1955, in the shortest
//! augmenting path form of Jonker and Volgenant 1987) finds the least sum of squared flights, which
//! keeps the other drones from detours. Both are exact.

use std::collections::VecDeque;

use crate::geometry::V2;

/// Not matched.
const FREE: usize = usize::MAX;

/// For every site of `to_m` the index into `from_m` of the drone that flies there; drones not named
/// are spare and stay where they are.
///
/// All indices are distinct. Of several optima the same one is returned for the same input.
///
/// # Panics
/// If there are more sites than drones, or a coordinate is not finite: a caller's mistake.
#[must_use]
pub fn assign(from_m: &[V2], to_m: &[V2]) -> Vec<usize> {
    assert!(to_m.len() <= from_m.len(), "{} sites for {} drones", to_m.len(), from_m.len());
    assert!(from_m.iter().chain(to_m).all(|p| p.x.is_finite() && p.y.is_finite()), "positions are finite");
    let drones = from_m.len();
    let squared_m2: Vec<f64> =
        to_m.iter().flat_map(|to| from_m.iter().map(move |from| (to - from).norm_squared())).collect();

    let mut thresholds = squared_m2.clone();
    thresholds.sort_unstable_by(f64::total_cmp);
    thresholds.dedup();
    let enough = thresholds.partition_point(|&longest_m2| !all_matched(&squared_m2, drones, longest_m2));
    let Some(&longest_m2) = thresholds.get(enough) else { return Vec::new() };

    least_sum(&squared_m2, drones, longest_m2)
}

/// Whether every site finds a drone of its own within `longest_m2` (Hopcroft and Karp).
fn all_matched(squared_m2: &[f64], drones: usize, longest_m2: f64) -> bool {
    let sites = squared_m2.len() / drones;
    let near = |site: usize| {
        let row = &squared_m2[site * drones..(site + 1) * drones];
        row.iter().enumerate().filter(move |&(_, &d)| d <= longest_m2).map(|(drone, _)| drone)
    };
    let edges: Vec<Vec<usize>> = (0..sites).map(|site| near(site).collect()).collect();
    let (mut drone_of, mut site_of) = (vec![FREE; sites], vec![FREE; drones]);
    let mut matched = 0;
    loop {
        // Layers of shortest alternating paths from the free sites.
        let mut layer = vec![FREE; sites];
        let mut queue: VecDeque<usize> = (0..sites).filter(|&s| drone_of[s] == FREE).collect();
        queue.iter().for_each(|&site| layer[site] = 0);
        while let Some(site) = queue.pop_front() {
            for next in edges[site].iter().map(|&drone| site_of[drone]).filter(|&s| s != FREE) {
                if layer[next] == FREE {
                    layer[next] = layer[site] + 1;
                    queue.push_back(next);
                }
            }
        }
        let mut tried = vec![0; sites];
        let free: Vec<usize> = (0..sites).filter(|&s| drone_of[s] == FREE).collect();
        let before = matched;
        for site in free {
            if augment(site, &edges, &layer, &mut tried, &mut drone_of, &mut site_of) {
                matched += 1;
            }
        }
        if matched == before {
            return matched == sites;
        }
    }
}

/// Depth-first along the layers to a free drone; every edge is tried once per phase.
fn augment(
    root: usize,
    edges: &[Vec<usize>],
    layer: &[usize],
    tried: &mut [usize],
    drone_of: &mut [usize],
    site_of: &mut [usize],
) -> bool {
    let mut path = vec![root];
    while let Some(&site) = path.last() {
        let Some(&drone) = edges[site].get(tried[site]) else {
            path.pop();
            // The edge that led here is a dead end.
            if let Some(&parent) = path.last() {
                tried[parent] += 1;
            }
            continue;
        };
        let next = site_of[drone];
        if next == FREE {
            // Each site on the path takes the drone that it was trying.
            for &site in &path {
                let drone = edges[site][tried[site]];
                (drone_of[site], site_of[drone]) = (drone, site);
                tried[site] += 1;
            }
            return true;
        }
        if layer[next] == layer[site] + 1 && tried[next] < edges[next].len() {
            path.push(next);
        } else {
            tried[site] += 1;
        }
    }
    false
}

/// Least sum of squares with no flight beyond `longest_m2`, which is known to be possible.
///
/// Sites are taken in one after the other along shortest augmenting paths; potentials keep the reduced
/// costs of allowed flights nonnegative. Forbidden flights are left out, not priced.
fn least_sum(squared_m2: &[f64], drones: usize, longest_m2: f64) -> Vec<usize> {
    let sites = squared_m2.len() / drones;
    let (mut site_price, mut drone_price) = (vec![0.0; sites], vec![0.0; drones]);
    let mut site_of = vec![FREE; drones];
    let mut drone_of = vec![FREE; sites];
    for root in 0..sites {
        let mut length = vec![f64::INFINITY; drones];
        let mut parent = vec![FREE; drones]; // the site from which a drone is reached
        let mut done = vec![false; drones];
        let (mut site, mut here) = (root, 0.0);
        let end = loop {
            for drone in (0..drones).filter(|&d| !done[d]) {
                let flight_m2 = squared_m2[site * drones + drone];
                let reduced = here + flight_m2 - site_price[site] - drone_price[drone];
                if flight_m2 <= longest_m2 && reduced < length[drone] {
                    (length[drone], parent[drone]) = (reduced, site);
                }
            }
            let nearest = (0..drones).filter(|&d| !done[d]).min_by(|&a, &b| length[a].total_cmp(&length[b]));
            let drone = nearest.filter(|&d| length[d] < f64::INFINITY);
            let drone = drone.expect("the threshold admits a matching of all sites");
            here = length[drone];
            if site_of[drone] == FREE {
                break drone;
            }
            done[drone] = true;
            site = site_of[drone];
        };
        // Prices of all that was reached rise to the length of the path found.
        site_price[root] += here;
        for drone in (0..drones).filter(|&d| done[d]) {
            let slack = here - length[drone];
            site_price[site_of[drone]] += slack;
            drone_price[drone] -= slack;
        }
        // Turn the path: every drone on it goes to its parent.
        let mut drone = end;
        while drone != FREE {
            let site = parent[drone];
            let given_up = drone_of[site];
            (site_of[drone], drone_of[site]) = (site, drone);
            drone = if site == root { FREE } else { given_up };
        }
    }
    drone_of
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cost(from_m: &[V2], to_m: &[V2], drone_of: &[usize]) -> (f64, f64) {
        let flights = to_m.iter().zip(drone_of).map(|(to, &drone)| (to - from_m[drone]).norm_squared());
        flights.fold((0.0, 0.0), |(longest, sum), d| (d.max(longest), sum + d))
    }

    /// Every way of giving distinct drones to the sites.
    fn brute_force(from_m: &[V2], to_m: &[V2], chosen: &mut Vec<usize>, best: &mut (f64, f64)) {
        if chosen.len() == to_m.len() {
            let now = cost(from_m, to_m, chosen);
            if now.0 < best.0 - 1e-9 || (now.0 < best.0 + 1e-9 && now.1 < best.1) {
                *best = now;
            }
            return;
        }
        for drone in 0..from_m.len() {
            if !chosen.contains(&drone) {
                chosen.push(drone);
                brute_force(from_m, to_m, chosen, best);
                chosen.pop();
            }
        }
    }

    fn points(spec: &[(i32, i32)]) -> Vec<V2> {
        spec.iter().map(|&(x, y)| V2::new(f64::from(x), f64::from(y))).collect()
    }

    proptest! {
        /// On a small lattice equal flights abound.
        #[test]
        fn truth_assignment_matches_brute_force(
            from in prop::collection::vec((0i32..8, 0i32..8), 0..7),
            to in prop::collection::vec((0i32..8, 0i32..8), 0..7),
        ) {
            let (from_m, mut to_m) = (points(&from), points(&to));
            to_m.truncate(from_m.len());
            let found = assign(&from_m, &to_m);
            let mut best = (f64::INFINITY, f64::INFINITY);
            brute_force(&from_m, &to_m, &mut vec![], &mut best);
            let (longest, sum) = cost(&from_m, &to_m, &found);
            prop_assert!((longest - best.0).abs() < 1e-9, "longest {longest}, brute force {}", best.0);
            prop_assert!((sum - best.1).abs() < 1e-9, "sum {sum}, brute force {}", best.1);
            let mut distinct = found.clone();
            distinct.sort_unstable();
            distinct.dedup();
            prop_assert_eq!(distinct.len(), to_m.len());
        }
    }

    #[test]
    fn spare_drones_are_those_not_named() {
        let from_m = points(&[(0, 0), (100, 0), (200, 0)]);
        assert_eq!(assign(&from_m, &points(&[(190, 0), (10, 0)])), [2, 0]);
        assert_eq!(assign(&from_m, &[]), Vec::<usize>::new());
        assert_eq!(assign(&[], &[]), Vec::<usize>::new());
    }

    #[test]
    fn the_longest_flight_comes_before_the_sum() {
        // The least sum of squares of lengths 0 and 10 would leave one drone with the long way.
        let (from_m, to_m) = (points(&[(0, 0), (6, 0)]), points(&[(6, 0), (12, 0)]));
        assert_eq!(assign(&from_m, &to_m), [0, 1]);
    }

    #[test]
    fn several_hundred_drones_take_no_time_worth_naming() {
        let ring = |radius: f64, turn: f64| -> Vec<V2> {
            (0..400)
                .map(|i| f64::from(i) * 0.0157 + turn)
                .map(|a| V2::new(a.cos(), a.sin()) * radius)
                .collect()
        };
        let (from_m, to_m) = (ring(100.0, 0.0), ring(3000.0, 1.0));
        let mut found = assign(&from_m, &to_m);
        found.sort_unstable();
        assert!(found.into_iter().eq(0..400));
    }
}
