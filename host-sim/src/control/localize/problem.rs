//! Occasions sorted and checked: one problem per clock group, in the layout that the solver reads.

use std::ops::Range;

use skyroost_protocol::units::{DroneId, UserId};

use super::model::{C_M_PER_NS, LocalizeConfig, MAX_CAPTURES, Occasion};
use super::walk::VISIT_GAP_S;

/// Numbers beyond these are mistakes, and would drown everything else in rounding errors: 31,000 years,
/// 100,000 km, 11 days, a millisecond, a femtosecond.
const MOST_TIME_S: f64 = 1e12;
const MOST_POSITION_M: f64 = 1e8;
const MOST_TOA_NS: f64 = 1e15;
const SIGMA_NS: [f64; 2] = [1e-6, 1e6];

/// One usable occasion. Unused places carry no information (`info` = 0).
#[derive(Clone, Copy, Debug)]
pub(super) struct Heard {
    pub(super) time_s: f64,
    /// Captures, the first ones of the arrays.
    pub(super) count: u8,
    /// Index of the drone within its group.
    pub(super) slot: [u8; MAX_CAPTURES],
    pub(super) east_m: [f64; MAX_CAPTURES],
    pub(super) north_m: [f64; MAX_CAPTURES],
    /// Height above the altitude assumed for the user.
    pub(super) up_m: [f64; MAX_CAPTURES],
    /// Relative to the occasion's first capture.
    pub(super) toa_ns: [f64; MAX_CAPTURES],
    /// Inverse variance, 1/ns^2.
    pub(super) info: [f64; MAX_CAPTURES],
}

/// One user of a group; of one that walks, one visit.
#[derive(Clone, Debug)]
pub(super) struct UserSpan {
    pub(super) user: UserId,
    /// Its occasions in [`Problem::heard`], in time order.
    pub(super) span: Range<usize>,
    /// Mean position of the drones while they heard it: where the search starts.
    pub(super) centroid_m: [f64; 2],
    /// Direction of the drones' flight past it: principal axis of their positions, a unit vector.
    pub(super) track: [f64; 2],
    pub(super) last_heard_s: f64,
}

impl UserSpan {
    /// A user of no problem, heard about there.
    pub(super) fn at(centroid_m: [f64; 2]) -> Self {
        Self { user: UserId(0), span: 0..0, centroid_m, track: [1.0, 0.0], last_heard_s: 0.0 }
    }
}

/// All that one clock group heard.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    pub(super) clock_group: u16,
    /// Sorted; the first is the reference of the clocks.
    pub(super) drones: Vec<DroneId>,
    /// Sorted by id, visits by time.
    pub(super) users: Vec<UserSpan>,
    /// Sorted by user, then time.
    pub(super) heard: Vec<Heard>,
    /// First and last time in `heard`; both 0 when that is empty.
    pub(super) time_s: [f64; 2],
}

/// Why captures or occasions did not make it into a problem.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    /// Occasions at a time that is not finite or absurd.
    pub(super) bad_time: usize,
    /// Captures with a number that is not finite or absurd, or a standard deviation not above 0.
    pub(super) bad_capture: usize,
    /// Second captures of a drone in one occasion.
    pub(super) duplicate: usize,
    /// Captures of drones beyond the 256th of a group.
    pub(super) too_many_drones: usize,
}

impl Dropped {
    /// One line per reason that occurred.
    pub(super) fn warnings(self) -> impl Iterator<Item = String> {
        [
            (self.bad_time, "occasions dropped: time_s is not finite or beyond 1e12"),
            (
                self.bad_capture,
                "captures dropped: not finite, or beyond 1e8 m, 1e15 ns or sigma_ns of 1e-6 to 1e6",
            ),
            (self.duplicate, "captures dropped: the same drone twice in one occasion"),
            (self.too_many_drones, "captures dropped: more than 256 drones in one clock group"),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
    }
}

/// Splits occasions by clock group, with the captures that `keep(occasion, capture)` (indices of the input) lets
/// through. The result does not depend on the order of occasions or captures.
pub(super) fn split(
    occasions: &[Occasion],
    cfg: &LocalizeConfig,
    keep: impl Fn(usize, usize) -> bool,
) -> (Vec<Problem>, Dropped) {
    let mut dropped = Dropped::default();
    let mut fleets = Fleets::default();
    let mut order: Vec<Key> = Vec::with_capacity(occasions.len());
    for (i, occasion) in occasions.iter().enumerate() {
        if occasion.time_s.abs() <= MOST_TIME_S {
            let user = u64::from(occasion.clock_group) << 32 | u64::from(occasion.user.0);
            order.push((user, i as u32));
            fleets.add(occasion);
        } else {
            dropped.bad_time += 1;
        }
    }
    // Stable: what comes in order of time stays in it.
    order.sort_by_key(|&(user, _)| user);
    let problems = order
        .chunk_by_mut(|a, b| a.0 >> 32 == b.0 >> 32)
        .map(|group| {
            let drones = fleets.take((group[0].0 >> 32) as u16);
            build(occasions, group, drones, cfg, &keep, &mut dropped)
        })
        .collect();
    (problems, dropped)
}

/// Group and user, index of an occasion.
type Key = (u64, u32);

/// Sorts the occasions of one user by time, and equal times by what was captured, so that input order never matters.
fn sort_by_time(occasions: &[Occasion], of_user: &mut [Key]) {
    let at = |key: &Key| &occasions[key.1 as usize];
    if !of_user.is_sorted_by(|a, b| at(a).time_s < at(b).time_s) {
        of_user.sort_unstable_by(|a, b| {
            let (a, b) = (at(a), at(b));
            a.time_s.total_cmp(&b.time_s).then_with(|| canonical(a).cmp(&canonical(b)))
        });
    }
}

/// Drones of every clock group, sorted.
#[derive(Default)]
struct Fleets {
    drones: Vec<(u16, Vec<DroneId>)>,
    /// The last one added to.
    last: usize,
}

impl Fleets {
    fn add(&mut self, occasion: &Occasion) {
        let group = occasion.clock_group;
        if self.drones.get(self.last).is_none_or(|(known, _)| *known != group) {
            let known = self.drones.iter().position(|(known, _)| *known == group);
            self.last = known.unwrap_or(self.drones.len());
            if known.is_none() {
                self.drones.push((group, Vec::new()));
            }
        }
        let drones = &mut self.drones[self.last].1;
        for (i, capture) in occasion.captures.iter().enumerate() {
            if let Err(at) = find(drones, i, capture.drone) {
                drones.insert(at, capture.drone);
            }
        }
    }

