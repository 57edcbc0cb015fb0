//! Off the knife's edge: of all centres that cover the same users, the one with the largest margin.
//!
//! The margin of a centre x is `min(radius_i - |x - p_i|)`. To maximise it is to find the smallest disk
//! that encloses the disks (p_i, K - radius_i), K being any constant not below the radii: a convex
//! problem whose optimum is fixed by at most three of them (Fischer and Gaertner 2003, "The smallest
//! enclosing ball of balls", who also show that Welzl's move-to-front fails once radii differ). With so
//! small a basis it is solved by pivots: take in the disk that sticks out most, drop what is not needed.

use std::f64::consts::TAU;

use super::KeepOut;
use crate::geometry::V2;

/// A disk that sticks out by less than this is enclosed.
const ENCLOSED_M: f64 = 1e-9;

/// The enclosing disk grows with every pivot, so a basis never returns; this bounds the pivots where
/// rounding says otherwise. Typical: 3 to 6.
const MOST_PIVOTS: usize = 64;

/// Accuracy of the margin where the best centre lies too close to another site.
const SHORE_ACCURACY_M: f64 = 1e-4;

/// Centre with the largest margin to `disks` (position, radius), and that margin; negative where no
/// centre is in all of them. `None` without disks, or where no centre is allowed.
///
/// A `witness` is an allowed centre that is known to be in all of them.
pub(crate) fn most_margin(disks: &[(V2, f64)], keep_out: &KeepOut, witness: Option<V2>) -> Option<(V2, f64)> {
    let free = smallest_enclosing(disks)?;
    // Nowhere is the margin larger than at the free optimum.
    let chosen = if keep_out.allows(free) || margin_m(disks, free) < -super::TOLERANCE_M {
        Some(free)
    } else {
        most_margin_ashore(disks, keep_out, free, witness)
    };
    let best = [chosen, witness].into_iter().flatten().map(|at| (at, margin_m(disks, at)));
    best.reduce(|a, b| if b.1 > a.1 { b } else { a })
}

/// Least `radius - distance` at `at`; infinite without disks.
fn margin_m(disks: &[(V2, f64)], at: V2) -> f64 {
    disks.iter().map(|(p, radius_m)| radius_m - (p - at).norm()).fold(f64::INFINITY, f64::min)
}

/// An enclosing disk. Its radius is offset by the common constant K and may be negative.
#[derive(Clone, Copy, Debug)]
struct Enclosing {
    at: V2,
    /// Greatest `|at - p_i| - radius_i`, the negative of the margin.
    excess_m: f64,
}

/// Centre of the smallest disk enclosing all (p_i, -radius_i).
fn smallest_enclosing(disks: &[(V2, f64)]) -> Option<V2> {
    // Started from the disk of least radius: alone it gives the largest excess of any single one.
    let first = disks.iter().copied().reduce(|a, b| if b.1 < a.1 { b } else { a })?;
    let mut basis = vec![first];
    let mut now = Enclosing { at: first.0, excess_m: -first.1 };
    for _ in 0..MOST_PIVOTS {
        let excess_m = |&(p, radius_m): &(V2, f64)| (p - now.at).norm() - radius_m;
        let Some(worst) =
            disks.iter().copied().reduce(|a, b| if excess_m(&b) > excess_m(&a) { b } else { a })
        else {
            break;
        };
        if excess_m(&worst) <= now.excess_m + ENCLOSED_M {
            break;
        }
        let Some((next, support)) = pivot(&basis, worst) else { break };
        (now, basis) = (next, support);
    }
    Some(now.at)
}

/// Smallest disk enclosing `basis` and `incoming`, with the disks that fix it. The newcomer is one of them.
fn pivot(basis: &[(V2, f64)], incoming: (V2, f64)) -> Option<(Enclosing, Vec<(V2, f64)>)> {
    let mut best: Option<(Enclosing, Vec<(V2, f64)>)> = None;
    let mut consider = |candidate: Option<Enclosing>, support: &[(V2, f64)]| {
        let Some(mut candidate) = candidate else { return };
        // What it takes to enclose all: right for the true support, an overestimate for any other.
        let needed = basis.iter().chain([&incoming]).map(|(p, r)| (p - candidate.at).norm() - r);
        candidate.excess_m = needed.fold(f64::NEG_INFINITY, f64::max);
        if best.as_ref().is_none_or(|(b, _)| candidate.excess_m < b.excess_m) {
            best = Some((candidate, support.to_vec()));
        }
    };
    consider(Some(Enclosing { at: incoming.0, excess_m: -incoming.1 }), &[incoming]);
    for (i, &a) in basis.iter().enumerate() {
        consider(of_two(incoming, a), &[incoming, a]);
        for &b in &basis[i + 1..] {
            for candidate in of_three(incoming, a, b) {
                consider(candidate, &[incoming, a, b]);
            }
        }
    }
    best
}

