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

mod host;
mod log;
mod time;

use core::panic::PanicInfo;

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{ExceptionFrame, entry, exception};
use embassy_executor::InterruptExecutor;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_time::{Duration, Timer};
use skyroost_firmware::board::shell::{BUS_PIPE, Shell, Stopwatch};

/// Guidance, above the links. Both use the interrupt of a peripheral that the boards leave alone.
static GUIDANCE: InterruptExecutor = InterruptExecutor::new();
/// Bus, radio and telemetry.
static LINKS: InterruptExecutor = InterruptExecutor::new();

/// Time between two lines of telemetry in the log.
const TELEMETRY_EVERY: Duration = Duration::from_secs(10);

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
    let Some(shell) = Shell::the_only() else { host::exit(false) };
    let Some(mut bus) = host::Bus::open() else { host::exit(false) };
    start_stopwatch();
    interrupt::UART5.set_priority(Priority::P6);
    interrupt::UART4.set_priority(Priority::P12);
    let guidance_executor = GUIDANCE.start(interrupt::UART5);
    let links_executor = LINKS.start(interrupt::UART4);
    // A task is refused only when it runs already, and these start here and nowhere else.
    let (Ok(guidance), Ok(bus_task), Ok(radio), Ok(telemetry)) =
        (guidance(shell), bus_task(shell), radio(shell), telemetry(shell))
    else {
        host::exit(false)
    };
    guidance_executor.spawn(guidance);
    links_executor.spawn(radio);
    links_executor.spawn(bus_task);
    links_executor.spawn(telemetry);
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

/// The core's clock, which QEMU's `-icount` ties to the instructions done.
struct SysTick;

/// Bits of the SysTick counter.
const SYSTICK_BITS: u32 = 24;

impl Stopwatch for SysTick {
    fn read(&self) -> u32 {
        SYST::get_current()
    }

    fn since(&self, earlier: u32) -> u32 {
        // It counts down.
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
