//! What the simulated world costs. A mission of six drones takes 50 vehicle steps a second and drone, so one
//! step of vehicle, wind and navigation is budgeted at 120 ns, a frame through a link at 60 ns.

use criterion::{Criterion, criterion_group, criterion_main};
use skyroost_host_sim::geometry::{V2, V3};
use skyroost_host_sim::rng::{self, Stream};
use skyroost_host_sim::world::channel::{Channel, ChannelConfig};
use skyroost_host_sim::world::clock::{CAPTURE_TICK_HZ, Clock, ClockConfig};
use skyroost_host_sim::world::gnss::{Gnss, GnssConfig};
use skyroost_host_sim::world::grid::PointGrid;
use skyroost_host_sim::world::link::{Link, LinkConfig};
use skyroost_host_sim::world::users::poisson_users;
use skyroost_host_sim::world::vehicle::{Command, Vehicle, VehicleConfig};
use skyroost_host_sim::world::wind::{Wind, WindConfig};
use std::hint::black_box;

const DT_S: f64 = 0.02;

fn vehicle_step(c: &mut Criterion) {
    let mut vehicle = Vehicle::new(VehicleConfig::default(), DT_S, V3::new(0.0, 0.0, 300.0));
    let mut wind = Wind::new(&WindConfig::default(), DT_S, 1, 0);
    let mut gnss = Gnss::new(&GnssConfig::default(), DT_S, 1, 0);
    let command = Command::velocity(V3::new(8.0, 6.0, 0.0));
    c.bench_function("vehicle alone", |b| {
        b.iter(|| {
            vehicle.step(black_box(command), V3::new(2.0, 1.0, 0.0));
            vehicle.pos_enu_m()
        });
    });
    c.bench_function("wind alone", |b| b.iter(|| wind.step()));
    c.bench_function("gnss alone", |b| b.iter(|| gnss.step(black_box(V3::zeros()), black_box(V3::zeros()))));
    c.bench_function("vehicle + wind + gnss", |b| {
        b.iter(|| {
            vehicle.step(black_box(command), wind.step());
            gnss.step(vehicle.pos_enu_m(), vehicle.vel_enu_mps())
        });
    });
}

fn link(c: &mut Criterion) {
    for (name, config) in [
        ("link send + poll", LinkConfig::default()),
        (
            "link send + poll, bad",
            LinkConfig {
                loss: 0.1,
                duplication: 0.1,
                reordering: 0.1,
                corruption: 0.1,
                ..LinkConfig::default()
            },
        ),
    ] {
        let mut link = Link::<288>::new(config, 1, Stream::LinkUp, 0);
        let mut now_us = 0;
        c.bench_function(name, |b| {
            b.iter(|| {
                now_us += 20_000;
                link.send(now_us, black_box(&[5; 64]));
                while let Some(frame) = link.poll(now_us) {
                    black_box(frame);
                }
            });
        });
    }
}

fn radio(c: &mut Criterion) {
    let mut clock = Clock::new(&ClockConfig::default(), 1, 0);
    let mut now_ps = 0;
    c.bench_function("clock ticks, every 10 ms", |b| {
        b.iter(|| {
            now_ps += 10_000_000_000;
            clock.ticks(now_ps, CAPTURE_TICK_HZ)
        });
    });
    let channel = Channel::new(ChannelConfig::default(), 1);
    let (user, drone) = (V3::new(1.0, 2.0, 0.0), V3::new(100.0, 250.0, 300.0));
    let mut occasion = 0;
    c.bench_function("channel receive", |b| {
        b.iter(|| {
            occasion += 1;
            channel.receive(occasion, 2, 0, black_box(user), black_box(drone))
        });
    });
}

fn users(c: &mut Criterion) {
    let side = (V2::zeros(), V2::new(10_000.0, 10_000.0));
    let users = poisson_users(50.0, side, |_| true, 1).expect("a sane density");
    let points: Vec<V2> = users.iter().map(|user| user.pos_m).collect();
    let grid = PointGrid::new(&points, 250.0);
    c.bench_function("users within 500 m of 5000", |b| {
        b.iter(|| grid.within(black_box(V2::new(4321.0, 5678.0)), 500.0).sum::<usize>());
    });
    let mut rng = rng::stream(1, Stream::Scenario, 0);
    c.bench_function("standard normal", |b| b.iter(|| rng::normal(&mut rng)));
}

criterion_group!(benches, vehicle_step, link, radio, users);
criterion_main!(benches);
