//! What an ELF file says of its code: sections, symbols, and where code ends and data begins.
//!
//! Sources: System V ABI, "Object Files"; ELF for the Arm Architecture (IHI 0044), "Mapping symbols".

/// An executable's code with its symbols.
pub(super) struct Elf<'a> {
    code: Vec<Section<'a>>,
    /// By address; one for every name.
    functions: Vec<Symbol<'a>>,
    /// By address: where instructions (`true`) or data within code (`false`) begin.
    marks: Vec<(u32, bool)>,
}

/// A section that holds instructions.
struct Section<'a> {
    address: u32,
    bytes: &'a [u8],
}

/// A named stretch of code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Symbol<'a> {
    pub(super) name: &'a str,
    pub(super) start: u32,
    pub(super) end: u32,
}

impl<'a> Elf<'a> {
    /// Reads a little-endian 32-bit executable with a symbol table.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub(super) fn of(file: &'a [u8]) -> Result<Self, String> {
        if file.get(..6) != Some(b"\x7fELF\x01\x01") {
            return Err("not a little-endian 32-bit ELF file".into());
        }
        Self::read(file).ok_or("the ELF file ends within its sections")?
    }

    /// `None` where the file ends too early.
    fn read(file: &'a [u8]) -> Option<Result<Self, String>> {
        const SHT_PROGBITS: u32 = 1;
        const SHT_SYMTAB: u32 = 2;
        const SHF_EXECINSTR: u32 = 4;
        let table = word(file, 32)? as usize;
        let (stride, count) = (usize::from(half(file, 46)?), usize::from(half(file, 48)?));
        let header = |index: usize| -> Option<[u32; 10]> {
            let at = table + index * stride;
            let mut words = [0; 10];
            for (n, field) in words.iter_mut().enumerate() {
                *field = word(file, at + 4 * n)?;
            }
            Some(words)
        };
        let content = |header: &[u32; 10]| file.get(header[4] as usize..)?.get(..header[5] as usize);
        let mut code = Vec::new();
        let mut symbols = None;
        for index in 0..count {
            let section = header(index)?;
            match section[1] {
                SHT_PROGBITS if section[2] & SHF_EXECINSTR != 0 => {
                    code.push(Section { address: section[3], bytes: content(&section)? });
                }
                SHT_SYMTAB => {
                    let names = header(section[6] as usize)?;
                    symbols = Some((content(&section)?, content(&names)?));
                }
                _ => {}
            }
        }
        let Some((symbols, names)) = symbols else { return Some(Err("the image has no symbols".into())) };
        let mut elf = Self { code, functions: Vec::new(), marks: Vec::new() };
        elf.take_symbols(symbols, names)?;
        Some(Ok(elf))
    }

    fn take_symbols(&mut self, symbols: &'a [u8], names: &'a [u8]) -> Option<()> {
        const STT_NOTYPE: u8 = 0;
        const STT_FUNC: u8 = 2;
        for symbol in symbols.chunks_exact(16) {
            let (value, size, kind) = (word(symbol, 4)?, word(symbol, 8)?, symbol[12] & 15);
            let name = names.get(word(symbol, 0)? as usize..)?.split(|byte| *byte == 0).next()?;
            let name = str::from_utf8(name).unwrap_or("?");
            let start = value & !1; // the lowest bit says "Thumb"
            match kind {
                STT_FUNC if self.section(start).is_some() => {
                    self.functions.push(Symbol { name, start, end: start.saturating_add(size) });
                }
                STT_NOTYPE if name == "$t" || name.starts_with("$t.") => self.marks.push((start, true)),
                STT_NOTYPE if name == "$d" || name.starts_with("$d.") => self.marks.push((start, false)),
                _ => {}
            }
        }
        self.functions.sort_by_key(|symbol| (symbol.start, symbol.end));
        // Where data and code are both said to begin, the data is empty.
        self.marks.sort_unstable();
        // A function written in assembly may not say how long it is: it goes on to the next one.
        for index in 0..self.functions.len() {
            let Symbol { start, end, .. } = self.functions[index];
            if start == end {
                let next = self.functions[index..].iter().map(|next| next.start).find(|next| *next > start);
                let section = self.section(start)?;
                let section_end = section.address.saturating_add(section.bytes.len() as u32);
                self.functions[index].end = next.unwrap_or(section_end).min(section_end);
            }
        }
        Some(())
    }

    fn section(&self, address: u32) -> Option<&Section<'a>> {
        self.code.iter().find(|section| {
            section.address <= address && address - section.address < section.bytes.len() as u32
        })
    }

    /// Every name of every function, by address.
    pub(super) fn functions(&self) -> &[Symbol<'a>] {
        &self.functions
    }

    /// The bytes of code from `start` to `end`; empty where there are none.
    pub(super) fn bytes(&self, start: u32, end: u32) -> &'a [u8] {
        let Some(section) = self.section(start) else { return &[] };
        let from = (start - section.address) as usize;
        let to = end.saturating_sub(section.address) as usize;
        section.bytes.get(from..to.min(section.bytes.len())).unwrap_or(&[])
    }

    /// The stretches of `start..end` that hold instructions. Without any mark, all of it does.
    pub(super) fn instructions(&self, start: u32, end: u32) -> Vec<(u32, u32)> {
        let before = self.marks.partition_point(|(address, _)| *address <= start);
        let mut is_code = before == 0 || self.marks[before - 1].1;
        let (mut from, mut stretches) = (start, Vec::new());
        let inside = self.marks[before..].iter().take_while(|(address, _)| *address < end);
        for &(address, next_is_code) in inside.chain([&(end, false)]) {
            if is_code && from < address {
                stretches.push((from, address));
            }
            (from, is_code) = (address, next_is_code);
        }
        stretches
    }
}

