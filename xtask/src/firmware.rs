//! `cargo xtask firmware`: building a board's image.

use std::fs;
use std::path::PathBuf;

use crate::image::Usage;
use crate::process::{self, Failure, Outcome, root};
use crate::setup::{self, Need};
use crate::toolchain::{TARGET, TARGET_DIR, Toolchain};

pub(crate) const HELP: &str = "\
Usage: cargo xtask firmware --board NAME [--size]

Builds the flight code's image for a board and prints where it lies.

  --board NAME  stm32f405: the flight board; emulated: the same chip in the emulator
  --size        also print the flash and RAM that the image takes of the board's memory
";

/// A board that has an image: `firmware/src/bin/NAME.rs`, built with the feature `board-NAME`.
pub(crate) struct Board {
    pub(crate) name: &'static str,
    /// The linker script with its memory, at the root of the workspace.
    memory: &'static str,
}

/// Every board there is.
pub(crate) const BOARDS: [Board; 2] =
    [Board { name: "stm32f405", memory: "memory.x" }, Board { name: "emulated", memory: "memory.x" }];

impl Board {
    fn named(name: &str) -> Outcome<&'static Self> {
        BOARDS.iter().find(|board| board.name == name).ok_or_else(|| {
            let known: Vec<_> = BOARDS.iter().map(|board| board.name).collect();
            Failure::Usage(format!("unknown board `{name}`; known: {}", known.join(", ")))
        })
    }

    /// What tells cargo to work on this board's image and nothing else. Only the firmware package is
    /// named: cargo joins the features of all packages it builds at once, and the host's are not fit
    /// for a board.
    pub(crate) fn cargo_args(&self) -> [String; 5] {
        let package = "--package=skyroost-firmware";
        [package, "--no-default-features", "--bin", self.name, &format!("--features=board-{}", self.name)]
            .map(String::from)
    }

    /// Builds the image and returns its path.
    pub(crate) fn build(&self, toolchain: Toolchain) -> Outcome<PathBuf> {
        process::run(toolchain.cargo("build").args(self.cargo_args()))?;
        Ok(root().join(TARGET_DIR).join(TARGET).join("release").join(self.name))
    }

    /// The memory that the image at `path` takes.
    pub(crate) fn usage(&self, path: &PathBuf) -> Outcome<Usage> {
        let script = root().join(self.memory);
        let elf = fs::read(path).map_err(Failure::while_doing(path.display()))?;
        let memory_x = fs::read_to_string(&script).map_err(Failure::while_doing(script.display()))?;
        Usage::of(&elf, &memory_x).map_err(Failure::while_doing(path.display()))
    }
}

/// `cargo xtask firmware`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let (board, with_size) = parse(args)?;
    let path = board.build(toolchain()?)?;
    println!("{}", path.display());
    if with_size {
        println!("{}", board.usage(&path)?);
    }
    Ok(())
}

/// The compiler for the boards, installed first if need be.
pub(crate) fn toolchain() -> Outcome<Toolchain> {
    if let Some(toolchain) = Toolchain::detect() {
        return Ok(toolchain);
    }
    setup::ensure(&[Need::Cross])?;
    Toolchain::detect().ok_or_else(|| Failure::Failed(format!("no compiler for {TARGET}")))
}

fn parse(args: &[String]) -> Outcome<(&'static Board, bool)> {
    let (mut board, mut with_size) = (None, false);
    let mut words = args.iter().map(String::as_str);
    while let Some(word) = words.next() {
        let name = match word {
            "--size" => {
                with_size = true;
                continue;
            }
            "--board" => words.next().ok_or_else(|| Failure::Usage("--board wants a name".into()))?,
            _ => word
                .strip_prefix("--board=")
                .ok_or_else(|| Failure::Usage(format!("unknown word `{word}`")))?,
        };
        if board.replace(Board::named(name)?).is_some() {
            return Err(Failure::Usage("--board is given twice".into()));
        }
    }
    let board = board.ok_or_else(|| Failure::Usage("--board is missing".into()))?;
    Ok((board, with_size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_in_any_order_and_form() {
        for words in [&["--board", "stm32f405", "--size"][..], &["--size", "--board=stm32f405"]] {
            let args: Vec<String> = words.iter().map(ToString::to_string).collect();
            let (board, with_size) = parse(&args).unwrap();
            assert_eq!((board.name, with_size), ("stm32f405", true));
        }
    }

    #[test]
    fn an_unknown_board_is_told_the_known_ones() {
        let Err(Failure::Usage(message)) = parse(&["--board=toaster".into()]) else { panic!("accepted") };
        assert_eq!(message, "unknown board `toaster`; known: stm32f405");
    }

    #[test]
    fn every_board_has_an_image_a_memory_map_and_a_line_of_help() {
        for board in &BOARDS {
            assert!(root().join(format!("firmware/src/bin/{}.rs", board.name)).is_file());
            assert!(root().join(board.memory).is_file());
            assert!(HELP.contains(&format!("{}:", board.name)));
        }
    }
}
