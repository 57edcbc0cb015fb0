//! Names for people out of the names that compilers give to functions.
//!
//! Sources: Rust RFC 2603 (v0, `_R...`) and the older `_ZN...E`. What is not understood stays as it is:
//! a long name is better than a wrong one.

/// The path of a function, with its generic arguments, without hashes.
pub(super) fn demangle(name: &str) -> String {
    let readable = match name.strip_prefix("_R") {
        Some(rest) => {
            V0 { text: rest.as_bytes(), at: 0, out: String::new(), is_type: false, steps: 0 }.whole()
        }
        None => name.strip_prefix("_ZN").and_then(legacy),
    };
    readable.unwrap_or_else(|| name.to_owned())
}

/// `_ZN4core9panicking5panic17h0123456789abcdefE`.
fn legacy(mut rest: &str) -> Option<String> {
    let mut parts: Vec<&str> = Vec::new();
    while !rest.starts_with('E') {
        let digits = rest.find(|c: char| !c.is_ascii_digit())?;
        let (length, after) = rest.split_at(digits);
        let length: usize = length.parse().ok()?;
        parts.push(after.get(..length)?);
        rest = after.get(length..)?;
    }
    let hash = parts.pop()?;
    let is_hash = hash.len() == 17 && hash.starts_with('h');
    if !is_hash {
        parts.push(hash);
    }
    let path = parts.join("::").replace("..", "::").replace("$LT$", "<").replace("$GT$", ">");
    Some(path.replace("$u20$", " ").replace("$RF$", "&").replace("$C$", ",").replace("_<", "<"))
}

/// A reader of the v0 scheme. Every method takes one production of its grammar and writes it to `out`.
struct V0<'a> {
    text: &'a [u8],
    at: usize,
    out: String,
    /// Whether a path stands for a type.
    is_type: bool,
    /// Productions read so far: back references must not make a short name endless.
    steps: u32,
}

