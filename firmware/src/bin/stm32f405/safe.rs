//! The safe state of this board, and the way there from anywhere.
//!
//! Stopping the motors is not safe in the air, and neither is a setpoint that nobody computes any more.
//! Safe is to command nothing: the autopilot sees `OUTPUT_ENABLE` fall and the setpoints stop, and its own
//! failsafe takes over. The baseband sees its gate closed.

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;
use embassy_stm32::pac;
use embassy_stm32::pac::gpio::vals::Moder;
use skyroost_firmware::board::boot::LastWords;

/// `OUTPUT_ENABLE`, PB0: high while the board is well and commands.
const OUTPUT_ENABLE: usize = 0;
/// `SRS_GATE`, PB10: high while the baseband should listen.
pub(crate) const SRS_GATE: usize = 10;

/// Makes the outputs safe. From any context, at any time, again and again; needs no driver and no clock but
/// that of the port, which it turns on.
///
/// Until it has been called first, and through every reset, both pins are inputs: the board that they lead
/// to pulls them down.
pub(crate) fn outputs() {
    pac::RCC.ahb1enr().modify(|w| w.set_gpioben(true));
    // The chip wants two cycles after a clock is turned on (errata ES0182, 2.1.13): reading it back takes them.
    let _ = pac::RCC.ahb1enr().read();
    for pin in [OUTPUT_ENABLE, SRS_GATE] {
        pac::GPIOB.bsrr().write(|w| w.set_br(pin, true));
        pac::GPIOB.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
    }
}

/// The board is well: what it says may be obeyed.
pub(crate) fn enable_outputs() {
    pac::GPIOB.bsrr().write(|w| w.set_bs(OUTPUT_ENABLE, true));
}

/// The end of this run, from any context: outputs safe, word left why, `log` called, reset.
///
/// `log` is left out where it was in it that things went wrong (the log of a fault that hit the log
/// would fail again, for ever).
pub(crate) fn reset(words: LastWords, log: impl FnOnce()) -> ! {
    static ENDING: AtomicBool = AtomicBool::new(false);
    outputs();
    if !ENDING.swap(true, Ordering::Relaxed) {
        super::supply::leave_word(words);
        log();
    }
    SCB::sys_reset()
}
