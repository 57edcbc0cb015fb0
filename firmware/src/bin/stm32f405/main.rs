//! The flight board: an STM32F405RG with an 8 MHz crystal, as on most flight controllers and
//! evaluation boards of this chip, running at its full 168 MHz.
//!
//! The image is a shell around the flight code. Guidance runs on an interrupt executor above all links, the
//! links on another below it; thread mode sleeps. The first message on the bus says what the board is
//! for ([`BusMode`](skyroost_firmware::board::bus_mode::BusMode)): with an autopilot it flies, with a host
//! it is the drone of a simulation. Whatever goes wrong in flight ends with safe outputs and a reset: a
//! panic or a fault asks for one, a hang is met by the watchdog.
//!
//! The same image runs in QEMU (`-machine netduinoplus2`), where it serves the host on USART1.
//!
//! Built and linted by every check, and its bench side run in the emulator; no hardware has run it so far.
//! Wiring and flashing: `firmware/README.md`.
#![no_std]
// A board's file: registers and interrupts want it, each with its reason.
#![allow(unsafe_code)]
#![no_main]

mod capture;
mod chip;
mod clocks;
mod emulator;
mod flight;
mod links;
mod safe;
mod supply;

use core::panic::PanicInfo;

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{SCB, SYST};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, SendSpawner, SpawnError, SpawnToken};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use skyroost_firmware::board::boot::LastWords;
use skyroost_firmware::board::shell::{Shell, Stopwatch};

/// Guidance, above the links. Both use the interrupt of a peripheral that the boards leave alone.
static GUIDANCE: InterruptExecutor = InterruptExecutor::new();
/// Bus, radio and telemetry.
static LINKS: InterruptExecutor = InterruptExecutor::new();

/// Below the timers and the capture, which keep the reset's P0, and above everything else.
const GUIDANCE_PRIORITY: Priority = Priority::P6;
/// The UARTs and their DMA, which wake the links.
const DRIVER_PRIORITY: Priority = Priority::P10;
const LINKS_PRIORITY: Priority = Priority::P12;

#[interrupt]
unsafe fn UART5() {
    // SAFETY: this is the interrupt that `main` starts the executor on, and nothing else calls it.
    unsafe { GUIDANCE.on_interrupt() }
}

#[interrupt]
unsafe fn UART4() {
    // SAFETY: this is the interrupt that `main` starts the executor on, and nothing else calls it.
    unsafe { LINKS.on_interrupt() }
}

#[entry]
fn main() -> ! {
    static SHELL: Shell = Shell::new();
    let shell = &SHELL;
    start_stopwatch();
    interrupt::UART5.set_priority(GUIDANCE_PRIORITY);
    interrupt::UART4.set_priority(LINKS_PRIORITY);
    let executors =
        Executors { guidance: GUIDANCE.start(interrupt::UART5), links: LINKS.start(interrupt::UART4) };
    executors.link(links::bench(shell));
    executors.link(links::radio_frames(shell));
    if emulator::detect() {
        emulator::start(shell, &executors);
    } else {
        chip::start(shell, &executors);
    }
    loop {
        cortex_m::asm::wfi();
    }
}

/// Where tasks are spawned.
struct Executors {
    guidance: SendSpawner,
    links: SendSpawner,
}

impl Executors {
    /// Spawns the guidance task.
    fn guide<S: Send>(&self, task: Result<SpawnToken<S>, SpawnError>) {
        spawn(self.guidance, task);
    }

    /// Spawns a task of the links.
    fn link<S: Send>(&self, task: Result<SpawnToken<S>, SpawnError>) {
        spawn(self.links, task);
    }
}

fn spawn<S: Send>(executor: SendSpawner, task: Result<SpawnToken<S>, SpawnError>) {
    // A task is refused only when it already runs; at start that means memory is not what it should be.
    match task {
        Ok(task) => executor.spawn(task),
        Err(_) => SCB::sys_reset(),
    }
}

/// The core's clock: SysTick, which the emulator has as well, down over 24 bits (100 ms).
#[derive(Clone, Copy)]
struct Cycles;

const SYSTICK_BITS: u32 = 24;

impl Stopwatch for Cycles {
    fn read(&self) -> u32 {
        SYST::get_current()
    }

    fn since(&self, earlier: u32) -> u32 {
        earlier.wrapping_sub(SYST::get_current()) & ((1 << SYSTICK_BITS) - 1)
    }
}

fn start_stopwatch() {
    let Some(core) = cortex_m::Peripherals::take() else { return };
    let mut systick = core.SYST;
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload((1 << SYSTICK_BITS) - 1);
    systick.clear_current();
    systick.enable_counter();
}

/// Most bytes of stack ever in use: how far down the paint of the start-up code is gone.
fn stack_used() -> u32 {
    unsafe extern "C" {
        static _stack_start: u32;
        static _stack_end: u32;
    }
    let top = &raw const _stack_start as usize;
    let mut at = (&raw const _stack_end as usize).next_multiple_of(4);
    // SAFETY: `at` runs over the words between the linker's two marks, which are RAM of the stack.
    while at < top && unsafe { (at as *const u32).read_volatile() } == cortex_m_rt::STACK_PAINT_VALUE {
        at += 4;
    }
    (top - at) as u32
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    safe::reset(LastWords::Fault, || {
        defmt::error!("hard fault at {=u32:#010x}, called from {=u32:#010x}", frame.pc(), frame.lr());
    })
}

/// The clock security system found the crystal stopped; the chip runs on its internal oscillator now.
#[exception]
unsafe fn NonMaskableInt() {
    safe::reset(LastWords::Crystal, || defmt::error!("the crystal has stopped"))
}

/// Says where, then resets: a drone is better served by a board that starts again than by one that halts.
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    safe::reset(LastWords::Panic, || {
        if let Some(place) = info.location() {
            defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
        }
    })
}
