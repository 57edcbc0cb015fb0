//! The tasks of the links that do not care what lies beneath them.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex as Raw;
use embassy_sync::channel::Channel;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embedded_io_async::{Read, Write};
use skyroost_firmware::board::autopilot::{FromAutopilot, Status};
use skyroost_firmware::board::bus_mode::{BusIntake, BusMode, Heard};
use skyroost_firmware::board::shell::Shell;

use super::{capture, stack_used};

/// What the board is for, once the bus has said so.
pub(crate) static MODE: Signal<Raw, BusMode> = Signal::new();
/// Messages of the autopilot and the timer's value when they came, on their way to guidance.
pub(crate) static MESSAGES: Channel<Raw, (FromAutopilot, u32), 8> = Channel::new();
/// Bytes for the radio: what its rate takes in a slot, and some.
pub(crate) static RADIO_OUT: Pipe<Raw, 2048> = Pipe::new();
/// How the board fares, for the log.
pub(crate) static STATUS: Signal<Raw, Status> = Signal::new();

/// Frames of the bus that came damaged or meant nothing.
pub(crate) static UNKNOWN: AtomicU32 = AtomicU32::new(0);
/// Messages that found [`MESSAGES`] full, and errors of the UARTs.
pub(crate) static LOST: AtomicU32 = AtomicU32::new(0);

/// Serves the host, should it be one that speaks.
#[embassy_executor::task]
pub(crate) async fn bench(shell: &'static Shell) {
    // The host's time is only in the steps: no timer of this board waits for it.
    shell.bus(|_| {}, stack_used).await;
}

/// Finds frames in the bytes of the radio.
#[embassy_executor::task]
pub(crate) async fn radio_frames(shell: &'static Shell) {
    shell.radio().await;
}

/// Writes the state of the board into the log.
#[embassy_executor::task]
pub(crate) async fn log(shell: &'static Shell) {
    loop {
        let status = STATUS.wait().await;
        let (damaged, overflowed, dropped) = shell.dropped().await;
        defmt::info!(
            "{}; radio: {=u32} damaged, {=u32} without room; flight code: {=u32} dropped; stack: {=u32} B",
            status,
            damaged,
            overflowed,
            dropped,
            stack_used()
        );
    }
}

/// Takes in what comes on the bus.
pub(crate) async fn read_bus(shell: &Shell, mut uart: impl Read) -> ! {
    let mut intake = BusIntake::new();
    let mut bytes = [0; 128];
    loop {
        let Ok(count) = uart.read(&mut bytes).await else {
            LOST.fetch_add(1, Ordering::Relaxed);
            continue;
        };
        let came = capture::now();
        let mut rest = bytes.get(..count).unwrap_or(&[]);
        while intake.mode() != BusMode::Bench
            && let Some((byte, tail)) = rest.split_first()
        {
            rest = tail;
            let before = intake.mode();
            match intake.push(*byte) {
                Some(Heard::Autopilot(message)) => {
                    if MESSAGES.try_send((message, came)).is_err() {
                        LOST.fetch_add(1, Ordering::Relaxed);
                    }
                }
                Some(Heard::Host(frame)) => shell.bus_in.write_all(&frame).await,
                None => {}
            }
            if intake.mode() != before {
                MODE.signal(intake.mode());
            }
        }
        UNKNOWN.store(intake.unknown(), Ordering::Relaxed);
        shell.bus_in.write_all(rest).await;
    }
}

/// Sends what is for the bus.
pub(crate) async fn write_bus(shell: &Shell, mut uart: impl Write) -> ! {
    let mut bytes = [0; 128];
    loop {
        let count = shell.bus_out.read(&mut bytes).await;
        write(&mut uart, bytes.get(..count).unwrap_or(&[])).await;
    }
}

/// Takes in the bytes of the radio.
pub(crate) async fn read_radio(shell: &Shell, mut uart: impl Read) -> ! {
    let mut bytes = [0; 128];
    loop {
        match uart.read(&mut bytes).await {
            Ok(count) => shell.radio_in.write_all(bytes.get(..count).unwrap_or(&[])).await,
            Err(_) => {
                LOST.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

/// Sends what is for the radio.
pub(crate) async fn write_radio(mut uart: impl Write) -> ! {
    let mut bytes = [0; 128];
    loop {
        let count = RADIO_OUT.read(&mut bytes).await;
        write(&mut uart, bytes.get(..count).unwrap_or(&[])).await;
    }
}

async fn write(uart: &mut impl Write, bytes: &[u8]) {
    if uart.write_all(bytes).await.is_err() {
        LOST.fetch_add(1, Ordering::Relaxed);
    }
}
