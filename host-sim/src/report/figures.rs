//! What several reports say in the same way.

use crate::control::localize::FixStatus;

/// A status as results spell it.
pub(crate) const fn status_name(status: FixStatus) -> &'static str {
    match status {
        FixStatus::Ok => "ok",
        FixStatus::Ambiguous => "ambiguous",
        FixStatus::PoorGeometry => "poor_geometry",
        FixStatus::Inconsistent => "inconsistent",
        FixStatus::NotLocated => "not_located",
    }
}

/// Quantile of sorted values, the lower of two neighbours.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    sorted.get((last as f64 * share) as usize).copied()
}
