//! Speed of encoding and decoding the messages that flow most, and of the byte link around them.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use heapless::Vec;
use skyroost_protocol::codec::{Body, encode_into};
use skyroost_protocol::message::{Down, Manner, MateTdoa, PeerState, SharedState, TdoaEntry, TdoaFlags, Up};
use skyroost_protocol::units::{DroneId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId, VelEnuMmps};
use skyroost_protocol::{MAX_FRAME, Stamp, StreamDecoder, StreamFrame, decode, encode_stream};
use std::hint::black_box;

const STAMP: Stamp = Stamp { sender: DroneId(3), boot_epoch: 7, sequence: 123_456 };

const STATE: SharedState = SharedState {
    time: TimePs(1_234_567_890_123_456),
    pos: PosEnuMm([4_321_000, -1_234_567, 300_125]),
    vel: VelEnuMmps([9_876, -1_543, 12]),
    error_radius_mm: 2_000,
    manner: Manner::ALONE,
};

fn peers() -> Down {
    Down::Peers((1..=4).map(|drone| PeerState { drone: DroneId(drone), state: STATE }).collect())
}

fn tdoa() -> Up {
    let mate = |drone| MateTdoa {
        drone: DroneId(drone),
        tdoa: TdoaPs(-123_456),
        pos: STATE.pos,
        sigma: ToaSigma(626),
        flags: TdoaFlags::default(),
    };
    let entry = |occasion| TdoaEntry {
        occasion: OccasionId(occasion),
        user: UserId(9),
        time: STATE.time,
        pos: STATE.pos,
        sigma: ToaSigma(626),
        mates: Vec::from_array([mate(1), mate(2)]),
    };
    Up::Tdoa((0..2).map(entry).collect())
}

fn message<B: Body>(c: &mut Criterion, name: &str, message: &B) {
    let mut frame = [0; MAX_FRAME];
    let len = encode_into(&STAMP, message, &mut frame).expect("a frame holds every message");
    let mut group = c.benchmark_group(name);
    group.throughput(Throughput::Bytes(len as u64));
    group.bench_function("encode", |b| {
        let mut out = [0; MAX_FRAME];
        b.iter(|| encode_into(&STAMP, black_box(message), black_box(&mut out)));
    });
    group.bench_function("decode", |b| b.iter(|| decode(black_box(&frame[..len]))));
    group.finish();
}

fn byte_link(c: &mut Criterion) {
    let mut frame = [0; MAX_FRAME];
    let len = encode_into(&STAMP, &peers(), &mut frame).expect("a frame holds every message");
    let mut bytes = StreamFrame::new();
    encode_stream(&frame[..len], &mut bytes).expect("a frame fits the link");
    let mut group = c.benchmark_group("stream");
    group.throughput(Throughput::Bytes(bytes.len() as u64));
    group.bench_function("encode", |b| {
        let mut out = StreamFrame::new();
        b.iter(|| encode_stream(black_box(&frame[..len]), black_box(&mut out)));
    });
    group.bench_function("decode", |b| {
        let mut decoder = StreamDecoder::new();
        b.iter(|| black_box(&bytes).iter().filter(|byte| decoder.push(**byte).is_some()).count());
    });
    group.finish();
}

fn codec(c: &mut Criterion) {
    message(c, "shared_state", &Up::SharedState(STATE));
    message(c, "peers_4", &peers());
    message(c, "tdoa_2x2", &tdoa());
    byte_link(c);
}

criterion_group!(benches, codec);
criterion_main!(benches);
