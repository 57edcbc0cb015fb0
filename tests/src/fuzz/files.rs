//! Targets of what people give the command: readers of files.

use super::{Outcome, Target};
use skyroost_host_sim::{
    campaign::{
        Manifest, block as blocks_of,
        plan::{Plan, PlanOverrides},
    },
    control::{
        area::{Area, parse_fence, parse_obstacles},
        captures::Captures,
        keys::file::KeyFile,
        located::LocatedUsers,
    },
    encounter::{Encounter, Family, draw},
    geometry::frame::LocalFrame,
    scenario::LoadedScenario,
    world::users::parse_users,
};
use std::{path::Path, sync::OnceLock};
use xxhash_rust::xxh3::xxh3_128;

pub(super) const fn target(
    name: &'static str,
    run: fn(&[u8]) -> Outcome,
    seeds: fn() -> Vec<Vec<u8>>,
    words: &'static [&'static str],
    rounds: u32,
) -> Target {
    Target { name, run, seeds, words, rounds }
}

/// Of areas, plans, users and encounters in JSON.
pub(super) const JSON: &[&str] = &[
    "[",
    "]",
    "{",
    "}",
    ",",
    ":",
    "null",
    "true",
    "\"\"",
    "[]",
    "{}",
    "\"type\"",
    "\"Polygon\"",
    "\"Point\"",
    "\"MultiPolygon\"",
    "\"Feature\"",
    "\"FeatureCollection\"",
    "\"GeometryCollection\"",
    "\"geometries\"",
    "\"features\"",
    "\"coordinates\"",
    "\"geometry\"",
    "\"properties\"",
    "\"radius_m\":",
    "\"height_m\":",
    "\"polygon\"",
    "\"inclusion\"",
    "\"circles\"",
    "\"status\":\"ok\"",
    "\"id\":1",
    "\"cov_m2\":[[1,0],[0,1]]",
    "[13.7,51.0]",
    "[180,90]",
    "[-180,-90]",
];
pub(super) const KML: &[&str] = &[
    "<",
    ">",
    "</",
    "/>",
    "<!--",
    "]]>",
    "&amp;",
    "&#0;",
    "<Placemark>",
    "</Placemark>",
    "<Polygon>",
    "</Polygon>",
    "<MultiGeometry>",
    "</MultiGeometry>",
    "<outerBoundaryIs>",
    "<innerBoundaryIs>",
    "<LinearRing>",
    "<coordinates>",
    "</coordinates>",
    "13.7,51.0",
    "13.7,51.0,0 ",
    "<Folder>",
    "</Folder>",
    "<?xml version=\"1.0\"?>",
    "<!DOCTYPE a [<!ENTITY b \"c\">]>",
    "&b;",
];
pub(super) const CSV: &[&str] = &[
    ",", "\n", "\r\n", "\"", ";", "\t", "id", "x_m", "y_m", "r_e_m", "r95_m", "weight", "status", "ok", "u1",
    "\u{feff}",
];
pub(super) const TOML: &[&str] = &[
    "[",
    "]",
    "[[",
    "]]",
    "=",
    "\"",
    "'",
    "\"\"\"",
    "{",
    "}",
    ",",
    "\n",
    "#",
    "true",
    "false",
    "[fleet]",
    "[area]",
    "[link]",
    "[[losses]]",
    "[[partitions]]",
    "[[drone]]",
    "[campaign]",
    "[users]",
    "[limits]",
    "[srs]",
    "drones = 3",
    "id = 1",
    "at_s = 5",
    "1979-05-27T07:32:00Z",
    "inf",
    "nan",
    "0x7fffffff",
];

/// Read twice, the same comes of it: nothing depends on more than the bytes.
fn reads_alike<T: std::fmt::Debug, E: std::fmt::Display>(read: impl Fn() -> Result<T, E>) -> Outcome {
    let told = |found: Result<T, E>| {
        found.map_or_else(|error| Err(error.to_string()), |found| Ok(format!("{found:?}")))
    };
    let (once, again) = (told(read()), told(read()));
    assert_eq!(once, again);
    if let Err(told) = &once {
        assert!(!told.is_empty() && told.len() < 4_000, "a complaint of {} bytes", told.len());
    }
    Outcome::of(once.is_ok())
}

