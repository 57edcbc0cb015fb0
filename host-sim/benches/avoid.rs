//! What methods of avoidance keep and cost: families of encounters times methods, in one table.
//!
//! `cargo bench -p skyroost-host-sim --bench avoid`, with `--quick` behind `--` fewer runs. With `SKYROOST_UPDATE_DOCS` set,
//! the whole table also goes to `docs/avoidance.md`.

#[path = "avoid/table.rs"]
mod table;

use std::fs;

fn main() {
    let asked = |word: &str| std::env::args().any(|arg| arg == word);
    // `cargo test` runs benches without `--bench`.
    let quick = asked("--quick") || !asked("--bench");
    let mut text = String::new();
    for line in table::lines(quick) {
        println!("{line}");
        text += &line;
        text += "\n";
    }
    if !quick && std::env::var_os("SKYROOST_UPDATE_DOCS").is_some() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/avoidance.md");
        let page = fs::read_to_string(file).expect("the page in docs/");
        let (by_hand, _) = page.split_once(table::MARK).expect("the mark before the table");
        fs::write(file, [by_hand, table::MARK, "\n", &text].concat()).expect("docs/ can be written");
    }
}
