//! Arithmetic of single numbers, to the same bits on every processor.
//!
//! `f32::min` and `f32::max` may answer with either zero where both signs meet, and processors differ in
//! which they take; `f32::clamp` panics where its limits cross. These here do what is written. Where one
//! number is NaN they answer with the other, as those of `core` do.

/// The greater of both; `b` where they are equal.
#[inline]
#[must_use]
pub const fn greater(a: f32, b: f32) -> f32 {
    if a > b || b.is_nan() { a } else { b }
}

/// The lesser of both; `b` where they are equal.
#[inline]
#[must_use]
pub const fn lesser(a: f32, b: f32) -> f32 {
    if a < b || b.is_nan() { a } else { b }
}

/// `x`, or the limit that it lies beyond; where the limits cross, the upper one holds. A NaN stays one,
/// and a NaN for a limit limits nothing.
#[inline]
#[must_use]
pub const fn within(x: f32, low: f32, high: f32) -> f32 {
    let raised = if x < low { low } else { x };
    if raised > high { high } else { raised }
}

/// Square root of an integer, rounded down. One function: a board's processor takes a page of code for it.
#[inline(never)]
#[must_use]
pub fn root(square: u64) -> u32 {
    square.isqrt() as u32
}

/// Quarter turns in a radian, and a quarter turn in two parts, of which the first has so few bits that multiples of it are exact.
const QUARTERS_PER_RAD: f64 = core::f64::consts::FRAC_2_PI;
const QUARTER_HIGH: f64 = 1.570_796_310_901_641_8;
const QUARTER_LOW: f64 = 1.589_325_477_352_819_7e-8;

/// Sine and cosine of an angle in radians, to within a unit in the last place for angles up to a million turns; beyond, and of what is
/// no number, zero and one.
///
/// `libm::sincosf` gives the same bits but for rare last ones, and takes seven kilobytes of a board's flash, most of them for angles
/// of more turns than any drone flies. The polynomials are those of FreeBSD's `k_sinf` and `k_cosf` (minimax up to a quarter of pi).
#[inline(never)] // for the same reason
#[must_use]
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    const MOST_RAD: f32 = 6.0e6;
    if !(angle_rad > -MOST_RAD && angle_rad < MOST_RAD) {
        return (0.0, 1.0);
    }
    let angle = angle_rad as f64;
    let half = if angle_rad < 0.0 { -0.5 } else { 0.5 };
    let quarters = (angle * QUARTERS_PER_RAD + half) as i32;
    let rest = angle - quarters as f64 * QUARTER_HIGH - quarters as f64 * QUARTER_LOW;
    let (z, s) = (rest * rest, rest * rest * rest);
    let w = z * z;
    let sin_low = -0.166_666_666_416_265_24 + z * 0.008_333_329_385_889_463;
    let sin_high = -0.000_198_393_348_360_966_32 + z * 0.000_002_718_311_493_989_822;
    let sin = (rest + s * sin_low + s * w * sin_high) as f32;
    let cos_low = 1.0 - z * 0.499_999_997_251_031 + w * 0.041_666_623_323_739_06;
    let cos = (cos_low + w * z * (-0.001_388_676_377_460_993 + z * 0.000_024_390_448_796_277_41)) as f32;
    match quarters & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// How many numbers lie between two of the same sign, at most one of them zero.
    fn ulps(a: f32, b: f32) -> u32 {
        a.abs().to_bits().abs_diff(b.abs().to_bits()) + u32::from(a * b < 0.0) * 1_000
    }

    #[test]
    fn truth_sines_and_cosines_are_those_of_double_precision() {
        let mut other = 0;
        for k in -2_000_000..=2_000_000_i32 {
            let angle = k as f32 * 7.31e-5; // up to 23 turns either way
            let (sin, cos) = sin_cos(angle);
            let (true_sin, true_cos) =
                (libm::sin(f64::from(angle)) as f32, libm::cos(f64::from(angle)) as f32);
            assert!(ulps(sin, true_sin) <= 1 && ulps(cos, true_cos) <= 1, "{angle}: {sin} {cos}");
            other += u32::from((sin, cos) != libm::sincosf(angle));
        }
        assert_eq!(other, 0, "of libm's own");
    }

    #[test]
    fn far_angles_and_no_numbers_have_an_answer() {
        for angle in [1e5_f32, -123_456.7, 5.9e6] {
            let (sin, cos) = sin_cos(angle);
            assert!((f64::from(sin) - libm::sin(f64::from(angle))).abs() < 1e-6, "{angle}");
            assert!((f64::from(cos) - libm::cos(f64::from(angle))).abs() < 1e-6, "{angle}");
        }
        for none in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
            assert!(matches!(sin_cos(none), (0.0, 1.0)));
        }
    }

    /// Whether two numbers are the same one, whatever the sign of a zero or the bits of a NaN.
    fn same(a: f32, b: f32) -> bool {
        (a..=a).contains(&b) || (a.is_nan() && b.is_nan())
    }

    proptest! {
        #[test]
        #[expect(clippy::disallowed_methods)] // the independent computation
        fn truth_is_that_of_core(a: f32, b: f32, c: f32) {
            for (a, b) in [(a, b), (a, a), (a, f32::NAN), (f32::NAN, b), (f32::NAN, f32::NAN)] {
                prop_assert!(same(greater(a, b), a.max(b)));
                prop_assert!(same(lesser(a, b), a.min(b)));
            }
            let (low, high) = if b <= c { (b, c) } else { (c, b) };
            prop_assume!(low <= high);
            for x in [a, b, c, f32::NAN, f32::INFINITY] {
                prop_assert!(same(within(x, low, high), x.clamp(low, high)));
            }
        }
    }

    #[test]
    fn limits_that_cross_or_are_none_do_no_harm() {
        assert!(same(within(5.0, 3.0, 1.0), 1.0));
        assert!(same(within(5.0, f32::NAN, f32::NAN), 5.0));
    }

    #[test]
    fn of_two_zeros_it_is_always_the_second() {
        for (a, b) in [(0.0f32, -0.0f32), (-0.0, 0.0)] {
            assert_eq!(greater(a, b).to_bits(), b.to_bits());
            assert_eq!(lesser(a, b).to_bits(), b.to_bits());
        }
    }
}
