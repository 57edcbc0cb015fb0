//! Cholesky factorisation of a symmetric positive definite matrix in skyline (envelope) storage.
//!
//! Row `i` of the lower triangle keeps the columns from its first nonzero to the diagonal. The factor fills the
//! same envelope and nothing outside it (George & Liu 1981, chapter 4), and so does every entry of the inverse
//! that the recurrence of Takahashi (1973) needs, which is why the marginal covariances cost no more than
//! two factorisations.

/// Lower triangle of a symmetric matrix, or its Cholesky factor, row by row.
#[derive(Clone, Debug)]
pub(super) struct Skyline {
    /// First stored column of every row.
    first: Vec<usize>,
    /// Where column 0 of a row would be in `values`, so that entry (i, j) is at `origin[i] + j`.
    origin: Vec<isize>,
    values: Vec<f64>,
}

impl Skyline {
    /// A zero matrix with this envelope; `first[i] <= i`.
    pub(super) fn new(first: Vec<usize>) -> Self {
        let mut origin = Vec::with_capacity(first.len());
        let mut length = 0usize;
        for (i, &f) in first.iter().enumerate() {
            assert!(f <= i, "row {i} starts right of its diagonal");
            origin.push(length as isize - f as isize);
            length += i + 1 - f;
        }
        Self { first, origin, values: vec![0.0; length] }
    }

    /// Rows.
    pub(super) fn len(&self) -> usize {
        self.first.len()
    }

    /// Forgets all values, keeps the envelope.
    pub(super) fn clear(&mut self) {
        self.values.fill(0.0);
    }

    #[inline]
    fn index(&self, i: usize, j: usize) -> usize {
        debug_assert!(self.first[i] <= j && j <= i);
        (self.origin[i] + j as isize) as usize
    }

    /// Columns `from..to` of row `i`.
    #[inline]
    pub(super) fn row(&self, i: usize, from: usize, to: usize) -> &[f64] {
        let start = self.index(i, from);
        &self.values[start..start + (to - from)]
    }

    /// Columns `from..to` of row `i`, to change.
    #[inline]
    pub(super) fn row_mut(&mut self, i: usize, from: usize, to: usize) -> &mut [f64] {
        let start = self.index(i, from);
        &mut self.values[start..start + (to - from)]
    }

    /// Entry (i, j) = (j, i), which must lie in the envelope.
    #[inline]
    pub(super) fn get(&self, i: usize, j: usize) -> f64 {
        let (i, j) = if i >= j { (i, j) } else { (j, i) };
        self.values[self.index(i, j)]
    }

    /// Adds to entry (i, j) = (j, i), which must lie in the envelope.
    #[inline]
    pub(super) fn add(&mut self, i: usize, j: usize, value: f64) {
        let (i, j) = if i >= j { (i, j) } else { (j, i) };
        let at = self.index(i, j);
        self.values[at] += value;
    }

    /// Replaces the matrix by its Cholesky factor `L` (`A = L L'`). Says false, with the contents spoilt, where
    /// the matrix is not positive definite to working precision.
    #[must_use]
    pub(super) fn factor(&mut self) -> bool {
        for i in 0..self.len() {
            let first_i = self.first[i];
            let start_i = self.index(i, first_i);
            let (above, here) = self.values.split_at_mut(start_i);
            for j in first_i..i {
                let from = first_i.max(self.first[j]);
                let row_j = (self.origin[j] + from as isize) as usize;
                let (left, at) = (&here[from - first_i..j - first_i], j - first_i);
                let diagonal = above[row_j + j - from];
                here[at] = (here[at] - dot(left, &above[row_j..row_j + left.len()])) / diagonal;
            }
            let (left, rest) = here.split_at_mut(i - first_i);
            let square = rest[0];
            let pivot = square - dot(left, left);
            // A pivot below the rounding error of its own row carries no digit.
            if !(pivot > square.abs() * 1e-14 && pivot.is_finite()) {
                return false;
            }
            rest[0] = pivot.sqrt();
        }
        true
    }

    /// Solves `L L' x = b` in place.
    pub(super) fn solve(&self, b: &mut [f64]) {
        assert_eq!(b.len(), self.len());
        for i in 0..b.len() {
            let row = self.row(i, self.first[i], i + 1);
            let (left, diagonal) = row.split_at(row.len() - 1);
            b[i] = (b[i] - dot(left, &b[self.first[i]..i])) / diagonal[0];
        }
        for i in (0..b.len()).rev() {
            let row = self.row(i, self.first[i], i + 1);
            let (left, diagonal) = row.split_at(row.len() - 1);
            let x = b[i] / diagonal[0];
            b[i] = x;
            for (below, l) in b[self.first[i]..i].iter_mut().zip(left) {
                *below -= l * x;
            }
        }
    }

