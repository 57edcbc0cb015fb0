//! What an image may take, from `firmware/budgets.toml`, and the table that holds figures against it.

use std::fmt;

/// Where the budgets stand, from the root of the workspace.
pub(crate) const FILE: &str = "firmware/budgets.toml";

/// What there is a budget for: the key in the file, and what it is called in a table. A figure goes by
/// the key of its budget.
const KEYS: [(&str, &str); 7] = [
    ("flash_bytes", "flash, bytes"),
    ("ram_and_stack_bytes", "static RAM and stack, bytes"),
    ("step_stack_bytes", "stack of a step, bytes"),
    ("step_instructions_worst", "worst step, instructions"),
    (AIM, "worst step, the aim"),
    ("step_instructions_typical", "typical step, instructions"),
    ("upload_instructions_worst", "end of an upload, instructions"),
];

/// The one budget that may be missed: it says where the worst step should get to.
const AIM: &str = "step_instructions_worst_aim";

/// The figure that is held against the aim as well.
const AIMED_AT: &str = "step_instructions_worst";

/// What one image may take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Budget {
    values: [u64; KEYS.len()],
}

/// A figure measured on an image, or by running it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Figure {
    /// One of the budget's keys, or something else that is only shown.
    pub(crate) key: String,
    pub(crate) value: u64,
}

impl Figure {
    pub(crate) fn new(key: &str, value: u64) -> Self {
        Self { key: key.to_owned(), value }
    }

    /// Reads figures as a program that measures prints them: a line each, `key value`. Empty lines and
    /// those that begin with `#` are passed over.
    ///
    /// # Errors
    /// Names the first line that is anything else, or the second of the same figure.
    pub(crate) fn read(text: &str) -> Result<Vec<Self>, String> {
        let mut figures: Vec<Self> = Vec::new();
        for (number, line) in numbered(text) {
            let wrong = |what: &str| format!("line {number}: {what}: {line}");
            let (key, value) = line.split_once(' ').ok_or_else(|| wrong("not `key value`"))?;
            if !is_key(key) {
                return Err(wrong("not the name of a figure"));
            }
            let value = integer(value.trim()).ok_or_else(|| wrong("not a whole number"))?;
            if figures.iter().any(|figure| figure.key == key) {
                return Err(wrong("the figure is there already"));
            }
            figures.push(Self { key: key.to_owned(), value });
        }
        Ok(figures)
    }
}

impl Budget {
    /// The budget of `image` out of the file's text: a section `[image]` for every image, in it
    /// `key = integer` for every one of [`KEYS`], and comments.
    ///
    /// # Errors
    /// Names the line that does not belong there, or the section that lacks something.
    pub(crate) fn of(image: &str, text: &str) -> Result<Self, String> {
        let mut budgets = Vec::new();
        for section in sections(text)? {
            budgets.push((section.image, section.budget()?));
        }
        let found = budgets.into_iter().find(|(name, _)| *name == image);
        found.map(|(_, budget)| budget).ok_or_else(|| format!("there is no section [{image}]"))
    }

    fn get(&self, key: &str) -> Option<u64> {
        let index = KEYS.iter().position(|(known, _)| *known == key)?;
        Some(self.values[index])
    }

    /// Holds figures against the budget.
    pub(crate) fn hold(&self, figures: &[Figure]) -> Table {
        let mut rows = Vec::new();
        for figure in figures {
            let what = KEYS.iter().find(|(key, _)| *key == figure.key).map(|(_, what)| *what);
            let row = |what: &str, budget| Row {
                what: what.to_owned(),
                measured: figure.value,
                budget,
                is_aim: false,
            };
            rows.push(row(what.unwrap_or(&figure.key), self.get(&figure.key)));
            if figure.key == AIMED_AT {
                rows.push(Row { is_aim: true, ..row("  to aim at", self.get(AIM)) });
            }
        }
        Table { rows }
    }
}

/// Figures beside what they may be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Table {
    rows: Vec<Row>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Row {
    what: String,
    measured: u64,
    budget: Option<u64>,
    is_aim: bool,
}

