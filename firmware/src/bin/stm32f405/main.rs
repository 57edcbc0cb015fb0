//! The flight board: an STM32F405RG with an 8 MHz crystal, as on most flight controllers and
//! evaluation boards of this chip, running at its full 168 MHz.
//!
//! The image is a shell: it owns the drivers and the clock, steps the flight code on the 50 Hz grid and
//! logs over RTT. Whatever goes wrong in flight ends in a reset: a panic asks for one, a hang or a fault
//! is met by the watchdog, which runs from the first step on. Before it, a crystal that does not start
//! keeps the board where it is: on the ground.
//!
//! Built and linted by every check, but not yet flown: no hardware has run it so far.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::time::Hertz;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Instant, Timer};
use skyroost_firmware::agent::FlightAgent;
use skyroost_firmware::board::cadence::Cadence;
use skyroost_firmware::config::AgentConfig;
use skyroost_firmware::io::{Inputs, Outputs};
use skyroost_protocol::units::{DroneId, TimePs};

/// The watchdog resets the board when no step has ended for this long: ten slots at the nominal 32 kHz
/// of its own oscillator, 136 to 376 ms over that oscillator's range (17 to 47 kHz, data sheet DS8626).
const WATCHDOG_US: u32 = 200_000;

/// Steps between two reports of the loop's punctuality: ten seconds.
const STEPS_PER_REPORT: u32 = 500;

/// 168 MHz from the 8 MHz crystal, the highest this chip allows (RM0090, section 7).
///
/// 8 MHz / 4 = 2 MHz into the PLL, x 168 = 336 MHz inside, / 2 = 168 MHz for core and AHB, / 7 = 48 MHz
/// for USB. APB1 runs at 42 MHz (its timers, among them the 32-bit TIM2 and TIM5, at 84 MHz), APB2 at
/// 84 MHz (its timers at 168 MHz).
fn clock_tree() -> embassy_stm32::Config {
    use embassy_stm32::rcc::{
        AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk,
    };
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(Hse { freq: Hertz::mhz(8), mode: HseMode::Oscillator });
    config.rcc.pll_src = PllSource::HSE;
    config.rcc.pll = Some(Pll {
        prediv: PllPreDiv::DIV4,
        mul: PllMul::MUL168,
        divp: Some(PllPDiv::DIV2),
        divq: Some(PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let peripherals = embassy_stm32::init(clock_tree());
    defmt::info!("skyroost {=str} on stm32f405", env!("CARGO_PKG_VERSION"));
    // A task is refused only when it already runs; at start that means memory is not what it should be.
    let Ok(guidance) = guidance(IndependentWatchdog::new(peripherals.IWDG, WATCHDOG_US)) else {
        SCB::sys_reset();
    };
    spawner.spawn(guidance);
}

/// Steps the flight code at every slot of the grid and keeps the watchdog quiet while it does.
#[embassy_executor::task]
async fn guidance(mut watchdog: IndependentWatchdog<'static, IWDG>) {
    let mut cadence = Cadence::starting_at(Instant::now().as_micros());
    let mut agent = FlightAgent::new(AgentConfig::new(DroneId(1)));
    let (mut inputs, mut outputs) = (Inputs::default(), Outputs::default());
    watchdog.unleash();
    loop {
        Timer::at(Instant::from_micros(cadence.due_us())).await;
        let begun = Instant::now();
        // GNSS time until a receiver disciplines it. The drivers of radio, navigation and capture timer come
        // with the boards that carry them; until then the agent hears nothing and stays on the ground.
        let now = TimePs::from_us(begun.as_micros() as i64);
        outputs.clear();
        agent.step(now, &inputs, &mut outputs);
        inputs.clear();
        cadence.finished(begun.as_micros(), Instant::now().as_micros());
        watchdog.pet();
        if cadence.punctuality().steps.is_multiple_of(STEPS_PER_REPORT) {
            defmt::info!("{}", cadence.punctuality());
        }
    }
}

/// Says where, then resets: a drone is better served by a board that starts again than by one that halts.
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    SCB::sys_reset()
}
