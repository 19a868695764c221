//! Grades the figures of a check.

use super::colour::Colours;
use super::reprojection::Reprojection;
use crate::latency::{ClockOffset, LatencyError};
use penumbra_rig_model::Grade;
use penumbra_white_balance::Provenance;

/// Maximum RMS reprojection error, pixels: good, usable.
const REPROJECTION: [f64; 2] = [1.0, 3.0];
/// Minimum number of corners for an assessment.
const MIN_CORNERS: usize = 80;
/// Maximum share of the corners that the tracker's pose may put out of the camera's sight.
const MAX_UNSEEN: f64 = 0.1;
/// Maximum median CIEDE2000: good (hardly visible side by side), usable (clearly visible).
const COLOUR: [f64; 2] = [2.0, 5.0];
/// Maximum deviation from the calibrated latency, milliseconds: good, usable. A rotation of 60°/s
/// moves a typical picture by half a pixel in one millisecond.
const LATENCY: [f64; 2] = [2.0, 8.0];

/// The measurements of a check.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurements {
    /// Reprojection error under the tracker's pose.
    pub by_tracker: Option<Reprojection>,
    /// Reprojection error of each marker under the pose from the others.
    pub leave_one_out: Option<Reprojection>,
    /// Whether the rig has a tracker.
    pub has_tracker: bool,
    /// Whether the rig has an environment camera of its own.
    pub has_environment: bool,
    /// Colour differences.
    pub colours: Option<Colours>,
    /// Clock offset between tracker and camera; `None` without tracker data.
    pub latency: Option<Result<ClockOffset, LatencyError>>,
    /// Calibrated clock offset, seconds.
    pub calibrated_offset: f64,
}

/// Assessment of a check.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Assessment {
    /// Figures, one line each.
    pub lines: Vec<String>,
    /// Problems and their remedies.
    pub findings: Vec<(Grade, String)>,
}

impl Assessment {
    /// Grades the measurements.
    #[must_use]
    pub fn from_measurements(measured: &Measurements) -> Self {
        let mut assessment = Self::default();
        assessment.reprojection(measured);
        assessment.colour(measured);
        assessment.latency(measured);
        assessment.findings.sort_by_key(|f| std::cmp::Reverse(f.0));
        assessment
    }

    /// Returns the worst grade of all findings.
    #[must_use]
    pub fn grade(&self) -> Grade {
        self.findings
            .iter()
            .map(|f| f.0)
            .max()
            .unwrap_or(Grade::Good)
    }

    fn reprojection(&mut self, measured: &Measurements) {
        let (found, source, remedy) = if measured.has_tracker {
            (
                measured.by_tracker,
                "the tracker",
                "calibrate tracker and latency again; a large mean error indicates that something was moved",
            )
        } else {
            (
                measured.leave_one_out,
                "the other markers",
                "calibrate the map and the lens again; look for a marker that was moved",
            )
        };
        if let Some(r) = found.filter(|r| r.unseen > 0 && r.corners + r.unseen >= MIN_CORNERS) {
            let (unseen, all) = (r.unseen, r.corners + r.unseen);
            if unseen as f64 > MAX_UNSEEN * all as f64 {
                self.findings.push((
                    Grade::Refused,
                    format!(
                        "the pose from {source} puts {unseen} of {all} corners of markers out of the camera's sight, \
                         although it sees them: the mounting of tracker and camera is wrong or missing; \
                         run `calibrate tracker` and check again with --rig"
                    ),
                ));
                return;
            }
        }
        let Some(r) = found.filter(|r| r.corners >= MIN_CORNERS) else {
            let corners = found.map_or(0, |r| r.corners);
            self.findings.push((
                Grade::Refused,
                format!(
                    "only {corners} of {MIN_CORNERS} needed corners of known markers were seen with a pose from \
                     {source}; show the scene camera the rig's markers for a minute"
                ),
            ));
            return;
        };
        self.lines.push(format!(
            "reprojection error with the pose from {source}: {:.2} ± {:.2} px RMS (median {:.2}, maximum {:.1}; mean {:+.2}, {:+.2}; {} corners)",
            r.rms, r.sigma, r.median, r.max, r.mean.x, r.mean.y, r.corners
        ));
        self.assess(r.rms, REPROJECTION, || {
            format!("reprojection error is {:.2} px RMS; {remedy}", r.rms)
        });
        if measured.has_tracker
            && let Some(others) = measured.leave_one_out
        {
            self.lines.push(format!(
                "reprojection error of each marker with the pose from the others: {:.2} ± {:.2} px RMS ({} corners)",
                others.rms, others.sigma, others.corners
            ));
            self.assess(others.rms, REPROJECTION, || {
                format!(
                    "reprojection error between markers is {:.2} px RMS; calibrate the map and the lens again",
                    others.rms
                )
            });
        }
    }