fn area(name: &str, bytes: &[u8]) -> Outcome {
    let read = || Area::parse(Path::new(name), bytes);
    if let Ok(area) = read() {
        let area_m2 = area.region.area_m2();
        assert!(area_m2.is_finite() && area_m2 > 0.0, "{area_m2} m2");
        assert!(area.region.bbox_m().iter().all(|corner| corner.iter().all(|m| m.is_finite())));
    }
    reads_alike(read)
}

pub(super) fn area_geojson(bytes: &[u8]) -> Outcome {
    area("a.geojson", bytes)
}

pub(super) fn area_kml(bytes: &[u8]) -> Outcome {
    area("a.kml", bytes)
}

pub(super) fn area_plan(bytes: &[u8]) -> Outcome {
    area("a.plan", bytes)
}

pub(super) fn area_csv(bytes: &[u8]) -> Outcome {
    area("a.csv", bytes)
}

/// Where the seeds are.
fn frame() -> LocalFrame {
    LocalFrame::new(13.75, 51.05)
}

pub(super) fn obstacles(bytes: &[u8]) -> Outcome {
    reads_alike(|| parse_obstacles(Path::new("o.geojson"), bytes, &frame()))
}

pub(super) fn fence(bytes: &[u8]) -> Outcome {
    let read = || parse_fence(Path::new("f.geojson"), bytes, &frame());
    if let Ok(fence) = read() {
        assert!(fence.first_reflex_m().is_none(), "a fence is convex");
    }
    reads_alike(read)
}

/// Text, as the command would have read it.
fn text(bytes: &[u8]) -> Option<&str> {
    str::from_utf8(bytes).ok()
}

pub(super) fn scenario(bytes: &[u8]) -> Outcome {
    let Some(text) = text(bytes) else { return Outcome::Refused };
    reads_alike(|| {
        let loaded = LoadedScenario::from_toml(text, "s.toml", Path::new("dir"))?;
        loaded.check().map(|()| loaded.scenario)
    })
}

pub(super) fn users(bytes: &[u8]) -> Outcome {
    reads_alike(|| parse_users(bytes, Path::new("users.csv")))
}

pub(super) fn captures(bytes: &[u8]) -> Outcome {
    let read = || Captures::parse(Path::new("captures.csv"), bytes);
    if let Ok(captures) = read() {
        for clocks_differ in [false, true] {
            let prepared = captures.prepare(clocks_differ);
            assert!(prepared.occasions.len() <= captures.count(), "no more occasions than captures");
        }
    }
    Outcome::of(read().is_ok())
}

pub(super) fn located(bytes: &[u8]) -> Outcome {
    reads_alike(|| LocatedUsers::parse(Path::new("located.csv"), bytes))
}

pub(super) fn located_geojson(bytes: &[u8]) -> Outcome {
    reads_alike(|| LocatedUsers::parse(Path::new("located.geojson"), bytes))
}

pub(super) fn keys(bytes: &[u8]) -> Outcome {
    let Some(text) = text(bytes) else { return Outcome::Refused };
    let path = Path::new("fleet.keys");
    match KeyFile::parse(path, text) {
        Ok(keys) => {
            let written = keys.text();
            let again = KeyFile::parse(path, &written).expect("what is written is read");
            assert_eq!(*again.text(), *written);
            Outcome::Accepted
        }
        Err(error) => {
            // A complaint goes to a terminal and into logs.
            let told = error.to_string();
            let mut pieces = (0..=KEY_DIGITS.len() - 8).map(|at| &KEY_DIGITS[at..at + 8]);
            assert!(!pieces.any(|piece| told.contains(piece)), "of a key is told: {told}");
            Outcome::Refused
        }
    }
}

