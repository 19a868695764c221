//! A dense matrix and Cholesky's factors of a symmetric one.

use std::ops::{Index, IndexMut};

/// Row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    rows: usize,
    columns: usize,
    data: Vec<f64>,
}

impl Matrix {
    /// All zero.
    #[must_use]
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self {
            rows,
            columns,
            data: vec![0.0; rows * columns],
        }
    }

    /// Ones on the diagonal.
    #[must_use]
    pub fn identity(size: usize) -> Self {
        let mut out = Self::zeros(size, size);
        for i in 0..size {
            out[(i, i)] = 1.0;
        }
        out
    }

    /// Number of rows.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[must_use]
    pub const fn columns(&self) -> usize {
        self.columns
    }

    /// One row.
    #[must_use]
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.columns..(i + 1) * self.columns]
    }

    /// Sets all to zero.
    pub fn clear(&mut self) {
        self.data.fill(0.0);
    }

    /// Rows become columns.
    #[must_use]
    pub fn transposed(&self) -> Self {
        let mut out = Self::zeros(self.columns, self.rows);
        for i in 0..self.rows {
            for j in 0..self.columns {
                out[(j, i)] = self[(i, j)];
            }
        }
        out
    }

    /// `self · other`; sizes must fit.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        debug_assert_eq!(self.columns, other.rows);
        let mut out = Self::zeros(self.rows, other.columns);
        for i in 0..self.rows {
            for k in 0..self.columns {
                let factor = self[(i, k)];
                for j in 0..other.columns {
                    out[(i, j)] += factor * other[(k, j)];
                }
            }
        }
        out
    }

    /// `self · vector`.
    #[must_use]
    pub fn times_vector(&self, vector: &[f64]) -> Vec<f64> {
        (0..self.rows).map(|i| dot(self.row(i), vector)).collect()
    }

    /// `self += factor · a bᵀ`.
    pub fn add_outer(&mut self, factor: f64, a: &[f64], b: &[f64]) {
        for (i, &x) in a.iter().enumerate() {
            let scaled = factor * x;
            if scaled != 0.0 {
                let row = &mut self.data[i * self.columns..(i + 1) * self.columns];
                for (slot, &y) in row.iter_mut().zip(b) {
                    *slot += scaled * y;
                }
            }
        }
    }

    /// `self += factor · other`.
    pub fn add_scaled(&mut self, factor: f64, other: &Self) {
        for (slot, value) in self.data.iter_mut().zip(&other.data) {
            *slot += factor * value;
        }
    }

    /// Every element times `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.data.iter_mut().for_each(|x| *x *= factor);
        self
    }

    /// The lower triangle L of `self` = L Lᵀ; `None` unless positive definite.
    ///
    /// Rows and columns are brought to a unit diagonal first, so that parameters in pixels
    /// and coefficients of 1e-6 can stand in one matrix.
    #[must_use]
    pub fn cholesky(&self) -> Option<Cholesky> {
        let n = self.rows;
        let mut scale = Vec::with_capacity(n);
        for i in 0..n {
            let d = self[(i, i)];
            if !(d.is_finite() && d > 0.0) {
                return None;
            }
            scale.push(1.0 / d.sqrt());
        }
        let mut lower = Self::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                let sum = dot(&lower.row(i)[..j], &lower.row(j)[..j]);
                let rest = self[(i, j)] * scale[i] * scale[j] - sum;
                if i != j {
                    lower[(i, j)] = rest / lower[(j, j)];
                } else if rest > 1e-15 {
                    lower[(i, i)] = rest.sqrt();
                } else {
                    return None;
                }
            }
        }
        Some(Cholesky { lower, scale })
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;
    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.data[row * self.columns + column]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.data[row * self.columns + column]
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Cholesky's factor of a symmetric positive definite matrix A.
#[derive(Clone, Debug)]
pub struct Cholesky {
    lower: Matrix,
    /// D⁻¹ᐟ² of the diagonal D of A: D⁻¹ᐟ² A D⁻¹ᐟ² = L Lᵀ.
    scale: Vec<f64>,
}

impl Cholesky {
    /// x of A x = b.
    #[must_use]
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let (l, n) = (&self.lower, self.scale.len());
        let mut x: Vec<f64> = b.iter().zip(&self.scale).map(|(b, s)| b * s).collect();
        for i in 0..n {
            let known = dot(&l.row(i)[..i], &x[..i]);
            x[i] = (x[i] - known) / l[(i, i)];
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|k| l[(k, i)] * x[k]).sum();
            x[i] = (x[i] - known) / l[(i, i)];
        }
        x.iter_mut().zip(&self.scale).for_each(|(x, s)| *x *= s);
        x
    }

    /// ln det A.
    #[must_use]
    pub fn log_determinant(&self) -> f64 {
        let terms = self.scale.iter().enumerate();
        terms
            .map(|(i, s)| 2.0 * (self.lower[(i, i)] / s).ln())
            .sum()
    }

    /// A⁻¹.
    #[must_use]
    pub fn inverse(&self) -> Matrix {
        let n = self.scale.len();
        let mut out = Matrix::zeros(n, n);
        let mut unit = vec![0.0; n];
        for j in 0..n {
            unit[j] = 1.0;
            for (i, x) in self.solve(&unit).into_iter().enumerate() {
                out[(i, j)] = x;
            }
            unit[j] = 0.0;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_badly_scaled_system_is_solved() {
        let mut a = Matrix::zeros(3, 3);
        for row in [
            [1e6, 2.0, 1e-4],
            [3.0, 1e3, 2e-5],
            [1e5, 1.0, 1e-3],
            [0.0, 4.0, 1e-4],
        ] {
            a.add_outer(1.0, &row, &row);
        }
        let truth = [1e-3, 2.0, 3e4];
        let x = a.cholesky().unwrap().solve(&a.times_vector(&truth));
        for (x, t) in x.iter().zip(truth) {
            assert!((x / t - 1.0).abs() < 1e-8, "{x} {t}");
        }
        let three = Matrix::identity(3).scaled(2.0).cholesky().unwrap();
        assert!((three.log_determinant() - 8f64.ln()).abs() < 1e-12);
        let one = a.times(&a.cholesky().unwrap().inverse());
        assert!((one[(0, 0)] - 1.0).abs() < 1e-8 && one[(0, 1)].abs() < 1e-4);
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let mut a = Matrix::identity(2);
        a[(0, 1)] = 1.0;
        a[(1, 0)] = 1.0;
        assert!(a.cholesky().is_none());
        a[(1, 1)] = f64::NAN;
        assert!(a.cholesky().is_none());
    }
}
