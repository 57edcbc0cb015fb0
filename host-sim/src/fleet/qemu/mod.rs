//! Emulated boards: the image of `firmware/src/bin/emulated` in QEMU, one process for each drone.
//!
//! QEMU knows the STM32F405 as `netduinoplus2`. The image's bus is a pair of FIFOs in a folder of its own, read
//! and written by semihosting; its log is a file there. With `-icount` QEMU's time follows the instructions done,
//! so that the core's clock counts them, the same in every run.
//!
//! No process outlives its [`Emulator`], and no folder: both go with it, with a panic of this program, and the
//! process also with the end of its FIFO, whatever has become of this program.

mod fifo;
mod log;

use super::{
    BackendError, Board, BoardError, BoardFault, BoardFigures, BoardReport,
    bus::{BusClient, LinkKind},
    image::Image,
    panic_guard::PanicGuard,
};
use fifo::Fifos;
use log::LogReader;
use skyroost_firmware::{
    board::bus::Report,
    config::AgentConfig,
    counters::Counters,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{key::Key, units::TimePs};
use std::{
    fs::{self, File},
    io,
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    sync::atomic::{AtomicU32, Ordering},
    time::{Duration, Instant},
};

/// The emulator.
const QEMU: &str = "qemu-system-arm";
/// Virtual nanoseconds an instruction takes are 2 to this power.
const ICOUNT_SHIFT: u32 = 3;
/// The core's clock as QEMU has it on this machine, hertz.
const CORE_HZ: u64 = 168_000_000;
/// An image that has not opened its bus by then is no image of an emulated board.
const BOOT: Duration = Duration::from_secs(3);
/// An emulator whose bus has ended gets this long to end by itself.
const FAREWELL: Duration = Duration::from_millis(500);
/// The log in the emulator's folder; the image writes it.
const LOG: &str = "board.log";
/// What the emulator itself has to say.
const COMPLAINTS: &str = "emulator.err";

/// How to run emulated boards.
#[derive(Clone, Debug, Default)]
pub struct QemuOptions {
    /// The image to run; none for the workspace's own, built where it is missing.
    pub image: Option<PathBuf>,
    /// Folder for the boards' logs.
    pub log_dir: Option<PathBuf>,
}

/// Starts emulators.
pub struct Launcher {
    image: Image,
    reader: LogReader,
    log_dir: Option<PathBuf>,
}

impl Launcher {
    /// Finds the image, and builds it first where it is the workspace's own and missing.
    ///
    /// # Errors
    /// When there is no image.
    pub fn new(options: &QemuOptions) -> Result<Self, BackendError> {
        let image = Image::find(options.image.as_deref())?;
        let reader = LogReader::new(&image.elf);
        Ok(Self { image, reader, log_dir: options.log_dir.clone() })
    }

    /// Starts the board of a drone.
    ///
    /// # Errors
    /// When the emulator cannot be started or what it runs is no board of this version.
    pub fn start(&self, config: AgentConfig, key: Option<Key>) -> Result<Emulator, BoardError> {
        let drone = config.id.0;
        let not_started = |what: String| BoardError {
            drone,
            port: None,
            fault: BoardFault::NotStarted(what),
            log: Vec::new(),
        };
        let folder =
            Folder::make().map_err(|error| not_started(format!("no folder for its FIFOs: {error}")))?;
        let process = self.spawn(folder.path()).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => {
                not_started(format!("{QEMU} is not installed; `cargo xtask setup` installs it"))
            }
            _ => not_started(format!("{QEMU}: {error}")),
        })?;
        let guard = PanicGuard::new(process.id(), folder.path().to_owned());
        let log_to = self.log_dir.as_ref().map(|dir| dir.join(format!("drone-{drone}.log")));
        let reader = self.reader.clone();
        let mut emulator = Emulator { drone, process, bus: None, folder, _guard: guard, reader, log_to };
        let fifos = emulator.connect(&self.image.path)?;
        let bus = emulator.bus.insert(BusClient::new(fifos, LinkKind::LOSSLESS));
        let begun = bus.begin(&config, key);
        begun.map_err(|fault| emulator.failed(fault))?;
        Ok(emulator)
    }

    fn spawn(&self, folder: &Path) -> io::Result<Child> {
        Fifos::make(folder)?;
        let mut command = Command::new(QEMU);
        command
            .args(["-machine", "netduinoplus2", "-display", "none", "-monitor", "none", "-serial", "null"])
            .args(["-semihosting-config", "enable=on,target=native"])
            .arg("-icount")
            .arg(format!("shift={ICOUNT_SHIFT},sleep=off"))
            .arg("-kernel")
            .arg(&self.image.path)
            .current_dir(folder)
            // Ctrl-C is for this program, which then ends its emulators in good order.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(folder.join(COMPLAINTS))?);
        command.spawn()
    }
}

/// One emulated board.
pub struct Emulator {
    drone: u16,
    process: Child,
    /// None before the image has opened it, and once it has been ended.
    bus: Option<BusClient<Fifos>>,
    folder: Folder,
    _guard: PanicGuard,
    reader: LogReader,
    log_to: Option<PathBuf>,
}

