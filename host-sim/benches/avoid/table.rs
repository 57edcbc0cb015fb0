//! Families of encounters times methods of avoidance.

mod orca;

use orca::Orca;
use rayon::prelude::*;
use skyroost_firmware::Vec3;
use skyroost_host_sim::encounter::{
    Avoidance, Encounter, Family, Knowledge, NoiseModel, Outcome, Steering, draw, fly,
};

/// What the hand-written part of `docs/avoidance.md` ends with; the table follows.
pub(crate) const MARK: &str = "<!-- From here on: `SKYROOST_UPDATE_DOCS=1 cargo xtask bench avoid`. -->\n";

/// A family and how often it is flown, from seed 1 on.
struct Row {
    name: &'static str,
    family: Family,
    vehicles: usize,
    runs: u64,
    quick_runs: u64,
    change: fn(&mut Encounter),
}

/// Once: nothing about it is random.
const ONCE: [u64; 2] = [1, 1];

const ROWS: [Row; 24] = [
    row("crossing", Family::Crossing, [10_000, 50]),
    row("intruder", Family::Intruder, [1_000, 50]),
    row("hover", Family::Hover, [1_000, 20]),
    row("head-on", Family::HeadOn, [500, 20]),
    row("head-on, exact", Family::HeadOn, [100, 5]).with(exact),
    row("overtake", Family::Overtake, [1_000, 20]),
    row("shallow", Family::Shallow, [1_000, 20]),
    row("fleets", Family::Fleets, [200, 5]),
    row("sweep-end", Family::SweepEnd, [200, 5]),
    row("circle of 8", Family::Circle, [50, 4]),
    row("circle of 20", Family::Circle, [20, 1]).of(20),
    row("circle of 50", Family::Circle, [4, 0]).of(50),
    row("circle of 8, exact", Family::Circle, ONCE).with(exact),
    row("circle of 20, exact", Family::Circle, ONCE).of(20).with(exact),
    row("box of 20", Family::Box, [30, 1]),
    row("crossing, 30 % lost", Family::Crossing, [1_000, 20]).with(lossy),
    row("box of 20, 30 % lost", Family::Box, [10, 1]).with(lossy),
    row("circle of 8, 1 s late", Family::Circle, [20, 2]).with(|encounter| encounter.share_delay_s = 1.0),
    row("crossing, adversarial", Family::Crossing, [1_000, 20]).with(adversarial),
    row("circle of 20, adversarial", Family::Circle, [5, 0]).of(20).with(adversarial),
    row("box of 20, adversarial", Family::Box, [10, 1]).with(adversarial),
    row("crossing, adversarial-shared", Family::Crossing, [1_000, 20]).with(adversarial_shared),
    row("circle of 20, adversarial-shared", Family::Circle, [5, 0]).of(20).with(adversarial_shared),
    row("box of 20, adversarial-shared", Family::Box, [10, 0]).with(adversarial_shared),
];

const fn row(name: &'static str, family: Family, [runs, quick_runs]: [u64; 2]) -> Row {
    Row { name, family, vehicles: family.usual_count(), runs, quick_runs, change: |_| {} }
}

impl Row {
    const fn of(self, vehicles: usize) -> Self {
        Self { vehicles, ..self }
    }

    const fn with(self, change: fn(&mut Encounter)) -> Self {
        Self { change, ..self }
    }
}

fn exact(encounter: &mut Encounter) {
    encounter.r_s_m = 0.0;
}

fn lossy(encounter: &mut Encounter) {
    encounter.share_loss = 0.3;
}

fn adversarial(encounter: &mut Encounter) {
    encounter.noise = NoiseModel::Adversarial;
}

fn adversarial_shared(encounter: &mut Encounter) {
    encounter.noise = NoiseModel::AdversarialShared;
}

#[derive(Clone, Copy)]
enum Method {
    FlightCode(Avoidance),
    Orca(Orca),
}

