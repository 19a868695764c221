//! Calibrated lenses, which replace those of `rig.json`.

use crate::CalibrationFileError;
use crate::RigDocument;
use crate::lens_record::LensRecord;
use penumbra_camera::EnvironmentView;
use penumbra_camera::PinholeCamera;
use penumbra_camera::{Lens, LensModel};

/// Lens file of the scene camera, beside `rig.json`.
pub const SCENE_LENS: &str = "calibration/scene_camera.json";
/// Lens file of the environment camera.
pub const ENVIRONMENT_LENS: &str = "calibration/environment_camera.json";

/// Applies the existing lens files to `rig`.
///
/// # Errors
/// A file is invalid, was refused when it was made, or does not match the rig.
pub fn apply_lens_files<'a>(
    rig: &mut RigDocument,
    attachments: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<(), CalibrationFileError> {
    if let Some(bytes) = attachments(SCENE_LENS) {
        let (lens, record) = usable(SCENE_LENS, bytes)?;
        let scene_camera = &mut rig.calibration.scene_camera;
        let camera = &mut scene_camera.camera;
        *camera = pinhole(SCENE_LENS, &lens, Some(camera))?;
        scene_camera.spread = record.spread(SCENE_LENS)?;
    }
    if let Some(bytes) = attachments(ENVIRONMENT_LENS) {
        let (lens, record) = usable(ENVIRONMENT_LENS, bytes)?;
        let Some(environment) = &mut rig.calibration.environment else {
            return Ok(());
        };
        match &mut environment.view {
            EnvironmentView::Fisheye { lens: fisheye, .. } => {
                fits(ENVIRONMENT_LENS, &lens, (fisheye.width, fisheye.height))?;
                if lens.model != LensModel::KannalaBrandt {
                    return Err(unusable(
                        ENVIRONMENT_LENS,
                        "rig.json has a fisheye; calibrate with --model fisheye",
                    ));
                }
                fisheye.focal = (lens.focal.x * lens.focal.y).sqrt();
                fisheye.centre = lens.centre;
                fisheye.distortion.copy_from_slice(&lens.coefficients[..4]);
                // Beyond this angle the calibration is an extrapolation; rig.json may limit the angle further.
                fisheye.max_theta = record
                    .max_theta
                    .map_or(fisheye.max_theta, |k| k.min(fisheye.max_theta));
            }
            EnvironmentView::Sphere { camera, .. } => {
                *camera = pinhole(ENVIRONMENT_LENS, &lens, Some(camera))?;
            }
            EnvironmentView::SphereInScene { .. } => {}
        }
    }
    Ok(())
}

/// Returns the picture size (width, height) with which the scene camera was calibrated, if it was.
///
/// # Errors
/// The file is invalid.
pub(crate) fn size_of_lens<'a>(
    attachments: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<Option<(u32, u32)>, CalibrationFileError> {
    let lens = attachments(SCENE_LENS).map(|bytes| usable(SCENE_LENS, bytes));
    Ok(lens.transpose()?.map(|(lens, _)| (lens.width, lens.height)))
}

/// Reads a lens and its record; rejects a refused calibration.
fn usable(file: &str, bytes: &[u8]) -> Result<(Lens, LensRecord), CalibrationFileError> {
    let record = LensRecord::parse(file, bytes)?;
    if record
        .quality
        .as_ref()
        .is_some_and(|q| q.verdict == "refused")
    {
        return Err(unusable(
            file,
            "was refused when it was made; calibrate again, or remove it",
        ));
    }
    Ok((record.lens(file)?, record))
}

fn pinhole(
    file: &str,
    lens: &Lens,
    current: Option<&PinholeCamera>,
) -> Result<PinholeCamera, CalibrationFileError> {
    if let Some(current) = current {
        fits(file, lens, (current.width, current.height))?;
    }
    lens.as_pinhole().ok_or_else(|| {
        unusable(
            file,
            "the compositor supports Brown-Conrady lenses with k1, k2, p1, p2, k3; calibrate with --model brown",
        )
    })
}

fn fits(file: &str, lens: &Lens, (width, height): (u32, u32)) -> Result<(), CalibrationFileError> {
    if (lens.width, lens.height) == (width, height) {
        return Ok(());
    }
    Err(unusable(
        file,
        &format!(
            "is of pictures of {}×{}, rig.json's are {width}×{height}; calibrate in the mode that is used",
            lens.width, lens.height
        ),
    ))
}

