//! Estimates while the sweep goes on: a little work for each capture that arrives.
//!
//! The whole problem is solved now and then ([`Running::calibrate`] takes its clocks); between two solutions every
//! user is fitted alone, with the clocks carried on. A filter that folds each occasion into a mean and a covariance
//! diverges at low altitude, where the first occasions leave the position open and the geometry curves. So each
//! user keeps some occasions, spread over all that it was heard in, and the fit is made anew from those when they have
//! grown: it can still change its mind, and its cost is bounded. A fit that
//! explains them badly is tried from further starts.

use std::collections::BTreeMap;

use skyroost_protocol::units::{DroneId, UserId};

use super::check::{on_ground, starts, stepped};
use super::model::{ClockFix, ClockModel, LocalizeConfig, MAX_CAPTURES, Occasion, Robust};
use super::motion::Motion;
use super::normal::{PositionPrior, UserBlock};
use super::problem::{Dropped, Heard, Reader, UserSpan};
use super::r95::r95;
use super::robust::{Loss, linearise};
use super::small::{Mat, dot, horizontal, inverse, mul};
use super::solve::position_prior;
use super::walk::VISIT_GAP_S;

/// Most occasions kept of a user; beyond, each new one takes the place of one of those before, every other in turn.
const KEPT: usize = 64;
/// A user is fitted again when its occasions have grown by this factor: fewer say nothing new.
const GROWTH: f64 = 1.25;
/// Robust cost of an occasion beyond which a fit is doubted; a true one costs 1, and some more for late captures.
const DOUBTFUL_COST: f64 = 2.5;
/// Steps of a fit at each scale of the noise.
const STEPS: usize = 2;
/// What a solved clock is worth where it was solved, nanoseconds.
const SOLVED_SIGMA_NS: f64 = 0.5;
/// Altitudes taken as known are so to this, metres.
const KNOWN_ALTITUDE_M: f64 = 1e-3;

/// What is known of a user so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunningFix {
    /// East and north, metres.
    pub pos_m: [f64; 2],
    /// 95 % radius, the clocks' uncertainty included, metres.
    pub r95_m: f64,
    /// 95 % radius that all occasions together allow where the clocks are known, metres: what further occasions
    /// can improve.
    pub known_clocks_r95_m: f64,
    /// Occasions with two or more captures.
    pub occasions: u32,
    /// When the last of them was, seconds of mission time.
    pub last_heard_s: f64,
}

impl RunningFix {
    /// The same at a later time.
    fn grown(self, motion: &Motion, time_s: f64) -> Self {
        let grown_m = |r95_m| motion.grown_r95_m(r95_m, time_s - self.last_heard_s);
        Self { r95_m: grown_m(self.r95_m), known_clocks_r95_m: grown_m(self.known_clocks_r95_m), ..self }
    }
}

/// Estimates of all users, by captures so far.
#[derive(Clone, Debug)]
pub struct Running {
    cfg: LocalizeConfig,
    groups: BTreeMap<u16, Group>,
    users: BTreeMap<(UserId, u16), Tracked>,
}

/// The drones of a clock group.
#[derive(Clone, Debug)]
struct Group {
    /// Sorted.
    drones: Vec<DroneId>,
    /// As last solved, in the order of the drones; empty before.
    clocks: Vec<ClockFix>,
}

#[derive(Clone, Debug)]
struct Tracked {
    kept: Vec<Heard>,
    /// The next to go.
    victim: usize,
    heard: u32,
    /// Occasions at the last fit.
    fitted: u32,
    /// Occasions at which further starts are tried.
    start_anew_at: u32,
    /// Mean position of the drones that heard it.
    centroid_m: [f64; 2],
    pos_m: [f64; 3],
    fix: RunningFix,
}

impl Running {
    /// Nothing heard yet; `groups` are the clock groups (fleets) and their drones.
    #[must_use]
    pub fn new(cfg: LocalizeConfig, groups: impl IntoIterator<Item = (u16, Vec<DroneId>)>) -> Self {
        let mut running = Self { cfg, groups: BTreeMap::new(), users: BTreeMap::new() };
        groups.into_iter().for_each(|(id, drones)| running.group(id, drones));
        running
    }

    /// From now on there are also occasions of this clock group; one that is known stays as it is.
    pub fn group(&mut self, id: u16, mut drones: Vec<DroneId>) {
        drones.sort_unstable();
        self.groups.entry(id).or_insert(Group { drones, clocks: Vec::new() });
    }

    /// Takes the clocks of a solution of everything.
    pub fn calibrate(&mut self, clocks: &[ClockFix]) {
        for (id, group) in &mut self.groups {
            let of = |drone: &DroneId| clocks.iter().find(|c| c.clock_group == *id && c.drone == *drone);
            let found: Option<Vec<ClockFix>> = group.drones.iter().map(|d| of(d).cloned()).collect();
            group.clocks = found.unwrap_or_default();
        }
    }

