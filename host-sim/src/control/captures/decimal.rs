//! Decimal numbers kept exactly: a clock's 19 digits do not fit a float, their small differences do.

/// Units in one: numbers are counted in billionths.
const DECIMALS: i32 = 9;
/// Significant digits that are read; all further ones lie beyond the billionths of anything in range.
const MOST_DIGITS: u32 = 36;

/// A number of billionths, rounded half away from zero, from what `f64` would read as a finite number:
/// `-12.5`, `+.5`, `3.`, `1.7e18`. `None` where it is no such number, or does not fit.
pub(super) fn billionths(text: &[u8]) -> Option<i128> {
    let (negative, unsigned) = match text {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, text),
    };
    let mut mantissa: i128 = 0;
    let mut significant = 0;
    // Power of ten of the last digit taken.
    let mut power = 0;
    let mut point = false;
    let mut digits = 0usize;
    let mut rest = unsigned;
    while let [byte, after @ ..] = rest {
        match byte {
            b'0'..=b'9' => {
                digits += 1;
                if significant < MOST_DIGITS {
                    mantissa = mantissa * 10 + i128::from(byte - b'0');
                    significant += u32::from(mantissa > 0);
                    power -= i32::from(point);
                } else {
                    power += i32::from(!point);
                }
            }
            b'.' if !point => point = true,
            _ => break,
        }
        rest = after;
    }
    if digits == 0 {
        return None;
    }
    let shift = i64::from(power) + i64::from(exponent(rest)?) + i64::from(DECIMALS);
    let magnitude = if mantissa == 0 {
        0
    } else if shift >= 0 {
        mantissa.checked_mul(10i128.checked_pow(u32::try_from(shift).ok()?)?)?
    } else {
        match u32::try_from(-shift).ok().and_then(|places| 10i128.checked_pow(places)) {
            Some(divisor) => (mantissa + divisor / 2) / divisor,
            None => 0,
        }
    };
    Some(if negative { -magnitude } else { magnitude })
}

/// The power of ten after the digits: nothing, or `e` with a whole number.
fn exponent(text: &[u8]) -> Option<i32> {
    let [b'e' | b'E', rest @ ..] = text else { return text.is_empty().then_some(0) };
    let (sign, digits) = match rest {
        [b'-', digits @ ..] => (-1, digits),
        [b'+', digits @ ..] => (1, digits),
        _ => (1, rest),
    };
    if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    // Saturation suffices: nothing with such an exponent fits, or it is 0.
    let value =
        digits.iter().fold(0i32, |value, d| value.saturating_mul(10).saturating_add(i32::from(d - b'0')));
    Some(sign * value)
}

/// As a float, in whole units.
pub(super) fn to_f64(billionths: i128) -> f64 {
    billionths as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn every_digit_counts() {
        for (text, expected) in [
            ("0", 0),
            ("-0.0", 0),
            ("1", 1_000_000_000),
            ("+.5", 500_000_000),
            ("3.", 3_000_000_000),
            ("1.7e18", 1_700_000_000_000_000_000_000_000_000),
            ("1700000000123456789.125", 1_700_000_000_123_456_789_125_000_000),
            ("-1700000000123456789.0000000006", -1_700_000_000_123_456_789_000_000_001),
            ("0.0000000004999", 0),
            ("5E-10", 1),
            ("1e-999999999999", 0),
            ("0e999999999999", 0),
            ("000000000000000000000000000000000000000000001", 1_000_000_000),
            ("0.00000000000000000000000000000000000001e38", 1_000_000_000),
            ("100000000000000000000000000000000000000000e-40", 10_000_000_000),
        ] {
            assert_eq!(billionths(text.as_bytes()), Some(expected), "{text}");
        }
        for text in [
            "",
            "+",
            "-",
            ".",
            "e5",
            "1e",
            "1e+",
            "1e5.5",
            "--1",
            "1-",
            "1.2.3",
            "0x10",
            "nan",
            "inf",
            "-inf",
            "1 2",
            "1e30",
            "1e999999999999",
            "١",
        ] {
            assert_eq!(billionths(text.as_bytes()), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn agrees_with_floats(text in "[-+]?[0-9]{0,12}\\.?[0-9]{0,12}([eE][-+]?[0-9]{1,2})?") {
            let float = text.parse::<f64>().ok();
            match billionths(text.as_bytes()) {
                Some(exact) => {
                    let float = float.unwrap();
                    prop_assert!((to_f64(exact) - float).abs() <= 1e-15 * float.abs() + 0.5e-9, "{} {}", exact, float);
                }
                None => prop_assert!(float.is_none_or(|float| float.abs() > 1e28)),
            }
        }

        #[test]
        fn never_panics(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = billionths(&bytes);
        }
    }
}
