//! One clock group from captures to positions: start, graduated robust iterations, second starts, verdicts.

use super::check::{self, on_ground};
use super::clock::{Clocks, Grid, Resolution, first_lines};
use super::excess;
use super::model::{ClockFix, FixStatus, LocalizeConfig, MAX_CAPTURES, Robust, UserFix};
use super::normal::{Eliminated, Fit, Normal, PositionPrior};
use super::problem::{Heard, Problem, UserSpan};
use super::r95::r95;
use super::robust::Loss;
use super::small::{Mat, horizontal};
use super::undeclared;
use super::walk;

/// The noise is first taken this many times larger than it is, then less and less (graduated non-convexity,
/// Blake & Zisserman 1987): the start is off by some 100 ns, and a capture that far off must not be thrown out.
const SCALES: [f64; 4] = [32.0, 12.0, 5.0, 2.0];
/// Steps per scale before the last.
const STEPS_PER_SCALE: u32 = 2;
/// Steps at the true noise.
const MOST_STEPS: u32 = 30;
/// Occasions per user that suffice for the first iterations.
const FIRST_OCCASIONS: usize = 12;
/// Converged when the cost that a step leaves is expected to be less than this per user: a hundredth of a standard
/// deviation.
const TOLERANCE_PER_USER: f64 = 5e-5;
/// Share of its promise that a step leaves at least, however much less than the one before it promises.
const LEAST_LEFT: f64 = 0.01;
/// Rounds of new starts for users with a bad fit.
const MOST_RESTARTS: usize = 3;
/// Up to this many users a group may have to be started anew as a whole: their errors do not yet average out in
/// the first lines of the clocks, and clocks and users can settle in a wrong minimum together.
const FEW_USERS: usize = 6;

/// What one group gives.
#[derive(Clone, Debug, Default)]
pub(super) struct GroupAnswer {
    pub(super) users: Vec<UserFix>,
    /// Of each, what its covariance holds beyond the noise of its captures.
    pub(super) beyond_m2: Vec<Mat<2>>,
    pub(super) clocks: Vec<ClockFix>,
    pub(super) iterations: u32,
    pub(super) warnings: Vec<String>,
}

/// All unknowns of a group, and the knots that its clocks live on.
#[derive(Clone, Debug)]
pub(super) struct State<const D: usize> {
    pub(super) grid: Grid,
    pub(super) clocks: Clocks,
    /// East, north and, where it is unknown, up from the altitude assumed.
    pub(super) pos_m: Vec<[f64; D]>,
}

impl<const D: usize> State<D> {
    /// Offsets of the clocks of the captures of one occasion.
    #[inline]
    pub(super) fn clock_ns(&self, heard: &Heard) -> [f64; MAX_CAPTURES] {
        if self.grid.clocks() == 0 {
            return [0.0; MAX_CAPTURES];
        }
        let (interval, fraction) = self.grid.locate(heard.time_s);
        self.clocks.of_captures(heard, interval, fraction)
    }
}

/// A group solved.
pub(super) struct Solved<const D: usize> {
    pub(super) answer: GroupAnswer,
    pub(super) pos_m: Vec<[f64; D]>,
    /// Offset of every clock at the first time, and its change over all of it.
    pub(super) lines: Vec<(f64, f64)>,
    /// Robust cost at the minimum: less a constant, the negative logarithm of the likelihood.
    pub(super) cost: f64,
}

/// Solves one group of users that stand.
pub(super) fn solve_standing(problem: &Problem, cfg: &LocalizeConfig) -> GroupAnswer {
    if problem.heard.is_empty() {
        let users: Vec<UserFix> = problem.users.iter().map(|user| check::not_located(user, cfg)).collect();
        return GroupAnswer { beyond_m2: vec![[[0.0; 2]; 2]; users.len()], users, ..GroupAnswer::default() };
    }
    if cfg.user_altitude_sigma_m > 0.0 {
        solve_and_doubt::<3>(problem, cfg)
    } else {
        solve_and_doubt::<2>(problem, cfg)
    }
}

fn solve_and_doubt<const D: usize>(problem: &Problem, cfg: &LocalizeConfig) -> GroupAnswer {
    let mut solved = solve_blocks::<D>(problem, cfg);
    undeclared::hold_to_account::<D>(problem, cfg, &mut solved);
    solved.answer
}

