//! Bounds against figures known from elsewhere, against closed forms, and against the estimator itself.

use proptest::prelude::*;
use skyroost_protocol::units::{DroneId, UserId};

use super::pass::Heard;
use super::*;
use crate::control::localize::{ClockModel, LocalizeConfig, Robust, localize, r95};
use crate::runner::formation::{fixed_orientation_rad, slot_m};

fn corners() -> [V2; 3] {
    [0, 1, 2].map(|slot| slot_m(fixed_orientation_rad(0.0), slot, 1.0))
}

fn formation(spacing_m: f64, altitude_m: f64) -> Formation {
    Formation {
        corners: corners(),
        spacing_m,
        altitude_m,
        speed_mps: 10.0,
        radius_m: 500.0,
        srs_period_s: 1.0,
        sigma_toa_ns: 1.0,
    }
}

fn known(sigma_toa_ns: f64) -> LocalizeConfig {
    LocalizeConfig {
        sigma_toa_ns,
        clock: ClockModel::Synchronised,
        drone_pos_sigma_m: 0.0,
        robust: Robust::None,
        ..LocalizeConfig::default()
    }
}

fn radius_m(formation: &Formation, user_m: V2, heard: Heard) -> f64 {
    let bounds = formation.bounds(&[user_m], heard, &known(formation.sigma_toa_ns)).unwrap();
    r95(bounds[0].unwrap())
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found / expected - 1.0).abs() <= tolerance, "found {found}, expected {expected}");
}

/// Figures of a computation that shares nothing with this one, for a nanosecond of noise, 50 m, 300 m and 10 m/s.
///
/// That one let users be heard wherever all three drones reach, which at 400 m gives two SRS more than the inscribed disk
/// and 2.75 m; hence the wider tolerance there.
#[test]
fn truth_figures_known_independently() {
    let formation = formation(50.0, 300.0);
    for (offset_m, heard, expected_m, tolerance) in [
        (0.0, Heard::Once, 6.3, 0.01),
        (400.0, Heard::Once, 23.0, 0.02),
        (0.0, Heard::WholePass, 0.95, 0.01),
        (400.0, Heard::WholePass, 2.75, 0.035),
    ] {
        close(radius_m(&formation, V2::new(0.0, offset_m), heard), expected_m, tolerance);
    }
}

#[test]
fn passes_have_the_length_of_their_chord() {
    let formation = formation(50.0, 300.0);
    // 471.13 m, sqrt(471.13^2 - 400^2) = 248.9 m; the last metres hold one SRS.
    assert_eq!([0.0, 400.0, 471.1].map(|offset_m| formation.srs_of_pass(offset_m)), [95, 49, 1]);
    let slow = Formation { srs_period_s: 1e5, ..formation };
    assert_eq!(slow.srs_of_pass(0.0), 1);
    close(
        radius_m(&slow, V2::zeros(), Heard::WholePass),
        radius_m(&formation, V2::zeros(), Heard::Once),
        1e-12,
    );
}

