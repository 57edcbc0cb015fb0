//! A serial line of two pseudo terminals: what is written at one comes out at the other, but for damage.
//!
//! `skyroost` has one terminal for its port, an emulated board the other for its UART. In between a thread
//! carries the bytes, flips bits in some, and can be told to carry none or to pull the plug.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    fs::{Mode, OFlags, fcntl_setfl, open},
    io::Errno,
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{OptionalActions, tcgetattr, tcsetattr},
};
use std::{
    ffi::OsStr,
    io,
    os::{fd::OwnedFd, unix::ffi::OsStrExt},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    },
    thread::JoinHandle,
};

/// How often the line looks whether it has been cut while no byte comes.
const IDLE: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
/// Bytes carried at once at most.
const PORTION: usize = 4096;

/// A serial line; unplugged with this value.
pub struct Line {
    port: PathBuf,
    board_end: PathBuf,
    state: Arc<State>,
    carrier: Option<JoinHandle<()>>,
}

/// What the carrier is told, and what it counts.
#[derive(Default)]
struct State {
    cut: AtomicBool,
    unplugged: AtomicBool,
    carried: AtomicU64,
    damaged: AtomicU64,
}

impl Line {
    /// A line that damages one byte in so many, in each direction; none for 0. `seed` decides which.
    ///
    /// # Panics
    /// When the system has no pseudo terminals left.
    #[must_use]
    pub fn new(seed: u64, damage_one_in: u32) -> Self {
        let ends = [(); 2].map(|()| Terminal::open().expect("a pseudo terminal"));
        let [port, board_end] = [0, 1].map(|end: usize| ends[end].path.clone());
        let state = Arc::new(State::default());
        let directions = [0, 1].map(|from| {
            let mut chance = ChaCha8Rng::seed_from_u64(seed);
            chance.set_stream(from as u64);
            Direction { from, waiting: Vec::new(), chance, damage_one_in }
        });
        let told = Arc::clone(&state);
        let carrier = std::thread::spawn(move || {
            if let Err(error) = carry(&ends, directions, &told) {
                eprintln!("the line fails: {error}");
            }
        });
        Self { port, board_end, state, carrier: Some(carrier) }
    }

    /// The port for `skyroost`.
    #[must_use]
    pub fn port(&self) -> &Path {
        &self.port
    }

    /// The terminal for the board.
    #[must_use]
    pub fn board_end(&self) -> &Path {
        &self.board_end
    }

    /// Bytes carried so far, both ways.
    #[must_use]
    pub fn carried(&self) -> u64 {
        self.state.carried.load(Relaxed)
    }

    /// Of those, the ones that were damaged.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.state.damaged.load(Relaxed)
    }

    /// From here on no byte arrives: the wire is cut, the port is still there.
    pub fn cut(&self) {
        self.state.cut.store(true, Relaxed);
    }

    /// Takes both terminals away, as when a USB adapter is pulled out.
    pub fn unplug(&mut self) {
        self.state.unplugged.store(true, Relaxed);
        if let Some(carrier) = self.carrier.take() {
            let _ = carrier.join(); // its panic is on stderr already
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.unplug();
    }
}

/// A pseudo terminal as bytes only: no echo, no line ends.
struct Terminal {
    master: OwnedFd,
    /// Held open, so that nobody who comes and goes hangs the line up.
    _slave: OwnedFd,
    path: PathBuf,
}

impl Terminal {
    fn open() -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?;
        let path = PathBuf::from(OsStr::from_bytes(name.to_bytes()));
        let slave = open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        let mut settings = tcgetattr(&slave)?;
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings)?;
        fcntl_setfl(&master, OFlags::NONBLOCK)?;
        Ok(Self { master, _slave: slave, path })
    }
}

/// One direction of the line.
struct Direction {
    from: usize,
    /// Bytes on their way.
    waiting: Vec<u8>,
    chance: ChaCha8Rng,
    damage_one_in: u32,
}

/// Carries bytes until the line is unplugged.
fn carry(ends: &[Terminal; 2], mut directions: [Direction; 2], state: &State) -> io::Result<()> {
    while !state.unplugged.load(Relaxed) {
        // Bytes are taken only when there is room for them: nothing is lost but what is to be.
        let wanted = directions.each_ref().map(|direction| match direction.waiting.is_empty() {
            true => (direction.from, PollFlags::IN),
            false => (1 - direction.from, PollFlags::OUT),
        });
        let mut polled = wanted.map(|(end, events)| PollFd::new(&ends[end].master, events));
        match poll(&mut polled, Some(&IDLE)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        for direction in &mut directions {
            direction.take(&ends[direction.from].master, state)?;
            direction.give(&ends[1 - direction.from].master)?;
        }
    }
    Ok(())
}

impl Direction {
    fn take(&mut self, from: &OwnedFd, state: &State) -> io::Result<()> {
        if !self.waiting.is_empty() {
            return Ok(());
        }
        let mut bytes = [0; PORTION];
        let count = match rustix::io::read(from, &mut bytes) {
            Err(Errno::AGAIN | Errno::INTR) => 0,
            result => result?,
        };
        if state.cut.load(Relaxed) {
            return Ok(());
        }
        state.carried.fetch_add(count as u64, Relaxed);
        for byte in &mut bytes[..count] {
            if self.damage_one_in > 0 && self.chance.next_u32().is_multiple_of(self.damage_one_in) {
                *byte ^= 1 << (self.chance.next_u32() % 8);
                state.damaged.fetch_add(1, Relaxed);
            }
        }
        self.waiting.extend_from_slice(&bytes[..count]);
        Ok(())
    }

    fn give(&mut self, to: &OwnedFd) -> io::Result<()> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let count = match rustix::io::write(to, &self.waiting) {
            Err(Errno::AGAIN | Errno::INTR) => 0,
            result => result?,
        };
        self.waiting.drain(..count);
        Ok(())
    }
}
