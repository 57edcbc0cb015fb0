//! The clock tree.

use embassy_stm32::pac;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;

/// Reads of the ready flag that a crystal is given: some 10 cycles each at 16 MHz, so 200 ms, a hundred
/// times the typical start (data sheet DS8626, 5.3.8).
const CRYSTAL_PATIENCE: u32 = 320_000;

/// Starts the 8 MHz crystal; says whether it runs.
pub(crate) fn start_crystal() -> bool {
    pac::RCC.cr().modify(|w| w.set_hseon(true));
    (0..CRYSTAL_PATIENCE).any(|_| pac::RCC.cr().read().hserdy())
}

/// 168 MHz, the highest this chip allows (RM0090, section 7).
///
/// 2 MHz into the PLL, x 168 = 336 MHz inside, / 2 = 168 MHz for core and AHB, / 7 = 48 MHz for USB. APB1
/// runs at 42 MHz (its timers, among them the 32-bit TIM2 and TIM5, at 84 MHz), APB2 at 84 MHz (its timers
/// at 168 MHz).
///
/// The 2 MHz come from the crystal, divided by 4. Where it does not start they come from the internal
/// oscillator, divided by 8: a per cent off, good enough to say what is wrong, not to fly.
pub(crate) fn tree(crystal: bool) -> embassy_stm32::rcc::Config {
    let mut rcc = embassy_stm32::rcc::Config::new();
    let prediv = if crystal {
        rcc.hse = Some(Hse { freq: Hertz::mhz(8), mode: HseMode::Oscillator });
        rcc.pll_src = PllSource::HSE;
        PllPreDiv::DIV4
    } else {
        rcc.pll_src = PllSource::HSI;
        PllPreDiv::DIV8
    };
    rcc.pll = Some(Pll {
        prediv,
        mul: PllMul::MUL168,
        divp: Some(PllPDiv::DIV2),
        divq: Some(PllQDiv::DIV7),
        divr: None,
    });
    rcc.sys = Sysclk::PLL1_P;
    rcc.ahb_pre = AHBPrescaler::DIV1;
    rcc.apb1_pre = APBPrescaler::DIV4;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc
}

/// From now on a crystal that stops raises the NMI (clock security system, RM0090 7.2.7).
pub(crate) fn guard_crystal() {
    pac::RCC.cr().modify(|w| w.set_csson(true));
}
