//! The step's summary, filled in by its assessments.

use penumbra_rig_model::Grade;

/// Lines, findings and hints of the step.
#[derive(Default)]
pub(super) struct Summary {
    pub lines: Vec<String>,
    pub findings: Vec<(Grade, String)>,
    pub hints: Vec<String>,
}

impl Summary {
    pub fn finding(&mut self, grade: Grade, text: impl Into<String>) {
        self.findings.push((grade, text.into()));
    }
}
