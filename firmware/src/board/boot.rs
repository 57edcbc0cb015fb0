//! Why the board has started, and what of it survives a reset.

/// Why the chip was reset (RM0090, 7.3.21: `RCC_CSR`), as the bits 25 to 31 of that register.
///
/// Several can be set: power-on sets the brown-out's bit as well, and every reset that the chip makes
/// itself pulls the reset pin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResetCause(pub u8);

impl ResetCause {
    const BROWN_OUT: u8 = 1;
    const PIN: u8 = 1 << 1;
    const POWER: u8 = 1 << 2;
    const SOFTWARE: u8 = 1 << 3;
    const WATCHDOG: u8 = 1 << 4;
    const WINDOW_WATCHDOG: u8 = 1 << 5;
    const LOW_POWER: u8 = 1 << 6;

    /// From the value of `RCC_CSR`.
    #[must_use]
    pub const fn from_csr(csr: u32) -> Self {
        Self((csr >> 25) as u8 & 0x7f)
    }

    /// The cause behind the other bits, in a word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        // From what says most to what any reset sets as well.
        if self.0 & Self::POWER != 0 {
            "power-on"
        } else if self.0 & Self::BROWN_OUT != 0 {
            "brown-out"
        } else if self.0 & Self::WATCHDOG != 0 {
            "watchdog"
        } else if self.0 & Self::WINDOW_WATCHDOG != 0 {
            "window watchdog"
        } else if self.0 & Self::SOFTWARE != 0 {
            "software"
        } else if self.0 & Self::LOW_POWER != 0 {
            "low-power"
        } else if self.0 & Self::PIN != 0 {
            "pin"
        } else {
            "unknown"
        }
    }
}

/// Why the board reset itself, kept over that reset in another backup register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum LastWords {
    /// It did not, or nobody wrote it down.
    #[default]
    None,
    /// A panic.
    Panic,
    /// A fault of the processor: an access to nowhere, an instruction that is none.
    Fault,
    /// The supply fell below the supervisor's threshold and came back.
    Supply,
    /// The crystal stopped.
    Crystal,
}

impl LastWords {
    const ALL: [Self; 5] = [Self::None, Self::Panic, Self::Fault, Self::Supply, Self::Crystal];

    /// What a register says; none when it holds anything else.
    #[must_use]
    pub fn from_register(register: u32) -> Self {
        Self::ALL.into_iter().find(|words| words.register() == register).unwrap_or_default()
    }

    /// What to put into the register.
    #[must_use]
    pub const fn register(self) -> u32 {
        mark(self as u16) << 16 | self as u32
    }

    /// In a word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Panic => "panic",
            Self::Fault => "fault",
            Self::Supply => "supply",
            Self::Crystal => "crystal",
        }
    }
}

/// Marks a backup register that this program wrote.
const MAGIC: u32 = 0x5b00;

const fn mark(words: u16) -> u32 {
    (MAGIC ^ !(words as u32)) & 0xffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn last_words_are_remembered_and_nothing_else() {
        for words in LastWords::ALL {
            assert_eq!(LastWords::from_register(words.register()), words);
        }
        for register in [0, u32::MAX, LastWords::Fault as u32] {
            assert_eq!(LastWords::from_register(register), LastWords::None);
        }
    }

    #[test]
    fn names_the_cause_behind_the_pin() {
        // Power-on sets power, brown-out and pin (RM0090, 7.3.21: reset value 0x0e00_0000).
        assert_eq!(ResetCause::from_csr(0x0e00_0000).name(), "power-on");
        assert_eq!(ResetCause::from_csr(0x0600_0000).name(), "brown-out");
        assert_eq!(ResetCause::from_csr(0x2400_0003).name(), "watchdog");
        assert_eq!(ResetCause::from_csr(0x1400_0000).name(), "software");
        assert_eq!(ResetCause::from_csr(0x0400_0000).name(), "pin");
        assert_eq!(ResetCause::from_csr(0).name(), "unknown");
    }

    proptest! {
        /// One flipped bit is noticed.
        #[test]
        fn damage_is_noticed(which in 0..LastWords::ALL.len(), bit in 0..32_u32) {
            let words = LastWords::ALL[which];
            prop_assert_eq!(LastWords::from_register(words.register() ^ (1 << bit)), LastWords::None);
        }
    }
}
