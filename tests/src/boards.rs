//! Runs `skyroost mission --backend qemu` as something that can be watched, hurt and looked after: its processes,
//! its folders and how it ends.

use crate::{mission::binary, processes};
use rustix::process::Signal;
use std::{
    fs::{self, File},
    io::Read,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Mutex, MutexGuard, OnceLock, PoisonError},
    time::{Duration, Instant},
};
use tempfile::TempDir;

/// A failure must have been told by then.
pub const TOLD_WITHIN: Duration = Duration::from_secs(5);
/// Nothing that these tests start takes longer.
const PATIENCE: Duration = Duration::from_secs(120);

/// The image of the emulated board: the one that `SKYROOST_BOARD_IMAGE` names, or else built now.
///
/// # Panics
/// When it cannot be built.
pub fn image() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| {
        if let Some(named) = std::env::var_os("SKYROOST_BOARD_IMAGE") {
            return PathBuf::from(named);
        }
        let root = workspace();
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let build = ["xtask", "firmware", "--board", "emulated"];
        let status = Command::new(cargo).current_dir(&root).args(build).status().expect("cargo runs");
        assert!(status.success(), "the image of the emulated board does not build");
        root.join("target/cross/thumbv7em-none-eabihf/release/emulated")
    })
}

/// The root of the workspace.
///
/// # Panics
/// Never where this crate lies in its workspace.
#[must_use]
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_owned()
}

/// Room for one run: its folder for temporary files, where its results go, and a folder that is searched for
/// programs first.
pub struct Site {
    dir: TempDir,
    /// Runs with emulators take turns: each has a time to keep, and takes all cores by itself.
    _turn: MutexGuard<'static, ()>,
}

impl Default for Site {
    fn default() -> Self {
        Self::new()
    }
}

impl Site {
    /// Waits for its turn and makes the folders.
    ///
    /// # Panics
    /// When there is no room for them.
    #[must_use]
    pub fn new() -> Self {
        static TURN: Mutex<()> = Mutex::new(());
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let dir = TempDir::new().expect("a temporary folder");
        for name in ["tmp", "bin"] {
            fs::create_dir(dir.path().join(name)).expect("a folder");
        }
        Self { dir, _turn: turn }
    }

    /// A path in its folder.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Makes a program that is found before any other of its name.
    ///
    /// # Panics
    /// When it cannot be written.
    pub fn program(&self, name: &str, script: &str) {
        use std::os::unix::fs::PermissionsExt;
        let path = self.path("bin").join(name);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).expect("a script");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("a program");
    }

    /// Starts a mission on emulated boards, with further words.
    ///
    /// # Panics
    /// When it does not start.
    #[must_use]
    pub fn start(&self, words: &[&str]) -> Running<'_> {
        self.start_with(words, |_| {})
    }

    /// Starts a mission on emulated boards, with further words and whatever `change` does to the command.
    ///
    /// # Panics
    /// When it does not start.
    #[must_use]
    pub fn start_with(&self, words: &[&str], change: impl FnOnce(&mut Command)) -> Running<'_> {
        let search = std::env::var("PATH").unwrap_or_default();
        let mut command = Command::new(binary());
        command.args(["mission", "--backend", "qemu", "--json", "--quiet"]);
        if !words.contains(&"--board-image") {
            command.arg("--board-image").arg(image());
        }
        command.args(words).arg("--out").arg(self.path("out"));
        command
            .env("TMPDIR", self.path("tmp"))
            .env("PATH", format!("{}:{search}", self.path("bin").display()));
        // Files, so that nobody has to read along.
        let sink = |name| File::create(self.path(name)).expect("a file");
        command.stdin(Stdio::null()).stdout(sink("stdout")).stderr(sink("stderr"));
        change(&mut command);
        Running { site: self, child: command.spawn().expect("skyroost starts") }
    }

    fn text(&self, name: &str) -> String {
        let mut text = String::new();
        File::open(self.path(name)).and_then(|mut file| file.read_to_string(&mut text)).expect("UTF-8");
        text
    }

    /// Ids of all processes that run here, whoever their parent is by now: they have its folder for temporary files
    /// in their environment.
    ///
    /// # Panics
    /// When `/proc` cannot be read.
    #[must_use]
    pub fn processes(&self) -> Vec<u32> {
        processes::bearing(&[&format!("TMPDIR={}", self.path("tmp").display())])
    }

    /// What lies in its folder for temporary files.
    ///
    /// # Panics
    /// When that is gone.
    #[must_use]
    pub fn leftovers(&self) -> Vec<PathBuf> {
        fs::read_dir(self.path("tmp")).expect("a folder").flatten().map(|entry| entry.path()).collect()
    }

    /// Asserts that no process, no folder and no result is left.
    ///
    /// # Panics
    /// When something is.
    #[track_caller]
    pub fn assert_clean(&self) {
        let (processes, folders) = (self.processes(), self.leftovers());
        assert!(processes.is_empty() && folders.is_empty(), "left: processes {processes:?}, {folders:?}");
    }
}

