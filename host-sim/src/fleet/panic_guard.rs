//! Cleaning up when this program panics: its release build aborts then, and runs no destructor.

use std::{
    collections::BTreeMap,
    fs, panic,
    path::PathBuf,
    sync::{Mutex, Once, PoisonError},
};

/// Folders to remove and processes to kill, by the order in which they came.
static LEFT_BEHIND: Mutex<BTreeMap<u64, (u32, PathBuf)>> = Mutex::new(BTreeMap::new());

/// A process and its folder that go when this program panics.
#[derive(Debug)]
pub(super) struct PanicGuard {
    key: u64,
}

impl PanicGuard {
    /// From now on a panic kills `process` and removes `folder`.
    pub(super) fn new(process: u32, folder: PathBuf) -> Self {
        static HOOK: Once = Once::new();
        HOOK.call_once(|| {
            let before = panic::take_hook();
            panic::set_hook(Box::new(move |info| {
                before(info);
                clean_up();
            }));
        });
        let mut left = LEFT_BEHIND.lock().unwrap_or_else(PoisonError::into_inner);
        let key = left.last_key_value().map_or(0, |(key, _)| key + 1);
        left.insert(key, (process, folder));
        Self { key }
    }
}

impl Drop for PanicGuard {
    fn drop(&mut self) {
        LEFT_BEHIND.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.key);
    }
}

fn clean_up() {
    // A panic while the lock was held leaves the rest to the end of the FIFOs, which ends the emulators.
    let Ok(mut left) = LEFT_BEHIND.try_lock() else { return };
    for (process, folder) in std::mem::take(&mut *left).into_values() {
        if let Some(pid) = i32::try_from(process).ok().and_then(rustix::process::Pid::from_raw) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
        }
        let _ = fs::remove_dir_all(folder);
    }
}
