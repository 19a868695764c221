//! Small dense linear algebra, nonlinear least squares, robust statistics and reproducible
//! random numbers, in double precision, for estimators with a dozen unknowns.

mod cholesky;
mod eigen;
pub mod fixed_size;
mod interpolation;
mod levenberg_marquardt;
mod matrix;
mod random;
mod rotation;
mod statistics;

pub use eigen::{null_vector, symmetric_eigen};
pub use interpolation::smoothstep;
pub use levenberg_marquardt::{Minimum, NormalEquations, Stop, descend, minimise};
pub use matrix::{Cholesky, Matrix};
pub use random::Random;
pub use rotation::{BestRotation, best_rotation, rotation_vector};
pub use statistics::{median, median_absolute, root_mean_square, tukey_weight};

/// Compiles and runs the README's example.
#[cfg(doctest)]
#[doc = include_str!("README.md")]
struct Readme;
