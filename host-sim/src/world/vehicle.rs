//! A multirotor as the flight code sees it: a point mass behind the velocity loop of an autopilot.
//!
//! # Model
//! ```text
//! demand = sat(ff + KP (v_sp - v), A)       kinematic acceleration asked for, A = 3 m/s2, as a vector
//! trim'  = KI (v_sp - v)                    what the loop learned about the drag, held while demand is cut
//! thrust = demand + trim                    horizontally through a lag TAU: the airframe must tilt first
//! v'     = sat(thrust + K (wind - v), A)    drag towards the wind
//! ```
//! The cut lies before the trim: an autopilot that leans against a steady wind still has its full
//! acceleration for manoeuvres (the tilt for both together is atan((3 + 3) / 9.81) = 31 degrees). The last cut makes
//! the limit a law: no vehicle ever accelerates harder than A, gusts included, as the encounter
//! interface promises. Speed stays within `1.2 max_speed`, climb and descent within `max_vertical`.
//!
//! # Gains
//! Horizontally, from v_sp to v, the characteristic polynomial is
//! s^3 + (1/TAU + K) s^2 + (K + KP)/TAU s + KI/TAU. With the defaults (KP = 1.2 1/s, KI = 0.5 1/s2, TAU = 0.25 s,
//! K = 0.15 1/s) its roots are -0.63 1/s (the trim) and a pair of natural frequency 1.79 rad/s with damping
//! 0.98; without the trim the pair has 2.3 rad/s and 0.89. At 0.02 s a step is a 25th of the pair's time constant,
//! so the discrete loop is as well damped as the continuous one (test `truth_step_response`).

use crate::geometry::V3;
use crate::world::{ConfigError, Range, limited, require};
use serde::Deserialize;

/// Standard gravity, met only by a vehicle whose motors stop in the air.
const G_MPS2: f64 = 9.806_65;

/// Parameters of the vehicle and its autopilot.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleConfig {
    /// Cruise speed; the hard limit is 1.2 times this.
    pub max_speed_mps: f64,
    /// Largest climb and descent speed.
    pub max_vertical_mps: f64,
    /// Largest acceleration, as a vector.
    pub max_accel_mps2: f64,
    /// Velocity loop, proportional gain.
    pub kp_per_s: f64,
    /// Velocity loop, integral gain.
    pub ki_per_s2: f64,
    /// Largest trim against drag, as a vector.
    pub max_trim_mps2: f64,
    /// First-order lag from demanded to achieved horizontal acceleration.
    pub attitude_tau_s: f64,
    /// Drag: deceleration per speed through the air.
    pub drag_per_s: f64,
}

impl Default for VehicleConfig {
    fn default() -> Self {
        Self {
            max_speed_mps: 10.0,
            max_vertical_mps: 3.0,
            max_accel_mps2: 3.0,
            kp_per_s: 1.2,
            ki_per_s2: 0.5,
            max_trim_mps2: 3.0,
            attitude_tau_s: 0.25,
            drag_per_s: 0.15,
        }
    }
}

impl VehicleConfig {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// The first such parameter.
    pub fn check(&self) -> Result<(), ConfigError> {
        require("max_speed_mps", self.max_speed_mps, Range::Positive)?;
        require("max_vertical_mps", self.max_vertical_mps, Range::Positive)?;
        require("max_accel_mps2", self.max_accel_mps2, Range::Positive)?;
        require("kp_per_s", self.kp_per_s, Range::Positive)?;
        require("ki_per_s2", self.ki_per_s2, Range::NotNegative)?;
        require("max_trim_mps2", self.max_trim_mps2, Range::NotNegative)?;
        require("attitude_tau_s", self.attitude_tau_s, Range::Positive)?;
        require("drag_per_s", self.drag_per_s, Range::NotNegative)
    }

    /// The speed that no vehicle with running motors ever exceeds.
    #[must_use]
    pub fn hard_speed_limit_mps(&self) -> f64 {
        1.2 * self.max_speed_mps
    }
}

/// What the flight code asks of the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Motors stopped. In the air that is the end of the flight.
    MotorsOff,
    /// Fly at a velocity.
    Velocity {
        /// Velocity setpoint, ENU.
        vel_enu_mps: V3,
        /// Acceleration that the setpoint is known to have, ENU.
        accel_ff_enu_mps2: V3,
    },
}

