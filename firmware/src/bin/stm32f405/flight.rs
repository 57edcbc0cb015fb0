//! Guidance: in flight on the 50 Hz grid of GNSS time, on the bench when the host says.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex as Raw;
use embassy_sync::pipe::Pipe;
use embassy_time::{Instant, Timer};
use skyroost_firmware::board::autopilot::{Given, Start, Status, TO_AUTOPILOT, ToAutopilot, encode};
use skyroost_firmware::board::bus_mode::BusMode;
use skyroost_firmware::board::cadence::GUIDANCE_PERIOD_US;
use skyroost_firmware::board::grid::{Grid, Waking};
use skyroost_firmware::board::inflight::Inflight;
use skyroost_firmware::board::shell::Shell;
use skyroost_firmware::config::AgentConfig;
use skyroost_firmware::io::{Outputs, SrsGate};
use skyroost_firmware::srs::clock::TickRate;
use skyroost_firmware::srs::discipline::Oscillator;
use skyroost_protocol::codec::Frame;
use skyroost_protocol::key::Key;
use skyroost_protocol::stream::{StreamFrame, encode_stream};
use skyroost_protocol::units::{DroneId, TimePs};

use super::capture::{self, Window};
use super::given::Sector;
use super::links::{self, MESSAGES, MODE, RADIO_OUT, STATUS};
use super::{SysTick, safe};

const TIMER_RATE: TickRate = match TickRate::new(capture::RATE_HZ) {
    Ok(rate) => rate,
    Err(_) => unreachable!(),
};

/// What the board's crystal and a timing receiver do wrong: 20 ppm at 25 °C and as much over temperature with
/// some of age; a nanosecond over a second; half a ppm a kelvin at a hundredth of a kelvin a second; a pulse
/// within 60 ns in 99 of 100 seconds (u-blox M8, time pulse accuracy), and twice that for antenna and cable.
const OSCILLATOR: Oscillator = Oscillator {
    rate: TIMER_RATE,
    tolerance_ppb: 50_000,
    walk_ps: 1_000,
    wander_fs_per_s2: 5_000_000,
    pulse_ps: 60_000,
};

/// The baseband listens this long before a transmission,
const GATE_EARLY: TimePs = TimePs::from_us(100);
/// and this long after it began: the longest way and the longest signal, a symbol of 71 us.
const GATE_LATE: TimePs = TimePs::from_us(200);

/// Steps between two reports of status: a second.
const STEPS_PER_STATUS: u32 = 50;
/// Steps between two messages of how the board came to start: ten seconds.
const STEPS_PER_START: u32 = 500;

/// Frames for bus or radio that found no room.
static UNSENT: AtomicU32 = AtomicU32::new(0);

/// The guidance task of the chip.
#[embassy_executor::task]
pub(crate) async fn guidance(
    shell: &'static Shell,
    mut watchdog: IndependentWatchdog<'static, IWDG>,
    sector: Sector,
    start: Start,
) {
    match MODE.wait().await {
        // The host steps the board when it likes, and nothing is commanded: no watchdog.
        BusMode::Undecided | BusMode::Bench => shell.guidance(SysTick).await,
        BusMode::Flight => {
            watchdog.unleash();
            Pilot::new(shell, sector, start).fly(|| watchdog.pet()).await;
        }
    }
}

/// The guidance task of the emulator, which has neither watchdog nor timers: it serves the host.
#[embassy_executor::task]
pub(crate) async fn bench_guidance(shell: &'static Shell) {
    shell.guidance(SysTick).await;
}

/// Guidance in flight.
struct Pilot {
    shell: &'static Shell,
    sector: Sector,
    start: Start,
    board: Inflight,
    /// None until GNSS time is known and with it the drone is born.
    grid: Option<Grid>,
    worst_step_cycles: u32,
}

impl Pilot {
    fn new(shell: &'static Shell, sector: Sector, start: Start) -> Self {
        let board = Inflight::new(OSCILLATOR, capture::now());
        Self { shell, sector, start, board, grid: None, worst_step_cycles: 0 }
    }

    /// Flies for ever. `well` is called after every slot that ended as it should, and by nothing else.
    async fn fly(&mut self, mut well: impl FnMut()) -> ! {
        say(self.shell, &ToAutopilot::Started(self.start));
        let mut pause_us = u64::from(GUIDANCE_PERIOD_US);
        loop {
            Timer::after_micros(pause_us).await;
            pause_us = self.wake().await;
            well();
        }
    }

    /// Takes in what has come and steps if it is time to. Returns the time to the next waking.
    async fn wake(&mut self) -> u64 {
        self.board.read(capture::now());
        while let Ok(edge) = capture::EDGES.try_receive() {
            self.board.edge(edge);
        }
        while let Ok((message, came)) = MESSAGES.try_receive() {
            self.board.hear(message, came);
        }
        // Before GNSS time is known the drone is no part of a fleet: its times would be lies.
        let Some(now) = self.board.step_time(capture::now()) else { return u64::from(GUIDANCE_PERIOD_US) };
        if self.grid.is_none() {
            self.be_born().await;
            if !self.may_fly() {
                return u64::from(GUIDANCE_PERIOD_US);
            }
        }
        let grid = self.grid.get_or_insert_default();
        if let Waking::Sleep { us } = grid.wake(now) {
            return us;
        }
        let begun = Instant::now();
        self.step(now).await;
        let grid = self.grid.get_or_insert_default();
        let pause_us = grid.stepped(now, begun.elapsed().as_micros());
        let steps = grid.punctuality().steps;
        if steps.is_multiple_of(STEPS_PER_STATUS) {
            self.report();
        }
        if steps.is_multiple_of(STEPS_PER_START) {
            say(self.shell, &ToAutopilot::Started(self.start));
        }
        pause_us
    }

