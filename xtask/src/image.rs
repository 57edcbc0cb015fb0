//! How much of a board's memory an image takes: an ELF file's segments against a linker script's regions.

use std::fmt;
use std::ops::Range;

/// A region of a linker script's `MEMORY` block.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Region {
    addresses: Range<u64>,
}

/// What an image takes of flash and RAM, in bytes, and what there is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Usage {
    /// Code, constants and the initial values of variables.
    pub(crate) flash: u64,
    /// Variables, initialised or not. The rest is left to the stack.
    pub(crate) ram: u64,
    flash_size: u64,
    ram_size: u64,
}

impl Usage {
    /// Reads an image (`elf`: a little-endian 32-bit executable) and a linker script with the regions
    /// `FLASH` and `RAM`.
    ///
    /// # Errors
    /// What is wrong with either, in words.
    pub(crate) fn of(elf: &[u8], memory_x: &str) -> Result<Self, String> {
        let flash_region = region(memory_x, "FLASH")?;
        let ram_region = region(memory_x, "RAM")?;
        let (mut flash, mut ram) = (0, 0);
        for segment in loaded_segments(elf)? {
            // A segment lies in the file at its load address and, once the start-up code has copied
            // it, in memory at its virtual address: `.data` counts in both, `.bss` only in the second.
            if segment.file_size > 0 {
                if !flash_region.holds(segment.load_address, segment.file_size) {
                    return Err(format!("a segment loads at {:#x}, outside of FLASH", segment.load_address));
                }
                flash += segment.file_size;
            }
            if ram_region.holds(segment.address, segment.size) {
                ram += segment.size;
            } else if !flash_region.holds(segment.address, segment.size) {
                return Err(format!("a segment lies at {:#x}, outside of FLASH and RAM", segment.address));
            }
        }
        Ok(Self { flash, ram, flash_size: flash_region.size(), ram_size: ram_region.size() })
    }
}

impl fmt::Display for Usage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |part: u64, whole: u64| 100.0 * part as f64 / whole as f64;
        let Self { flash, ram, flash_size, ram_size } = *self;
        writeln!(f, "flash {flash:8} of {flash_size:8} bytes  {:5.1} %", percent(flash, flash_size))?;
        writeln!(f, "RAM   {ram:8} of {ram_size:8} bytes  {:5.1} %", percent(ram, ram_size))?;
        write!(f, "stack {:8} bytes left", ram_size - ram)
    }
}

impl Region {
    fn size(&self) -> u64 {
        self.addresses.end - self.addresses.start
    }

    fn holds(&self, address: u64, size: u64) -> bool {
        self.addresses.start <= address && address + size <= self.addresses.end
    }
}

/// The region called `name`: `NAME (rx) : ORIGIN = 0x08000000, LENGTH = 1024K`.
fn region(script: &str, name: &str) -> Result<Region, String> {
    let script = without_comments(script);
    let line = script
        .lines()
        .find(|line| line.split([' ', '\t', ':', '(']).find(|word| !word.is_empty()) == Some(name))
        .ok_or_else(|| format!("the linker script has no region {name}"))?;
    let value = |key: &str| {
        let (_, rest) = line.split_once(key)?;
        let (_, rest) = rest.split_once('=')?;
        number(rest.split(',').next()?.trim())
    };
    let (Some(origin), Some(length)) = (value("ORIGIN"), value("LENGTH")) else {
        return Err(format!("cannot read the region's ORIGIN and LENGTH: {}", line.trim()));
    };
    match origin.checked_add(length) {
        Some(end) if length > 0 => Ok(Region { addresses: origin..end }),
        _ => Err(format!("the region is empty or too long: {}", line.trim())),
    }
}

/// `script` with every `/* ... */` taken out.
fn without_comments(script: &str) -> String {
    let mut code = String::new();
    let mut rest = script;
    while let Some((before, after)) = rest.split_once("/*") {
        code.push_str(before);
        rest = after.split_once("*/").map_or("", |(_, after)| after);
    }
    code + rest
}

/// A number as linker scripts write it: decimal or hexadecimal, with `K` or `M` for binary multiples.
fn number(text: &str) -> Option<u64> {
    let (digits, unit) = match text.as_bytes().last()? {
        b'K' | b'k' => (text.get(..text.len() - 1)?, 1 << 10),
        b'M' | b'm' => (text.get(..text.len() - 1)?, 1 << 20),
        _ => (text, 1),
    };
    let value = match digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
        Some(hexadecimal) => u64::from_str_radix(hexadecimal, 16),
        None => digits.parse(),
    };
    value.ok()?.checked_mul(unit)
}

/// One part of an executable that takes up memory.
#[derive(Clone, Copy, Debug)]
struct Segment {
    address: u64,
    load_address: u64,
    file_size: u64,
    size: u64,
}

