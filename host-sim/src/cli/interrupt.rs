//! Ctrl-C and SIGTERM as a flag that long work polls, so that an interrupted run can clean up.

use super::console::Console;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set once the user wants the run to end.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// From here on an interrupt sets the flag that is returned and does nothing else.
pub(super) fn flag(console: &Console) -> &'static AtomicBool {
    if let Err(error) = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed)) {
        console.log(&format!("warning: interrupts will not be cleaned up after: {error}"));
    }
    &INTERRUPTED
}