    /// The drones of a group, no more than slots can number.
    fn take(&mut self, group: u16) -> Vec<DroneId> {
        let found = self.drones.iter_mut().find(|(known, _)| *known == group);
        let mut drones = found.map(|(_, drones)| std::mem::take(drones)).unwrap_or_default();
        drones.truncate(256);
        drones
    }
}

/// Place of a drone in a sorted list, or where it belongs. Mostly it is at `guess`: a fleet's captures are those of
/// its drones, in order.
#[inline]
fn find(drones: &[DroneId], guess: usize, drone: DroneId) -> Result<usize, usize> {
    if drones.get(guess) == Some(&drone) { Ok(guess) } else { drones.binary_search(&drone) }
}

/// A total order of occasions with equal user and time.
fn canonical(occasion: &Occasion) -> Vec<(u16, [u64; 4])> {
    let mut keys: Vec<_> = occasion
        .captures
        .iter()
        .map(|c| {
            let [x, y, z] = c.pos_enu_m.map(f64::to_bits);
            (c.drone.0, [c.toa_ns.to_bits(), x, y, z])
        })
        .collect();
    keys.sort_unstable();
    keys
}

/// One group, sorted.
fn build(
    occasions: &[Occasion],
    group: &mut [Key],
    drones: Vec<DroneId>,
    cfg: &LocalizeConfig,
    keep: &impl Fn(usize, usize) -> bool,
    dropped: &mut Dropped,
) -> Problem {
    let mut problem = Problem {
        clock_group: occasions[group[0].1 as usize].clock_group,
        drones,
        users: Vec::new(),
        heard: Vec::with_capacity(group.len()),
        time_s: [f64::INFINITY, f64::NEG_INFINITY],
    };
    let reader = Reader::new(&problem.drones, cfg);
    group.chunk_by_mut(|a, b| a.0 == b.0).for_each(|of_user| sort_by_time(occasions, of_user));
    let at_s = |key: &Key| occasions[key.1 as usize].time_s;
    let same_visit =
        |a: &Key, b: &Key| a.0 == b.0 && (cfg.motion.is_still() || at_s(b) - at_s(a) <= VISIT_GAP_S);
    for of_user in group.chunk_by(same_visit) {
        let start = problem.heard.len();
        let mut track = Track::default();
        for &(_, i) in of_user {
            let i = i as usize;
            let heard = reader.hear(&occasions[i], |capture| keep(i, capture), dropped);
            if heard.count > 0 {
                track.add(&heard);
            }
            if heard.count >= 2 {
                problem.time_s[0] = problem.time_s[0].min(heard.time_s);
                problem.time_s[1] = problem.time_s[1].max(heard.time_s);
                problem.heard.push(heard);
            }
        }
        // A user none of whose captures can be read is not in the answer; its captures are counted.
        if let Some((centroid_m, direction)) = track.finish() {
            problem.users.push(UserSpan {
                user: occasions[of_user[0].1 as usize].user,
                span: start..problem.heard.len(),
                centroid_m,
                track: direction,
                last_heard_s: track.last_heard_s,
            });
        }
    }
    if problem.heard.is_empty() {
        problem.time_s = [0.0; 2];
    }
    problem
}

/// Reads occasions of one clock group.
pub(super) struct Reader<'a> {
    drones: &'a [DroneId],
    cfg: &'a LocalizeConfig,
    /// What errors of the drones' positions add to an arrival.
    drone_variance_ns2: f64,
}