impl Table {
    /// A line for every figure above its budget.
    pub(crate) fn excesses(&self) -> Vec<String> {
        let over = |row: &&Row| !row.is_aim && row.budget.is_some_and(|budget| row.measured > budget);
        let line = |row: &Row| {
            let budget = row.budget.unwrap_or_default();
            format!("over budget: {}: {} of {budget}", row.what, row.measured)
        };
        self.rows.iter().filter(over).map(line).collect()
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:30} {:>9} {:>9} {:>8}", "what", "measured", "budget", "share")?;
        for Row { what, measured, budget, .. } in &self.rows {
            write!(f, "\n{what:30} {measured:9}")?;
            match budget {
                Some(budget) => {
                    write!(f, " {budget:9} {:6.1} %", 100.0 * *measured as f64 / *budget as f64)?;
                }
                None => write!(f, " {:>9}", "-")?,
            }
        }
        Ok(())
    }
}

/// A section of the file as it is read.
struct Section<'a> {
    image: &'a str,
    line: usize,
    values: [Option<u64>; KEYS.len()],
}

impl Section<'_> {
    fn budget(&self) -> Result<Budget, String> {
        let mut values = [0; KEYS.len()];
        for ((value, found), (key, _)) in values.iter_mut().zip(self.values).zip(KEYS) {
            let missing = || format!("line {}: [{}] lacks {key}", self.line, self.image);
            *value = found.ok_or_else(missing)?;
        }
        Ok(Budget { values })
    }
}

fn sections(text: &str) -> Result<Vec<Section<'_>>, String> {
    let mut sections: Vec<Section<'_>> = Vec::new();
    for (number, line) in numbered(text) {
        let wrong = |what: &str| format!("line {number}: {what}: {line}");
        if let Some(image) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            if !is_key(image) {
                return Err(wrong("not the name of an image"));
            }
            if sections.iter().any(|section| section.image == image) {
                return Err(wrong("the section is there already"));
            }
            sections.push(Section { image, line: number, values: [None; KEYS.len()] });
            continue;
        }
        let (key, value) = line.split_once('=').ok_or_else(|| wrong("not `key = integer`"))?;
        let index = KEYS.iter().position(|(known, _)| *known == key.trim());
        let index = index.ok_or_else(|| wrong("unknown key"))?;
        let value = integer(value.trim()).ok_or_else(|| wrong("not a whole number"))?;
        let section = sections.last_mut().ok_or_else(|| wrong("stands before any section"))?;
        if section.values[index].replace(value).is_some() {
            return Err(wrong("the key is there already"));
        }
    }
    Ok(sections)
}

/// The lines of `text` that say something, with their numbers, without comments.
fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().zip(1..).filter_map(|(line, number)| {
        let line = line.split('#').next().unwrap_or(line).trim();
        (!line.is_empty()).then_some((number, line))
    })
}

fn is_key(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
}

