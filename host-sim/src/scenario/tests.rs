//! What is read, what is refused, and how a refusal reads.

use super::*;

/// The scenario that the text states, checked.
fn read(text: &str) -> Result<Scenario, ScenarioError> {
    let loaded = LoadedScenario::from_toml(text, "host.toml", Path::new("/data"))?;
    loaded.check()?;
    Ok(loaded.scenario)
}

/// How the refusal of the text reads.
fn refusal(text: &str) -> String {
    read(text).map_or_else(|error| error.to_string(), |scenario| format!("accepted: {scenario:?}"))
}

#[test]
fn the_paper_file_states_the_defaults_and_adds_limits() {
    let LoadedScenario { scenario, source } = LoadedScenario::paper();
    assert_ne!(scenario.limits, LimitsTable::default());
    assert_eq!(Scenario { limits: LimitsTable::default(), ..scenario }, Scenario::default());
    assert_eq!(source.name(), "built-in scenario `paper`");
    assert!(LoadedScenario::paper().check().is_ok());
}

#[test]
fn the_paper_file_names_every_key() {
    let named = |key: &str| {
        PAPER_TOML.lines().any(|line| line.trim_start_matches("# ").starts_with(&format!("{key} =")))
    };
    let tables = serde_json::to_value(Scenario::default()).unwrap_or_default();
    for (name, value) in tables.as_object().into_iter().flatten() {
        match value.as_object() {
            _ if name == "limits" => {} // a choice of them
            Some(table) => table.keys().for_each(|key| assert!(named(key), "{name}.{key}")),
            None => assert!(named(name), "{name}"),
        }
    }
}

#[test]
fn a_scenario_survives_being_written_and_read() {
    let scenario = LoadedScenario::paper().scenario;
    let text = toml::to_string(&scenario).unwrap_or_default();
    assert_eq!(read(&text.replace("width_m = 10000.0", "width_m = 10000")).ok(), Some(scenario));
}

#[test]
fn an_empty_file_is_the_paper_without_limits() {
    assert_eq!(read("").ok(), Some(Scenario::default()));
}

#[test]
fn paths_are_relative_to_the_scenario_file() {
    let scenario =
        read("[area]\nfile = 'town.csv'\n[users]\nfile = '/abs/users.csv'").ok().unwrap_or_default();
    assert_eq!(scenario.area.file, Some(PathBuf::from("/data/town.csv")));
    assert_eq!(scenario.users.file, Some(PathBuf::from("/abs/users.csv")));
}

#[test]
fn fleets_take_three_and_the_rest_is_in_reserve() {
    for (drones, fleets, reserves) in [(2, 0, 2), (3, 1, 0), (6, 2, 0), (8, 2, 2)] {
        let scenario =
            Scenario { fleet: FleetTable { drones, ..FleetTable::default() }, ..Scenario::default() };
        assert_eq!((scenario.fleets(), scenario.reserves()), (fleets, reserves));
    }
}