impl V0<'_> {
    fn whole(mut self) -> Option<String> {
        self.path()?;
        Some(self.out)
    }

    fn take(&mut self) -> Option<u8> {
        self.at += 1;
        self.text.get(self.at - 1).copied()
    }

    fn takes(&mut self, byte: u8) -> bool {
        let found = self.text.get(self.at) == Some(&byte);
        self.at += usize::from(found);
        found
    }

    fn write(&mut self, text: &str) {
        self.out.push_str(text);
    }

    fn path(&mut self) -> Option<()> {
        self.count()?;
        match self.take()? {
            b'C' => self.identifier(),
            b'M' => {
                self.silently(Self::impl_path)?;
                self.bracketed(Self::kind)
            }
            b'X' => {
                self.silently(Self::impl_path)?;
                self.bracketed(Self::kind_as_trait)
            }
            b'Y' => self.bracketed(Self::kind_as_trait),
            b'N' => {
                let space = self.take()?;
                self.path()?;
                self.write("::");
                if space == b'C' {
                    let number = self.disambiguator()?;
                    self.silently(Self::plain_identifier)?;
                    self.write(&format!("{{closure#{number}}}"));
                    return Some(());
                }
                self.identifier()
            }
            b'I' => {
                self.path()?;
                if !self.is_type {
                    self.write("::");
                }
                self.bracketed(|v0| v0.list(Self::generic_argument))
            }
            b'B' => self.back(Self::path),
            _ => None,
        }
    }

    fn impl_path(&mut self) -> Option<()> {
        self.disambiguator()?;
        self.path()
    }

    fn kind_as_trait(&mut self) -> Option<()> {
        self.kind()?;
        self.write(" as ");
        self.path_of_type()
    }

    fn generic_argument(&mut self) -> Option<()> {
        match self.text.get(self.at)? {
            b'L' => {
                self.at += 1;
                self.base_62()?;
                self.write("'_");
                Some(())
            }
            b'K' => {
                self.at += 1;
                self.constant()
            }
            _ => self.kind(),
        }
    }

    /// A type.
    fn kind(&mut self) -> Option<()> {
        self.count()?;
        let tag = self.take()?;
        if let Some(name) = basic(tag) {
            self.write(name);
            return Some(());
        }
        match tag {
            b'A' => {
                self.write("[");
                self.kind()?;
                self.write("; ");
                self.constant()?;
                self.write("]");
            }
            b'S' => {
                self.write("[");
                self.kind()?;
                self.write("]");
            }
            b'T' => {
                self.write("(");
                self.list(Self::kind)?;
                self.write(")");
            }
            b'R' | b'Q' => {
                self.write(if tag == b'R' { "&" } else { "&mut " });
                if self.takes(b'L') {
                    self.base_62()?;
                }
                self.kind()?;
            }
            b'P' | b'O' => {
                self.write(if tag == b'P' { "*const " } else { "*mut " });
                self.kind()?;
            }
            b'F' => self.function()?,
            b'D' => self.object()?,
            b'B' => self.back(Self::kind)?,
            _ => {
                self.at -= 1;
                self.path_of_type()?;
            }
        }
        Some(())
    }

    /// A path where a type or trait is meant, whose generic arguments follow without `::`.
    fn path_of_type(&mut self) -> Option<()> {
        let outer = std::mem::replace(&mut self.is_type, true);
        self.path()?;
        self.is_type = outer;
        Some(())
    }

    /// The type of a function.
    fn function(&mut self) -> Option<()> {
        self.binder()?;
        let _is_unsafe = self.takes(b'U');
        if self.takes(b'K') && !self.takes(b'C') {
            self.silently(Self::plain_identifier)?;
        }
        self.write("fn(");
        self.list(Self::kind)?;
        self.write(")");
        if self.takes(b'u') {
            return Some(());
        }
        self.write(" -> ");
        self.kind()
    }

    /// A trait object.
    fn object(&mut self) -> Option<()> {
        self.write("dyn ");
        self.binder()?;
        while !self.takes(b'E') {
            self.path_of_type()?;
            while self.takes(b'p') {
                self.silently(Self::plain_identifier)?;
                self.silently(Self::kind)?;
            }
            if self.text.get(self.at)? != &b'E' {
                self.write(" + ");
            }
        }
        if !self.takes(b'L') {
            return None;
        }
        self.base_62().map(|_| ())
    }

    fn constant(&mut self) -> Option<()> {
        if self.takes(b'B') {
            return self.back(Self::constant);
        }
        if self.takes(b'p') {
            self.write("_");
            return Some(());
        }
        self.silently(|v0| v0.take().and_then(basic).map(|_| ()))?;
        if self.takes(b'n') {
            self.write("-");
        }
        let start = self.at;
        while self.take()? != b'_' {}
        let digits = str::from_utf8(self.text.get(start..self.at - 1)?).ok()?;
        let number = if digits.is_empty() { 0 } else { u64::from_str_radix(digits, 16).ok()? };
        self.write(&number.to_string());
        Some(())
    }

    /// One production after the other, up to an `E`.
    fn list(&mut self, one: fn(&mut Self) -> Option<()>) -> Option<()> {
        let mut is_first = true;
        while !self.takes(b'E') {
            if !is_first {
                self.write(", ");
            }
            is_first = false;
            one(self)?;
        }
        Some(())
    }

    fn bracketed(&mut self, inner: impl FnOnce(&mut Self) -> Option<()>) -> Option<()> {
        self.write("<");
        inner(self)?;
        self.write(">");
        Some(())
    }

    fn silently(&mut self, inner: impl FnOnce(&mut Self) -> Option<()>) -> Option<()> {
        let length = self.out.len();
        inner(self)?;
        self.out.truncate(length);
        Some(())
    }

    fn back(&mut self, production: fn(&mut Self) -> Option<()>) -> Option<()> {
        let tag = self.at - 1;
        let target = usize::try_from(self.base_62()?).ok().filter(|target| *target < tag)?;
        let here = std::mem::replace(&mut self.at, target);
        production(self)?;
        self.at = here;
        Some(())
    }

    fn identifier(&mut self) -> Option<()> {
        self.disambiguator()?;
        self.plain_identifier()
    }

    fn plain_identifier(&mut self) -> Option<()> {
        if self.takes(b'u') {
            return None; // not ASCII
        }
        let start = self.at;
        if !self.takes(b'0') {
            while self.text.get(self.at)?.is_ascii_digit() {
                self.at += 1;
            }
        }
        let length: usize = str::from_utf8(&self.text[start..self.at]).ok()?.parse().ok()?;
        self.takes(b'_');
        let name = str::from_utf8(self.text.get(self.at..)?.get(..length)?).ok()?;
        self.at += length;
        self.write(name);
        Some(())
    }

    fn disambiguator(&mut self) -> Option<u64> {
        if self.takes(b's') { self.base_62()?.checked_add(1) } else { Some(0) }
    }

    fn binder(&mut self) -> Option<()> {
        if self.takes(b'G') {
            self.base_62()?;
        }
        Some(())
    }

    fn base_62(&mut self) -> Option<u64> {
        let mut number: Option<u64> = None;
        loop {
            let digit = match self.take()? {
                b'_' => return number.map_or(Some(0), |number| number.checked_add(1)),
                digit @ b'0'..=b'9' => digit - b'0',
                digit @ b'a'..=b'z' => digit - b'a' + 10,
                digit @ b'A'..=b'Z' => digit - b'A' + 36,
                _ => return None,
            };
            number = Some(number.unwrap_or(0).checked_mul(62)?.checked_add(digit.into())?);
        }
    }

    fn count(&mut self) -> Option<()> {
        self.steps += 1;
        (self.steps < 1000).then_some(())
    }
}

