//! Findings of a calibration step and the grade that they result in.

use penumbra_rig_model::Grade;

/// Findings, each with the grade that it limits the result to.
pub(super) type Findings = Vec<(Grade, String)>;

/// Sorts the findings, worst first, and returns the resulting grade.
pub(super) fn grade(findings: &mut Findings) -> Grade {
    findings.sort_by_key(|f| std::cmp::Reverse(f.0));
    findings.first().map_or(Grade::Good, |f| f.0)
}
