//! Tells the linker of a board's image about its memory; does nothing on the host.

use std::env;
use std::path::Path;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    // memory.x stands at the root of the workspace, the map of the flight board and of its emulation.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("firmware/ lies in the workspace");
    println!("cargo::rerun-if-changed={}", root.join("memory.x").display());
    println!("cargo::rustc-link-search={}", root.display());
    println!("cargo::rustc-link-arg-bins=--nmagic"); // no padding of sections to pages
    println!("cargo::rustc-link-arg-bins=-Tlink.x"); // cortex-m-rt
    if env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
}
