//! Either end of the link between a drone and the control center: numbers, window and keys.
//!
//! # How the ends find each other
//! A drone that boots knows its own boot epoch and not the control center's. Its hello is sealed without that
//! ([`FLAG_UNBOUND`]): it proves who says it and says nothing of when. The control center answers to that boot, bound to its
//! own; with the first such frame the drone knows that somebody who has the key speaks to this very boot, and binds
//! whatever it says from then on. With the first bound frame the control center knows the same. A recorded hello only makes
//! the control center answer to a boot that is over, which nobody can go on from.
//!
//! A control center that starts anew knows of no drone which boot it is at. It asks by a management frame
//! ([`manage`]), or remembers; its first bound frame makes the drone change over to it, as its boot epoch is
//! newer.
//!
//! # How a key is changed
//! The control center makes a key and tells it under the old one ([`Command::Rekey`](crate::message::Command::Rekey)). The drone
//! keeps it beside the old one and acknowledges ([`LinkEnd::offer`]). Only then does the control center seal with it
//! ([`LinkEnd::confirmed`]), and only when such a frame has come does the drone. Each forgets the old key with the first frame that comes
//! under the new one. A bit in the header ([`FLAG_SLOT`]) says which of the two it is. A boot of either end makes an end of that:
//! the next session begins with the root key.

use crate::codec::{Body, Sender, parse};
use crate::error::{DecodeError, EncodeError};
use crate::header::{FLAG_SLOT, FLAG_UNBOUND, Header, Kind};
use crate::key::{Key, Purpose, Room, SessionKey};
use crate::manage::{self, Management};
use crate::session::{Receiver, Verdict};
use crate::units::DroneId;

/// The boot epoch that nobody has: the other end is not known.
const UNKNOWN: u16 = 0;

/// Why a frame was not taken in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkFault {
    /// It is no frame, or none that this end may open.
    Decode(DecodeError),
    /// Nothing that this link carries: another kind or another sender.
    Unexpected,
    /// Authentic, and seen before or too old; or under a key that was changed since, which nobody can tell to be authentic.
    Repeated,
}

impl From<DecodeError> for LinkFault {
    fn from(error: DecodeError) -> Self {
        Self::Decode(error)
    }
}

/// A frame that was taken in.
#[derive(Clone, Copy, Debug)]
pub struct Opened<'a> {
    /// Its header.
    pub header: Header,
    /// Its body, in the clear.
    pub body: &'a [u8],
    /// What the window says: [`Verdict::Fresh`] or [`Verdict::NewEpoch`].
    pub verdict: Verdict,
    /// Whether the sender knew which boot of this end it talked to. Where it did not, only a hello may be believed.
    pub bound: bool,
}

/// One end of a link.
#[derive(Clone, Debug)]
pub struct LinkEnd {
    sender: Sender,
    receiver: Receiver,
    other: DroneId,
    /// The boot of the other end that this one talks to.
    other_epoch: u16,
    /// Whether the other end has proved to know of this boot.
    bound: bool,
    /// Where there is none, nothing is sealed.
    root: Option<Key>,
    /// Opens what the other end sends.
    incoming: Option<SessionKey>,
    incoming_slot: u8,
    /// Offered and not heard yet.
    next: Option<Key>,
}

impl LinkEnd {
    /// An end that has heard nothing, of the drone or the control center `own`, with this root key; without one, nothing is
    /// sealed and nothing sealed is accepted. `boot_epoch` must rise with every boot and never be 0.
    #[must_use]
    pub const fn new(own: DroneId, boot_epoch: u16, other: DroneId, root: Option<Key>) -> Self {
        Self {
            sender: Sender::new(own, boot_epoch),
            receiver: Receiver::new(),
            other,
            other_epoch: UNKNOWN,
            bound: false,
            root,
            incoming: None,
            incoming_slot: 0,
            next: None,
        }
    }

    /// The window and what it counted.
    #[must_use]
    pub const fn receiver(&self) -> &Receiver {
        &self.receiver
    }

    /// Frames sent so far.
    #[must_use]
    pub const fn sent(&self) -> u32 {
        self.sender.next_sequence()
    }

    /// Whether frames are sealed.
    #[must_use]
    pub const fn is_sealed(&self) -> bool {
        self.root.is_some()
    }

    /// The boot of the other end that this one talks to, if it knows.
    #[must_use]
    pub const fn other_epoch(&self) -> Option<u16> {
        if self.other_epoch == UNKNOWN { None } else { Some(self.other_epoch) }
    }

    /// Whether the other end has proved to know which boot of this one it talks to; where nothing is sealed, whether it
    /// was heard.
    #[must_use]
    pub const fn is_bound(&self) -> bool {
        self.bound
    }

    /// Writes the next frame to the start of `out` and returns its length.
    ///
    /// # Errors
    /// [`EncodeError`]; the number is then not used up.
    pub fn encode_into<B: Body>(&mut self, message: &B, out: &mut [u8]) -> Result<usize, EncodeError> {
        if let (Some(root), None) = (&self.root, self.sender.seal_flags()) {
            let key = root.session(self.outgoing(), self.sender.id(), self.sender.boot_epoch(), UNKNOWN);
            self.sender.seal_with(key, FLAG_UNBOUND);
        }
        self.sender.encode_into(message, out)
    }

