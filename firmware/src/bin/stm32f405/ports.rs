//! The bus's UART, by DMA on the chip and by plain interrupts in the emulator: one task each way for both, as a task's memory is
//! set aside whether it runs or not.

use embassy_stm32::mode::Async;
use embassy_stm32::usart::{Error, RingBufferedUartRx, UartTx};
use embedded_io_async::{ErrorType, Read, Write};
use skyroost_firmware::board::shell::Shell;

use super::{emulator, links};

/// Where bytes of the bus come from.
pub(crate) enum BusRx {
    Chip(RingBufferedUartRx<'static>),
    Emulator(emulator::Port),
}

/// Where they go.
pub(crate) enum BusTx {
    Chip(UartTx<'static, Async>),
    Emulator(emulator::Port),
}

impl ErrorType for BusRx {
    type Error = Error;
}

impl Read for BusRx {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        match self {
            Self::Chip(uart) => uart.read(bytes).await,
            Self::Emulator(port) => Ok(port.read(bytes).await),
        }
    }
}

impl ErrorType for BusTx {
    type Error = Error;
}

impl Write for BusTx {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        match self {
            Self::Chip(uart) => uart.write(bytes).await.map(|()| bytes.len()),
            Self::Emulator(port) => Ok(port.write(bytes)),
        }
    }

    async fn flush(&mut self) -> Result<(), Error> {
        Ok(())
    }
}

#[embassy_executor::task]
pub(crate) async fn read_bus(shell: &'static Shell, uart: BusRx) {
    links::read_bus(shell, uart).await;
}

#[embassy_executor::task]
pub(crate) async fn write_bus(shell: &'static Shell, uart: BusTx) {
    links::write_bus(shell, uart).await;
}
