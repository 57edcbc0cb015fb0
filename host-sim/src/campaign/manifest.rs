//! What a campaign's directory says of itself: the plan, what it hashes to, and which program is to run it.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_128;

use super::files::{self, FileError};
use super::plan::{Fidelity, Method, Plan, PlanOverrides};

/// The file.
pub(super) const FILE: &str = "manifest.json";
/// Raised whenever a block of an older format would be read wrongly.
const FORMAT: u32 = 1;

/// A campaign as it was planned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Format of manifest and blocks.
    pub format: u32,
    /// The scenario's name.
    pub name: String,
    /// How runs come about.
    pub fidelity: Fidelity,
    /// The seed that all chance comes from.
    pub base_seed: u64,
    /// What is compared in each run.
    pub methods: Vec<Method>,
    /// Runs in all.
    pub runs: u64,
    /// Hash over everything that the plan says, however its text looks.
    pub scenario_hash: String,
    /// Hash over the program's file: blocks of different programs are not mixed.
    pub program_hash: String,
    /// Its version, for people.
    pub program_version: String,
    /// The blocks.
    pub blocks: Vec<PlannedBlock>,
    /// The plan's text.
    pub plan_toml: String,
}

/// One block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedBlock {
    /// Its number, from 0.
    pub block: u64,
    /// Its first run.
    pub first_run: u64,
    /// How many it has.
    pub runs: u64,
}

/// What is wrong with a manifest.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// It is not there.
    #[error("{}: found no such file, expected the manifest that `skyroost campaign plan` writes", path.display())]
    Missing {
        /// Where it should be.
        path: PathBuf,
    },
    /// It is no manifest.
    #[error("{}: {error}; expected the manifest that `skyroost campaign plan` writes", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        error: serde_json::Error,
    },
    /// A field is not what the rest, or this program, makes it.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field.
        field: &'static str,
        /// What it holds.
        found: String,
        /// What it should hold, and what to do.
        expected: String,
    },
}

impl Manifest {
    /// Of a plan, to be run by this program.
    ///
    /// # Errors
    /// [`FileError`] where this program cannot be read.
    pub fn of(plan: &Plan, plan_toml: String) -> Result<Self, FileError> {
        let block = |block: u64| {
            let runs = plan.block(block)?;
            Some(PlannedBlock { block, first_run: runs.start, runs: runs.end - runs.start })
        };
        Ok(Self {
            format: FORMAT,
            name: plan.scenario.name.clone(),
            fidelity: plan.campaign.fidelity,
            base_seed: plan.campaign.base_seed,
            methods: plan.campaign.methods.clone(),
            runs: plan.runs(),
            scenario_hash: scenario_hash(plan),
            program_hash: program_hash()?,
            program_version: env!("CARGO_PKG_VERSION").to_owned(),
            blocks: (0..plan.blocks()).filter_map(block).collect(),
            plan_toml,
        })
    }

    /// Reads a manifest and the plan in it, and holds one against the other.
    pub(super) fn read(dir: &Path) -> Result<(Self, Plan), super::CampaignError> {
        let path = dir.join(FILE);
        let text = match fs::read_to_string(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(ManifestError::Missing { path }.into());
            }
            read => read.map_err(files::failed(&path, "read"))?,
        };
        Self::parse(&path, &text)
    }

    /// Reads the text of the manifest at `path` and the plan in it, and holds one against the other.
    ///
    /// # Errors
    /// [`ManifestError`], and what is wrong with the plan.
    pub fn parse(path: &Path, text: &str) -> Result<(Self, Plan), super::CampaignError> {
        let manifest: Self = serde_json::from_str(text)
            .map_err(|error| ManifestError::Json { path: path.to_owned(), error })?;
        let field = |field, found: String, expected: String| ManifestError::Field {
            path: path.to_owned(),
            field,
            found,
            expected,
        };
        if manifest.format != FORMAT {
            return Err(field("format", manifest.format.to_string(), FORMAT.to_string()).into());
        }
        let name = format!("{}: plan_toml", path.display());
        let plan = Plan::from_toml(&manifest.plan_toml, &name, manifest.overrides())?;
        let expected = Self {
            program_hash: manifest.program_hash.clone(),
            program_version: manifest.program_version.clone(),
            ..Self::of(&plan, manifest.plan_toml.clone())?
        };
        if manifest.scenario_hash != expected.scenario_hash {
            let expected = format!("{}, the hash of plan_toml; plan anew", expected.scenario_hash);
            return Err(field("scenario_hash", manifest.scenario_hash, expected).into());
        }
        if manifest != expected {
            let expected = "what plan_toml says; plan anew".to_owned();
            return Err(field("blocks", "other blocks, runs, methods or seeds".to_owned(), expected).into());
        }
        Ok((manifest, plan))
    }

    /// What the command line may have replaced when it was planned.
    fn overrides(&self) -> PlanOverrides {
        PlanOverrides { fidelity: Some(self.fidelity), base_seed: Some(self.base_seed) }
    }

    /// Refuses to run blocks that another program has planned.
    pub(super) fn check_program(&self, dir: &Path) -> Result<(), super::CampaignError> {
        let own = program_hash()?;
        if self.program_hash == own {
            return Ok(());
        }
        let (path, found) = (dir.join(FILE), self.program_hash.clone());
        let expected =
            format!("{own}, the hash of this program; run the program that planned it, or plan anew");
        Err(ManifestError::Field { path, field: "program_hash", found, expected }.into())
    }

    /// As the file holds it.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Plain data with names for keys: there is nothing in it that JSON could not say.
        serde_json::to_string_pretty(self).map_or_else(|_| String::new(), |text| text + "\n")
    }
}

