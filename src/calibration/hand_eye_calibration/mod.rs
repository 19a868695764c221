//! What a tracker and the pictures of one recording say together: the steps `latency`
//! and `tracker`.
//!
//! `surveyor` finds the scene camera's pose in each picture by tags or a board, `readings` keep
//! what the tracker said, `latency` compares how both turn, `mounting` where both are; `field`
//! is how an electromagnetic tracker's space is bent.

mod field_fit;
mod latency;
mod latency_judge;
mod latency_page;
mod mounting;
mod mounting_judge;
mod mounting_page;
mod readings;
mod surveyor;

pub use latency::{LatencyOptions, LatencyStep};
pub use mounting::{LatencyChoice, MountingOptions, MountingStep};
pub use readings::Readings;
pub use surveyor::{Landmarks, Sighting, Surveyor};

use penumbra_rig_model::Grade;

/// Findings with what each makes of the grade.
type Findings = Vec<(Grade, String)>;

/// The worst of them first, and the grade that they make.
fn graded(findings: &mut Findings) -> Grade {
    findings.sort_by_key(|f| std::cmp::Reverse(f.0));
    findings.first().map_or(Grade::Good, |f| f.0)
}

#[cfg(test)]
mod tests;
