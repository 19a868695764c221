//! Dense matrices, and the Cholesky factor of a symmetric one.

use crate::cholesky;
use std::ops::{Index, IndexMut};

/// A dense matrix, stored row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    rows: usize,
    columns: usize,
    data: Vec<f64>,
}

impl Matrix {
    /// Creates a zero matrix.
    #[must_use]
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self {
            rows,
            columns,
            data: vec![0.0; rows * columns],
        }
    }

    /// Creates the identity.
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

    /// Returns row `i`.
    #[must_use]
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.columns..(i + 1) * self.columns]
    }

    /// Sets all elements to zero.
    pub fn clear(&mut self) {
        self.data.fill(0.0);
    }

    /// Returns the transpose.
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

    /// Returns `self · other`; the columns of `self` must match the rows of `other`.
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

    /// Returns `self · vector`.
    #[must_use]
    pub fn times_vector(&self, vector: &[f64]) -> Vec<f64> {
        (0..self.rows).map(|i| dot(self.row(i), vector)).collect()
    }

    /// Adds `factor · a bᵀ`.
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

    /// Adds `factor · other`.
    pub fn add_scaled(&mut self, factor: f64, other: &Self) {
        for (slot, value) in self.data.iter_mut().zip(&other.data) {
            *slot += factor * value;
        }
    }

    /// Returns the matrix times `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.data.iter_mut().for_each(|x| *x *= factor);
        self
    }

    /// Returns the Cholesky factor; `None` unless the matrix is positive definite.
    #[must_use]
    pub fn cholesky(&self) -> Option<Cholesky> {
        let (mut lower, mut scale) = (self.clone(), vec![0.0; self.rows]);
        cholesky::factorise(&mut lower.data, &mut scale)?;
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

/// Cholesky factor of a symmetric positive definite matrix A.
#[derive(Clone, Debug)]
pub struct Cholesky {
    lower: Matrix,
    /// D⁻¹ᐟ² of the diagonal D of A: D⁻¹ᐟ² A D⁻¹ᐟ² = L Lᵀ.
    scale: Vec<f64>,
}

impl Cholesky {
    /// Solves A x = b.
    #[must_use]
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x = b.to_vec();
        cholesky::solve(&self.lower.data, &self.scale, &mut x);
        x
    }

    /// Returns ln det A.
    #[must_use]
    pub fn log_determinant(&self) -> f64 {
        let terms = self.scale.iter().enumerate();
        terms
            .map(|(i, s)| 2.0 * (self.lower[(i, i)] / s).ln())
            .sum()
    }

    /// Returns A⁻¹.
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
    use super::*;

    #[test]
    fn solves_badly_scaled_system() {
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
    fn rejects_matrix_that_is_not_positive_definite() {
        let mut a = Matrix::identity(2);
        a[(0, 1)] = 1.0;
        a[(1, 0)] = 1.0;
        assert!(a.cholesky().is_none());
        a[(1, 1)] = f64::NAN;
        assert!(a.cholesky().is_none());
    }
}
