//! Radiometric calibration: tone curves, vignetting, noise and gains, which replace those of `rig.json`.

use crate::CalibrationFileError;
use crate::Header;
use crate::RigDocument;
use crate::header::parse;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::EnvironmentView;
use penumbra_camera::Response;
use penumbra_camera::Vignetting;
use penumbra_camera::look::NOISE_LAGS;
use penumbra_camera::{CameraNoise, NoiseTexture};
use penumbra_white_balance::{CalibratedGains, GainEstimate};
use serde::{Deserialize, Serialize};

/// Name of the file, beside `rig.json`.
pub const RADIOMETRIC: &str = "calibration/radiometric.json";
/// Name of the file in earlier versions.
const OLD_NAME: &str = "calibration/photometric.json";
/// The calibration step.
pub const STEP: &str = "radiometric";

/// The file.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct RadiometricRecord {
    /// Step, date, source, quality.
    #[serde(flatten)]
    pub header: Header,
    /// The scene camera.
    #[serde(default, skip_serializing_if = "CameraRecord::is_empty")]
    pub scene_camera: CameraRecord,
    /// The environment camera.
    #[serde(default, skip_serializing_if = "CameraRecord::is_empty")]
    pub environment_camera: CameraRecord,
    /// Gains between them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gains: Option<GainsRecord>,
}

/// Radiometric calibration of one camera; missing parts keep the values of `rig.json`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct CameraRecord {
    /// Tone curve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub response: Option<ResponseRecord>,
    /// Vignetting.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vignetting: Option<VignettingRecord>,
    /// Noise of a pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseRecord>,
    /// Colours of a chart; stated only, the rig does not use them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colours: Option<ColoursRecord>,
}

/// A camera's colours of a chart, compared with the chart's reference.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct ColoursRecord {
    /// Mean CIEDE2000 with the exposure corrected.
    pub delta_e_as_shown: f64,
    /// The same, white balanced on the grey row.
    pub delta_e_balanced: f64,
    /// The same, with `matrix`.
    pub delta_e_matrix: f64,
    /// reference = matrix × camera, linear, row by row.
    pub matrix: [[f64; 3]; 3],
}

impl CameraRecord {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// A tone curve.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct ResponseRecord {
    /// Linear values of the 256 codes, ascending from 0 to 1.
    pub linear_from_code: Vec<f32>,
    /// Relative standard error of each.
    #[serde(default)]
    pub relative_sigma: Vec<f32>,
}

/// Relative brightness 1 + k1 ρ² + k2 ρ⁴ + k3 ρ⁶, ρ the distance from `centre` in units of `radius`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct VignettingRecord {
    /// Width of the pictures, pixels.
    pub width: u32,
    /// Height of the pictures, pixels.
    pub height: u32,
    /// Centre, pixels.
    pub centre: [f64; 2],
    /// Radius at which ρ is 1, pixels.
    pub radius: f64,
    /// k1, k2, k3.
    pub coefficients: [f64; 3],
    /// Their standard errors.
    pub sigma: [f64; 3],
}

/// Noise: variance of a pixel = read + shot × value; linear, full scale 1.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct NoiseRecord {
    /// Variance of the read noise, per channel.
    pub read: [f64; 3],
    /// Its standard error.
    pub read_sigma: [f64; 3],
    /// Variance of the shot noise per linear value, per channel.
    pub shot: [f64; 3],
    /// Its standard error.
    pub shot_sigma: [f64; 3],
    /// Correlation between pixels and channels; independent noise without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<NoiseTextureRecord>,
}

/// Correlation of noise of unit variance, of luma Y and the differences B − Y and R − Y.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct NoiseTextureRecord {
    /// Correlation with the first, second, ... pixel to the right.
    pub across: [[f64; NOISE_LAGS]; 3],
    /// The same, downwards.
    pub down: [[f64; NOISE_LAGS]; 3],
    /// Covariance of the three.
    pub covariance: [[f64; 3]; 3],
}

