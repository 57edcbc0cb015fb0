//! `cargo xtask setup`: what the checks need beyond Rust itself, and how to get it.

use std::env;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::process::{self, Failure, Outcome};
use crate::toolchain::{TARGET, Toolchain};

pub(crate) const HELP: &str = "\
Usage: cargo xtask setup

Makes sure that this machine can cross-compile for the boards, emulate one, open a report in a
browser, and read flight plans back. As root on Debian or a relative it installs the packages that are missing; otherwise it
prints what to type and exits with 1. The other subcommands call it where they need it.
";

/// Something that part of the work cannot do without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Need {
    /// A compiler for the boards.
    Cross,
    /// A machine that runs an image without a board.
    Emulator,
    /// A browser that tests can steer.
    Browser,
    /// What reads flight plans back, independently of the code that writes them.
    Python,
}

/// All of it.
pub(crate) const ALL: [Need; 4] = [Need::Cross, Need::Emulator, Need::Browser, Need::Python];

impl Need {
    fn name(self) -> &'static str {
        match self {
            Self::Cross => "a compiler for thumbv7em-none-eabihf",
            Self::Emulator => "qemu-system-arm",
            Self::Browser => "Chromium with its driver",
            Self::Python => "python3",
        }
    }

    /// Debian's packages that meet the need.
    fn packages(self) -> &'static [&'static str] {
        match self {
            Self::Cross => {
                &["rustc-web", "cargo-web", "rust-web-src", "rust-web-clippy", "rust-web-llvm", "lld-22"]
            }
            Self::Emulator => &["qemu-system-arm"],
            Self::Browser => &["chromium", "chromium-driver"],
            Self::Python => &["python3"],
        }
    }

    fn is_met(self) -> bool {
        match self {
            Self::Cross => Toolchain::detect().is_some(),
            Self::Emulator => on_path("qemu-system-arm"),
            Self::Browser => on_path("chromium") && on_path("chromedriver"),
            Self::Python => on_path("python3"),
        }
    }
}

/// `cargo xtask setup`.
pub(crate) fn run(args: &[String]) -> Outcome {
    if let Some(word) = args.first() {
        return Err(Failure::Usage(format!("unknown word `{word}`")));
    }
    ensure(&ALL)?;
    println!("setup: nothing is missing");
    Ok(())
}

/// Returns once every one of `needs` is met, installing packages if that takes it and is allowed.
pub(crate) fn ensure(needs: &[Need]) -> Outcome {
    let missing = unmet(needs);
    if missing.is_empty() {
        return Ok(());
    }
    let Some(apt_get) = find_on_path("apt-get").filter(|_| is_root()) else {
        return Err(Failure::Failed(advice(&missing)));
    };
    eprintln!("setup: installing {}", names(&missing));
    let apt = || {
        let mut command = Command::new(&apt_get);
        command.env("DEBIAN_FRONTEND", "noninteractive").args(["-q", "-o", "DPkg::Lock::Timeout=300"]);
        command
    };
    process::run(apt().arg("update"))?;
    process::run(apt().args(["install", "-y", "--no-install-recommends"]).args(packages(&missing)))?;
    let missing = unmet(needs);
    if missing.is_empty() {
        return Ok(());
    }
    Err(Failure::Failed(format!("still missing after the packages were installed: {}", names(&missing))))
}

fn unmet(needs: &[Need]) -> Vec<Need> {
    needs.iter().copied().filter(|need| !need.is_met()).collect()
}

fn names(needs: &[Need]) -> String {
    needs.iter().map(|need| need.name()).collect::<Vec<_>>().join(", ")
}

fn packages(needs: &[Need]) -> Vec<&'static str> {
    needs.iter().flat_map(|need| need.packages()).copied().collect()
}

/// What to type where this program may not, or cannot, install anything itself.
fn advice(missing: &[Need]) -> String {
    let mut text = format!(
        "missing: {}\non Debian type:\n\n  sudo sh -c 'apt-get update && apt-get install -y --no-install-recommends {}'\n",
        names(missing),
        packages(missing).join(" ")
    );
    if missing.contains(&Need::Cross) {
        text += &format!(
            "\nwhere rustup may fetch from the network, the compiler needs only:\n\n  rustup target add {TARGET}\n"
        );
    }
    text
}

/// Whether this process runs as root, told by who owns it (always false where there is no `/proc`).
fn is_root() -> bool {
    fs::metadata("/proc/self").is_ok_and(|process| process.uid() == 0)
}

fn on_path(program: &str) -> bool {
    find_on_path(program).is_some()
}

/// Where the shell would find `program`.
fn find_on_path(program: &str) -> Option<PathBuf> {
    let path = env::var_os("PATH")?;
    env::split_paths(&path).map(|folder| folder.join(program)).find(|file| is_executable(file))
}

fn is_executable(file: &Path) -> bool {
    fs::metadata(file).is_ok_and(|found| found.is_file() && found.mode() & 0o111 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_are_found_as_the_shell_finds_them() {
        assert!(on_path("sh"));
        assert!(!on_path("no-such-program-anywhere"));
        assert!(!is_executable(Path::new("/etc/passwd")));
        assert!(!is_executable(Path::new("/usr/bin"))); // a folder has the bits as well
    }

    #[test]
    fn only_the_packages_of_unmet_needs_are_asked_for() {
        assert_eq!(packages(&[Need::Emulator]), ["qemu-system-arm"]);
        assert_eq!(
            packages(&[Need::Emulator, Need::Browser]),
            ["qemu-system-arm", "chromium", "chromium-driver"]
        );
        assert!(packages(&[]).is_empty());
    }

    #[test]
    fn advice_is_one_line_to_type_and_mentions_rustup_only_for_the_compiler() {
        let emulator = advice(&[Need::Emulator]);
        assert!(
            emulator.contains("apt-get install -y --no-install-recommends qemu-system-arm'"),
            "{emulator}"
        );
        assert!(!emulator.contains("rustup"));
        assert!(advice(&ALL).contains("rustup target add thumbv7em-none-eabihf"));
    }
}