/// The linearised shifts are those of the estimator on captures without noise.
#[test]
fn truth_gains_are_what_the_estimator_does() {
    let formation = formation(50.0, 300.0);
    // Wide, so that no prior pulls.
    let cfg = LocalizeConfig { expected_radius_m: 1e5, max_r95_m: 1e5, ..known(1.0) };
    let bound = |at_m| formation.bounds(&[at_m], Heard::WholePass, &known(1.0)).unwrap()[0].unwrap();
    for offset_m in [-400.0, 0.0, 200.0] {
        let at_m = V2::new(0.0, offset_m);
        let gains = formation.gains(at_m, bound(at_m));
        for drone in 0..3 {
            let found_m = |clock_ns: f64, moved_m: [f64; 3]| {
                let mut occasions: Vec<_> = formation.occasions(UserId(1), at_m, Heard::WholePass).collect();
                let mistaken = occasions.iter_mut().flat_map(|occasion| &mut occasion.captures);
                for capture in mistaken.filter(|capture| capture.drone == DroneId(drone as u16 + 1)) {
                    capture.toa_ns += clock_ns;
                    (0..3).for_each(|axis| capture.pos_enu_m[axis] += moved_m[axis]);
                }
                V2::from(localize(&occasions, &cfg).unwrap().users[0].pos_m)
            };
            let shift = |plus: V2, minus: V2, of: f64| (plus - minus) / (2.0 * of);
            let clock = shift(found_m(0.05, [0.0; 3]), found_m(-0.05, [0.0; 3]), 0.05);
            let expected = gains.clock_m_per_ns[drone];
            assert!((clock - expected).norm() < 0.01 * expected.norm(), "clock: {clock} {expected}");
            for axis in 0..3 {
                let moved = |by_m: f64| [0, 1, 2].map(|other| if other == axis { by_m } else { 0.0 });
                let drone_at = shift(found_m(0.0, moved(0.02)), found_m(0.0, moved(-0.02)), 0.02);
                let expected = gains.position[drone][axis];
                let off = (drone_at - expected).norm();
                assert!(off < 0.01 * expected.norm() + 0.01, "axis {axis}: {drone_at} {expected}");
            }
        }
    }
}

/// The estimator's own covariance for standalone receivers is the one of the table.
#[test]
fn constant_errors_of_drones_count_as_the_estimator_counts_them() {
    let formation = Formation { sigma_toa_ns: 5.0, ..formation(50.0, 300.0) };
    let accuracy = Accuracy::of(formation).unwrap();
    let cfg = LocalizeConfig { drone_bias_sigma_m: 1.5, max_r95_m: 1e4, ..known(5.0) };
    let standalone = accuracy.drone_bias.iter().find(|row| row.of > 1.0).unwrap();
    for (&offset_m, &expected_m) in accuracy.offset_m.iter().zip(&standalone.r95_m).take(6) {
        let radius_m = |side: f64| {
            let at_m = V2::new(0.0, side * offset_m);
            let occasions: Vec<_> = formation.occasions(UserId(1), at_m, Heard::WholePass).collect();
            localize(&occasions, &cfg).unwrap().users[0].r95_m
        };
        close(radius_m(1.0).max(radius_m(-1.0)), expected_m, 0.01);
    }
}

/// What the tables are read for.
#[test]
fn less_knowledge_is_never_better() {
    let accuracy = Accuracy::of(Formation { sigma_toa_ns: 5.0, ..formation(50.0, 300.0) }).unwrap();
    assert_eq!(accuracy.offset_m.len(), 10);
    let row = |sync| &accuracy.sync.iter().find(|row| row.of == sync).unwrap().r95_m;
    let (constant, mission) = (row(Sync::ConstantOffsets), row(Sync::Mission));
    for i in 0..accuracy.offset_m.len() {
        let known = accuracy.pass_m[i];
        assert!(known < accuracy.one_srs_m[i]);
        assert!(known < constant[i] && constant[i] < mission[i], "{known} {} {}", constant[i], mission[i]);
        for column in [&accuracy.drone_bias, &accuracy.terrain, &accuracy.sigma] {
            let radii: Vec<f64> = column.iter().map(|row| row.r95_m[i]).collect();
            assert!(radii.is_sorted(), "{radii:?}");
        }
        close(accuracy.drone_bias[0].r95_m[i], known, 1e-9);
        close(accuracy.terrain[0].r95_m[i], known, 1e-9);
    }
    // Twenty users estimate constant offsets at a loss of a fifth.
    close(constant[0] / accuracy.pass_m[0], 1.2, 0.02);
}

