//! Grades a mounting.

use super::mounting::{MountingResult, MountingStep};
use crate::summary::Findings;
use penumbra_rig_model::Grade;

/// Maximum 1σ of a good pose of the camera on the sensor, metres and radians.
const GOOD: (f64, f64) = (0.001, 0.001_75);
/// Maximum 1σ of a usable pose, metres and radians.
const USABLE: (f64, f64) = (0.005, 0.008_7);
/// RMS of the position residuals above which the tracker's space is distorted, metres.
const DISTORTED: f64 = 0.006;

impl MountingStep {
    pub(super) fn assess(&self, result: &MountingResult) -> Findings {
        let mut findings = Findings::new();
        let found = &result.hand_eye;
        let (rotation, translation) = (
            found.sensor_sigma.0.max_element(),
            found.sensor_sigma.1.max_element(),
        );
        let text = format!(
            "the camera's pose on the sensor has standard deviations of {:.1} mm and {:.2} degrees; rotate the rig by 30 degrees or more about all axes for a minute",
            1e3 * translation,
            rotation.to_degrees()
        );
        if translation.is_nan() || translation > USABLE.0 || rotation > USABLE.1 {
            findings.push((Grade::Refused, text));
        } else if translation > GOOD.0 || rotation > GOOD.1 {
            findings.push((Grade::Usable, text));
        }
        if let Some(error) = &result.latency_error {
            findings.push((
                Grade::Usable,
                format!("the latency could not be estimated from this motion ({error}); the calibrated one was used"),
            ));
        }
        let used = found.used.iter().filter(|u| **u).count();
        let share = used as f64 / found.used.len().max(1) as f64;
        if share < 0.75 {
            findings.push((
                Grade::Usable,
                format!(
                    "{:.0} % of the poses are inconsistent with the others; check for moved markers and for metal near the tracker",
                    100.0 * (1.0 - share)
                ),
            ));
        }
        findings.extend(self.assess_distortion(result));
        findings
    }

    fn assess_distortion(&self, result: &MountingResult) -> Option<(Grade, String)> {
        let rms = 1e3 * result.hand_eye.position_rms;
        match &result.field {
            Some(fit) if !fit.helps() => Some((
                Grade::Usable,
                format!(
                    "a distortion map would not help and was not written: the residual of held-out poses is {:.2} mm with it, {:.2} mm without",
                    1e3 * fit.after.0,
                    1e3 * fit.before.0
                ),
            )),
            None if self.options.distortion => Some((
                Grade::Usable,
                "too few pairs of poses for a distortion map; record a minute of motion through the entire volume".to_owned(),
            )),
            None if result.hand_eye.position_rms > DISTORTED => Some((
                Grade::Usable,
                format!("tracker and pictures differ by {rms:.1} mm RMS: metal distorts the tracker's field, or the map's marker positions are wrong; try --distortion"),
            )),
            _ => None,
        }
    }
}
