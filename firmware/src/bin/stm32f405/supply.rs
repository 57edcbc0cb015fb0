//! Supply and resets: why the board has started, what it keeps for the next start, and when its supply falls.

use embassy_stm32::interrupt;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac;
use skyroost_firmware::board::boot::{LastWords, ResetCause};

use super::safe;

/// Backup register of the last words.
const WORDS: usize = 1;

/// How the board came to start.
#[derive(Clone, Copy)]
pub(crate) struct Start {
    pub(crate) cause: ResetCause,
    pub(crate) words: LastWords,
}

/// Reads why the chip was reset, and clears it; reads what was left in the backup registers. The clocks are set up: only then is the backup domain what it stays, since a change of the
/// real-time clock's source would clear it.
pub(crate) fn start() -> Start {
    let csr = pac::RCC.csr();
    let cause = ResetCause::from_csr(csr.read().0);
    csr.modify(|w| w.set_rmvf(true));
    csr.modify(|w| w.set_rmvf(false));
    let words = LastWords::from_register(pac::RTC.bkpr(WORDS).read().bkp());
    leave_word(LastWords::None);
    Start { cause, words }
}

/// Leaves word for the next start. From any context.
pub(crate) fn leave_word(words: LastWords) {
    pac::RCC.apb1enr().modify(|w| w.set_pwren(true));
    pac::PWR.cr1().modify(|w| w.set_dbp(true));
    pac::RTC.bkpr(WORDS).write(|w| w.set_bkp(words.register()));
}

/// Threshold of the supply supervisor: the highest, typically 3.03 V falling and 3.14 V rising (data sheet
/// DS8626, 5.3.5), 200 mV above the brown-out reset that the option bytes should be set to.
const HIGHEST: u8 = 7;
/// The line of the supervisor at the interrupt controller (RM0090, 12.2.5).
const EXTI_PVD: usize = 16;

/// From now on a falling supply raises an interrupt before the brown-out reset.
pub(crate) fn guard() {
    pac::PWR.cr1().modify(|w| {
        w.set_pls(HIGHEST);
        w.set_pvde(true);
    });
    // The supervisor's output rises as the supply falls.
    pac::EXTI.rtsr(0).modify(|w| w.set_line(EXTI_PVD, true));
    pac::EXTI.pr(0).write(|w| w.set_line(EXTI_PVD, true));
    pac::EXTI.imr(0).modify(|w| w.set_line(EXTI_PVD, true));
    // SAFETY: the handler below needs nothing but the registers it names.
    unsafe { interrupt::PVD.enable() };
}

#[interrupt]
unsafe fn PVD() {
    safe::reset(LastWords::Supply, || {
        defmt::error!("the supply falls");
        // Down to the brown-out reset, or up again; should this take long, the watchdog ends it.
        while pac::PWR.csr1().read().pvdo() {}
    })
}
