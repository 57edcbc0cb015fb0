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
#[path = "../common/mod.rs"]
mod common;
mod emulator;
mod flight;
mod given;
mod links;
mod ports;
mod safe;
mod supply;

use core::panic::PanicInfo;

use common::{Executors, SysTick, stack_used};
use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_rtt as _;
use embassy_executor::{SendSpawner, SpawnError, SpawnToken};
use embassy_stm32::interrupt::Priority;
use skyroost_firmware::board::boot::LastWords;
use skyroost_firmware::board::shell::Shell;

/// The UARTs and their DMA, which wake the links: between those and guidance.
const DRIVER_PRIORITY: Priority = Priority::P10;

#[entry]
fn main() -> ! {
    // Taken here and nowhere else.
    let Some(shell) = Shell::the_only() else { safe::reset(LastWords::Panic, || ()) };
    SysTick::start();
    let executors = Executors::start();
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
