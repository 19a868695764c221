//! `[look]`: the camera's grain, sharpness, motion blur and depth of field on virtual objects.

use super::range::{Result, set, within};
use penumbra_camera::DepthOfField;
use penumbra_strict_toml::Fault;
use serde::Deserialize;
use std::ops::RangeInclusive;

/// Range of exposure times, milliseconds.
const EXPOSURE_MS: RangeInclusive<f64> = 0.01..=1000.0;
/// Range of diameters of an aperture, millimetres.
const APERTURE_MM: RangeInclusive<f64> = 0.01..=100.0;
/// Range of focus distances, metres.
const FOCUS_M: RangeInclusive<f64> = 0.05..=1000.0;

/// `[look]`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookConfig {
    /// Whether virtual objects and shadows get the noise that was calibrated.
    pub grain: bool,
    /// Whether they get the sharpness that was calibrated.
    pub softness: bool,
    /// Whether they are blurred by motion during the exposure.
    pub motion_blur: bool,
    /// Exposure time, seconds; overrides the one that the camera reports.
    pub exposure_seconds: Option<f64>,
    /// Depth of field, if it is switched on and stated.
    pub depth_of_field: Option<DepthOfField>,
}

impl Default for LookConfig {
    fn default() -> Self {
        Self {
            grain: true,
            softness: true,
            motion_blur: true,
            exposure_seconds: None,
            depth_of_field: None,
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct LookFile {
    pub grain: Option<bool>,
    pub softness: Option<bool>,
    pub motion_blur: Option<bool>,
    pub exposure_ms: Option<f64>,
    pub defocus: Option<bool>,
    pub aperture_mm: Option<f64>,
    pub focus_m: Option<f64>,
}

pub(super) fn look(file: &LookFile, out: &mut LookConfig) -> Result<()> {
    set(&mut out.grain, file.grain);
    set(&mut out.softness, file.softness);
    set(&mut out.motion_blur, file.motion_blur);
    let exposure = within("look.exposure_ms", file.exposure_ms, EXPOSURE_MS)?;
    out.exposure_seconds = exposure.map(|ms| ms * 1e-3);
    let aperture = within("look.aperture_mm", file.aperture_mm, APERTURE_MM)?;
    let focus = within("look.focus_m", file.focus_m, FOCUS_M)?;
    let stated = match (aperture, focus) {
        (Some(aperture), Some(focus)) => Some(DepthOfField {
            aperture: aperture * 1e-3,
            focus,
        }),
        (Some(_), None) => {
            return Err(Fault::new(
                "look.aperture_mm",
                "needs `focus_m`; add the distance that is in focus, metres",
            ));
        }
        (None, Some(_)) => {
            return Err(Fault::new(
                "look.focus_m",
                "needs `aperture_mm`; add the diameter of the aperture, millimetres",
            ));
        }
        (None, None) => None,
    };
    out.depth_of_field = stated.filter(|_| file.defocus.unwrap_or(true));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(file: LookFile) -> std::result::Result<LookConfig, Fault> {
        let mut config = LookConfig::default();
        look(&file, &mut config)?;
        Ok(config)
    }

    #[test]
    fn everything_is_on_and_nothing_is_stated_by_default() {
        let config = read(LookFile::default()).unwrap();
        assert_eq!(config, LookConfig::default());
        assert!(config.grain && config.softness && config.motion_blur);
        assert_eq!(config.depth_of_field, None);
    }

    #[test]
    fn rejects_impossible_exposure_and_aperture_by_key_and_range() {
        let exposure = |exposure_ms| LookFile {
            exposure_ms: Some(exposure_ms),
            ..LookFile::default()
        };
        let lens = |aperture_mm, focus_m| LookFile {
            aperture_mm,
            focus_m,
            ..LookFile::default()
        };
        for (file, key, range) in [
            (exposure(0.0), "look.exposure_ms", "0.01 to 1000"),
            (exposure(-8.0), "look.exposure_ms", "0.01 to 1000"),
            (exposure(f64::NAN), "look.exposure_ms", "0.01 to 1000"),
            (
                lens(Some(500.0), Some(1.0)),
                "look.aperture_mm",
                "0.01 to 100",
            ),
            (lens(Some(2.0), Some(0.0)), "look.focus_m", "0.05 to 1000"),
            (lens(Some(2.0), None), "look.aperture_mm", "needs `focus_m`"),
            (lens(None, Some(1.0)), "look.focus_m", "needs `aperture_mm`"),
        ] {
            let fault = format!("{:?}", read(file).unwrap_err());
            assert!(fault.contains(key) && fault.contains(range), "{fault}");
        }
        let stated = read(lens(Some(2.0), Some(0.8))).unwrap();
        let lens = stated.depth_of_field.unwrap();
        assert_eq!((lens.aperture, lens.focus), (2e-3, 0.8));
    }
}
