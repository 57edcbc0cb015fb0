//! The figures of a campaign, for people, for a page, for scripts and as pictures.
//!
//! - `plot`: a figure as a picture,
//! - `page`: a figure as tables in Markdown,
//! - `json`: every number, for scripts.

mod json;
mod page;
mod plot;
#[cfg(test)]
mod tests;

use crate::campaign::figures::{Comparison, Count, Curve, Figure};
use crate::campaign::plan::{Method, Plan};

/// The figures of one campaign.
#[derive(Clone, Debug)]
pub struct CampaignReport {
    /// What was varied.
    pub plan: Plan,
    /// What came of it.
    pub figures: Vec<Figure>,
}

impl CampaignReport {
    /// Files to be written: a picture of each figure, and `figures.md` and `figures.json` of all.
    #[must_use]
    pub fn files(&self) -> Vec<(String, String)> {
        let picture = |figure: &Figure| (self.picture_file(figure), plot::render(self, figure));
        let mut files: Vec<(String, String)> = self.figures.iter().map(picture).collect();
        files.push(("figures.md".to_owned(), page::render(self)));
        files.push(("figures.json".to_owned(), self.to_json()));
        files
    }

    /// All figures as one JSON object, with a line break at its end.
    #[must_use]
    pub fn to_json(&self) -> String {
        json::render(self)
    }

    /// For people: the tables of the page.
    #[must_use]
    pub fn to_text(&self) -> String {
        page::render(self)
    }

    /// The scenario's name alone where there is one figure, and else what sets this one apart.
    fn picture_file(&self, figure: &Figure) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
        let mut name: String = self.plan.scenario.name.chars().map(plain).collect();
        if self.plan.campaign.r_e_m.len() > 1 {
            name += &format!("-r_e-{}m", figure.r_e_m);
        }
        if self.plan.campaign.drones.len() > 1 {
            name += &format!("-{}-drones", figure.drones);
        }
        name + ".svg"
    }
}

/// What a method is called.
const fn title(method: Method) -> &'static str {
    match method {
        Method::Proposed => "Algorithm 2",
        Method::Random => "random search",
        Method::Full => "full system",
    }
}

/// How a curve counts, in a word or two.
const fn counted(method: Method, count: Count) -> &'static str {
    match (method, count) {
        (Method::Random, Count::Guaranteed) => "within R_C - r_e",
        (Method::Random, Count::Actual) => "within R_C",
        (_, Count::Guaranteed) => "guaranteed",
        (_, Count::Actual) => "actual",
    }
}

/// The curves worth showing: without an error both counts of a method are one, but those of the full system.
fn distinct(figure: &Figure) -> impl Iterator<Item = &Curve> {
    figure
        .curves
        .iter()
        .filter(|curve| curve.count == Count::Actual || curve.method == Method::Full || figure.r_e_m > 0.0)
}

/// As [`distinct`]: without an error only counts of true positions differ from each other, and for the full system its own.
fn distinct_comparisons(figure: &Figure) -> impl Iterator<Item = &Comparison> {
    figure.comparisons.iter().filter(|it| {
        let of_truth =
            it.against == Count::Actual && (it.count == Count::Actual || it.method == Method::Full);
        of_truth || figure.r_e_m > 0.0
    })
}