/// Gains: scene = rgb × environment, linear.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct GainsRecord {
    /// Gain per channel.
    pub rgb: [f64; 3],
    /// Relative standard error of each.
    pub relative_sigma: [f64; 3],
    /// How they were found: "chart", "grey card", "overlap", or "exposures of one camera".
    pub method: String,
    /// Exposure time × gain of scene and environment camera during the calibration, seconds, if the
    /// cameras report it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposures: Option<[f64; 2]>,
    /// Colour matrix: scene = matrix × environment, row by row, if the cameras differ by more than gains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matrix: Option<[[f64; 3]; 3]>,
}

/// Applies the file, if it exists, to `rig`.
///
/// # Errors
/// The file is invalid, was refused when it was made, or has values that no camera can have.
pub fn apply_radiometric_file<'a>(
    rig: &mut RigDocument,
    attachments: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<(), CalibrationFileError> {
    if attachments(OLD_NAME).is_some() {
        return Err(CalibrationFileError::Unusable {
            file: OLD_NAME.to_owned(),
            reason: format!(
                "the step is now called `{STEP}`; rename the file to {RADIOMETRIC} and its \"step\" \
                 to \"{STEP}\", or calibrate again"
            ),
        });
    }
    let Some(bytes) = attachments(RADIOMETRIC) else {
        return Ok(());
    };
    let record: RadiometricRecord = parse(RADIOMETRIC, bytes)?;
    record.header.check(RADIOMETRIC, STEP)?;
    let rig = &mut rig.calibration;
    if let Some(response) = response(&record.scene_camera)? {
        rig.scene_camera.response = response;
    }
    rig.scene_camera.noise = noise(&record.scene_camera)?;
    if let Some(environment) = &mut rig.environment {
        if let Some(response) = response(&record.environment_camera)? {
            environment.response = response;
        }
        let size = match &environment.view {
            EnvironmentView::Fisheye { lens, .. } => Some((lens.width, lens.height)),
            EnvironmentView::Sphere { camera, .. } => Some((camera.width, camera.height)),
            EnvironmentView::SphereInScene { .. } => None,
        };
        environment.vignetting = vignetting(&record.environment_camera, size)?;
    }
    let camera = &rig.scene_camera.camera;
    let size = Some((camera.width, camera.height));
    rig.scene_camera.vignetting = vignetting(&record.scene_camera, size)?;
    // A sphere in the scene camera's picture is observed by that camera.
    if let Some(environment) = &mut rig.environment
        && matches!(environment.view, EnvironmentView::SphereInScene { .. })
    {
        environment.response = rig.scene_camera.response.clone();
        environment.vignetting = rig.scene_camera.vignetting;
    }
    rig.gains = record.gains.as_ref().map(gains).transpose()?;
    Ok(())
}

fn response(camera: &CameraRecord) -> Result<Option<Response>, CalibrationFileError> {
    let Some(record) = &camera.response else {
        return Ok(None);
    };
    Response::from_table(&record.linear_from_code)
        .map(Some)
        .map_err(|e| unusable(&e.to_string()))
}

/// Largest variance of read noise, and of shot noise per linear value: a standard deviation of a
/// tenth and of a third of white.
const MAX_NOISE: [f64; 2] = [0.01, 0.1];

