//! Sealed links: nobody without the key is heard, and nothing is heard twice.

use proptest::prelude::*;
use skyroost_protocol::codec::{MAX_FRAME, encode_into};
use skyroost_protocol::key::{KEY_LEN, ROOM};
use skyroost_protocol::manage::{Identity, MAX_MANAGEMENT, Management};
use skyroost_protocol::message::{Down, Up};
use skyroost_protocol::units::DroneId;
use skyroost_protocol::{DecodeError, HEADER_LEN, Key, LinkEnd, LinkFault, Stamp, TAG_LEN, Verdict, decode};

const DRONE: DroneId = DroneId(3);

fn root() -> Key {
    Key::new(core::array::from_fn(|i| i as u8 + 1))
}

fn drone_end(boot_epoch: u16) -> LinkEnd {
    LinkEnd::new(DRONE, boot_epoch, DroneId::CONTROL, Some(root()))
}

fn control_end(boot_epoch: u16) -> LinkEnd {
    LinkEnd::new(DroneId::CONTROL, boot_epoch, DRONE, Some(root()))
}

fn up(end: &mut LinkEnd) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let length = end.encode_into(&Up::Heartbeat, &mut out).expect("room for a frame");
    out[..length].to_vec()
}

fn down(end: &mut LinkEnd) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let length = end.encode_into(&Down::Heartbeat, &mut out).expect("room for a frame");
    out[..length].to_vec()
}

/// The verdict, and whether the frame was bound.
fn heard(end: &mut LinkEnd, frame: &[u8]) -> Result<(Verdict, bool), LinkFault> {
    let mut room = ROOM;
    end.open(frame, &mut room).map(|opened| (opened.verdict, opened.bound))
}

/// Both ends after hello, welcome and the first bound word.
fn met() -> (LinkEnd, LinkEnd) {
    let (mut drone, mut control) = (drone_end(7), control_end(9));
    let hello = up(&mut drone);
    assert_eq!(heard(&mut control, &hello), Ok((Verdict::NewEpoch, false)));
    control.meet(7);
    let welcome = down(&mut control);
    assert_eq!(heard(&mut drone, &welcome), Ok((Verdict::NewEpoch, true)));
    let first = up(&mut drone);
    assert_eq!(heard(&mut control, &first), Ok((Verdict::Fresh, true)));
    assert!(drone.is_bound() && control.is_bound());
    (drone, control)
}

const FORGED: LinkFault = LinkFault::Decode(DecodeError::Forged);

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Figures of `truth_seal.py`, which is written from the RFC.
#[test]
fn truth_frames_are_what_the_rfc_makes_of_them() {
    fn numbered(end: &mut LinkEnd, sequence: u32, frame: fn(&mut LinkEnd) -> Vec<u8>) -> String {
        // Numbers are not set but used up.
        (0..sequence).for_each(|_| drop(frame(end)));
        hex(&frame(end))
    }
    let (mut drone, mut control) = (drone_end(7), control_end(9));
    let expected = "53520501030300070040e201000100a5beb09bb2657a8120ceb823f8ba9cd0d8";
    assert_eq!(numbered(&mut drone, 123_456, up), expected);
    let mut drone = drone_end(7);
    drone.meet(9);
    let expected = "53520501010300070040e201000100441ae76b1c9bb50e651b5addf010e5eb60";
    assert_eq!(numbered(&mut drone, 123_456, up), expected);
    control.meet(7);
    let expected = "535205020100000900050000000100232660d2219b3d6ca25cedbfb415f84659";
    assert_eq!(numbered(&mut control, 5, down), expected);
    let mut control = control_end(9);
    (0..5).for_each(|_| drop(down(&mut control)));
    let mut out = [0; MAX_MANAGEMENT];
    let length = control.manage(&Management::Identify, &mut out).expect("room for it");
    assert_eq!(hex(&out[..length]), "535200000100000900050000000100acc0f52ff65c2f02aadd4f2496c845e03b");
    assert_eq!(hex(&root().fingerprint()), "807802d7c5c7bb8d");
}

