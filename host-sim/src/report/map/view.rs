//! From metres (east, north) to pixels (right, down).

use crate::geometry::V2;

/// Least and greatest height of a map, pixels.
const HEIGHT_PX: [f64; 2] = [360.0, 820.0];
/// Free space around what is drawn.
const PADDING_PX: f64 = 36.0;
/// More of it below, for the scale.
const FOOT_PX: f64 = 22.0;

/// A map's frame and its scale.
pub(in crate::report) struct View {
    left_top_px: [f64; 2],
    size_px: [f64; 2],
    centre_m: V2,
    px_per_m: f64,
}

impl View {
    /// A map of the given width around some points, the larger one of its scales that fits.
    pub(in crate::report) fn around(points_m: &[V2], left_top_px: [f64; 2], width_px: f64) -> Self {
        let corners = points_m.iter().copied().map(|p| [p, p]);
        let [low, high] = corners.reduce(|[a, b], [c, d]| [a.inf(&c), b.sup(&d)]).unwrap_or([V2::zeros(); 2]);
        let extent = (high - low).map(|length_m| length_m.max(1.0));
        let (beside_px, above_and_below_px) = (2.0 * PADDING_PX, 2.0 * PADDING_PX + FOOT_PX);
        let fits = [(width_px - beside_px) / extent.x, (HEIGHT_PX[1] - above_and_below_px) / extent.y];
        let px_per_m = fits[0].min(fits[1]);
        let height_px = (extent.y * px_per_m + above_and_below_px).clamp(HEIGHT_PX[0], HEIGHT_PX[1]);
        Self { left_top_px, size_px: [width_px, height_px], centre_m: (low + high) / 2.0, px_per_m }
    }

    pub(in crate::report) fn height_px(&self) -> f64 {
        self.size_px[1]
    }

    /// The frame: left, top, width, height.
    pub(in crate::report) fn frame_px(&self) -> [f64; 4] {
        [self.left_top_px[0], self.left_top_px[1], self.size_px[0], self.size_px[1]]
    }

    pub(in crate::report) fn px_per_m(&self) -> f64 {
        self.px_per_m
    }

    pub(in crate::report) fn point_px(&self, point_m: V2) -> V2 {
        let [left, top, width, height] = self.frame_px();
        let from_centre = (point_m - self.centre_m) * self.px_per_m;
        V2::new(left + width / 2.0 + from_centre.x, top + (height - FOOT_PX) / 2.0 - from_centre.y)
    }

    /// Path data of a line, closed or open.
    pub(in crate::report) fn path(&self, points_m: &[V2], closed: bool) -> String {
        let steps = points_m.iter().enumerate().map(|(i, &point_m)| {
            let p = self.point_px(point_m);
            format!("{}{} {}", if i == 0 { 'M' } else { 'L' }, px(p.x), px(p.y))
        });
        let line: String = steps.collect();
        if closed { line + "Z" } else { line }
    }

    /// Path data of some rings, to be filled by the even-odd rule.
    pub(in crate::report) fn rings<R: AsRef<[V2]>>(&self, rings_m: impl Iterator<Item = R>) -> String {
        rings_m.map(|ring_m| self.path(ring_m.as_ref(), true)).collect()
    }
}

/// A tenth of a pixel, without zeros at the end.
pub(in crate::report) fn px(length: f64) -> String {
    let text = format!("{length:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}

/// Text that is no markup.
pub(in crate::report) fn escaped(text: &str) -> String {
    let printable = text.chars().filter(|c| !c.is_control());
    printable.fold(String::new(), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c => out.push(c),
        }
        out
    })
}
