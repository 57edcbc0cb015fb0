//! One chart: axes with round ticks, curves with their names at the right end, and bands that they are known within.

use std::fmt::Write as _;

use crate::report::map::view::{escaped, px};

/// Look of everything in a chart, after that of all pictures.
pub(in crate::report) const STYLE: &str = include_str!("chart.css");

/// Left of the frame for the ticks' numbers.
const NUMBERS_PX: f64 = 34.0;
/// Above the frame for the heading, below it for numbers and the axis' name.
const HEAD_PX: f64 = 26.0;
const FOOT_PX: f64 = 44.0;
/// Names of curves keep this distance from line to line.
const NAME_LINE_PX: f64 = 15.0;
/// More numbers than these would run into each other.
const MOST_TICKS: f64 = 6.0;

/// From values to pixels.
#[derive(Clone, Copy, Debug)]
pub(in crate::report) struct Axis {
    range: [f64; 2],
    logarithmic: bool,
}

impl Axis {
    /// Equal steps from 0 to `most`.
    pub(in crate::report) fn linear(most: f64) -> Self {
        Self { range: [0.0, most], logarithmic: false }
    }

    /// Equal steps around all `values` that are finite, and 0; it begins and ends at a tick.
    pub(in crate::report) fn around_zero(values: impl Iterator<Item = f64>) -> Self {
        let finite = values.filter(|value| value.is_finite());
        let range =
            finite.fold([0.0, 0.0], |[least, most], value| [f64::min(least, value), f64::max(most, value)]);
        let step = tick_step((range[1] - range[0]).max(1.0));
        Self {
            range: [(range[0] / step).floor() * step, (range[1] / step).ceil().max(1.0) * step],
            logarithmic: false,
        }
    }

    /// Equal ratios between round numbers around all `values` (positive ones that are finite).
    pub(in crate::report) fn logarithmic(values: impl Iterator<Item = f64>) -> Self {
        let finite = values.filter(|value| value.is_finite() && *value > 0.0);
        let range = finite.fold([f64::INFINITY, 0.0], |[least, most], value| {
            [f64::min(least, value), f64::max(most, value)]
        });
        let [least, most] = if range[1] > 0.0 { range } else { [1.0, 10.0] };
        let below = round_numbers(least / 10.0, least).last().unwrap_or(least);
        let above = round_numbers(most * (1.0 + 1e-9), most * 10.0).next().unwrap_or(most);
        Self { range: [below, above], logarithmic: true }
    }

    /// 0 to 1 along the axis.
    fn share(&self, value: f64) -> f64 {
        let [least, most] = self.range;
        if self.logarithmic {
            (value / least).ln() / (most / least).ln()
        } else {
            (value - least) / (most - least)
        }
    }

    fn ticks(&self) -> Vec<f64> {
        let [least, most] = self.range;
        if self.logarithmic {
            let all: Vec<f64> = round_numbers(least, most).collect();
            let powers = |value: &f64| (value.log10() - value.log10().round()).abs() < 1e-6;
            return if all.len() <= 12 { all } else { all.into_iter().filter(powers).collect() };
        }
        let step = tick_step(most - least);
        (0..=((most - least) / step + 1e-9) as usize).map(|k| least + k as f64 * step).collect()
    }
}

/// The least round number that a length has few enough of.
fn tick_step(length: f64) -> f64 {
    let mut steps = round_numbers(length / MOST_TICKS / 10.0, length);
    steps.find(|step| length / step <= MOST_TICKS).unwrap_or(length)
}

/// 1, 2 and 5 times powers of ten within a range.
fn round_numbers(least: f64, most: f64) -> impl Iterator<Item = f64> {
    let first = least.log10().floor() as i32;
    let last = most.log10().ceil() as i32;
    let all = (first..=last).flat_map(|power| [1.0, 2.0, 5.0].map(|k| k * 10f64.powi(power)));
    all.filter(move |value| (least * (1.0 - 1e-9)..=most * (1.0 + 1e-9)).contains(value))
}

/// A number as a tick shows it.
fn number(value: f64) -> String {
    format!("{}", (value * 1e6).round() / 1e6)
}

/// One line of a chart.
pub(in crate::report) struct Line {
    /// Its look.
    pub(in crate::report) class: String,
    /// What stands at its right end; nothing if empty.
    pub(in crate::report) name: String,
    /// Abscissa and ordinate; what is not finite is left out.
    pub(in crate::report) points: Vec<[f64; 2]>,
    /// What each of them is known within: least and greatest ordinate; empty for a line without a band.
    pub(in crate::report) band: Vec<[f64; 2]>,
}

/// A chart in its place.
pub(in crate::report) struct Chart<'a> {
    /// Left, top, width and height of everything, pixels.
    pub(in crate::report) place_px: [f64; 4],
    /// Right of the frame for the names of curves.
    pub(in crate::report) names_px: f64,
    pub(in crate::report) head: &'a str,
    pub(in crate::report) x: Axis,
    pub(in crate::report) y: Axis,
    pub(in crate::report) x_name: &'a str,
}