#[test]
fn ends_find_each_other_and_go_on() {
    let (mut drone, mut control) = met();
    for _ in 0..3 {
        let (up, down) = (up(&mut drone), down(&mut control));
        assert_eq!(heard(&mut control, &up), Ok((Verdict::Fresh, true)));
        assert_eq!(heard(&mut control, &up), Err(LinkFault::Repeated));
        assert_eq!(heard(&mut drone, &down), Ok((Verdict::Fresh, true)));
        assert_eq!(heard(&mut drone, &down), Err(LinkFault::Repeated));
    }
}

#[test]
fn bodies_are_not_readable_on_the_way() {
    let (mut drone, _) = met();
    let frame = up(&mut drone);
    let mut plain = [0; MAX_FRAME];
    let stamp = Stamp { sender: DRONE, boot_epoch: 7, sequence: 2 };
    let length = encode_into(&stamp, &Up::Heartbeat, &mut plain).expect("room for a frame");
    assert_eq!(frame.len(), length + TAG_LEN, "sealing takes 16 bytes");
    assert_ne!(frame[HEADER_LEN], plain[HEADER_LEN]);
    assert_eq!(decode(&frame), Err(DecodeError::Sealed));
}

#[test]
fn without_the_key_nothing_is_believed() {
    let (mut drone, mut control) = met();
    let stranger = || Some(Key::new([9; KEY_LEN]));
    let mut impostor = LinkEnd::new(DRONE, 7, DroneId::CONTROL, stranger());
    assert_eq!(heard(&mut control, &up(&mut impostor)), Err(FORGED));
    impostor.meet(9);
    assert_eq!(heard(&mut control, &up(&mut impostor)), Err(FORGED));
    let mut impostor = LinkEnd::new(DroneId::CONTROL, 10, DRONE, stranger());
    impostor.meet(7);
    assert_eq!(heard(&mut drone, &down(&mut impostor)), Err(FORGED));
    // Nor is anything that is not sealed at all, by either side of a link that is.
    let mut open = LinkEnd::new(DroneId::CONTROL, 10, DRONE, None);
    assert_eq!(heard(&mut drone, &down(&mut open)), Err(LinkFault::Decode(DecodeError::Unsealed)));
    assert_eq!(heard(&mut open, &up(&mut drone)), Err(LinkFault::Decode(DecodeError::Sealed)));
}

#[test]
fn a_frame_does_not_come_back_as_anothers() {
    let (mut drone, mut control) = met();
    // To its sender, or to another drone with the same key.
    assert_eq!(heard(&mut drone.clone(), &up(&mut drone)), Err(LinkFault::Unexpected));
    let mut other = LinkEnd::new(DroneId::CONTROL, 9, DroneId(4), Some(root()));
    assert_eq!(heard(&mut other, &up(&mut drone)), Err(LinkFault::Unexpected));
    let mut renamed = up(&mut drone);
    renamed[5] = 4;
    assert_eq!(heard(&mut other, &renamed), Err(FORGED));
    assert!(heard(&mut control, &up(&mut drone)).is_ok());
}

#[test]
fn what_was_said_to_a_boot_that_is_over_opens_for_nobody() {
    let (mut drone, mut control) = met();
    let (said_up, said_down) = (up(&mut drone), down(&mut control));
    // The drone boots: nothing that was said to it before is taken for new, although it remembers nothing.
    let mut drone = drone_end(8);
    assert_eq!(heard(&mut drone, &said_down), Err(FORGED));
    // The control center boots: the same.
    let mut control = control_end(10);
    control.meet(7);
    assert_eq!(heard(&mut control, &said_up), Err(FORGED));
}

#[test]
fn a_recorded_hello_leads_nowhere() {
    let hello = up(&mut drone_end(7));
    // Years later the drone is at its twelfth boot, and the control center at its twentieth.
    let (mut drone, mut control) = (drone_end(12), control_end(20));
    assert_eq!(heard(&mut control, &hello), Ok((Verdict::NewEpoch, false)));
    control.meet(7);
    assert_eq!(heard(&mut drone, &down(&mut control)), Err(FORGED));
    assert!(!control.is_bound());
    // The true one still gets through, and then the old one is over.
    assert_eq!(heard(&mut control, &up(&mut drone)), Ok((Verdict::NewEpoch, false)));
    control.meet(12);
    assert!(heard(&mut drone, &down(&mut control)).is_ok());
    assert!(heard(&mut control, &up(&mut drone)).is_ok());
    assert_eq!(heard(&mut control, &hello), Err(LinkFault::Repeated));
    control.meet(7);
    assert_eq!(control.other_epoch(), Some(12));
}

