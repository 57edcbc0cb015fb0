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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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
