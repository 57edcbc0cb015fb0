//! A board's log: defmt's frames, made readable with the strings of the image.

use defmt_decoder::{DecodeError, Table};
use std::{fs, io, path::Path, sync::Arc};

/// Lines of the log that an error shows.
const TAIL_LINES: usize = 10;

/// What it takes to read the logs of boards that run one image.
#[derive(Clone)]
pub(super) struct LogReader {
    table: Option<Arc<Table>>,
}

impl LogReader {
    /// For the boards of this image; an image without strings has a log that nobody can read.
    pub(super) fn new(elf: &[u8]) -> Self {
        Self { table: Table::parse(elf).ok().flatten().map(Arc::new) }
    }

    /// All lines of the log in `file`.
    pub(super) fn lines(&self, file: &Path) -> Vec<String> {
        let Ok(bytes) = fs::read(file) else { return Vec::new() };
        let Some(table) = &self.table else {
            return vec![format!("({} bytes of log that the image has no strings for)", bytes.len())];
        };
        let mut decoder = table.new_stream_decoder();
        decoder.received(&bytes);
        let mut lines = Vec::new();
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let time = frame.display_timestamp().map_or_else(String::new, |time| format!("{time} "));
                    let level = frame.level().map_or("", |level| level.as_str()).to_uppercase();
                    lines.push(format!("{time}{level:5} {}", frame.display_message()));
                }
                Err(DecodeError::UnexpectedEof) => return lines,
                Err(DecodeError::Malformed) => lines.push("(a damaged line)".to_owned()),
            }
        }
    }

    /// The last lines of the log in `file`.
    pub(super) fn tail(&self, file: &Path) -> Vec<String> {
        let mut lines = self.lines(file);
        lines.drain(..lines.len().saturating_sub(TAIL_LINES));
        lines
    }

    /// Copies the log, readable, to `to`.
    pub(super) fn copy(&self, file: &Path, to: &Path) -> io::Result<()> {
        let mut text = self.lines(file).join("\n");
        text.push('\n');
        fs::write(to, text)
    }
}
