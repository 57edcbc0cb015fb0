//! `cargo xtask bench`: how fast the host's code is.

use crate::process::{self, Failure, Outcome, cargo};

pub(crate) const HELP: &str = "\
Usage: cargo xtask bench [NAME]

Runs every bench of the host's packages, or only the bench target NAME. Criterion keeps the figures in
target/criterion/ and compares them with those of the run before.
";

/// `cargo xtask bench`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let target = match args {
        [] => "*",
        [name] if !name.starts_with('-') => name,
        [word, ..] if word.starts_with('-') => {
            return Err(Failure::Usage(format!("unknown option `{word}`")));
        }
        _ => return Err(Failure::Usage("more than one bench".into())),
    };
    process::run(cargo("bench").args(["--locked", "--bench", target]))
}
