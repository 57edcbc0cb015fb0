//! What the three disks of a fleet have in common.

use super::super::V2;

/// The largest disk around the best centre that three disks of one radius have in common for certain: the
/// centre of the smallest circle around their centres, and `radius_m` less that circle's radius (negative
/// when the disks have no such disk in common).
///
/// A point within `r - m` of the centre `c` is within `r` of every drone, m being the distance from c to
/// the farthest one; the smallest enclosing circle makes m least. For an equilateral triangle of side d
/// that is `r - d / sqrt(3)`.
///
/// # Between two samples
/// When the drones move in straight lines from one sample to the next, the farthest drone from the point
/// that moves in a straight line between the two centres is never farther than the larger of the two
/// circles' radii, because a distance is a convex function of a linear motion: the fleet does cover the
/// stadium between the two disks with the smaller of the two radii.
#[must_use]
pub fn overlap_disk(drones_m: [V2; 3], radius_m: f64) -> (V2, f64) {
    let centre = enclosing_centre(drones_m);
    // Measured, not taken from the formula: it holds even where rounding moved the centre.
    let farthest_m = drones_m.iter().map(|d| (d - centre).norm()).fold(0.0, f64::max);
    (centre, radius_m - farthest_m)
}

/// Centre of the smallest circle around three points: over the longest side where the third point lies within (the
/// triangle is right or obtuse), else the circumcircle.
fn enclosing_centre([a, b, c]: [V2; 3]) -> V2 {
    let mut sides = [(a, b, c), (b, c, a), (c, a, b)];
    sides.sort_by(|s, t| (t.1 - t.0).norm_squared().total_cmp(&(s.1 - s.0).norm_squared()));
    let (p, q, apex) = sides[0];
    let (u, v) = (p - apex, q - apex);
    // The angle at the apex, opposite to the longest side, is the only one that can be 90 degrees or more.
    if u.dot(&v) <= 0.0 {
        return (p + q) / 2.0;
    }
    let twice_area = super::super::cross(u, v);
    let (u2, v2) = (u.norm_squared(), v.norm_squared());
    apex + V2::new(v.y * u2 - u.y * v2, u.x * v2 - v.x * u2) / (2.0 * twice_area)
}

/// Area that three disks of radius `radius_m` at the corners of an equilateral triangle of side
/// `spacing_m` have in common: the paper's eq. (2), square metres.
///
/// The printed form holds for `0 <= d <= sqrt(3) R`. Beyond, the three disks have nothing in common, and
/// the printed form would go on with meaningless positive figures: the area is zero.
///
/// # Panics
/// If the spacing or the radius is negative or not finite.
#[must_use]
pub fn overlap_area_m2(spacing_m: f64, radius_m: f64) -> f64 {
    assert!(spacing_m >= 0.0 && radius_m >= 0.0, "lengths are not negative");
    assert!(spacing_m.is_finite() && radius_m.is_finite(), "lengths are finite");
    if spacing_m >= 3f64.sqrt() * radius_m {
        return 0.0;
    }
    let alpha = (spacing_m / (2.0 * radius_m)).acos();
    radius_m.powi(2) * (3.0 * alpha - std::f64::consts::FRAC_PI_2)
        - 1.5 * spacing_m * (radius_m.powi(2) - spacing_m.powi(2) / 4.0).sqrt()
        + 3f64.sqrt() / 4.0 * spacing_m.powi(2)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn truth_of_the_paper_s_fleet() {
        assert!((overlap_area_m2(50.0, 500.0) - 711_512.0).abs() < 1.0);
        let corners = [V2::new(0.0, 0.0), V2::new(50.0, 0.0), V2::new(25.0, 50.0 * 0.75f64.sqrt())];
        let (centre, radius_m) = overlap_disk(corners, 500.0);
        assert!((2.0 * radius_m - 942.26).abs() < 0.01);
        assert!((centre - (corners[0] + corners[1] + corners[2]) / 3.0).norm() < 1e-9);
    }

    #[test]
    fn the_ends_of_the_domain() {
        assert!((overlap_area_m2(0.0, 2.0) - 4.0 * std::f64::consts::PI).abs() < 1e-12);
        assert!(overlap_area_m2(3f64.sqrt() * 2.0 * (1.0 - 1e-9), 2.0).abs() < 1e-6);
        assert_eq!(overlap_area_m2(3.5, 2.0).to_bits(), 0.0f64.to_bits());
        assert_eq!(overlap_area_m2(0.0, 0.0).to_bits(), 0.0f64.to_bits());
    }

    #[test]
    fn drones_on_one_point_or_one_line() {
        let p = V2::new(3.0, 4.0);
        assert_eq!(overlap_disk([p; 3], 10.0), (p, 10.0));
        let (centre, radius_m) = overlap_disk([p, p + V2::new(8.0, 0.0), p + V2::new(2.0, 0.0)], 10.0);
        assert!((centre - V2::new(7.0, 4.0)).norm() < 1e-12 && (radius_m - 6.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn truth_no_other_centre_is_nearer_to_the_farthest_drone(
            xs in prop::array::uniform6(-50.0..50.0f64), turn in 0.0..6.3f64, step_m in 0.001..60.0f64,
        ) {
            let drones = [V2::new(xs[0], xs[1]), V2::new(xs[2], xs[3]), V2::new(xs[4], xs[5])];
            let farthest = |c: V2| drones.iter().map(|d| (d - c).norm()).fold(0.0, f64::max);
            let (centre, radius_m) = overlap_disk(drones, 100.0);
            prop_assert!((farthest(centre) - (100.0 - radius_m)).abs() < 1e-6);
            let other = centre + V2::new(turn.cos(), turn.sin()) * step_m;
            prop_assert!(farthest(other) >= 100.0 - radius_m - 1e-6);
        }
    }
}