    /// Takes in one occasion. Its work does not grow with what was heard before. Occasions of groups unknown and
    /// captures that cannot be read say nothing here; the solution of everything counts them.
    pub fn add(&mut self, occasion: &Occasion) {
        let Some(group) = self.groups.get(&occasion.clock_group) else { return };
        let heard = Reader::new(&group.drones, &self.cfg).hear(occasion, |_| true, &mut Dropped::default());
        if heard.count < 2 || !heard.time_s.is_finite() {
            return;
        }
        let key = (occasion.user, occasion.clock_group);
        let tracked = self.users.entry(key).or_insert_with(|| Tracked::new(&heard));
        if !self.cfg.motion.is_still() && heard.time_s - tracked.fix.last_heard_s > VISIT_GAP_S {
            *tracked = Tracked::new(&heard); // it has gone elsewhere meanwhile
        }
        tracked.take(heard);
        if f64::from(tracked.heard) >= GROWTH * f64::from(tracked.fitted) {
            tracked.fit(&self.cfg, group);
        }
    }

    /// What is known of a user: of several groups' estimates the best.
    #[must_use]
    pub fn fix(&self, user: UserId) -> Option<RunningFix> {
        let fixes = self.users.range((user, 0)..=(user, u16::MAX)).map(|(_, tracked)| tracked.fix);
        fixes.min_by(|a, b| a.r95_m.total_cmp(&b.r95_m))
    }

    /// What is known of a user at a time, seconds of the mission: whoever walks has gone on since it was heard.
    #[must_use]
    pub fn fix_at(&self, user: UserId, time_s: f64) -> Option<RunningFix> {
        let fixes = self.users.range((user, 0)..=(user, u16::MAX));
        let grown = fixes.map(|(_, tracked)| tracked.fix.grown(&self.cfg.motion, time_s));
        grown.min_by(|a, b| a.r95_m.total_cmp(&b.r95_m))
    }

    /// Users heard so far.
    #[must_use]
    pub fn len(&self) -> usize {
        self.users.len()
    }

    /// Whether nobody was heard.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.users.is_empty()
    }
}

impl Tracked {
    fn new(first: &Heard) -> Self {
        let centroid_m = centre_m(first);
        let nothing = RunningFix {
            pos_m: centroid_m,
            r95_m: f64::INFINITY,
            known_clocks_r95_m: f64::INFINITY,
            occasions: 0,
            last_heard_s: first.time_s,
        };
        Self {
            kept: Vec::with_capacity(KEPT),
            victim: 1,
            heard: 0,
            fitted: 0,
            start_anew_at: 4,
            centroid_m,
            pos_m: on_ground(centroid_m),
            fix: nothing,
        }
    }

    /// Keeps an occasion.
    fn take(&mut self, heard: Heard) {
        self.heard += 1;
        self.fix.occasions = self.heard;
        self.fix.last_heard_s = self.fix.last_heard_s.max(heard.time_s);
        for (mean, x) in self.centroid_m.iter_mut().zip(centre_m(&heard)) {
            *mean += (x - *mean) / f64::from(self.heard);
        }
        if self.kept.len() == KEPT {
            self.kept.remove(self.victim);
            // The one after has moved up into this place; the next victim is the one behind it.
            self.victim = if self.victim + 2 < KEPT { self.victim + 1 } else { 1 };
        }
        self.kept.push(heard);
    }

