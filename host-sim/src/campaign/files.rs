//! Files that appear whole or not at all, also where a machine is cut off in the middle.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// A file of a campaign cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be {what}: {source}; expected a directory of a campaign that can be written to", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What was to be done to it.
    what: &'static str,
    /// What the system says.
    pub source: io::Error,
}

/// Turns the system's complaint about a path into ours.
pub(super) fn failed(path: &Path, what: &'static str) -> impl FnOnce(io::Error) -> FileError {
    move |source| FileError { path: path.to_owned(), what, source }
}

/// What names of files end with that are still being written.
pub(super) const PARTIAL: &str = ".partial";

/// Writes a file under a name that nobody else has, then renames it: readers see it whole or not at all.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    static WRITTEN: AtomicU64 = AtomicU64::new(0);
    let (dir, name) = (path.parent().unwrap_or(Path::new("")), path.file_name().unwrap_or_default());
    // Unique on this machine by process and count; on others, which share the directory, by the time of day.
    let nanos = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.subsec_nanos());
    let count = WRITTEN.fetch_add(1, Ordering::Relaxed);
    let own = format!(".{}.{}-{count}-{nanos}{PARTIAL}", name.to_string_lossy(), std::process::id());
    let partial = dir.join(own);
    let written = File::create(&partial)
        .and_then(|mut file| {
            file.write_all(bytes)?;
            // On disk before the rename: a power cut must not leave a short file under a final name.
            file.sync_all()
        })
        .and_then(|()| fs::rename(&partial, path));
    written.map_err(|source| {
        let _ = fs::remove_file(&partial);
        failed(path, "written")(source)
    })
}

/// Removes what killed writers left in a directory.
pub(super) fn remove_partial(dir: &Path) {
    for entry in fs::read_dir(dir).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().ends_with(PARTIAL) {
            // Litter harms nobody: what cannot be removed may stay.
            let _ = fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole_and_leaves_no_litter() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csv");
        write_whole(&path, b"one").unwrap();
        write_whole(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        fs::write(dir.path().join(".a.csv.1-0-0.partial"), "half").unwrap();
        remove_partial(dir.path());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_directory_that_is_not_there_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let error = write_whole(&dir.path().join("none/a.csv"), b"").unwrap_err().to_string();
        assert!(error.contains("none/a.csv: cannot be written"), "{error}");
    }
}
