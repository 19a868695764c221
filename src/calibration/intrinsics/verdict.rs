//! Grades a lens, with findings and hints.

use super::coverage::{Coverage, Tilt, Uncertainty, lit_radius};
use super::estimate::Estimate;
use super::finding::Finding;
use penumbra_camera::LensModel;
use penumbra_rig_model::Grade;

/// A grade with its reasons.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The worst of the findings.
    pub grade: Grade,
    /// Each with what it alone would make of the grade.
    pub findings: Vec<(Grade, Finding)>,
    /// What to do next, best first: "cover the top right corner".
    pub hints: Vec<String>,
}

impl Verdict {
    /// Nothing can be used.
    #[must_use]
    pub fn refused(finding: Finding) -> Self {
        Self {
            grade: Grade::Refused,
            findings: vec![(Grade::Refused, finding)],
            hints: Vec::new(),
        }
    }

    /// Of an estimate.
    #[must_use]
    pub fn of(
        estimate: &Estimate,
        coverage: &Coverage,
        tilt: &Tilt,
        uncertainty: &Uncertainty,
    ) -> Self {
        let mut findings = Vec::new();
        let mut find = |value: f64, (usable, refused): (f64, f64), finding: Finding| {
            // What is no number is refused too.
            if value.is_nan() || value > refused {
                findings.push((Grade::Refused, finding));
            } else if value > usable {
                findings.push((Grade::Usable, finding));
            }
        };
        let used = estimate.views.iter().filter(|v| v.used).count();
        let views = estimate.views.len();
        let rejected = views - used;
        find(-(used as f64), (-8.0, -3.0), Finding::FewViews { used });
        let share = rejected as f64 / views.max(1) as f64;
        find(
            share,
            (0.2, 0.5),
            Finding::ViewsDisagree { rejected, views },
        );
        let degrees = tilt.largest().to_degrees();
        find(-degrees, (-20.0, -10.0), Finding::NoTilt { degrees });
        let percent = 100.0 * coverage.share;
        find(-percent, (-70.0, -20.0), Finding::PoorCoverage { percent });
        let lens = &estimate.lens;
        let longer = f64::from(lens.width.max(lens.height));
        let pixels = estimate.rms;
        let blunt = (longer / 1280.0).max(1.0);
        find(
            pixels,
            (0.5 * blunt, 1.5 * blunt),
            Finding::LargeResiduals { pixels },
        );
        let percent = 100.0 * estimate.sigma[0].max(estimate.sigma[1]) / lens.focal.min_element();
        find(percent, (0.3, 1.0), Finding::FocalUncertain { percent });
        let pixels = uncertainty.worst;
        // Beyond the corners that were seen a lens is a guess, which is said; where most of the
        // picture is one it is refused.
        let sure_elsewhere = uncertainty.median <= 2.0 * blunt;
        let limit = if sure_elsewhere {
            10.0 * blunt
        } else {
            2.0 * blunt
        };
        find(
            pixels,
            (1.0 * blunt, limit),
            Finding::ProjectionUncertain { pixels },
        );
        if let Some(what) = implausible(estimate) {
            findings.push((Grade::Refused, Finding::Implausible { what }));
        }
        findings.sort_by_key(|f| std::cmp::Reverse(f.0));
        Self {
            grade: findings.first().map_or(Grade::Good, |f| f.0),
            findings,
            hints: hints(coverage, tilt, used),
        }
    }
}

impl Verdict {
    /// One more finding; the grade follows.
    pub fn add(&mut self, grade: Grade, finding: Finding) {
        self.findings.push((grade, finding));
        self.findings.sort_by_key(|f| std::cmp::Reverse(f.0));
        self.grade = self.grade.max(grade);
    }
}

/// Returns why the lens is physically implausible.
fn implausible(estimate: &Estimate) -> Option<&'static str> {
    let lens = &estimate.lens;
    let size = lens.last_pixel() + 1.0;
    let middle = lens.centre / size;
    if middle.min_element() < 0.2 || middle.max_element() > 0.8 {
        return Some("its axis is far from the picture's middle");
    }
    if (lens.focal.x / lens.focal.y - 1.0).abs() > 0.05 {
        return Some("its pixels are not square");
    }
    let fold = if lens.model == LensModel::KannalaBrandt {
        lit_radius(lens, &estimate.views)
    } else {
        size.length()
    };
    (!lens.is_invertible_within(fold)).then_some("its distortion folds the picture over")
}

fn hints(coverage: &Coverage, tilt: &Tilt, used: usize) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(part) = coverage.poorest_part() {
        out.push(format!("cover the {part}"));
    }
    if let Some(side) = tilt.poorest_side() {
        let to = if side.ends_with("wards") {
            ""
        } else {
            "to the "
        };
        out.push(format!("tilt the board {to}{side}"));
    }
    if used < 15 {
        out.push(format!("take {} more views", 15 - used));
    }
    out
}

#[cfg(test)]
mod tests;
