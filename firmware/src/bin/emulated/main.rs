//! The emulated board: an STM32F405 as QEMU knows it (`-machine netduinoplus2`), in lockstep with the host.
//!
//! The tasks around the flight agent are those of the flight board, on the same two interrupt executors;
//! only what lies beneath them differs. Where a chip has UARTs with DMA, here two FIFOs of the host are read
//! and written by semihosting, in thread mode: it runs only when every task waits. Where a chip has timers,
//! here time is what the host says.
//!
//! QEMU runs it in a folder with the FIFOs `bus.in` and `bus.out` and puts the log, in defmt's encoding, into
//! `board.log`. The end of `bus.in` ends the emulator; a panic or a fault ends it with status 1, having said why
//! in the log.
#![no_std]
// A board's file: semihosting, interrupts and the logger want it, each with its reason.
#![allow(unsafe_code)]
#![no_main]

#[path = "../common/mod.rs"]
mod common;
mod host;
mod log;
mod time;

use core::panic::PanicInfo;

use common::{Executors, SysTick, stack_used};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use embassy_time::{Duration, Timer};
use skyroost_firmware::board::shell::{BUS_PIPE, Shell};

/// Time between two lines of telemetry in the log.
const TELEMETRY_EVERY: Duration = Duration::from_secs(10);

#[entry]
fn main() -> ! {
    let Some(shell) = Shell::the_only() else { host::exit(false) };
    let Some(mut bus) = host::Bus::open() else { host::exit(false) };
    SysTick::start();
    let executors = Executors::start();
    // A task is refused only when it runs already, and these start here and nowhere else.
    let (Ok(guidance), Ok(bus_task), Ok(radio), Ok(telemetry)) =
        (guidance(shell), bus_task(shell), radio(shell), telemetry(shell))
    else {
        host::exit(false)
    };
    executors.guidance.spawn(guidance);
    executors.links.spawn(radio);
    executors.links.spawn(bus_task);
    executors.links.spawn(telemetry);
    defmt::info!("skyroost {=str} on the emulated board", env!("CARGO_PKG_VERSION"));
    exchange(shell, &mut bus)
}

/// Carries bytes between the host and the bus task for ever.
fn exchange(shell: &Shell, bus: &mut host::Bus) -> ! {
    let mut bytes = [0; BUS_PIPE];
    loop {
        // Whenever this runs, every task waits: for bytes, or for room for its answer.
        while let Ok(count) = shell.bus_out.try_read(&mut bytes) {
            bus.write(bytes.get(..count).unwrap_or(&[]));
        }
        let Some(count) = bus.read(&mut bytes) else { host::exit(true) };
        let mut rest = bytes.get(..count).unwrap_or(&[]);
        while !rest.is_empty() {
            match shell.bus_in.try_write(rest) {
                Ok(taken) => rest = rest.get(taken..).unwrap_or(&[]),
                // Its task waits for room; the answer is too long for the pipe and goes in pieces.
                Err(_) => {
                    let mut answer = [0; 64];
                    while let Ok(count) = shell.bus_out.try_read(&mut answer) {
                        bus.write(answer.get(..count).unwrap_or(&[]));
                    }
                }
            }
        }
    }
}

#[embassy_executor::task]
async fn guidance(shell: &'static Shell) {
    shell.guidance(SysTick).await;
}

#[embassy_executor::task]
async fn bus_task(shell: &'static Shell) {
    shell.bus(time::advance_to, stack_used).await;
}

#[embassy_executor::task]
async fn radio(shell: &'static Shell) {
    shell.radio().await;
}

#[embassy_executor::task]
async fn telemetry(shell: &'static Shell) {
    loop {
        // Not a ticker: that would make up for every line that a leap of the host's time left out.
        Timer::after(TELEMETRY_EVERY).await;
        let (damaged, overflowed, dropped) = shell.dropped().await;
        defmt::info!(
            "radio: {=u32} damaged, {=u32} without room; flight code: {=u32} dropped",
            damaged,
            overflowed,
            dropped
        );
    }
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    defmt::error!("hard fault at {=u32:#010x}, called from {=u32:#010x}", frame.pc(), frame.lr());
    host::exit(false)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    host::exit(false)
}
