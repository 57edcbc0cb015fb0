//! Blocks of one user, small enough for the stack: two unknowns (east, north), or three with the altitude.

/// A square matrix by rows.
pub(super) type Mat<const D: usize> = [[f64; D]; D];

/// Inverse of a symmetric positive definite matrix. Not finite where it has none.
#[inline]
pub(super) fn inverse<const D: usize>(m: Mat<D>) -> Mat<D> {
    if D == 2 {
        let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        let mut out = [[0.0; D]; D];
        out[0][0] = m[1][1] / det;
        out[1][1] = m[0][0] / det;
        out[0][1] = -m[0][1] / det;
        out[1][0] = out[0][1];
        return out;
    }
    // Gauss-Jordan in place; a definite matrix needs no pivots.
    let mut a = m;
    for k in 0..D {
        let pivot = 1.0 / a[k][k];
        a[k][k] = 1.0;
        a[k].iter_mut().for_each(|x| *x *= pivot);
        let row = a[k];
        for (_, other) in a.iter_mut().enumerate().filter(|(i, _)| *i != k) {
            let factor = std::mem::take(&mut other[k]);
            other.iter_mut().zip(row).for_each(|(x, y)| *x -= factor * y);
        }
    }
    a
}

/// Matrix times vector.
#[inline]
pub(super) fn mul<const D: usize>(m: &Mat<D>, v: [f64; D]) -> [f64; D] {
    std::array::from_fn(|i| dot(m[i], v))
}

#[inline]
pub(super) fn dot<const D: usize>(a: [f64; D], b: [f64; D]) -> f64 {
    let mut sum = a[0] * b[0];
    for k in 1..D {
        sum += a[k] * b[k];
    }
    sum
}

/// The block of east and north.
pub(super) fn horizontal<const D: usize>(m: &Mat<D>) -> Mat<2> {
    [[m[0][0], m[0][1]], [m[1][0], m[1][1]]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_inverse_times_matrix_is_one() {
        let three = [[4.0, 1.0, -0.5], [1.0, 3.0, 0.7], [-0.5, 0.7, 2.0]];
        assert_unit(three, inverse(three));
        let two = horizontal(&three);
        assert_unit(two, inverse(two));
    }

    fn assert_unit<const D: usize>(m: Mat<D>, inverted: Mat<D>) {
        for (i, row) in m.iter().enumerate() {
            // The inverse is symmetric: its rows are its columns.
            for (j, column) in inverted.iter().enumerate() {
                let expected = f64::from(u8::from(i == j));
                assert!((dot(*row, *column) - expected).abs() < 1e-14, "({i}, {j})");
            }
        }
    }
}