const METHODS: [(&str, Method); 5] = [
    ("off", Method::FlightCode(Avoidance::Off)),
    ("literal PCA", Method::FlightCode(Avoidance::LiteralPca)),
    ("ORCA", Method::Orca(Orca::USUAL)),
    ("ORCA, leaning", Method::Orca(Orca::LEANING)),
    ("ours", Method::FlightCode(Avoidance::On)),
];

impl Steering for Method {
    fn steer(&self, known: &Knowledge<'_>) -> Vec3 {
        match self {
            Self::FlightCode(avoidance) => avoidance.steer(known),
            Self::Orca(orca) => orca.steer(known),
        }
    }
}

/// The lines of the table, flown one by one as they are asked for; the same for any number of threads. The quick one
/// has fewer runs and digits, so that only what matters changes it.
pub(crate) fn lines(quick: bool) -> impl Iterator<Item = String> {
    let head = ["family", "method", "runs", "violating", "least, m", "overhead", "not arrived"];
    let rule = ["---", "---", "---:", "---:", "---:", "---:", "---:"];
    let chosen = ROWS.iter().filter(move |row| !quick || row.quick_runs > 0);
    let flown = chosen.flat_map(move |row| {
        METHODS.iter().map(move |(name, method)| {
            let runs = if quick { row.quick_runs } else { row.runs };
            let outcomes = outcomes(row, *method, runs);
            if *name == "ours" {
                tell_violations(row, &outcomes);
            }
            let digits = if quick { 0 } else { 2 };
            let [violating, least_m, overhead, missing] = figures(&outcomes, digits);
            line([row.name, name, &runs.to_string(), &violating, &least_m, &overhead, &missing])
        })
    });
    [line(head), line(rule)].into_iter().chain(flown)
}

fn line([family, method, runs, violating, least_m, overhead, missing]: [&str; 7]) -> String {
    format!(
        "| {family:<32} | {method:<13} | {runs:>6} | {violating:>9} | {least_m:>8} | {overhead:>8} | {missing:>11} |"
    )
}

fn outcomes(row: &Row, method: Method, runs: u64) -> Vec<Outcome> {
    let one = |seed| {
        let mut encounter = draw(row.family, row.vehicles, seed);
        (row.change)(&mut encounter);
        fly(&encounter, &method, &mut |_, _| {}).expect("families can be flown")
    };
    (1..=runs).into_par_iter().map(one).collect()
}

/// Which runs to look at.
fn tell_violations(row: &Row, outcomes: &[Outcome]) {
    let seeds: Vec<String> = (1..)
        .zip(outcomes)
        .filter(|(_, outcome)| outcome.violations > 0)
        .map(|(seed, _): (u64, _)| seed.to_string())
        .collect();
    if !seeds.is_empty() {
        eprintln!("{}: ours breaks the separation with the seeds {}", row.name, seeds.join(", "));
    }
}

/// Share of the runs with a violation, least separation (rounded down), mean overhead of those who arrived, and how many
/// did not.
fn figures(outcomes: &[Outcome], digits: u8) -> [String; 4] {
    let violating = outcomes.iter().filter(|outcome| outcome.violations > 0).count();
    let least_m =
        outcomes.iter().filter_map(|outcome| outcome.min_separation_m).fold(f64::INFINITY, f64::min);
    let some_arrived = |outcome: &&Outcome| outcome.arrival_s.iter().any(Option::is_some);
    let overheads: Vec<f64> =
        outcomes.iter().filter(some_arrived).map(|outcome| outcome.overhead_fraction).collect();
    let mean = overheads.iter().sum::<f64>() / overheads.len() as f64;
    let missing = outcomes.iter().flat_map(|outcome| &outcome.arrival_s).filter(|s| s.is_none()).count();
    let (scale, digits) = (10f64.powi(i32::from(digits)), usize::from(digits));
    // Zero added, so that it has no sign.
    let percent = |share: f64| format!("{:.digits$} %", (100.0 * share * scale).round() / scale + 0.0);
    [
        percent(violating as f64 / outcomes.len() as f64),
        format!("{:.digits$}", (least_m * scale).floor() / scale),
        if overheads.is_empty() { "-".to_owned() } else { percent(mean) },
        missing.to_string(),
    ]
}
