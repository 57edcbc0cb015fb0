//! What a campaign varies and what it holds fixed: the plan, read from TOML and checked as a whole.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};
use skyroost_protocol::units::MAX_DRONES;

use crate::scenario::{LoadedScenario, Scenario, ScenarioError, Source};

/// The table of a plan's TOML that is not the scenario's.
const TABLE: &str = "campaign";
/// Most of anything that is counted in a plan.
const MOST_SEEDS: u32 = 1_000_000;
const MOST_RUNS: u64 = 10_000_000;
const MOST_BLOCKS: u64 = 100_000;
/// Users of a run: as many as `world::users` draws.
const MOST_USERS: f64 = 1e7;
/// Least drones that can sweep.
const FLEET_DRONES: u32 = 3;

/// How runs come about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fidelity {
    /// The paper's closed model: all users located with error `r_e`, nothing flown for the proposed method, points
    /// that fly straight for random search.
    #[default]
    Paper,
    /// Every run flown by the flight code, users located by what it heard.
    Flight,
}

/// How drones come to their places.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The paper's Algorithm 2 on all users, each located with error `r_e`.
    Proposed,
    /// The paper's baseline: random search.
    Random,
    /// The whole system: each user with its own 95 % radius, all drones placed together.
    Full,
}

impl Method {
    /// As plans and results spell it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Proposed => "proposed",
            Self::Random => "random",
            Self::Full => "full",
        }
    }

    /// The method of a name.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        [Self::Proposed, Self::Random, Self::Full].into_iter().find(|method| method.name() == name)
    }
}

/// Which deployment random search answers with; the paper leaves it open (section 4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// The best places that all drones held at one time: what was recorded is what serves.
    #[default]
    Simultaneous,
    /// Of all places that any drone visited, one after the other the one that adds the most users. The drones then fly
    /// back there, and must know whom they have heard where.
    Greedy,
}

/// The table `[campaign]`: every key has a default but the densities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CampaignTable {
    /// How runs come about.
    pub fidelity: Fidelity,
    /// The seed that all chance of all runs comes from.
    pub base_seed: u64,
    /// Runs of each combination of the lists below.
    pub seeds: u32,
    /// Mean numbers of users per square kilometre.
    pub densities_per_km2: Vec<f64>,
    /// Errors of position that the proposed method assumes, and in the closed model has.
    pub r_e_m: Vec<f64>,
    /// Numbers of drones; the scenario's where none is stated.
    pub drones: Vec<u32>,
    /// What is compared on the users of each run.
    pub methods: Vec<Method>,
    /// What random search answers with.
    pub random_search: Reading,
    /// Runs of a block.
    pub block_runs: u32,
}

impl Default for CampaignTable {
    fn default() -> Self {
        Self {
            fidelity: Fidelity::Paper,
            base_seed: 1,
            seeds: 100,
            densities_per_km2: Vec::new(),
            r_e_m: vec![30.0],
            drones: Vec::new(),
            methods: vec![Method::Proposed, Method::Random, Method::Full],
            random_search: Reading::Simultaneous,
            block_runs: 50,
        }
    }
}

/// What the command line may replace in a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlanOverrides {
    /// How runs come about.
    pub fidelity: Option<Fidelity>,
    /// The seed that all chance of all runs comes from.
    pub base_seed: Option<u64>,
}

/// A checked plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// What is varied.
    pub campaign: CampaignTable,
    /// What is held fixed. Its seed, density and number of drones are not used.
    pub scenario: Scenario,
}