    /// Takes in a frame; one that is sealed is opened in `room`.
    ///
    /// # Errors
    /// [`LinkFault`]; nothing here has changed then, but for counts of the window.
    pub fn open<'a>(&mut self, bytes: &'a [u8], room: &'a mut Room) -> Result<Opened<'a>, LinkFault> {
        let parcel = parse(bytes)?;
        let header = parcel.header;
        if header.kind != self.incoming() || header.sender != self.other {
            return Err(LinkFault::Unexpected);
        }
        let Some(root) = &self.root else {
            let body = parcel.plain()?;
            let verdict = self.judged(&header)?;
            (self.other_epoch, self.bound) = (header.boot_epoch, true);
            return Ok(Opened { header, body, verdict, bound: true });
        };
        let slot = header.flags & FLAG_SLOT;
        let session = |key: &Key, own_epoch| {
            key.session(self.incoming().purpose(), header.sender, header.boot_epoch, own_epoch)
        };
        let bound = header.flags & FLAG_UNBOUND == 0;
        let known = header.boot_epoch == self.other_epoch && self.incoming.is_some();
        let own_epoch = self.sender.boot_epoch();
        if !bound && header.kind == Kind::Down {
            return Err(LinkFault::Unexpected); // a drone listens to nobody who does not know of its boot
        }
        if !bound || !known {
            // The first frame of a session: the root key's.
            if slot != 0 || header.boot_epoch == UNKNOWN {
                return Err(DecodeError::Forged.into());
            }
            let key = session(root, if bound { own_epoch } else { UNKNOWN });
            let body = parcel.open(&key, room)?;
            let verdict = self.judged(&header)?;
            if bound {
                self.meet(header.boot_epoch);
                self.bound = true;
            }
            return Ok(Opened { header, body, verdict, bound });
        }
        let changed = slot != self.incoming_slot;
        let key = match (&self.next, changed) {
            (Some(next), true) => session(next, own_epoch),
            // Of a key that is forgotten: overtaken by the change.
            (None, true) => return Err(LinkFault::Repeated),
            (_, false) => self.incoming.clone().ok_or(DecodeError::Forged)?,
        };
        let body = parcel.open(&key, room)?;
        let verdict = self.judged(&header)?;
        self.bound = true;
        if changed {
            self.change_over(key);
        }
        Ok(Opened { header, body, verdict, bound })
    }

    /// From now on this end talks to that boot of the other, beginning with the root key. Nothing changes where it does
    /// already, or where that boot is over.
    pub fn meet(&mut self, other_epoch: u16) {
        if other_epoch == UNKNOWN || other_epoch == self.other_epoch || self.receiver.is_over(other_epoch) {
            return;
        }
        (self.other_epoch, self.bound) = (other_epoch, false);
        let (outgoing, incoming) = (self.outgoing(), self.incoming().purpose());
        let Some(root) = &self.root else { return };
        let (own, own_epoch) = (self.sender.id(), self.sender.boot_epoch());
        self.sender.seal_with(root.session(outgoing, own, own_epoch, other_epoch), 0);
        self.incoming = Some(root.session(incoming, self.other, other_epoch, own_epoch));
        (self.incoming_slot, self.next) = (0, None);
    }

    /// Whether a key was offered and has not been heard yet.
    #[must_use]
    pub const fn is_changing(&self) -> bool {
        self.next.is_some()
    }

    /// Keeps a key to change over to, in the place of one that was kept before. Whoever makes keys must not offer another while
    /// a [change is under way](Self::is_changing): the other end may seal with the first already.
    pub fn offer(&mut self, key: Key) {
        self.next = Some(key);
    }

    /// The other end has the key that was offered: seals with it from now on, and opens with the old one until the other end
    /// has changed over as well.
    pub fn confirmed(&mut self) {
        self.seal_with_next(self.incoming_slot ^ FLAG_SLOT);
    }

    /// The other end seals with the key that was offered: so does this one, and the old key is forgotten.
    fn change_over(&mut self, incoming: SessionKey) {
        self.incoming_slot ^= FLAG_SLOT;
        self.incoming = Some(incoming);
        self.seal_with_next(self.incoming_slot);
        self.next = None;
    }

    fn seal_with_next(&mut self, slot: u8) {
        let Some(next) = self.next.as_ref().filter(|_| self.sender.seal_flags() != Some(slot)) else {
            return;
        };
        let key = next.session(self.outgoing(), self.sender.id(), self.sender.boot_epoch(), self.other_epoch);
        self.sender.seal_with(key, slot);
    }

    /// Writes a management frame to the start of `out` and returns its length.
    ///
    /// # Errors
    /// [`EncodeError`].
    pub fn manage(&mut self, message: &Management, out: &mut [u8]) -> Result<usize, EncodeError> {
        let stamp = self.sender.take_stamp();
        manage::encode_into(&stamp, message, self.root.as_ref(), out)
    }

    /// What a management frame of the other end says, and at which of its boots. It may have been said before: nothing says
    /// when.
    ///
    /// # Errors
    /// [`LinkFault`], where it is no such frame.
    pub fn managed(&self, bytes: &[u8]) -> Result<(u16, Management), LinkFault> {
        let (header, message) = manage::decode(bytes, self.root.as_ref())?;
        if header.sender == self.other {
            Ok((header.boot_epoch, message))
        } else {
            Err(LinkFault::Unexpected)
        }
    }

    fn judged(&mut self, header: &Header) -> Result<Verdict, LinkFault> {
        let verdict = self.receiver.accept(header);
        if verdict.is_accepted() { Ok(verdict) } else { Err(LinkFault::Repeated) }
    }

    fn outgoing(&self) -> Purpose {
        if self.sender.id() == DroneId::CONTROL { Purpose::Down } else { Purpose::Up }
    }

    fn incoming(&self) -> Kind {
        if self.other == DroneId::CONTROL { Kind::Down } else { Kind::Up }
    }
}

impl Kind {
    /// What keys of its frames are for.
    #[must_use]
    pub const fn purpose(self) -> Purpose {
        match self {
            Self::Management => Purpose::Management,
            Self::Up => Purpose::Up,
            Self::Down => Purpose::Down,
            Self::Peer => Purpose::Peer,
        }
    }
}
