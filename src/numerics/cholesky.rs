//! Cholesky's factorisation of a symmetric positive definite matrix, on row-major slices.
//!
//! Rows and columns are scaled to a unit diagonal first, so that parameters in pixels and
//! coefficients of 1e-6 can stand in one matrix.

/// Smallest pivot of the scaled matrix that counts as positive.
const MIN_PIVOT: f64 = 1e-15;

/// Replaces the symmetric row-major matrix A by the lower triangle L of
/// D⁻¹ᐟ² A D⁻¹ᐟ² = L Lᵀ, and fills `scale` with the diagonal of D⁻¹ᐟ², where D is the diagonal
/// of A. `None` unless A is positive definite. Elements above the diagonal are left as they are.
pub(crate) fn factorise(a: &mut [f64], scale: &mut [f64]) -> Option<()> {
    let n = scale.len();
    for i in 0..n {
        let d = a[i * n + i];
        if !(d.is_finite() && d > 0.0) {
            return None;
        }
        scale[i] = 1.0 / d.sqrt();
    }
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum();
            let rest = a[i * n + j] * scale[i] * scale[j] - sum;
            if i != j {
                a[i * n + j] = rest / a[j * n + j];
            } else if rest > MIN_PIVOT {
                a[i * n + i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(())
}

/// Replaces b by the x of A x = b, for the factor and scale that [`factorise`] made of A.
pub(crate) fn solve(lower: &[f64], scale: &[f64], x: &mut [f64]) {
    let n = scale.len();
    x.iter_mut().zip(scale).for_each(|(x, s)| *x *= s);
    for i in 0..n {
        let known: f64 = (0..i).map(|k| lower[i * n + k] * x[k]).sum();
        x[i] = (x[i] - known) / lower[i * n + i];
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|k| lower[k * n + i] * x[k]).sum();
        x[i] = (x[i] - known) / lower[i * n + i];
    }
    x.iter_mut().zip(scale).for_each(|(x, s)| *x *= s);
}
