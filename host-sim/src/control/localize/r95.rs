//! The radius of the circle that holds 95 % of a two-dimensional Gaussian.

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Angles of the quadrature over a quarter turn; 16 already give nine digits at any axis ratio.
const ANGLES: usize = 24;

/// Squared cosine and sine of each. Midpoints: the same order as the trapezoidal rule, and never the angle where the
/// deviation may vanish.
static SQUARES: LazyLock<[[f64; 2]; ANGLES]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let theta = (k as f64 + 0.5) * (0.5 * PI / ANGLES as f64);
        [theta.cos().powi(2), theta.sin().powi(2)]
    })
});

/// Newton's step halves the digits that are wrong: after one as small as this, none is.
const LAST_STEP: f64 = 1e-7;

/// `sqrt(-2 ln 0.05)`: the 95 % radius of a circular Gaussian of unit variance.
const RADIUS_CIRCULAR: f64 = 2.447_746_830_680_816;

/// Eigenvalues of a symmetric 2x2 matrix, larger first.
pub(super) fn eigenvalues([[xx, xy], [_, yy]]: [[f64; 2]; 2]) -> [f64; 2] {
    let mean = 0.5 * (xx + yy);
    let radius = (0.5 * (xx - yy)).hypot(xy);
    [mean + radius, mean - radius]
}

/// Radius around the mean that holds 95 % of a Gaussian with covariance `cov` (symmetric, positive
/// semidefinite), in the square root of its unit.
///
/// In polar coordinates of the whitened Gaussian the radius is Rayleigh and the angle uniform, so that
/// `P(|z| > r) = mean over theta of exp(-r^2 / (2 s^2(theta)))`, with
/// `s^2 = l1 cos^2 theta + l2 sin^2 theta`. The integrand is smooth and periodic, hence the trapezoidal rule
/// converges geometrically; Newton finds the root.
#[must_use]
pub fn r95(cov: [[f64; 2]; 2]) -> f64 {
    let [major, minor] = eigenvalues(cov);
    if !(major.is_finite() && major > 0.0) {
        return 0.0;
    }
    let ratio = (minor / major).clamp(0.0, 1.0);
    // In units of the major axis the answer lies between 1.96 (a line) and 2.448 (a circle).
    let mut r = RADIUS_CIRCULAR - 0.487 * (1.0 - ratio.sqrt());
    let squares = &*SQUARES;
    for _ in 0..20 {
        let (mut tail, mut slope) = (0.0, 0.0);
        for [cos2, sin2] in squares {
            let per_s2 = 1.0 / (cos2 + ratio * sin2);
            let beyond = (-0.5 * r * r * per_s2).exp();
            tail += beyond;
            slope += beyond * r * per_s2;
        }
        let step = (tail - 0.05 * ANGLES as f64) / slope;
        r = (r + step).clamp(1.9, 2.5);
        if step.abs() < LAST_STEP {
            break;
        }
    }
    r * major.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known quantiles: circle sqrt(-2 ln 0.05), line 1.959964 (two-sided normal).
    #[test]
    fn truth_limits() {
        assert!((r95([[4.0, 0.0], [0.0, 4.0]]) - 2.0 * RADIUS_CIRCULAR).abs() < 1e-9);
        assert!((r95([[9.0, 0.0], [0.0, 0.0]]) - 3.0 * 1.959_963_984_540_054).abs() < 1e-6);
        assert!((r95([[0.0, 0.0], [0.0, 0.0]])).abs() < 1e-300);
    }

    /// SciPy figures of `scripts/localize_truth.py` (quadrature of the generalised chi-square).
    #[test]
    fn truth_ellipses() {
        for (ratio, expected) in TRUTH {
            let found = r95([[1.0, 0.0], [0.0, ratio * ratio]]);
            assert!((found - expected).abs() < 1e-7, "axis ratio {ratio}: {found} against {expected}");
        }
    }

    /// (minor over major axis, radius)
    const TRUTH: [(f64, f64); 5] = [
        (0.1, 1.962_529_596_8),
        (0.3, 1.984_196_226_1),
        (0.5, 2.035_858_720_3),
        (0.8, 2.230_287_285_7),
        (0.95, 2.388_119_523_1),
    ];

    #[test]
    fn rotation_does_not_matter() {
        let (l1, l2) = (9.0, 0.25);
        let straight = r95([[l1, 0.0], [0.0, l2]]);
        for k in 0..12 {
            let (s, c) = (0.3 * f64::from(k)).sin_cos();
            let xy = (l1 - l2) * s * c;
            let turned = r95([[l1 * c * c + l2 * s * s, xy], [xy, l1 * s * s + l2 * c * c]]);
            assert!((turned - straight).abs() < 1e-10);
        }
    }
}
