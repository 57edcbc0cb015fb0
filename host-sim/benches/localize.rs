//! Localization of whole missions, one thread: captures to fixes, and the bound.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use skyroost_host_sim::control::localize::{C_M_PER_NS, Capture, LocalizeConfig, Occasion, crlb, localize};

#[path = "../src/control/localize/sim.rs"]
mod sim;

fn missions(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let cfg = LocalizeConfig::default();
    for (users_per_km2, samples) in [(1.0, 50), (5.0, 20), (50.0, 10)] {
        let flown = sim::World { users_per_km2, ..sim::World::default() }.fly();
        let name = format!("{}_users_{}_occasions", flown.truth.len(), flown.occasions.len());
        let mut group = c.benchmark_group(name);
        group.sample_size(samples);
        group.bench_function("localize", |b| {
            b.iter(|| pool.install(|| localize(&flown.occasions, &cfg)));
        });
        group.bench_function("crlb", |b| {
            b.iter(|| pool.install(|| crlb(&flown.occasions, &flown.late, &flown.truth, &cfg)));
        });
        group.finish();
    }
}

criterion_group!(benches, missions);
criterion_main!(benches);
