//! Small symmetric systems.

/// A symmetric matrix, row by row.
pub type Matrix<const N: usize> = [[f64; N]; N];

/// Lower factor of a positive definite matrix; `None` where it is not.
fn cholesky<const N: usize>(a: &Matrix<N>) -> Option<Matrix<N>> {
    let mut l = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            let rest = a[i][j] - dot;
            if i == j {
                if rest.is_nan() || rest <= 1e-14 * a[i][i].abs() {
                    return None;
                }
                l[i][i] = rest.sqrt();
            } else {
                l[i][j] = rest / l[j][j];
            }
        }
    }
    Some(l)
}

/// x with A x = b.
pub fn solve<const N: usize>(a: &Matrix<N>, b: &[f64; N]) -> Option<[f64; N]> {
    let l = cholesky(a)?;
    let mut x = *b;
    for i in 0..N {
        let dot: f64 = (0..i).map(|k| l[i][k] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i][i];
    }
    for i in (0..N).rev() {
        let dot: f64 = (i + 1..N).map(|k| l[k][i] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i][i];
    }
    Some(x)
}

/// The inverse.
pub fn inverse<const N: usize>(a: &Matrix<N>) -> Option<Matrix<N>> {
    let mut out = [[0.0; N]; N];
    for i in 0..N {
        let mut unit = [0.0; N];
        unit[i] = 1.0;
        let column = solve(a, &unit)?;
        for (row, value) in out.iter_mut().zip(column) {
            row[i] = value;
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_inverse_inverts_and_a_singular_matrix_has_none() {
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
