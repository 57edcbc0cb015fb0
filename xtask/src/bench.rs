//! `cargo xtask bench`: how fast the host's code is, and what the flight code costs on its board.

use std::process::Stdio;

use crate::budget::Figure;
use crate::firmware::{self, BOARDS, EMULATED};
use crate::process::{self, Failure, Outcome, cargo};

pub(crate) const HELP: &str = "\
Usage: cargo xtask bench [NAME [--quick]]

Runs every bench of the host's packages, or only the bench target NAME, with --quick for less time. Criterion
keeps the figures in target/criterion/ and compares them with those of the run before.

`avoid` measures no time: it flies families of encounters with the flight code's avoidance and with others, and
prints what each keeps and costs. SKYROOST_UPDATE_DOCS=1 puts the table into docs/avoidance.md too.

`campaign` prints what runs of a campaign cost, and how that grows with users and drones.

`board` is another kind: it builds every board's image, flies the emulated board through its worst steps
and a part of the default mission, and holds instructions, stack, flash and RAM against
firmware/budgets.toml.
";

/// The bench target that measures on the emulated board.
const BOARD: &str = "board";

/// `cargo xtask bench`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let (target, thoroughness) = match args {
        [] => ("*", Thoroughness::Full),
        [name] if !name.starts_with('-') => (name.as_str(), Thoroughness::Full),
        [name, quick] if !name.starts_with('-') && quick == "--quick" => (name.as_str(), Thoroughness::Quick),
        [word, ..] | [_, word] if word.starts_with('-') => {
            return Err(Failure::Usage(format!("unknown option `{word}`")));
        }
        _ => return Err(Failure::Usage("more than one bench".into())),
    };
    if target == BOARD {
        let toolchain = firmware::toolchain()?;
        BOARDS.iter().try_for_each(|board| board.build(toolchain).map(drop))?;
        return hold_boards(thoroughness);
    }
    let mut command = cargo("bench");
    command.args(["--locked", "--bench", target]);
    if thoroughness == Thoroughness::Quick {
        command.args(["--", "--quick"]);
    }
    process::run(&mut command)
}

/// How much to measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Thoroughness {
    /// Seconds.
    Quick,
    /// Minutes.
    Full,
}

/// Measures on the emulated board and holds every image, built before, against its budget.
pub(crate) fn hold_boards(thoroughness: Thoroughness) -> Outcome {
    let figures = measure(thoroughness)?;
    // Tasks and interrupts nest on both boards alike, so the depth measured on one counts for the other.
    let stack: Vec<Figure> =
        figures.iter().filter(|figure| figure.key == firmware::STACK_MEASURED).cloned().collect();
    let check = |board: &firmware::Board| {
        let measured = if board.name == EMULATED.name { &figures } else { &stack };
        board.check(&board.image(), measured.clone())
    };
    process::all(BOARDS.iter().map(check))
}

/// What the bench target [`BOARD`] prints. It is built as the tests are, from what they have built: the
/// emulator does the work, and what is counted does not depend on the host.
fn measure(thoroughness: Thoroughness) -> Outcome<Vec<Figure>> {
    let mut command = cargo("test");
    command.args(["--workspace", "--locked", "--profile=checks", "--bench", BOARD]);
    if thoroughness == Thoroughness::Quick {
        command.args(["--", "--quick"]);
    }
    command.env("SKYROOST_BOARD_IMAGE", EMULATED.image()).stdout(Stdio::piped());
    eprintln!("$ {}", process::shown(&command));
    let child = command.spawn().map_err(process::not_started(&command))?;
    let output = child.wait_with_output().map_err(process::not_started(&command))?;
    let printed = String::from_utf8_lossy(&output.stdout);
    if !output.status.success() {
        return Err(Failure::Failed(format!("measuring on the emulated board: {}", output.status)));
    }
    Figure::read(&printed).map_err(Failure::while_doing("what was measured on the emulated board"))
}