impl Plan {
    /// Reads a plan: the table `[campaign]`, and the tables of a scenario beside it.
    ///
    /// # Errors
    /// A mistake with its file, line and field.
    pub fn read(path: &Path, overrides: PlanOverrides) -> Result<(Self, String), ScenarioError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|source| ScenarioError::Unreadable { file: name.clone(), source })?;
        Ok((Self::from_toml(&text, &name, overrides)?, text))
    }

    /// Reads a plan from text; `name` stands for its file in messages.
    ///
    /// # Errors
    /// As [`Plan::read`].
    pub fn from_toml(text: &str, name: &str, overrides: PlanOverrides) -> Result<Self, ScenarioError> {
        let (campaign, mut loaded) =
            LoadedScenario::from_toml_beside::<CampaignTable>(TABLE, text, name, Path::new(""))?;
        let mut campaign = campaign.unwrap_or_default();
        if let Some(fidelity) = overrides.fidelity {
            campaign.fidelity = fidelity;
            loaded.source.replaced_by("campaign.fidelity", "--fidelity");
        }
        if let Some(base_seed) = overrides.base_seed {
            campaign.base_seed = base_seed;
            loaded.source.replaced_by("campaign.base_seed", "--seed");
        }
        loaded.check()?;
        let LoadedScenario { scenario, source } = loaded;
        if campaign.drones.is_empty() {
            campaign.drones.push(scenario.fleet.drones);
        }
        let plan = Self { campaign, scenario };
        plan.check(&source)?;
        Ok(plan)
    }

    /// Runs of the whole campaign.
    #[must_use]
    pub fn runs(&self) -> u64 {
        u64::from(self.campaign.seeds) * self.combinations()
    }

    /// Combinations of what is varied, methods and seeds aside.
    pub(super) fn combinations(&self) -> u64 {
        let CampaignTable { densities_per_km2, r_e_m, drones, .. } = &self.campaign;
        [densities_per_km2.len(), r_e_m.len(), drones.len()]
            .into_iter()
            .fold(1, |all, of| all.saturating_mul(of as u64))
    }

    /// Blocks of the whole campaign.
    #[must_use]
    pub fn blocks(&self) -> u64 {
        self.runs().div_ceil(u64::from(self.campaign.block_runs))
    }

    fn check(&self, source: &Source) -> Result<(), ScenarioError> {
        let Self { campaign, scenario } = self;
        for (field, by) in [
            ("seed", "campaign.base_seed in its place"),
            ("users.density_per_km2", "campaign.densities_per_km2 in its place"),
            ("users.file", "users strewn at random, by campaign.densities_per_km2"),
            ("area.file", "area.width_m and area.height_m, so that a plan is one file"),
            ("obstacles.file", "none, so that a plan is one file"),
            ("fence.file", "none, so that a plan is one file"),
        ] {
            refuse(source.states(field), source, field, "a value", || by.to_owned())?;
        }
        let area_km2 = scenario.area.width_m * scenario.area.height_m * 1e-6;
        let densest = (MOST_USERS / area_km2).min(10_000.0);
        let radius_m = scenario.fleet.radius_m;
        numbers(
            source,
            "campaign.densities_per_km2",
            &campaign.densities_per_km2,
            |density| (0.0..=densest).contains(density),
            || format!("one or more different numbers from 0 to {densest}"),
        )?;
        numbers(
            source,
            "campaign.r_e_m",
            &campaign.r_e_m,
            |r_e_m| (0.0..radius_m).contains(r_e_m),
            || format!("one or more different numbers from 0 to less than fleet.radius_m = {radius_m}"),
        )?;
        let drones: Vec<f64> = campaign.drones.iter().map(|&drones| f64::from(drones)).collect();
        numbers(
            source,
            "campaign.drones",
            &drones,
            |drones| (1.0..=f64::from(MAX_DRONES)).contains(drones),
            || format!("one or more different whole numbers from 1 to {MAX_DRONES}"),
        )?;
        let methods: BTreeSet<Method> = campaign.methods.iter().copied().collect();
        let twice = methods.len() < campaign.methods.len();
        let found = if twice { "one of them twice" } else { "none" };
        refuse(methods.is_empty() || twice, source, "campaign.methods", found, || {
            "one or more of proposed, random and full".to_owned()
        })?;
        refuse(
            !(1..=MOST_SEEDS).contains(&campaign.seeds),
            source,
            "campaign.seeds",
            campaign.seeds,
            || format!("1 to {MOST_SEEDS}"),
        )?;
        refuse(campaign.block_runs == 0, source, "campaign.block_runs", 0, || "1 or more".to_owned())?;
        refuse(
            self.runs() > MOST_RUNS,
            source,
            "campaign.seeds",
            format!("{} runs in all", self.runs()),
            || format!("at most {MOST_RUNS}"),
        )?;
        refuse(
            self.blocks() > MOST_BLOCKS,
            source,
            "campaign.block_runs",
            format!("{} blocks", self.blocks()),
            || format!("at most {MOST_BLOCKS}"),
        )?;
        if methods.contains(&Method::Random) {
            for (field, side_m) in
                [("area.width_m", scenario.area.width_m), ("area.height_m", scenario.area.height_m)]
            {
                refuse(side_m < 2.0 * radius_m, source, field, side_m, || {
                    format!(
                        "at least twice fleet.radius_m = {radius_m}, which random search keeps within the area"
                    )
                })?;
            }
        }
        let grounded = campaign.drones.iter().find(|&&drones| drones < FLEET_DRONES);
        if let Some(drones) = grounded.filter(|_| campaign.fidelity == Fidelity::Flight) {
            refuse(true, source, "campaign.drones", drones, || {
                format!("{FLEET_DRONES} or more, as a fleet that sweeps needs")
            })?;
        }
        Ok(())
    }
}

/// Complains about a list that is empty, holds a number twice or one that is not `good`. NaN is never good.
fn numbers(
    source: &Source,
    field: &str,
    found: &[f64],
    good: impl Fn(&f64) -> bool,
    expected: impl FnOnce() -> String,
) -> Result<(), ScenarioError> {
    let twice = |(i, number): (usize, &f64)| found[..i].iter().any(|before| before.total_cmp(number).is_eq());
    let complaint = match found.iter().find(|number| !good(number)) {
        Some(number) => Some(number.to_string()),
        None if found.is_empty() => Some("none".to_owned()),
        None => found.iter().enumerate().find(|&it| twice(it)).map(|(_, number)| format!("{number} twice")),
    };
    match complaint {
        Some(complaint) => refuse(true, source, field, complaint, expected),
        None => Ok(()),
    }
}

