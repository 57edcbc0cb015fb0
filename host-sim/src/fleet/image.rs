//! The image that emulated boards run: found, built where it is missing, checked before anything starts.

use super::workspace;
use std::{
    fs, io,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::SystemTime,
};
use thiserror::Error;

/// Where `cargo xtask firmware --board emulated` puts the image, below the workspace.
const IMAGE: &str = "target/cross/thumbv7em-none-eabihf/release/emulated";
/// What the image is made of, below the workspace.
const SOURCES: [&str; 5] = ["firmware", "protocol", "Cargo.toml", "Cargo.lock", "memory.x"];

/// There is no image to run.
#[derive(Debug, Error)]
pub enum ImageError {
    /// The file named by the user cannot be read.
    #[error("--board-image: {}: {source}; expected the image of an emulated board", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The file is not an image.
    #[error(
        "{}: not an image for a board: {what}; `cargo xtask firmware --board emulated` builds one", path.display()
    )]
    NotAnImage {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: &'static str,
    },
    /// There is none, and no sources to build it from.
    #[error("no image for the emulated board: the sources are gone from {}; give one with --board-image", env!("CARGO_MANIFEST_DIR"))]
    NoSources,
    /// It could not be built.
    #[error("the image for the emulated board could not be built: {0}")]
    NotBuilt(String),
}

/// An image in memory and where it came from.
#[derive(Clone, Debug)]
pub(super) struct Image {
    pub(super) path: PathBuf,
    pub(super) elf: Vec<u8>,
}

impl Image {
    /// The user's image, or the workspace's own, built first where it is missing or older than its sources.
    pub(super) fn find(named: Option<&Path>) -> Result<Self, ImageError> {
        match named {
            Some(path) => Self::read(path),
            None => {
                let root = workspace().ok_or(ImageError::NoSources)?;
                let path = root.join(IMAGE);
                if !is_fresh(&root, &path) {
                    build(&root)?;
                }
                Self::read(&path)
            }
        }
    }

    fn read(path: &Path) -> Result<Self, ImageError> {
        let unreadable = |source| ImageError::Unreadable { path: path.to_owned(), source };
        // The emulator runs elsewhere.
        let path = path.canonicalize().map_err(unreadable)?;
        let elf = fs::read(&path).map_err(|source| ImageError::Unreadable { path: path.clone(), source })?;
        match check(&elf) {
            Ok(()) => Ok(Self { path, elf }),
            Err(what) => Err(ImageError::NotAnImage { path, what }),
        }
    }
}

/// Whether `elf` is a program for a processor like the board's (System V ABI, "ELF Header").
fn check(elf: &[u8]) -> Result<(), &'static str> {
    const CLASS_32_LITTLE_ENDIAN: [u8; 2] = [1, 1];
    const EXECUTABLE: [u8; 2] = [2, 0];
    const ARM: [u8; 2] = [40, 0];
    if elf.get(..4) != Some(b"\x7fELF") {
        return Err("not an ELF file");
    }
    if elf.get(4..6) != Some(&CLASS_32_LITTLE_ENDIAN) || elf.get(18..20) != Some(&ARM) {
        return Err("an ELF file for another processor");
    }
    if elf.get(16..18) != Some(&EXECUTABLE) {
        return Err("an ELF file that is no program");
    }
    // Linkers put the table of sections last: where it is whole, everything is.
    match sections_end(elf) {
        Some(end) if end <= elf.len() as u64 => Ok(()),
        _ => Err("an ELF file that is cut short"),
    }
}

/// Where the table of sections ends (`e_shoff`, `e_shentsize`, `e_shnum`); none in a file without a header.
fn sections_end(elf: &[u8]) -> Option<u64> {
    let at = u32::from_le_bytes(elf.get(32..36)?.try_into().ok()?);
    let half = |at: usize| Some(u16::from_le_bytes(elf.get(at..at + 2)?.try_into().ok()?));
    Some(u64::from(at) + u64::from(half(46)?) * u64::from(half(48)?))
}

/// Whether the image is there and no source is newer.
fn is_fresh(root: &Path, image: &Path) -> bool {
    let Ok(built) = fs::metadata(image).and_then(|file| file.modified()) else { return false };
    SOURCES.iter().all(|source| newest(&root.join(source)).is_none_or(|changed| changed <= built))
}

/// When anything at or below `path` was last changed.
fn newest(path: &Path) -> Option<SystemTime> {
    let found = fs::metadata(path).ok()?;
    if found.is_dir() {
        fs::read_dir(path).ok()?.flatten().filter_map(|entry| newest(&entry.path())).max()
    } else {
        found.modified().ok()
    }
}

fn build(root: &Path) -> Result<(), ImageError> {
    let words = ["xtask", "firmware", "--board", "emulated"];
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    let output = command.current_dir(root).args(words).stdin(Stdio::null()).output();
    let output = output.map_err(|error| ImageError::NotBuilt(format!("cargo: {error}")))?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let mut last: Vec<&str> = said.lines().rev().take(12).collect();
    last.reverse();
    Err(ImageError::NotBuilt(format!("`cargo {}`: {}\n{}", words.join(" "), output.status, last.join("\n"))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_programs_for_the_boards_processor_are_images() {
        let mut elf = vec![0; 52];
        elf[..6].copy_from_slice(b"\x7fELF\x01\x01");
        elf[16] = 2;
        elf[18] = 40;
        assert_eq!(check(&elf), Ok(()));
        for length in 0..50 {
            assert!(check(&elf[..length]).is_err(), "{length} bytes");
        }
        let mut cut = elf.clone();
        (cut[32], cut[46], cut[48]) = (52, 40, 1); // a section after the header
        assert_eq!(check(&cut), Err("an ELF file that is cut short"));
        cut.resize(52 + 40, 0);
        assert_eq!(check(&cut), Ok(()));
        let own = fs::read(std::env::current_exe().unwrap()).unwrap();
        assert_eq!(check(&own), Err("an ELF file for another processor"));
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = Image::find(Some(Path::new("/no/such/image"))).unwrap_err();
        assert!(error.to_string().contains("/no/such/image"), "{error}");
    }
}
