//! Laws of the codec: everything sent is read back, and no bytes are read that were never sent.

mod common;

use common::{frame_of, message, stamp};
use proptest::collection::vec;
use proptest::prelude::*;
use skyroost_protocol::codec::encode_into;
use skyroost_protocol::message::Up;
use skyroost_protocol::units::DroneId;
use skyroost_protocol::{
    DecodeError, EncodeError, HEADER_LEN, MAX_BODY, MAX_FRAME, PROTOCOL_VERSION, Sender, Stamp, TAG_LEN,
    decode,
};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn reads_back_what_was_sent(stamp in stamp(), message in message()) {
        let frame = frame_of(&stamp, &message);
        let (header, decoded) = decode(&frame).expect("a valid frame");
        prop_assert_eq!(decoded, message);
        prop_assert_eq!(
            (header.sender, header.boot_epoch, header.sequence),
            (stamp.sender, stamp.boot_epoch, stamp.sequence)
        );
        // Room for the tag stays free.
        prop_assert!(frame.len() <= MAX_FRAME - TAG_LEN);
    }

    /// Cut anywhere or with a byte more, a frame is refused for just that.
    #[test]
    fn refuses_any_other_length(stamp in stamp(), message in message(), extra: u8) {
        let mut bytes = frame_of(&stamp, &message).to_vec();
        for len in 0..bytes.len() {
            prop_assert_eq!(decode(&bytes[..len]), Err(DecodeError::Truncated));
        }
        bytes.push(extra);
        prop_assert_eq!(decode(&bytes), Err(DecodeError::TrailingBytes));
    }

    /// Every value has one encoding: whatever is accepted encodes to the same bytes.
    #[test]
    fn accepts_only_what_it_would_send(
        stamp in stamp(), message in message(), damage in vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)
    ) {
        let mut bytes = frame_of(&stamp, &message).to_vec();
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok((header, message)) = decode(&bytes) {
            let stamp = Stamp { sender: header.sender, boot_epoch: header.boot_epoch, sequence: header.sequence };
            prop_assert_eq!(&frame_of(&stamp, &message)[..], &bytes[..]);
        }
    }

    /// A varint padded with a zero byte says the same in more bytes. It is refused, unless the byte
    /// padded was none of a varint and another message came of it.
    #[test]
    fn refuses_padding(stamp in stamp(), message in message(), at: prop::sample::Index) {
        let mut bytes = frame_of(&stamp, &message).to_vec();
        let ends: Vec<usize> = (HEADER_LEN..bytes.len()).filter(|at| bytes[*at] < 0x80).collect();
        let at = ends[at.index(ends.len())];
        bytes[at] |= 0x80;
        bytes.insert(at + 1, 0);
        let body_len = (bytes.len() - HEADER_LEN) as u16;
        bytes[13..HEADER_LEN].copy_from_slice(&body_len.to_le_bytes());
        if let Ok((_, read)) = decode(&bytes) {
            prop_assert_eq!(&frame_of(&stamp, &read)[..], &bytes[..]);
        }
    }

    #[test]
    fn survives_any_bytes(bytes in vec(any::<u8>(), 0..2 * MAX_FRAME)) {
        let _ = decode(&bytes);
    }

    /// A valid header in front of noise reaches the body's decoder.
    #[test]
    fn survives_any_body(kind in 1..=3_u8, tag in 0..9_u8, noise in vec(any::<u8>(), 0..MAX_BODY)) {
        let body_len = (noise.len() + 1) as u16;
        let mut bytes = vec![b'S', b'R', PROTOCOL_VERSION, kind, 0, 3, 0, 7, 0, 1, 0, 0, 0];
        bytes.extend(body_len.to_le_bytes());
        bytes.push(tag);
        bytes.extend(&noise);
        match decode(&bytes) {
            Ok((header, message)) => {
                let stamp = Stamp { sender: header.sender, boot_epoch: 7, sequence: 1 };
                prop_assert_eq!(&frame_of(&stamp, &message)[..], &bytes[..]);
            }
            Err(error) => prop_assert_eq!(error, DecodeError::Body),
        }
    }

    /// A buffer is large enough exactly when it holds the frame.
    #[test]
    fn encodes_into_just_enough_room(stamp in stamp(), message in common::down()) {
        let frame = frame_of(&stamp, &skyroost_protocol::Message::Down(message.clone()));
        let mut out = [0xee; MAX_FRAME];
        let len = encode_into(&stamp, &message, &mut out[..frame.len()]).expect("just enough room");
        prop_assert_eq!(&out[..len], &frame[..]);
        let short = frame.len() - 1;
        prop_assert_eq!(encode_into(&stamp, &message, &mut out[..short]), Err(EncodeError::BufferTooSmall));
    }
}

#[test]
fn names_what_is_wrong() {
    let good = frame_of(
        &Stamp { sender: DroneId(3), boot_epoch: 7, sequence: 1 },
        &skyroost_protocol::Message::Up(Up::Heartbeat),
    );
    let with = |at: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[at] = byte;
        decode(&bytes)
    };
    assert_eq!(with(0, 0), Err(DecodeError::Magic));
    assert_eq!(with(1, 0), Err(DecodeError::Magic));
    assert_eq!(with(2, 0), Err(DecodeError::Version { found: 0 }));
    assert_eq!(with(2, 9), Err(DecodeError::Version { found: 9 }));
    assert_eq!(with(3, 0), Err(DecodeError::Kind));
    assert_eq!(with(3, 4), Err(DecodeError::Kind));
    assert_eq!(with(4, 2), Err(DecodeError::Flags), "a flag of sealed frames without a tag");
    assert_eq!(with(4, 9), Err(DecodeError::Flags));
    assert_eq!(with(4, 1), Err(DecodeError::Truncated));
    assert_eq!(with(13, MAX_BODY as u8 + 1), Err(DecodeError::Length));
    assert_eq!(with(13, 2), Err(DecodeError::Truncated));
    assert_eq!(with(13, 0), Err(DecodeError::TrailingBytes));
    assert_eq!(with(HEADER_LEN, 200), Err(DecodeError::Body));
}

#[test]
fn a_sender_numbers_its_frames() {
    let mut sender = Sender::new(DroneId(3), 7);
    let mut out = [0; MAX_FRAME];
    for expected in 0..3 {
        let frame = sender.up(&Up::Heartbeat).expect("a frame holds every message");
        let (header, _) = decode(&frame).expect("a valid frame");
        assert_eq!((header.sender, header.boot_epoch, header.sequence), (DroneId(3), 7, expected));
    }
    assert_eq!(sender.encode_into(&Up::Heartbeat, &mut out[..3]), Err(EncodeError::BufferTooSmall));
    assert_eq!(sender.next_sequence(), 3, "a frame that was not sent has no number");
    assert_eq!(sender.encode_into(&Up::Heartbeat, &mut out), Ok(HEADER_LEN + 1));
    assert_eq!(sender.next_sequence(), 4);
}