fn half(file: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*file.get(at..)?.first_chunk()?))
}

fn word(file: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*file.get(at..)?.first_chunk()?))
}

/// Builds executables for tests.
#[cfg(test)]
pub(super) mod build {
    /// An executable with one section of `code` at `address` and symbols `(name, value, size, type)`.
    pub(in crate::proof) fn executable(
        address: u32,
        code: &[u8],
        symbols: &[(&str, u32, u32, u8)],
    ) -> Vec<u8> {
        let mut names = vec![0];
        let mut table = vec![0; 16];
        for &(name, value, size, kind) in symbols {
            let entry = [names.len() as u32, value, size, u32::from(kind) | 1 << 16];
            table.extend(entry.iter().flat_map(|field| field.to_le_bytes()));
            names.extend(name.bytes().chain([0]));
        }
        let mut file = vec![0; 52];
        file[..6].copy_from_slice(b"\x7fELF\x01\x01");
        let mut headers = vec![[0; 10]];
        for (kind, flags, start, link, content) in
            [(1, 6, address, 0, code), (2, 0, 0, 3, &table), (3, 0, 0, 0, &names)]
        {
            let mut header: [u32; 10] = [0; 10];
            header[1..7].copy_from_slice(&[
                kind,
                flags,
                start,
                file.len() as u32,
                content.len() as u32,
                link,
            ]);
            headers.push(header);
            file.extend(content);
        }
        let table = file.len() as u32;
        file[32..36].copy_from_slice(&table.to_le_bytes());
        (file[46], file[48]) = (40, headers.len() as u8);
        file.extend(headers.iter().flatten().flat_map(|field| field.to_le_bytes()));
        file
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_found_with_their_ends_and_the_data_among_them() {
        let file = build::executable(
            0x100,
            &[0; 32],
            &[
                ("second", 0x111, 0, 2), // no size: to the end of the section
                ("first", 0x101, 16, 2),
                ("elsewhere", 0x2000_0001, 4, 2),
                ("a variable", 0x104, 4, 1),
                ("$t", 0x100, 0, 0),
                ("$d.1", 0x108, 0, 0),
                ("$t.2", 0x10c, 0, 0),
            ],
        );
        let elf = Elf::of(&file).unwrap();
        let found: Vec<_> = elf.functions().iter().map(|f| (f.name, f.start, f.end)).collect();
        assert_eq!(found, [("first", 0x100, 0x110), ("second", 0x110, 0x120)]);
        assert_eq!(elf.instructions(0x100, 0x110), [(0x100, 0x108), (0x10c, 0x110)]);
        assert_eq!(elf.instructions(0x10a, 0x10c), []);
        assert_eq!(elf.bytes(0x11c, 0x200).len(), 4);
        assert_eq!(elf.bytes(0x500, 0x600).len(), 0);
    }

    #[test]
    fn a_file_cut_anywhere_is_refused() {
        let file = build::executable(0x100, &[0; 8], &[("f", 0x101, 8, 2)]);
        assert!(Elf::of(&file).is_ok());
        for length in 0..file.len() {
            assert!(Elf::of(&file[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn a_stripped_image_is_refused() {
        let mut file = build::executable(0x100, &[0; 8], &[]);
        let headers = word(&file, 32).unwrap() as usize;
        file[headers + 2 * 40 + 4] = 0; // the type of the symbol table's section
        assert_eq!(Elf::of(&file).err().unwrap(), "the image has no symbols");
    }
}
