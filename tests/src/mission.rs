//! Runs the `skyroost` command as a user would and reads what it leaves.

use serde_json::Value;
use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::OnceLock,
};
use tempfile::TempDir;

/// A run of `skyroost mission` that came to its end.
pub struct Flown {
    /// What it printed on stdout.
    pub json: Value,
    /// The same as bytes.
    pub bytes: Vec<u8>,
    /// The exit status.
    pub code: i32,
    /// The command that does the same again.
    pub replay: String,
    /// The directory with its results; gone with this value.
    pub out: TempDir,
}

/// The optimised `skyroost`: the one that `SKYROOST_BIN` names, or else built now.
///
/// # Panics
/// When it cannot be built.
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| {
        if let Some(named) = std::env::var_os("SKYROOST_BIN") {
            return PathBuf::from(named);
        }
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let build = ["build", "--release", "--locked", "--package", "skyroost-host-sim"];
        let status = Command::new(cargo).current_dir(root).args(build).status().expect("cargo runs");
        assert!(status.success(), "the optimised skyroost does not build");
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
        target.join("release").join("skyroost")
    })
}

/// Runs `skyroost mission --json` with further words.
///
/// # Panics
/// When it cannot be started, or dies of a signal.
#[must_use]
pub fn run(words: &[&str]) -> (Output, TempDir) {
    let out = TempDir::new().expect("a temporary directory");
    let mut command = Command::new(binary());
    command.arg("mission").args(words).args(["--json", "--quiet", "--out"]).arg(out.path().join("out"));
    (command.output().expect("skyroost starts"), out)
}

/// Flies a mission to its end.
///
/// # Panics
/// When it ends with anything but a verdict (status 0 or 1), naming the command that replays it.
#[must_use]
pub fn fly(words: &[&str]) -> Flown {
    let replay = format!("cargo run --release -- mission {}", words.join(" "));
    let (output, out) = run(words);
    let code = output.status.code().expect("an exit status");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(code, 0 | 1), "exit status {code}: {errors}\nreplay: {replay}");
    let json = serde_json::from_slice(&output.stdout).expect("one JSON object on stdout");
    Flown { json, bytes: output.stdout, code, replay, out }
}

impl Flown {
    /// A number of the result by its JSON pointer.
    ///
    /// # Panics
    /// When there is none.
    pub fn number(&self, pointer: &str) -> f64 {
        let value = self.json.pointer(pointer).and_then(Value::as_f64);
        value.unwrap_or_else(|| panic!("no number at {pointer}\nreplay: {}", self.replay))
    }

    /// Holds every figure that a mission promises against its limit, and reports all that fail.
    ///
    /// # Panics
    /// When one fails, naming the command that replays it.
    pub fn assert_accepted(&self) {
        let located = self.number("/localization/located") / self.number("/localization/users");
        let checks = [
            ("coverage_fraction", self.number("/sweep/coverage_fraction"), 1.0 - 1e-9, f64::INFINITY),
            ("located fraction", located, 0.99, 1.0),
            ("in_r95_fraction", self.number("/localization/in_r95_fraction"), 0.9, 1.0),
            ("r95_median_m", self.number("/localization/r95_median_m"), 0.0, 15.0),
            ("crlb_ratio", self.number("/localization/crlb_ratio"), 0.5, 1.25),
            ("violations", self.number("/safety/violations"), 0.0, 0.0),
            ("min_separation_m", self.number("/safety/min_separation_m"), 10.0, f64::INFINITY),
            ("formation_error_rms_m", self.number("/safety/formation_error_rms_m"), 0.0, 1.0),
            ("formation_error_max_m", self.number("/safety/formation_error_max_m"), 0.0, 5.0),
            ("served_ratio", self.number("/placement/served_ratio"), 0.96, f64::INFINITY),
            ("frames", self.number("/link/frames"), 1.0, f64::INFINITY),
            ("rejected frames", self.number("/link/rejected"), 0.0, 0.0),
        ];
        let failed: Vec<String> = checks
            .iter()
            .filter(|(_, found, least, most)| !(least <= found && found <= most))
            .map(|(name, found, least, most)| format!("{name} {found}, expected {least} to {most}"))
            .collect();
        assert!(failed.is_empty(), "{}\nreplay: {}", failed.join("\n"), self.replay);
    }
}
