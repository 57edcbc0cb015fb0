//! Laws of the byte link: every undamaged frame arrives, whatever happens to the others.

mod common;

use common::{frame_of, message, stamp};
use proptest::collection::vec;
use proptest::prelude::*;
use skyroost_protocol::stream::StreamCounters;
use skyroost_protocol::{MAX_FRAME, MAX_STREAM, StreamDecoder, StreamError, StreamFrame, encode_stream};

fn stream_of(frame: &[u8]) -> StreamFrame {
    let mut out = StreamFrame::new();
    encode_stream(frame, &mut out).expect("a frame fits the link");
    out
}

/// What a new decoder finds in the bytes.
fn receive(bytes: &[u8]) -> (Vec<Vec<u8>>, StreamCounters) {
    let mut decoder = StreamDecoder::new();
    let mut frames = Vec::new();
    let mut errors = 0;
    for byte in bytes {
        match decoder.push(*byte) {
            Some(Ok(frame)) => frames.push(frame.to_vec()),
            Some(Err(_)) => errors += 1,
            None => {}
        }
    }
    let counters = *decoder.counters();
    assert_eq!(counters.frames as usize, frames.len());
    assert_eq!(counters.crc_errors + counters.cobs_errors + counters.overflow + counters.runt, errors);
    (frames, counters)
}

/// The same, taking the bytes in portions of these sizes.
fn receive_in_portions(bytes: &[u8], sizes: &[usize]) -> (Vec<Vec<u8>>, StreamCounters) {
    let mut decoder = StreamDecoder::new();
    let mut frames = Vec::new();
    let mut rest = bytes;
    for size in sizes.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let (mut portion, after) = rest.split_at((*size).min(rest.len()));
        rest = after;
        while !portion.is_empty() {
            let (taken, found) = decoder.take(portion);
            assert!(taken > 0 && (found.is_some() || taken == portion.len()));
            frames.extend(found.and_then(Result::ok).map(<[u8]>::to_vec));
            portion = &portion[taken..];
        }
    }
    (frames, *decoder.counters())
}

/// Any frame the link carries, with more zeros and long runs than chance would give.
fn payload() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![Just(0), Just(1), Just(255), any::<u8>()];
    prop_oneof![vec(byte, 1..=MAX_FRAME), vec(1..=255_u8, MAX_FRAME), Just(vec![0; MAX_FRAME])]
}

/// What can happen to a frame on the way.
#[derive(Clone, Debug)]
enum Damage {
    None,
    /// Bits flip.
    Flip(Vec<(prop::sample::Index, u8)>),
    /// Bytes are missing.
    Cut(prop::sample::Index, prop::sample::Index),
    /// Bytes come in between.
    Insert(prop::sample::Index, Vec<u8>),
}

fn damage() -> impl Strategy<Value = Damage> {
    let index = || any::<prop::sample::Index>();
    prop_oneof![
        Just(Damage::None),
        vec((index(), 1..=255_u8), 1..5).prop_map(Damage::Flip),
        (index(), index()).prop_map(|(from, to)| Damage::Cut(from, to)),
        (index(), vec(any::<u8>(), 1..2 * MAX_STREAM)).prop_map(|(at, bytes)| Damage::Insert(at, bytes)),
    ]
}

