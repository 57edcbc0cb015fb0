//! `cargo xtask`: set-up, checks, board images and benches of skyroost.
//!
//! Plain Rust without dependencies, so that it builds in seconds on a machine that has nothing yet.

mod bench;
mod budget;
mod check;
mod faults;
mod firmware;
mod fuzz;
mod image;
mod process;
mod proof;
mod setup;
mod toolchain;

use std::env;
use std::fmt::Write as _;
use std::process::ExitCode;

use process::{Failure, Outcome};

/// One word of the command line.
struct Subcommand {
    name: &'static str,
    summary: &'static str,
    help: &'static str,
    run: fn(&[String]) -> Outcome,
}

/// Everything `cargo xtask` can do.
const SUBCOMMANDS: [Subcommand; 6] = [
    Subcommand {
        name: "setup",
        summary: "install what the cross build, the emulator and the page tests need",
        help: setup::HELP,
        run: setup::run,
    },
    Subcommand { name: "test", summary: "run every check", help: check::HELP, run: check::run },
    Subcommand {
        name: "faults",
        summary: "fly missions to which random things happen",
        help: faults::HELP,
        run: faults::run,
    },
    Subcommand {
        name: "firmware",
        summary: "build a board's image",
        help: firmware::HELP,
        run: firmware::run,
    },
    Subcommand {
        name: "fuzz",
        summary: "give decoders and readers of files random bytes",
        help: fuzz::HELP,
        run: fuzz::run,
    },
    Subcommand {
        name: "bench",
        summary: "run the benches, compare avoidance, or hold the boards against their budgets",
        help: bench::HELP,
        run: bench::run,
    },
];

fn main() -> ExitCode {
    let args: Vec<String> = env::args().skip(1).collect();
    match dispatch(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("xtask: {failure}");
            ExitCode::from(failure.exit_status())
        }
    }
}

/// Runs the subcommand that `args` names, or prints the help it asks for.
fn dispatch(args: &[String]) -> Outcome {
    let Some((word, rest)) = args.split_first() else {
        return Err(Failure::Usage(format!("a subcommand is missing\n\n{}", overview())));
    };
    if is_help(word) {
        print!("{}", overview());
        return Ok(());
    }
    let Some(subcommand) = SUBCOMMANDS.iter().find(|s| s.name == word) else {
        return Err(Failure::Usage(format!("unknown subcommand `{word}`\n\n{}", overview())));
    };
    if rest.iter().any(|arg| is_help(arg)) {
        print!("{}", subcommand.help);
        return Ok(());
    }
    (subcommand.run)(rest).map_err(|failure| match failure {
        Failure::Usage(message) => Failure::Usage(format!("{message}\n\n{}", subcommand.help)),
        other => other,
    })
}

fn is_help(word: &str) -> bool {
    matches!(word, "help" | "--help" | "-h")
}

/// The help of `cargo xtask` itself.
fn overview() -> String {
    let mut text = String::from("Usage: cargo xtask SUBCOMMAND [--help]\n\n");
    for Subcommand { name, summary, .. } in &SUBCOMMANDS {
        let _ = writeln!(text, "  {name:10} {summary}"); // a String takes every write
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exit_status(words: &[&str]) -> u8 {
        let args: Vec<String> = words.iter().map(ToString::to_string).collect();
        dispatch(&args).map_or_else(|failure| failure.exit_status(), |()| 0)
    }

    #[test]
    fn unknown_words_are_wrong_usage() {
        for words in [
            &[][..],
            &["frobnicate"],
            &["test", "fast"],
            &["setup", "--yes"],
            &["faults", "--missions"],
            &["faults", "--seed", "x"],
            &["faults", "now"],
            &["bench", "a", "b"],
            &["bench", "--quick"],
            &["bench", "a", "--slow"],
            &["bench", "--slow", "a"],
            &["fuzz", "frame"],
            &["fuzz", "--seconds"],
            &["fuzz", "--list", "--quick"],
            &["firmware"],
            &["firmware", "stm32f405"],
            &["firmware", "--board"],
            &["firmware", "--board", "toaster"],
            &["firmware", "--board", "step_proof", "--size"],
            &["firmware", "--board", "stm32f405", "--board", "stm32f405"],
        ] {
            assert_eq!(exit_status(words), 2, "{words:?}");
        }
    }

    #[test]
    fn every_subcommand_has_help() {
        assert_eq!(exit_status(&["--help"]), 0);
        for subcommand in &SUBCOMMANDS {
            assert_eq!(exit_status(&[subcommand.name, "--help"]), 0);
            assert!(subcommand.help.starts_with(&format!("Usage: cargo xtask {}", subcommand.name)));
        }
    }
}