/// A mission under way.
pub struct Running<'a> {
    site: &'a Site,
    child: Child,
}

/// How a mission ended.
#[derive(Debug)]
pub struct Ended {
    /// Its exit status; none when a signal ended it.
    pub code: Option<i32>,
    /// What it printed.
    pub stdout: String,
    /// What it said.
    pub stderr: String,
    /// How long that took since it was asked to, or waited for.
    pub took: Duration,
}

/// An emulator of a mission under way.
#[derive(Clone, Debug)]
pub struct Emulated {
    /// Its process.
    pub process: u32,
    /// The drone whose board it is.
    pub drone: usize,
    /// Its folder, with the FIFOs.
    pub folder: PathBuf,
}

impl Running<'_> {
    /// Its process.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Waits until the boards of so many drones fly, and a moment longer; in order of the drones.
    ///
    /// # Panics
    /// When they do not, or the mission is over before.
    #[must_use]
    pub fn wait_for_boards(&mut self, count: usize) -> Vec<Emulated> {
        let begun = Instant::now();
        loop {
            let emulators = self.emulators();
            if emulators.len() == count {
                // Steps are done from now on: some hundred, or thousands.
                std::thread::sleep(Duration::from_millis(500));
                let over = self.child.try_wait().expect("its state");
                assert!(over.is_none(), "the mission is over already: {over:?}");
                return emulators;
            }
            assert!(begun.elapsed() < PATIENCE, "only {emulators:?} of {count} boards fly");
            let over = self.child.try_wait().expect("its state");
            assert!(over.is_none(), "the mission ended with {over:?}: {}", self.site.text("stderr"));
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Emulators that have both FIFOs open, in order of their drones.
    fn emulators(&self) -> Vec<Emulated> {
        let own = self.id();
        let running = |id: &u32| {
            let folder = fs::read_link(format!("/proc/{id}/cwd")).ok()?;
            let number: usize =
                folder.file_name()?.to_str()?.strip_prefix(&format!("skyroost-{own}-"))?.parse().ok()?;
            let open = ["bus.in", "bus.out"].iter().all(|name| open_as(*id, &folder.join(name)).is_some());
            open.then(|| Emulated { process: *id, drone: number + 1, folder })
        };
        let mut found: Vec<Emulated> = self.site.processes().iter().filter_map(running).collect();
        found.sort_by_key(|emulator| emulator.drone);
        found
    }

    /// Sends it a signal.
    ///
    /// # Panics
    /// When it is gone.
    pub fn signal(&self, which: Signal) {
        signal(self.id(), which);
    }

    /// Waits for its end.
    ///
    /// # Panics
    /// When it does not end.
    #[must_use]
    pub fn end(mut self) -> Ended {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("its state") {
                break status;
            }
            assert!(begun.elapsed() < PATIENCE, "the mission does not end");
            std::thread::sleep(Duration::from_millis(2));
        };
        let took = begun.elapsed();
        Ended {
            code: status.code(),
            stdout: self.site.text("stdout"),
            stderr: self.site.text("stderr"),
            took,
        }
    }

    /// Waits for its end, which must be that of a board that failed: status 4, one message that holds all of `told`
    /// in time, and nothing left.
    ///
    /// # Panics
    /// When it ends otherwise.
    #[track_caller]
    #[expect(clippy::must_use_candidate, reason = "its assertions are enough for most")]
    pub fn fails(self, told: &[&str]) -> Ended {
        let site = self.site;
        let ended = self.end();
        assert_eq!(ended.code, Some(4), "{ended:?}");
        for told in told {
            assert!(ended.stderr.contains(told), "{told:?} is not in: {}", ended.stderr);
        }
        assert!(ended.stderr.starts_with("error: "), "{}", ended.stderr);
        assert_eq!(ended.stderr.matches("error: ").count(), 1, "one message: {}", ended.stderr);
        assert_eq!(ended.stdout, "");
        assert!(ended.took < TOLD_WITHIN, "told after {:?}", ended.took);
        assert!(!site.path("out").exists(), "results of a mission that failed");
        site.assert_clean();
        ended
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        // A test that failed must not leave it.
        if matches!(self.child.try_wait(), Ok(None)) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// Sends a process a signal.
///
/// # Panics
/// When there is none.
pub fn signal(process: u32, which: Signal) {
    assert!(processes::try_signal(process, which), "no process {process} to signal");
}

/// The path below `/proc` under which a process has a file open.
#[must_use]
pub fn open_as(process: u32, file: &Path) -> Option<PathBuf> {
    let open = fs::read_dir(format!("/proc/{process}/fd")).ok()?.flatten();
    open.map(|entry| entry.path()).find(|path| fs::read_link(path).is_ok_and(|target| target == file))
}
