//! ORCA (J. van den Berg and others, "Reciprocal n-body collision avoidance", 2011) by the crate `dodgy_2d`, a port of
//! its authors' RVO2, with exactly what the flight code's avoidance gets.
//!
//! The crate takes a random direction where one drone is at another's place and stays there; with any error, and with
//! wanted velocities that lean, that does not happen, and all else is a function of its input.

use std::borrow::Cow;

use dodgy_2d::{Agent, AvoidanceOptions, Vec2};
use skyroost_firmware::avoid::pca::Mover;
use skyroost_firmware::{STEP_S, Vec3};
use skyroost_host_sim::encounter::{Knowledge, Steering};

/// Beyond `d_safe` and both error radii, as the flight code plans, metres.
const PLAN_SLACK_M: f32 = 0.5;

/// Optimal reciprocal collision avoidance in the plane; the vertical velocity is the wanted one.
#[derive(Clone, Copy)]
pub(crate) struct Orca {
    /// How far ahead conflicts are looked for, seconds.
    horizon_s: f32,
    /// By how much the wanted velocity is turned to its left, radians (small).
    lean_rad: f32,
}

impl Orca {
    /// As RVO2's examples use it: the wanted velocity is a thousandth off, so that symmetry does not last. Of horizons
    /// of 2, 3, 5, 8 and 15 s this one breaks the separation least.
    pub(crate) const USUAL: Self = Self { horizon_s: 5.0, lean_rad: 0.001 };
    /// The best found: everybody leans by 6 degrees, which is no part of ORCA, but makes all pass on one side. Of horizons
    /// of 3, 5, 8 and 12 s and leans of 0.02, 0.05, 0.1 and 0.2 this one costs least in a box, of those that broke no
    /// separation in a first try.
    pub(crate) const LEANING: Self = Self { horizon_s: 8.0, lean_rad: 0.1 };
}

impl Steering for Orca {
    fn steer(&self, known: &Knowledge<'_>) -> Vec3 {
        let separation = &known.separation;
        // Radii of a pair add up to what the flight code keeps.
        let agent = |mover: &Mover, error_radius_m: f32| Agent {
            position: flat(&mover.pos_enu_m),
            velocity: flat(&mover.vel_enu_mps),
            radius: 0.5 * (separation.d_safe_m + PLAN_SLACK_M) + error_radius_m,
            avoidance_responsibility: 1.0,
        };
        let neighbours: Vec<Cow<'_, Agent>> = (known.peers.iter())
            .map(|peer| Cow::Owned(agent(&peer.predicted(known.now), peer.error_radius_m())))
            .collect();
        let wanted_mps = flat(&known.wanted_mps);
        let v = agent(&known.own, separation.own_error_m).compute_avoiding_velocity(
            &neighbours,
            &[],
            wanted_mps + wanted_mps.perp() * self.lean_rad,
            separation.max_speed_mps,
            STEP_S,
            &AvoidanceOptions {
                obstacle_margin: 0.0,
                time_horizon: self.horizon_s,
                obstacle_time_horizon: self.horizon_s,
            },
        );
        Vec3::new(v.x, v.y, known.wanted_mps.z)
    }
}

fn flat(v: &Vec3) -> Vec2 {
    Vec2::new(v.x, v.y)
}
