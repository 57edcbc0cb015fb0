//! Result files that appear whole or not at all.
//!
//! Files are written under temporary names in the directory where they belong and renamed together
//! at the end. Whatever ends a run before (an error, an interrupt) leaves the directory as it was
//! found, earlier results included; a directory made for the run disappears again.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The directory or a file in it cannot be written.
#[derive(Debug, Error)]
#[error("{option}: {}: cannot be written: {source}; expected a directory that can be written to", path.display())]
pub(super) struct OutputError {
    /// The option that names the directory.
    option: &'static str,
    path: PathBuf,
    source: io::Error,
}

/// A directory with files on their way into it.
#[derive(Debug)]
pub(super) struct OutputDir {
    /// The option that names it.
    option: &'static str,
    dir: PathBuf,
    /// Directories made for this run, outermost first.
    made: Vec<PathBuf>,
    /// Files written and not yet renamed: temporary and final path.
    staged: Vec<(PathBuf, PathBuf)>,
}

impl OutputDir {
    /// Makes the directory that `option` names, if it is missing, and proves that files can be written in it.
    pub(super) fn prepare(option: &'static str, dir: &Path) -> Result<Self, OutputError> {
        // Drop cleans up whatever was made when a later step fails.
        let mut output = Self { option, dir: dir.to_owned(), made: Vec::new(), staged: Vec::new() };
        for path in dir.ancestors().collect::<Vec<_>>().into_iter().rev() {
            // Asked anew at each step: in `new/..` the second part exists once the first was made.
            if path.as_os_str().is_empty() || path.is_dir() {
                continue;
            }
            fs::create_dir(path).map_err(|source| output.error(path, source))?;
            output.made.push(path.to_owned());
        }
        let probe = output.temporary("probe");
        File::create(&probe)
            .and_then(|_| fs::remove_file(&probe))
            .map_err(|source| output.error(dir, source))?;
        Ok(output)
    }

    fn error(&self, path: &Path, source: io::Error) -> OutputError {
        OutputError { option: self.option, path: path.to_owned(), source }
    }

    /// Writes one file under a temporary name.
    pub(super) fn stage<E: Into<io::Error>>(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
    ) -> Result<(), OutputError> {
        let (temporary, path) = (self.temporary(name), self.dir.join(name));
        self.staged.push((temporary.clone(), path.clone()));
        let written = File::create(temporary).and_then(|file| {
            let mut file = BufWriter::new(file);
            write(&mut file).map_err(Into::into)?;
            file.flush()?;
            // On disk before the rename: a power cut must not leave a short file under a final name.
            file.get_ref().sync_all()
        });
        written.map_err(|source| self.error(&path, source))
    }

    /// Gives every file its final name.
    pub(super) fn commit(mut self) -> Result<(), OutputError> {
        for (temporary, path) in &self.staged {
            fs::rename(temporary, path).map_err(|source| self.error(path, source))?;
        }
        self.staged.clear();
        self.made.clear();
        Ok(())
    }

    /// A name that neither a result nor another run has.
    fn temporary(&self, name: &str) -> PathBuf {
        self.dir.join(format!(".{name}.{}.partial", std::process::id()))
    }
}

impl Drop for OutputDir {
    fn drop(&mut self) {
        // Best effort: a file already renamed or never made is not there to be removed, and
        // `remove_dir` refuses a directory that holds anything.
        for (temporary, _) in &self.staged {
            let _ = fs::remove_file(temporary);
        }
        for dir in self.made.iter().rev() {
            let _ = fs::remove_dir(dir);
        }
    }
}

/// Files on their way into a directory.
pub(super) fn staged(
    option: &'static str,
    dir: &Path,
    files: &[(String, String)],
) -> Result<OutputDir, OutputError> {
    let mut output = OutputDir::prepare(option, dir)?;
    for (name, text) in files {
        output.stage(name, |file| -> io::Result<()> { file.write_all(text.as_bytes()) })?;
    }
    Ok(output)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(dir)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    fn put(output: &mut OutputDir, name: &str, text: &str) -> Result<(), OutputError> {
        output.stage(name, |file| file.write_all(text.as_bytes()))
    }

    #[test]
    fn files_appear_together_at_the_commit() -> Result<(), Box<dyn std::error::Error>> {
        let root = tempfile::tempdir()?;
        let dir = root.path().join("a/b");
        let mut output = OutputDir::prepare("--out", &dir)?;
        put(&mut output, "one.txt", "1")?;
        put(&mut output, "two.txt", "2")?;
        assert!(names(&dir).iter().all(|name| name.ends_with(".partial")), "{:?}", names(&dir));
        output.commit()?;
        assert_eq!(names(&dir), ["one.txt", "two.txt"]);
        assert_eq!(fs::read_to_string(dir.join("two.txt"))?, "2");
        Ok(())
    }

    #[test]
    fn an_interrupted_run_leaves_nothing_of_its_own() -> Result<(), Box<dyn std::error::Error>> {
        let root = tempfile::tempdir()?;
        let mut output = OutputDir::prepare("--out", &root.path().join("a/b"))?;
        put(&mut output, "one.txt", "1")?;
        drop(output);
        assert!(names(root.path()).is_empty());
        Ok(())
    }

    #[test]
    fn an_interrupted_run_leaves_what_was_there() -> Result<(), Box<dyn std::error::Error>> {
        let root = tempfile::tempdir()?;
        fs::write(root.path().join("one.txt"), "earlier")?;
        let mut output = OutputDir::prepare("--out", root.path())?;
        put(&mut output, "one.txt", "later")?;
        drop(output);
        assert_eq!(names(root.path()), ["one.txt"]);
        assert_eq!(fs::read_to_string(root.path().join("one.txt"))?, "earlier");
        Ok(())
    }

    #[test]
    fn a_failed_write_leaves_nothing_of_its_own() -> Result<(), Box<dyn std::error::Error>> {
        let root = tempfile::tempdir()?;
        let mut output = OutputDir::prepare("--out", &root.path().join("out"))?;
        put(&mut output, "one.txt", "1")?;
        let full = output.stage("two.txt", |file| {
            file.write_all(b"half")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert!(full.is_err_and(|error| error.to_string().contains("two.txt")));
        drop(output);
        assert!(names(root.path()).is_empty());
        Ok(())
    }

    #[test]
    fn a_directory_below_a_file_is_refused() -> Result<(), Box<dyn std::error::Error>> {
        let root = tempfile::tempdir()?;
        let file = root.path().join("file");
        fs::write(&file, "")?;
        let refused = OutputDir::prepare("--out", &file.join("out"));
        assert!(refused.is_err_and(|error| error.to_string().contains("file")));
        assert_eq!(names(root.path()), ["file"]);
        Ok(())
    }
}
