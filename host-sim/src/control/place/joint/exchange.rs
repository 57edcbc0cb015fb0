//! One drone taken out and put where it adds the most, exactly, until no such exchange helps.

use std::time::Instant;

use super::super::PlaceUser;
use super::{Column, Joint, deepest};

/// Each exchange gains at least one user; these are for weights that are no whole numbers.
const MOST_ROUNDS: usize = 20;

/// Improves the best placement of `joint`.
pub(super) fn improve(joint: &mut Joint<'_>) {
    for _ in 0..MOST_ROUNDS {
        let before = joint.value;
        for drone in 0..joint.best.len() {
            if joint.late() {
                return;
            }
            let mut columns = joint.best.clone();
            columns.remove(drone);
            if let Some(column) = best_beside(joint.users, &columns, joint.until) {
                columns.insert(drone, column);
            }
            joint.take(columns);
        }
        if joint.value <= before {
            return;
        }
    }
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
