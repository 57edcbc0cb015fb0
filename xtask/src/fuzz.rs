//! `cargo xtask fuzz`: gives decoders and readers of files random bytes for as long as one likes.

use std::process::Command;

use crate::process::{self, Failure, Outcome, cargo, root, target_dir};

pub(crate) const HELP: &str = "\
Usage: cargo xtask fuzz [--target NAME] [--seconds S] [--seed S]
       cargo xtask fuzz --target NAME (--hex DIGITS | --replay FILE)
       cargo xtask fuzz --list

Changes valid inputs at random and gives them to every decoder and every reader of files, which must neither panic nor
hang, and agree with themselves. Built as the tests are; `cargo xtask test` does some seconds of it, always with seed 1.

  --target NAME   one of those that --list names; without it all of them, one after the other
  --seconds S     for how long, shared out among the targets [default: 300]
  --seed S        the same inputs again; without it, others every time
  --hex DIGITS    the target gets this input and nothing else, as a failure prints it
  --replay FILE   the same, from a file, as a failure saves it in target/fuzz/

An input that breaks something is made small, printed and saved, with the command that replays it; exit status 1.

tests/fuzz/ has the same targets for cargo-fuzz, which looks at what is covered:
cargo +nightly fuzz run --fuzz-dir tests/fuzz NAME
";

/// Options, and whether they have a value.
const OPTIONS: [(&str, bool); 6] = [
    ("--target", true),
    ("--seconds", true),
    ("--seed", true),
    ("--hex", true),
    ("--replay", true),
    ("--list", false),
];

/// `cargo xtask fuzz`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let mut rest = args.iter();
    while let Some(word) = rest.next() {
        let Some((_, has_value)) = OPTIONS.iter().find(|(name, _)| name == word) else {
            return Err(Failure::Usage(format!("unknown word `{word}`")));
        };
        if *has_value && rest.next().is_none() {
            return Err(Failure::Usage(format!("`{word}` lacks its value")));
        }
    }
    // As the checks build it, or else everything would be compiled once more; the program comes with the test.
    let mut build = cargo("test");
    build.args(["--quiet", "--workspace", "--locked", "--profile=checks", "--test=fuzz", "--no-run"]);
    process::run(&mut build)?;
    let mut fuzz = Command::new(target_dir().join("checks").join("fuzz"));
    process::run(fuzz.current_dir(root()).args(args))
}