/// Solves one group with `D` unknowns per user.
pub(super) fn solve_blocks<const D: usize>(problem: &Problem, cfg: &LocalizeConfig) -> Solved<D> {
    let mut solver = Solver::<D>::new(problem, cfg);
    let (state, converged) = solver.solve();
    let cost = solver.cost;
    let mut answer = solver.verdicts(&state);
    answer.iterations = solver.iterations;
    if !converged {
        let group = problem.clock_group;
        answer.warnings.push(format!("clock group {group}: not converged after {} steps", solver.iterations));
    }
    let last = state.grid.knots() - 1;
    let line = |slot| {
        let [first_ns, last_ns] = [0, last].map(|knot| state.clocks.offset_ns(knot, slot));
        (first_ns, last_ns - first_ns)
    };
    let lines = (0..problem.drones.len()).map(line).collect();
    Solved { answer, pos_m: state.pos_m, lines, cost }
}

/// A user lies within the coverage radius of the drones' centroid: as a standard deviation this moves a fix with
/// an r95 of 10 m by at most a decimetre, and it bounds one with hardly any information.
pub(super) fn position_prior(cfg: &LocalizeConfig) -> PositionPrior {
    PositionPrior {
        horizontal_info: cfg.expected_radius_m.powi(-2),
        up_info: cfg.user_altitude_sigma_m.powi(-2),
    }
}

struct Solver<'a, const D: usize> {
    problem: &'a Problem,
    cfg: &'a LocalizeConfig,
    prior: PositionPrior,
    iterations: u32,
    /// How well the users fit where `minimise` last linearised, and the cost where it ended.
    fits: Vec<Fit>,
    cost: f64,
    /// Minima of the whole group that compare with the best: the positions of all users.
    rivals: Vec<Vec<[f64; D]>>,
    /// A user that `minimise` does not move.
    pinned: Option<usize>,
}

impl<'a, const D: usize> Solver<'a, D> {
    fn new(problem: &'a Problem, cfg: &'a LocalizeConfig) -> Self {
        let prior = position_prior(cfg);
        Self {
            problem,
            cfg,
            prior,
            iterations: 0,
            fits: Vec::new(),
            cost: f64::INFINITY,
            rivals: Vec::new(),
            pinned: None,
        }
    }

    /// From the drones' centroids to the minimum. Says whether it converged.
    fn solve(&mut self) -> (State<D>, bool) {
        let (problem, cfg) = (self.problem, self.cfg);
        let mut state = self.start(problem.users.iter().map(|user| on_ground(user.centroid_m)).collect());
        // Nothing is thrown out by least squares: the few occasions may settle it.
        let steps = if cfg.robust == Robust::None { MOST_STEPS } else { STEPS_PER_SCALE };
        for scale in cfg.robust.stages(&SCALES) {
            self.minimise(&mut state, *scale, steps, true);
        }
        if problem.users.len() <= FEW_USERS {
            self.start_anew(&mut state);
        }
        let fine = Grid::new(problem, cfg, Resolution::Fine);
        state.clocks = state.clocks.resample(&state.grid, &fine);
        state.grid = fine;
        let mut converged = self.minimise(&mut state, 1.0, MOST_STEPS, false);
        for _ in 0..MOST_RESTARTS {
            if !check::restart_bad_fits(problem, cfg, &self.fits, &mut state) {
                break;
            }
            self.minimise(&mut state, 2.0, STEPS_PER_SCALE, false);
            converged = self.minimise(&mut state, 1.0, MOST_STEPS, false);
        }
        (state, converged)
    }

    /// Users at `pos_m`, clocks on robust lines.
    fn start(&self, pos_m: Vec<[f64; D]>) -> State<D> {
        let grid = Grid::new(self.problem, self.cfg, Resolution::Coarse);
        let clocks = Clocks::from_lines(&grid, &first_lines(self.problem, self.cfg, &pos_m));
        State { grid, clocks, pos_m }
    }

