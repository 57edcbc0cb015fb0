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

/// Seconds to a boot epoch. No board is born twice in so short a time: its clock takes longer to lock.
const EPOCH_S: i64 = 4;

/// Epoch under which a board is born, so that its sequence numbers, which start anew, never repeat.
///
/// Receivers compare epochs modulo 2^16 (RFC 1982) and drop what is not newer than the last one they
/// heard. So an epoch is GPS time in units of four seconds, which goes on whatever power is lost, and
/// compares rightly for 36 hours. The last epoch is kept in a backup register of the real-time clock as
/// well, over every reset and, with a battery at `VBAT`, over a loss of power: should time ever have run
/// ahead, the next birth is newer all the same. Where that register was lost, time alone decides.
#[must_use]
pub const fn epoch_at_birth(last: Option<u16>, gps_s: i64) -> u16 {
    let by_time = gps_s.div_euclid(EPOCH_S) as u16;
    match last {
        Some(last) if (by_time.wrapping_sub(last) as i16) <= 0 => last.wrapping_add(1),
        _ => by_time,
    }
}

/// The last epoch, from the register that holds it; none when that was lost.
///
/// The register's upper half is a mark over the lower one, so that what a register holds at power-on is
/// not taken for an epoch.
#[must_use]
pub const fn epoch_from_register(register: u32) -> Option<u16> {
    let epoch = register as u16;
    if register >> 16 == mark(epoch) { Some(epoch) } else { None }
}

/// What to put into the register.
#[must_use]
pub const fn register_of_epoch(epoch: u16) -> u32 {
    mark(epoch) << 16 | epoch as u32
}

const fn mark(epoch: u16) -> u32 {
    (MAGIC ^ !(epoch as u32)) & 0xffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_empty_register_holds_no_epoch() {
        assert_eq!(epoch_from_register(0), None);
        assert_eq!(epoch_from_register(u32::MAX), None);
    }

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
        /// Every birth is newer than all before it within a day and a half, as receivers compare.
        #[test]
        fn truth_a_later_birth_is_newer(
            first_gps_s in 0..4_000_000_000_i64,
            after_s in 4..131_000_i64,
            kept: bool,
        ) {
            let first = epoch_at_birth(None, first_gps_s);
            let next = epoch_at_birth(kept.then_some(first), first_gps_s + after_s);
            prop_assert!((next.wrapping_sub(first) as i16) > 0);
        }

        /// With the register, whatever time does.
        #[test]
        fn with_the_register_it_is_newer_at_any_time(last: u16, gps_s: i64) {
            let next = epoch_at_birth(Some(last), gps_s);
            prop_assert!((next.wrapping_sub(last) as i16) > 0);
        }

        /// One flipped bit is noticed.
        #[test]
        fn damage_is_noticed(epoch: u16, bit in 0..32_u32) {
            let register = register_of_epoch(epoch);
            prop_assert_eq!(epoch_from_register(register), Some(epoch));
            prop_assert_eq!(epoch_from_register(register ^ (1 << bit)), None);
        }
    }
}
