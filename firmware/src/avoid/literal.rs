//! The paper's rule as it stands, but for its signs: every pair shares what is missing, and the shares add up.

use super::{Separation, pca};
use crate::{Vec3, avoid::pca::Mover, peers::PeerTable};
use skyroost_protocol::units::TimePs;

/// The paper adds nothing beyond what is known to err; this is for rounding and delay, metres.
const SLACK_M: f32 = 0.5;

/// Sum over conflicts of A's share of the displacement (14) along `l_p`, each spread over its time to closest approach
/// (16), (17), metres a second.
pub(super) fn displacement_mps(now: TimePs, own: &Mover, peers: &PeerTable, separation: &Separation) -> Vec3 {
    let mut sum = Vec3::zeros();
    for peer in peers.iter() {
        let other = peer.predicted(now);
        let keep_m = separation.d_safe_m + separation.own_error_m + peer.error_radius_m() + SLACK_M;
        let Some(pca::Approach { tau_s, pass_m }) = pca::approach(own, &other) else { continue };
        let miss_m = pass_m.norm();
        // (12) with the time that it omits, (13) to (15) with the sum of both displacements mended; where the pass
        // vector vanishes the paper names no direction.
        if tau_s <= 0.0 || miss_m >= separation.d_safe_m || miss_m <= 0.0 {
            continue;
        }
        let (speed_a, speed_b) = (own.vel_enu_mps.norm(), other.vel_enu_mps.norm());
        let share = speed_b / (speed_a + speed_b);
        sum += pass_m * (share * (keep_m - miss_m) / (miss_m * tau_s));
    }
    if sum.iter().all(|x| x.is_finite()) { sum } else { Vec3::zeros() }
}