    fn colour(&mut self, measured: &Measurements) {
        if !measured.has_environment {
            self.lines
                .push("colour: not compared, the rig has one camera".to_owned());
            return;
        }
        let Some(c) = measured.colours else {
            self.findings.push((
                Grade::Usable,
                "colours were not compared: both cameras must see the same bright, matt surfaces of the \
                 ground or of phantoms; turn the rig towards them"
                    .to_owned(),
            ));
            return;
        };
        let source = match c.provenance {
            Provenance::Calibrated => "the calibration",
            Provenance::Chart => "the colour chart",
            Provenance::Overlap => "surfaces seen by both cameras",
            Provenance::Reflectance => "surfaces of known reflectance",
            Provenance::SameModel => "the statement that both cameras are of one model",
            Provenance::SameProduct => "the product name that both cameras have",
            Provenance::Fixed => "the configuration",
            Provenance::SameCamera | Provenance::GreyWorld | Provenance::Unknown => "nothing",
        };
        self.lines.push(format!(
            "colour difference with gains from {source}: median ΔE2000 {:.2}, 90th percentile {:.2} ({} surfaces in {} comparisons)",
            c.delta_e, c.percentile_90, c.counts.0, c.counts.1
        ));
        self.assess(c.delta_e, COLOUR, || {
            format!(
                "the cameras' colours differ by ΔE2000 {:.1}; calibrate radiometric again, in this light",
                c.delta_e
            )
        });
    }

    fn latency(&mut self, measured: &Measurements) {
        match &measured.latency {
            Some(Ok(found)) => {
                let deviation = 1e3 * (found.seconds - measured.calibrated_offset);
                self.lines.push(format!(
                    "latency: {:.2} ± {:.2} ms ({deviation:+.2} ms from the calibrated latency; {} samples)",
                    1e3 * found.seconds,
                    1e3 * found.sigma,
                    found.samples
                ));
                // Less two standard deviations: a deviation within the noise is not a fault.
                self.assess(deviation.abs() - 2e3 * found.sigma, LATENCY, || {
                    format!("latency deviates by {deviation:+.1} ms from the calibrated latency; calibrate latency again")
                });
            }
            Some(Err(error)) => self
                .findings
                .push((Grade::Usable, format!("latency was not measured: {error}"))),
            None if measured.has_tracker => self.findings.push((
                Grade::Usable,
                "latency was not measured: the tracker sent no data".to_owned(),
            )),
            None => (),
        }
    }

    /// Adds a finding if `value` exceeds the limit of the grade `good` or is not a number.
    fn assess(&mut self, value: f64, [good, usable]: [f64; 2], finding: impl Fn() -> String) {
        if value > good || value.is_nan() {
            let grade = if value <= usable {
                Grade::Usable
            } else {
                Grade::Refused
            };
            self.findings.push((grade, finding()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    fn reprojection(rms: f64) -> Reprojection {
        Reprojection {
            rms,
            sigma: 0.1 * rms,
            median: rms,
            max: 2.0 * rms,
            mean: DVec2::ZERO,
            corners: 400,
            unseen: 0,
        }
    }

    #[test]
    fn corners_out_of_sight_are_named_instead_of_an_error() {
        let mut measured = measured();
        measured.by_tracker = Some(Reprojection {
            rms: f64::NAN,
            corners: 0,
            unseen: 400,
            ..reprojection(1.0)
        });
        let assessment = Assessment::from_measurements(&measured);
        assert_eq!(assessment.grade(), Grade::Refused);
        let text = &assessment.findings[0].1;
        assert!(text.contains("400 of 400 corners"), "{text}");
        assert!(text.contains("calibrate tracker"), "{text}");
        let figures = assessment.lines.join(" ");
        assert!(
            !figures.contains("NaN") && !figures.contains("10000"),
            "{figures}"
        );
    }

    fn measured() -> Measurements {
        Measurements {
            by_tracker: Some(reprojection(0.6)),
            leave_one_out: Some(reprojection(0.2)),
            has_tracker: true,
            has_environment: true,
            colours: Some(Colours {
                delta_e: 1.2,
                percentile_90: 3.0,
                counts: (500, 20),
                provenance: Provenance::Chart,
            }),
            latency: Some(Ok(ClockOffset {
                seconds: 0.009,
                sigma: 0.0004,
                correlation: 0.99,
                samples: 300,
            })),
            calibrated_offset: 0.008,
        }
    }

    #[test]
    fn correct_rig_is_graded_good() {
        let assessment = Assessment::from_measurements(&measured());
        assert_eq!(assessment.grade(), Grade::Good, "{assessment:?}");
        assert_eq!(assessment.lines.len(), 4);
    }

    #[test]
    fn each_bad_figure_is_reported_with_its_remedy() {
        type Spoil = fn(&mut Measurements);
        let cases: [(Spoil, Grade, &str); 6] = [
            (
                |m| m.by_tracker = Some(reprojection(2.0)),
                Grade::Usable,
                "calibrate tracker",
            ),
            (
                |m| m.by_tracker = None,
                Grade::Refused,
                "show the scene camera",
            ),
            (
                |m| m.leave_one_out = Some(reprojection(9.0)),
                Grade::Refused,
                "calibrate the map",
            ),
            (|m| m.colours = None, Grade::Usable, "turn the rig"),
            (
                |m| m.calibrated_offset = 0.03,
                Grade::Refused,
                "calibrate latency",
            ),
            (
                |m| m.latency = None,
                Grade::Usable,
                "the tracker sent no data",
            ),
        ];
        for (spoil, grade, message) in cases {
            let mut m = measured();
            spoil(&mut m);
            let assessment = Assessment::from_measurements(&m);
            assert_eq!(assessment.grade(), grade, "{message}");
            let is_reported = assessment.findings.iter().any(|f| f.1.contains(message));
            assert!(is_reported, "{message}: {:?}", assessment.findings);
        }
    }
}
