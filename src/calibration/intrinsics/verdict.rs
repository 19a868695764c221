//! Is it good enough, why not, and what to do about it.

use super::coverage::{Coverage, Tilt, Uncertainty, lit_radius};
use super::estimate::{Estimate, NoEstimate};
use super::lens::LensModel;
use thiserror::Error;

/// What a calibration may be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// For everything.
    Good,
    /// It can be used; something would make it better.
    Usable,
    /// Not to be used: it may be wrong.
    Refused,
}

impl Grade {
    /// As files and reports spell it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Usable => "usable",
            Self::Refused => "refused",
        }
    }
}

/// Something that speaks against a calibration. Each text says what was found and what to do.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Finding {
    /// There is no lens at all.
    #[error(transparent)]
    NoLens(#[from] NoEstimate),
    /// No picture shows the board.
    #[error("none of {pictures} pictures shows the board; check --board, light and focus")]
    BoardNotSeen {
        /// Pictures looked at.
        pictures: usize,
    },
    /// The board has another number of corners than was said.
    #[error(
        "the board in the pictures has {columns}×{rows} inner corners, not as said; give its true size with --board"
    )]
    OtherBoard {
        /// Seen in a row.
        columns: u32,
        /// Rows seen.
        rows: u32,
    },
    /// Pictures of several cameras, or of one in several modes.
    #[error("the pictures have several sizes; give those of one camera in one mode")]
    SizesDiffer,
    /// Too few views for a sure result.
    #[error("{used} views were used; take 15 or more")]
    FewViews {
        /// That agree.
        used: usize,
    },
    /// Many views contradict the others.
    #[error(
        "{rejected} of {views} views contradict the others: motion blur, a bent board, or two cameras mixed"
    )]
    ViewsDisagree {
        /// Left out.
        rejected: usize,
        /// Of so many.
        views: usize,
    },
    /// The board was held parallel to the picture.
    #[error("the board was tilted by {degrees:.0}° at most; tilt it by 20° to 45° to all sides")]
    NoTilt {
        /// The largest angle.
        degrees: f64,
    },
    /// Parts of the picture without corners.
    #[error("corners cover {percent:.0} % of the picture; hold the board into every part of it")]
    PoorCoverage {
        /// Of the picture's cells.
        percent: f64,
    },
    /// Corners are not where the lens puts them.
    #[error(
        "reprojection error is {pixels:.2} px; a flat board, sharp pictures and no motion give 0.1 to 0.4 px"
    )]
    LargeResiduals {
        /// Root mean square.
        pixels: f64,
    },
    /// The focal length is not sure.
    #[error(
        "the focal length is known to {percent:.2} % only; tilt the board more, and fill the picture with it"
    )]
    FocalUncertain {
        /// 1σ.
        percent: f64,
    },
    /// Somewhere in the picture the lens is not sure.
    #[error(
        "somewhere in the picture the lens is known to {pixels:.1} px only; show the board there"
    )]
    ProjectionUncertain {
        /// 1σ at the worst place.
        pixels: f64,
    },
    /// A lens that no camera has.
    #[error("the lens found is no camera's ({what}); check the board's size, and take more views")]
    Implausible {
        /// What is wrong with it.
        what: &'static str,
    },
}

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

/// What no camera's lens is like.
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
