//! Grades the figures of a check.

use super::colour::Colours;
use super::reprojection::Reprojection;
use crate::latency::{ClockOffset, LatencyError};
use penumbra_rig_model::Grade;
use penumbra_white_balance::Provenance;

/// Maximum RMS reprojection error, pixels: good, usable.
const REPROJECTION: [f64; 2] = [1.0, 3.0];
/// Minimum number of corners for a verdict.
const LEAST_CORNERS: usize = 80;
/// Maximum median CIEDE2000: good (hardly visible side by side), usable (plainly visible).
const COLOUR: [f64; 2] = [2.0, 5.0];
/// Maximum deviation from the calibrated latency, milliseconds: good, usable. A rotation of 60°/s
/// moves a typical picture by half a pixel in one millisecond.
const LATENCY: [f64; 2] = [2.0, 8.0];

/// The measurements of a check.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Reprojection error by the tracker's pose.
    pub tracked: Option<Reprojection>,
    /// Reprojection error of each marker by the others' pose.
    pub among: Option<Reprojection>,
    /// The rig has a tracker.
    pub has_tracker: bool,
    /// The rig has an environment camera of its own.
    pub has_environment: bool,
    /// Colour differences.
    pub colours: Option<Colours>,
    /// Clock offset between tracker and camera.
    pub latency: Option<Result<ClockOffset, LatencyError>>,
    /// Calibrated clock offset, seconds.
    pub calibrated_offset: f64,
}

/// Assessment of a check.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Judgement {
    /// Figures, one line each.
    pub lines: Vec<String>,
    /// Problems and their remedies.
    pub findings: Vec<(Grade, String)>,
}

impl Judgement {
    /// Grades the measurements.
    #[must_use]
    pub fn of(measured: &Measured) -> Self {
        let mut judgement = Self::default();
        judgement.reprojection(measured);
        judgement.colour(measured);
        judgement.latency(measured);
        judgement.findings.sort_by_key(|f| std::cmp::Reverse(f.0));
        judgement
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

    fn reprojection(&mut self, measured: &Measured) {
        let (found, by, what) = if measured.has_tracker {
            (
                measured.tracked,
                "tracker",
                "calibrate tracker and latency again; if the mean is far off, something was moved",
            )
        } else {
            (
                measured.among,
                "the other markers",
                "calibrate the map and the lens again; look for a marker that was moved",
            )
        };
        let Some(r) = found.filter(|r| r.corners >= LEAST_CORNERS) else {
            let corners = found.map_or(0, |r| r.corners);
            self.findings.push((
                Grade::Refused,
                format!(
                    "{corners} corners of known markers were seen with a pose by {by}, {LEAST_CORNERS} are \
                     needed: show the scene camera the rig's markers for a minute"
                ),
            ));
            return;
        };
        self.lines.push(format!(
            "markers by {by}: {:.2} ± {:.2} px RMS (median {:.2}, worst {:.1}; mean {:+.2}, {:+.2}; {} corners)",
            r.rms, r.sigma, r.median, r.worst, r.mean.x, r.mean.y, r.corners
        ));
        self.judge(r.rms, REPROJECTION, || {
            format!("markers are {:.2} px RMS beside their place; {what}", r.rms)
        });
        if measured.has_tracker
            && let Some(among) = measured.among
        {
            self.lines.push(format!(
                "markers by one another: {:.2} ± {:.2} px RMS ({} corners)",
                among.rms, among.sigma, among.corners
            ));
            self.judge(among.rms, REPROJECTION, || {
                format!(
                    "markers are {:.2} px RMS beside where the others say; calibrate the map and the lens again",
                    among.rms
                )
            });
        }
    }

    fn colour(&mut self, measured: &Measured) {
        if !measured.has_environment {
            self.lines
                .push("colour: one camera, nothing to compare".to_owned());
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
        let by = match c.by {
            Provenance::Calibrated => "the calibration",
            Provenance::Chart => "the colour chart",
            Provenance::Overlap => "what both saw before",
            Provenance::Reflectance => "known surfaces",
            Provenance::Fixed => "the configuration",
            Provenance::SameCamera | Provenance::GreyWorld | Provenance::Unknown => "nothing",
        };
        self.lines.push(format!(
            "colour by {by}: ΔE2000 {:.2} in the median, 9 of 10 under {:.2} ({} surfaces at {} moments)",
            c.delta_e, c.ninth, c.counts.0, c.counts.1
        ));
        self.judge(c.delta_e, COLOUR, || {
            format!(
                "the cameras' colours differ by ΔE2000 {:.1}; calibrate radiometric again, in this light",
                c.delta_e
            )
        });
    }

    fn latency(&mut self, measured: &Measured) {
        match &measured.latency {
            Some(Ok(found)) => {
                let off = 1e3 * (found.seconds - measured.calibrated_offset);
                self.lines.push(format!(
                    "latency: {:.2} ± {:.2} ms ({off:+.2} ms beside the calibrated; {} turns)",
                    1e3 * found.seconds,
                    1e3 * found.sigma,
                    found.samples
                ));
                // A deviation within the noise is no fault.
                self.judge(off.abs() - 2e3 * found.sigma, LATENCY, || {
                    format!("tracker and camera are {off:+.1} ms apart; calibrate latency again")
                });
            }
            Some(Err(error)) => self
                .findings
                .push((Grade::Usable, format!("latency was not measured: {error}"))),
            None if measured.has_tracker => self.findings.push((
                Grade::Usable,
                "latency was not measured: nothing came from the tracker".to_owned(),
            )),
            None => (),
        }
    }

    fn judge(&mut self, value: f64, [good, usable]: [f64; 2], finding: impl Fn() -> String) {
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
            worst: 2.0 * rms,
            mean: DVec2::ZERO,
            corners: 400,
        }
    }

    fn measured() -> Measured {
        Measured {
            tracked: Some(reprojection(0.6)),
            among: Some(reprojection(0.2)),
            has_tracker: true,
            has_environment: true,
            colours: Some(Colours {
                delta_e: 1.2,
                ninth: 3.0,
                counts: (500, 20),
                by: Provenance::Chart,
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
        let judgement = Judgement::of(&measured());
        assert_eq!(judgement.grade(), Grade::Good, "{judgement:?}");
        assert_eq!(judgement.lines.len(), 4);
    }

    #[test]
    fn each_bad_figure_names_its_remedy() {
        type Spoil = fn(&mut Measured);
        let cases: [(Spoil, Grade, &str); 6] = [
            (
                |m| m.tracked = Some(reprojection(2.0)),
                Grade::Usable,
                "calibrate tracker",
            ),
            (
                |m| m.tracked = None,
                Grade::Refused,
                "show the scene camera",
            ),
            (
                |m| m.among = Some(reprojection(9.0)),
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
                "nothing came from the tracker",
            ),
        ];
        for (spoil, grade, says) in cases {
            let mut m = measured();
            spoil(&mut m);
            let judgement = Judgement::of(&m);
            assert_eq!(judgement.grade(), grade, "{says}");
            let all = judgement.findings.iter().any(|f| f.1.contains(says));
            assert!(all, "{says}: {:?}", judgement.findings);
        }
    }
}
