//! Prices of users: the dual of the linear relaxation, by column generation.
//!
//! The restricted master (`master`) prices users so that no known disk is dearer than any other that it uses; the
//! one-disk search then finds the dearest of all disks at these prices, which bounds every placement, (1) in
//! [`super`]. Disks dearer than the master knows join it. Prices between the best known and the master's
//! keep them from swinging (Wentges 1997, "Weighted Dantzig-Wolfe decomposition for linear mixed-integer programming").

use std::time::Instant;

use super::super::PlaceUser;
use super::super::disk::Counting;
use super::master::Master;
use super::{Column, Joint, ROUNDING};

/// Most rounds of column generation; typical are 10 to 40.
const MOST_ROUNDS: usize = 300;
/// Weight of the best prices known in the prices that are tried.
const SMOOTHING: f64 = 0.4;
/// No price is less than this share of a user's weight, so that a search sees everyone.
const LEAST_SHARE: f64 = 1e-7;
/// Within this share of the dearest a further disk of a round is worth knowing.
const WORTH_KNOWING: f64 = 0.2;

/// A further disk of a round may be cheaper than the dearest left by this share of the dearest.
const NEARLY_DEAREST: f64 = 0.1;

/// The best prices found.
pub(super) struct Prices {
    of_users: Vec<f64>,
    bound: f64,
    dearest: f64,
}

impl Prices {
    /// Everyone at full weight.
    pub(super) fn new(joint: &Joint<'_>) -> Self {
        let of_users = joint.users.iter().map(worth).collect();
        Self { of_users, bound: f64::INFINITY, dearest: f64::INFINITY }
    }

    /// Prices as they are given, within what prices may be, the bound (1) that follows, and disks that are dear at them.
    /// None where nobody can be covered.
    pub(super) fn at(
        users: &[PlaceUser],
        drones: usize,
        given: &[f64],
        until: Option<Instant>,
    ) -> Option<(Self, Vec<Column>)> {
        let of_users: Vec<f64> = (users.iter().zip(given))
            .map(|(user, price)| price.clamp(LEAST_SHARE * worth(user), worth(user)))
            .collect();
        let (dearest, columns) = dear(&priced(users, &of_users), drones, until)?;
        let unpriced: f64 = users.iter().zip(&of_users).map(|(user, price)| worth(user) - price).sum();
        let bound = unpriced + drones as f64 * dearest;
        Some((Self { of_users, bound, dearest }, columns))
    }

    pub(super) fn of_users(&self) -> &[f64] {
        &self.of_users
    }

    /// No placement is better.
    pub(super) fn bound(&self) -> f64 {
        self.bound
    }

    /// Price of the dearest disk.
    pub(super) fn dearest(&self) -> f64 {
        self.dearest
    }

    /// The users weighing their prices.
    pub(super) fn priced(&self, users: &[PlaceUser]) -> Vec<PlaceUser> {
        priced(users, &self.of_users)
    }

    /// Generates columns until the bound is proved to be that of the relaxation, or shows `joint`'s placement to be the best.
    /// Returns the disks met on the way.
    pub(super) fn settle(&mut self, joint: &mut Joint<'_>) -> Vec<Column> {
        let mut master = Master::new(joint.users, joint.drones);
        joint.best.iter().for_each(|column| master.know(column));
        self.generate(joint, &mut master);
        master.into_columns()
    }

    fn generate(&mut self, joint: &mut Joint<'_>, master: &mut Master<'_>) {
        let mut smoothing = 0.0;
        for _ in 0..MOST_ROUNDS {
            if joint.late() {
                return;
            }
            let Some(solved) = master.solve() else { return };
            let mixed: Vec<f64> = (solved.of_users.iter().zip(&self.of_users))
                .map(|(new, best)| smoothing * best + (1.0 - smoothing) * new)
                .collect();
            let Some((tried, columns)) = Self::at(joint.users, joint.drones, &mixed, joint.until) else {
                return;
            };
            let improved = tried.bound < self.bound - ROUNDING;
            if tried.bound < self.bound {
                *self = tried;
                joint.lower(self.bound);
            }
            joint.take(columns.clone());
            joint.take(solved.rounded.clone());
            if joint.is_proved() || self.bound <= solved.value + ROUNDING * joint.drones as f64 {
                return;
            }
            let known = columns.iter().filter(|column| !master.knows_as_dear(column, &solved)).count();
            columns.iter().for_each(|column| master.know(column));
            if known == 0 && smoothing == 0.0 {
                return; // the relaxation is solved, to rounding
            }
            smoothing = if known == 0 || !improved { 0.0 } else { SMOOTHING };
        }
    }
}

/// What covering a user is worth; nothing where no drone can.
pub(super) fn worth(user: &PlaceUser) -> f64 {
    if user.radius_m >= 0.0 { user.weight } else { 0.0 }
}

fn priced(users: &[PlaceUser], prices: &[f64]) -> Vec<PlaceUser> {
    users.iter().zip(prices).map(|(user, &weight)| PlaceUser { weight, ..*user }).collect()
}

/// The dearest disk's price, and disks that are dear: it, the dearest of the users that it leaves, and so on.
fn dear(priced: &[PlaceUser], drones: usize, until: Option<Instant>) -> Option<(f64, Vec<Column>)> {
    let mut counting = Counting::new(priced)?.until(until);
    let mut dearest = 0.0;
    let mut columns = Vec::new();
    for nth in 0..drones {
        if nth > 0 && until.is_some_and(|until| Instant::now() >= until) {
            break;
        }
        // Only the first one bounds; the others need not be the dearest of all.
        let gap = if nth == 0 { 0.0 } else { NEARLY_DEAREST * dearest };
        let Some(found) = counting.deepest(gap) else { break };
        if nth == 0 {
            dearest = found.ceiling;
        } else if found.weight < WORTH_KNOWING * dearest {
            break;
        }
        counting.strike(&found.column.users);
        columns.push(counting.all_at(found.column.at, &found.column.users));
    }
    (!columns.is_empty()).then_some((dearest, columns))
}