impl<'a> Reader<'a> {
    /// For a group of these drones, sorted.
    pub(super) fn new(drones: &'a [DroneId], cfg: &'a LocalizeConfig) -> Self {
        // A bias is no noise (`excess`), but it shows in the residuals: outliers are judged with it.
        let drone_sigma_ns = cfg.drone_pos_sigma_m.hypot(cfg.drone_bias_sigma_m) / C_M_PER_NS;
        Self { drones, cfg, drone_variance_ns2: drone_sigma_ns.powi(2) }
    }

    /// Reads one occasion, captures sorted by drone.
    pub(super) fn hear(
        &self,
        occasion: &Occasion,
        keep: impl Fn(usize) -> bool,
        dropped: &mut Dropped,
    ) -> Heard {
        let mut heard = Heard {
            time_s: occasion.time_s,
            count: 0,
            slot: [0; MAX_CAPTURES],
            east_m: [0.0; MAX_CAPTURES],
            north_m: [0.0; MAX_CAPTURES],
            up_m: [1.0; MAX_CAPTURES],
            toa_ns: [0.0; MAX_CAPTURES],
            info: [0.0; MAX_CAPTURES],
        };
        let mut order: [usize; MAX_CAPTURES] = std::array::from_fn(|i| i);
        let captures = &occasion.captures;
        let order = &mut order[..captures.len()];
        if !captures.is_sorted_by(|a, b| a.drone < b.drone) {
            order.sort_unstable_by(|&a, &b| {
                let (a, b) = (&captures[a], &captures[b]);
                a.drone.cmp(&b.drone).then(a.toa_ns.total_cmp(&b.toa_ns))
            });
        }
        let mut first_toa_ns = 0.0;
        for &i in order.iter().filter(|&&i| keep(i)) {
            let capture = &captures[i];
            let sigma_ns = capture.sigma_ns.unwrap_or(self.cfg.sigma_toa_ns);
            let sane = capture.pos_enu_m.iter().all(|p| p.abs() <= MOST_POSITION_M)
                && capture.toa_ns.abs() <= MOST_TOA_NS
                && (SIGMA_NS[0]..=SIGMA_NS[1]).contains(&sigma_ns);
            if !sane {
                dropped.bad_capture += 1;
                continue;
            }
            let n = usize::from(heard.count);
            let Ok(slot) = find(self.drones, n, capture.drone) else {
                dropped.too_many_drones += 1;
                continue;
            };
            if n > 0 && usize::from(heard.slot[n - 1]) == slot {
                dropped.duplicate += 1;
                continue;
            }
            if n == 0 {
                first_toa_ns = capture.toa_ns;
            }
            let [east_m, north_m, up_m] = capture.pos_enu_m;
            heard.slot[n] = slot as u8;
            heard.east_m[n] = east_m;
            heard.north_m[n] = north_m;
            heard.up_m[n] = up_m - self.cfg.user_altitude_m;
            heard.toa_ns[n] = capture.toa_ns - first_toa_ns;
            heard.info[n] = 1.0 / (sigma_ns.powi(2) + self.drone_variance_ns2);
            heard.count += 1;
        }
        heard
    }
}

/// Moments of the drones' mean position over the occasions of one user.
#[derive(Default)]
struct Track {
    count: f64,
    /// The first position: the others are taken relative to it, so that sums of squares keep their digits.
    origin_m: [f64; 2],
    sum_m: [f64; 2],
    /// East-east, east-north, north-north.
    sum_m2: [f64; 3],
    last_heard_s: f64,
}

impl Track {
    fn add(&mut self, heard: &Heard) {
        // Unused places hold zeros.
        let mean = |values: &[f64; MAX_CAPTURES]| values.iter().sum::<f64>() / f64::from(heard.count);
        let at_m = [mean(&heard.east_m), mean(&heard.north_m)];
        if self.count == 0.0 {
            self.origin_m = at_m;
        }
        let [x, y] = [at_m[0] - self.origin_m[0], at_m[1] - self.origin_m[1]];
        self.count += 1.0;
        self.sum_m = [self.sum_m[0] + x, self.sum_m[1] + y];
        self.sum_m2 = [self.sum_m2[0] + x * x, self.sum_m2[1] + x * y, self.sum_m2[2] + y * y];
        self.last_heard_s = heard.time_s;
    }

    /// Centroid and principal axis; `None` without any occasion.
    fn finish(&self) -> Option<([f64; 2], [f64; 2])> {
        if self.count == 0.0 {
            return None;
        }
        let [x, y] = self.sum_m.map(|sum| sum / self.count);
        let [xx, xy, yy] = self.sum_m2.map(|sum| sum / self.count);
        let (xx, xy, yy) = (xx - x * x, xy - x * y, yy - y * y);
        let (sin, cos) = (0.5 * f64::atan2(2.0 * xy, xx - yy)).sin_cos();
        Some(([self.origin_m[0] + x, self.origin_m[1] + y], [cos, sin]))
    }
}
