//! The emulator: QEMU 7.2's STM32F405, which has UARTs but neither clock tree nor DMA.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_stm32::interrupt;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex as Raw;
use embassy_sync::pipe::Pipe;
use skyroost_firmware::board::shell::Shell;

use super::ports::{self, BusRx, BusTx};
use super::{DRIVER_PRIORITY, Executors, flight};

static EMULATED: AtomicBool = AtomicBool::new(false);
/// Bytes that USART1 received.
static RECEIVED: Pipe<Raw, 256> = Pipe::new();

/// 921,600 baud from the 16 MHz that the chip runs on after a reset, to 2 %. The emulator does not care.
const BRR: u32 = 17;

/// Reads of a register that is given time to take a value.
const PATIENCE: u32 = 100;

/// Whether this is [`detect`]ed to be the emulator.
pub(crate) fn is_this() -> bool {
    EMULATED.load(Ordering::Relaxed)
}

/// Finds out whether this is the emulator: it has no model of the power controller, whose registers read as
/// zero whatever is written. On the chip, `PWR_CR.DBP` holds what is written a few cycles before (RM0090,
/// 5.4.1), and has to for the backup registers.
///
/// A chip taken for the emulator would be a broken one, and harmless: all it does is answer a host on USART1.
/// `OUTPUT_ENABLE` is never touched and stays low by the resistor at it, no setpoint is ever sent (there is
/// no task that would), timer and radio stay off; the autopilot flies as without a board. The emulator
/// taken for a chip waits for its clocks for ever and answers nobody, which any test shows.
pub(crate) fn detect() -> bool {
    pac::RCC.apb1enr().modify(|w| w.set_pwren(true));
    let _ = pac::RCC.apb1enr().read();
    pac::PWR.cr1().modify(|w| w.set_dbp(true));
    let holds = (0..PATIENCE).any(|_| pac::PWR.cr1().read().dbp());
    EMULATED.store(!holds, Ordering::Relaxed);
    !holds
}

/// Sets USART1 up and spawns what the emulator needs.
pub(crate) fn start(shell: &'static Shell, executors: &Executors) {
    pac::RCC.apb2enr().modify(|w| w.set_usart1en(true));
    let uart = pac::USART1;
    uart.brr().write(|w| w.0 = BRR);
    uart.cr1().write(|w| {
        w.set_ue(true);
        w.set_te(true);
        w.set_re(true);
        w.set_rxneie(true);
    });
    interrupt::USART1.set_priority(DRIVER_PRIORITY);
    // SAFETY: the handler needs nothing but what is set up now.
    unsafe { interrupt::USART1.enable() };
    executors.guide(flight::bench_guidance(shell));
    executors.link(ports::read_bus(shell, BusRx::Emulator(Port)));
    executors.link(ports::write_bus(shell, BusTx::Emulator(Port)));
}

/// Takes in the byte that has come. Without room it stays where it is, and the emulator sends no more.
pub(crate) fn on_usart1() {
    let uart = pac::USART1;
    while uart.sr().read().rxne() {
        if RECEIVED.is_full() {
            uart.cr1().modify(|w| w.set_rxneie(false));
            return;
        }
        // There is room for one byte, and nobody else writes.
        let _ = RECEIVED.try_write(&[uart.dr().read().dr() as u8]);
    }
}

/// USART1 by plain interrupts.
pub(crate) struct Port;

impl Port {
    /// Waits for bytes; how many came.
    pub(crate) async fn read(&mut self, bytes: &mut [u8]) -> usize {
        let count = RECEIVED.read(bytes).await;
        critical_section::with(|_| pac::USART1.cr1().modify(|w| w.set_rxneie(true)));
        count
    }

    /// Sends all of `bytes`.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> usize {
        for byte in bytes {
            // The emulator is always ready: it hands bytes on as they are written.
            while !pac::USART1.sr().read().txe() {}
            pac::USART1.dr().write(|w| w.set_dr(u16::from(*byte)));
        }
        bytes.len()
    }
}
