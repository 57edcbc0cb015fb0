//! defmt's log into a file of the host.

use super::host::File;
use core::cell::RefCell;
use critical_section::{Mutex, RestoreState};

/// A line of the log is written in pieces no longer than this.
const BUFFER: usize = 128;

struct State {
    encoder: defmt::Encoder,
    restore: RestoreState,
    file: Option<File>,
    buffer: heapless::Vec<u8, BUFFER>,
}

static STATE: Mutex<RefCell<State>> = Mutex::new(RefCell::new(State {
    encoder: defmt::Encoder::new(),
    restore: RestoreState::invalid(),
    file: None,
    buffer: heapless::Vec::new(),
}));

impl State {
    fn put(&mut self, encode: impl FnOnce(&mut defmt::Encoder, &mut dyn FnMut(&[u8]))) {
        let Self { encoder, file, buffer, .. } = self;
        encode(encoder, &mut |bytes| {
            if buffer.extend_from_slice(bytes).is_err() {
                write(file, buffer);
                buffer.clear();
                // A piece that is longer than the buffer goes by itself.
                if buffer.extend_from_slice(bytes).is_err() {
                    write(file, bytes);
                }
            }
        });
    }
}

fn write(file: &mut Option<File>, bytes: &[u8]) {
    if file.is_none() {
        *file = File::log();
    }
    if let Some(file) = file {
        file.write(bytes);
    }
}

/// Does something with the state while the logger is held.
fn with_state(act: impl FnOnce(&mut State)) {
    critical_section::with(|cs| {
        if let Ok(mut state) = STATE.borrow(cs).try_borrow_mut() {
            act(&mut state);
        }
    });
}

#[defmt::global_logger]
struct Logger;

// SAFETY: between `acquire` and `release` interrupts are off, so no other context can log.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: `release` restores what this saves, as defmt calls both in pairs.
        let restore = unsafe { critical_section::acquire() };
        with_state(|state| {
            state.restore = restore;
            state.put(|encoder, put| encoder.start_frame(put));
        });
    }

    unsafe fn flush() {}

    unsafe fn release() {
        let mut restore = RestoreState::invalid();
        with_state(|state| {
            state.put(|encoder, put| encoder.end_frame(put));
            let State { file, buffer, .. } = state;
            write(file, buffer);
            buffer.clear();
            restore = state.restore;
        });
        // SAFETY: this is what `acquire` saved.
        unsafe { critical_section::release(restore) };
    }

    unsafe fn write(bytes: &[u8]) {
        with_state(|state| state.put(|encoder, put| encoder.write(bytes, put)));
    }
}
