//! Running other programs, and what an xtask can fail with.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, io};

/// Why an xtask did not succeed.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The command line is wrong.
    Usage(String),
    /// A check, a build or a program did not succeed.
    Failed(String),
}

/// What an xtask returns.
pub(crate) type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    /// The exit status for the shell.
    pub(crate) fn exit_status(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            Self::Failed(_) => 1,
        }
    }

    /// A closure for `map_err` that says what was being done.
    pub(crate) fn while_doing<E: fmt::Display>(what: impl fmt::Display) -> impl FnOnce(E) -> Self {
        move |error| Self::Failed(format!("{what}: {error}"))
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(message) | Self::Failed(message) => f.write_str(message),
        }
    }
}

/// The root of the workspace, where every program is run.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."))
}

/// Where the host's builds land.
pub(crate) fn target_dir() -> PathBuf {
    root().join(env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// The host's cargo with `verb`: the one that runs this program, or else the first on the path.
pub(crate) fn cargo(verb: &str) -> Command {
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root()).arg(verb);
    command
}

/// Shows `command`, runs it with this program's input and output, and fails when it does.
pub(crate) fn run(command: &mut Command) -> Outcome {
    eprintln!("$ {}", shown(command));
    let status = command.status().map_err(not_started(command))?;
    if status.success() { Ok(()) } else { Err(Failure::Failed(format!("`{}`: {status}", shown(command)))) }
}

/// All of them succeeded, or what failed of each.
pub(crate) fn all(outcomes: impl Iterator<Item = Outcome>) -> Outcome {
    let faults: Vec<String> = outcomes.filter_map(|outcome| Some(outcome.err()?.to_string())).collect();
    if faults.is_empty() { Ok(()) } else { Err(Failure::Failed(faults.join("\n"))) }
}

/// What `command` prints, when it can be run and succeeds.
pub(crate) fn answer(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Names the program that could not be started, which mostly means that it is missing.
pub(crate) fn not_started(command: &Command) -> impl FnOnce(io::Error) -> Failure + use<> {
    Failure::while_doing(format!("cannot run `{}`", command.get_program().display()))
}

/// `command` as one would type it, programs by their short names.
pub(crate) fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let mut line = program.file_name().unwrap_or(program.as_os_str()).to_string_lossy().into_owned();
    for arg in command.get_args() {
        line.push(' ');
        line.push_str(&arg.to_string_lossy());
    }
    line
}