fn plan(text: &str) -> Result<Plan, String> {
    Plan::from_toml(text, "plan.toml", PlanOverrides::default()).map_err(|error| error.to_string())
}

pub(super) fn campaign(bytes: &[u8]) -> Outcome {
    let Some(text) = text(bytes) else { return Outcome::Refused };
    if let Ok(plan) = plan(text) {
        let blocks = (0..plan.blocks()).filter_map(|block| plan.block(block));
        assert_eq!(
            blocks.map(|runs| runs.end - runs.start).sum::<u64>(),
            plan.runs(),
            "every run is in a block"
        );
    }
    reads_alike(|| plan(text))
}

pub(super) fn manifest(bytes: &[u8]) -> Outcome {
    let Some(text) = text(bytes) else { return Outcome::Refused };
    let path = Path::new("manifest.json");
    let Ok((found, _)) = Manifest::parse(path, text) else { return Outcome::Refused };
    let written = found.to_json();
    let (again, _) = Manifest::parse(path, &written).expect("what is written is read");
    assert_eq!(again.to_json(), written);
    Outcome::Accepted
}

fn small_campaign() -> &'static (Manifest, Plan) {
    static CAMPAIGN: OnceLock<(Manifest, Plan)> = OnceLock::new();
    CAMPAIGN.get_or_init(|| {
        let plan = plan(SMALL_CAMPAIGN).expect("a plan");
        (Manifest::of(&plan, SMALL_CAMPAIGN.to_owned()).expect("this program can be read"), plan)
    })
}

/// A block as it is, and its text with a checksum that holds: chance alone would never hit it.
pub(super) fn block(bytes: &[u8]) -> Outcome {
    let (manifest, plan) = small_campaign();
    let body = bytes.split(|byte| *byte == b'#').next().unwrap_or_default();
    let head = stamp();
    let mut summed = [head.as_bytes(), body].concat();
    summed.extend(format!("# xxh3 {:032x}\n", xxh3_128(&summed)).bytes());
    let mut accepted = false;
    for bytes in [bytes, &summed] {
        if let Ok(rows) = blocks_of::decode(manifest, plan, 0, bytes) {
            accepted = true;
            let written = blocks_of::encode(manifest, 0, &rows);
            let again = blocks_of::decode(manifest, plan, 0, written.as_bytes());
            assert_eq!(again.as_ref(), Ok(&rows), "what is written is read");
        }
    }
    Outcome::of(accepted)
}

pub(super) fn encounter(bytes: &[u8]) -> Outcome {
    let Ok(encounter) = serde_json::from_slice::<Encounter>(bytes) else { return Outcome::Refused };
    reads_alike(|| encounter.check())
}

// ---------------------------------------------------------------------------------------------------------------------
// Seeds.

fn bytes(texts: &[&str]) -> Vec<Vec<u8>> {
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

/// The first lines of a file in the repository.
fn first_lines(text: &str, count: usize) -> String {
    text.lines().take(count).map(|line| format!("{line}\n")).collect()
}

const DRESDEN: &str = include_str!("../../../host-sim/scenarios/dresden-elbe.geojson");
const RING: &str = "[[13.70,51.00],[13.80,51.00],[13.80,51.10],[13.70,51.10],[13.70,51.00]]";
const HOLE: &str = "[[13.74,51.04],[13.76,51.04],[13.76,51.06],[13.74,51.06],[13.74,51.04]]";

fn feature(geometry: &str, properties: &str) -> String {
    format!(r#"{{"type":"Feature","properties":{{{properties}}},"geometry":{geometry}}}"#)
}

fn collection(features: &[String]) -> String {
    format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(","))
}

fn polygon(rings: &str) -> String {
    format!(r#"{{"type":"Polygon","coordinates":[{rings}]}}"#)
}

pub(super) fn geojson_areas() -> Vec<Vec<u8>> {
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING},{HOLE}]]}}"#);
    let one = collection(&[feature(&polygon(HOLE), "\"name\":\"a\"")]);
    bytes(&[DRESDEN, &multi, &one, &polygon(&format!("{RING},{HOLE}"))])
}

