//! What any bytes may be given to: every decoder and every reader of a file, each as a function of bytes.
//!
//! A target must not panic and must end, whatever the bytes; most hold what they find against a second way to it. [`drive`] mutates
//! seeds without looking at coverage, the same way on every machine: for every run of the checks, and for long runs by
//! `cargo xtask fuzz`. `tests/fuzz/` has the same targets for cargo-fuzz, which looks.

pub mod drive;
mod files;
mod links;
mod seeds;

/// What became of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// They are not what the target reads, and it said so.
    Refused,
    /// They are: what is made of them is worth changing further.
    Accepted,
}

impl Outcome {
    fn of(accepted: bool) -> Self {
        if accepted { Self::Accepted } else { Self::Refused }
    }
}

/// Something that reads bytes.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name.
    pub name: &'static str,
    /// Panics where the bytes break what must hold.
    pub run: fn(&[u8]) -> Outcome,
    /// Valid inputs to begin with.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// What text is made of; empty where the bytes are none.
    pub words: &'static [&'static str],
    /// Inputs tried in every run of the checks: some seconds of them.
    pub rounds: u32,
}

/// All of them.
pub const TARGETS: [Target; 27] = [
    links::target("frame", links::frame, seeds::frames, 600_000),
    links::target("body", links::body, seeds::bodies, 400_000),
    links::target("sealed", links::sealed, seeds::sealed_frames, 150_000),
    links::target("stream", links::stream, seeds::streams, 50_000),
    links::target("management", links::management, seeds::management_frames, 800_000),
    links::target("bus", links::bus_message, seeds::bus_messages, 500_000),
    links::target("lockstep", links::lockstep, seeds::lockstep_talks, 40_000),
    links::target("autopilot", links::autopilot_message, seeds::autopilot_messages, 400_000),
    links::target("inflight", links::inflight, seeds::autopilot_talks, 8_000),
    links::target("provision", links::provision, seeds::provisions, 400_000),
    links::target("agent", links::agent, seeds::agent_talks, 20_000),
    files::target("area-geojson", files::area_geojson, files::geojson_areas, files::JSON, 20_000),
    files::target("area-kml", files::area_kml, files::kml_areas, files::KML, 12_000),
    files::target("area-plan", files::area_plan, files::plan_areas, files::JSON, 15_000),
    files::target("area-csv", files::area_csv, files::csv_areas, files::CSV, 6_000),
    files::target("obstacles", files::obstacles, files::obstacle_files, files::JSON, 25_000),
    files::target("fence", files::fence, files::fences, files::JSON, 25_000),
    files::target("scenario", files::scenario, files::scenarios, files::TOML, 4_000),
    files::target("users", files::users, files::user_files, files::CSV, 8_000),
    files::target("captures", files::captures, files::capture_files, files::CSV, 15_000),
    files::target("located", files::located, files::located_files, files::CSV, 40_000),
    files::target("located-geojson", files::located_geojson, files::located_geojsons, files::JSON, 25_000),
    files::target("keys", files::keys, files::key_files, files::TOML, 40_000),
    files::target("campaign", files::campaign, files::campaigns, files::TOML, 15_000),
    files::target("manifest", files::manifest, files::manifests, files::JSON, 40_000),
    files::target("block", files::block, files::blocks, files::CSV, 6_000),
    files::target("encounter", files::encounter, files::encounters, files::JSON, 8_000),
];

/// The target of that name.
#[must_use]
pub fn target(name: &str) -> Option<&'static Target> {
    const ALL: &[Target] = &TARGETS;
    ALL.iter().find(|target| target.name == name)
}

/// Entry of cargo-fuzz: the target of that name gets the bytes.
///
/// # Panics
/// Where the target does, or there is none of that name.
pub fn given(name: &str, bytes: &[u8]) {
    let Some(target) = target(name) else { panic!("no target {name}") };
    (target.run)(bytes);
}