#[test]
fn what_makes_no_sense_is_named() {
    let good = formation(50.0, 300.0);
    let refused = |bad: Formation| Accuracy::of(bad).unwrap_err().to_string();
    for (bad, told) in [
        (Formation { spacing_m: 0.0, ..good }, "spacing_m: found 0.0"),
        (Formation { altitude_m: f64::NAN, ..good }, "altitude_m: found NaN"),
        (Formation { radius_m: 1e9, ..good }, "radius_m: found 1000000000.0"),
        (Formation { speed_mps: -1.0, ..good }, "speed_mps: found -1.0"),
        (Formation { srs_period_s: f64::INFINITY, ..good }, "srs_period_s: found inf"),
        (Formation { sigma_toa_ns: 0.0, ..good }, "sigma_ns: found 0.0"),
        (Formation { spacing_m: 900.0, ..good }, "expected at most 865.9"),
        (Formation { speed_mps: 0.01, ..good }, "found 0.01 m from one SRS to the next"),
    ] {
        assert!(refused(bad).contains(told), "{} for {told}", refused(bad));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Right below, the three horizontal directions are alike: the variance of a coordinate is 2 (c sigma s / d)^2 with
    /// the slant range s.
    #[test]
    fn truth_right_below_the_radius_has_a_closed_form(
        spacing_m in 10.0..800.0f64, altitude_m in 10.0..1000.0f64, sigma_toa_ns in 0.1..30.0f64,
    ) {
        let formation = Formation { sigma_toa_ns, ..formation(spacing_m, altitude_m) };
        let slant_m = altitude_m.hypot(spacing_m / 3f64.sqrt());
        let expected_m = (-2.0 * 0.05f64.ln() * 2.0).sqrt() * 0.299_792_458 * sigma_toa_ns * slant_m / spacing_m;
        prop_assert!((radius_m(&formation, V2::zeros(), Heard::Once) / expected_m - 1.0).abs() < 1e-6);
    }

    /// Directions do not change when everything is as many times as large, nor does a pass.
    #[test]
    fn only_shapes_matter(
        spacing_m in 10.0..300.0f64, altitude_m in 30.0..600.0f64, share in 0.0..0.9f64, scale in 0.3..3.0f64,
    ) {
        let small = formation(spacing_m, altitude_m);
        let large = Formation {
            spacing_m: scale * spacing_m,
            altitude_m: scale * altitude_m,
            radius_m: scale * small.radius_m,
            // The last SRS of a pass must not hang on rounding.
            speed_mps: scale * 9.999,
            ..small
        };
        let small = Formation { speed_mps: 9.999, ..small };
        let user_m = V2::new(0.0, share * small.swath_radius_m());
        prop_assume!(small.srs_of_pass(user_m.y) == large.srs_of_pass(scale * user_m.y));
        let [a, b] = [(small, user_m), (large, user_m * scale)].map(|(it, at)| radius_m(&it, at, Heard::WholePass));
        prop_assert!((a / b - 1.0).abs() < 1e-6, "{} {}", a, b);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// Any formation that is let in has an answer, with nothing but positive numbers and infinities in it.
    #[test]
    fn any_formation_has_an_answer(
        spacing_m in 0.2..1000.0f64, altitude_m in 0.2..1e4f64, radius_m in 0.2..1e3f64, step_share in 0.02..2.0f64,
        speed_mps in 1.0..30.0f64, sigma_toa_ns in 0.01..1e3f64,
    ) {
        let srs_period_s = step_share * radius_m / speed_mps;
        let any = Formation {
            spacing_m, altitude_m, radius_m, speed_mps, srs_period_s, sigma_toa_ns, ..formation(50.0, 300.0)
        };
        if let Ok(accuracy) = Accuracy::of(any) {
            prop_assert!((1..=10).contains(&accuracy.offset_m.len()));
            prop_assert!(accuracy.residual_curves.len() == 3);
            let rows = accuracy.sync.iter().map(|row| &row.r95_m);
            for radius_m in rows.chain([&accuracy.one_srs_m, &accuracy.pass_m]).flatten() {
                prop_assert!(*radius_m > 0.0, "{radius_m}");
            }
        }
    }
}
