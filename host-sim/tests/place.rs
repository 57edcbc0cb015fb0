//! `skyroost place` as an operator and a script see it: exit status, stdout, stderr and files.

mod support;

use std::fs;
use std::process::Command;

use serde_json::Value;
use support::Bench;

/// Users of whom one drone after the other misses two that two drones together serve.
const USERS: &str = "id,x_m,y_m,r_e_m\n\
    w1,-1400,0,0\nw2,-1300,0,0\nw3,-600,0,0\nw4,-500,0,0\n\
    m1,-450,1,0\nm2,-449,1,0\nm3,-448,1,0\nm4,450,1,0\nm5,449,1,0\nm6,448,1,0\n\
    e1,500,0,0\ne2,600,0,0\ne3,1300,0,0\ne4,1400,0,0\nlost,0,5000,501\n";

fn bench() -> Bench {
    Bench::of("place").file("users.csv", USERS)
}

fn json(bench: &Bench, args: &[&str]) -> Value {
    let ran = bench.run(&[&["place", "--json", "--radius-m", "500"], args].concat());
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""), "{args:?}");
    serde_json::from_str(&ran.stdout).expect("one JSON object and nothing else")
}

#[test]
fn help_shows_every_option_and_examples() {
    let ran = bench().run(&["place", "--help"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    insta::assert_snapshot!(ran.stdout);
}

#[test]
fn the_summary_says_where_drones_hover_and_how_good_that_is() {
    let ran = bench().run(&["place", "--users", "users.csv", "--drones", "2", "--radius-m", "500"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    let seconds = |line: &str| line.split(" proved in ").next().map(str::to_owned).unwrap_or_default();
    insta::assert_snapshot!(ran.stdout.lines().map(seconds).collect::<Vec<_>>().join("\n"));
}

#[test]
fn json_has_the_keys_that_scripts_rely_on() {
    for (method, covered, bound) in [("joint", 14, 14), ("greedy", 11, 16), ("minlp", 11, 16)] {
        let answer = json(&bench(), &["--users", "users.csv", "--drones", "2", "--method", method]);
        assert_eq!((&answer["method"], &answer["radius_m"]), (&method.into(), &500.0.into()));
        assert_eq!(answer["covered"], covered, "{answer}");
        assert!(answer["upper_bound"].as_u64().is_some_and(|most| (14..=bound).contains(&most)), "{answer}");
        assert_eq!(answer["proved_optimal"], method == "joint");
        assert_eq!((&answer["never_coverable"], &answer["users"]), (&1.into(), &15.into()));
        assert!(answer["wall_s"].as_f64().is_some_and(|s| s >= 0.0));
        let drones = answer["drones"].as_array().unwrap();
        assert_eq!(drones.len(), 2);
        let mut ids: Vec<&str> = Vec::new();
        for drone in drones {
            let at = [&drone["x_m"], &drone["y_m"]].map(|x| x.as_f64().unwrap());
            for id in drone["covered"].as_array().unwrap() {
                let id = id.as_str().unwrap();
                let row = USERS.lines().find(|row| row.starts_with(&format!("{id},"))).unwrap();
                let numbers: Vec<f64> = row.split(',').skip(1).map(|x| x.parse().unwrap()).collect();
                let distance_m = (at[0] - numbers[0]).hypot(at[1] - numbers[1]);
                assert!(distance_m <= 500.0 - numbers[2] + 1e-6, "{id} at {distance_m} m of {drone}");
                ids.push(id);
            }
        }
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), covered, "each user once");
    }
}

#[test]
fn files_appear_and_geojson_can_be_read_back() {
    let bench = bench();
    let args = ["--users", "users.csv", "--drones", "3", "--out", "out", "--origin-lon-lat", "13.7,51"];
    let answer = json(&bench, &args);
    assert_eq!(bench.names("out"), ["place.geojson", "place.json", "place.svg", "sites.csv"]);
    let svg = fs::read_to_string(bench.path("out/place.svg")).unwrap();
    roxmltree::Document::parse(&svg).unwrap();
    assert_eq!(fs::read_to_string(bench.path("out/sites.csv")).unwrap().lines().count(), 4);
    let map: Value =
        serde_json::from_str(&fs::read_to_string(bench.path("out/place.geojson")).unwrap()).unwrap();
    let features = map["features"].as_array().unwrap();
    let kinds = |kind| features.iter().filter(|f| f["properties"]["kind"] == kind).count();
    assert_eq!((kinds("user"), kinds("drone"), kinds("coverage")), (15, 3, 3));
    // The users of the map alone: as many are served.
    let users: Vec<&Value> = features.iter().filter(|f| f["properties"]["kind"] == "user").collect();
    let users = serde_json::json!({ "type": "FeatureCollection", "features": users });
    let bench = bench.file("users.geojson", &users.to_string());
    let again = json(&bench, &["--users", "users.geojson", "--drones", "3"]);
    assert_eq!(
        (&again["covered"], &again["never_coverable"]),
        (&answer["covered"], &answer["never_coverable"])
    );
}

#[test]
fn threads_and_order_change_no_count() {
    let mut text = "id,x_m,y_m\n".to_owned();
    let mut rows: Vec<String> = (0..400u64)
        .map(|i| format!("u{i},{},{}\n", (i * 7919) % 6007, (i * i * 104_729 + 31 * i) % 5003))
        .collect();
    text.extend(rows.iter().map(String::as_str));
    rows.reverse();
    let reversed = "id,x_m,y_m\n".to_owned() + &rows.concat();
    let bench = Bench::of("place").file("a.csv", &text).file("b.csv", &reversed);
    let one = json(&bench, &["--users", "a.csv", "--drones", "5", "--threads", "1"]);
    let two = json(&bench, &["--users", "a.csv", "--drones", "5", "--threads", "2"]);
    let back = json(&bench, &["--users", "b.csv", "--drones", "5"]);
    assert_eq!(one["drones"], two["drones"]);
    assert_eq!((&one["covered"], &one["proved_optimal"]), (&back["covered"], &true.into()));
}

#[test]
fn nobody_is_no_fault() {
    let bench = Bench::of("place").file("none.csv", "id,x_m,y_m\n");
    let answer = json(&bench, &["--users", "none.csv", "--drones", "2"]);
    assert_eq!((&answer["covered"], &answer["upper_bound"]), (&0.into(), &0.into()));
    assert_eq!(answer["proved_optimal"], true);
}

#[test]
fn bad_input_is_refused_by_name() {
    let users = ["--users", "users.csv", "--drones", "2", "--radius-m", "500"];
    for (change, told) in [
        (("--drones", "0"), "--drones"),
        (("--drones", "1000000"), "--drones"),
        (("--drones", "-1"), "--drones"),
        (("--radius-m", "-5"), "--radius-m"),
        (("--radius-m", "nan"), "--radius-m"),
        (("--time-limit-s", "-1"), "--time-limit-s"),
        (("--method", "best"), "--method"),
    ] {
        let mut args: Vec<&str> = users.to_vec();
        match args.iter().position(|arg| *arg == change.0) {
            Some(at) => args[at + 1] = change.1,
            None => args.extend([change.0, change.1]),
        }
        let bench = bench();
        bench.refused(&[&args[..], &["--out", "out"]].concat(), &[told]);
    }
    for (text, told) in [
        ("", "line 1: found nothing, expected the header"),
        ("id,x_m\na,1\n", "line 1: found no column y_m"),
        ("id,x_m,y_m\na,1\n", "line 2: found 2 fields"),
        ("id,x_m,y_m\na,1,inf\n", "line 2, y_m: found \"inf\""),
        ("id,x_m,y_m,r_e_m\na,1,2,-3\n", "line 2, r_e_m: found \"-3\""),
        ("id,x_m,y_m\na,1,2\na,1,2\n", "line 3, id: found \"a\""),
    ] {
        let bench = Bench::of("place").file("users.csv", text);
        bench.refused(&[&users[..], &["--out", "out"]].concat(), &[told]);
    }
    bench().refused(&["--users", "no.csv", "--drones", "1", "--radius-m", "1"], &["no.csv: No such file"]);
}

/// Users as a mission of the paper's scenario located them, which README's example places drones for.
const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/located.csv");

#[test]
fn the_sample_is_placed_with_a_proof_and_drawn_as_in_the_documentation() {
    let bench = bench();
    let ran =
        bench.run(&["place", "--users", SAMPLE, "--drones", "6", "--radius-m", "500", "--out", "placed"]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stdout.contains("optimal        no placement serves more"), "{}", ran.stdout);
    let drawn = fs::read_to_string(bench.path("placed/place.svg")).unwrap().replace(SAMPLE, "located.csv");
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/place.svg");
    if std::env::var_os("SKYROOST_UPDATE_DOCS").is_some() {
        fs::write(page, &drawn).unwrap();
    }
    let shown = fs::read_to_string(page).unwrap();
    assert!(shown == drawn, "docs/place.svg is out of date: SKYROOST_UPDATE_DOCS=1 cargo test --test place");
}

#[test]
fn confidence_counts_whoever_is_likely_in_range() {
    let bench = bench();
    let sample = ["--users", SAMPLE, "--drones", "6"];
    let disks = json(&bench, &sample);
    let mut last = f64::INFINITY;
    for confidence in ["0.5", "0.8", "0.95", "0.999"] {
        let answer = json(&bench, &[&sample[..], &["--confidence", confidence]].concat());
        let number = |name: &str| answer[name].as_f64().unwrap();
        assert_eq!(answer["confidence"], confidence.parse::<f64>().unwrap());
        // The surer the fewer.
        assert!(number("value") <= last && number("value") <= number("upper_bound"), "{answer}");
        last = number("value");
        assert!(number("expected_served") >= number("value") * confidence.parse::<f64>().unwrap());
    }
    // Disks of 95 % radii ask for more than 95 %, for an error towards the drone does no harm.
    let likely = json(&bench, &[&sample[..], &["--confidence", "0.95"]].concat());
    assert!(likely["value"].as_f64() >= disks["value"].as_f64());
    let sure = 0.95 * disks["value"].as_f64().unwrap();
    assert!(disks["confidence"].is_null() && disks["expected_served"].as_f64().is_some_and(|x| x >= sure));
    for wrong in ["0", "1", "-0.5", "nan", "95"] {
        let ran = bench.run(&[&["place", "--radius-m", "500", "--confidence", wrong], &sample[..]].concat());
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""), "{wrong}");
        assert!(ran.stderr.contains("a probability above 0 and below 1"), "{}", ran.stderr);
    }
}

