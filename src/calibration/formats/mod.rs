//! Camera parameters in other programs' files: OpenCV's FileStorage YAML and XML, ROS's
//! `camera_info` YAML, Kalibr's camchain YAML and Basalt's JSON.
//!
//! `yaml` and `xml` parse the document, `fields` reads typed values from it; `opencv`, `ros` and
//! `kalibr` read and write the dialects; `basalt` reads its own.

mod basalt;
mod fields;
mod kalibr;
mod opencv;
mod ros;
mod xml;
mod yaml;

use fields::Fields;
use penumbra_camera::{Lens, LensModel};
use thiserror::Error;

/// Dialect of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Dialect {
    /// OpenCV's FileStorage, as its calibration samples write it.
    Opencv,
    /// ROS's camera_info, as camera_calibration writes it.
    Ros,
    /// Kalibr's camchain.
    Kalibr,
}

/// One camera of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedLens {
    /// Name in the file.
    pub name: String,
    /// The lens.
    pub lens: Lens,
}

/// Errors of reading or writing a file. Each message names the place and the remedy.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum FormatError {
    /// The file is not valid in the supported subset of YAML or XML.
    #[error("line {line}: {reason}")]
    Syntax {
        /// Line number, from 1.
        line: usize,
        /// The problem.
        reason: &'static str,
    },
    /// The file is not Basalt's JSON.
    #[error("is not a calibration of Basalt: {message}")]
    Json {
        /// The problem and its position.
        message: String,
    },
    /// A required key is missing.
    #[error("key `{key}` is missing; add it ({expected})")]
    Missing {
        /// Path of the key from the root.
        key: String,
        /// Required value.
        expected: &'static str,
    },
    /// A value has the wrong type or range.
    #[error("line {line}: `{key}` must be {expected}")]
    Wrong {
        /// Line number, from 1.
        line: usize,
        /// Path of the key from the root.
        key: String,
        /// Required value.
        expected: &'static str,
    },
    /// The file has none of the dialects.
    #[error(
        "no camera found: expected OpenCV's camera_matrix, ROS's distortion_model, Kalibr's cam0 or Basalt's \
         value0"
    )]
    Unknown,
    /// The format cannot express the lens.
    #[error(
        "{dialect} cannot express {what}; calibrate with another model, or export to another format"
    )]
    Inexpressible {
        /// Name of the format.
        dialect: &'static str,
        /// Property of the lens that it cannot express.
        what: &'static str,
    },
}

type Result<T> = std::result::Result<T, FormatError>;

/// Reads all cameras of a file in any of the dialects. `size` is the pictures' size in
/// pixels, used where the file has none (OpenCV's stereo files).
///
/// # Errors
/// The text is not valid YAML, XML or JSON, has no camera, or a key is missing or has a wrong value.
pub fn read(text: &str, size: Option<(u32, u32)>) -> Result<Vec<NamedLens>> {
    if basalt::is_basalt(text) {
        return basalt::read(text);
    }
    let document = if text.trim_start().starts_with('<') {
        xml::parse(text)?
    } else {
        yaml::parse(text)?
    };
    let root = Fields::root(&document)?;
    if root.find("camera_model").is_some() || root.find("cam0").is_some() {
        kalibr::read(&root)
    } else if root.find("distortion_model").is_some() {
        Ok(vec![ros::read(&root)?])
    } else {
        opencv::read(&root, size)
    }
}

/// Writes cameras as a file. OpenCV and ROS files hold one camera: the first.
///
/// # Errors
/// The format cannot express the lens.
pub fn write(dialect: Dialect, cameras: &[NamedLens]) -> Result<String> {
    let first = cameras.first().ok_or(FormatError::Unknown)?;
    match dialect {
        Dialect::Opencv => Ok(opencv::write(first)),
        Dialect::Ros => Ok(ros::write(first)),
        Dialect::Kalibr => kalibr::write(cameras),
    }
}

/// Formats a number with enough digits that it reads back unchanged.
fn number(value: f64) -> String {
    format!("{value:?}")
}

fn numbers(values: &[f64]) -> String {
    let texts: Vec<String> = values.iter().map(|v| number(*v)).collect();
    texts.join(", ")
}

/// Returns the camera matrix: fx, 0, cx, 0, fy, cy, 0, 0, 1.
fn camera_matrix(lens: &Lens) -> [f64; 9] {
    let (f, c) = (lens.focal, lens.centre);
    [f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0]
}

/// Returns `lens` with this model and these coefficients, in the model's order; missing ones are
/// zero.
fn with_coefficients(mut lens: Lens, model: LensModel, coefficients: &[f64]) -> Lens {
    lens.model = model;
    lens.coefficients = [0.0; 8];
    for (slot, value) in lens.coefficients.iter_mut().zip(coefficients) {
        *slot = *value;
    }
    lens
}

#[cfg(test)]
mod tests;