impl Chart<'_> {
    /// The frame that curves lie in: left, top, width and height, pixels.
    pub(in crate::report) fn frame_px(&self) -> [f64; 4] {
        let [left, top, width, height] = self.place_px;
        [left + NUMBERS_PX, top + HEAD_PX, width - NUMBERS_PX - self.names_px, height - HEAD_PX - FOOT_PX]
    }

    /// Height of an ordinate in the picture, pixels.
    pub(in crate::report) fn ordinate_px(&self, y: f64) -> f64 {
        self.point_px([self.x.range[0], y])[1]
    }

    fn point_px(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, top, width, height] = self.frame_px();
        [left + width * self.x.share(x), top + height * (1.0 - self.y.share(y))]
    }

    /// Draws it all.
    pub(in crate::report) fn draw(&self, svg: &mut String, lines: &[Line]) {
        self.axes(svg);
        lines.iter().for_each(|line| self.band(svg, line));
        let mut names: Vec<(f64, &Line)> = Vec::new();
        for line in lines {
            let finite = line.points.iter().filter(|point| point[1].is_finite());
            let points: Vec<[f64; 2]> = finite.map(|&point| self.point_px(point)).collect();
            let Some(&[_, end_y]) = points.last() else { continue };
            let steps = points.iter().enumerate();
            let path: String = steps
                .map(|(i, [x, y])| format!("{}{} {}", if i == 0 { 'M' } else { 'L' }, px(*x), px(*y)))
                .collect();
            let _ = writeln!(svg, "<path class=\"curve {}\" d=\"{path}\"/>", line.class);
            if !line.name.is_empty() {
                names.push((end_y, line));
            }
        }
        self.names(svg, names);
    }

    /// The band of a line, there and back; below all curves.
    fn band(&self, svg: &mut String, line: &Line) {
        let edge = |side: usize| {
            let ends = line.points.iter().zip(&line.band).map(move |(point, ends)| [point[0], ends[side]]);
            ends.filter(|point| point[1].is_finite()).map(|point| self.point_px(point)).collect::<Vec<_>>()
        };
        let (low, high) = (edge(0), edge(1));
        if low.len() < 2 || low.len() != high.len() {
            return;
        }
        let corner = |(i, [x, y]): (usize, &[f64; 2])| {
            format!("{}{} {}", if i == 0 { 'M' } else { 'L' }, px(*x), px(*y))
        };
        let path: String = low.iter().chain(high.iter().rev()).enumerate().map(corner).collect();
        let _ = writeln!(svg, "<path class=\"band {}\" d=\"{path}Z\"/>", line.class);
    }

    fn axes(&self, svg: &mut String) {
        let [left, top, width, height] = self.frame_px();
        let [place_left, place_top, ..] = self.place_px;
        let (right, bottom) = (left + width, top + height);
        let _ = writeln!(
            svg,
            "<text class=\"head\" x=\"{}\" y=\"{}\">{}</text>\n\
             <rect class=\"frame\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            px(place_left),
            px(place_top + 11.0),
            escaped(&self.head.to_uppercase()),
            px(left),
            px(top),
            px(width),
            px(height),
        );
        for tick in self.y.ticks() {
            let y = self.point_px([self.x.range[0], tick])[1];
            let _ = writeln!(
                svg,
                "<path class=\"rule\" d=\"M{} {y}H{}\"/><text class=\"number small\" x=\"{}\" y=\"{}\">{}</text>",
                px(left),
                px(right),
                px(left - 6.0),
                px(y + 4.0),
                number(tick),
                y = px(y),
            );
        }
        for tick in self.x.ticks() {
            let x = self.point_px([tick, self.y.range[0]])[0];
            let _ = writeln!(
                svg,
                "<path class=\"rule\" d=\"M{x} {}V{}\"/><text class=\"small\" text-anchor=\"middle\" x=\"{x}\" y=\"{}\">{}</text>",
                px(top),
                px(bottom),
                px(bottom + 17.0),
                number(tick),
                x = px(x),
            );
        }
        let _ = writeln!(
            svg,
            "<text class=\"muted small\" text-anchor=\"middle\" x=\"{}\" y=\"{}\">{}</text>",
            px(left + width / 2.0),
            px(bottom + 36.0),
            escaped(self.x_name)
        );
    }

    /// Names from top to bottom, each at the end of its curve or below the one before.
    fn names(&self, svg: &mut String, mut names: Vec<(f64, &Line)>) {
        let [left, _, width, _] = self.frame_px();
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut above = f64::NEG_INFINITY;
        for (end_y, line) in names {
            let y = (end_y + 4.0).max(above + NAME_LINE_PX);
            above = y;
            let _ = writeln!(
                svg,
                "<text class=\"name {}\" x=\"{}\" y=\"{}\">{}</text>",
                line.class,
                px(left + width + 7.0),
                px(y),
                escaped(&line.name)
            );
        }
    }
}
