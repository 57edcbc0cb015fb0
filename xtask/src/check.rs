//! `cargo xtask test`: every check, in order, up to the first that fails.

use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};
use std::time::Instant;
use std::{fmt, io};

use crate::bench::{self, Thoroughness};
use crate::firmware::{self, BOARDS, Board, STEP_PROOF};
use crate::process::{self, Failure, Outcome, cargo, target_dir};
use crate::setup;

pub(crate) const HELP: &str = "\
Usage: cargo xtask test

Runs every check in this order and stops at the first that fails:

  setup    what the checks need is there, or gets installed
  format   cargo fmt --check
  lint     clippy on the host, warnings denied
  cross    the flight code and every board's image: clippy, build, flash, RAM and stack within
           firmware/budgets.toml, no panic, allocation or recursion in a step; and the link of
           step_proof, which fails where the flight code can panic
  build    polars' reader of Parquet
  test     unit, property, documentation and mission tests, and some seconds of `cargo xtask fuzz`
  budget   instructions and stack of the worst steps on the emulated board
  doc      documentation, warnings denied
";

/// A check: its name in [`HELP`], and what it does. It may add to the count of tests.
type Step = (&'static str, fn(&mut TestCount) -> Outcome);

const STEPS: [Step; 8] = [
    ("setup", |_| setup::ensure(&setup::ALL)),
    ("format", |_| {
        process::run(cargo("fmt").args(["--all", "--check"]))?;
        process::run(cargo("fmt").args(["--check", POLARS]))
    }),
    ("lint", |_| process::run(cargo("clippy").args(HOST).args(["--all-targets", "--", "-D", "warnings"]))),
    ("cross", |_| cross()), // before the tests, which fly missions on the emulated image
    ("build", |_| process::run(cargo("build").args(["--locked", POLARS, "--target-dir=target/polars"]))),
    ("test", test),
    ("budget", |_| bench::hold_boards(Thoroughness::Quick)), // with what the tests have built
    ("doc", |_| process::run(cargo("doc").args(HOST).arg("--no-deps").env("RUSTDOCFLAGS", "-D warnings"))),
];

/// What reads Parquet for a test, on its own because of what it is made of.
const POLARS: &str = "--manifest-path=tests/polars/Cargo.toml";

/// Everything that runs on the host, with the versions in Cargo.lock.
const HOST: [&str; 2] = ["--workspace", "--locked"];

/// `cargo xtask test`.
pub(crate) fn run(args: &[String]) -> Outcome {
    if let Some(word) = args.first() {
        return Err(Failure::Usage(format!("unknown word `{word}`")));
    }
    let begun = Instant::now();
    let mut count = TestCount::default();
    let mut times = Vec::new();
    for (name, step) in STEPS {
        eprintln!("\n=== {name}");
        let step_begun = Instant::now();
        let outcome = step(&mut count);
        let step_s = step_begun.elapsed().as_secs_f64();
        if let Err(failure) = outcome {
            return Err(Failure::Failed(format!("{name} failed after {step_s:.1} s: {failure}")));
        }
        eprintln!("=== {name}: ok, {step_s:.1} s");
        times.push(format!("{name} {step_s:.1}"));
    }
    println!("\nseconds: {}", times.join(", "));
    println!("every check passed in {:.0} s", begun.elapsed().as_secs_f64());
    println!("tests: {count}");
    Ok(())
}

/// Runs the tests, shows what they print as they print it, and counts them.
fn test(count: &mut TestCount) -> Outcome {
    let binary = target_dir().join("checks").join("skyroost");
    let mut command = cargo("test");
    command.args(HOST).args(["--profile=checks", "--no-fail-fast"]).env("SKYROOST_BIN", binary);
    command.env("SKYROOST_BOARD_IMAGE", firmware::EMULATED.image());
    eprintln!("$ {}", process::shown(&command));
    let mut child = command.stdout(Stdio::piped()).spawn().map_err(process::not_started(&command))?;
    let lines = child.stdout.take().map(BufReader::new);
    for line in lines.into_iter().flat_map(BufRead::lines) {
        let line = line.map_err(Failure::while_doing("reading what the tests print"))?;
        count.add(&line);
        let _ = writeln!(io::stdout(), "{line}"); // a closed pipe is no reason to stop testing
    }
    let status = child.wait().map_err(process::not_started(&command))?;
    if !status.success() {
        return Err(Failure::Failed(format!("{count}; {status}")));
    }
    if count.passed == 0 {
        return Err(Failure::Failed("no test was run".into()));
    }
    Ok(())
}

/// Lints and builds the flight code for its processor, bare and as every board's image, and looks
/// whether the images are fit to fly: all of them, also where one is not.
fn cross() -> Outcome {
    let toolchain = firmware::toolchain()?;
    let lint = |command: &mut Command| process::run(command.args(["--", "-D", "warnings"]));
    lint(toolchain.cargo("clippy").args([
        "--package=skyroost-protocol",
        "--package=skyroost-firmware",
        "--lib",
    ]))?;
    let check = |board: &Board| {
        lint(toolchain.cargo("clippy").args(board.cargo_args()))?;
        board.check(&board.build(toolchain)?, Vec::new())
    };
    process::all(BOARDS.iter().map(check))?;
    // That it links is the proof.
    lint(toolchain.cargo("clippy").args(STEP_PROOF.cargo_args()))?;
    STEP_PROOF.build(toolchain).map(drop)
}

/// How many tests have been run, by what libtest says of each program.
#[derive(Debug, Default, PartialEq, Eq)]
struct TestCount {
    passed: u64,
    failed: u64,
    ignored: u64,
}

impl TestCount {
    /// Takes up a line of output if it is one of those that close a test program:
    /// `test result: ok. 5 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.00s`.
    fn add(&mut self, line: &str) {
        let Some((_, counts)) = line.strip_prefix("test result: ").and_then(|rest| rest.split_once(". "))
        else {
            return;
        };
        for part in counts.split("; ") {
            match part.split_once(' ').map(|(number, what)| (number.parse::<u64>(), what)) {
                Some((Ok(number), "passed")) => self.passed += number,
                Some((Ok(number), "failed")) => self.failed += number,
                Some((Ok(number), "ignored")) => self.ignored += number,
                _ => {}
            }
        }
    }
}

impl fmt::Display for TestCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed, {} failed", self.passed, self.failed)?;
        if self.ignored > 0 { write!(f, ", {} skipped", self.ignored) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::root;

    #[test]
    fn closing_lines_of_test_programs_are_added_up() {
        let mut count = TestCount::default();
        for line in [
            "running 5 tests",
            "test a ... ok",
            "test result: ok. 5 passed; 0 failed; 1 ignored; 0 measured; 2 filtered out; finished in 0.00s",
            "test result: FAILED. 3 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.20s",
            "a test result: ok. 9 passed; 9 failed",
        ] {
            count.add(line);
        }
        assert_eq!(count, TestCount { passed: 8, failed: 2, ignored: 1 });
        assert_eq!(count.to_string(), "8 passed, 2 failed, 1 skipped");
    }

    #[test]
    fn the_help_lists_the_steps_in_order() {
        let mut rest = HELP;
        for (name, _) in STEPS {
            let at =
                rest.find(&format!("\n  {name} ")).unwrap_or_else(|| panic!("{name} is not in its place"));
            rest = &rest[at + 1..];
        }
    }

    #[test]
    fn continuous_integration_runs_this_and_nothing_else() {
        let script = std::fs::read_to_string(root().join(".ci/run")).unwrap();
        assert_eq!(script.lines().last(), Some("cargo xtask test"));
    }
}
