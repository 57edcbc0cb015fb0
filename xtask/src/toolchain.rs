//! Which compiler builds a board's image, and how to call it.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::process::{answer, cargo, root};

/// The target of every board: Cortex-M4F with its floating-point unit.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Where images and their parts are built, apart from the host's files; also in `cross-debian.toml`.
pub(crate) const TARGET_DIR: &str = "target/cross";

/// What Debian's packages bring, and what the cross build needs of it.
const DEBIAN_FILES: [&str; 5] = [
    "/usr/bin/rustc",
    "/usr/bin/cargo",
    "/usr/bin/cargo-clippy",
    "/usr/bin/rust-lld",
    "/usr/lib/rustlib/src/rust/library/core/Cargo.toml",
];

/// What a user may have set for the host and would lead a build for another target astray.
const HOST_FLAGS: [&str; 6] = [
    "CARGO_BUILD_RUSTFLAGS",
    "CARGO_BUILD_TARGET",
    "CARGO_ENCODED_RUSTFLAGS",
    "CARGO_TARGET_DIR",
    "RUSTC_WORKSPACE_WRAPPER",
    "RUSTFLAGS",
];

/// What cargo and rustup's proxies tell their children, and would lead Debian's compiler astray.
const HOST_TOOLCHAIN: [&str; 4] = ["CARGO", "LD_LIBRARY_PATH", "RUSTDOC", "RUSTUP_TOOLCHAIN"];

/// A compiler that can build for [`TARGET`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Toolchain {
    /// The host's own compiler with the target's library beside it, as rustup installs it.
    Native,
    /// Debian's compiler, which builds the library from its source along with the image.
    Debian,
}

impl Toolchain {
    /// The one to use on this machine: the native one where it can, then Debian's.
    pub(crate) fn detect() -> Option<Self> {
        let libdir = answer(Command::new("rustc").current_dir(root()).args([
            "--print",
            "target-libdir",
            "--target",
            TARGET,
        ]));
        if libdir.is_some_and(|dir| holds_core(Path::new(&dir))) {
            return Some(Self::Native);
        }
        let complete = DEBIAN_FILES.iter().all(|file| Path::new(file).exists());
        let version = answer(without(&mut Command::new("/usr/bin/rustc"), &HOST_TOOLCHAIN).arg("--version"));
        (complete && version.is_some_and(|v| recent_enough(&v))).then_some(Self::Debian)
    }

    /// `cargo VERB` for [`TARGET`], to be run at the root of the workspace.
    pub(crate) fn cargo(self, verb: &str) -> Command {
        let mut command = match self {
            Self::Native => {
                let mut command = cargo(verb);
                command.args(["--target", TARGET, "--target-dir", TARGET_DIR]);
                command
            }
            // Debian's cargo would find rustup's cargo-clippy first on the path; called directly,
            // Debian's cargo-clippy calls back the cargo in CARGO.
            Self::Debian => {
                let program = if verb == "clippy" { "/usr/bin/cargo-clippy" } else { "/usr/bin/cargo" };
                let mut command = Command::new(program);
                without(&mut command, &HOST_TOOLCHAIN)
                    .current_dir(root())
                    .env("CARGO", "/usr/bin/cargo")
                    .env("RUSTC", "/usr/bin/rustc")
                    .args([verb, "--config", "xtask/cross-debian.toml"]);
                command
            }
        };
        // defmt's own default is errors only.
        without(&mut command, &HOST_FLAGS).env("DEFMT_LOG", "info").args(["--locked", "--release"]);
        command
    }
}

/// Takes variables out of `command`'s environment.
fn without<'a>(command: &'a mut Command, variables: &[&str]) -> &'a mut Command {
    for name in variables {
        command.env_remove(name);
    }
    command
}

/// Whether a target's library folder has been installed; rustc names it even where it has not.
fn holds_core(libdir: &Path) -> bool {
    let Ok(entries) = fs::read_dir(libdir) else { return false };
    entries.flatten().any(|entry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with("libcore-") && name.ends_with(".rlib")
    })
}

/// Whether `rustc --version` names a compiler that the workspace accepts.
fn recent_enough(version_line: &str) -> bool {
    let needed = major_minor(env!("CARGO_PKG_RUST_VERSION"));
    let found = version_line.split_whitespace().nth(1).and_then(major_minor);
    found.is_some() && found >= needed
}

/// `1.95` out of `1.95`, `1.95.0` or `1.95.0-nightly`.
fn major_minor(version: &str) -> Option<(u32, u32)> {
    let mut parts = version.split('.').map(|part| part.parse().ok());
    Some((parts.next()??, parts.next()??))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_compiler_must_be_as_recent_as_the_workspace_says() {
        assert!(recent_enough("rustc 1.96.0 (ac68faa20 2026-05-25) (built from a source tarball)"));
        assert!(recent_enough("rustc 2.0.0-nightly"));
        assert!(recent_enough(&format!("rustc {}.0", env!("CARGO_PKG_RUST_VERSION"))));
        assert!(!recent_enough("rustc 1.63.0"));
        assert!(!recent_enough("rustc 1.9.0")); // numbers, not letters
        assert!(!recent_enough("command not found"));
        assert!(!recent_enough(""));
    }

    #[test]
    fn a_library_folder_counts_only_with_core_in_it() {
        assert!(!holds_core(Path::new("/nowhere/at/all")));
        assert!(!holds_core(root()));
    }

    #[test]
    fn a_cross_build_does_not_inherit_the_hosts_flags() {
        let removed =
            |command: &Command, name: &str| command.get_envs().any(|pair| pair == (name.as_ref(), None));
        for toolchain in [Toolchain::Native, Toolchain::Debian] {
            assert!(HOST_FLAGS.iter().all(|name| removed(&toolchain.cargo("build"), name)));
        }
        assert!(removed(&Toolchain::Debian.cargo("build"), "RUSTUP_TOOLCHAIN"));
        assert!(!removed(&Toolchain::Native.cargo("build"), "RUSTUP_TOOLCHAIN"));
    }
}
