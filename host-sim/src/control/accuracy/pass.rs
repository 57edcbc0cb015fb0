//! What is heard of users beside a lane, at the true geometry, and the bound of it.

use std::collections::BTreeMap;

use skyroost_protocol::units::{DroneId, UserId};

use super::{AccuracyError, Formation};
use crate::control::localize::{C_M_PER_NS, Capture, LocalizeConfig, Occasion, crlb};
use crate::geometry::V2;

/// Which of a user's SRS count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// The one with the fleet's centre abreast.
    Once,
    /// All while the user is in the swath's disk, one of them abreast.
    WholePass,
}

/// Covariance of a position, in square metres.
pub(super) type Covariance = [[f64; 2]; 2];

impl Formation {
    /// SRS of a user in a whole pass, `offset_m` beside the lane and in the swath.
    pub(super) fn srs_of_pass(&self, offset_m: f64) -> usize {
        2 * self.steps(offset_m) as usize + 1
    }

    /// SRS before the one abreast, and after it.
    fn steps(&self, offset_m: f64) -> i32 {
        let half_chord_m = (self.swath_radius_m().powi(2) - offset_m.powi(2)).max(0.0).sqrt();
        (half_chord_m / (self.speed_mps * self.srs_period_s)) as i32
    }

    /// Drones when the fleet's centre is `along_m` up the lane.
    pub(super) fn drones_m(&self, along_m: f64) -> [[f64; 3]; 3] {
        self.corners.map(|corner| {
            let at_m = V2::new(along_m, 0.0) + corner * self.spacing_m;
            [at_m.x, at_m.y, self.altitude_m]
        })
    }

    /// The fleet's centre along the lane at each SRS of a user at `user_m`.
    pub(super) fn asked_along_m(&self, user_m: V2, heard: Heard) -> impl Iterator<Item = f64> + use<> {
        let steps = match heard {
            Heard::Once => 0,
            Heard::WholePass => self.steps(user_m.y),
        };
        let step_m = self.speed_mps * self.srs_period_s;
        (-steps..=steps).map(move |k| user_m.x + f64::from(k) * step_m)
    }

    /// The SRS of one user, captured without noise. Time is 0 where the lane's coordinates are.
    pub(super) fn occasions(&self, user: UserId, user_m: V2, heard: Heard) -> impl Iterator<Item = Occasion> {
        self.asked_along_m(user_m, heard).map(move |along_m| Occasion {
            user,
            clock_group: 0,
            time_s: along_m / self.speed_mps,
            captures: (1..)
                .zip(self.drones_m(along_m))
                .map(|(id, pos_enu_m)| {
                    let [x, y, z] = pos_enu_m;
                    let distance_m = (V2::new(x, y) - user_m).norm().hypot(z);
                    let toa_ns = distance_m / C_M_PER_NS;
                    Capture { drone: DroneId(id), pos_enu_m, toa_ns, sigma_ns: Some(self.sigma_toa_ns) }
                })
                .collect(),
        })
    }

    /// Bound of each of `users_m`, who share what is unknown about the clocks; none where the captures do not
    /// determine a position.
    pub(super) fn bounds(
        &self,
        users_m: &[V2],
        heard: Heard,
        cfg: &LocalizeConfig,
    ) -> Result<Vec<Option<Covariance>>, AccuracyError> {
        let users = || (1..).map(UserId).zip(users_m.iter().copied());
        let occasions: Vec<Occasion> =
            users().flat_map(|(user, user_m)| self.occasions(user, user_m, heard)).collect();
        let truth: BTreeMap<UserId, [f64; 2]> = users().map(|(user, p)| (user, [p.x, p.y])).collect();
        let bounds = crlb(&occasions, &vec![[false; 3]; occasions.len()], &truth, cfg)?;
        Ok(users().map(|(user, _)| bounds.get(&user).copied()).collect())
    }
}