fn damaged(mut bytes: Vec<u8>, damage: &Damage) -> Vec<u8> {
    match damage {
        Damage::None => {}
        Damage::Flip(flips) => {
            for (at, mask) in flips {
                let at = at.index(bytes.len());
                bytes[at] ^= mask;
            }
        }
        Damage::Cut(from, to) => {
            let (from, to) = (from.index(bytes.len()), to.index(bytes.len()));
            bytes.drain(from.min(to)..=from.max(to));
        }
        Damage::Insert(at, noise) => {
            let at = at.index(bytes.len());
            bytes.splice(at..at, noise.iter().copied());
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// How the bytes are cut into portions makes no difference.
    #[test]
    fn portions_do_not_matter(
        frames in vec((payload(), damage()), 1..8),
        sizes in vec(1..300_usize, 1..6),
    ) {
        let mut bytes = Vec::new();
        for (frame, damage) in &frames {
            bytes.extend(damaged(stream_of(frame).to_vec(), damage));
        }
        prop_assert_eq!(receive_in_portions(&bytes, &sizes), receive(&bytes));
    }

    /// The `cobs` crate, and a bitwise CRC, agree with what is sent.
    #[test]
    fn truth_cobs_and_crc(frame in payload()) {
        let mut payload = frame.clone();
        payload.extend(crc32_bitwise(&frame).to_le_bytes());
        let mut expected = [0; MAX_STREAM];
        let len = cobs::try_encode_including_sentinels(&payload, &mut expected).expect("room");
        prop_assert_eq!(&stream_of(&frame)[..], &expected[..len]);
    }

    #[test]
    fn every_frame_arrives(frames in vec(payload(), 0..6), idle in 0..3_usize) {
        let bytes: Vec<u8> =
            frames.iter().flat_map(|frame| [stream_of(frame).to_vec(), vec![0; idle]].concat()).collect();
        let (received, counters) = receive(&bytes);
        prop_assert_eq!(received, frames);
        prop_assert_eq!(counters.crc_errors + counters.cobs_errors + counters.overflow + counters.runt, 0);
    }

    /// Damage within a frame, its delimiters included, costs that frame alone.
    #[test]
    fn damage_costs_one_frame(frames in vec((payload(), damage()), 1..8)) {
        let mut bytes = Vec::new();
        let mut sound = Vec::new();
        for (frame, damage) in &frames {
            let sent = stream_of(frame).to_vec();
            let arrived = damaged(sent.clone(), damage);
            if arrived == sent {
                sound.push(frame.clone());
            }
            bytes.extend(arrived);
        }
        let (received, _) = receive(&bytes);
        // In order, with nothing between them but frames that were damaged outside of their payload.
        let mut rest = received.iter();
        for frame in &sound {
            prop_assert!(rest.any(|found| found == frame));
        }
        let sent: Vec<&Vec<u8>> = frames.iter().map(|(frame, _)| frame).collect();
        prop_assert!(received.iter().all(|found| sent.contains(&found)), "a frame nobody sent");
    }

    /// Whatever came before, the next frame is found.
    #[test]
    fn survives_noise(noise in vec(any::<u8>(), 0..4 * MAX_STREAM), stamp in stamp(), message in message()) {
        let frame = frame_of(&stamp, &message);
        let bytes = [&noise[..], &stream_of(&frame)].concat();
        let (received, _) = receive(&bytes);
        prop_assert_eq!(received.last().map(Vec::as_slice), Some(&frame[..]));
    }
}

/// CRC-32/ISO-HDLC bit by bit from its definition: polynomial 0x04C11DB7 reflected, all ones in and out.
fn crc32_bitwise(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    })
}

#[test]
fn truth_crc_check_value() {
    assert_eq!(crc32_bitwise(b"123456789"), 0xcbf4_3926, "the catalogue's check value");
}

#[test]
fn counts_what_it_drops() {
    let frame = [1, 2, 3];
    let sent = stream_of(&frame).to_vec();
    assert_eq!(receive(&sent).1, StreamCounters { frames: 1, ..Default::default() });

    let mut wrong = sent.clone();
    wrong[3] ^= 4;
    assert_eq!(receive(&wrong).1, StreamCounters { crc_errors: 1, ..Default::default() });

    let mut beyond = sent.clone();
    beyond[1] += 1;
    assert_eq!(receive(&beyond).1, StreamCounters { cobs_errors: 1, ..Default::default() });

    assert_eq!(receive(&[0, 1, 0]).1, StreamCounters { runt: 1, ..Default::default() });
    assert_eq!(receive(&[0, 0, 0]).1, StreamCounters::default(), "silence is no frame");

    let endless = [[7; 5000].as_slice(), &sent].concat();
    assert_eq!(receive(&endless).1, StreamCounters { frames: 1, overflow: 1, ..Default::default() });
}

#[test]
fn refuses_what_is_no_frame() {
    let mut out = StreamFrame::new();
    assert_eq!(encode_stream(&[], &mut out), Err(StreamError::Runt));
    assert_eq!(encode_stream(&[7; MAX_FRAME + 1], &mut out), Err(StreamError::Overflow));
    assert!(out.is_empty());
    assert_eq!(encode_stream(&[7; MAX_FRAME], &mut out), Ok(()));
    assert_eq!(out.len(), MAX_STREAM);
}