    /// Whether the board was given what it takes.
    fn may_fly(&self) -> bool {
        matches!(self.start.given, Given::Key | Given::OpenLink)
    }

    /// The agent is born when the board knows who it is and what time it is, and finds a key for it. It looks once.
    async fn be_born(&mut self) {
        if self.start.given != Given::Unread {
            return;
        }
        let Some(identity) = self.board.identity() else { return };
        let (sector, mut given) = (&mut self.sector, Given::OpenLink);
        let born = || {
            let (config, key) = drone_of(sector, identity.drone)?;
            defmt::info!("drone {=u16} begins, boot epoch {=u16}", config.id.0, config.boot_epoch);
            if key.is_some() {
                given = Given::Key;
            }
            Ok((config, key))
        };
        if let Err(why) = self.shell.begin(born).await {
            defmt::error!("drone {=u16} cannot begin: {}", identity.drone.0, why);
            given = why;
        }
        self.start.given = given;
        say(self.shell, &ToAutopilot::Started(self.start));
    }

    async fn step(&mut self, now: TimePs) {
        let (shell, crystal) = (self.shell, self.start.crystal);
        let act = |board: &mut Inflight, outputs: &Outputs| act(shell, now, crystal, board, outputs);
        let cycles = shell.fly(now, &SysTick, &mut self.board, Inflight::sense, act).await;
        self.worst_step_cycles = self.worst_step_cycles.max(cycles);
    }

    fn report(&self) {
        let mut status = Status { captures_lost: capture::lost(), ..Status::default() };
        self.board.describe(&mut status);
        if let Some(grid) = &self.grid {
            let kept = grid.punctuality();
            status.steps = [kept.steps, kept.dropped_slots, kept.worst_step_us];
        }
        status.links = [&links::UNKNOWN, &links::LOST, &UNSENT].map(|count| count.load(Ordering::Relaxed));
        say(self.shell, &ToAutopilot::Status(status));
        STATUS.signal(status);
        defmt::debug!("{}; worst step {=u32} cycles", self.board.counters(), self.worst_step_cycles);
    }
}

/// Constants and key for this drone; spends a boot.
fn drone_of(sector: &mut Sector, drone: DroneId) -> Result<(AgentConfig, Option<Key>), Given> {
    let provision = sector.provision()?;
    if provision.drone != drone {
        return Err(Given::AnothersKey);
    }
    let mut config = AgentConfig::new(drone);
    config.boot_epoch = sector.boot()?;
    // TIM2 captures triggers and pulses alike: one oscillator, one discipline.
    config.oscillator = OSCILLATOR;
    Ok((config, provision.key))
}

/// Sees to it that what the step wants is done.
fn act(shell: &Shell, now: TimePs, crystal: bool, board: &mut Inflight, outputs: &Outputs) {
    board.act(now, outputs);
    for frame in outputs.uplink.iter().chain(&outputs.peer) {
        send(frame);
    }
    for gate in &outputs.srs_gates {
        open_gate(board, gate);
        say(shell, &ToAutopilot::Gate((*gate).into()));
    }
    // Without its crystal the board knows no time worth flying by.
    if crystal {
        say(shell, &ToAutopilot::Setpoint { now, setpoint: outputs.setpoint.into() });
        safe::enable_outputs();
    }
}

fn open_gate(board: &Inflight, gate: &SrsGate) {
    let ticks_at = |time| board.clock().ticks_at(time).map(|ticks| ticks as u32);
    let early = TimePs(gate.at.0.saturating_sub(GATE_EARLY.0));
    // A clock that has lost the time opens no gate; its triggers count as untimed.
    if let (Some(open), Some(close)) = (ticks_at(early), ticks_at(gate.at.after(GATE_LATE))) {
        capture::open_gate(Window { open, close });
    }
}

/// Puts a frame on its way to the radio, whole or not at all.
fn send(frame: &Frame) {
    let mut stream = StreamFrame::new();
    if encode_stream(frame, &mut stream).is_err() || !put(&RADIO_OUT, &stream) {
        UNSENT.fetch_add(1, Ordering::Relaxed);
    }
}

/// Puts a message on its way to the autopilot, whole or not at all.
fn say(shell: &Shell, message: &ToAutopilot) {
    if !encode(TO_AUTOPILOT, message).is_some_and(|frame| put(&shell.bus_out, &frame)) {
        UNSENT.fetch_add(1, Ordering::Relaxed);
    }
}

/// Writes all of `bytes`, or nothing where they do not fit. Guidance alone writes in flight.
fn put<const N: usize>(pipe: &Pipe<Raw, N>, bytes: &[u8]) -> bool {
    if pipe.free_capacity() < bytes.len() {
        return false;
    }
    let mut rest = bytes;
    // In two pieces where the pipe's memory ends.
    while let Ok(count) = pipe.try_write(rest)
        && count < rest.len()
    {
        rest = rest.get(count..).unwrap_or(&[]);
    }
    true
}
