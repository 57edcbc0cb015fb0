//! What the covariance of a fix has to hold beyond the noise of its captures.

use super::model::{C_M_PER_NS, LocalizeConfig, MAX_CAPTURES};
use super::problem::{Heard, Problem, UserSpan};
use super::robust::{Loss, linearise};
use super::small::{Mat, mul};
use super::solve::State;

/// Standard deviations grow by this factor where nothing vouches for the captures: 95 % become 99 % if all is as
/// declared.
const UNVOUCHED: f64 = 1.3;

/// Covariance of user `u`, widened by what its captures cannot show. `known_clocks` is its covariance if the clocks
/// were known.
pub(super) fn widened<const D: usize>(
    problem: &Problem,
    cfg: &LocalizeConfig,
    state: &State<D>,
    u: usize,
    cov: &Mat<D>,
    known_clocks: &Mat<D>,
) -> Mat<D> {
    let user = &problem.users[u];
    let heard = &problem.heard[user.span.clone()];
    let mut cov = *cov;
    if cfg.drone_bias_sigma_m > 0.0 {
        let biased = bias_gains(cfg, state, heard, state.pos_m[u], known_clocks);
        let variance_m2 = cfg.drone_bias_sigma_m.powi(2);
        for gain in biased.iter().flatten() {
            for a in 0..D {
                for b in 0..D {
                    cov[a][b] += variance_m2 * gain[a] * gain[b];
                }
            }
        }
    }
    if by_one_pair(heard) || out_of_reach(cfg, user, heard, state.pos_m[u]) {
        cov = cov.map(|row| row.map(|x| UNVOUCHED * UNVOUCHED * x));
    }
    cov
}

/// Whether the same two drones made all captures: no third one to contradict them.
fn by_one_pair(heard: &[Heard]) -> bool {
    let pair = |h: &Heard| [h.slot[0], h.slot[1]];
    heard.iter().all(|h| h.count == 2 && pair(h) == pair(&heard[0]))
}

/// Whether a user would lie beyond the radius in which it should be heard, whoever heard it.
fn out_of_reach<const D: usize>(cfg: &LocalizeConfig, user: &UserSpan, heard: &[Heard], p: [f64; D]) -> bool {
    let near = |[x, y]: [f64; 2]| (p[0] - x).hypot(p[1] - y) <= cfg.expected_radius_m;
    let drones = heard.iter().flat_map(|h| (0..usize::from(h.count)).map(|i| [h.east_m[i], h.north_m[i]]));
    !near(user.centroid_m) && !drones.into_iter().any(near)
}

/// By how much a fix moves for a metre of each coordinate of each drone, the same over all captures.
///
/// The clocks are held, although they would take up some of it: the widening errs to the safe side.
fn bias_gains<const D: usize>(
    cfg: &LocalizeConfig,
    state: &State<D>,
    heard: &[Heard],
    p: [f64; D],
    known_clocks: &Mat<D>,
) -> Vec<[[f64; D]; 3]> {
    let loss = Loss::accepting(cfg.robust);
    let mut gains = vec![[[0.0; D]; 3]; state.grid.drones];
    for h in heard {
        let row = linearise(h, p, state.clock_ns(h), &loss);
        if row.total <= 0.0 {
            continue;
        }
        let up_m = p.get(2).copied().unwrap_or(0.0);
        let mean: [f64; D] = std::array::from_fn(|axis| {
            (0..MAX_CAPTURES).map(|i| row.weight[i] * row.slope[i][axis]).sum::<f64>() * row.inverse_total
        });
        for i in 0..usize::from(h.count) {
            let way_m = [p[0] - h.east_m[i], p[1] - h.north_m[i], up_m - h.up_m[i]];
            let distance_m = way_m.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-3);
            for (gain, way_m) in gains[usize::from(h.slot[i])].iter_mut().zip(way_m) {
                let delay_ns = way_m / (distance_m * C_M_PER_NS);
                for axis in 0..D {
                    gain[axis] += row.weight[i] * (row.slope[i][axis] - mean[axis]) * delay_ns;
                }
            }
        }
    }
    gains.iter_mut().flatten().for_each(|gain| *gain = mul(known_clocks, *gain));
    gains
}
