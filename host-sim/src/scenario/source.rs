//! Which line of the file, or which option of the command line, a value came from.

use super::error::{Place, ScenarioError};
use std::collections::BTreeMap;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Where each field of a scenario was stated.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file, or what stands for it in messages.
    name: String,
    /// Every key of the file by its path (`fleet.drones`).
    keys: BTreeMap<String, KeySpan>,
    /// Fields replaced by an option of the command line.
    options: BTreeMap<&'static str, &'static str>,
}

/// Where a key and its value stand in the text.
#[derive(Clone, Debug)]
struct KeySpan {
    line: usize,
    key_bytes: Range<usize>,
    value_bytes: Range<usize>,
}

impl Source {
    /// Notes the lines of all keys.
    pub(super) fn parse(text: &str, name: &str) -> Result<Self, ScenarioError> {
        let document = DeTable::parse(text).map_err(|error| {
            let line = error.span().map_or(1, |span| line_of(text, span.start));
            ScenarioError::Syntax {
                place: Place::Line { file: name.to_owned(), line },
                message: error.message().to_owned(),
            }
        })?;
        let mut keys = BTreeMap::new();
        note_keys(text, "", document.get_ref(), &mut keys);
        Ok(Self { name: name.to_owned(), keys, options: BTreeMap::new() })
    }

    /// The file, or what stands for it in messages.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where `field` was stated.
    #[must_use]
    pub fn place(&self, field: &str) -> Place {
        let file = self.name.clone();
        match (self.options.get(field), self.keys.get(field)) {
            (Some(option), _) => Place::Option(option),
            (None, Some(key)) => Place::Line { file, line: key.line },
            (None, None) => Place::Default { file },
        }
    }

    /// Whether the file or the command line states `field`.
    #[must_use]
    pub fn states(&self, field: &str) -> bool {
        self.keys.contains_key(field) || self.options.contains_key(field)
    }

    /// Notes that an option of the command line replaced a field.
    pub(crate) fn replaced_by(&mut self, field: &'static str, option: &'static str) {
        self.options.insert(field, option);
    }

    /// Refuses a file that states `field` and one of `others`, of which only one can hold.
    pub(super) fn refuse_pair(&self, field: &str, others: &[&str]) -> Result<(), ScenarioError> {
        match others.iter().find(|other| self.keys.contains_key(field) && self.keys.contains_key(**other)) {
            None => Ok(()),
            Some(other) => Err(ScenarioError::Value {
                place: self.place(other),
                field: (*other).to_owned(),
                found: format!("together with {field}"),
                expected: "one of the two".to_owned(),
            }),
        }
    }

    /// Gives an error of the deserializer its place and field: the innermost key that holds the
    /// error's first byte.
    pub(super) fn explain(
        &self,
        error: &toml::de::Error,
        build: impl FnOnce(Place, &str, &str) -> ScenarioError,
    ) -> ScenarioError {
        let start = error.span().map_or(0, |span| span.start);
        let innermost = self
            .keys
            .iter()
            .filter(|(_, key)| key.key_bytes.contains(&start) || key.value_bytes.contains(&start))
            .max_by_key(|(path, _)| path.len());
        let (place, field) = innermost.map_or_else(
            || (Place::Default { file: self.name.clone() }, ""),
            |(path, key)| (Place::Line { file: self.name.clone(), line: key.line }, path.as_str()),
        );
        build(place, field, error.message())
    }
}

/// Adds the keys of `table`, and of the tables in it, to `keys`.
fn note_keys(text: &str, prefix: &str, table: &DeTable<'_>, keys: &mut BTreeMap<String, KeySpan>) {
    for (key, value) in table {
        let path =
            if prefix.is_empty() { key.get_ref().to_string() } else { format!("{prefix}.{}", key.get_ref()) };
        if let DeValue::Table(inner) = value.get_ref() {
            note_keys(text, &path, inner, keys);
        }
        let span = KeySpan {
            line: line_of(text, key.span().start),
            key_bytes: key.span(),
            value_bytes: Spanned::span(value),
        };
        keys.insert(path, span);
    }
}

/// Line of a byte of the text, counted from 1.
fn line_of(text: &str, byte: usize) -> usize {
    1 + text.bytes().take(byte).filter(|&b| b == b'\n').count()
}
