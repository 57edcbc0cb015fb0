//! Which drones' clocks can be compared, and by how much they differ, roughly.
//!
//! Clocks that count from different starts differ by seconds or years, which neither a prior nor a float's digits
//! survive. One occasion heard together tells the difference to the time that light takes between the drones.

use super::HeardDrone;
use super::rows::Row;

/// Numbers the drones anew: those tied to the reference first, by their order in `names`, then the others. The
/// reference is the first drone of the tied ones that have most captures together. `rows` are sorted by occasion and
/// get the new numbers.
pub(super) fn tie(rows: &mut [Row], names: Vec<String>) -> Vec<HeardDrone> {
    let groups = groups(rows, names.len());
    let mut captures = vec![0usize; names.len()];
    for row in &*rows {
        captures[groups[row.drone as usize].0] += 1;
    }
    // The first of the largest ones: `max_by_key` would take the last.
    let main = (0..captures.len()).rev().max_by_key(|&group| captures[group]).unwrap_or_default();
    let mut drones: Vec<(u32, HeardDrone)> = (0..)
        .zip(names.into_iter().zip(&groups))
        .map(|(number, (id, &(group, coarse)))| (number, HeardDrone { id, tied: group == main, coarse }))
        .collect();
    drones.sort_by_key(|(_, drone)| !drone.tied);
    let mut place = vec![0; drones.len()];
    for (new, (old, _)) in (0..).zip(&drones) {
        place[*old as usize] = new;
    }
    rows.iter_mut().for_each(|row| row.drone = place[row.drone as usize]);
    drones.into_iter().map(|(_, drone)| drone).collect()
}

/// For each drone the first one it is tied to, and by how much its clock is ahead of that one's.
fn groups(rows: &[Row], drones: usize) -> Vec<(usize, i128)> {
    // How much the column's drone is ahead of the row's, by the first occasion that tells. Neighbours suffice: they
    // tie all drones of an occasion together.
    let mut ahead: Vec<Option<i128>> = vec![None; drones * drones];
    for pair in rows.windows(2).filter(|pair| pair[0].same_occasion(&pair[1])) {
        let [a, b] = [pair[0], pair[1]].map(|row| row.drone as usize);
        let difference = pair[1].toa - pair[0].toa;
        ahead[a * drones + b].get_or_insert(difference);
        ahead[b * drones + a].get_or_insert(-difference);
    }
    let mut found: Vec<Option<(usize, i128)>> = vec![None; drones];
    for root in 0..drones {
        if found[root].is_some() {
            continue;
        }
        found[root] = Some((root, 0));
        let mut reached = vec![(root, 0)];
        while let Some((from, offset)) = reached.pop() {
            for to in 0..drones {
                if let (None, Some(difference)) = (found[to], ahead[from * drones + to]) {
                    found[to] = Some((root, offset + difference));
                    reached.push((to, offset + difference));
                }
            }
        }
    }
    found.into_iter().flatten().collect()
}
