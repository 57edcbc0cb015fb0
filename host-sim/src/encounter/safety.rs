//! The conditions of docs/safety.md: within each the separation holds, and beyond it does not.

use super::*;

/// The least separation with the flight code's avoidance.
fn least_m(encounter: &Encounter) -> f64 {
    let outcome = fly(encounter, &Avoidance::On, &mut |_, _| {}).unwrap();
    outcome.min_separation_m.unwrap_or(f64::INFINITY)
}

/// The least separation over seeds of an encounter.
fn least_of_m(seeds: u64, encounter: impl Fn(u64) -> Encounter) -> f64 {
    (1..=seeds).map(|seed| least_m(&encounter(seed))).fold(f64::INFINITY, f64::min)
}

fn vehicle(id: u16, from: [f64; 2], to: [f64; 2], speed_mps: f64) -> VehicleSpec {
    let (from, to) = (V3::new(from[0], from[1], 100.0), V3::new(to[0], to[1], 100.0));
    let way = to - from;
    let vel = if speed_mps > 0.0 { way * (speed_mps / way.norm()) } else { V3::zeros() };
    VehicleSpec {
        id,
        pos_m: from.into(),
        vel_mps: vel.into(),
        goal_m: to.into(),
        cooperative: true,
        has_right_of_way: false,
    }
}

/// Two towards each other at full speed, from this distance.
fn head_on(distance_m: f64) -> Encounter {
    let (west, east) = ([-0.5 * distance_m, 0.0], [0.5 * distance_m, 0.0]);
    Encounter::of(vec![vehicle(1, west, [200.0, 0.0], 10.0), vehicle(2, east, [-200.0, 0.0], 10.0)])
}

fn circle(seed: u64) -> Encounter {
    draw(Family::Circle, 8, seed)
}

#[test]
fn positions_err_by_what_is_declared() {
    let with =
        |true_m: f64| move |seed| Encounter { r_s_m: true_m, declared_r_s_m: Some(2.0), ..circle(seed) };
    let (within, beyond) = (least_of_m(4, with(2.0)), least_of_m(4, with(12.0)));
    assert!(within >= 10.0 && beyond < 10.0, "{within} {beyond}");
}

#[test]
fn states_are_not_too_old() {
    let with = |share_delay_s: f64| move |seed| Encounter { share_delay_s, ..circle(seed) };
    let (within, beyond) = (least_of_m(4, with(1.0)), least_of_m(4, with(4.0)));
    assert!(within >= 10.0 && beyond < 10.0, "{within} {beyond}");
}

#[test]
fn states_are_heard_now_and_then() {
    let with = |share_loss: f64| move |seed| Encounter { share_loss, ..circle(seed) };
    // All but the first lost: whoever is silent is kept out of a growing ball, and nobody knows whom turns brought where.
    let (within, beyond) = (least_of_m(4, with(0.6)), least_of_m(4, with(1.0)));
    assert!(within >= 10.0 && beyond < 10.0, "{within} {beyond}");
}

#[test]
fn they_accelerate_as_counted_on() {
    let with = |max_accel_mps2: f64| least_m(&Encounter { max_accel_mps2, ..head_on(70.0) });
    let (within, beyond) = (with(3.0), with(0.5));
    assert!(within >= 10.0 && beyond < 10.0, "{within} {beyond}");
}

#[test]
fn they_begin_far_enough_apart_to_stop() {
    let (within, beyond) = (least_m(&head_on(70.0)), least_m(&head_on(30.0)));
    assert!(within >= 10.0 && beyond < 10.0, "{within} {beyond}");
}

/// One that does not avoid hovers, and then sets off straight through another that hovers.
#[test]
fn whoever_does_not_avoid_comes_from_far_enough_to_be_seen() {
    let with = |distance_m: f64| {
        let own = vehicle(1, [0.0; 2], [0.0; 2], 0.0);
        let other = vehicle(2, [distance_m, 0.0], [-200.0, 0.0], 0.0);
        least_m(&Encounter::of(vec![own, VehicleSpec { cooperative: false, ..other }]))
    };
    let (within, beyond) = (with(40.0), with(12.0));
    assert!(within >= 10.0 && beyond < 10.0, "{within} {beyond}");
}

/// A board keeps 32 neighbours, the nearest: one that comes the other way is seen late by the first of a crowd.
#[test]
fn no_more_than_the_table_holds_are_nearer_than_stopping_takes() {
    let with = |followers: u16| {
        let follower = |k: u16| {
            let (row, column) = (f64::from(k / 5), f64::from(k % 5) - 2.0);
            let [x, y] = [-220.0 - 4.0 * row, 4.0 * column];
            VehicleSpec { cooperative: false, ..vehicle(3 + k, [x, y], [x + 400.0, y], 10.0) }
        };
        let own = vehicle(1, [-200.0, 0.0], [200.0, 0.0], 10.0);
        let other = VehicleSpec { cooperative: false, ..vehicle(2, [200.0, 0.0], [-200.0, 0.0], 10.0) };
        let all = Encounter::of((0..followers).map(follower).chain([own, other]).collect());
        let mut between_m = f64::INFINITY;
        let mut watch = |_: f64, places: &[(u16, V3)]| {
            let at = |id: u16| places.iter().find(|place| place.0 == id).unwrap().1;
            between_m = between_m.min((at(1) - at(2)).norm());
        };
        fly(&all, &Avoidance::On, &mut watch).unwrap();
        between_m
    };
    let (within, beyond) = (with(0), with(40));
    assert!(within >= 10.0 && beyond < 10.0, "{within} {beyond}");
}

/// One that cannot manoeuvre flies its way as if it were alone; the others keep clear, wherever they come from.
#[test]
fn whoever_cannot_manoeuvre_is_kept_clear_of() {
    for degrees in (0_i32..180).step_by(20) {
        let angle = f64::from(degrees).to_radians();
        let far = |m: f64| [m * angle.cos(), m * angle.sin()];
        let own = VehicleSpec { has_right_of_way: true, ..vehicle(1, [200.0, 0.0], [-200.0, 0.0], 8.0) };
        let other = vehicle(2, far(-210.0), far(190.0), 8.0);
        let encounter =
            Encounter { r_s_m: 0.0, declared_r_s_m: Some(2.0), ..Encounter::of(vec![own, other]) };
        let mut aside_m = 0.0_f64;
        let mut watch = |_: f64, places: &[(u16, V3)]| {
            let own_m = places.iter().find(|place| place.0 == 1).unwrap().1;
            aside_m = aside_m.max(own_m.y.abs()).max((own_m.z - 100.0).abs());
        };
        let outcome = fly(&encounter, &Avoidance::On, &mut watch).unwrap();
        let least_m = outcome.min_separation_m.unwrap();
        assert!(least_m >= 10.0, "from {degrees} degrees: {least_m} m");
        assert!(aside_m < 1.0, "from {degrees} degrees: gave way by {aside_m} m");
        assert!(outcome.arrival_s.iter().all(Option::is_some));
    }
}
