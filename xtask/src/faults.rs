//! `cargo xtask faults`: missions to which random things happen.

use crate::process::{self, Failure, Outcome, cargo};

pub(crate) const HELP: &str = "\
Usage: cargo xtask faults [--missions N] [--seed S] [--replay SEED] [--json]

Flies random missions to which random things happen (drones that fail, boards that start anew, clocks
that jump, receivers that hang, links that lose and hold up, frames that somebody forged, control
centers that are killed), and holds what must never happen against them second by second.

  --missions N   so many missions [default: 500]
  --seed S       seed of the campaign, from which the seeds of its missions follow [default: 1]
  --replay SEED  fly the mission of this seed, as a failure names it, and show its scenario
  --json         one object: missions, completed, ended_safe, failed (seed, invariant, at_s of each)

Exit status: 0 where every mission was completed or ended safe with a reason, 1 where one failed.

Examples:
  cargo xtask faults
  cargo xtask faults --missions 5000 --seed 7 --json
  cargo xtask faults --replay 4242
";

/// `cargo xtask faults`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let mut words = args.iter();
    while let Some(word) = words.next() {
        match word.as_str() {
            "--json" => {}
            "--missions" | "--seed" | "--replay" => {
                let found = words.next().map_or("nothing", String::as_str);
                if found.parse::<u64>().is_err() {
                    return Err(Failure::Usage(format!("{word}: found {found}, expected a whole number")));
                }
            }
            _ => return Err(Failure::Usage(format!("unknown word `{word}`"))),
        }
    }
    let program =
        ["--quiet", "--locked", "--profile=checks", "--package=skyroost-tests", "--bin=faults", "--"];
    process::run(cargo("run").args(program).args(args))
}