pub(super) fn kml_areas() -> Vec<Vec<u8>> {
    let ring = |at: &str| format!("<LinearRing><coordinates>{at}</coordinates></LinearRing>");
    let outer = ring("13.70,51.00,0 13.80,51.00,0 13.80,51.10,0 13.70,51.10,0 13.70,51.00,0");
    let hole = ring("13.74,51.04 13.76,51.04 13.76,51.06 13.74,51.04");
    let polygon = format!(
        "<Polygon><outerBoundaryIs>{outer}</outerBoundaryIs><innerBoundaryIs>{hole}</innerBoundaryIs></Polygon>"
    );
    let file = |inside: &str| {
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>\
             <name>a &amp; b</name><Placemark>{inside}</Placemark></Document></kml>\n"
        )
    };
    bytes(&[&file(&polygon), &file(&format!("<MultiGeometry>{polygon}</MultiGeometry>"))])
}

pub(super) fn plan_areas() -> Vec<Vec<u8>> {
    let file = |items: &str, polygons: &str| {
        format!(
            r#"{{"fileType":"Plan","version":1,"groundStation":"QGroundControl","geoFence":{{"circles":[
            {{"circle":{{"center":[51.05,13.75],"radius":90}},"inclusion":false,"version":1}}],
            "polygons":[{polygons}],"version":2}},"mission":{{"items":[{{"type":"SimpleItem","command":22,
            "params":[0,null]}}{items}],"version":2}},"rallyPoints":{{"points":[],"version":2}}}}"#
        )
    };
    let ring = "[[51.00,13.70],[51.00,13.80],[51.10,13.80],[51.10,13.70]]";
    let fence = format!(r#"{{"inclusion":true,"polygon":{ring},"version":1}}"#);
    let survey = format!(r#",{{"type":"ComplexItem","complexItemType":"survey","polygon":{ring}}}"#);
    bytes(&[&file("", &fence), &file(&survey, "")])
}

pub(super) fn csv_areas() -> Vec<Vec<u8>> {
    bytes(&[
        "x_m,y_m\n0,0\n5000,0\n5000.5,4000\n2500,6e3\n0,4000\n0,0\n",
        "x_m,y_m\r\n0,0\r\n10,0\r\n0,10\r\n",
    ])
}

pub(super) fn obstacle_files() -> Vec<Vec<u8>> {
    let mast = r#"{"type":"Point","coordinates":[13.75,51.05]}"#;
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING}],[{HOLE}]]}}"#);
    bytes(&[
        &collection(&[
            feature(&polygon(HOLE), "\"name\":\"hall\",\"height_m\":40"),
            feature(mast, "\"radius_m\":20"),
        ]),
        &collection(&[feature(&multi, "\"height_m\":12.5")]),
    ])
}

pub(super) fn fences() -> Vec<Vec<u8>> {
    bytes(&[&collection(&[feature(&polygon(RING), "")]), &feature(&polygon(HOLE), "\"name\":\"yard\"")])
}

const SCENARIO: &str = r#"name = "two"
seed = 5
[fleet]
drones = 6
pads_m = [[0, 0], [50, 0], [100, 0], [0, 900], [50, 900], [100, 900]]
[link]
loss_fraction = 0.1
burst_every_s = 60
burst_s = 0.5
[[partitions]]
drones = [1]
from_s = 10
until_s = 18
[[losses]]
drone = 2
at_s = 900
[limits]
located_fraction_min = 0.99
"#;

pub(super) fn scenarios() -> Vec<Vec<u8>> {
    bytes(&[
        include_str!("../../../host-sim/scenarios/paper.toml"),
        include_str!("../../../host-sim/scenarios/dresden-elbe.toml"),
        SCENARIO,
    ])
}

pub(super) fn user_files() -> Vec<Vec<u8>> {
    bytes(&[
        "id,x_m,y_m\na,1,2\nb,3.5,-4e2\n",
        "x_m,y_m\n1,2\n3,4\n",
        "id,x_m,y_m,r_e_m\na,1,2,30\nb,3,4,0\n",
    ])
}

