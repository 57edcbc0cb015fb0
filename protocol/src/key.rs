//! Keys, and how they seal frames: ChaCha20-Poly1305 (RFC 8439) under a key of each session.
//!
//! Drone and control center share one root key for each drone, which seals nothing itself. What seals frames is the half of a
//! block of ChaCha20 under the root key, as RFC 8439 (2.6) makes keys for tags: the block is a pseudorandom function of its nonce,
//! and the nonce says what the key is for, who sends, which boot of the sender and which boot of the receiver it is. So a key never seals two frames of one number as long as no boot epoch comes
//! twice, and what was sent to a boot that is over opens for nobody: nothing can be replayed to a drone or a control center
//! that has started anew, although neither keeps a clock or a memory for that.
//!
//! The AEAD of RFC 8439 is put together here of its two parts: the crate that has it whole can panic, which flight code must
//! not, and takes three passes over a frame. The tests hold it against that crate and against figures from the RFC.
//!
//! Keys are not printed, and are overwritten when they are dropped.

use crate::codec::MAX_BODY;
use crate::header::{HEADER_LEN, TAG_LEN};
use crate::units::DroneId;
use chacha20::{
    ChaCha20,
    cipher::{KeyIvInit, StreamCipher},
};
use core::fmt;
use poly1305::{
    Poly1305,
    universal_hash::{KeyInit, UniversalHash},
};
use serde::{Deserialize, Serialize};
use zeroize::{Zeroize, ZeroizeOnDrop};

/// Bytes of a key.
pub const KEY_LEN: usize = 32;
/// Bytes of a key's fingerprint.
pub const FINGERPRINT_LEN: usize = 8;

/// Bytes of a block of the cipher.
const BLOCK_LEN: usize = 64;

/// Room to work on a body in.
pub type Room = [u8; BLOCK_LEN + MAX_BODY];
/// Such room.
pub const ROOM: Room = [0; BLOCK_LEN + MAX_BODY];

/// What a key that is derived is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Management frames, in every version.
    Management = 0,
    /// Drone to control center.
    Up = 1,
    /// Control center to drone.
    Down = 2,
    /// Drone to fleet mates.
    Peer = 3,
    /// Naming a key without telling it.
    Fingerprint = 4,
}

/// A secret of 256 bits.
#[derive(Clone, Serialize, Deserialize)]
pub struct Key([u8; KEY_LEN]);

impl Key {
    /// A key of these bytes, which must be random.
    #[must_use]
    pub const fn new(bytes: [u8; KEY_LEN]) -> Self {
        Self(bytes)
    }

    /// The bytes, for whoever keeps them.
    #[must_use]
    pub const fn expose(&self) -> &[u8; KEY_LEN] {
        &self.0
    }

    /// The key of the frames that this boot of `sender` sends to this boot of the receiver; 0 where that is not known or
    /// there are several receivers.
    #[must_use]
    pub fn session(
        &self,
        purpose: Purpose,
        sender: DroneId,
        sender_epoch: u16,
        receiver_epoch: u16,
    ) -> SessionKey {
        SessionKey(self.derive(purpose, sender, sender_epoch, receiver_epoch))
    }

    /// Names the key without telling it.
    #[must_use]
    pub fn fingerprint(&self) -> [u8; FINGERPRINT_LEN] {
        let derived = self.derive(Purpose::Fingerprint, DroneId(0), 0, 0);
        derived.0.first_chunk().copied().unwrap_or_default()
    }

    fn derive(&self, purpose: Purpose, sender: DroneId, sender_epoch: u16, receiver_epoch: u16) -> Self {
        let ([s0, s1], [e0, e1], [r0, r1]) =
            (sender.0.to_le_bytes(), sender_epoch.to_le_bytes(), receiver_epoch.to_le_bytes());
        let [m0, m1, m2, m3] = *b"SRK1";
        let input = [m0, m1, m2, m3, purpose as u8, s0, s1, e0, e1, r0, r1, 0];
        let mut derived = Self([0; KEY_LEN]);
        // Never fails: the cipher has 2^32 blocks.
        let _ = apply_cipher(self, &input, &mut derived.0);
        derived
    }
}

/// Adds the cipher's stream to `text`; none where the stream is at its end.
#[inline(never)] // once: a board has little room
fn apply_cipher(key: &Key, nonce: &[u8; 12], text: &mut [u8]) -> Option<()> {
    ChaCha20::new(&key.0.into(), &(*nonce).into()).try_apply_keystream(text).ok()
}

impl PartialEq for Key {
    fn eq(&self, other: &Self) -> bool {
        // All bytes are compared, so that the time taken says nothing of where they differ.
        self.0.iter().zip(other.0).fold(0, |differing, (a, b)| differing | (a ^ b)) == 0
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(..)")
    }
}

impl Drop for Key {
    fn drop(&mut self) {
        self.0.zeroize();
    }
}

impl ZeroizeOnDrop for Key {}

/// The key of one session: see [`Key::session`].
#[derive(Clone, Debug, PartialEq)]
pub struct SessionKey(Key);

impl SessionKey {
    /// Encrypts `body` in its place and returns the tag over `head` and body; none where `body` is longer than any message. No
    /// two frames of one session may have one number.
    #[must_use]
    pub fn seal(&self, sequence: u32, head: &[u8; HEADER_LEN], body: &mut [u8]) -> Option<[u8; TAG_LEN]> {
        let mut room = ROOM;
        let worked = self.work(sequence, body, &mut room)?;
        body.iter_mut().zip(worked.body).for_each(|(to, from)| *to = *from);
        Some(tag(worked.tag_key, head, body).finalize().into())
    }