/// Over every value, those that the text leaves to their defaults as well.
fn scenario_hash(plan: &Plan) -> String {
    let text = serde_json::to_string(plan).unwrap_or_default();
    hash(text.as_bytes())
}

/// Over the file of this program; read once.
fn program_hash() -> Result<String, FileError> {
    static HASH: OnceLock<String> = OnceLock::new();
    if let Some(hash) = HASH.get() {
        return Ok(hash.clone());
    }
    let path = std::env::current_exe().map_err(files::failed(Path::new("this program"), "found"))?;
    let bytes = fs::read(&path).map_err(files::failed(&path, "read"))?;
    Ok(HASH.get_or_init(|| hash(&bytes)).clone())
}

/// The hash of all hashes of a campaign.
pub(super) fn hash(bytes: &[u8]) -> String {
    format!("{:032x}", xxh3_128(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOML: &str = "[campaign]\nseeds = 5\ndensities_per_km2 = [1, 2]\nblock_runs = 3\n";

    fn plan(text: &str) -> Plan {
        Plan::from_toml(text, "plan.toml", PlanOverrides::default()).unwrap()
    }

    #[test]
    fn the_hash_is_of_what_is_said_and_not_of_how() {
        let hash = |text: &str| scenario_hash(&plan(text));
        let same = "# a word\n[campaign]\ndensities_per_km2 = [1.0, 2.0]\nseeds=5\nblock_runs=3\nr_e_m = [30]\n[fleet]\ndrones = 6";
        assert_eq!(hash(TOML), hash(same));
        for other in ["seeds = 6", "seeds = 5\nbase_seed = 2", "seeds = 5\nr_e_m = [29.0]"] {
            assert_ne!(hash(TOML), hash(&TOML.replace("seeds = 5", other)), "{other}");
        }
        assert_ne!(hash(TOML), hash(&format!("{TOML}[fleet]\nspeed_mps = 11\n")));
    }

    #[test]
    fn what_is_written_is_read_and_what_was_changed_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let manifest = Manifest::of(&plan(TOML), TOML.to_owned()).unwrap();
        let path = dir.path().join(FILE);
        let read = |text: &str| {
            fs::write(&path, text).unwrap();
            Manifest::read(dir.path()).map_err(|error| error.to_string())
        };
        let text = manifest.to_json();
        let (found, found_plan) = read(&text).unwrap();
        assert_eq!((&found, found_plan), (&manifest, plan(TOML)));
        assert_eq!(manifest.blocks.last(), Some(&PlannedBlock { block: 3, first_run: 9, runs: 1 }));
        found.check_program(dir.path()).unwrap();
        let other = Manifest { program_hash: "0".to_owned(), ..found };
        assert!(other.check_program(dir.path()).unwrap_err().to_string().contains("program_hash: found 0"));
        for (from, to, told) in [
            ("\"format\": 1", "\"format\": 2", "format: found 2, expected 1"),
            ("seeds = 5", "seeds = 6", "scenario_hash"),
            ("\"first_run\": 9", "\"first_run\": 8", "blocks"),
            ("\"base_seed\": 1", "\"base_seed\": 2", "scenario_hash"),
            ("\"name\"", "\"nom\"", "missing field `name`"),
            ("seeds = 5", "sedes = 5", "plan_toml:2: campaign.sedes: found an unknown key"),
        ] {
            let error = read(&text.replace(from, to)).unwrap_err();
            assert!(error.contains(told), "{told:?} is not in: {error}");
        }
        fs::remove_file(&path).unwrap();
        let error = Manifest::read(dir.path()).unwrap_err().to_string();
        assert!(error.contains("manifest.json: found no such file"), "{error}");
    }
}
