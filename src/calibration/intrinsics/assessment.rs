//! Assesses a lens: grade, findings, hints.

use super::coverage::{Coverage, Tilt, Uncertainty, lit_radius};
use super::estimate::Estimate;
use super::findings::Finding;
use crate::summary::grade;
use penumbra_camera::LensModel;
use penumbra_rig_model::Grade;

/// A grade with its reasons.
#[derive(Clone, Debug, PartialEq)]
pub struct Assessment {
    /// The worst of the findings.
    pub grade: Grade,
    /// The findings, each with the grade that it implies.
    pub findings: Vec<(Grade, Finding)>,
    /// Instructions for further views, most useful first, e.g. "cover the top right corner".
    pub hints: Vec<String>,
}

impl Assessment {
    /// Creates the assessment of a calibration that is refused because of `finding`.
    #[must_use]
    pub fn refused(finding: Finding) -> Self {
        Self {
            grade: Grade::Refused,
            findings: vec![(Grade::Refused, finding)],
            hints: Vec::new(),
        }
    }

    /// Assesses an estimate.
    #[must_use]
    pub fn from_estimate(
        estimate: &Estimate,
        coverage: &Coverage,
        tilt: &Tilt,
        uncertainty: &Uncertainty,
    ) -> Self {
        let mut findings = Vec::new();
        let mut check = |value: f64, (usable, refused): (f64, f64), finding: Finding| {
            // Undefined values are refused.
            if value.is_nan() || value > refused {
                findings.push((Grade::Refused, finding));
            } else if value > usable {
                findings.push((Grade::Usable, finding));
            }
        };
        let used = estimate.views.iter().filter(|v| v.used).count();
        let views = estimate.views.len();
        let rejected = views - used;
        check(-(used as f64), (-8.0, -3.0), Finding::FewViews { used });
        let share = rejected as f64 / views.max(1) as f64;
        check(
            share,
            (0.2, 0.3),
            Finding::RejectedViews { rejected, views },
        );
        let degrees = tilt.max().to_degrees();
        check(-degrees, (-20.0, -10.0), Finding::SmallTilt { degrees });
        let percent = 100.0 * coverage.share;
        check(-percent, (-70.0, -20.0), Finding::PoorCoverage { percent });
        let lens = &estimate.lens;
        let longer = f64::from(lens.width.max(lens.height));
        let pixels = estimate.rms;
        let scale = (longer / 1280.0).max(1.0);
        check(
            pixels,
            (0.5 * scale, 1.5 * scale),
            Finding::LargeResiduals { pixels },
        );
        let percent = 100.0 * estimate.sigma[0].max(estimate.sigma[1]) / lens.focal.min_element();
        check(percent, (0.3, 1.0), Finding::FocalUncertain { percent });
        let pixels = uncertainty.worst;
        // Outside the area with corners the lens is extrapolated, which gives a finding; it is
        // refused if most of the picture is extrapolated.
        let is_mostly_known = uncertainty.median <= 2.0 * scale;
        let limit = if is_mostly_known {
            10.0 * scale
        } else {
            2.0 * scale
        };
        check(
            pixels,
            (1.0 * scale, limit),
            Finding::ProjectionUncertain { pixels },
        );
        if let Some(reason) = implausible_reason(estimate) {
            findings.push((Grade::Refused, Finding::Implausible { reason }));
        }
        Self {
            grade: grade(&mut findings),
            findings,
            hints: hints(coverage, tilt, used),
        }
    }
}

impl Assessment {
    /// Adds a finding; the grade becomes the worse of both.
    pub fn add(&mut self, severity: Grade, finding: Finding) {
        self.findings.push((severity, finding));
        self.grade = grade(&mut self.findings);
    }
}

/// Returns why the lens is physically implausible; `None` if it is plausible.
fn implausible_reason(estimate: &Estimate) -> Option<&'static str> {
    let lens = &estimate.lens;
    let size = lens.last_pixel() + 1.0;
    let middle = lens.centre / size;
    if middle.min_element() < 0.2 || middle.max_element() > 0.8 {
        return Some("its principal point is far from the picture's centre");
    }
    if (lens.focal.x / lens.focal.y - 1.0).abs() > 0.05 {
        return Some("its pixels are not square");
    }
    let radius = if lens.model == LensModel::KannalaBrandt {
        lit_radius(lens, &estimate.views)
    } else {
        size.length()
    };
    (!lens.is_invertible_within(radius))
        .then_some("its distortion is not invertible within the picture")
}

fn hints(coverage: &Coverage, tilt: &Tilt, used: usize) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(part) = coverage.least_covered_part() {
        out.push(format!("cover the {part}"));
    }
    if let Some(side) = tilt.least_tilted_side() {
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
