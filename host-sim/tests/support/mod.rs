//! Runs the `skyroost` command as a script would.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// A directory of its own to run the command in.
pub(crate) struct Bench {
    subcommand: &'static str,
    dir: TempDir,
}

/// What a run of the command left.
pub(crate) struct Ran {
    /// Exit status.
    pub(crate) code: Option<i32>,
    /// Results.
    pub(crate) stdout: String,
    /// Logs and errors.
    pub(crate) stderr: String,
}

impl Bench {
    /// For the tests of a subcommand.
    pub(crate) fn of(subcommand: &'static str) -> Self {
        Self { subcommand, dir: tempfile::tempdir().expect("a temporary directory") }
    }

    /// Puts an input file into the directory.
    pub(crate) fn file(self, name: &str, text: &str) -> Self {
        fs::write(self.path(name), text).expect("an input file");
        self
    }

    /// Of something in the directory.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// The command in the directory, not yet started.
    pub(crate) fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_skyroost"));
        command.args(args).current_dir(self.dir.path()).stdin(Stdio::null()).env("COLUMNS", "100");
        command
    }

    /// Runs the command to its end.
    pub(crate) fn run(&self, args: &[&str]) -> Ran {
        let Output { status, stdout, stderr } = self.command(args).output().expect("the command starts");
        let text = |bytes| String::from_utf8(bytes).expect("output in UTF-8");
        Ran { code: status.code(), stdout: text(stdout), stderr: text(stderr) }
    }

    /// Names of everything in a directory below this one.
    pub(crate) fn names(&self, dir: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(dir)).expect("a directory");
        let name = |entry: std::io::Result<fs::DirEntry>| entry.expect("an entry").file_name();
        let mut names: Vec<String> =
            entries.map(name).map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// Runs the subcommand, which must refuse this as bad input: status 2, an error that holds `told`,
    /// nothing on stdout, nothing written.
    #[track_caller]
    pub(crate) fn refused(&self, args: &[&str], told: &[&str]) {
        let before = self.names(".");
        let ran = self.run(&[&[self.subcommand], args].concat());
        assert_eq!(ran.code, Some(2), "{}", ran.stderr);
        for told in told {
            assert!(ran.stderr.contains(told), "{told:?} is not in: {}", ran.stderr);
        }
        assert!(ran.stderr.starts_with("error: "), "{}", ran.stderr);
        assert_eq!(ran.stdout, "");
        assert_eq!(self.names("."), before);
    }
}
