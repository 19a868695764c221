//! The file that a calibration leaves behind: what was found, how sure it is, of which
//! device and when.
//!
//! `calibration/scene_camera.json` and `calibration/environment_camera.json` beside a
//! `rig.json` take the place of the lens that `rig.json` says; a recording carries them.

use crate::CalibrationFileError;
use crate::DeviceRecord;
use glam::DVec2;
use penumbra_camera::{Lens, LensModel};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the format that is written; older ones can be read.
const VERSION: u32 = 1;
/// No such file is larger, bytes.
const LARGEST_FILE: usize = 1 << 20;
/// No parameter is larger.
const LARGEST: f64 = 1e6;
/// Pixels along a side.
const MOST_PIXELS: u32 = 65_536;

/// A camera's calibration, as it is written. Lengths are pixels, `sigma` is one standard
/// deviation.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct LensRecord {
    /// Version of this format.
    pub penumbra_calibration: u32,
    /// "scene" or "environment".
    pub camera: String,
    /// When, UTC, as ISO 8601.
    pub date: String,
    /// Which device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceRecord>,
    /// From what: a session or a folder.
    #[serde(default)]
    pub source: String,
    /// As `--board` has it.
    #[serde(default)]
    pub board: String,
    /// "brown", "brown-rational" or "fisheye".
    pub model: String,
    /// Width and height.
    pub image_size: [u32; 2],
    /// fx and fy.
    pub focal: [f64; 2],
    /// cx and cy.
    pub centre: [f64; 2],
    /// k1, ... by name.
    pub distortion: BTreeMap<String, f64>,
    /// The angle from the axis up to which a fisheye is known, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_theta: Option<f64>,
    /// Of fx, fy, cx, cy and the coefficients by name.
    #[serde(default)]
    pub sigma: BTreeMap<String, f64>,
    /// How good it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<QualityRecord>,
}

/// What speaks for and against it.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct QualityRecord {
    /// "good", "usable" or "refused".
    pub verdict: String,
    /// Why not good.
    pub findings: Vec<String>,
    /// Root mean square of the reprojection error.
    pub rms: f64,
    /// Views used, and all.
    pub views: [usize; 2],
    /// Corners used, and all.
    pub corners: [usize; 2],
    /// Share of the picture with corners in it.
    pub coverage: f64,
    /// Of a direction's picture, 1σ: in the middle and at worst.
    pub projection_sigma: [f64; 2],
}

impl LensRecord {
    /// Of a lens that other programs found.
    #[must_use]
    pub fn of_lens(lens: &Lens, camera: &str, date: String) -> Self {
        let names = lens.model.coefficients();
        let pairs = names.iter().zip(lens.coefficients);
        Self {
            penumbra_calibration: VERSION,
            camera: camera.to_owned(),
            date,
            device: None,
            source: String::new(),
            board: String::new(),
            model: lens.model.name().to_owned(),
            image_size: [lens.width, lens.height],
            focal: lens.focal.to_array(),
            centre: lens.centre.to_array(),
            distortion: pairs.map(|(n, v)| ((*n).to_owned(), v)).collect(),
            max_theta: None,
            sigma: BTreeMap::new(),
            quality: None,
        }
    }

    /// Reads the bytes of `file`.
    ///
    /// # Errors
    /// What is wrong and where, in one line.
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Self, CalibrationFileError> {
        if bytes.len() > LARGEST_FILE {
            return Err(CalibrationFileError::Unusable {
                file: file.to_owned(),
                reason: "more than 1 MiB: no calibration of a lens".to_owned(),
            });
        }
        let record: Self =
            serde_json::from_slice(bytes).map_err(|e| CalibrationFileError::NotJson {
                file: file.to_owned(),
                line: e.line(),
                column: e.column(),
                reason: e.to_string(),
            })?;
        record.lens(file)?;
        Ok(record)
    }

    /// The lens that it holds; `file` is for complaints.
    ///
    /// # Errors
    /// A version, a model or numbers that make no sense.
    pub fn lens(&self, file: &str) -> Result<Lens, CalibrationFileError> {
        let wrong = |key, expected| CalibrationFileError::Wrong {
            file: file.to_owned(),
            key,
            expected,
        };
        if self.penumbra_calibration != VERSION {
            return Err(wrong(
                "penumbra_calibration",
                "1: it is of a newer Penumbra",
            ));
        }
        let model = LensModel::of_name(&self.model)
            .ok_or_else(|| wrong("model", "\"brown\", \"brown-rational\" or \"fisheye\""))?;
        let [width, height] = self.image_size;
        if !(1..=MOST_PIXELS).contains(&width) || !(1..=MOST_PIXELS).contains(&height) {
            return Err(wrong("image_size", "[width, height] in pixels, 1 to 65536"));
        }
        let (focal, centre) = (DVec2::from(self.focal), DVec2::from(self.centre));
        if !(focal.min_element() > 0.0 && focal.max_element() <= LARGEST) {
            return Err(wrong("focal", "[fx, fy] in pixels, above 0"));
        }
        if !centre.is_finite() || centre.abs().max_element() > LARGEST {
            return Err(wrong("centre", "[cx, cy] in pixels"));
        }
        if self
            .max_theta
            .is_some_and(|t| !(t > 0.0 && t <= std::f64::consts::PI))
        {
            return Err(wrong("max_theta", "radians, above 0 and at most pi"));
        }
        let mut lens = Lens::ideal(model, (width, height), focal, centre);
        let names = model.coefficients();
        if self.distortion.keys().any(|k| !names.contains(&k.as_str())) {
            return Err(wrong(
                "distortion",
                "an object with the model's coefficients",
            ));
        }
        for (slot, name) in lens.coefficients.iter_mut().zip(names) {
            *slot = self.distortion.get(*name).copied().unwrap_or(0.0);
        }
        if lens.coefficients.iter().any(|k| k.abs() > LARGEST) {
            return Err(wrong("distortion", "an object of numbers of at most 1e6"));
        }
        Ok(lens)
    }
}

#[cfg(test)]
mod tests;