    /// Moves every user in turn to points around its centroid and solves the whole group from there, on coarse
    /// knots. The best minimum replaces `state`; those that compare with it are kept as rivals.
    fn start_anew(&mut self, state: &mut State<D>) {
        self.minimise(state, 1.0, MOST_STEPS, false);
        let mut best_cost = self.cost;
        let mut found = vec![(best_cost, state.pos_m.clone())];
        for u in 0..self.problem.users.len() {
            for start in check::starts(&self.problem.users[u], self.cfg) {
                let mut pos_m = state.pos_m.clone();
                pos_m[u] = start;
                let mut trial = self.start(pos_m);
                for scale in self.cfg.robust.stages(&SCALES[1..]) {
                    self.minimise(&mut trial, *scale, STEPS_PER_SCALE, false);
                }
                self.minimise(&mut trial, 1.0, MOST_STEPS, false);
                found.push((self.cost, trial.pos_m.clone()));
                if self.cost < best_cost {
                    best_cost = self.cost;
                    *state = trial;
                }
            }
        }
        let comparable = best_cost + check::COMPARABLE_COST;
        self.rivals =
            found.into_iter().filter(|(cost, _)| *cost < comparable).map(|(_, pos_m)| pos_m).collect();
    }

    fn evaluate(&self, state: &State<D>, loss: &Loss, thinned: bool, normal: &mut Normal<D>) {
        let thin = |user: &UserSpan| if thinned { (user.span.len() / FIRST_OCCASIONS).max(1) } else { 1 };
        normal.evaluate(self.problem, state, loss, self.prior, thin);
        if let Some(u) = self.pinned {
            normal.pin(u, &state.grid);
        }
    }

    /// Levenberg-Marquardt on the robust cost. Says whether it converged.
    fn minimise(&mut self, state: &mut State<D>, scale: f64, most_steps: u32, thinned: bool) -> bool {
        let loss = Loss::new(self.cfg.robust, scale);
        let tolerance = TOLERANCE_PER_USER * (self.problem.users.len() as f64 + 1.0);
        let mut normal = Normal::default();
        self.evaluate(state, &loss, thinned, &mut normal);
        let mut matrix = normal.envelope(&state.grid);
        let mut trial_normal = Normal::default();
        let mut damping = 0.0;
        // What the step before promised and kept.
        let mut promised: Option<f64> = None;
        for _ in 0..most_steps {
            self.iterations += 1;
            let Some(eliminated) = normal.eliminate(state, damping, matrix) else {
                matrix = normal.envelope(&state.grid);
                damping = raise(damping);
                continue;
            };
            let step = normal.step(&state.grid, damping, &eliminated);
            matrix = eliminated.into_matrix();
            let mut trial = state.clone();
            trial.clocks.step(&step.clocks);
            for (p, d) in trial.pos_m.iter_mut().zip(&step.users_m) {
                *p = check::stepped(*p, *d, self.cfg);
            }
            // Near the minimum, steps shrink by a steady factor: the next would promise that much less.
            let left = promised.map_or(1.0, |before| (step.predicted / before).clamp(LEAST_LEFT, 1.0));
            if step.predicted * left < tolerance {
                *state = trial;
                (self.fits, self.cost) = (normal.fits, normal.cost - step.predicted);
                return true;
            }
            self.evaluate(&trial, &loss, thinned, &mut trial_normal);
            if trial_normal.cost <= normal.cost {
                *state = trial;
                std::mem::swap(&mut normal, &mut trial_normal);
                damping = lower(damping);
                promised = Some(step.predicted);
            } else {
                damping = raise(damping);
                promised = None;
            }
        }
        (self.fits, self.cost) = (normal.fits, normal.cost);
        false
    }

    /// Whether the cost of the whole group rises at the ends of user `u`'s ellipse as the covariance claims.
    fn profile_is_parabola(&mut self, state: &State<D>, u: usize, cov_m2: &Mat<D>) -> bool {
        let mut lowest = state.clone();
        self.minimise(&mut lowest, 1.0, MOST_STEPS, false);
        let cost = self.cost;
        check::ellipse_ends(state.pos_m[u], cov_m2).into_iter().all(|end| {
            let mut trial = state.clone();
            trial.pos_m[u] = end;
            self.pinned = Some(u);
            self.minimise(&mut trial, 1.0, MOST_STEPS, false);
            self.pinned = None;
            check::rise_is_parabolic(self.cost - cost)
        })
    }