fn unusable(file: &str, reason: &str) -> CalibrationFileError {
    CalibrationFileError::Unusable {
        file: file.to_owned(),
        reason: reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    const FISHEYE: &str = r#"{
        "scene_camera": {"image_size": [640, 480],
                         "K": [[700.0, 0, 320.0], [0, 701.0, 240.0], [0, 0, 1]]},
        "environment_camera": {
            "kind": "fisheye", "image_size": [600, 600],
            "T_world_cam": {"position": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]},
            "projection": {"model": "equidistant", "f": 165.0, "cx": 299.5, "cy": 299.5,
                           "max_theta_rad": 1.5}}}"#;

    fn file(model: LensModel, size: (u32, u32)) -> Vec<u8> {
        let mut lens = Lens::ideal(model, size, DVec2::splat(500.0), DVec2::new(321.0, 239.0));
        lens.coefficients[0] = -0.2;
        serde_json::to_vec(&LensRecord::from_lens(&lens, "scene", String::new())).unwrap()
    }

    fn applied(bytes: &[u8]) -> Result<RigDocument, CalibrationFileError> {
        let mut rig = RigDocument::uncalibrated(640, 480);
        apply_lens_files(&mut rig, &|name| (name == SCENE_LENS).then_some(bytes))?;
        Ok(rig)
    }

    #[test]
    fn calibrated_lens_replaces_that_of_rig_json() {
        let rig = applied(&file(LensModel::Brown, (640, 480))).unwrap();
        let camera = &rig.calibration.scene_camera.camera;
        assert_eq!((camera.focal.x, camera.distortion[0]), (500.0, -0.2));
    }

    #[test]
    fn sharpness_of_the_lens_file_is_that_of_the_camera() {
        let with = |sharpness: &str| {
            let bytes = String::from_utf8(file(LensModel::Brown, (640, 480))).unwrap();
            let given = format!("\"sigma\":{{}},\"sharpness\":{sharpness}");
            bytes.replacen("\"sigma\":{}", &given, 1).into_bytes()
        };
        let rig = applied(&with(
            r#"{"across":[0.5,0.2,0.05],"down":[0.6,0.2,0.0],"mtf50":[0.3,0.35],"edges":90}"#,
        ));
        let spread = rig.unwrap().calibration.scene_camera.spread.unwrap();
        assert_eq!(spread.across, [0.5, 0.2, 0.05]);
        let plain = applied(&file(LensModel::Brown, (640, 480))).unwrap();
        assert_eq!(plain.calibration.scene_camera.spread, None);
        let wrong = r#"{"across":[0.5,0.9,0.05],"down":[1.0,0.0,0.0],"mtf50":[0,0],"edges":1}"#;
        let error = applied(&with(wrong)).unwrap_err().to_string();
        assert!(
            error.starts_with(SCENE_LENS) && error.contains("`sharpness`"),
            "{error}"
        );
    }

    #[test]
    fn fisheye_is_limited_to_its_calibrated_angle() {
        let (size, focal) = ((600, 600), DVec2::splat(165.0));
        let lens = Lens::ideal(LensModel::KannalaBrandt, size, focal, DVec2::splat(299.5));
        let record = |max_theta| {
            let record = LensRecord::from_lens(&lens, "environment", String::new());
            serde_json::to_vec(&LensRecord {
                max_theta,
                ..record
            })
            .unwrap()
        };
        let applied = |bytes: &[u8]| -> Result<f64, CalibrationFileError> {
            let mut rig = RigDocument::parse(FISHEYE.as_bytes()).unwrap();
            apply_lens_files(&mut rig, &|name| {
                (name == ENVIRONMENT_LENS).then_some(bytes)
            })?;
            match rig.calibration.environment.map(|e| e.view) {
                Some(EnvironmentView::Fisheye { lens, .. }) => Ok(lens.max_theta),
                _ => unreachable!(),
            }
        };
        let model_angle = applied(&record(None)).unwrap();
        assert_eq!(
            applied(&record(Some(model_angle - 0.2))).unwrap(),
            model_angle - 0.2
        );
        assert_eq!(
            applied(&record(Some(model_angle + 0.2))).unwrap(),
            model_angle
        );
        for wrong in [0.0, -1.0, 4.0] {
            let error = applied(&record(Some(wrong))).unwrap_err().to_string();
            assert!(error.contains("max_theta"), "{error}");
        }
    }

    #[test]
    fn rejects_mismatched_files_with_one_line() {
        let refused = file(LensModel::Brown, (640, 480));
        let refused = String::from_utf8(refused).unwrap().replacen(
            "\"sigma\":{}",
            "\"sigma\":{},\"quality\":{\"verdict\":\"refused\",\"findings\":[],\"rms\":9.0,\
             \"views\":[1,2],\"corners\":[3,4],\"coverage\":0.1,\"projection_sigma\":[1.0,2.0]}",
            1,
        );
        for (bytes, expected_text) in [
            (file(LensModel::KannalaBrandt, (640, 480)), "--model brown"),
            (
                file(LensModel::Brown, (1280, 960)),
                "1280×960, rig.json's are 640×480",
            ),
            (refused.into_bytes(), "was refused"),
            (b"{".to_vec(), "line 1"),
        ] {
            let error = applied(&bytes).unwrap_err().to_string();
            assert!(
                error.starts_with(SCENE_LENS) && error.contains(expected_text),
                "{error}"
            );
        }
    }
}