    /// Decrypts `body` in `room`; none if head, body and tag are not as they were sealed.
    #[must_use]
    pub fn open<'r>(
        &self,
        sequence: u32,
        head: &[u8; HEADER_LEN],
        body: &[u8],
        sealed: &[u8; TAG_LEN],
        room: &'r mut Room,
    ) -> Option<&'r [u8]> {
        let worked = self.work(sequence, body, room)?;
        // In constant time.
        tag(worked.tag_key, head, body).verify(&(*sealed).into()).ok()?;
        Some(worked.body)
    }

    /// The cipher's first block, whose half is the key of the tag, and `text` with the blocks after it (RFC 8439, 2.6 and 2.8):
    /// one pass over both.
    fn work<'r>(&self, sequence: u32, text: &[u8], room: &'r mut Room) -> Option<Worked<'r>> {
        let work = room.get_mut(..BLOCK_LEN + text.len())?;
        let (first, body) = work.split_first_chunk_mut::<BLOCK_LEN>()?;
        *first = [0; BLOCK_LEN];
        body.copy_from_slice(text);
        apply_cipher(&self.0, &nonce(sequence), work)?;
        let (first, body) = work.split_first_chunk::<BLOCK_LEN>()?;
        Some(Worked { tag_key: first.first_chunk()?, body })
    }
}

/// What the cipher makes of a body.
struct Worked<'r> {
    tag_key: &'r [u8; KEY_LEN],
    body: &'r [u8],
}

/// The tag over both, each padded to whole blocks, and their lengths (RFC 8439, 2.8).
#[inline(never)] // once: a board has little room
fn tag(key: &[u8; KEY_LEN], head: &[u8; HEADER_LEN], sealed: &[u8]) -> Poly1305 {
    let mut tag = Poly1305::new(&(*key).into());
    tag.update_padded(head);
    tag.update_padded(sealed);
    // Frames are short: two bytes of each length are enough.
    let [[a0, a1], [b0, b1]] = [HEADER_LEN, sealed.len()].map(|length| (length as u16).to_le_bytes());
    tag.update(&[[a0, a1, 0, 0, 0, 0, 0, 0, b0, b1, 0, 0, 0, 0, 0, 0].into()]);
    tag
}

/// The frame's number, which no other frame of the session has.
fn nonce(sequence: u32) -> [u8; 12] {
    let [a, b, c, d] = sequence.to_le_bytes();
    [0, 0, 0, 0, 0, 0, 0, 0, a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::*;
    use chacha20poly1305::{ChaCha20Poly1305, aead::AeadInOut};
    use proptest::{collection::vec, prelude::*};
    use std::format;

    #[test]
    fn keys_are_told_apart_by_all_that_they_are_for() {
        let key = Key::new([7; KEY_LEN]);
        let session = |purpose, sender, own, other| key.session(purpose, DroneId(sender), own, other);
        let all = [
            session(Purpose::Up, 1, 1, 1),
            session(Purpose::Down, 1, 1, 1),
            session(Purpose::Up, 2, 1, 1),
            session(Purpose::Up, 1, 2, 1),
            session(Purpose::Up, 1, 1, 2),
            Key::new([8; KEY_LEN]).session(Purpose::Up, DroneId(1), 1, 1),
        ];
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                assert_ne!(a, b);
            }
        }
    }

    proptest! {
        /// Against the crate that has the AEAD whole.
        #[test]
        fn truth_frames_are_sealed_as_others_seal_them(
            key: [u8; KEY_LEN], sequence: u32, head: [u8; HEADER_LEN], body in vec(any::<u8>(), 0..=MAX_BODY),
            at: prop::sample::Index, flip in 1..=255_u8,
        ) {
            let session = SessionKey(Key::new(key));
            let mut sealed = body.clone();
            let tag = session.seal(sequence, &head, &mut sealed).expect("no longer than a message");
            let (mut expected, mut room) = (body.clone(), ROOM);
            let cipher = ChaCha20Poly1305::new(&key.into());
            let of_crate = cipher.encrypt_inout_detached(&nonce(sequence).into(), &head, expected.as_mut_slice().into());
            prop_assert_eq!(<[u8; TAG_LEN]>::from(of_crate.expect("it is short")), tag);
            prop_assert_eq!(&sealed, &expected);
            prop_assert_eq!(session.open(sequence, &head, &sealed, &tag, &mut room), Some(&body[..]));
            let mut all = [&head[..], &sealed, &tag].concat();
            let at = at.index(all.len());
            all[at] ^= flip;
            let (head, rest) = all.split_first_chunk().expect("a header");
            let (sealed, tag) = rest.split_last_chunk().expect("a tag");
            prop_assert_eq!(session.open(sequence, head, sealed, tag, &mut room), None);
        }
    }

    #[test]
    fn keys_are_not_printed() {
        let key = Key::new([0xab; KEY_LEN]);
        let session = key.session(Purpose::Up, DroneId(1), 1, 1);
        assert_eq!(format!("{key:?} {session:?}"), "Key(..) SessionKey(Key(..))");
        assert_ne!(key.fingerprint(), [0xab; FINGERPRINT_LEN]);
    }
}