    /// Covariances and statuses at the minimum.
    fn verdicts(&mut self, state: &State<D>) -> GroupAnswer {
        let loss = Loss::accepting(self.cfg.robust);
        let mut normal = Normal::default();
        self.evaluate(state, &loss, false, &mut normal);
        let matrix = normal.envelope(&state.grid);
        let eliminated = normal.eliminate(state, 0.0, matrix);
        let covariances = eliminated.as_ref().map(|e| normal.covariances(&state.grid, e));
        let mut answer = GroupAnswer::default();
        if covariances.is_none() {
            let group = self.problem.clock_group;
            answer.warnings.push(format!("clock group {group}: covariances are not positive definite"));
        }
        for (u, user) in self.problem.users.iter().enumerate() {
            let (fix, beyond_m2) = match (&covariances, &eliminated) {
                (Some(covariances), Some(eliminated)) => {
                    let fix = self.verdict(state, u, &covariances[u], &normal, eliminated);
                    let beyond_m2 = walk::beyond_noise(&fix.cov_m2, &eliminated.inverses[u]);
                    (fix, beyond_m2)
                }
                _ => (check::not_located(user, self.cfg), [[0.0; 2]; 2]),
            };
            answer.users.push(fix);
            answer.beyond_m2.push(beyond_m2);
        }
        let grid = &state.grid;
        for (slot, &drone) in self.problem.drones.iter().enumerate() {
            let knots = (0..grid.knots()).map(|k| (grid.knot_time_s(k), state.clocks.offset_ns(k, slot)));
            answer.clocks.push(ClockFix {
                clock_group: self.problem.clock_group,
                drone,
                reference_time_s: grid.knot_time_s(0),
                offset_ns: state.clocks.offset_ns(0, slot),
                drift_ns_per_s: state.clocks.drift_ns_per_s(grid, slot),
                knots: knots.collect(),
            });
        }
        answer
    }

    fn verdict(
        &mut self,
        state: &State<D>,
        u: usize,
        cov_m2: &Mat<D>,
        normal: &Normal<D>,
        eliminated: &Eliminated<D>,
    ) -> UserFix {
        let user = &self.problem.users[u];
        let fit = normal.fits[u];
        let p = state.pos_m[u];
        let known_clocks = &eliminated.inverses[u];
        let cov_m2 = &excess::widened(self.problem, self.cfg, state, u, cov_m2, known_clocks);
        let r95_m = r95(horizontal(cov_m2));
        let rival = self.rivals.iter().any(|rival| check::apart_m(rival[u], p) > check::distinct_m(r95_m));
        let mut status = check::status(self.problem, self.cfg, state, u, &fit, r95_m, known_clocks);
        if rival && status == FixStatus::Ok {
            status = FixStatus::Ambiguous;
        }
        let few = self.problem.users.len() <= FEW_USERS;
        let trusted = |solver: &mut Self| !few || solver.profile_is_parabola(state, u, cov_m2);
        let pulled = check::is_pulled(user, self.cfg, p, &horizontal(cov_m2), r95_m);
        if status == FixStatus::Ok && (pulled || !trusted(self)) {
            status = FixStatus::PoorGeometry;
        }
        if status == FixStatus::NotLocated {
            let rejected = fit.captures - fit.accepted;
            return UserFix { rejected, ..check::not_located(user, self.cfg) };
        }
        UserFix {
            user: user.user,
            pos_m: [p[0], p[1]],
            cov_m2: horizontal(cov_m2),
            r95_m,
            altitude_m: self.cfg.user_altitude_m + p.get(2).copied().unwrap_or(0.0),
            altitude_sigma_m: cov_m2.get(2).map_or(0.0, |row| row[2].sqrt()),
            status,
            occasions: user.span.len() as u32,
            rejected: fit.captures - fit.accepted,
            last_heard_s: user.last_heard_s,
        }
    }
}

fn raise(damping: f64) -> f64 {
    (damping * 10.0).max(1e-2)
}

fn lower(damping: f64) -> f64 {
    if damping < 1e-3 { 0.0 } else { damping * 0.1 }
}