    /// From the factor `L`, the entries of `Z = (L L')^-1` inside the envelope.
    ///
    /// From `Z L = L'^-1`: `Z_ij = (delta_ij / L_jj - sum_{k>j} Z_ik L_kj) / L_jj`, column by column from the
    /// last. Where rows i and k both reach column j, `Z_ik` is inside the envelope.
    pub(super) fn inverse_in_envelope(&self) -> Self {
        let n = self.len();
        let mut z = Self { values: vec![0.0; self.values.len()], ..self.clone() };
        // `reach[j]`: last row that reaches column j.
        let mut reach: Vec<usize> = (0..n).collect();
        for i in 0..n {
            reach[self.first[i]] = reach[self.first[i]].max(i);
        }
        for j in 1..n {
            reach[j] = reach[j].max(reach[j - 1]);
        }
        let mut column = vec![0.0; n];
        let mut sum = vec![0.0; n];
        let mut rows = Vec::with_capacity(n);
        for j in (0..n).rev() {
            rows.clear();
            rows.extend((j + 1..=reach[j]).filter(|&i| self.first[i] <= j));
            for &i in &rows {
                column[i] = self.get(i, j);
            }
            for &i in &rows {
                let row = z.row(i, j + 1, i + 1);
                let (left, diagonal) = row.split_at(row.len() - 1);
                sum[i] += dot(left, &column[j + 1..i]) + diagonal[0] * column[i];
                let scale = column[i];
                for (s, value) in sum[j + 1..i].iter_mut().zip(left) {
                    *s += value * scale;
                }
            }
            let l_jj = self.get(j, j);
            let mut z_jj = 1.0 / l_jj;
            for &i in &rows {
                let value = -sum[i] / l_jj;
                *z.row_mut(i, j, j + 1).first_mut().expect("one entry") = value;
                z_jj -= value * column[i];
            }
            *z.row_mut(j, j, j + 1).first_mut().expect("one entry") = z_jj / l_jj;
            sum[j + 1..=reach[j]].fill(0.0);
            for &i in &rows {
                column[i] = 0.0;
            }
        }
        z
    }
}

/// Inner product with eight partial sums, so that it vectorises; the order of additions is fixed.
#[inline]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let (a, b) = (&a[..n], &b[..n]);
    let mut parts = [0.0; 8];
    let (chunks_a, chunks_b) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = chunks_a.remainder().iter().zip(chunks_b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in chunks_a.zip(chunks_b) {
        for k in 0..8 {
            parts[k] += x[k] * y[k];
        }
    }
    parts.iter().sum::<f64>() + tail
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    /// A diagonally dominant matrix with the given envelope, in both forms.
    fn random(first: &[usize], mut next: impl FnMut() -> f64) -> (Skyline, DMatrix<f64>) {
        let n = first.len();
        let mut sky = Skyline::new(first.to_vec());
        let mut dense = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in first[i]..=i {
                let value = if i == j { 2.0 * n as f64 } else { next() };
                sky.add(i, j, value);
                dense[(i, j)] = value;
                dense[(j, i)] = value;
            }
        }
        (sky, dense)
    }

    proptest! {
        /// Against nalgebra's dense factorisation and inverse.
        #[test]
        fn truth_dense(shape in prop::collection::vec(0.0..1.0f64, 1..40), values in prop::collection::vec(-1.0..1.0f64, 900)) {
            let first: Vec<usize> = shape.iter().enumerate().map(|(i, f)| (f * (i + 1) as f64) as usize).collect();
            let mut values = values.into_iter();
            let (mut sky, dense) = random(&first, || values.next().unwrap_or(0.3));
            let n = first.len();
            let rhs = DVector::from_fn(n, |i, _| (i as f64).sin() + 0.1);
            prop_assert!(sky.factor());
            let mut x = rhs.as_slice().to_vec();
            sky.solve(&mut x);
            prop_assert!((&dense * DVector::from_vec(x) - rhs).amax() < 1e-10);
            let inverse = dense.try_inverse().expect("dominant");
            let z = sky.inverse_in_envelope();
            for i in 0..n {
                for j in first[i]..=i {
                    prop_assert!((z.get(i, j) - inverse[(i, j)]).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn an_indefinite_matrix_is_refused() {
        let mut sky = Skyline::new(vec![0, 0]);
        sky.add(0, 0, 1.0);
        sky.add(1, 0, 2.0);
        sky.add(1, 1, 1.0);
        assert!(!sky.factor());
        assert!(!Skyline::new(vec![0]).factor());
    }
}
