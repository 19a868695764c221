//! The summary of a calibration step: lines, findings and hints, and the grade that results.

use crate::step::Finished;
use penumbra_rig_model::Grade;

/// Findings, each with the grade to which it limits the result.
pub(crate) type Findings = Vec<(Grade, String)>;

/// Sorts the findings, worst first, and returns the resulting grade.
pub(crate) fn grade<T>(findings: &mut [(Grade, T)]) -> Grade {
    findings.sort_by_key(|f| std::cmp::Reverse(f.0));
    findings.first().map_or(Grade::Good, |f| f.0)
}

/// Lines, findings and hints of a step.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    pub lines: Vec<String>,
    pub findings: Findings,
    pub hints: Vec<String>,
}

impl Summary {
    pub fn finding(&mut self, grade: Grade, text: impl ToString) {
        self.findings.push((grade, text.to_string()));
    }

    pub fn line(&mut self, text: String) {
        self.lines.push(text);
    }

    /// Returns the result of the step, with its grade, without report and file.
    pub fn finished(mut self) -> Finished {
        Finished {
            grade: grade(&mut self.findings),
            lines: self.lines,
            findings: self.findings,
            hints: self.hints,
            report: String::new(),
            file: None,
        }
    }
}
