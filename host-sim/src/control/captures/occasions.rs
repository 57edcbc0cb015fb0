//! Captures as the estimator takes them.

use heapless::Vec as BoundedVec;
use skyroost_protocol::units::{DroneId, UserId};

use super::Captures;
use super::decimal::to_f64;
use super::rows::Row;
use crate::control::localize::{C_M_PER_NS, Capture, MAX_CAPTURES, Occasion};

/// A difference of arrivals beyond the way between the drones by this many standard deviations is none of the noise.
const IMPLAUSIBLE_SIGMAS: f64 = 6.0;

/// What the estimator is given, and what became of the file on the way there.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// By user and time; times count from the first epoch, arrivals from the first of their occasion.
    pub occasions: Vec<Occasion>,
    /// What was taken out of each drone's arrivals beforehand, nanoseconds, in the order of [`Captures::drones`].
    pub taken_out_ns: Vec<f64>,
    /// Occasions that two drones heard or more.
    pub heard_together: usize,
    /// Occasions that one drone heard: they hold no difference of arrivals.
    pub heard_alone: usize,
    /// Of those heard together the ones that more drones heard than the estimator takes at once.
    pub divided: usize,
    /// Differences of arrivals that were given up by dividing.
    pub differences_lost: usize,
    /// Occasions with arrivals further apart than the way between the drones allows, were their clocks the same.
    pub implausible: usize,
}

impl Captures {
    /// The occasions for the estimator, all of one group of clocks.
    ///
    /// With `clocks_differ` a coarse difference is taken out of every drone's arrivals first, exactly: what is left
    /// for the estimator is some 100 ns, whatever the clocks count from.
    ///
    /// An occasion that more than [`MAX_CAPTURES`] drones heard becomes several with emission times of their own:
    /// honest, though a difference is lost with each. Which drones go together changes from occasion to
    /// occasion, so that all clocks stay tied.
    #[must_use]
    pub fn prepare(&self, clocks_differ: bool) -> Prepared {
        let coarse: Vec<i128> =
            self.drones.iter().map(|drone| if clocks_differ { drone.coarse } else { 0 }).collect();
        let mut prepared = Prepared {
            occasions: Vec::with_capacity(self.rows.len() / 2),
            taken_out_ns: coarse.iter().map(|&coarse| to_f64(coarse)).collect(),
            heard_together: 0,
            heard_alone: 0,
            divided: 0,
            differences_lost: 0,
            implausible: 0,
        };
        for of_user in self.rows.chunk_by(|a, b| a.user == b.user) {
            for (turn, rows) in of_user.chunk_by(Row::same_occasion).enumerate() {
                let time_s = to_f64(rows[0].epoch - self.first_epoch);
                let first = rows[0].toa - coarse[rows[0].drone as usize];
                let toa_ns = |row: &Row| to_f64(row.toa - coarse[row.drone as usize] - first);
                prepared.count(rows, &toa_ns);
                for part in parts(rows.len(), turn) {
                    let captures: BoundedVec<Capture, MAX_CAPTURES> = part
                        .map(|i| Capture {
                            drone: DroneId(rows[i].drone as u16 + 1),
                            pos_enu_m: rows[i].pos_m,
                            toa_ns: toa_ns(&rows[i]),
                            sigma_ns: Some(rows[i].sigma_ns),
                        })
                        .collect();
                    prepared.occasions.push(Occasion {
                        user: UserId(rows[0].user),
                        clock_group: 0,
                        time_s,
                        captures,
                    });
                }
            }
        }
        prepared
    }
}

impl Prepared {
    fn count(&mut self, rows: &[Row], toa_ns: &impl Fn(&Row) -> f64) {
        if rows.len() < 2 {
            self.heard_alone += 1;
            return;
        }
        self.heard_together += 1;
        self.differences_lost += rows.len().div_ceil(MAX_CAPTURES) - 1;
        self.divided += usize::from(rows.len() > MAX_CAPTURES);
        self.implausible += usize::from(rows.windows(2).any(|pair| {
            let way_m = (0..3).map(|k| (pair[1].pos_m[k] - pair[0].pos_m[k]).powi(2)).sum::<f64>().sqrt();
            let noise_ns = pair[0].sigma_ns.hypot(pair[1].sigma_ns);
            (toa_ns(&pair[1]) - toa_ns(&pair[0])).abs() > way_m / C_M_PER_NS + IMPLAUSIBLE_SIGMAS * noise_ns
        }));
    }
}

/// Divides `count` captures, in a circle, into as few parts of about equal size as the estimator takes; the first one
/// begins at `turn`.
fn parts(count: usize, turn: usize) -> impl Iterator<Item = impl Iterator<Item = usize>> {
    let parts = count.div_ceil(MAX_CAPTURES).max(1);
    let bound = move |part: usize| part * count / parts;
    let begin = if parts > 1 { turn % count } else { 0 };
    (0..parts).map(move |part| (bound(part)..bound(part + 1)).map(move |i| (begin + i) % count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_every_capture_once_and_never_one_alone() {
        for count in 1..=40 {
            for turn in 0..50 {
                let parts: Vec<Vec<usize>> = parts(count, turn).map(Iterator::collect).collect();
                assert_eq!(parts.len(), count.div_ceil(MAX_CAPTURES));
                assert!(
                    parts.iter().all(|part| part.len() <= MAX_CAPTURES && (part.len() > 1 || count == 1))
                );
                let mut all = parts.concat();
                all.sort_unstable();
                assert_eq!(all, (0..count).collect::<Vec<_>>());
            }
        }
    }
}
