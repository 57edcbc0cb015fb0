//! The flight board's image in the emulator, its bus on a terminal: a board for `--backend serial`.

use std::{
    io::{self, Write},
    os::unix::net::UnixStream,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::OnceLock,
    time::{Duration, Instant},
};
use tempfile::TempDir;

/// The image: the one that `SKYROOST_FLIGHT_IMAGE` names, or else the workspace's, built where it is missing.
///
/// # Panics
/// When there is none and it cannot be built.
pub fn image() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| {
        if let Some(named) = std::env::var_os("SKYROOST_FLIGHT_IMAGE") {
            return PathBuf::from(named);
        }
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
        let image = target.join("cross/thumbv7em-none-eabihf/release/stm32f405");
        if !image.exists() {
            let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
            let words = ["xtask", "firmware", "--board", "stm32f405"];
            let status = Command::new(cargo).current_dir(root).args(words).status().expect("cargo runs");
            // An image over its budget is for another test to refuse.
            assert!(image.exists(), "the image of the flight board does not build: {status}");
        }
        image
    })
}

/// An emulated flight board; ends with this value.
pub struct FlightBoard {
    process: Child,
    /// Where the emulator takes orders.
    dir: TempDir,
}

impl FlightBoard {
    /// Starts a board whose USART1 is at this terminal.
    ///
    /// # Panics
    /// When the emulator cannot be started.
    #[must_use]
    pub fn start(terminal: &Path) -> Self {
        let dir = TempDir::new().expect("a temporary folder");
        // Should the tests be killed, the system kills what they started.
        let process = Command::new("setpriv")
            .args(["--pdeathsig", "KILL", "qemu-system-arm", "-machine", "netduinoplus2"])
            .args(["-display", "none", "-monitor"])
            .arg(format!("unix:{},server=on,wait=off", dir.path().join(MONITOR).display()))
            .arg("-chardev")
            .arg(format!("serial,id=bus,path={}", terminal.display()))
            .args(["-serial", "chardev:bus", "-kernel"])
            .arg(image())
            .stdin(Stdio::null())
            .spawn()
            .expect("qemu-system-arm and setpriv are there: see `cargo xtask setup`");
        Self { process, dir }
    }

    /// Waits until the board runs: from a cold disk, on a machine with more to do, that takes seconds.
    ///
    /// # Panics
    /// When it does not within a minute.
    pub fn wait_until_up(&self) {
        let begun = Instant::now();
        while !self.order("info status").is_ok_and(|answer| answer.contains("running")) {
            assert!(begun.elapsed() < Duration::from_secs(60), "the emulator does not get up");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Pulls the board's reset line: it starts again from its vector table, at once.
    ///
    /// # Panics
    /// When the emulator takes no orders.
    pub fn reset(&self) {
        self.order("system_reset").expect("the emulator takes orders");
    }

    /// Gives the emulator an order and returns what it says to it.
    fn order(&self, words: &str) -> io::Result<String> {
        let mut monitor = UnixStream::connect(self.dir.path().join(MONITOR))?;
        writeln!(monitor, "{words}")?;
        // It reads what came before the end.
        monitor.shutdown(std::net::Shutdown::Write)?;
        io::read_to_string(monitor)
    }
}

/// The emulator's monitor, in the board's folder.
const MONITOR: &str = "monitor";

impl Drop for FlightBoard {
    fn drop(&mut self) {
        let _ = self.process.kill(); // it may have ended already
        let _ = self.process.wait();
    }
}