impl Command {
    /// Hold a velocity without feed-forward.
    #[must_use]
    pub fn velocity(vel_enu_mps: V3) -> Self {
        Self::Velocity { vel_enu_mps, accel_ff_enu_mps2: V3::zeros() }
    }
}

/// How the vehicle moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// At rest on the ground, z = 0. Lifts off when the loop demands to climb.
    Grounded,
    /// Flying under its velocity loop.
    Flying,
    /// Motors stopped in the air: a fall that no command ends.
    Falling,
}

/// One vehicle: state and loop.
#[derive(Clone, Debug)]
pub struct Vehicle {
    config: VehicleConfig,
    dt_s: f64,
    /// 1 - exp(-dt / TAU): the lag sampled exactly.
    lag: f64,
    motion: Motion,
    pos_enu_m: V3,
    vel_enu_mps: V3,
    accel_enu_mps2: V3,
    thrust_enu_mps2: V3,
    trim_enu_mps2: V3,
    touchdown_mps: f64,
    refused_commands: u64,
}

impl Vehicle {
    /// A vehicle at rest at `pos_enu_m`, on the ground if that is not above it, stepped every `dt_s`.
    ///
    /// # Panics
    /// On a config that [`VehicleConfig::check`] refuses, `dt_s` not positive, or a position not finite.
    #[must_use]
    pub fn new(config: VehicleConfig, dt_s: f64, pos_enu_m: V3) -> Self {
        assert!(dt_s > 0.0 && config.check().is_ok(), "vehicle parameters are checked where they are read");
        assert!(is_finite(&pos_enu_m), "a vehicle starts somewhere: {pos_enu_m:?}");
        Self {
            dt_s,
            lag: -(-dt_s / config.attitude_tau_s).exp_m1(),
            config,
            motion: if pos_enu_m.z > 0.0 { Motion::Flying } else { Motion::Grounded },
            pos_enu_m: V3::new(pos_enu_m.x, pos_enu_m.y, pos_enu_m.z.max(0.0)),
            vel_enu_mps: V3::zeros(),
            accel_enu_mps2: V3::zeros(),
            thrust_enu_mps2: V3::zeros(),
            trim_enu_mps2: V3::zeros(),
            touchdown_mps: 0.0,
            refused_commands: 0,
        }
    }

    /// The same vehicle already under way, within its speed limits.
    #[must_use]
    pub fn moving(mut self, vel_enu_mps: V3) -> Self {
        self.vel_enu_mps = self.within_speed_limits(vel_enu_mps);
        self
    }

    /// One step of `dt_s` under a command and the wind at the vehicle. A command that is not finite
    /// is refused, counted, and flown as a hover.
    pub fn step(&mut self, command: Command, wind_enu_mps: V3) {
        match (self.motion, command) {
            (Motion::Grounded, Command::MotorsOff) => {}
            (Motion::Flying | Motion::Falling, Command::MotorsOff) | (Motion::Falling, _) => {
                self.motion = Motion::Falling;
                let accel = self.drag(wind_enu_mps) - V3::z() * G_MPS2;
                self.integrate(self.vel_enu_mps + accel * self.dt_s);
            }
            (Motion::Grounded | Motion::Flying, Command::Velocity { vel_enu_mps, accel_ff_enu_mps2 }) => {
                if is_finite(&vel_enu_mps) && is_finite(&accel_ff_enu_mps2) {
                    self.fly(vel_enu_mps, accel_ff_enu_mps2, wind_enu_mps);
                } else {
                    self.refused_commands += 1;
                    self.fly(V3::zeros(), V3::zeros(), wind_enu_mps);
                }
            }
        }
    }

