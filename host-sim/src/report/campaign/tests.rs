use super::*;
use crate::campaign::figures::figures;
use crate::campaign::plan::PlanOverrides;

/// Results that are made up: Algorithm 2 falls below random search between 10 and 30 users/km².
fn report(r_e_m: &str) -> CampaignReport {
    let toml = format!(
        "name = \"made <up>\"\n[campaign]\nseeds = 12\ndensities_per_km2 = [10, 30, 50]\nr_e_m = {r_e_m}\n"
    );
    let plan = Plan::from_toml(&toml, "plan.toml", PlanOverrides::default()).unwrap();
    let rows = (0..plan.runs()).flat_map(|number| {
        let run = plan.run(number).unwrap();
        let (density, noise) = (run.density_per_km2 as usize, (7 * run.seed % 5) as usize);
        let served = move |method: Method| match method {
            Method::Proposed => [9 * density + 30 + noise, 10 * density + 30],
            Method::Random => [8 * density + noise, 11 * density + noise],
            Method::Full => [12 * density + 40, 12 * density + 45 + noise],
        };
        plan.campaign
            .methods
            .clone()
            .into_iter()
            .map(move |method| run.row(method, 100 * density, served(method)))
    });
    let rows: Vec<_> = rows.collect();
    CampaignReport { figures: figures(&plan, &rows), plan }
}

#[test]
fn the_page_has_every_curve_and_crossover() {
    insta::assert_snapshot!(report("[30.0]").to_text());
}

#[test]
fn without_error_both_counts_are_one() {
    let page = report("[0.0]").to_text();
    let head = page.lines().find(|line| line.starts_with("| users")).unwrap();
    assert_eq!(head.matches("Algorithm 2").count(), 1, "{head}");
    assert_eq!(head.matches("full system").count(), 2, "{head}");
    assert_eq!(page.matches("\n- ").count(), 3, "{page}");
}

#[test]
fn pictures_are_named_by_what_sets_them_apart() {
    let names = |r_e_m: &str| report(r_e_m).files().into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    assert_eq!(names("[30]"), ["made--up-.svg", "figures.md", "figures.json"]);
    let two = ["made--up--r_e-30m.svg", "made--up--r_e-0m.svg", "figures.md", "figures.json"];
    assert_eq!(names("[30, 0]"), two);
}

#[test]
fn a_picture_is_whole_and_has_bands() {
    let report = report("[30]");
    let svg = plot::render(&report, &report.figures[0]);
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    roxmltree::Document::parse(&svg).expect("well-formed XML");
    // Six curves and six differences; a band where there is noise or none alike.
    assert_eq!((svg.matches("class=\"curve ").count(), svg.matches("class=\"band ").count()), (12, 12));
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    assert!(svg.contains("made &lt;up&gt;"));
}

#[test]
fn json_says_what_the_page_says() {
    let answer: serde_json::Value = serde_json::from_str(&report("[30]").to_json()).unwrap();
    let figure = &answer["figures"][0];
    assert_eq!((&figure["r_e_m"], &figure["curves"][0]["method"]), (&30.0.into(), &"proposed".into()));
    assert_eq!(figure["curves"][0]["points"][2]["runs"], 12);
    // 9 d + 30 against 11 d: they meet at 15 in truth, on the line from 10 to 30 as well.
    let crossover = figure["comparisons"][0]["crossover_per_km2"].as_f64().unwrap();
    assert!((crossover - 15.0).abs() < 1e-9, "{crossover}");
    assert!(figure["comparisons"][3]["crossover_per_km2"].is_null());
}
