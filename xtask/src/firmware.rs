//! `cargo xtask firmware`: building a board's image.

use std::fs;
use std::path::{Path, PathBuf};

use crate::budget::{self, Budget, Figure};
use crate::image::Usage;
use crate::process::{self, Failure, Outcome, root};
use crate::proof::Proof;
use crate::setup::{self, Need};
use crate::toolchain::{TARGET, TARGET_DIR, Toolchain};

pub(crate) const HELP: &str = "\
Usage: cargo xtask firmware --board NAME [--size] [--proof] [--root FUNCTION] [--figures FILE]

Builds the flight code's image for a board and prints where it lies.

  --board NAME     stm32f405: the flight board; emulated: the same chip in the emulator; or
                   step_proof: no board, but an image that links only if the flight code cannot panic
  --size           also print the flash and RAM that the image takes of the board's memory and of
                   its budget in firmware/budgets.toml
  --proof          also read in the image how much stack a step of the flight code takes at most, and fail
                   if the image is over its budget or a step can panic, allocate or recurse
  --root FUNCTION  follow another function than the step; without a judgement
  --figures FILE   the same, and hold figures that were measured by running the image against the budget
                   too: lines of `key value`, with the budget's keys, and `stack_bytes` for the deepest
                   stack of all
";

/// A board that has an image: `firmware/src/bin/NAME.rs` or `NAME/main.rs`, built with the feature
/// `board-NAME`.
pub(crate) struct Board {
    pub(crate) name: &'static str,
    /// The linker script with its memory, at the root of the workspace.
    memory: &'static str,
    /// How it is optimised, in TOML: `"s"` for what must fit, `2` for what should be fast and fit as well. The same bits either way.
    opt_level: &'static str,
}

/// Every board there is.
pub(crate) const BOARDS: [Board; 2] =
    [Board { name: "stm32f405", memory: "memory.x", opt_level: "\"s\"" }, EMULATED];

/// The figure of a stack measured by running an image, all but variables.
pub(crate) const STACK_MEASURED: &str = "stack_bytes";

/// The board that whole missions are flown on without hardware.
pub(crate) const EMULATED: Board = Board { name: "emulated", memory: "memory.x", opt_level: "2" };

/// No board, though built like one: an image that links only if the flight code cannot panic.
pub(crate) const STEP_PROOF: Board = Board { name: "step_proof", memory: "memory.x", opt_level: "3" };

impl Board {
    fn named(name: &str) -> Outcome<&'static Self> {
        BOARDS.iter().chain([&STEP_PROOF]).find(|board| board.name == name).ok_or_else(|| {
            let known: Vec<_> = BOARDS.iter().map(|board| board.name).collect();
            Failure::Usage(format!("unknown board `{name}`; known: {}", known.join(", ")))
        })
    }

    /// What tells cargo to work on this board's image and nothing else. Only the firmware package is
    /// named: cargo joins the features of all packages it builds at once, and the host's are not fit
    /// for a board.
    pub(crate) fn cargo_args(&self) -> [String; 7] {
        [
            "--package=skyroost-firmware".to_owned(),
            "--no-default-features".to_owned(),
            "--bin".to_owned(),
            self.name.to_owned(),
            format!("--features=board-{}", self.name),
            "--config".to_owned(),
            format!("profile.release.opt-level={}", self.opt_level),
        ]
    }

    /// Builds the image and returns its path.
    pub(crate) fn build(&self, toolchain: Toolchain) -> Outcome<PathBuf> {
        process::run(toolchain.cargo("build").args(self.cargo_args()))?;
        Ok(self.image())
    }

    /// Where the image lies once it is built.
    pub(crate) fn image(&self) -> PathBuf {
        root().join(TARGET_DIR).join(TARGET).join("release").join(self.name)
    }

    /// The memory that the image at `path` takes.
    fn usage(&self, path: &Path) -> Outcome<Usage> {
        let script = root().join(self.memory);
        let memory_x = fs::read_to_string(&script).map_err(Failure::while_doing(script.display()))?;
        Usage::of(&read(path)?, &memory_x).map_err(Failure::while_doing(path.display()))
    }

    /// What can be read of the step, or of another function, in the image at `path`.
    fn proof(&self, path: &Path, root: Option<&str>) -> Outcome<Proof> {
        Proof::of(&read(path)?, root).map_err(Failure::while_doing(path.display()))
    }

    fn budget(&self) -> Outcome<Budget> {
        let file = root().join(budget::FILE);
        let text = fs::read_to_string(&file).map_err(Failure::while_doing(budget::FILE))?;
        Budget::of(self.name, &text).map_err(Failure::while_doing(budget::FILE))
    }

    /// Prints what can be known of the image at `path` without running it, and what was `measured` by running
    /// it. Fails if it should not fly: it is over its budget, or a step can panic, allocate or recurse.
    pub(crate) fn check(&self, path: &Path, measured: Vec<Figure>) -> Outcome {
        let usage = self.usage(path)?;
        let proof = self.proof(path, None)?;
        println!("{}: {proof}", self.name);
        let mut figures = vec![Figure::new("flash_bytes", usage.flash)];
        // Without a bound, for a step that calls itself, there is no figure, but a fault.
        if let Some(step_stack) = proof.stack_bytes() {
            let stack_read = u64::from(proof.above_bytes) + step_stack;
            let stack_measured = measured.iter().find(|figure| figure.key == STACK_MEASURED);
            // Reading the image leaves out interrupts; running it, whatever did not happen.
            let stack = stack_measured.map_or(0, |figure| figure.value).max(stack_read);
            figures.push(Figure::new("ram_and_stack_bytes", usage.ram + stack));
            figures.push(Figure::new("step_stack_bytes", step_stack));
        }
        figures.extend(measured);
        let table = self.budget()?.hold(&figures);
        println!("{table}");
        let faults = [table.excesses(), proof.faults].concat();
        if faults.is_empty() {
            return Ok(());
        }
        Err(Failure::Failed(format!("{} is not fit to fly:\n  {}", self.name, faults.join("\n  "))))
    }
}

