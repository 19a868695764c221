//! Symmetric positive definite systems of a size known at compile time, solved without allocation.

use crate::cholesky;

/// A symmetric matrix, row by row.
pub type Matrix<const N: usize> = [[f64; N]; N];

/// Solves A x = b by Cholesky's factorisation; `None` unless A is positive definite.
#[must_use]
pub fn solve<const N: usize>(a: &Matrix<N>, b: &[f64; N]) -> Option<[f64; N]> {
    let (mut lower, mut scale, mut x) = (*a, [0.0; N], *b);
    cholesky::factorise(lower.as_flattened_mut(), &mut scale)?;
    cholesky::solve(lower.as_flattened(), &scale, &mut x);
    Some(x)
}

/// Returns A⁻¹; `None` unless A is positive definite.
#[must_use]
pub fn inverse<const N: usize>(a: &Matrix<N>) -> Option<Matrix<N>> {
    let (mut lower, mut scale) = (*a, [0.0; N]);
    cholesky::factorise(lower.as_flattened_mut(), &mut scale)?;
    let mut out = [[0.0; N]; N];
    for i in 0..N {
        let mut column = [0.0; N];
        column[i] = 1.0;
        cholesky::solve(lower.as_flattened(), &scale, &mut column);
        for (row, value) in out.iter_mut().zip(column) {
            row[i] = value;
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverts_positive_definite_and_rejects_singular_matrix() {
        let a = [[4.0, 1.0, -0.5], [1.0, 3.0, 0.25], [-0.5, 0.25, 1.0]];
        let b = inverse(&a).unwrap();
        for (i, row) in a.iter().enumerate() {
            let product: [f64; 3] =
                std::array::from_fn(|j| row.iter().zip(&b).map(|(x, other)| x * other[j]).sum());
            for (j, value) in product.into_iter().enumerate() {
                assert!((value - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
        }
        assert_eq!(solve(&[[1.0, 2.0], [2.0, 4.0]], &[1.0, 1.0]), None);
    }
}
