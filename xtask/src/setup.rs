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
browser, read flight plans back, and run campaigns on a Slurm and on a Dask cluster. As root on Debian
or a relative it installs the packages that are missing; otherwise it prints what to type and exits
with 1. The other subcommands call it where they need it.
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
    /// Both sides of a Slurm, and what its daemons know each other by.
    Slurm,
    /// Dask, for a Python that tests find.
    Dask,
}

/// All of it.
pub(crate) const ALL: [Need; 6] =
    [Need::Cross, Need::Emulator, Need::Browser, Need::Python, Need::Slurm, Need::Dask];

/// Daemons lie there, and not everybody's shell looks for programs in it.
const DAEMONS: &str = "/usr/sbin";

impl Need {
    fn name(self) -> &'static str {
        match self {
            Self::Cross => "a compiler for thumbv7em-none-eabihf",
            Self::Emulator => "qemu-system-arm",
            Self::Browser => "Chromium with its driver",
            Self::Python => "python3",
            Self::Slurm => "Slurm with munge",
            Self::Dask => "Dask's `distributed` for Python",
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
            Self::Slurm => &["slurmctld", "slurmd", "slurm-client", "munge"],
            Self::Dask => &["python3-distributed"],
        }
    }

    fn is_met(self) -> bool {
        match self {
            Self::Cross => Toolchain::detect().is_some(),
            Self::Emulator => on_path("qemu-system-arm"),
            Self::Browser => on_path("chromium") && on_path("chromedriver"),
            Self::Python => on_path("python3"),
            Self::Slurm => {
                let is_there = |daemon| on_path(daemon) || is_executable(&Path::new(DAEMONS).join(daemon));
                ["slurmctld", "slurmd", "munged"].into_iter().all(is_there)
                    && ["sbatch", "sinfo", "squeue"].into_iter().all(on_path)
            }
            Self::Dask => ["python3", "/usr/bin/python3"].into_iter().any(has_dask), // as the tests look for it
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

/// A Python that is found first may know nothing of Debian's packages.
fn has_dask(python: &str) -> bool {
    let asked = Command::new(python).args(["-c", "import distributed"]).output();
    asked.is_ok_and(|ran| ran.status.success())
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
