//! Values of options: what is out of range is wrong usage.

fn number(text: &str, good: impl Fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    let found = text.trim().parse().ok();
    found.filter(|x: &f64| x.is_finite() && good(*x)).ok_or_else(|| format!("expected {expected}"))
}

/// Any finite number.
pub(super) fn finite(text: &str) -> Result<f64, String> {
    number(text, |_| true, "a finite number")
}

/// A finite number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    number(text, |x| x > 0.0, "a finite number above 0")
}

/// A finite number, 0 or more.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    number(text, |x| x >= 0.0, "a finite number, 0 or more")
}

/// A probability that is neither certain nor ruled out.
pub(super) fn probability(text: &str) -> Result<f64, String> {
    number(text, |x| x > 0.0 && x < 1.0, "a probability above 0 and below 1")
}

/// Two finite numbers.
pub(super) fn pair(text: &str) -> Result<[f64; 2], String> {
    let expected = "expected two finite numbers with a comma between them";
    let (x, y) = text.split_once(',').ok_or(expected)?;
    Ok([
        number(x, |_| true, expected).map_err(|_| expected)?,
        number(y, |_| true, expected).map_err(|_| expected)?,
    ])
}

/// A place on Earth, longitude first.
pub(super) fn lon_lat(text: &str) -> Result<[f64; 2], String> {
    pair(text)
        .ok()
        .filter(|[lon, lat]| lon.abs() <= 180.0 && lat.abs() < 90.0)
        .ok_or_else(|| "expected longitude and latitude in degrees with a comma between them".to_owned())
}