/// A number as TOML writes it: digits, with `_` among them if one likes.
fn integer(text: &str) -> Option<u64> {
    let is_edged = text.starts_with('_') || text.ends_with('_') || text.contains("__");
    let is_number = !is_edged && text.bytes().all(|byte| byte.is_ascii_digit() || byte == b'_');
    is_number.then(|| text.replace('_', "").parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::root;

    const GOOD: &str = "\
# what images may take
[board]
flash_bytes = 131_072
ram_and_stack_bytes = 49152  # both
step_stack_bytes = 8192

step_instructions_worst = 1000000
step_instructions_worst_aim = 300000
step_instructions_typical = 60000
upload_instructions_worst = 2000000
";

    #[test]
    fn every_board_has_a_budget() {
        let text = std::fs::read_to_string(root().join(FILE)).unwrap();
        for board in &crate::firmware::BOARDS {
            Budget::of(board.name, &text).unwrap();
        }
    }

    #[test]
    fn a_budget_is_read_by_its_sections_name() {
        let budget = Budget::of("board", GOOD).unwrap();
        assert_eq!(budget.get("flash_bytes"), Some(131_072));
        assert_eq!(budget.get("ram_and_stack_bytes"), Some(49152));
        assert_eq!(budget.get("no_such_key"), None);
        assert_eq!(Budget::of("other", GOOD).unwrap_err(), "there is no section [other]");
    }

    #[test]
    fn what_does_not_belong_there_is_named_with_its_line() {
        for (old, new, error) in [
            ("step_stack_bytes = 8192\n", "", "line 2: [board] lacks step_stack_bytes"),
            ("flash_bytes", "flash_bites", "line 3: unknown key: flash_bites = 131_072"),
            ("[board]\n", "", "line 2: stands before any section: flash_bytes = 131_072"),
            ("131_072", "128K", "line 3: not a whole number: flash_bytes = 128K"),
            ("131_072", "-1", "line 3: not a whole number: flash_bytes = -1"),
            ("131_072", "_1", "line 3: not a whole number: flash_bytes = _1"),
            ("131_072", "", "line 3: not a whole number: flash_bytes ="),
            ("flash_bytes = ", "flash_bytes ", "line 3: not `key = integer`: flash_bytes 131_072"),
            ("step_stack_bytes", "flash_bytes", "line 5: the key is there already: flash_bytes = 8192"),
            ("\n\n", "\n[board]\n", "line 6: the section is there already: [board]"),
            ("[board]", "[The board]", "line 2: not the name of an image: [The board]"),
            ("[board]", "[board", "line 2: not `key = integer`: [board"),
        ] {
            assert_eq!(Budget::of("board", &GOOD.replacen(old, new, 1)).unwrap_err(), error);
        }
    }

    #[test]
    fn a_mistake_in_another_boards_section_is_one_too() {
        let text = format!("{GOOD}[later]\nflash_bytes = 1\n");
        assert_eq!(Budget::of("board", &text).unwrap_err(), "line 11: [later] lacks ram_and_stack_bytes");
    }

    #[test]
    fn figures_are_lines_of_key_and_value() {
        let text = "# measured\nstep_instructions_worst 812345\n\nsteps   300000\n";
        let expected = [Figure::new("step_instructions_worst", 812_345), Figure::new("steps", 300_000)];
        assert_eq!(Figure::read(text).unwrap(), expected);
        for (text, error) in [
            ("steps", "line 1: not `key value`: steps"),
            ("a 1\nsteps many", "line 2: not a whole number: steps many"),
            ("Steps 1", "line 1: not the name of a figure: Steps 1"),
            ("a 1\na 2", "line 2: the figure is there already: a 2"),
        ] {
            assert_eq!(Figure::read(text).unwrap_err(), error);
        }
    }

    #[test]
    fn figures_above_their_budget_are_excesses_and_aims_are_not() {
        let budget = Budget::of("board", GOOD).unwrap();
        let hold = |key: &str, value| budget.hold(&[Figure::new(key, value)]).excesses();
        assert!(hold("flash_bytes", 131_072).is_empty());
        assert_eq!(hold("flash_bytes", 131_073), ["over budget: flash, bytes: 131073 of 131072"]);
        assert!(hold("step_instructions_worst", 300_001).is_empty()); // short of the aim only
        assert_eq!(hold("step_instructions_worst", 1_000_001).len(), 1);
        assert!(hold("something_else", u64::MAX).is_empty());
    }

    #[test]
    fn the_table_has_a_line_for_every_figure() {
        let budget = Budget::of("board", GOOD).unwrap();
        let figures = [
            Figure::new("flash_bytes", 65536),
            Figure::new("step_instructions_worst", 450_000),
            Figure::new("steps", 7),
        ];
        let shown = budget.hold(&figures).to_string();
        let expected = "\
what                            measured    budget    share
flash, bytes                       65536    131072   50.0 %
worst step, instructions          450000   1000000   45.0 %
  to aim at                       450000    300000  150.0 %
steps                                  7         -";
        assert_eq!(shown, expected);
    }
}
