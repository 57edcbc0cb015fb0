//! Host and board must compute the same bits: what clippy cannot see of that.
//!
//! `clippy.toml` refuses methods of floats whose results differ between processors or libraries, and matrices
//! on the heap. A trait method in scope, a word in a macro or a feature of a dependency gets past it; not past
//! these tests.
#![allow(missing_docs)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Words that shared code has no use for, and why.
const BANNED: [(&str, &str); 12] = [
    ("f64", "the board has no unit for it: f32 and integers"),
    ("num_traits", "its methods may be those of std: libm by name"),
    ("ComplexField", "its methods may be those of std: libm by name"),
    ("RealField", "its methods may be those of std: libm by name"),
    ("simba", "its methods may be those of std: libm by name"),
    ("Float", "its methods may be those of std: libm by name"),
    ("Dyn", "matrices have fixed sizes"),
    ("DMatrix", "matrices have fixed sizes"),
    ("DVector", "matrices have fixed sizes"),
    ("alloc", "nothing is allocated"),
    ("std", "there is none on the board"),
    ("intrinsics", "libm by name"),
];

/// The shared code: all of both libraries but for their tests.
fn shared_code() -> Vec<(PathBuf, String)> {
    let firmware = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    collect(&firmware.join("src"), &mut files);
    collect(&firmware.join("../protocol/src"), &mut files);
    // Images are not shared: each runs on one processor. Tests of their own are in files and folders of that name.
    files.retain(|path| !path.starts_with(firmware.join("src/bin")));
    files.retain(|path| !path.iter().any(|part| part == "tests" || part == "tests.rs"));
    assert!(files.len() > 30, "found only {files:?}");
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).expect("source is text");
        (path, code_of(&text))
    };
    files.into_iter().map(read).collect()
}

fn collect(dir: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).expect("a folder of sources") {
        let path = entry.expect("a folder of sources").path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// Without comments, and without what is compiled for tests only.
fn code_of(text: &str) -> String {
    let mut code = String::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        match line.trim() {
            "#[cfg(test)]" => match lines.next() {
                Some(next) if next.ends_with('{') => break, // the module of tests ends every file
                _ => {}
            },
            line if line.starts_with("#![cfg_attr(") => {}
            line => {
                code.push_str(line.split("//").next().unwrap_or_default());
                code.push('\n');
            }
        }
    }
    code
}

fn words(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !(c.is_alphanumeric() || c == '_'))
}

/// The one place that double precision is good for: sine and cosine, some times a mission, whose sums and products are as exact in
/// a board's software.
const DOUBLE_PRECISION_IN: &str = "src/scalar.rs";

#[test]
fn shared_code_has_no_banned_word() {
    for (path, code) in shared_code() {
        for (banned, why) in BANNED {
            if banned == "f64" && path.ends_with(DOUBLE_PRECISION_IN) {
                continue;
            }
            assert!(!words(&code).any(|word| word == banned), "{}: `{banned}`: {why}", path.display());
        }
    }
}

#[test]
fn the_reader_of_code_sees_code_and_nothing_else() {
    let text =
        "use a; // std\n#[cfg(test)]\nextern crate std;\nfn b() {}\n#[cfg(test)]\nmod tests {\n    f64\n}\n";
    assert_eq!(code_of(text), "use a; \nfn b() {}\n");
}

/// What the boards are built of, one line a package: name, version and features.
fn packages() -> Vec<(String, Vec<String>)> {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let boards = fs::read_to_string(manifest.join("Cargo.toml")).expect("the manifest is text");
    let boards: Vec<&str> = boards
        .lines()
        .filter(|l| l.starts_with("board-"))
        .filter_map(|l| l.split_whitespace().next())
        .collect();
    assert!(!boards.is_empty(), "a feature for every board");
    let mut packages = Vec::new();
    for board in boards {
        let output = Command::new(env!("CARGO"))
            .current_dir(manifest)
            .args(["tree", "--locked", "--offline", "--package=skyroost-firmware", "--no-default-features"])
            .args(["--target=thumbv7em-none-eabihf", "--edges=normal,no-proc-macro", "--prefix=none"])
            .args(["--no-dedupe", "--format={p}|{f}", "--features", board])
            .output()
            .expect("cargo runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        for line in String::from_utf8(output.stdout).expect("names are text").lines() {
            let (package, features) = line.split_once('|').expect("the format above");
            let features = features.split(',').filter(|f| !f.is_empty()).map(String::from).collect();
            packages.push((package.to_owned(), features));
        }
    }
    packages.sort();
    packages.dedup();
    packages
}

#[test]
fn boards_are_built_of_libm_and_nothing_that_needs_a_heap() {
    let packages = packages();
    let with = |name: &str, feature: &str| {
        let mut found =
            packages.iter().filter(|(package, _)| package.split(' ').next() == Some(name)).peekable();
        assert!(found.peek().is_some(), "{name} is not there");
        assert!(found.all(|(_, features)| features.iter().any(|f| f == feature)), "{name} without {feature}");
    };
    with("nalgebra", "libm-force");
    with("simba", "libm_force");
    for (package, features) in &packages {
        for banned in ["std", "alloc", "use-std"] {
            assert!(!features.iter().any(|f| f == banned), "{package} is built with `{banned}`");
        }
    }
}

/// The host's build must not do without `libm-force` either: it is the other side of the comparison.
#[test]
fn the_manifest_asks_for_libm() {
    let manifest = include_str!("../Cargo.toml");
    let nalgebra = manifest.lines().find(|line| line.starts_with("nalgebra")).expect("a dependency");
    assert!(nalgebra.contains("\"libm-force\""), "{nalgebra}");
}