    /// Fits the position to the occasions kept.
    fn fit(&mut self, cfg: &LocalizeConfig, group: &Group) {
        self.fitted = self.heard;
        let mut prior = position_prior(cfg);
        prior.up_info = cfg.user_altitude_sigma_m.max(KNOWN_ALTITUDE_M).powi(-2);
        let user = UserSpan::at(self.centroid_m);
        let clocks: Vec<[f64; MAX_CAPTURES]> = self.kept.iter().map(|h| group.offsets_ns(h)).collect();
        let variance_ns2 = self.kept.iter().map(|h| group.variance_ns2(cfg, h.time_s)).fold(0.0, f64::max);
        // Clocks that are off make captures look as bad as late ones: the cut-off has to leave them room.
        let most_info = self.kept.iter().flat_map(|h| h.info).fold(0.0, f64::max);
        let noise = (1.0 + variance_ns2 * most_info).sqrt();
        let loss = Loss::new(cfg.robust, noise);
        let block = |p: [f64; 3], loss: &Loss| {
            let mut block = UserBlock::new(&user, p, prior);
            for (heard, clock_ns) in self.kept.iter().zip(&clocks) {
                block.add(heard, &linearise(heard, p, *clock_ns, loss));
            }
            block
        };
        let descend = |mut p: [f64; 3], losses: &[Loss]| {
            for loss in losses {
                for _ in 0..STEPS {
                    let block = block(p, loss);
                    p = stepped(p, mul(&inverse(block.info), block.gradient), cfg);
                }
            }
            (block(p, &losses[losses.len() - 1]).fit.cost, p)
        };
        let mut best = descend(self.pos_m, &[loss]);
        let doubtful = best.0 > DOUBTFUL_COST * (2.0 + self.kept.len() as f64);
        if doubtful && self.heard >= self.start_anew_at {
            self.start_anew_at = 2 * self.heard;
            let graduated = [8.0, 1.0].map(|scale| Loss::new(cfg.robust, scale * noise));
            let found = starts(&user, cfg).into_iter().map(|start| descend(start, &graduated));
            best = found.fold(best, |best, other| if other.0 < best.0 { other } else { best });
        }
        self.pos_m = best.1;
        self.fix.pos_m = [self.pos_m[0], self.pos_m[1]];
        let (known_clocks, of_clocks) = self.covariance(&user, prior, &clocks);
        let (known_clocks, of_clocks) = (horizontal(&known_clocks), horizontal(&of_clocks));
        let sum = |i: usize, j: usize| known_clocks[i][j] + variance_ns2 * of_clocks[i][j];
        // The solution of everything has all occasions, not only those kept.
        let all = (self.kept.len() as f64 / f64::from(self.heard)).sqrt();
        self.fix.known_clocks_r95_m = all * r95(known_clocks);
        self.fix.r95_m = r95([[sum(0, 0), sum(0, 1)], [sum(1, 0), sum(1, 1)]]);
    }

    /// Covariance from the occasions kept if the clocks were known, and what a variance of 1 ns2 of each clock adds.
    fn covariance(
        &self,
        user: &UserSpan,
        prior: PositionPrior,
        clocks: &[[f64; MAX_CAPTURES]],
    ) -> (Mat<3>, Mat<3>) {
        let loss = Loss::new(Robust::None, 1.0);
        let mut block = UserBlock::new(user, self.pos_m, prior);
        let mut by_clock: Vec<[f64; 3]> = Vec::new();
        for (heard, clock_ns) in self.kept.iter().zip(clocks) {
            let row = linearise(heard, self.pos_m, *clock_ns, &loss);
            let slope = block.add(heard, &row);
            let captures = heard.slot.iter().zip(row.weight).zip(slope);
            for ((&slot, weight), slope) in captures.take(usize::from(heard.count)) {
                let slot = usize::from(slot);
                by_clock.resize(by_clock.len().max(slot + 1), [0.0; 3]);
                by_clock[slot].iter_mut().zip(slope).for_each(|(sum, u)| *sum += weight * u);
            }
        }
        let cov = inverse(block.info);
        let mut of_clocks = [[0.0; 3]; 3];
        for gain in by_clock.into_iter().map(|sum| mul(&cov, sum)) {
            for (row, g) in of_clocks.iter_mut().zip(gain) {
                row.iter_mut().zip(gain).for_each(|(x, h)| *x += g * h);
            }
        }
        (cov, of_clocks)
    }
}

impl Group {
    /// Offsets of the clocks of an occasion, carried on from the last solution.
    fn offsets_ns(&self, heard: &Heard) -> [f64; MAX_CAPTURES] {
        let offset_ns = |slot: u8| self.clocks.get(usize::from(slot)).map_or(0.0, |c| c.at_ns(heard.time_s));
        heard.slot.map(offset_ns)
    }

    /// Variance of each clock then.
    fn variance_ns2(&self, cfg: &LocalizeConfig, time_s: f64) -> f64 {
        let (offset, drift, walk) = match cfg.clock {
            ClockModel::Synchronised => return 0.0,
            ClockModel::SharedConstant => (1e5, 0.0, 0.0),
            ClockModel::SharedWander { offset_sigma_ns, drift_sigma_ns_per_s, walk_ns_per_sqrt_s } => {
                (offset_sigma_ns, drift_sigma_ns_per_s, walk_ns_per_sqrt_s)
            }
        };
        match self.clocks.first().and_then(|clock| clock.knots.last()) {
            Some((solved_s, _)) => SOLVED_SIGMA_NS.powi(2) + walk * walk * (time_s - solved_s).max(0.0),
            None => dot([offset, drift * time_s], [offset, drift * time_s]) + walk * walk * time_s.abs(),
        }
    }
}

/// Mean position of the drones of an occasion.
fn centre_m(heard: &Heard) -> [f64; 2] {
    let n = usize::from(heard.count);
    let mean = |values: &[f64; MAX_CAPTURES]| values[..n].iter().sum::<f64>() / n as f64;
    [mean(&heard.east_m), mean(&heard.north_m)]
}