/// The types that are one letter.
fn basic(tag: u8) -> Option<&'static str> {
    Some(match tag {
        b'a' => "i8",
        b'b' => "bool",
        b'c' => "char",
        b'd' => "f64",
        b'e' => "str",
        b'f' => "f32",
        b'h' => "u8",
        b'i' => "isize",
        b'j' => "usize",
        b'l' => "i32",
        b'm' => "u32",
        b'n' => "i128",
        b'o' => "u128",
        b's' => "i16",
        b't' => "u16",
        b'u' => "()",
        b'v' => "...",
        b'x' => "i64",
        b'y' => "u64",
        b'z' => "!",
        b'p' => "_",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    // As `llvm-cxxfilt` has them, but for the impls' own paths, which it prints no more than we do.

    #[test]
    fn truth_names_of_the_flight_code() {
        for (mangled, readable) in [
            (
                "_RNvMNtCs163u6RYMJt6_17skyroost_firmware5agentNtB2_11FlightAgent4step",
                "<skyroost_firmware::agent::FlightAgent>::step",
            ),
            (
                "_RINvNtCs2pbOJsOxIua_4core9panicking13assert_failedyyEB4_",
                "core::panicking::assert_failed::<u64, u64>",
            ),
            (
                "_RINvMNtNtCs3XPF8eqIezG_16embassy_executor8platform6threadNtB3_8Executor3runNCNvCs92WV3PUcZJ6_9stm32f40518___cortex_m_rt_main0EB1f_",
                "<embassy_executor::platform::thread::Executor>::run::<stm32f405::__cortex_m_rt_main::{closure#0}>",
            ),
            (
                "_RNvXs1g_NtCs2pbOJsOxIua_4core3fmtRDNtB6_5DebugEL_Bx_3fmtB8_",
                "<&dyn core::fmt::Debug as core::fmt::Debug>::fmt",
            ),
        ] {
            assert_eq!(demangle(mangled), readable);
        }
    }

    #[test]
    fn arrays_lengths_and_references() {
        assert_eq!(demangle("_RINvCs1_1a1bKj1f_Ahj4_QShE"), "a::b::<31, [u8; 4], &mut [u8]>");
        assert_eq!(demangle("_RINvCs1_1a1bFUKCThmEEuTEE"), "a::b::<fn((u8, u32)), ()>");
    }

    #[test]
    fn older_names_lose_their_hash() {
        let mangled = "_ZN4core9panicking9panic_fmt17h0123456789abcdefE";
        assert_eq!(demangle(mangled), "core::panicking::panic_fmt");
        let mangled =
            "_ZN60_$LT$alloc..string..String$u20$as$u20$core..fmt..Display$GT$3fmt17h0123456789abcdefE";
        assert_eq!(demangle(mangled), "<alloc::string::String as core::fmt::Display>::fmt");
    }

    #[test]
    fn other_names_stay() {
        for name in
            ["main", "Reset", "_R", "_RNv", "_ZN", "_ZN99x", "_RNvB_", "_RNvC1_1a", "_RB_", "_RNvYB_B_"]
        {
            assert_eq!(demangle(name), name);
        }
    }
}