impl Emulator {
    /// Waits for the image to open its bus.
    fn connect(&mut self, image: &Path) -> Result<Fifos, BoardError> {
        let begun = Instant::now();
        loop {
            match Fifos::open(self.folder.path()) {
                Ok(Some(fifos)) => return Ok(fifos),
                Ok(None) => {}
                Err(error) => return Err(self.failed(BoardFault::Link(error))),
            }
            if let Ok(Some(status)) = self.process.try_wait() {
                let what = format!("{} when started with {}", self.ended(status), image.display());
                return Err(self.failed(BoardFault::NotStarted(what)));
            }
            if begun.elapsed() > BOOT {
                let what = format!(
                    "{} has not opened its bus within {} s; is it the image of an emulated board?",
                    image.display(),
                    BOOT.as_secs()
                );
                return Err(self.failed(BoardFault::NotStarted(what)));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// How the emulator ended, with what it said last.
    fn ended(&self, status: ExitStatus) -> String {
        let said = fs::read_to_string(self.folder.path().join(COMPLAINTS)).unwrap_or_default();
        let last = said.lines().rfind(|line| !line.trim().is_empty());
        last.map_or_else(
            || format!("the emulator ended with {status}"),
            |last| format!("the emulator ended with {status}, saying \"{}\"", last.trim()),
        )
    }

    /// Makes an error of a fault: with how the emulator ended, if it has, and the last of its log.
    fn failed(&mut self, fault: BoardFault) -> BoardError {
        let fault = match fault {
            BoardFault::Ended(what) => {
                // Its FIFO ends a moment before the process does.
                BoardFault::Ended(wait(&mut self.process, FAREWELL).map_or(what, |status| self.ended(status)))
            }
            other => other,
        };
        let log = self.reader.tail(&self.folder.path().join(LOG));
        BoardError { drone: self.drone, port: None, fault, log }
    }

    fn with_bus<A>(
        &mut self,
        act: impl FnOnce(&mut BusClient<Fifos>) -> Result<A, BoardFault>,
    ) -> Result<A, BoardError> {
        let bus = self.bus.as_mut().expect("an emulator that has been started has a bus");
        act(bus).map_err(|fault| self.failed(fault))
    }
}

/// Instructions in so many ticks of the core's clock.
fn instructions(ticks: u64) -> f64 {
    ticks as f64 * 1e9 / (CORE_HZ as f64 * f64::from(1_u32 << ICOUNT_SHIFT))
}

impl Board for Emulator {
    fn begin_step(&mut self, now: TimePs, inputs: &Inputs, _: &mut Outputs) -> Result<(), BoardError> {
        self.with_bus(|bus| bus.begin_step(now, inputs))
    }

    fn end_step(&mut self, outputs: &mut Outputs) -> Result<(), BoardError> {
        self.with_bus(|bus| bus.end_step(outputs))
    }

    fn restart(&mut self, config: AgentConfig, key: Option<Key>) -> Result<(), BoardError> {
        self.with_bus(|bus| bus.begin(&config, key))
    }

    fn report(&mut self) -> Result<BoardReport, BoardError> {
        let (report, counted) = self.with_bus(|bus| Ok((bus.report()?, *bus.counters())))?;
        let Report { counters, link, steps, worst_step_cost, stack_used } = report;
        let sum = instructions(counted.cost_sum);
        Ok(BoardReport {
            counters: Counters::from_array(counters),
            board: Some(BoardFigures {
                link,
                steps,
                step_instructions_mean: (steps > 0).then(|| (sum / f64::from(steps)).round()),
                step_instructions_worst: Some(instructions(worst_step_cost.into()).round() as u64),
                step_instructions_sum: Some(sum.round() as u64),
                stack_used: Some(stack_used),
                punctuality: None,
            }),
        })
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // The end of its FIFO ends the image by itself; whatever does not end is made to.
        self.bus = None;
        if wait(&mut self.process, FAREWELL).is_none() {
            let _ = self.process.kill();
            let _ = self.process.wait();
        }
        if let Some(to) = &self.log_to {
            // The flight is over, well or not; a log that cannot be written must not hide how.
            let _ = self.reader.copy(&self.folder.path().join(LOG), to);
        }
    }
}

/// How `process` ended, if it does so in time.
fn wait(process: &mut Child, timeout: Duration) -> Option<ExitStatus> {
    let begun = Instant::now();
    loop {
        match process.try_wait() {
            Ok(Some(status)) => return Some(status),
            Ok(None) if begun.elapsed() < timeout => std::thread::sleep(Duration::from_millis(1)),
            _ => return None,
        }
    }
}

/// A folder that goes with this value.
#[derive(Debug)]
struct Folder(PathBuf);

impl Folder {
    fn make() -> io::Result<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        loop {
            let number = COUNT.fetch_add(1, Ordering::Relaxed);
            let path = std::env::temp_dir().join(format!("skyroost-{}-{number}", std::process::id()));
            match fs::create_dir(&path) {
                // Left by an earlier process of the same number that was killed.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                made => return made.map(|()| Self(path)),
            }
        }
    }

    fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
