//! The host's files, by semihosting (Arm IHI 0105): calls that the emulator itself answers.

use cortex_m_semihosting::{debug, syscall};

/// Modes of `SYS_OPEN`: `rb` and `wb` of the C library.
const READ: usize = 1;
const WRITE: usize = 5;

/// A file of the host.
#[derive(Clone, Copy)]
pub(crate) struct File(usize);

impl File {
    /// Opens the file called `name`, which ends with a zero.
    fn open(name: &[u8], mode: usize) -> Option<Self> {
        // SAFETY: the name lives through the call and its length leaves out the zero, as the call wants.
        let handle = unsafe { syscall!(OPEN, name.as_ptr(), mode, name.len() - 1) };
        (handle as isize >= 0).then_some(Self(handle))
    }

    /// The file that the log goes to.
    pub(crate) fn log() -> Option<Self> {
        Self::open(b"board.log\0", WRITE)
    }

    /// Writes all of `bytes`; what the host will not take is gone, as the host then is.
    pub(crate) fn write(self, bytes: &[u8]) {
        // SAFETY: the bytes live through the call.
        unsafe { syscall!(WRITE, self.0, bytes.as_ptr(), bytes.len()) };
    }
}

/// Both directions of the bus.
pub(crate) struct Bus {
    from_host: File,
    to_host: File,
}

impl Bus {
    /// Opens the FIFOs, in the order in which the host does.
    pub(crate) fn open() -> Option<Self> {
        let from_host = File::open(b"bus.in\0", READ)?;
        let to_host = File::open(b"bus.out\0", WRITE)?;
        Some(Self { from_host, to_host })
    }

    /// Waits for bytes of the host and says how many came; none at the end.
    pub(crate) fn read(&mut self, bytes: &mut [u8]) -> Option<usize> {
        // SAFETY: the bytes live through the call and nobody else looks at them; it writes no more than
        // their number and returns how many of them it left alone.
        let left = unsafe { syscall!(READ, self.from_host.0, bytes.as_mut_ptr(), bytes.len()) };
        bytes.len().checked_sub(left).filter(|count| *count > 0)
    }

    /// Writes all of `bytes`.
    pub(crate) fn write(&mut self, bytes: &[u8]) {
        self.to_host.write(bytes);
    }
}

/// Ends the emulator.
pub(crate) fn exit(well: bool) -> ! {
    debug::exit(if well { debug::EXIT_SUCCESS } else { debug::EXIT_FAILURE });
    // The call does not return under an emulator; without one there is nobody to end.
    loop {
        cortex_m::asm::wfi();
    }
}
