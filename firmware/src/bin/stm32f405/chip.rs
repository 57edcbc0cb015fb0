//! The chip: clocks, UARTs with DMA, timer, watchdog.

use cortex_m::peripheral::SCB;
use cortex_m::singleton;
use embassy_stm32::dma;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{DMA1_CH5, DMA1_CH6, DMA2_CH2, DMA2_CH7, USART1, USART2};
use embassy_stm32::usart::{self, RingBufferedUartRx, Uart, UartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, interrupt::typelevel};
use skyroost_firmware::board::autopilot::{Given, Start};
use skyroost_firmware::board::shell::Shell;

use super::given::Sector;
use super::ports::{self, BusRx, BusTx};
use super::{DRIVER_PRIORITY, Executors, capture, clocks, emulator, flight, links, safe, supply};

/// The watchdog resets the board when no step has ended for this long: ten slots at the nominal 32 kHz
/// of its own oscillator, 136 to 376 ms over that oscillator's range (17 to 47 kHz, data sheet DS8626).
const WATCHDOG_US: u32 = 200_000;

/// Rate of the bus.
const BUS_BAUD: u32 = 921_600;
/// Rate of the radio.
const RADIO_BAUD: u32 = 921_600;

/// What the DMA may take in while the links wait for guidance: at the rates above, 11 ms.
const DMA_BUFFER: usize = 1024;

bind_interrupts!(struct Irqs {
    DMA2_STREAM2 => dma::InterruptHandler<DMA2_CH2>;
    DMA2_STREAM7 => dma::InterruptHandler<DMA2_CH7>;
    DMA1_STREAM5 => dma::InterruptHandler<DMA1_CH5>;
    DMA1_STREAM6 => dma::InterruptHandler<DMA1_CH6>;
    USART2 => usart::InterruptHandler<USART2>;
});

// SAFETY: on the chip the handler below does nothing but call the driver's.
unsafe impl typelevel::Binding<typelevel::USART1, usart::InterruptHandler<USART1>> for Irqs {}

#[interrupt]
unsafe fn USART1() {
    if emulator::is_this() {
        emulator::on_usart1();
    } else {
        // SAFETY: this is the interrupt of that driver.
        unsafe { <usart::InterruptHandler<USART1> as typelevel::Handler<typelevel::USART1>>::on_interrupt() }
    }
}

/// Sets the chip up and spawns what only it has.
pub(crate) fn start(shell: &'static Shell, executors: &Executors) {
    let crystal = clocks::start_crystal();
    let mut config = embassy_stm32::Config::default();
    config.rcc = clocks::tree(crystal);
    config.dma_interrupt_priority = DRIVER_PRIORITY;
    let peripherals = embassy_stm32::init(config);
    safe::outputs(); // not before: that reset the ports
    if crystal {
        clocks::guard_crystal();
    }
    let started = supply::start();
    supply::guard();
    defmt::info!(
        "skyroost {=str} on stm32f405 after {=str} ({=u8:#09b}), last words: {=str}",
        env!("CARGO_PKG_VERSION"),
        started.cause.name(),
        started.cause.0,
        started.words.name(),
    );
    if !crystal {
        defmt::error!("the crystal does not start: nothing will be commanded");
    }
    capture::start(peripherals.PA0, peripherals.PA1, peripherals.PB10);
    interrupt::USART1.set_priority(DRIVER_PRIORITY);
    interrupt::USART2.set_priority(DRIVER_PRIORITY);
    let bus = Uart::new(
        peripherals.USART1,
        peripherals.PA10,
        peripherals.PA9,
        peripherals.DMA2_CH7,
        peripherals.DMA2_CH2,
        Irqs,
        at(BUS_BAUD),
    );
    let radio = Uart::new(
        peripherals.USART2,
        peripherals.PA3,
        peripherals.PA2,
        peripherals.DMA1_CH6,
        peripherals.DMA1_CH5,
        Irqs,
        at(RADIO_BAUD),
    );
    let bus_buffer = singleton!(: [u8; DMA_BUFFER] = [0; DMA_BUFFER]);
    let radio_buffer = singleton!(: [u8; DMA_BUFFER] = [0; DMA_BUFFER]);
    // Rates that the clock tree can divide, and buffers that nobody else has taken: constants of this image,
    // tried at every start.
    let (Ok(bus), Ok(radio), Some(bus_buffer), Some(radio_buffer)) = (bus, radio, bus_buffer, radio_buffer)
    else {
        SCB::sys_reset()
    };
    let (bus_tx, bus_rx) = bus.split();
    let (radio_tx, radio_rx) = radio.split();
    let bus_rx = bus_rx.into_ring_buffered(bus_buffer);
    let radio_rx = radio_rx.into_ring_buffered(radio_buffer);
    let start = Start {
        given: Given::Unread,
        reset_cause: started.cause.0,
        last_words: started.words as u8,
        crystal,
    };
    let watchdog = IndependentWatchdog::new(peripherals.IWDG, WATCHDOG_US);
    executors.guide(flight::guidance(shell, watchdog, Sector::new(peripherals.FLASH), start));
    executors.link(ports::read_bus(shell, BusRx::Chip(bus_rx)));
    executors.link(ports::write_bus(shell, BusTx::Chip(bus_tx)));
    executors.link(read_radio(shell, radio_rx));
    executors.link(write_radio(radio_tx));
    executors.link(links::log(shell));
}

fn at(baud: u32) -> usart::Config {
    let mut config = usart::Config::default();
    config.baudrate = baud;
    config
}

#[embassy_executor::task]
async fn read_radio(shell: &'static Shell, uart: RingBufferedUartRx<'static>) {
    links::read_radio(shell, uart).await;
}

#[embassy_executor::task]
async fn write_radio(uart: UartTx<'static, Async>) {
    links::write_radio(uart).await;
}
