//! Whether a mounting is good enough.

use super::Findings;
use super::mounting::{Mounted, MountingStep};
use penumbra_rig_model::Grade;

/// The camera's place on the sensor is good, and of use, up to these (1σ, metres and radians).
const GOOD: (f64, f64) = (0.001, 0.001_75);
const USABLE: (f64, f64) = (0.005, 0.008_7);
/// What is left of positions is more than noise, metres.
const BENT: f64 = 0.006;
impl MountingStep {
    pub(super) fn judge(&self, mounted: &Mounted) -> Findings {
        let mut findings = Findings::new();
        let found = &mounted.hand_eye;
        let (turn, shift) = (
            found.sensor_sigma.0.max_element(),
            found.sensor_sigma.1.max_element(),
        );
        let text = format!(
            "the camera's place on the sensor is known to {:.1} mm and {:.2} degrees only; turn the rig more, by 30 degrees and more about all axes, for a minute",
            1e3 * shift,
            turn.to_degrees()
        );
        if shift.is_nan() || shift > USABLE.0 || turn > USABLE.1 {
            findings.push((Grade::Refused, text));
        } else if shift > GOOD.0 || turn > GOOD.1 {
            findings.push((Grade::Usable, text));
        }
        if let Some(error) = &mounted.latency_error {
            findings.push((
                Grade::Usable,
                format!("the latency could not be told from this motion ({error}); that of the calibration was taken"),
            ));
        }
        let used = found.used.iter().filter(|u| **u).count();
        let share = used as f64 / found.used.len().max(1) as f64;
        if share < 0.75 {
            findings.push((
                Grade::Usable,
                format!(
                    "{:.0} % of the poses contradict the others; look for markers that were moved, and for metal near the tracker",
                    100.0 * (1.0 - share)
                ),
            ));
        }
        findings.extend(self.judge_space(mounted));
        findings
    }

    fn judge_space(&self, mounted: &Mounted) -> Option<(Grade, String)> {
        let left = 1e3 * mounted.hand_eye.position_rms;
        match &mounted.field {
            Some(fit) if !fit.helps() => Some((
                Grade::Usable,
                format!(
                    "a map of distortion would not help: of what it has not learnt from it leaves {:.2} mm of {:.2} mm; none was written",
                    1e3 * fit.after.0,
                    1e3 * fit.before.0
                ),
            )),
            None if self.options.distortion => Some((
                Grade::Usable,
                "too few pairs of poses for a map of distortion; record a minute through the whole volume".to_owned(),
            )),
            None if mounted.hand_eye.position_rms > BENT => Some((
                Grade::Usable,
                format!("tracker and pictures differ by {left:.1} mm RMS: metal bends the tracker's space, or markers are not where the map says; try --distortion"),
            )),
            _ => None,
        }
    }
}