/// One mistake per line of the snapshot.
#[test]
fn refusals_name_line_field_found_and_expected() {
    let mistakes = [
        // Not TOML, unknown keys, wrong types.
        "[fleet\n",
        "\n[fleet]\ndronez = 6",
        "\n\n[flet]\ndrones = 6",
        "[fleet]\ndrones = 'six'",
        "[fleet]\ndrones = 6.5",
        "[fleet]\ndrones = -1",
        "[fleet]\nsplit = 'half'",
        "fleet = 3",
        "seed = -1",
        "[fleet]\nbase_m = [1.0]",
        "[fleet]\nbase_m = [1.0, 'x']",
        "fleet.drones = 6\nfleet.drones = 7",
        "[area]\nfile = 'a.csv'\nwidth_m = 5",
        "[users]\ndensity_per_km2 = 5\nfile = 'a.csv'",
        // Out of range.
        "name = ' '",
        "# comment\n[fleet]\ndrones = 0",
        "[fleet]\ndrones = 4097",
        "[fleet]\nradius_m = nan",
        "[fleet]\nradius_m = -500",
        "[fleet]\nspeed_mps = inf",
        "[fleet]\nbase_m = [0, -inf]",
        "[area]\nwidth_m = 0",
        "[users]\ndensity_per_km2 = -5",
        "[srs]\nnlos_fraction = 1.5",
        "[srs]\ntick_hz = 0",
        "[srs]\nsymbols = 3",
        "[clock]\npps_loss_fraction = 1.5",
        "[clock]\ndrift_ns_per_s = 200_000",
        "[link]\nloss_fraction = nan",
        "[mission]\nduration_s = 0",
        "[limits]\ncoverage_fraction_min = 99",
        "[limits]\ncrlb_ratio_max = nan",
        // Not in keeping with each other.
        "[fleet]\nd_safe_m = 46",
        "[fleet]\npad_spacing_m = 60",
        "[fleet]\ndrones = 3\npads_m = [[0, 0], [50, 0]]",
        "[fleet]\ndrones = 3\npads_m = [[0, 0], [50, 0], [nan, 0]]",
        "[fleet]\ndrones = 3\npads_m = [[0, 0], [50, 0], [50, 16]]",
        "[fleet]\ndrones = 3\naltitude_m = 16\npads_m = [[0, 0], [50, 0], [50, 17]]",
        "[fleet]\ndrones = 3\nbase_m = [0, 0]\npads_m = [[0, 0], [50, 0], [50, 17]]",
        "[[losses]]\ndrone = 7\nat_s = 1",
        "[[losses]]\ndrone = 6\nat_s = -1",
        "[[losses]]\ndrone = 6",
        "[[losses]]\ndrone = 6\nat_s = 1\n[[losses]]\ndrone = 6\nat_s = 2",
        "[[faults]]\nkind = 'gremlin'\nat_s = 1",
        "[[faults]]\nkind = 'clock_jump'\nat_s = 1",
        "[[faults]]\nkind = 'control_killed'\ndrone = 1\nat_s = 1",
        "[[faults]]\nkind = 'attack'\ndrone = 7\nat_s = 1",
        "[[faults]]\nkind = 'board_reset'\ndrone = 1\nat_s = nan",
        "[battery]\ncharges = [1, 1, 1, 1, 1]",
        "[battery]\ncharges = [1, 1, 1, 1, 1, 1.5]",
        "[[partitions]]\nfrom_s = 2\nuntil_s = 1",
        "[[partitions]]\ndrones = [7]\nfrom_s = 1\nuntil_s = 2",
        "[[partitions]]\nfrom_s = nan\nuntil_s = 2",
        "[[partitions]]\nfrom_s = 1",
        "[link]\nburst_every_s = 0",
        "[link]\nbits_per_s = -1",
        "[link]\nbits_per_s = 3999",
        "[link]\nrekey_s = 0",
        "[fleet]\nspacing_m = 867",
        "[fleet]\nmargin_m = 480",
        "[fleet]\nproportions = [1.0]",
        "[fleet]\nproportions = [0.5, 0.6]",
        "[fleet]\nproportions = [1.5, -0.5]",
        "[fleet]\nproportions = [nan, 0.5]",
        "[srs]\nnlos_min_ns = 2000",
        "[users]\naltitude_m = 300",
    ];
    let told: Vec<String> = mistakes
        .iter()
        .map(|text| format!("{}\n    {}\n", text.replace('\n', " | "), refusal(text)))
        .collect();
    insta::assert_snapshot!(told.concat());
}

#[test]
fn what_an_option_replaced_is_blamed_on_the_option() {
    let mut loaded = LoadedScenario::paper();
    loaded.apply(&Overrides { drones: Some(0), ..Overrides::default() });
    let told = loaded.check().map_or_else(|error| error.to_string(), |()| String::new());
    assert_eq!(told, "--drones: fleet.drones: found 0, expected 1 to 4096");
}

#[test]
fn an_option_replaces_what_the_file_states() {
    let text = "seed = 3\n[users]\nfile = 'users.csv'\n[area]\nwidth_m = 50";
    let mut loaded = LoadedScenario::from_toml(text, "host.toml", Path::new(""))
        .unwrap_or_else(|_| LoadedScenario::paper());
    loaded.apply(&Overrides {
        seed: Some(u64::MAX),
        density_per_km2: Some(9.0),
        area: Some("area.csv".into()),
        loss_fraction: Some(0.25),
        duration_s: Some(60.0),
        ..Overrides::default()
    });
    let scenario = loaded.scenario;
    assert_eq!(scenario.seed, u64::MAX);
    assert_eq!((scenario.users.file, scenario.users.density_per_km2), (None, 9.0));
    assert_eq!(scenario.area.file, Some(PathBuf::from("area.csv")));
    assert_eq!((scenario.link.loss_fraction, scenario.mission.duration_s), (0.25, Some(60.0)));
}

proptest::proptest! {
    /// Whatever the text, reading it answers; it never panics.
    #[test]
    fn any_text_is_answered(text in "\\PC*", key in "[a-z_.\\[\\]]{0,20}", value in "[-0-9.enaif'\"\\[\\], ]{0,12}") {
        let _ = read(&text);
        let _ = read(&format!("{key} = {value}"));
        let _ = read(&format!("[fleet]\nproportions = {value}\nspacing_m = {value}"));
    }

    /// Whatever the numbers, what passes the check is finite.
    #[test]
    fn what_passes_is_finite(value in proptest::num::f64::ANY) {
        let mut loaded = LoadedScenario::paper();
        for field in [0, 1, 2, 3] {
            let scenario = &mut loaded.scenario;
            *[&mut scenario.fleet.radius_m, &mut scenario.users.density_per_km2,
              &mut scenario.link.delay_s, &mut scenario.wind.direction_deg][field] = value;
            proptest::prop_assert!(value.is_finite() || loaded.check().is_err());
            loaded = LoadedScenario::paper();
        }
    }
}
