//! What every map shows: how long a metre is, and where north is.

use std::fmt::Write as _;

use super::view::{View, px};

/// The longest of 1, 2 and 5 times a power of ten that takes less than a fifth of the map.
pub(super) fn scale_bar(svg: &mut String, view: &View) {
    let [left, top, width, height] = view.frame_px();
    let most_m = width / 5.0 / view.px_per_m();
    let power = 10f64.powf(most_m.log10().floor());
    let length_m = [5.0, 2.0, 1.0].into_iter().map(|k| k * power).find(|l| *l <= most_m).unwrap_or(power);
    let text = if length_m >= 1000.0 { format!("{} km", length_m / 1000.0) } else { format!("{length_m} m") };
    let (x, y, end) = (left + 16.0, top + height - 16.0, left + 16.0 + length_m * view.px_per_m());
    let _ = writeln!(
        svg,
        "<path class=\"scale\" d=\"M{x} {low}V{y}H{end}V{low}\"/>\n<text class=\"halo\" x=\"{x}\" y=\"{above}\">{text}</text>",
        x = px(x),
        y = px(y),
        end = px(end),
        low = px(y - 6.0),
        above = px(y - 11.0),
    );
}

/// Which way is up.
pub(super) fn north(svg: &mut String, view: &View) {
    let [left, top, width, _] = view.frame_px();
    let _ = writeln!(
        svg,
        "<g transform=\"translate({} {})\"><path class=\"north\" d=\"M0 -12L6 8L0 4L-6 8Z\"/>\
         <text class=\"strong\" y=\"22\" text-anchor=\"middle\">N</text></g>",
        px(left + width - 20.0),
        px(top + 22.0)
    );
}