fn noise(camera: &CameraRecord) -> Result<Option<CameraNoise>, CalibrationFileError> {
    let Some(record) = &camera.noise else {
        return Ok(None);
    };
    let wrong = |key, expected| CalibrationFileError::Wrong {
        file: RADIOMETRIC.to_owned(),
        key,
        expected,
    };
    let all_within =
        |values: &[f64], low: f64, high: f64| values.iter().all(|v| (low..=high).contains(v));
    if !all_within(&record.read, 0.0, MAX_NOISE[0]) {
        return Err(wrong(
            "scene_camera.noise.read",
            "three variances from 0 to 0.01",
        ));
    }
    if !all_within(&record.shot, 0.0, MAX_NOISE[1]) {
        return Err(wrong(
            "scene_camera.noise.shot",
            "three variances per linear value from 0 to 0.1",
        ));
    }
    let texture = match &record.texture {
        None => NoiseTexture::WHITE,
        Some(t) => {
            let lags = [t.across, t.down].concat().concat();
            let variances = [0, 1, 2].map(|i| t.covariance[i][i]);
            let is_possible = all_within(&lags, -1.0, 1.0)
                && all_within(&variances, 0.0, 2.0)
                && all_within(&t.covariance.concat(), -2.0, 2.0);
            if !is_possible {
                return Err(wrong(
                    "scene_camera.noise.texture",
                    "correlations from -1 to 1, with variances from 0 to 2",
                ));
            }
            NoiseTexture {
                across: t.across,
                down: t.down,
                covariance: t.covariance,
            }
        }
    };
    Ok(Some(CameraNoise {
        read: record.read,
        shot: record.shot,
        texture,
    }))
}

fn vignetting(
    camera: &CameraRecord,
    size: Option<(u32, u32)>,
) -> Result<Option<Vignetting>, CalibrationFileError> {
    let (Some(record), Some(size)) = (&camera.vignetting, size) else {
        return Ok(None);
    };
    if (record.width, record.height) != size {
        return Err(unusable(&format!(
            "its vignetting is of pictures of {}×{}, rig.json's are {}×{}; calibrate in the mode \
             that is used",
            record.width, record.height, size.0, size.1
        )));
    }
    let found = Vignetting {
        centre: DVec2::from_array(record.centre),
        radius: record.radius,
        coefficients: record.coefficients,
        sigma: record.sigma,
    };
    found
        .is_possible(size)
        .then_some(Some(found))
        .ok_or_else(|| {
            unusable("no lens has its vignetting (0.02 to 2 over the picture); calibrate again")
        })
}

fn gains(record: &GainsRecord) -> Result<CalibratedGains, CalibrationFileError> {
    let estimate = GainEstimate {
        gains: DVec3::from_array(record.rgb),
        relative_sd: DVec3::from_array(record.relative_sigma),
    };
    let matrix = record
        .matrix
        .map(|rows| DMat3::from_cols_array_2d(&rows).transpose());
    let range = 1e-6..1e6;
    let sane = record.rgb.iter().all(|g| range.contains(g))
        && record
            .relative_sigma
            .iter()
            .all(|s| (0.0..10.0).contains(s))
        && record
            .exposures
            .iter()
            .flatten()
            .all(|e| (1e-9..1e6).contains(e))
        && matrix.is_none_or(|m| m.is_finite());
    if !sane {
        return Err(unusable(
            "its gains are not positive numbers; calibrate again",
        ));
    }
    Ok(CalibratedGains {
        estimate,
        matrix,
        exposures: record.exposures,
    })
}