#[test]
fn a_control_center_that_starts_anew_is_followed_at_once() {
    let (mut drone, _) = met();
    let mut control = control_end(10);
    control.meet(7); // it remembers, or has asked
    assert_eq!(heard(&mut drone, &down(&mut control)), Ok((Verdict::NewEpoch, true)));
    assert_eq!(heard(&mut control, &up(&mut drone)), Ok((Verdict::NewEpoch, true)));
}

#[test]
fn a_key_is_changed_only_when_both_have_it() {
    let (mut drone, mut control) = met();
    let key = || Key::new([0x55; KEY_LEN]);
    let old = up(&mut drone);
    control.offer(key());
    // Told, not yet acknowledged: both go on with the old one.
    drone.offer(key());
    assert!(heard(&mut drone, &down(&mut control)).is_ok());
    let acknowledged = up(&mut drone);
    assert!(heard(&mut control, &acknowledged).is_ok());
    control.confirmed();
    // What the control center says next is lost. The drone goes on with the old one and is heard.
    drop(down(&mut control));
    assert!(heard(&mut control, &up(&mut drone)).is_ok());
    // The first frame under the new key reaches it: from now on nobody opens the old one.
    assert!(heard(&mut drone, &down(&mut control)).is_ok());
    let first = up(&mut drone);
    assert!(heard(&mut control, &first).is_ok());
    assert_eq!(heard(&mut control, &old), Err(LinkFault::Repeated));
    assert!(heard(&mut drone, &down(&mut control)).is_ok());
    // Once more, as the bit that tells keys apart comes back.
    control.offer(Key::new([0x66; KEY_LEN]));
    drone.offer(Key::new([0x66; KEY_LEN]));
    control.confirmed();
    assert!(heard(&mut drone, &down(&mut control)).is_ok());
    assert!(heard(&mut control, &up(&mut drone)).is_ok());
    // A key that was never offered opens nothing.
    control.offer(Key::new([0x77; KEY_LEN]));
    control.confirmed();
    assert_eq!(heard(&mut drone, &down(&mut control)), Err(LinkFault::Repeated));
}

#[test]
fn all_versions_identify_each_other() {
    let (mut drone, mut control) = (drone_end(7), control_end(9));
    let mut out = [0; MAX_MANAGEMENT];
    let length = control.manage(&Management::Identify, &mut out).expect("room for it");
    assert_eq!(drone.managed(&out[..length]), Ok((9, Management::Identify)));
    assert_eq!(out[2], 0, "version 0, which no version refuses");
    let identity = Management::Identity(Identity { version_max: 77, ..Identity::OWN });
    let length = drone.manage(&identity, &mut out).expect("room for it");
    assert_eq!(length, MAX_MANAGEMENT);
    assert_eq!(control.managed(&out[..length]), Ok((7, identity)));
    for at in 0..length {
        let mut damaged = out;
        damaged[at] ^= 1;
        assert!(control.managed(&damaged[..length]).is_err(), "byte {at}");
    }
    // As later versions may say more, so may they say it to this one: open links know no tags.
    let mut longer = vec![b'S', b'R', 0, 0, 0, 3, 0, 7, 0, 1, 0, 0, 0, 12, 0];
    longer.extend([2, 5, 77, 1, 2, 3, 4, 1, 0, 0, 99, 99]);
    let open = LinkEnd::new(DroneId::CONTROL, 9, DRONE, None);
    let told = Identity { version_min: 5, version_max: 77, schema_hash: 0x0403_0201, release: [1, 0, 0] };
    assert_eq!(open.managed(&longer), Ok((7, Management::Identity(told))));
}