/// `cargo xtask firmware`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let Request { board, with_size, with_proof, root, figures } = parse(args)?;
    if board.name == STEP_PROOF.name && (with_size || with_proof || root.is_some() || figures.is_some()) {
        return Err(Failure::Usage(format!("{} is never run: that it links is all it says", board.name)));
    }
    let path = board.build(toolchain()?)?;
    println!("{}", path.display());
    if let Some(root) = root {
        let proof = board.proof(&path, Some(&root))?;
        println!("{proof}");
        proof.faults.iter().for_each(|fault| println!("{fault}"));
    }
    if with_size {
        let usage = board.usage(&path)?;
        println!(
            "{usage}\n{}",
            board.budget()?.hold(&[
                Figure::new("flash_bytes", usage.flash),
                Figure::new("ram_and_stack_bytes", usage.ram),
            ])
        );
    }
    match figures {
        Some(file) => {
            let text = fs::read_to_string(&file).map_err(Failure::while_doing(&file))?;
            board.check(&path, Figure::read(&text).map_err(Failure::while_doing(&file))?)
        }
        None if with_proof => board.check(&path, Vec::new()),
        None => Ok(()),
    }
}

fn read(path: &Path) -> Outcome<Vec<u8>> {
    fs::read(path).map_err(Failure::while_doing(path.display()))
}

/// The compiler for the boards, installed first if need be.
pub(crate) fn toolchain() -> Outcome<Toolchain> {
    if let Some(toolchain) = Toolchain::detect() {
        return Ok(toolchain);
    }
    setup::ensure(&[Need::Cross])?;
    Toolchain::detect().ok_or_else(|| Failure::Failed(format!("no compiler for {TARGET}")))
}

/// What the command line asks for.
struct Request {
    board: &'static Board,
    with_size: bool,
    with_proof: bool,
    root: Option<String>,
    figures: Option<String>,
}

fn parse(args: &[String]) -> Outcome<Request> {
    let (mut with_size, mut with_proof) = (false, false);
    let (mut board, mut root, mut figures) = (None, None, None);
    let mut words = args.iter().map(String::as_str);
    while let Some(word) = words.next() {
        let (option, mut value) = match word.split_once('=') {
            Some((option, value)) => (option, Some(value)),
            None => (word, None),
        };
        let slot = match option {
            "--size" | "--proof" if value.is_none() => {
                *(if option == "--size" { &mut with_size } else { &mut with_proof }) = true;
                continue;
            }
            "--board" => &mut board,
            "--root" => &mut root,
            "--figures" => &mut figures,
            _ => return Err(Failure::Usage(format!("unknown word `{word}`"))),
        };
        value = value.or_else(|| words.next());
        let value = value.ok_or_else(|| Failure::Usage(format!("{option} wants a name")))?;
        if slot.replace(value.to_owned()).is_some() {
            return Err(Failure::Usage(format!("{option} is given twice")));
        }
    }
    let board = board.ok_or_else(|| Failure::Usage("--board is missing".into()))?;
    Ok(Request { board: Board::named(&board)?, with_size, with_proof, root, figures })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_in_any_order_and_form() {
        for words in [&["--board", "stm32f405", "--size"][..], &["--size", "--board=stm32f405"]] {
            let args: Vec<String> = words.iter().map(ToString::to_string).collect();
            let Request { board, with_size, with_proof, .. } = parse(&args).unwrap();
            assert_eq!((board.name, with_size, with_proof), ("stm32f405", true, false));
        }
    }

    #[test]
    fn an_unknown_board_is_told_the_known_ones() {
        let Err(Failure::Usage(message)) = parse(&["--board=toaster".into()]) else { panic!("accepted") };
        assert_eq!(message, "unknown board `toaster`; known: stm32f405, emulated");
    }

    #[test]
    fn every_board_has_an_image_a_memory_map_and_a_line_of_help() {
        for board in &BOARDS {
            let source = |end: &str| root().join(format!("firmware/src/bin/{}{end}", board.name));
            assert!(source(".rs").is_file() || source("/main.rs").is_file());
            assert!(root().join(board.memory).is_file());
            assert!(HELP.contains(&format!("{}:", board.name)));
        }
    }
}
