//! How well a formation locates, for people, for a page, for scripts and as a picture.
//!
//! - `tables`: which tables there are and what they say,
//! - `table`: a table as text or as Markdown,
//! - `json`: every figure, for scripts,
//! - `plot`: radii as curves.

mod json;
mod plot;
mod table;
mod tables;
#[cfg(test)]
mod tests;

use crate::control::accuracy::Accuracy;

/// How well a formation locates.
#[derive(Clone, Debug)]
pub struct AccuracyReport {
    /// All figures.
    pub accuracy: Accuracy,
}

impl AccuracyReport {
    /// All figures as one JSON object, with a line break at its end. Radii of positions that the captures do not determine
    /// are null.
    #[must_use]
    pub fn to_json(&self) -> String {
        json::render(&self.accuracy)
    }

    /// The tables in Markdown, headings of the second level.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let tables = tables::all(&self.accuracy);
        let tables: Vec<String> = tables.iter().map(table::Table::to_markdown).collect();
        format!("{}\n\n{}", tables::formation(&self.accuracy.formation), tables.join("\n"))
    }

    /// Radii against the offset from the lane and against the error of clocks, as a picture.
    #[must_use]
    pub fn to_svg(&self) -> String {
        plot::render(&self.accuracy)
    }
}

impl std::fmt::Display for AccuracyReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}", tables::formation(&self.accuracy.formation))?;
        tables::all(&self.accuracy).iter().try_for_each(|table| write!(f, "\n{table}"))
    }
}