proptest! {
    /// A frame that differs from what was sealed in anything is refused, and the true one is taken afterwards.
    #[test]
    fn no_altered_frame_is_taken(flips in proptest::collection::vec((any::<prop::sample::Index>(), 1..=255_u8), 1..4), cut in 0..40_usize) {
        let (mut drone, mut control) = met();
        let frame = up(&mut drone);
        let mut altered = frame.clone();
        for (at, flip) in flips {
            let at = at.index(altered.len());
            altered[at] ^= flip;
        }
        prop_assume!(altered != frame);
        prop_assert!(heard(&mut control, &altered).is_err());
        prop_assert!(heard(&mut control, &frame[..frame.len().saturating_sub(cut + 1)]).is_err());
        prop_assert!(heard(&mut control, &frame).is_ok());
    }

    /// Whatever is lost while a key is changed, whenever, the ends understand each other afterwards.
    #[test]
    fn a_change_of_key_survives_losses(lost in proptest::collection::vec(any::<bool>(), 24)) {
        let (mut drone, mut control) = met();
        let key = || Key::new([0x55; KEY_LEN]);
        control.offer(key());
        let (mut offered, mut confirmed) = (false, false);
        for pair in lost.chunks(2) {
            let (frame, answer) = (down(&mut control), up(&mut drone));
            // A frame that arrives tells the key, until that is acknowledged.
            if !pair[0] {
                prop_assert!(heard(&mut drone, &frame).is_ok());
                if !confirmed && !offered {
                    drone.offer(key());
                    offered = true;
                }
            }
            if !pair[1] {
                prop_assert!(heard(&mut control, &answer).is_ok());
                if offered && !confirmed {
                    control.confirmed();
                    confirmed = true;
                }
            }
        }
        for _ in 0..2 {
            prop_assert!(heard(&mut drone, &down(&mut control)).is_ok());
            prop_assert!(heard(&mut control, &up(&mut drone)).is_ok());
        }
    }
}

/// Ten million frames of somebody without the key: forged, replayed, cut short and altered, at both ends.
#[test]
fn of_ten_million_frames_of_a_stranger_none_is_taken() {
    const FRAMES: u64 = 10_000_000;
    let threads = std::thread::available_parallelism().map_or(1, |cores| cores.get() as u64);
    std::thread::scope(|scope| {
        for thread in 0..threads {
            scope.spawn(move || attack(0x5eed + thread, FRAMES / threads));
        }
    });
}

/// Of so many frames, made by chance of this seed, none is taken, and the link works afterwards.
fn attack(seed: u64, frames: u64) {
    // SplitMix64 (Steele, Lea, Flood 2014): for a test, and in a line.
    let mut state = seed;
    let mut chance = move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    };
    let (mut drone, mut control) = met();
    let mut room = ROOM;
    let mut recorded: Vec<Vec<u8>> = Vec::new();
    for number in 0..frames {
        // Now and then the ends say something, which is recorded.
        if number % 4_096 == 0 {
            for _ in 0..4 {
                let (up, down) = (up(&mut drone), down(&mut control));
                assert!(
                    heard(&mut control, &up).is_ok() && heard(&mut drone, &down).is_ok(),
                    "seed {seed:#x}"
                );
                recorded.extend([up, down]);
            }
            let old = recorded.len().saturating_sub(64);
            recorded.drain(..old);
        }
        let mut frame = recorded[chance() as usize % recorded.len()].clone();
        match chance() % 4 {
            0 => {} // said again
            1 => {
                // Cut short.
                frame.truncate(chance() as usize % frame.len());
            }
            2 => {
                // Bits flipped.
                for _ in 0..=chance() % 3 {
                    let bit = chance() as usize % (8 * frame.len());
                    frame[bit / 8] ^= 1 << (bit % 8);
                }
            }
            _ => {
                // A new number, another flag, another boot, and a body and a tag of one's own.
                frame[4] = 1 | (chance() as u8 & 6);
                frame[7] ^= chance() as u8 & 1;
                let fresh = chance().to_le_bytes();
                frame[9..13].copy_from_slice(&fresh[..4]);
                for byte in &mut frame[HEADER_LEN..] {
                    *byte = chance() as u8;
                }
            }
        }
        // A frame with its bits flipped twice is the frame: that one has been heard.
        for end in [&mut drone, &mut control] {
            assert!(end.open(&frame, &mut room).is_err(), "seed {seed:#x}, frame {number}: {}", hex(&frame));
        }
    }
    let (up, down) = (up(&mut drone), down(&mut control));
    assert!(heard(&mut control, &up).is_ok() && heard(&mut drone, &down).is_ok(), "seed {seed:#x}");
}