pub(super) fn capture_files() -> Vec<Vec<u8>> {
    bytes(&[&first_lines(include_str!("../../../host-sim/scenarios/captures.csv"), 16)])
}

pub(super) fn located_files() -> Vec<Vec<u8>> {
    let found = first_lines(include_str!("../../../host-sim/scenarios/located.csv"), 12);
    bytes(&[&found, "id,x_m,y_m,r_e_m,weight\na,1,2,30,1\nb,3,4,0,2.5\n", "id,x_m,y_m\na,1,2\n"])
}

pub(super) fn located_geojsons() -> Vec<Vec<u8>> {
    let user = |at: &str, more: &str| feature(&format!(r#"{{"type":"Point","coordinates":{at}}}"#), more);
    bytes(&[&collection(&[
        user("[13.75,51.05]", "\"id\":\"a\",\"status\":\"ok\",\"r95_m\":9,\"cov_m2\":[[9,1],[1,8]]"),
        user("[13.76,51.05,3]", "\"id\":\"b\",\"r_e_m\":30,\"weight\":2"),
        user("[13.77,51.05]", "\"id\":\"c\",\"status\":\"ambiguous\""),
    ])])
}

const KEY_DIGITS: &str = "d41d8cd98f00b204e9800998ecf8427ee3b0c44298fc1c149afbf4c8996fb924";

pub(super) fn key_files() -> Vec<Vec<u8>> {
    let drone = |id: u32, more: &str| format!("\n[[drone]]\nid = {id}\nkey = \"{KEY_DIGITS}\"\n{more}");
    let head = "# Whoever reads this file can command the drones. Made by `skyroost keys`.\nformat = 1\ncontrol_boots = 7\n";
    bytes(&[&format!("{head}{}{}", drone(1, ""), drone(2, "exported = true\n")), head])
}

const SMALL_CAMPAIGN: &str = "[campaign]\nfidelity = \"paper\"\nbase_seed = 1\nseeds = 2\ndensities_per_km2 = [1, 2]\n\
                              r_e_m = [30.0]\nmethods = [\"proposed\"]\nblock_runs = 3\n[fleet]\ndrones = 3\n";

pub(super) fn campaigns() -> Vec<Vec<u8>> {
    bytes(&[
        SMALL_CAMPAIGN,
        include_str!("../../../host-sim/scenarios/figure6.toml"),
        include_str!("../../../host-sim/scenarios/figure7.toml"),
    ])
}

pub(super) fn manifests() -> Vec<Vec<u8>> {
    bytes(&[&small_campaign().0.to_json()])
}

fn small_block() -> String {
    let (manifest, plan) = small_campaign();
    let runs = plan.block(0).into_iter().flatten().filter_map(|run| plan.run(run));
    let rows =
        runs.flat_map(|run| plan.campaign.methods.iter().map(move |&method| run.row(method, 90, [40, 41])));
    blocks_of::encode(manifest, 0, &rows.collect::<Vec<_>>())
}

/// The first two lines of a block: what it is part of, and its columns.
fn stamp() -> &'static str {
    static STAMP: OnceLock<String> = OnceLock::new();
    STAMP.get_or_init(|| first_lines(&small_block(), 2))
}

pub(super) fn blocks() -> Vec<Vec<u8>> {
    let whole = small_block();
    let rows: String =
        whole.lines().skip(2).filter(|line| !line.starts_with('#')).map(|line| format!("{line}\n")).collect();
    bytes(&[&whole, &rows])
}

pub(super) fn encounters() -> Vec<Vec<u8>> {
    let of = |family, count| serde_json::to_vec(&draw(family, count, 1)).expect("plain data");
    vec![
        of(Family::Crossing, 2),
        of(Family::Intruder, 3),
        br#"{"vehicles":[{"id":1,"pos_m":[0,0,50],"goal_m":[90,0,50]}]}"#.to_vec(),
    ]
}
