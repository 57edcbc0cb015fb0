//! What avoidance keeps and costs next to other methods: `cargo xtask bench avoid`, in small.

#[path = "../benches/avoid/table.rs"]
mod table;

use std::sync::LazyLock;

fn on_threads(count: usize, lines: usize) -> Vec<String> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().expect("threads");
    pool.install(|| table::lines(true).take(lines).collect())
}

static TABLE: LazyLock<Vec<String>> = LazyLock::new(|| on_threads(3, usize::MAX));

#[test]
fn methods_compare_as_they_did() {
    insta::assert_snapshot!(TABLE.join("\n"));
}

#[test]
fn threads_change_no_byte() {
    let head_and_two_families = 2 + 2 * 5;
    assert_eq!(on_threads(1, head_and_two_families), TABLE[..head_and_two_families]);
}

#[test]
fn the_page_in_docs_has_every_row() {
    let page = include_str!("../../docs/avoidance.md");
    let (_, shown) = page.split_once(table::MARK).expect("the mark before the table");
    let names =
        |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).skip(1).take(2).collect::<Vec<_>>();
    let shown: Vec<Vec<String>> = shown.lines().map(names).collect();
    for line in &TABLE[2..] {
        let told =
            "docs/avoidance.md is stale: `SKYROOST_UPDATE_DOCS=1 cargo xtask bench avoid` writes it anew";
        assert!(shown.contains(&names(line)), "{told}; it lacks {line}");
    }
}
