//! A table with a heading and a word on what it shows, as text or as Markdown.

use std::fmt;

/// Columns of figures under a row of heads.
pub(super) struct Table {
    pub(super) title: &'static str,
    /// What it shows, in one line.
    pub(super) note: String,
    /// Heads, that of the rows' names first.
    pub(super) heads: Vec<String>,
    /// Names and figures.
    pub(super) rows: Vec<(String, Vec<String>)>,
}

impl Table {
    fn lines(&self) -> impl Iterator<Item = Vec<&str>> {
        self.rows.iter().map(|(name, figures)| {
            std::iter::once(name).chain(figures).map(String::as_str).collect::<Vec<&str>>()
        })
    }

    /// A section of a page.
    pub(super) fn to_markdown(&self) -> String {
        let line = |cells: &[&str]| format!("| {} |\n", cells.join(" | "));
        let heads: Vec<&str> = self.heads.iter().map(String::as_str).collect();
        let rules: Vec<&str> =
            (0..heads.len()).map(|column| if column == 0 { "---" } else { "---:" }).collect();
        let rows: String = self.lines().map(|cells| line(&cells)).collect();
        format!("## {}\n\n{}\n\n{}{}{rows}", self.title, wrapped(&self.note), line(&heads), line(&rules))
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n{}", self.title, wrapped(&self.note))?;
        let heads: Vec<&str> = self.heads.iter().map(String::as_str).collect();
        let lines: Vec<Vec<&str>> = std::iter::once(heads).chain(self.lines()).collect();
        let width = |column: usize| {
            lines.iter().filter_map(|cells| cells.get(column)).map(|cell| cell.chars().count()).max()
        };
        let widths: Vec<usize> = (0..self.heads.len()).map(|column| width(column).unwrap_or(0)).collect();
        for cells in &lines {
            for (column, (cell, width)) in cells.iter().zip(&widths).enumerate() {
                if column == 0 {
                    write!(f, "  {cell:<width$}")?;
                } else {
                    write!(f, "  {cell:>width$}")?;
                }
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

/// Lines that a terminal holds.
pub(super) fn wrapped(text: &str) -> String {
    /// Columns of a line.
    const WIDTH: usize = 96;
    let mut lines = String::new();
    let mut used = 0;
    for word in text.split_whitespace() {
        let width = word.chars().count();
        match used {
            0 => {}
            used if used + 1 + width > WIDTH => lines.push('\n'),
            _ => lines.push(' '),
        }
        used = if lines.ends_with('\n') { 0 } else { used + 1 } + width;
        lines += word;
    }
    lines
}
