//! The restricted master: the linear relaxation over the disks known so far, solved by Clarabel.
//!
//! ```text
//! maximise sum W_k y_k    y_k <= sum of x_j over disks j that cover k    sum x_j <= m    y_k <= 1    x_j >= 0
//! ```
//!
//! Users whom the same disks cover are one class k of weight W_k. The dual of the first row is the price of the class, which
//! its users share by weight; the dual of the second that of a disk.

use std::collections::{BTreeMap, BTreeSet};

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT::NonnegativeConeT,
};

use super::super::PlaceUser;
use super::Column;
use super::prices::worth;

/// The disks known.
pub(super) struct Master<'a> {
    users: &'a [PlaceUser],
    drones: usize,
    columns: Vec<Column>,
    known: BTreeSet<Vec<u32>>,
}

/// An optimum of the relaxation.
pub(super) struct Solved {
    /// Price of every user; that of one whom no known disk covers is all of its weight.
    pub(super) of_users: Vec<f64>,
    /// Value of the relaxation over the disks known.
    pub(super) value: f64,
    /// Price of a drone.
    drone: f64,
    /// The disks that have most of a drone, one for each drone: the optimum where the relaxation has whole drones.
    pub(super) rounded: Vec<Column>,
}

impl<'a> Master<'a> {
    pub(super) fn new(users: &'a [PlaceUser], drones: usize) -> Self {
        Self { users, drones, columns: Vec::new(), known: BTreeSet::new() }
    }

    /// Adds a disk unless it is known.
    pub(super) fn know(&mut self, column: &Column) {
        if self.known.insert(column.users.clone()) {
            self.columns.push(column.clone());
        }
    }

    /// All disks that it knows.
    pub(super) fn into_columns(self) -> Vec<Column> {
        self.columns
    }

    /// Whether the prices of `solved` have nothing to learn from a disk.
    pub(super) fn knows_as_dear(&self, column: &Column, solved: &Solved) -> bool {
        let price: f64 = column.users.iter().map(|&user| solved.of_users[user as usize]).sum();
        self.known.contains(&column.users) || price <= solved.drone * (1.0 + 1e-7) + 1e-9
    }

    /// Solves it; none where numbers do not allow.
    pub(super) fn solve(&self) -> Option<Solved> {
        let mut covered_by: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (j, column) in (0..).zip(&self.columns) {
            for &user in &column.users {
                covered_by.entry(user).or_default().push(j);
            }
        }
        let mut classes: BTreeMap<Vec<u32>, (f64, Vec<u32>)> = BTreeMap::new();
        for (user, columns) in covered_by {
            let class = classes.entry(columns).or_default();
            class.0 += worth(&self.users[user as usize]);
            class.1.push(user);
        }
        let (k, n) = (classes.len(), self.columns.len());
        // Columns of the matrix: first the y, then the x. Rows: cover, drones, y <= 1, x >= 0.
        let (mut start, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
        for class in 0..k {
            row.extend([class, k + 1 + class]);
            value.extend([1.0, 1.0]);
            start.push(row.len());
        }
        let mut covers = vec![Vec::new(); n];
        for (class, columns) in classes.keys().enumerate() {
            columns.iter().for_each(|&j| covers[j as usize].push(class));
        }
        for (j, classes) in covers.iter().enumerate() {
            row.extend(classes);
            value.resize(row.len(), -1.0);
            row.extend([k, 2 * k + 1 + j]);
            value.extend([1.0, -1.0]);
            start.push(row.len());
        }
        let rows = 2 * k + 1 + n;
        let matrix = CscMatrix::new(rows, k + n, start, row, value);
        let mut right = vec![0.0; rows];
        right[k] = self.drones as f64;
        right[k + 1..=2 * k].fill(1.0);
        let mut cost: Vec<f64> = classes.values().map(|(weight, _)| -weight).collect();
        cost.resize(k + n, 0.0);
        let none = CscMatrix::zeros((k + n, k + n));
        let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
        let mut solver =
            DefaultSolver::new(&none, &cost, &matrix, &right, &[NonnegativeConeT(rows)], settings).ok()?;
        solver.solve();
        let solution = &solver.solution;
        if !matches!(solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved) {
            return None;
        }
        let mut of_users: Vec<f64> = self.users.iter().map(worth).collect();
        for ((weight, users), price) in classes.values().zip(&solution.z) {
            let share = (price / weight).clamp(0.0, 1.0);
            users.iter().for_each(|&user| of_users[user as usize] *= share);
        }
        let share = |&j: &usize| solution.x[k + j];
        let mut by_share: Vec<usize> = (0..n).collect();
        by_share.sort_by(|a, b| share(b).total_cmp(&share(a)));
        let rounded = by_share.iter().take(self.drones).map(|&j| self.columns[j].clone()).collect();
        Some(Solved { of_users, value: -solution.obj_val, drone: solution.z[k], rounded })
    }
}
