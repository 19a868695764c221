//! `penumbra bench`: how long a frame takes, on the adapter chosen, for the cases of the
//! papers' tables.

mod report;
mod supan;

pub use report::{BenchReport, Row};

use crate::compositor::{Gpu, GpuError};

/// What to measure.
#[derive(Clone, Debug, Default)]
pub struct BenchOptions {
    /// Case name; all without it.
    pub case: Option<String>,
    /// Frames per row; the case's own number without it.
    pub frames: Option<u32>,
    /// Measure this picture size too.
    pub size: Option<(u32, u32)>,
}

/// Names of all cases.
pub const CASES: [&str; 1] = ["supan"];

/// Runs the chosen cases; `progress` is told each row as it is done.
///
/// # Errors
/// The device was lost.
pub fn run(
    gpu: &Gpu,
    options: &BenchOptions,
    progress: &mut dyn FnMut(&Row),
) -> Result<BenchReport, GpuError> {
    let mut report = BenchReport::new(gpu);
    let wanted = |name: &str| options.case.as_deref().is_none_or(|case| case == name);
    if wanted("supan") {
        supan::run(gpu, options, &mut report, progress)?;
    }
    Ok(report)
}
