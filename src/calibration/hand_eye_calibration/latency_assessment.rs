//! Grades and describes the latencies found.

use super::latency::{LatencyStep, Offsets};
use crate::latency::ClockOffset;
use crate::summary::Findings;
use penumbra_rig_model::Grade;

/// Maximum 1σ of a good offset, seconds.
const GOOD: f64 = 0.001;
/// Maximum 1σ of a usable offset, seconds.
const USABLE: f64 = 0.0025;

impl LatencyStep {
    pub(super) fn assess(&self, offsets: Option<&Offsets>) -> Findings {
        let mut findings = Findings::new();
        if let Some(missing) = self.readings.missing() {
            findings.push((Grade::Refused, missing));
            return findings;
        }
        let Some(offsets) = offsets else {
            let none = "there are no pictures of the scene camera; record it".to_owned();
            return vec![(Grade::Refused, none)];
        };
        match &offsets.scene {
            Err(error) => findings.push((Grade::Refused, format!("scene camera: {error}"))),
            Ok((found, _)) => findings.extend(uncertain("scene camera", found)),
        }
        if let (Ok((found, by)), Some((check, other))) = (&offsets.scene, &offsets.check) {
            let difference = (found.seconds - check.seconds).abs();
            let sigma = found.sigma.hypot(check.sigma);
            if difference > 0.004 && difference > 4.0 * sigma {
                findings.push((
                    Grade::Usable,
                    format!(
                        "the offset is {1:.1} ms from {0} but {3:.1} ms from {2}; the first is used; record again, rotating the rig in place",
                        by.name(), 1e3 * found.seconds, other.name(), 1e3 * check.seconds
                    ),
                ));
            }
        }
        match &offsets.environment {
            Some(Ok(found)) => findings.extend(uncertain("environment camera", found)),
            Some(Err(error)) => {
                findings.push((Grade::Usable, format!("environment camera: {error}")));
            }
            None => {}
        }
        findings
    }

    pub(super) fn lines(&self, offsets: &Offsets) -> Vec<String> {
        let mut lines = Vec::new();
        if let Ok((found, method)) = &offsets.scene {
            let tracker = found.seconds + self.scene_latency();
            lines.push(format!(
                "tracker latency: {:.2} ± {:.2} ms (assuming the calibrated {:.1} ms of the scene camera), from {} of {} pictures; correlation {:.3}",
                1e3 * tracker, 1e3 * found.sigma, 1e3 * self.scene_latency(), method.name(),
                found.samples, found.correlation
            ));
            if let Some((check, other)) = &offsets.check {
                lines.push(format!(
                    "tracker latency from {} instead: {:.2} ± {:.2} ms",
                    other.name(),
                    1e3 * (check.seconds + self.scene_latency()),
                    1e3 * check.sigma
                ));
            }
            match &offsets.environment {
                Some(Ok(e)) => lines.push(format!(
                    "environment camera latency: {:.2} ± {:.2} ms; correlation {:.3}",
                    1e3 * (tracker - e.seconds),
                    1e3 * e.sigma.hypot(found.sigma),
                    e.correlation
                )),
                None if self.environment.pictures > 0 => lines.push(
                    "environment camera: it does not move, so its pictures cannot be compared with the tracker; its latency is unchanged".to_owned(),
                ),
                _ => {}
            }
        }
        lines
    }
}

/// Returns a finding if an offset is not good.
fn uncertain(camera: &str, found: &ClockOffset) -> Option<(Grade, String)> {
    let grade = match found.sigma {
        s if s <= GOOD && found.correlation >= 0.8 => return None,
        s if s <= USABLE => Grade::Usable,
        _ => Grade::Refused,
    };
    Some((
        grade,
        format!(
            "{camera}: the offset has a standard deviation of {:.1} ms (correlation {:.2}); rotate the rig briskly and irregularly for half a minute",
            1e3 * found.sigma,
            found.correlation
        ),
    ))
}