fn unusable(reason: &str) -> CalibrationFileError {
    CalibrationFileError::Unusable {
        file: RADIOMETRIC.to_owned(),
        reason: reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_camera::PinholeCamera;

    const HEAD: &str = "\"penumbra_calibration\":1,\"step\":\"radiometric\",\"date\":\"\",\
                        \"verdict\":\"good\"";

    fn applied(rest: &str) -> Result<RigDocument, String> {
        let bytes = format!("{{{HEAD},{rest}}}").into_bytes();
        let mut rig = RigDocument::uncalibrated(640, 480);
        apply_radiometric_file(&mut rig, &|name| {
            (name == RADIOMETRIC).then_some(bytes.as_slice())
        })
        .map_err(|e| e.to_string())?;
        Ok(rig)
    }

    #[test]
    fn calibrated_values_replace_those_of_rig_json() {
        let table: Vec<String> = (0..256)
            .map(|i| format!("{}", f64::from(i) / 255.0))
            .collect();
        let rig = applied(&format!(
            "\"scene_camera\":{{\"response\":{{\"linear_from_code\":[{}]}}}},\
             \"gains\":{{\"rgb\":[1.5,1,2],\"relative_sigma\":[0.01,0.01,0.02],\"method\":\"chart\"}}",
            table.join(",")
        ))
        .unwrap();
        let camera: &PinholeCamera = &rig.calibration.scene_camera.camera;
        assert_eq!(camera.width, 640);
        let code = rig.calibration.scene_camera.response.code_from_linear(0.5);
        assert_eq!(code, 128);
        let gains = rig.calibration.gains.unwrap();
        assert_eq!(gains.estimate.gains, DVec3::new(1.5, 1.0, 2.0));
    }

    #[test]
    fn rejects_old_file_name_with_the_new_one() {
        let mut rig = RigDocument::uncalibrated(640, 480);
        let error = apply_radiometric_file(&mut rig, &|name| {
            (name == "calibration/photometric.json").then_some(b"{}".as_slice())
        })
        .unwrap_err()
        .to_string();
        assert!(
            error.starts_with("calibration/photometric.json: "),
            "{error}"
        );
        assert!(error.contains(RADIOMETRIC), "{error}");
    }

    #[test]
    fn noise_is_that_of_the_scene_camera() {
        let with = |read: &str, texture: &str| {
            applied(&format!(
                "\"scene_camera\":{{\"noise\":{{\"read\":[{read}],\"read_sigma\":[0,0,0],\
                 \"shot\":[1e-4,1e-4,2e-4],\"shot_sigma\":[0,0,0]{texture}}}}}"
            ))
        };
        let rig = with("1e-5,1e-5,2e-5", "").unwrap();
        let noise = rig.calibration.scene_camera.noise.unwrap();
        assert_eq!((noise.read[2], noise.texture), (2e-5, NoiseTexture::WHITE));
        let error = with("1e-5,-1,2e-5", "").unwrap_err();
        assert!(error.contains("`scene_camera.noise.read`") && error.contains("0 to 0.01"));
        let lags = "[[2,0,0,0,0,0,0],[0,0,0,0,0,0,0],[0,0,0,0,0,0,0]]";
        let texture = format!(
            ",\"texture\":{{\"across\":{lags},\"down\":{lags},\
             \"covariance\":[[1,0,0],[0,1,0],[0,0,1]]}}"
        );
        let error = with("1e-5,1e-5,2e-5", &texture).unwrap_err();
        assert!(error.contains("`scene_camera.noise.texture`"), "{error}");
    }

    #[test]
    fn rejects_impossible_values_with_one_line() {
        for (rest, expected_text) in [
            (
                "\"scene_camera\":{\"response\":{\"linear_from_code\":[0,1]}}",
                "has 2 values",
            ),
            (
                "\"gains\":{\"rgb\":[1,-1,1],\"relative_sigma\":[0,0,0],\"method\":\"chart\"}",
                "positive",
            ),
            (
                "\"scene_camera\":{\"vignetting\":{\"width\":64,\"height\":48,\"centre\":[32,24],\
                 \"radius\":40,\"coefficients\":[-0.2,0,0],\"sigma\":[0,0,0]}}",
                "64×48, rig.json's are 640×480",
            ),
            (
                "\"scene_camera\":{\"vignetting\":{\"width\":640,\"height\":480,\"centre\":[320,240],\
                 \"radius\":400,\"coefficients\":[-3,0,0],\"sigma\":[0,0,0]}}",
                "no lens",
            ),
        ] {
            let error = applied(rest).unwrap_err();
            assert!(
                error.starts_with(RADIOMETRIC) && error.contains(expected_text),
                "{error}"
            );
        }
    }
}
