//! Pictures of what lies on the ground: one SVG without script or anything from outside, light or dark as its viewer
//! asks for. A report brings what lies on the map and what its panel says.
//!
//! - `view`: metres to pixels, and the elements' text,
//! - `panel`: headings, figures and the legend beside the map,
//! - `marks`: scale and north.

mod marks;
mod panel;
pub(super) mod view;

use std::fmt::Write as _;
use std::path::Path;

use crate::geometry::V2;
pub(super) use panel::Panel;
use view::{View, escaped, px};

/// Palette, texts, frame and marks of all maps.
const STYLE: &str = include_str!("base.css");

/// Space around everything, pixels.
pub(super) const MARGIN_PX: f64 = 28.0;
/// Above the map.
pub(super) const HEADER_PX: f64 = 84.0;
/// Width of the map, and of the panel beside it.
const MAP_WIDTH_PX: f64 = 820.0;
const PANEL_WIDTH_PX: f64 = 330.0;
/// Between map and panel.
const GAP_PX: f64 = 28.0;

/// The beginning of any picture: its size, its style, and what it shows.
pub(super) fn header(title: &str, subtitle: &str, style: &str, size_px: [f64; 2]) -> String {
    let ([width, height], title) = (size_px.map(px), escaped(title));
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         role=\"img\" aria-labelledby=\"title\">\n<title id=\"title\">{title}</title>\n<style>\n{STYLE}{style}</style>\n\
         <rect class=\"paper\" width=\"{width}\" height=\"{height}\"/>\n\
         <text class=\"title\" x=\"{MARGIN_PX}\" y=\"42\">{title}</text>\n\
         <text class=\"muted\" x=\"{MARGIN_PX}\" y=\"65\">{}</text>\n",
        escaped(subtitle)
    )
}

/// A picture without its map.
pub(super) struct Sheet<'a> {
    /// What it shows, and of what file.
    pub(super) what: &'a str,
    pub(super) source: &'a str,
    /// A line of figures.
    pub(super) subtitle: &'a str,
    /// Style of what lies on the map.
    pub(super) style: &'a str,
    /// All points that the map has to show.
    pub(super) points_m: &'a [V2],
}

impl Sheet<'_> {
    /// The scale that the map will have.
    pub(super) fn view(&self) -> View {
        View::around(self.points_m, [MARGIN_PX, HEADER_PX], MAP_WIDTH_PX)
    }

    /// The whole picture; the same calls give the same bytes.
    pub(super) fn render(
        &self,
        draw: impl FnOnce(&mut String, &View),
        fill: impl FnOnce(&mut Panel),
    ) -> String {
        let view = self.view();
        let panel_x = MARGIN_PX + MAP_WIDTH_PX + GAP_PX;
        let mut panel = Panel::new([panel_x, HEADER_PX], PANEL_WIDTH_PX);
        fill(&mut panel);
        let (legend, bottom) = panel.finish();
        let width = panel_x + PANEL_WIDTH_PX + MARGIN_PX;
        let height = bottom.max(HEADER_PX + view.height_px()) + MARGIN_PX;
        let file = Path::new(self.source).file_name();
        let file = file.map_or_else(|| self.source.into(), |name| name.to_string_lossy());
        let title = format!("{} {file}", self.what);
        let mut svg = header(&title, self.subtitle, self.style, [width, height]);
        let [left, top, width, height] = view.frame_px().map(px);
        let frame = format!("x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" rx=\"10\"");
        let _ = writeln!(
            svg,
            "<defs>\n<clipPath id=\"frame\"><rect {frame}/></clipPath>\n</defs>\n\
             <rect class=\"frame\" {frame}/>\n<g clip-path=\"url(#frame)\">"
        );
        draw(&mut svg, &view);
        marks::scale_bar(&mut svg, &view);
        marks::north(&mut svg, &view);
        svg.push_str("</g>\n");
        svg.push_str(&legend);
        svg.push_str("</svg>\n");
        svg
    }
}
