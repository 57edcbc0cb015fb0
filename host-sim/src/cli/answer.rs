//! A command's answer: files where they are asked for, then JSON or text on stdout.

use std::fmt::Display;
use std::path::Path;

use super::console::Console;
use super::exit::Failure;
use super::output::staged;

/// Where an answer goes.
pub(super) struct Delivery<'a> {
    /// `--out`.
    pub(super) out: Option<&'a Path>,
    /// `--json`.
    pub(super) json: bool,
    /// What the picture is called, and its file.
    pub(super) picture: (&'static str, &'static str),
}

impl Delivery<'_> {
    /// Writes all files or none, then prints `json` or, for people, `text` and where the picture lies. A file without
    /// contents is one that needs to know where on Earth local coordinates lie, and is left out with a word.
    pub(super) fn deliver(
        &self,
        console: &Console,
        text: &impl Display,
        json: &str,
        files: impl FnOnce() -> Vec<(&'static str, Option<String>)>,
    ) -> Result<(), Failure> {
        let mut text = text.to_string();
        if let Some(dir) = self.out {
            let (there, missing): (Vec<_>, Vec<_>) =
                files().into_iter().partition(|(_, file)| file.is_some());
            let there: Vec<(String, String)> =
                there.into_iter().filter_map(|(name, file)| Some((name.to_owned(), file?))).collect();
            staged("--out", dir, &there)?.commit()?;
            for (name, _) in missing {
                console.log(&format!("no {name}: it needs --origin-lon-lat"));
            }
            let (what, file) = self.picture;
            text += &format!("\n{what}: {}\n", dir.join(file).display());
        }
        Console::print(if self.json { json } else { &text })
    }
}