/// Users of a city, 2,000 for each square kilometre, within 1 GiB of address space.
#[test]
fn two_hundred_thousand_users_fit_into_a_gibibyte() {
    let mut table = "id,x_m,y_m\n".to_owned();
    // A lattice of irrational steps: spread as evenly as draws, and the same everywhere.
    for user in 0..200_000_u32 {
        let share = |step: f64| (f64::from(user) * step).fract() * 10_000.0;
        table +=
            &format!("u{user},{:.3},{:.3}\n", share(0.754_877_666_246_693), share(0.569_840_290_998_053));
    }
    let bench = bench().file("city.csv", &table);
    let args = [
        "place",
        "--users",
        "city.csv",
        "--drones",
        "3",
        "--radius-m",
        "491.4",
        "--time-limit-s",
        "5",
        "--json",
    ];
    let limited = "ulimit -v 1048576 && exec \"$0\" \"$@\"";
    let mut command = Command::new("sh");
    command.args(["-c", limited, env!("CARGO_BIN_EXE_skyroost")]).args(args).current_dir(bench.path("."));
    let ran = command.output().expect("a shell");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let answer: Value = serde_json::from_slice(&ran.stdout).unwrap();
    // 1,517 users on average in every disk.
    assert!(answer["covered"].as_u64().is_some_and(|covered| covered >= 3 * 1_517), "{}", answer["covered"]);
    assert!(answer["upper_bound"].as_f64() >= answer["value"].as_f64());
}
