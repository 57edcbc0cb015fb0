//! What avoidance promises, over families of encounters.

use super::*;

/// Flies seeds of a family, and returns the least separation and the mean overhead.
fn flown(family: Family, count: usize, seeds: u64, change: impl Fn(&mut Encounter)) -> (f64, f64) {
    let (mut least_m, mut overhead) = (f64::INFINITY, 0.0);
    for seed in 1..=seeds {
        let mut encounter = draw(family, count, seed);
        change(&mut encounter);
        let outcome = fly(&encounter, &Avoidance::On, &mut |_, _| {}).unwrap();
        let told =
            format!("skyroost encounter --generate {family:?} --vehicles {count} --seed {seed}: {outcome:?}");
        assert_eq!(outcome.violations, 0, "{told}");
        assert!(outcome.arrival_s.iter().all(Option::is_some), "{told}");
        least_m = least_m.min(outcome.min_separation_m.unwrap_or(f64::INFINITY));
        overhead += outcome.overhead_fraction / seeds as f64;
    }
    (least_m, overhead)
}

#[test]
fn pairs_keep_apart_and_lose_little_time() {
    let (least_m, overhead) = flown(Family::Crossing, 2, 200, |_| {});
    assert!(least_m >= 11.0 && overhead <= 0.02, "{least_m} {overhead}");
    for family in [Family::Overtake, Family::Hover, Family::Fleets, Family::SweepEnd] {
        let (least_m, _) = flown(family, family.usual_count(), 20, |_| {});
        assert!(least_m >= 10.0, "{family:?} {least_m}");
    }
}

#[test]
fn crowds_keep_apart_and_everyone_arrives() {
    for (family, count, seeds) in [(Family::Circle, 8, 4), (Family::Circle, 20, 2), (Family::Box, 20, 4)] {
        flown(family, count, seeds, |_| {});
    }
    // Exactly symmetric, nobody errs.
    flown(Family::Circle, 8, 1, |encounter| encounter.r_s_m = 0.0);
}

#[test]
fn losses_and_delays_are_borne() {
    flown(Family::Crossing, 2, 100, |encounter| encounter.share_loss = 0.3);
    flown(Family::Circle, 8, 2, |encounter| encounter.share_delay_s = 1.0);
}

#[test]
fn adversarial_errors_are_borne() {
    for noise in [NoiseModel::Adversarial, NoiseModel::AdversarialShared] {
        flown(Family::Crossing, 2, 100, |encounter| encounter.noise = noise);
        flown(Family::Box, 20, 1, |encounter| encounter.noise = noise);
    }
}

/// A steering of one's own is asked with what is known, and obeyed by those who cooperate.
#[test]
fn any_steering_flies() {
    struct Stay;
    impl Steering for Stay {
        fn steer(&self, known: &Knowledge<'_>) -> Vec3 {
            assert_eq!(known.peers.iter().count(), 1);
            Vec3::zeros()
        }
    }
    let outcome = fly(&draw(Family::Intruder, 2, 1), &Stay, &mut |_, _| {}).unwrap();
    assert!(outcome.arrival_s[0].is_none() && outcome.arrival_s[1].is_some(), "{outcome:?}");
}

#[test]
fn without_avoidance_they_collide_and_the_papers_rule_violates() {
    let violating = |avoidance| {
        let one = |seed| fly(&draw(Family::Crossing, 2, seed), &avoidance, &mut |_, _| {}).unwrap();
        (1..=100).filter(|&seed| one(seed).violations > 0).count()
    };
    assert!(violating(Avoidance::Off) > 90);
    assert!(violating(Avoidance::LiteralPca) > 30);
}
