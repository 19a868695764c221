//! The step's summary while it is made.

use penumbra_rig_model::Grade;

/// Lines, findings and hints of the step.
#[derive(Debug, Default)]
pub(super) struct Summary {
    pub lines: Vec<String>,
    pub findings: Vec<(Grade, String)>,
    pub hints: Vec<String>,
}

impl Summary {
    pub fn finding(&mut self, grade: Grade, text: impl ToString) {
        self.findings.push((grade, text.to_string()));
    }

    pub fn line(&mut self, text: String) {
        self.lines.push(text);
    }

    /// Returns the grade of the worst finding.
    pub fn grade(&self) -> Grade {
        self.findings
            .iter()
            .map(|f| f.0)
            .max()
            .unwrap_or(Grade::Good)
    }
}
