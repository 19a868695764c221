//! Small dense linear algebra and least squares, for the estimators: a dozen unknowns at a
//! time, in double precision.

mod eigen;
mod levenberg;
mod matrix;
mod statistics;

pub use eigen::{null_vector, symmetric_eigen};
pub use levenberg::{Minimum, Normal, minimise};
pub use matrix::{Cholesky, Matrix};
pub use statistics::{median, median_absolute, root_mean_square};