/// The segments of type `PT_LOAD` that are not empty (System V ABI, "Program Header").
fn loaded_segments(elf: &[u8]) -> Result<Vec<Segment>, String> {
    const PT_LOAD: u32 = 1;
    const CLASS_32_LITTLE_ENDIAN: [u8; 2] = [1, 1];
    if elf.get(..4) != Some(b"\x7fELF") || elf.get(4..6) != Some(&CLASS_32_LITTLE_ENDIAN) {
        return Err("not a little-endian 32-bit ELF file".into());
    }
    let half = |at: usize| Some(u16::from_le_bytes(*elf.get(at..)?.first_chunk()?));
    let word = |at: usize| Some(u32::from_le_bytes(*elf.get(at..)?.first_chunk()?));
    let table = || Some((word(28)? as usize, usize::from(half(42)?), usize::from(half(44)?)));
    let header = |at: usize| {
        let [kind, address, load_address, file_size, size] =
            [word(at)?, word(at + 8)?, word(at + 12)?, word(at + 16)?, word(at + 20)?];
        let segment = Segment {
            address: address.into(),
            load_address: load_address.into(),
            file_size: file_size.into(),
            size: size.into(),
        };
        Some((kind, segment))
    };
    let headers = table().and_then(|(start, stride, count)| {
        (0..count).map(|index| header(start + index * stride)).collect::<Option<Vec<_>>>()
    });
    let headers = headers.ok_or("the ELF file ends within its headers")?;
    Ok(headers
        .into_iter()
        .filter(|(kind, segment)| *kind == PT_LOAD && segment.size > 0)
        .map(|(_, segment)| segment)
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const MEMORY_X: &str = include_str!("../../memory.x");

    /// An ELF file of nothing but its header and program headers `(type, vaddr, paddr, filesz, memsz)`.
    fn elf(headers: &[[u32; 5]]) -> Vec<u8> {
        let mut file = vec![0; 52];
        file[..6].copy_from_slice(b"\x7fELF\x01\x01");
        file[28] = 52;
        file[42] = 32;
        file[44] = headers.len() as u8;
        for &[kind, address, load_address, file_size, size] in headers {
            for word in [kind, 0, address, load_address, file_size, size, 0, 0] {
                file.extend(u32::to_le_bytes(word));
            }
        }
        file
    }

    #[test]
    fn the_boards_memory_is_read_from_its_linker_script() {
        assert_eq!(region(MEMORY_X, "FLASH").unwrap().addresses, 0x0800_0000..0x080e_0000);
        assert_eq!(region(MEMORY_X, "RAM").unwrap().size(), 128 * 1024);
        let compact = "MEMORY{\nRAM(rwx):ORIGIN=536870912,LENGTH=0x100\n}";
        assert_eq!(region(compact, "RAM").unwrap().addresses, 0x2000_0000..0x2000_0100);
    }

    #[test]
    fn a_script_without_sense_is_refused() {
        for script in [
            "",
            "/* RAM : ORIGIN = 0, LENGTH = 1K */",
            "RAM : ORIGIN = 0",
            "RAM : ORIGIN = x, LENGTH = 1K",
            "RAM : ORIGIN = 0, LENGTH = 0",
            "RAM : ORIGIN = 0xffffffffffffffff, LENGTH = 2M",
        ] {
            assert!(region(script, "RAM").is_err(), "{script}");
        }
    }

    #[test]
    fn initialised_data_counts_twice_and_zeroed_data_once() {
        let image = elf(&[
            [1, 0x0800_0000, 0x0800_0000, 392, 392],   // vector table
            [1, 0x0800_0188, 0x0800_0188, 9432, 9432], // code
            [1, 0x2000_0000, 0x0800_2660, 80, 80],     // .data
            [1, 0x2000_0050, 0x2000_0050, 0, 1176],    // .bss
            [0x6474_e551, 0, 0, 0, 0],                 // GNU_STACK
        ]);
        let usage = Usage::of(&image, MEMORY_X).unwrap();
        assert_eq!((usage.flash, usage.ram), (392 + 9432 + 80, 80 + 1176));
        let shown = usage.to_string();
        assert!(shown.contains("9904 of   917504 bytes    1.1 %"), "{shown}");
        assert!(shown.contains("1256 of   131072 bytes    1.0 %"), "{shown}");
    }

    #[test]
    fn segments_outside_of_memory_are_refused() {
        let beyond_flash = elf(&[[1, 0x080d_fff0, 0x080d_fff0, 0x20, 0x20]]);
        let nowhere = elf(&[[1, 0x1000_0000, 0x1000_0000, 0, 16]]);
        for image in [beyond_flash, nowhere] {
            assert!(Usage::of(&image, MEMORY_X).is_err());
        }
    }

    #[test]
    fn a_file_cut_anywhere_is_refused() {
        let image = elf(&[[1, 0x0800_0000, 0x0800_0000, 392, 392]]);
        for length in 0..image.len() - 8 {
            assert!(Usage::of(&image[..length], MEMORY_X).is_err(), "{length} bytes");
        }
    }
}
