//! The panel beside a map: headings, lines of figures, and what the marks mean.

use std::fmt::Write as _;

use super::view::{escaped, px};
use crate::geometry::V2;

/// From one line to the next, pixels.
const LINE_PX: f64 = 24.0;

/// A panel being filled from top to bottom.
pub(in crate::report) struct Panel {
    svg: String,
    x: f64,
    y: f64,
    pub(in crate::report) width: f64,
}

impl Panel {
    /// An empty one.
    pub(super) fn new([x, top]: [f64; 2], width: f64) -> Self {
        Self { svg: String::new(), x, y: top + 11.0, width }
    }

    /// What was drawn, and down to where.
    pub(super) fn finish(self) -> (String, f64) {
        (self.svg, self.y)
    }

    /// Text at `dx` from the left; of the class `number` it ends there.
    pub(in crate::report) fn text(&mut self, class: &str, dx: f64, text: &str) {
        let (x, y) = (px(self.x + dx), px(self.y));
        let _ = writeln!(self.svg, "<text class=\"{class}\" x=\"{x}\" y=\"{y}\">{}</text>", escaped(text));
    }

    /// A heading over a rule.
    pub(in crate::report) fn head(&mut self, text: &str) {
        self.text("head", 0.0, &text.to_uppercase());
        let (from, to, y) = (px(self.x), px(self.x + self.width), px(self.y + 8.0));
        let _ = writeln!(self.svg, "<path class=\"rule\" d=\"M{from} {y}H{to}\"/>");
        self.y += 29.0;
    }

    /// Goes to the next line.
    pub(in crate::report) fn next(&mut self) {
        self.y += LINE_PX;
    }

    /// Space between two headings.
    pub(in crate::report) fn gap(&mut self) {
        self.y += 14.0;
    }

    /// A mark and text beside it, on a line that goes on.
    pub(in crate::report) fn mark(&mut self, draw: impl Fn(V2) -> String, text: &str) {
        let mark = draw(V2::new(self.x + 10.0, self.y - 4.5));
        self.svg.push_str(&mark);
        self.svg.push('\n');
        self.text("", 30.0, text);
    }

    /// A line of the legend.
    pub(in crate::report) fn symbol(&mut self, draw: impl Fn(V2) -> String, text: &str) {
        self.mark(draw, text);
        self.next();
    }
}
