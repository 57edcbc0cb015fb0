//! The laws of one direction of a link.

use super::*;
use proptest::prelude::*;

fn link_with(config: LinkConfig) -> Link<32> {
    Link::new(config, 1, Stream::LinkUp, 0)
}

/// Sends `n` numbered frames, one each 20 ms; returns (number, sent, delivered) in order of delivery.
fn run(link: &mut Link<32>, n: u64) -> Vec<(u64, u64, u64)> {
    let mut deliveries = Vec::new();
    for number in 0..n {
        link.send(20_000 * number, &number.to_le_bytes());
    }
    while let Some(due_us) = link.next_due_us() {
        let frame = link.poll(due_us).expect("due").try_into().expect("eight bytes");
        let number = u64::from_le_bytes(frame);
        deliveries.push((number, 20_000 * number, due_us));
    }
    deliveries
}

fn roomy() -> LinkConfig {
    LinkConfig { capacity: 200_000, ..LinkConfig::default() }
}

#[test]
fn truth_delays_are_uniform_between_their_bounds() {
    let delays_ms: Vec<f64> = run(&mut link_with(roomy()), 50_000)
        .iter()
        .map(|(_, sent, due)| (due - sent) as f64 * 1e-3)
        .collect();
    assert!(delays_ms.iter().all(|d| (80.0..=120.0).contains(d)));
    let (mean, variance) = crate::world::moments(delays_ms.iter().copied());
    assert!((mean - 100.0).abs() < 4.0 * 11.55 / 223.6, "{mean}");
    assert!((variance / (1600.0 / 12.0) - 1.0).abs() < 0.02, "{variance}");
}

#[test]
fn truth_faults_come_at_their_rates() {
    let mut link = link_with(LinkConfig { loss: 0.1, duplication: 0.05, reordering: 0.3, ..roomy() });
    let deliveries = run(&mut link, 100_000);
    let c = *link.counters();
    let near = |found: u64, of: f64, p: f64| {
        assert!((found as f64 - of * p).abs() < 4.0 * (of * p * (1.0 - p)).sqrt(), "{found} of {of}");
    };
    near(c.lost, 1e5, 0.1);
    near(c.duplicated, 9e4, 0.05);
    assert_eq!(c.delivered as usize, deliveries.len());
    assert_eq!((c.sent, c.bytes, c.dropped_overflow), (100_000, 800_000, 0));
    // Held up beyond the jitter: uniform(0, 40) + uniform(0, 200) > 40 with probability 0.9.
    near(deliveries.iter().filter(|(_, sent, due)| due - sent > 120_000).count() as u64, 9e4, 0.27);

    let mut noisy = link_with(LinkConfig { corruption: 0.02, ..roomy() });
    (0..100_000).for_each(|i| noisy.send(i, &[0; 8]));
    near(noisy.counters().corrupted, 1e5, 0.02);
}

#[test]
fn reordered_counts_deliveries_overtaken_by_later_frames() {
    let mut link = link_with(LinkConfig { reordering: 0.2, duplication: 0.1, ..roomy() });
    let mut latest = 0;
    let mut overtaken = 0;
    for (number, ..) in run(&mut link, 10_000) {
        overtaken += u64::from(number < latest);
        latest = latest.max(number);
    }
    assert!(overtaken > 1000);
    assert_eq!(link.counters().reordered, overtaken);
    let mut steady = link_with(LinkConfig { jitter_us: 0, ..roomy() });
    let _ = run(&mut steady, 1000);
    assert_eq!(steady.counters().reordered, 0);
}

#[test]
fn raising_the_loss_leaves_the_delays_of_the_others_alone() {
    let all = run(&mut link_with(roomy()), 5000);
    let some = run(&mut link_with(LinkConfig { loss: 0.5, duplication: 0.0, ..roomy() }), 5000);
    assert!(some.len() < 2700 && some.iter().all(|delivery| all.contains(delivery)));
}

#[test]
fn corruption_flips_one_to_three_bits_of_one_copy() {
    let mut link = link_with(LinkConfig { corruption: 1.0, duplication: 1.0, ..roomy() });
    for i in 0..1000 {
        link.send(i * 1_000_000, &[0; 32]);
        let mut flipped = Vec::new();
        while let Some(frame) = link.poll((i + 1) * 1_000_000) {
            flipped.push(frame.iter().map(|b| b.count_ones()).sum::<u32>());
        }
        flipped.sort_unstable();
        assert!(flipped[0] == 0 && (1..=3).contains(&flipped[1]) && flipped.len() == 2, "{flipped:?}");
    }
    link.send(0, &[]);
    assert_eq!(link.counters().corrupted, 1000);
}

