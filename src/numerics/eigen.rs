//! Eigenvalues and eigenvectors of small symmetric matrices.

use crate::matrix::Matrix;

/// Maximum number of sweeps; Jacobi's method converges much earlier.
const SWEEPS: usize = 60;

/// Returns the eigenvalues in ascending order and, as the rows of the matrix, their unit
/// eigenvectors, by Jacobi's method (Golub & Van Loan, section 8.5). `symmetric` must be square.
#[must_use]
pub fn symmetric_eigen(symmetric: &Matrix) -> (Vec<f64>, Matrix) {
    let n = symmetric.rows();
    let (mut a, mut v) = (symmetric.clone(), Matrix::identity(n));
    for _ in 0..SWEEPS {
        let mut off = 0.0;
        for p in 0..n {
            for q in p + 1..n {
                off += a[(p, q)] * a[(p, q)];
                rotate(&mut a, &mut v, p, q);
            }
        }
        if off.is_nan() || off == 0.0 {
            break;
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| a[(i, i)].total_cmp(&a[(j, j)]));
    let mut vectors = Matrix::zeros(n, n);
    for (row, &i) in order.iter().enumerate() {
        for k in 0..n {
            vectors[(row, k)] = v[(k, i)];
        }
    }
    (order.iter().map(|&i| a[(i, i)]).collect(), vectors)
}

/// Returns the unit vector x that minimises xᵀ A x.
#[must_use]
pub fn null_vector(symmetric: &Matrix) -> Vec<f64> {
    symmetric_eigen(symmetric).1.row(0).to_vec()
}

/// Zeroes `a[p, q]` by a rotation of the coordinates p and q.
fn rotate(a: &mut Matrix, v: &mut Matrix, p: usize, q: usize) {
    if a[(p, q)] == 0.0 {
        return;
    }
    let theta = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    if !(c.is_finite() && s.is_finite()) {
        return;
    }
    for k in 0..a.rows() {
        let (x, y) = (a[(k, p)], a[(k, q)]);
        a[(k, p)] = c * x - s * y;
        a[(k, q)] = s * x + c * y;
    }
    for k in 0..a.rows() {
        let (x, y) = (a[(p, k)], a[(q, k)]);
        a[(p, k)] = c * x - s * y;
        a[(q, k)] = s * x + c * y;
        let (x, y) = (v[(k, p)], v[(k, q)]);
        v[(k, p)] = c * x - s * y;
        v[(k, q)] = s * x + c * y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_satisfy_their_equation() {
        let mut a = Matrix::zeros(4, 4);
        for (w, row) in [(5.0, [1.0, 2.0, 0.0, 1.0]), (2.0, [0.0, 1.0, -1.0, 3.0])] {
            a.add_outer(w, &row, &row);
        }
        a.add_scaled(0.5, &Matrix::identity(4));
        let (values, vectors) = symmetric_eigen(&a);
        assert!((values[0] - 0.5).abs() < 1e-12 && (values[1] - 0.5).abs() < 1e-12);
        for (i, value) in values.iter().enumerate() {
            let image = a.times_vector(vectors.row(i));
            for (x, y) in image.iter().zip(vectors.row(i)) {
                assert!((x - value * y).abs() < 1e-9);
            }
        }
    }
}