/// Complains about `field` where it is `bad`.
fn refuse(
    bad: bool,
    source: &Source,
    field: &str,
    found: impl fmt::Display,
    expected: impl FnOnce() -> String,
) -> Result<(), ScenarioError> {
    if !bad {
        return Ok(());
    }
    let (field, found) = (field.to_owned(), found.to_string());
    Err(ScenarioError::Value { place: source.place(&field), field, found, expected: expected() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str) -> Result<Plan, String> {
        Plan::from_toml(text, "plan.toml", PlanOverrides::default()).map_err(|error| error.to_string())
    }

    const SMALL: &str = "[campaign]\nseeds = 3\ndensities_per_km2 = [1, 5]\nr_e_m = [30.0, 0.0]\n";

    #[test]
    fn the_contract_is_read() {
        let text = "[campaign]\nfidelity = \"paper\"\nbase_seed = 1\nseeds = 100\ndensities_per_km2 = [1, 5, 10]\n\
                    r_e_m = [30.0, 0.0]\nmethods = [\"proposed\", \"random\", \"full\"]\nblock_runs = 50\n\
                    [fleet]\ndrones = 9\n";
        let plan = plan(text).unwrap();
        assert_eq!((plan.runs(), plan.blocks(), plan.combinations()), (600, 12, 6));
        assert_eq!(plan.campaign.drones, [9]);
        assert_eq!(plan.campaign.methods, [Method::Proposed, Method::Random, Method::Full]);
        assert_eq!(plan.campaign.random_search, Reading::Simultaneous);
    }

    #[test]
    fn options_replace_values() {
        let overrides = PlanOverrides { fidelity: Some(Fidelity::Flight), base_seed: Some(7) };
        let plan = Plan::from_toml(SMALL, "plan.toml", overrides).unwrap();
        assert_eq!((plan.campaign.fidelity, plan.campaign.base_seed), (Fidelity::Flight, 7));
    }

    #[test]
    fn names_spell_methods_both_ways() {
        for method in [Method::Proposed, Method::Random, Method::Full] {
            assert_eq!(Method::of_name(method.name()), Some(method));
            assert_eq!(serde_json::to_value(method).unwrap(), method.name());
        }
        assert_eq!(Method::of_name("best"), None);
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_field() {
        let with = |line: &str| format!("{SMALL}{line}\n");
        for (text, told) in [
            (
                String::new(),
                "plan.toml (default): campaign.densities_per_km2: found none, expected one or more",
            ),
            (with("seedz = 1"), "plan.toml:5: campaign.seedz: found an unknown key, expected one of"),
            (with("[fleets]"), "plan.toml:5: fleets: found an unknown key"),
            (with("base_seed = -1"), "plan.toml:5: campaign.base_seed: found integer `-1`"),
            (with("block_runs = 0"), "plan.toml:5: campaign.block_runs: found 0, expected 1 or more"),
            (with("methods = []"), "plan.toml:5: campaign.methods: found none"),
            (with("methods = [\"full\", \"full\"]"), "campaign.methods: found one of them twice"),
            (with("methods = [\"best\"]"), "plan.toml:5: campaign.methods: found `best`, expected one of"),
            (with("fidelity = \"film\""), "plan.toml:5: campaign.fidelity: found `film`, expected"),
            (with("drones = [0]"), "plan.toml:5: campaign.drones: found 0"),
            (with("drones = [6, 6]"), "plan.toml:5: campaign.drones: found 6 twice"),
            (with("drones = [2]\nfidelity = \"flight\""), "campaign.drones: found 2, expected 3 or more"),
            (SMALL.replace("seeds = 3", "seeds = 0"), "plan.toml:2: campaign.seeds: found 0, expected 1 to"),
            (SMALL.replace("[1, 5]", "[1, nan]"), "plan.toml:3: campaign.densities_per_km2: found NaN"),
            (
                SMALL.replace("[1, 5]", "[-1]"),
                "found -1, expected one or more different numbers from 0 to 10000",
            ),
            (SMALL.replace("[1, 5]", "[5, 1, 5]"), "found 5 twice"),
            (SMALL.replace("30.0", "500"), "plan.toml:4: campaign.r_e_m: found 500"),
            (SMALL.replace("30.0", "inf"), "plan.toml:4: campaign.r_e_m: found inf"),
            (with("[users]\ndensity_per_km2 = 5"), "plan.toml:6: users.density_per_km2: found a value"),
            (with("[area]\nfile = \"a.csv\""), "plan.toml:6: area.file: found a value"),
            (with("[area]\nwidth_m = 999"), "plan.toml:6: area.width_m: found 999, expected at least twice"),
            (with("[area]\nwidth_m = -1"), "plan.toml:6: area.width_m: found -1"),
            (with("x ="), "plan.toml:5: not valid TOML"),
            (format!("seed = 2\n{SMALL}"), "plan.toml:1: seed: found a value, expected campaign.base_seed"),
        ] {
            let error = plan(&text).unwrap_err();
            assert!(error.contains(told), "{told:?} is not in: {error}");
        }
    }
}