    /// The velocity loop of the module's head, one step.
    fn fly(&mut self, setpoint_mps: V3, feed_forward_mps2: V3, wind_mps: V3) {
        let c = &self.config;
        let error = self.within_speed_limits(setpoint_mps) - self.vel_enu_mps;
        let wanted = feed_forward_mps2 + error * c.kp_per_s;
        let demand = limited(wanted, c.max_accel_mps2);
        if self.motion == Motion::Grounded {
            if demand.z <= 0.0 {
                return;
            }
            self.motion = Motion::Flying;
        }
        // Anti-windup: while the demand is cut the trim may only shrink.
        let is_cut = wanted.norm_squared() > c.max_accel_mps2 * c.max_accel_mps2;
        if !is_cut || error.dot(&self.trim_enu_mps2) < 0.0 {
            self.trim_enu_mps2 =
                limited(self.trim_enu_mps2 + error * (c.ki_per_s2 * self.dt_s), c.max_trim_mps2);
        }
        let target = demand + self.trim_enu_mps2;
        let thrust = &mut self.thrust_enu_mps2;
        thrust.x += self.lag * (target.x - thrust.x);
        thrust.y += self.lag * (target.y - thrust.y);
        thrust.z = target.z; // the rotors answer much faster than the airframe tilts
        let accel = limited(self.thrust_enu_mps2 + self.drag(wind_mps), c.max_accel_mps2);
        // Both cuts of the speed are projections on convex sets that hold the present velocity, so they
        // never lengthen the change of velocity: the acceleration limit survives them.
        self.integrate(self.within_speed_limits(self.vel_enu_mps + accel * self.dt_s));
    }

    fn drag(&self, wind_mps: V3) -> V3 {
        (wind_mps - self.vel_enu_mps) * self.config.drag_per_s
    }

    /// `vel` with its vertical part, then its length cut to the limits.
    fn within_speed_limits(&self, vel: V3) -> V3 {
        let max_vertical = self.config.max_vertical_mps;
        limited(
            V3::new(vel.x, vel.y, vel.z.clamp(-max_vertical, max_vertical)),
            self.config.hard_speed_limit_mps(),
        )
    }

    /// Moves on to a new velocity at constant acceleration, until the ground.
    fn integrate(&mut self, vel_enu_mps: V3) {
        self.accel_enu_mps2 = (vel_enu_mps - self.vel_enu_mps) / self.dt_s;
        self.pos_enu_m += (self.vel_enu_mps + vel_enu_mps) * (0.5 * self.dt_s);
        self.vel_enu_mps = vel_enu_mps;
        if self.pos_enu_m.z <= 0.0 && self.vel_enu_mps.z <= 0.0 {
            self.touchdown_mps = self.vel_enu_mps.norm();
            self.motion = Motion::Grounded;
            self.pos_enu_m.z = 0.0;
            self.vel_enu_mps = V3::zeros();
            self.accel_enu_mps2 = V3::zeros();
            self.thrust_enu_mps2 = V3::zeros();
            self.trim_enu_mps2 = V3::zeros();
        }
    }

    /// True position.
    #[must_use]
    pub fn pos_enu_m(&self) -> V3 {
        self.pos_enu_m
    }

    /// True velocity.
    #[must_use]
    pub fn vel_enu_mps(&self) -> V3 {
        self.vel_enu_mps
    }

    /// True acceleration over the last step.
    #[must_use]
    pub fn accel_enu_mps2(&self) -> V3 {
        self.accel_enu_mps2
    }

    /// How it moves.
    #[must_use]
    pub fn motion(&self) -> Motion {
        self.motion
    }

    /// Speed at the latest touchdown, metres per second; above about 2 a landing is a crash.
    #[must_use]
    pub fn touchdown_mps(&self) -> f64 {
        self.touchdown_mps
    }

    /// Commands refused because they were not finite.
    #[must_use]
    pub fn refused_commands(&self) -> u64 {
        self.refused_commands
    }
}

