//! Two FIFOs as a transport of the bus.

use crate::fleet::bus::Transport;
use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    fs::{CWD, FileType, Mode, mknodat},
};
use std::{
    fs::{File, OpenOptions},
    io::{self, Read, Write},
    os::unix::fs::OpenOptionsExt,
    path::Path,
    time::Duration,
};

/// Names of the FIFOs in the folder that the emulator runs in; the image opens them.
const TO_BOARD: &str = "bus.in";
const FROM_BOARD: &str = "bus.out";

/// The host's ends.
#[derive(Debug)]
pub(super) struct Fifos {
    to_board: File,
    from_board: File,
}

impl Fifos {
    /// Makes both FIFOs.
    pub(super) fn make(folder: &Path) -> io::Result<()> {
        for name in [TO_BOARD, FROM_BOARD] {
            mknodat(CWD, folder.join(name), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)?;
        }
        Ok(())
    }

    /// Opens both once the board has opened the first; none while it has not.
    pub(super) fn open(folder: &Path) -> io::Result<Option<Self>> {
        let nonblocking = rustix::fs::OFlags::NONBLOCK.bits() as i32;
        // A FIFO without a reader cannot be opened for writing without waiting.
        let to_board = OpenOptions::new().write(true).custom_flags(nonblocking).open(folder.join(TO_BOARD));
        let to_board = match to_board {
            Err(error) if error.raw_os_error() == Some(rustix::io::Errno::NXIO.raw_os_error()) => {
                return Ok(None);
            }
            opened => opened?,
        };
        let from_board =
            OpenOptions::new().read(true).custom_flags(nonblocking).open(folder.join(FROM_BOARD))?;
        Ok(Some(Self { to_board, from_board }))
    }
}

/// Waits until `file` is ready or the time is up, and says which.
fn wait(file: &File, flags: PollFlags, timeout: Duration) -> io::Result<bool> {
    let timeout = Timespec::try_from(timeout).map_err(io::Error::other)?;
    loop {
        match poll(&mut [PollFd::new(file, flags)], Some(&timeout)) {
            Ok(ready) => return Ok(ready > 0),
            Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
}

impl Transport for Fifos {
    fn send(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.to_board.write(bytes) {
                Ok(count) => bytes = &bytes[count..],
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                // A step is much smaller than a FIFO: one that is full has not been read for long.
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    if !wait(&self.to_board, PollFlags::OUT, Duration::from_secs(1))? {
                        return Err(io::Error::new(
                            io::ErrorKind::TimedOut,
                            "the board does not read its bus",
                        ));
                    }
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn receive(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        loop {
            if !wait(&self.from_board, PollFlags::IN, timeout)? {
                return Ok(0);
            }
            match self.from_board.read(bytes) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Err(error)
                    if matches!(error.kind(), io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock) => {}
                result => return result,
            }
        }
    }
}
