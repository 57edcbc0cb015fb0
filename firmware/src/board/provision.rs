//! What a board is given once, on the ground: who it is and its root key, in a sector of flash that no image uses.
//!
//! | offset | bytes | field |
//! |---|---|---|
//! | 0 | 4 | magic, `"SRPV"` |
//! | 4 | 1 | format, 1 |
//! | 5 | 1 | link: 1 sealed, 2 open |
//! | 6 | 2 | drone |
//! | 8 | 32 | root key; zeros for an open link |
//! | 40 | 4 | CRC-32 of all before |
//! | 64 | .. | boots: one word for each, zero once it is spent |
//!
//! Integers are little-endian. Each boot spends a word, so that no boot epoch comes twice under one key, whatever power is
//! lost and whatever time it is. Flash loses bits without being erased: the words last for 32,752 boots, and a sector that is
//! written anew, with a new key, has them all again.

use skyroost_protocol::{
    key::{KEY_LEN, Key},
    stream::checksum,
    units::DroneId,
};

/// Bytes of the sector.
pub const SECTOR_LEN: usize = 128 * 1024;
/// Where the words of the boots begin.
pub const BOOTS_AT: usize = 64;
/// Boots that the sector has words for.
pub const MOST_BOOTS: u16 = ((SECTOR_LEN - BOOTS_AT) / WORD) as u16;
/// Bytes of what is given.
pub const PROVISION_LEN: usize = 44;
/// A word of flash.
const WORD: usize = 4;

const _: () = assert!(BOOTS_AT >= PROVISION_LEN, "boots begin after what is given");

const MAGIC: [u8; 4] = *b"SRPV";
const FORMAT: u8 = 1;
const SEALED: u8 = 1;
const OPEN: u8 = 2;

/// What a board is given.
#[derive(Clone, Debug, PartialEq)]
pub struct Provision {
    /// Who it is.
    pub drone: DroneId,
    /// The root key of its link; none for a link that whoever can send can command the drone over.
    pub key: Option<Key>,
}

/// Why a sector says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProvisionError {
    /// Nothing was ever written there.
    Empty,
    /// It does not begin as it should, or is of another format.
    Format,
    /// Its checksum is not that of its bytes.
    Checksum,
}

impl Provision {
    /// As it stands in flash.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; PROVISION_LEN] {
        let mut bytes = [0; PROVISION_LEN];
        let (body, end) = bytes.split_at_mut(PROVISION_LEN - size_of::<u32>());
        let [id0, id1] = self.drone.0.to_le_bytes();
        let link = if self.key.is_some() { SEALED } else { OPEN };
        let [m0, m1, m2, m3] = MAGIC;
        let head = [m0, m1, m2, m3, FORMAT, link, id0, id1];
        let key = self.key.as_ref().map_or(&[0; KEY_LEN], Key::expose);
        body.iter_mut().zip(head.iter().chain(key)).for_each(|(to, from)| *to = *from);
        end.copy_from_slice(&checksum(body).to_le_bytes());
        bytes
    }

    /// Reads what stands in flash.
    ///
    /// # Errors
    /// [`ProvisionError`].
    pub fn read(bytes: &[u8; PROVISION_LEN]) -> Result<Self, ProvisionError> {
        let (body, end) = bytes.split_at(PROVISION_LEN - size_of::<u32>());
        if bytes.iter().all(|byte| *byte == 0xff) {
            return Err(ProvisionError::Empty);
        }
        let (Some([m0, m1, m2, m3, format, link, id0, id1]), Some(key)) =
            (body.first_chunk::<8>(), body.last_chunk::<KEY_LEN>())
        else {
            return Err(ProvisionError::Format);
        };
        if [*m0, *m1, *m2, *m3] != MAGIC || *format != FORMAT || !matches!(*link, SEALED | OPEN) {
            return Err(ProvisionError::Format);
        }
        if end != checksum(body).to_le_bytes() {
            return Err(ProvisionError::Checksum);
        }
        let key = (*link == SEALED).then(|| Key::new(*key));
        Ok(Self { drone: DroneId(u16::from_le_bytes([*id0, *id1])), key })
    }
}

/// The epoch of this boot, and the offset in the sector of the word that it spends; none when all are spent. `is_spent` looks at the
/// word at an offset.
///
/// Words are spent in their order, so that the first one left is found by halves.
#[must_use]
pub fn next_boot(mut is_spent: impl FnMut(usize) -> bool) -> Option<(u16, usize)> {
    let offset = |boot: u16| BOOTS_AT + WORD * usize::from(boot);
    let (mut spent, mut left) = (0, MOST_BOOTS);
    while spent < left {
        let middle = spent + (left - spent) / 2;
        if is_spent(offset(middle)) {
            spent = middle + 1;
        } else {
            left = middle;
        }
    }
    (spent < MOST_BOOTS).then(|| (spent + 1, offset(spent)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(drone: u16, key: Option<[u8; KEY_LEN]>, at in 0..PROVISION_LEN, flip in 1..=255_u8) {
            let given = Provision { drone: DroneId(drone), key: key.map(Key::new) };
            let mut bytes = given.to_bytes();
            prop_assert_eq!(Provision::read(&bytes), Ok(given));
            bytes[at] ^= flip;
            prop_assert!(Provision::read(&bytes).is_err());
        }

        /// Against looking at one after the other.
        #[test]
        fn the_next_boot_is_the_first_word_left(boots in 0..=MOST_BOOTS) {
            let is_spent = |at: usize| (at - BOOTS_AT) / WORD < usize::from(boots);
            let expected = (boots < MOST_BOOTS).then(|| (boots + 1, BOOTS_AT + WORD * usize::from(boots)));
            prop_assert_eq!(next_boot(is_spent), expected);
        }
    }

    #[test]
    fn what_was_never_written_is_told_from_what_is_damaged() {
        assert_eq!(Provision::read(&[0xff; PROVISION_LEN]), Err(ProvisionError::Empty));
        assert_eq!(Provision::read(&[0; PROVISION_LEN]), Err(ProvisionError::Format));
        assert_eq!(MOST_BOOTS, 32_752, "half of the epochs, so that all compare rightly");
    }
}
