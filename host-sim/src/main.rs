//! The `skyroost` command.
fn main() {}