/// Smallest disk touching two: its centre is on their line. `None` where one encloses the other.
fn of_two((p, r): (V2, f64), (q, s): (V2, f64)) -> Option<Enclosing> {
    let towards = q - p;
    let distance_m = towards.norm();
    if distance_m <= (r - s).abs() {
        return None;
    }
    // |at - p| - r = |at - q| - s with |at - p| + |at - q| = distance
    let from_p_m = 0.5 * (distance_m + r - s);
    Some(Enclosing { at: p + towards * (from_p_m / distance_m), excess_m: from_p_m - r })
}

/// The disks touching three, `|at - p_i| - r_i = e` (Apollonius): subtracting two of the equations makes
/// them linear in (at, e), and the third is a quadratic in e.
fn of_three((p, r): (V2, f64), (q, s): (V2, f64), (w, t): (V2, f64)) -> [Option<Enclosing>; 2] {
    // With y = at - p and f = e + r: |y| = f, |y - a| = f + s - r, |y - b| = f + t - r.
    let (a, b, ds, dt) = (q - p, w - p, s - r, t - r);
    let determinant = a.perp(&b);
    // Collinear centres: by symmetry the optimum is on their line, and two of them fix it.
    if determinant.abs() <= 1e-14 * a.norm() * b.norm() {
        return [None; 2];
    }
    // 2 a.y = |a|^2 - ds^2 - 2 ds f, and likewise for b: y = constant + slope f
    let solve = |u: f64, v: f64| V2::new(u * b.y - v * a.y, a.x * v - b.x * u) / determinant;
    let constant = solve(0.5 * (a.norm_squared() - ds * ds), 0.5 * (b.norm_squared() - dt * dt));
    let slope = solve(-ds, -dt);
    // (|slope|^2 - 1) f^2 + 2 constant.slope f + |constant|^2 = 0, by the stable form of the roots
    let (qa, qb, qc) = (slope.norm_squared() - 1.0, constant.dot(&slope), constant.norm_squared());
    let discriminant = qb * qb - qa * qc;
    if discriminant < 0.0 {
        return [None; 2];
    }
    let mix = -(qb + discriminant.sqrt().copysign(qb));
    let root = |f: f64| {
        (f.is_finite() && f >= 0.0).then(|| Enclosing { at: p + constant + slope * f, excess_m: f - r })
    };
    [root(mix / qa), root(qc / mix)]
}

/// Largest margin on the shores of the exclusion disks, where the free optimum lies inside one.
///
/// The margin is concave, so without a local optimum elsewhere the best allowed centre is on a shore.
/// Along a shore of radius s the margin changes by at most s per radian: intervals that cannot hold
/// anything better by [`SHORE_ACCURACY_M`] are dropped, the others halved.
fn most_margin_ashore(disks: &[(V2, f64)], keep_out: &KeepOut, free: V2, witness: Option<V2>) -> Option<V2> {
    const FIRST_INTERVALS: u32 = 64;
    let shore_m = keep_out.shore_m();
    let mut best = witness.map(|at| (margin_m(disks, at), at));
    // Any shore may hold it, but mostly it is the nearest.
    let mut hubs = keep_out.centres.clone();
    hubs.sort_by(|a, b| (a - free).norm().total_cmp(&(b - free).norm()));
    for hub in hubs {
        let half_rad = 0.5 * TAU / f64::from(FIRST_INTERVALS);
        let mut intervals: Vec<(f64, f64)> =
            (0..FIRST_INTERVALS).map(|i| (f64::from(2 * i + 1) * half_rad, half_rad)).collect();
        while let Some((middle_rad, half_rad)) = intervals.pop() {
            let at = hub + V2::new(middle_rad.cos(), middle_rad.sin()) * shore_m;
            let margin = margin_m(disks, at);
            if keep_out.allows(at) && best.is_none_or(|(b, _)| margin > b) {
                best = Some((margin, at));
            }
            let reachable_m = margin + shore_m * half_rad;
            let worth = best.is_none_or(|(b, _)| reachable_m > b + SHORE_ACCURACY_M);
            let splits = shore_m * half_rad > SHORE_ACCURACY_M && !keep_out.swallows(at, shore_m * half_rad);
            if worth && splits {
                intervals.extend([-0.5, 0.5].map(|side| (middle_rad + side * half_rad, 0.5 * half_rad)));
            }
        }
    }
    best.map(|(_, at)| at)
}
