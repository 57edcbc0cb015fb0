//! Reading recorded captures: 100,000 occasions of 1,000 users, 300,000 rows.
//!
//! `cargo bench -p skyroost-host-sim --bench captures`

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use skyroost_host_sim::control::captures::Captures;

/// Rows as they come in while flying: all users once a second, each heard by three drones.
fn table() -> String {
    let mut text = "user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns\n".to_owned();
    for second in 0..100u64 {
        for user in 0..1000u64 {
            for drone in 1..4u64 {
                let (east_cm, toa_ps) = (1000 * second + 25 * drone, 7_919 * user + 104_729 * drone);
                let _ = writeln!(
                    text,
                    "user-{user},17000{second:05}.{user:06},{drone},{}.{:02},-14.43,300.00,17000{second:05}{toa_ps:09}.125,5",
                    east_cm / 100,
                    east_cm % 100,
                );
            }
        }
    }
    text
}

fn read(c: &mut Criterion) {
    let text = table();
    let file = Path::new("captures.csv");
    let captures = Captures::parse(file, text.as_bytes()).expect("a good file");
    let mut group = c.benchmark_group("300000_rows");
    group.sample_size(20).throughput(Throughput::Bytes(text.len() as u64));
    group.bench_function("parse", |b| b.iter(|| Captures::parse(file, black_box(text.as_bytes()))));
    group.bench_function("prepare", |b| b.iter(|| black_box(&captures).prepare(true)));
    group.finish();
}

criterion_group!(benches, read);
criterion_main!(benches);
