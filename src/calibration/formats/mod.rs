//! Cameras' parameters in other programs' files: OpenCV's FileStorage YAML, ROS's
//! `camera_info` YAML and Kalibr's camchain YAML.

mod fields;
mod kalibr;
mod opencv;
mod ros;
mod yaml;

use fields::Fields;
use penumbra_camera::{Lens, LensModel};
use thiserror::Error;

/// Whose file it is.
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
    /// As the file calls it.
    pub name: String,
    /// The lens.
    pub lens: Lens,
}

/// A file is not what it should be. Each text says where and what to do.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ExchangeError {
    /// Not of the kind of YAML that is read.
    #[error("line {line}: {reason}")]
    Syntax {
        /// From 1.
        line: usize,
        /// What is wrong there.
        reason: &'static str,
    },
    /// A key that is needed is not there.
    #[error("key `{key}` is missing; add it ({expected})")]
    Missing {
        /// From the root.
        key: String,
        /// What the value should be.
        expected: &'static str,
    },
    /// A value that makes no sense.
    #[error("line {line}: `{key}` must be {expected}")]
    Wrong {
        /// From 1.
        line: usize,
        /// From the root.
        key: String,
        /// What the value should be.
        expected: &'static str,
    },
    /// None of the three.
    #[error(
        "no camera in it: expected OpenCV's camera_matrix, ROS's distortion_model or Kalibr's cam0"
    )]
    Unknown,
    /// The file's format has no place for the lens.
    #[error(
        "{dialect} cannot express {what}; calibrate with another model, or export to another format"
    )]
    Inexpressible {
        /// Whose format.
        dialect: &'static str,
        /// What of the lens.
        what: &'static str,
    },
}

type Result<T> = std::result::Result<T, ExchangeError>;

/// All cameras of a file of any of the three dialects. `size` stands in for the pictures'
/// size where the file does not say it (OpenCV's stereo files).
///
/// # Errors
/// What is wrong and where, in one line.
pub fn read(text: &str, size: Option<(u32, u32)>) -> Result<Vec<NamedLens>> {
    let document = yaml::parse(text)?;
    let root = Fields::root(&document)?;
    if root.find("camera_model").is_some() || root.find("cam0").is_some() {
        kalibr::read(&root)
    } else if root.find("distortion_model").is_some() {
        Ok(vec![ros::read(&root)?])
    } else {
        opencv::read(&root, size)
    }
}

/// The file that says the same. OpenCV and ROS have one camera in a file: the first.
///
/// # Errors
/// A lens that the format cannot express.
pub fn write(dialect: Dialect, cameras: &[NamedLens]) -> Result<String> {
    let first = cameras.first().ok_or(ExchangeError::Unknown)?;
    match dialect {
        Dialect::Opencv => Ok(opencv::write(first)),
        Dialect::Ros => Ok(ros::write(first)),
        Dialect::Kalibr => kalibr::write(cameras),
    }
}

/// So many digits that reading gives the same number again.
fn number(value: f64) -> String {
    format!("{value:?}")
}

fn numbers(values: &[f64]) -> String {
    let texts: Vec<String> = values.iter().map(|v| number(*v)).collect();
    texts.join(", ")
}

/// fx, 0, cx, 0, fy, cy, 0, 0, 1.
fn camera_matrix(lens: &Lens) -> [f64; 9] {
    let (f, c) = (lens.focal, lens.centre);
    [f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0]
}

/// The lens of that model with coefficients in its own order, as far as given.
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
