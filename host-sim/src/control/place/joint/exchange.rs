//! One drone taken out and put where it adds the most, exactly, until no such exchange helps.

use std::time::Instant;

use rayon::prelude::*;

use super::super::PlaceUser;
use super::{Column, Joint, deepest};

/// Each exchange gains at least one user; these are for weights that are no whole numbers.
const MOST_ROUNDS: usize = 40;

/// Improves the best placement of `joint` by the exchange that gains most, again and again.
pub(super) fn improve(joint: &mut Joint<'_>) {
    for _ in 0..MOST_ROUNDS {
        let before = joint.value;
        let exchanged: Vec<Vec<Column>> =
            (0..joint.best.len()).into_par_iter().map(|drone| exchanged(joint, drone)).collect();
        // Only a better one is taken: of equals, the first.
        exchanged.into_iter().for_each(|columns| joint.take(columns));
        if joint.value <= before || joint.late() {
            return;
        }
    }
}

/// The best placement with one drone where it adds the most to the others.
fn exchanged(joint: &Joint<'_>, drone: usize) -> Vec<Column> {
    let mut columns = joint.best.clone();
    columns.remove(drone);
    if let Some(column) = best_beside(joint.users, &columns, joint.until) {
        columns.insert(drone, column);
    }
    columns
}

/// The disk that adds the most to `columns`.
fn best_beside(users: &[PlaceUser], columns: &[Column], until: Option<Instant>) -> Option<Column> {
    let mut left = users.to_vec();
    for &user in columns.iter().flat_map(|column| &column.users) {
        left[user as usize].weight = 0.0;
    }
    deepest(&left, until).map(|found| Column { users: all_within(users, &found.column), at: found.column.at })
}

/// The users of a disk that was found without those who are served already, and those.
fn all_within(users: &[PlaceUser], column: &Column) -> Vec<u32> {
    let covers =
        |u: &PlaceUser| u.radius_m >= 0.0 && u.weight > 0.0 && (u.pos_m - column.at).norm() <= u.radius_m;
    let others = users.iter().enumerate().filter(|(_, u)| covers(u)).map(|(user, _)| user as u32);
    let mut all: Vec<u32> = others.chain(column.users.iter().copied()).collect();
    all.sort_unstable();
    all.dedup();
    all
}
