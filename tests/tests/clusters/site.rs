//! A campaign that is to be run on a cluster, beside the same one that one process has run; nothing that was
//! started here outlives it.

use std::{
    fs,
    path::PathBuf,
    process::{Command, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
    thread::sleep,
    time::{Duration, Instant},
};

use rustix::process::Signal;
use serde_json::Value;
use skyroost_tests::{mission::binary, processes};
use tempfile::TempDir;

/// Twelve blocks, each long enough to be caught at work.
const PLAN: &str = "[campaign]\nseeds = 24\ndensities_per_km2 = [5, 20]\nmethods = [\"proposed\", \"random\"]\n\
                    block_runs = 4\n";
/// Nothing here takes nearly as long; only a failure waits so.
const PATIENCE: Duration = Duration::from_secs(120);

/// A folder with the program, a plan and its results by one process; `shared` is where a cluster puts its own.
pub(crate) struct Site {
    dir: TempDir,
    replay: String,
    /// Clusters take turns: each wants all cores.
    _turn: MutexGuard<'static, ()>,
}

/// A process that stands still in the middle of a block.
#[derive(Debug)]
pub(crate) struct Halted {
    pub(crate) process: u32,
    pub(crate) parent: u32,
    pub(crate) block: u64,
}

impl Site {
    /// For the test of this name.
    pub(crate) fn of(test: &str) -> Self {
        static TURN: Mutex<()> = Mutex::new(());
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let dir = TempDir::with_prefix("skyroost-").expect("a temporary folder");
        let replay = format!("cargo test --package skyroost-tests --test clusters {test}");
        let site = Self { dir, replay, _turn: turn };
        fs::create_dir(site.path("bin")).expect("a folder");
        std::os::unix::fs::symlink(binary(), site.path("bin/skyroost")).expect("a link");
        fs::write(site.path("plan.toml"), PLAN).expect("a plan");
        site.shell("skyroost campaign plan plan.toml --out alone");
        site.shell("skyroost campaign run --dir alone && skyroost campaign merge --dir alone");
        site
    }

    /// Of something in the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A program in the folder, not yet started. It and all that it starts can be told by their `TMPDIR`.
    pub(crate) fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        // Daemons are in /usr/sbin, which not everybody searches.
        let search = std::env::var("PATH").unwrap_or_default();
        let search = format!("{}:{search}:/usr/sbin", self.path("bin").display());
        command.current_dir(self.dir.path()).stdin(Stdio::null()).env("PATH", search);
        command
            .env("TMPDIR", self.dir.path())
            .env("SLURM_CONF", self.path("slurm.conf"))
            .env_remove("SKYROOST");
        command
    }

    /// Runs a line as somebody would type it, which must succeed, and tells what it prints.
    #[track_caller]
    pub(crate) fn shell(&self, line: &str) -> String {
        let ran = self.command("bash").args(["-c", line]).output().expect("bash runs");
        let [told, failed] =
            [&ran.stdout, &ran.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
        assert!(ran.status.success(), "`{line}`: {}: {failed}\nreplay: {}", ran.status, self.replay);
        told
    }

    /// Waits until `seen` has something to show.
    #[track_caller]
    pub(crate) fn wait_for<T>(&self, what: &str, mut seen: impl FnMut() -> Option<T>) -> T {
        let begun = Instant::now();
        loop {
            if let Some(seen) = seen() {
                return seen;
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain for {what}\nreplay: {}", self.replay);
            sleep(Duration::from_millis(5));
        }
    }

    /// Halts some process that is surely in the middle of a block, once `after` blocks are done; where machines have
    /// names, one of this machine.
    #[track_caller]
    pub(crate) fn halt_a_block(&self, machine: Option<&str>, after: usize) -> Halted {
        let is_block = |entry: &fs::DirEntry| entry.file_name().to_string_lossy().ends_with(".csv");
        let blocks = || fs::read_dir(self.path("shared/blocks")).into_iter().flatten().flatten();
        let done = || blocks().filter(is_block).count();
        self.wait_for("blocks that are done", || (done() >= after).then_some(()));
        self.wait_for("a block at work", || {
            self.processes(machine).into_iter().find_map(|process| {
                let words = processes::words(process);
                let block = words.get(words.iter().position(|word| word == "--block")? + 1)?.parse().ok()?;
                let halted = Halted { process, parent: processes::state(process)?.1, block };
                self.halts(&halted).then_some(halted)
            })
        })
    }

    /// Whether a process stands still before its block is done; otherwise it may go on.
    fn halts(&self, Halted { process, block, .. }: &Halted) -> bool {
        if !processes::try_signal(*process, Signal::STOP) {
            return false;
        }
        let still = self.wait_for("a process that halts", || match processes::state(*process) {
            Some(('T', _)) => Some(true),
            Some(('Z' | 'X', _)) | None => Some(false),
            Some(_) => None,
        });
        let in_the_middle = still && !self.path(&format!("shared/blocks/{block:05}.csv")).exists();
        if !in_the_middle {
            let _ = processes::try_signal(*process, Signal::CONT);
        }
        in_the_middle
    }

    /// All processes of this test, or the daemon and the tasks on one of its machines.
    pub(crate) fn processes(&self, machine: Option<&str>) -> Vec<u32> {
        let mut variables = vec![format!("TMPDIR={}", self.dir.path().display())];
        variables.extend(machine.map(|name| format!("SLURMD_NODENAME={name}")));
        processes::bearing(&variables.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// Which blocks are left to do.
    #[track_caller]
    pub(crate) fn missing(&self) -> Vec<u64> {
        let told = self.shell("skyroost campaign missing --dir shared --json || [ $? = 5 ]");
        let told: Value = serde_json::from_str(&told).expect("one JSON object");
        assert_eq!(
            told["corrupted"],
            serde_json::json!([]),
            "a kill damages nothing\nreplay: {}",
            self.replay
        );
        told["missing"].as_array().expect("a list").iter().filter_map(Value::as_u64).collect()
    }

    /// The merged files are those of one process.
    #[track_caller]
    pub(crate) fn assert_same_results(&self) {
        for name in ["results.csv", "results.parquet"] {
            let [alone, shared] = ["alone", "shared"].map(|dir| fs::read(self.path(dir).join(name)));
            let same = alone.expect("results of one process") == shared.expect("results of the cluster");
            assert!(same, "{name} differs from that of one process\nreplay: {}", self.replay);
        }
    }

    /// How to run the test again.
    pub(crate) fn replay(&self) -> &str {
        &self.replay
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        if std::thread::panicking() {
            // All logs are gone with the folder; what is of use is at their ends.
            for entry in fs::read_dir(self.dir.path()).into_iter().flatten().flatten() {
                let name = entry.file_name().to_string_lossy().into_owned();
                if name.ends_with(".log") {
                    let log = fs::read(entry.path()).unwrap_or_default();
                    let log = String::from_utf8_lossy(&log).into_owned();
                    let end: Vec<&str> = log.lines().rev().take(20).collect();
                    eprintln!("--- {name}\n{}", end.into_iter().rev().collect::<Vec<_>>().join("\n"));
                }
            }
        }
        // Whoever is told to end may start something while ending.
        let begun = Instant::now();
        loop {
            let left = self.processes(None);
            if left.is_empty() {
                break;
            }
            for process in &left {
                let _ = processes::try_signal(*process, Signal::KILL);
            }
            if begun.elapsed() > Duration::from_secs(5) {
                break; // a process that stays is no reason to wait for ever
            }
            sleep(Duration::from_millis(10));
        }
    }
}
