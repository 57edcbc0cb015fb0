//! Processes by what they bear in their environment: whoever their parent is by now, whatever they call themselves.

use rustix::process::{Pid, Signal, kill_process};
use std::fs;

/// Ids of all processes that have all of these variables, each as `NAME=value`, in their environment.
///
/// # Panics
/// When `/proc` cannot be read.
#[must_use]
pub fn bearing(variables: &[&str]) -> Vec<u32> {
    let ids = fs::read_dir("/proc").expect("/proc").flatten();
    ids.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .filter(|id| {
            let environment = fs::read(format!("/proc/{id}/environ")).unwrap_or_default();
            let has =
                |variable: &&str| environment.split(|byte| *byte == 0).any(|own| own == variable.as_bytes());
            variables.iter().all(has)
        })
        .collect()
}

/// Sends a process a signal; says whether there was one to get it.
#[must_use]
pub fn try_signal(process: u32, which: Signal) -> bool {
    let id = i32::try_from(process).ok().and_then(Pid::from_raw);
    id.is_some_and(|id| kill_process(id, which).is_ok())
}

/// State and parent of a process, as the letter and number in `/proc/ID/stat`; none when it is gone.
#[must_use]
pub fn state(process: u32) -> Option<(char, u32)> {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // After the name, which may hold anything.
    let mut words = stat.rsplit_once(')')?.1.split_whitespace();
    Some((words.next()?.chars().next()?, words.next()?.parse().ok()?))
}

/// The words that a process was started with; none when it is gone.
#[must_use]
pub fn words(process: u32) -> Vec<String> {
    let line = fs::read(format!("/proc/{process}/cmdline")).unwrap_or_default();
    line.split(|byte| *byte == 0).map(|word| String::from_utf8_lossy(word).into_owned()).collect()
}
