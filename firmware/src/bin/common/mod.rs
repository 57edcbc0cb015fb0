//! What the images of an STM32F405 share, on the chip and in the emulator: the two executors, the core's clock,
//! the use of the stack.

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use skyroost_firmware::board::shell::Stopwatch;

/// Guidance, above the links. Both use the interrupt of a peripheral that the boards leave alone.
static GUIDANCE: InterruptExecutor = InterruptExecutor::new();
/// Bus, radio and telemetry.
static LINKS: InterruptExecutor = InterruptExecutor::new();

/// Below the timers and the capture, which keep the reset's P0, and above everything else.
const GUIDANCE_PRIORITY: Priority = Priority::P6;
/// Below the drivers that wake the links.
const LINKS_PRIORITY: Priority = Priority::P12;

#[interrupt]
unsafe fn UART5() {
    // SAFETY: this is the interrupt that `start` starts the executor on, and nothing else calls it.
    unsafe { GUIDANCE.on_interrupt() }
}

#[interrupt]
unsafe fn UART4() {
    // SAFETY: this is the interrupt that `start` starts the executor on, and nothing else calls it.
    unsafe { LINKS.on_interrupt() }
}

/// Where tasks are spawned.
pub(crate) struct Executors {
    pub(crate) guidance: SendSpawner,
    pub(crate) links: SendSpawner,
}

impl Executors {
    /// Starts both; the entry calls it, once.
    pub(crate) fn start() -> Self {
        interrupt::UART5.set_priority(GUIDANCE_PRIORITY);
        interrupt::UART4.set_priority(LINKS_PRIORITY);
        Self { guidance: GUIDANCE.start(interrupt::UART5), links: LINKS.start(interrupt::UART4) }
    }
}

/// The core's clock: SysTick, down over 24 bits. On the chip that is 100 ms; QEMU's `-icount` ties it to the
/// instructions done.
#[derive(Clone, Copy)]
pub(crate) struct SysTick;

const SYSTICK_BITS: u32 = 24;

impl SysTick {
    /// Starts it; the entry calls it, once.
    pub(crate) fn start() {
        let Some(core) = cortex_m::Peripherals::take() else { return };
        let mut systick = core.SYST;
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload((1 << SYSTICK_BITS) - 1);
        systick.clear_current();
        systick.enable_counter();
    }
}

impl Stopwatch for SysTick {
    fn read(&self) -> u32 {
        SYST::get_current()
    }

    fn since(&self, earlier: u32) -> u32 {
        earlier.wrapping_sub(SYST::get_current()) & ((1 << SYSTICK_BITS) - 1)
    }
}

/// Most bytes of stack ever in use: how far down the paint of the start-up code is gone.
pub(crate) fn stack_used() -> u32 {
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
