//! Lines of a CSV file and their fields.
//!
//! A line is a row: the `csv` crate counts lines wrongly after blank ones and before CR LF, and lets a quote that
//! is never closed swallow the rest of the file. Quoted fields are those of RFC 4180, without line breaks.

use std::borrow::Cow;
use std::io::{self, BufRead, Read};

use super::Fault;
use crate::control::quoted::quoted;

/// A longer line is no row.
const MOST_LINE_BYTES: usize = 4096;

/// Reads line by line and counts.
pub(in crate::control) struct Lines<R> {
    reader: R,
    line: Vec<u8>,
    number: u32,
    bytes_left: u64,
}

/// Why there is no next line.
pub(in crate::control) enum LineError {
    Io(io::Error),
    Fault(Fault),
}

impl From<Fault> for LineError {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl<R: BufRead> Lines<R> {
    /// Of at most `most_bytes`.
    pub(in crate::control) fn new(reader: R, most_bytes: u64) -> Self {
        Self { reader, line: Vec::with_capacity(256), number: 0, bytes_left: most_bytes }
    }

    /// The next line that is not blank and its number from 1, without its end and without a byte order mark.
    pub(in crate::control) fn next(&mut self) -> Result<Option<(u32, &[u8])>, LineError> {
        loop {
            self.line.clear();
            // One byte more than is allowed tells a line that is too long.
            let most = MOST_LINE_BYTES as u64 + 1;
            let read =
                self.reader.by_ref().take(most).read_until(b'\n', &mut self.line).map_err(LineError::Io)?;
            if read == 0 {
                return Ok(None);
            }
            self.number = self.number.saturating_add(1);
            self.bytes_left = self.bytes_left.checked_sub(read as u64).ok_or_else(|| self.too_large())?;
            if read > MOST_LINE_BYTES && self.line.last() != Some(&b'\n') {
                let found = format!("a line of more than {MOST_LINE_BYTES} bytes");
                return Err(Fault::line(self.number, found, "a row").into());
            }
            if self.number == 1 && self.line.starts_with(b"\xef\xbb\xbf") {
                self.line.drain(..3);
            }
            if !self.line.trim_ascii().is_empty() {
                break;
            }
        }
        Ok(Some((self.number, self.line.trim_ascii())))
    }

    /// The number of the last line, or of the first where there is none.
    pub(in crate::control) fn number(&self) -> u32 {
        self.number.max(1)
    }

    fn too_large(&self) -> LineError {
        let expected = "a smaller file: some users at a time";
        Fault::line(self.number, "more bytes than a file may have", expected).into()
    }
}

/// One field: blanks around it and the quotes around it are gone, doubled quotes inside are not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::control) struct Field<'a> {
    pub(in crate::control) raw: &'a [u8],
    in_quotes: bool,
}

impl<'a> Field<'a> {
    /// What was meant: doubled quotes are single ones.
    pub(in crate::control) fn unescaped(self) -> Cow<'a, [u8]> {
        if !self.in_quotes || !self.raw.contains(&b'"') {
            return Cow::Borrowed(self.raw);
        }
        let mut text = Vec::with_capacity(self.raw.len());
        let mut bytes = self.raw.iter();
        while let Some(&byte) = bytes.next() {
            text.push(byte);
            if byte == b'"' {
                bytes.next();
            }
        }
        Cow::Owned(text)
    }
}

/// Splits a line into its fields: the first `N`, and how many there are.
pub(in crate::control) fn split<const N: usize>(
    number: u32,
    line: &[u8],
) -> Result<([Field<'_>; N], usize), Fault> {
    let mut fields = [Field::default(); N];
    let mut count = 0;
    let mut rest = Some(line);
    while let Some(text) = rest {
        let field;
        (field, rest) = first(number, text)?;
        if let Some(place) = fields.get_mut(count) {
            *place = field;
        }
        count += 1;
    }
    Ok((fields, count))
}

/// The first field, and what follows its comma.
fn first(number: u32, text: &[u8]) -> Result<(Field<'_>, Option<&[u8]>), Fault> {
    let text = text.trim_ascii_start();
    let Some(inside) = text.strip_prefix(b"\"") else {
        let end = text.iter().position(|&b| b == b',');
        let raw = text[..end.unwrap_or(text.len())].trim_ascii_end();
        return Ok((Field { raw, in_quotes: false }, end.map(|end| &text[end + 1..])));
    };
    let mut end = 0;
    loop {
        match inside[end..].iter().position(|&b| b == b'"') {
            None => return Err(Fault::line(number, shown(text), "a quote that is closed on the same line")),
            Some(at) if inside.get(end + at + 1) == Some(&b'"') => end += at + 2,
            Some(at) => {
                end += at;
                break;
            }
        }
    }
    let field = Field { raw: &inside[..end], in_quotes: true };
    match inside[end + 1..].trim_ascii_start() {
        [] => Ok((field, None)),
        [b',', rest @ ..] => Ok((field, Some(rest))),
        after => Err(Fault::line(number, shown(after), "a comma after the closing quote")),
    }
}

fn shown(bytes: &[u8]) -> String {
    quoted(&String::from_utf8_lossy(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(line: &str) -> Result<Vec<String>, String> {
        let (fields, count) = split::<8>(7, line.as_bytes()).map_err(|fault| fault.to_string())?;
        Ok(fields[..count].iter().map(|f| String::from_utf8(f.unescaped().into_owned()).unwrap()).collect())
    }

    #[test]
    fn fields_are_those_of_rfc_4180() {
        assert_eq!(fields("a,b ,\t c,"), Ok(vec!["a".into(), "b".into(), "c".into(), String::new()]));
        assert_eq!(
            fields(r#" "a, ""b""" ,"" , x"y"#),
            Ok(vec![r#"a, "b""#.into(), String::new(), r#"x"y"#.into()])
        );
        assert_eq!(fields(""), Ok(vec![String::new()]));
        assert_eq!(
            fields(r#"a,"b"#).unwrap_err(),
            r#"line 7: found "\"b", expected a quote that is closed on the same line"#
        );
        assert_eq!(
            fields(r#""a"b,c"#).unwrap_err(),
            r#"line 7: found "b,c", expected a comma after the closing quote"#
        );
    }

    #[test]
    fn more_fields_are_counted_not_kept() {
        assert_eq!(split::<2>(1, b"a,b,c,d").map(|(_, count)| count).ok(), Some(4));
    }

    #[test]
    fn lines_are_counted_as_an_editor_counts_them() {
        let text: &[u8] = b"\xef\xbb\xbfa\r\n\r\n \n\nb\nc";
        let mut lines = Lines::new(text, 100);
        let mut found = Vec::new();
        while let Ok(Some((number, line))) = lines.next() {
            found.push((number, line.to_vec()));
        }
        assert_eq!(found, [(1, b"a".to_vec()), (5, b"b".to_vec()), (6, b"c".to_vec())]);
    }

    #[test]
    fn a_file_that_is_too_large_is_refused_where_it_is() {
        let mut lines = Lines::new(&b"abc\nabc\nabc\n"[..], 8);
        assert!(matches!(lines.next(), Ok(Some((1, b"abc")))));
        assert!(matches!(lines.next(), Ok(Some((2, b"abc")))));
        assert!(matches!(lines.next(), Err(LineError::Fault(fault)) if fault.line == 3));
    }
}