fn is_finite(v: &V3) -> bool {
    v.x.is_finite() && v.y.is_finite() && v.z.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DT_S: f64 = 0.02;

    fn aloft() -> Vehicle {
        Vehicle::new(VehicleConfig::default(), DT_S, V3::new(0.0, 0.0, 300.0))
    }

    /// Velocities over `seconds` under one command and wind.
    fn fly(vehicle: &mut Vehicle, command: Command, wind: V3, seconds: f64) -> Vec<V3> {
        let step = |_| {
            vehicle.step(command, wind);
            vehicle.vel_enu_mps()
        };
        (0..(seconds / DT_S).round() as usize).map(step).collect()
    }

    #[test]
    fn truth_step_response() {
        // The linear loop's answer to a step of 1 m/s (nothing is cut), integrated here at 10 microseconds from the
        // differential equations of the module's head.
        let c = VehicleConfig::default();
        let (mut v, mut thrust, mut trim) = (0.0, 0.0, 0.0);
        let fine_s = 1e-5;
        let flown = fly(&mut aloft(), Command::velocity(V3::x()), V3::zeros(), 10.0);
        for (i, found) in flown.iter().enumerate() {
            for _ in 0..(DT_S / fine_s).round() as usize {
                let error = 1.0 - v;
                trim += c.ki_per_s2 * error * fine_s;
                thrust += (c.kp_per_s * error + trim - thrust) / c.attitude_tau_s * fine_s;
                v += (thrust - c.drag_per_s * v) * fine_s;
            }
            assert!((found.x - v).abs() < 0.02, "step {i}: {} of {v}", found.x);
        }
        let peak = flown.iter().map(|v| v.x).fold(0.0, f64::max);
        assert!((1.0..1.16).contains(&peak), "overshoot to {peak}");
        assert!(flown[400..].iter().all(|v| (v.x - 1.0).abs() < 0.02), "settled within 8 s");
    }

    #[test]
    fn reaches_cruise_without_much_overshoot_and_stops_again() {
        let mut vehicle = aloft();
        let up = fly(&mut vehicle, Command::velocity(V3::x() * 10.0), V3::zeros(), 20.0);
        let at_90_percent = up.iter().position(|v| v.x > 9.0).unwrap() as f64 * DT_S;
        assert!(at_90_percent < 6.0, "{at_90_percent} s to 9 m/s");
        let peak = up.iter().map(|v| v.x).fold(0.0, f64::max);
        assert!(peak < 10.8, "{peak}");
        assert!((up.last().unwrap().x - 10.0).abs() < 0.01);
        let down = fly(&mut vehicle, Command::velocity(V3::zeros()), V3::zeros(), 20.0);
        let undershoot = down.iter().map(|v| v.x).fold(0.0, f64::min);
        assert!(undershoot > -0.8, "{undershoot}");
        assert!(down.last().unwrap().norm() < 0.01);
    }

    #[test]
    fn steady_wind_leaves_no_velocity_error() {
        let wind = V3::new(3.0, 0.0, 0.0);
        for setpoint in
            [V3::zeros(), V3::new(-10.0, 0.0, 0.0), V3::new(6.0, 8.0, 0.0), V3::new(0.0, 5.0, 2.0)]
        {
            let mut vehicle = aloft();
            let flown = fly(&mut vehicle, Command::velocity(setpoint), wind, 60.0);
            assert!((flown.last().unwrap() - setpoint).norm() < 1e-6, "{setpoint:?}: {:?}", flown.last());
        }
        // A hover is pushed by no more than the drag over the loop's stiffness, K w / (KP + K) = 0.33 m/s.
        let worst = fly(&mut aloft(), Command::velocity(V3::zeros()), wind, 10.0);
        assert!(worst.iter().all(|v| v.norm() < 0.33));
    }

    #[test]
    fn feed_forward_follows_a_ramp_closely() {
        let mut vehicle = aloft();
        let mut worst: f64 = 0.0;
        for i in 0..200 {
            let t_s = f64::from(i) * DT_S;
            let command =
                Command::Velocity { vel_enu_mps: V3::x() * (2.0 * t_s), accel_ff_enu_mps2: V3::x() * 2.0 };
            vehicle.step(command, V3::zeros());
            worst = worst.max((vehicle.vel_enu_mps().x - 2.0 * (t_s + DT_S)).abs());
        }
        // The lag costs 2 m/s2 * 0.25 s at first, the growing drag 0.3 m/s3 / KI later.
        assert!(worst < 0.6, "{worst}");
    }

    #[test]
    fn takes_off_lands_softly_and_stays_put() {
        let mut vehicle = Vehicle::new(VehicleConfig::default(), DT_S, V3::new(5.0, 6.0, -1.0));
        let wind = V3::new(3.0, 1.0, 0.0);
        let _ = fly(&mut vehicle, Command::MotorsOff, wind, 5.0);
        let _ = fly(&mut vehicle, Command::velocity(V3::new(4.0, 0.0, -1.0)), wind, 5.0);
        assert_eq!((vehicle.motion(), vehicle.pos_enu_m()), (Motion::Grounded, V3::new(5.0, 6.0, 0.0)));
        let _ = fly(&mut vehicle, Command::velocity(V3::z() * 2.0), wind, 10.0);
        assert_eq!(vehicle.motion(), Motion::Flying);
        assert!(vehicle.pos_enu_m().z > 15.0);
        let _ = fly(&mut vehicle, Command::velocity(V3::z() * -0.5), wind, 60.0);
        assert_eq!((vehicle.motion(), vehicle.pos_enu_m().z), (Motion::Grounded, 0.0));
        assert!(vehicle.touchdown_mps() < 0.7, "{}", vehicle.touchdown_mps());
        assert_eq!(vehicle.vel_enu_mps(), V3::zeros());
    }

    #[test]
    fn motors_off_aloft_is_a_fall_that_nothing_ends() {
        let mut vehicle = aloft();
        vehicle.step(Command::MotorsOff, V3::zeros());
        let _ = fly(&mut vehicle, Command::velocity(V3::z() * 3.0), V3::zeros(), 2.0);
        assert_eq!(vehicle.motion(), Motion::Falling);
        // Linear drag: v = -(g / K)(1 - exp(-K t)).
        let expected = -G_MPS2 / 0.15 * (1.0 - (-0.15_f64 * 2.02).exp());
        assert!((vehicle.vel_enu_mps().z - expected).abs() < 0.05, "{} {expected}", vehicle.vel_enu_mps().z);
        let _ = fly(&mut vehicle, Command::velocity(V3::zeros()), V3::zeros(), 20.0);
        assert_eq!(vehicle.motion(), Motion::Grounded);
        assert!(vehicle.touchdown_mps() > 30.0);
    }

    #[test]
    fn commands_that_are_no_numbers_are_refused_and_counted() {
        let mut vehicle = aloft();
        let _ = fly(&mut vehicle, Command::velocity(V3::new(f64::NAN, 0.0, 0.0)), V3::zeros(), 1.0);
        let endless =
            Command::Velocity { vel_enu_mps: V3::zeros(), accel_ff_enu_mps2: V3::x() * f64::INFINITY };
        let _ = fly(&mut vehicle, endless, V3::zeros(), 1.0);
        assert_eq!(vehicle.refused_commands(), 100);
        assert_eq!(vehicle.pos_enu_m(), V3::new(0.0, 0.0, 300.0));
    }

    #[test]
    fn config_names_the_bad_parameter() {
        let bad = VehicleConfig { attitude_tau_s: 0.0, ..VehicleConfig::default() };
        assert_eq!(bad.check().unwrap_err().field, "attitude_tau_s");
    }

    fn vector(reach: f64) -> impl Strategy<Value = V3> {
        (-reach..reach, -reach..reach, -reach..reach).prop_map(|(x, y, z)| V3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn limits_are_never_exceeded(
            start in vector(20.0),
            legs in prop::collection::vec((vector(30.0), vector(10.0), vector(15.0), 1..200_usize), 1..12),
        ) {
            let mut vehicle = aloft().moving(start);
            for (vel_enu_mps, accel_ff_enu_mps2, wind, steps) in legs {
                for _ in 0..steps {
                    vehicle.step(Command::Velocity { vel_enu_mps, accel_ff_enu_mps2 }, wind);
                    prop_assert!(vehicle.accel_enu_mps2().norm() <= 3.0 + 1e-9);
                    prop_assert!(vehicle.vel_enu_mps().norm() <= 12.0 + 1e-9);
                    prop_assert!(vehicle.vel_enu_mps().z.abs() <= 3.0 + 1e-9);
                    prop_assert!(vehicle.pos_enu_m().z >= 0.0);
                }
            }
        }

        #[test]
        fn every_reachable_setpoint_is_reached_in_any_steady_wind(
            speed in 0.0..10.0_f64, heading in 0.0..std::f64::consts::TAU, climb in 0.0..2.9_f64,
            wind_speed in 0.0..8.0_f64, from in 0.0..std::f64::consts::TAU,
        ) {
            let setpoint = V3::new(speed * heading.cos(), speed * heading.sin(), climb);
            let wind = V3::new(from.cos(), from.sin(), 0.0) * wind_speed;
            let mut vehicle = aloft();
            let flown = fly(&mut vehicle, Command::velocity(setpoint), wind, 60.0);
            prop_assert!((flown.last().unwrap() - setpoint).norm() < 1e-3);
        }
    }
}