#[test]
fn a_full_link_drops_and_counts_and_never_grows() {
    let mut link = link_with(LinkConfig { capacity: 10, ..LinkConfig::default() });
    for round in 0..100 {
        for _ in 0..15 {
            link.send(round * 1_000_000, b"frame");
        }
        let mut delivered = 0;
        while link.poll((round + 1) * 1_000_000).is_some() {
            delivered += 1;
        }
        assert_eq!(delivered, 10);
        assert_eq!(link.slots.len(), 10);
    }
    assert_eq!(link.counters().dropped_overflow, 500);
}

#[test]
fn steady_traffic_allocates_nothing_after_warm_up() {
    let mut link = link_with(LinkConfig::default());
    let mut room = (0, 0, 0);
    for i in 0..50_000 {
        link.send(i * 20_000, &[1; 20]);
        while link.poll(i * 20_000).is_some() {}
        let now = (link.slots.capacity(), link.waiting.capacity(), link.free.capacity());
        if i == 1000 {
            room = now;
        }
        assert!(i <= 1000 || now == room);
    }
}

#[test]
fn equal_due_times_leave_in_the_order_sent() {
    let mut link = link_with(LinkConfig { jitter_us: 0, ..LinkConfig::default() });
    for byte in 0..100 {
        link.send(5, &[byte]);
    }
    for byte in 0..100 {
        assert_eq!(link.poll(80_005), Some(&[byte][..]));
    }
    assert_eq!(link.poll(u64::MAX), None);
}

#[test]
fn a_link_can_go_dark_and_come_back() {
    let mut link = link_with(LinkConfig::default());
    link.set_config(LinkConfig { loss: 1.0, ..LinkConfig::default() });
    link.send(0, b"lost");
    link.set_config(LinkConfig::default());
    link.send(0, b"heard");
    assert_eq!(link.poll(1_000_000), Some(&b"heard"[..]));
    assert_eq!(link.counters().lost, 1);
}

#[test]
fn config_names_the_bad_parameter() {
    let bad = LinkConfig { loss: 1.5, ..LinkConfig::default() };
    assert_eq!(bad.check().unwrap_err().to_string(), "loss: found 1.5, expected a probability from 0 to 1");
    assert_eq!(LinkConfig { capacity: 0, ..LinkConfig::default() }.check().unwrap_err().field, "capacity");
}

proptest! {
    #[test]
    fn never_early_never_unaccounted(
        seed: u64,
        min_delay_us in 0..200_000_u64,
        jitter_us in 0..100_000_u64,
        chances in [0.0..=1.0_f64, 0.0..=1.0, 0.0..=1.0],
        capacity in 1..64_usize,
        pauses_us in prop::collection::vec(0..50_000_u64, 1..200),
    ) {
        let [loss, duplication, reordering] = chances;
        let config = LinkConfig {
            min_delay_us, jitter_us, loss, duplication, reordering, capacity, ..LinkConfig::default()
        };
        let mut link = Link::<16>::new(config, seed, Stream::LinkPeer, 3);
        let (mut now_us, mut sent_us) = (0, Vec::new());
        for pause_us in pauses_us {
            now_us += pause_us;
            link.send(now_us, &sent_us.len().to_le_bytes());
            sent_us.push(now_us);
            // Deliver in full, each frame at its own due time.
            while let Some(due_us) = link.next_due_us().filter(|due_us| *due_us <= now_us) {
                if due_us > 0 {
                    prop_assert_eq!(link.poll(due_us - 1), None);
                }
                let frame = link.poll(due_us).expect("due").try_into().expect("eight bytes");
                prop_assert!(due_us >= sent_us[usize::from_le_bytes(frame)] + min_delay_us);
            }
            let c = link.counters();
            prop_assert_eq!(
                c.sent + c.duplicated,
                c.lost + c.dropped_overflow + c.delivered + link.in_flight() as u64
            );
            prop_assert!(link.in_flight() <= capacity);
        }
    }

    #[test]
    fn equal_links_do_equal_things(seed: u64, n in 1..100_u64) {
        let config = LinkConfig { loss: 0.2, duplication: 0.2, reordering: 0.2, corruption: 0.0, ..roomy() };
        let fresh = || Link::<32>::new(config.clone(), seed, Stream::LinkDown, 9);
        prop_assert_eq!(run(&mut fresh(), n), run(&mut fresh(), n));
    }
}
