//! Basalt's calibration JSON: cameras of the types `kb4`, `pinhole` and `pinhole-radtan8`.

use super::{FormatError, NamedLens, Result, with_coefficients};
use glam::DVec2;
use penumbra_camera::{Lens, LensModel};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Maximum magnitude of a camera parameter.
const MAX_PARAMETER: f64 = 1e6;

#[derive(Deserialize)]
struct Document {
    value0: Calibration,
}

#[derive(Deserialize)]
struct Calibration {
    intrinsics: Vec<Camera>,
    resolution: Vec<(u32, u32)>,
}

#[derive(Deserialize)]
struct Camera {
    camera_type: String,
    intrinsics: BTreeMap<String, f64>,
}

/// Returns whether a text is JSON as Basalt writes it.
pub(super) fn is_basalt(text: &str) -> bool {
    text.trim_start().starts_with('{') && text.contains("\"value0\"")
}

pub(super) fn read(text: &str) -> Result<Vec<NamedLens>> {
    let document: Document = serde_json::from_str(text).map_err(|error| FormatError::Json {
        message: error.to_string(),
    })?;
    let Calibration {
        intrinsics,
        resolution,
    } = document.value0;
    let cameras = intrinsics.iter().zip(resolution).enumerate();
    let lenses = cameras.map(|(i, (camera, size))| {
        Ok(NamedLens {
            name: format!("cam{i}"),
            lens: lens(i, camera, size)?,
        })
    });
    let lenses: Vec<NamedLens> = lenses.collect::<Result<_>>()?;
    if lenses.is_empty() {
        return Err(FormatError::Unknown);
    }
    Ok(lenses)
}

fn lens(index: usize, camera: &Camera, size: (u32, u32)) -> Result<Lens> {
    let path = |key: &str| format!("value0.intrinsics[{index}].{key}");
    let (model, keys): (LensModel, &[&str]) = match camera.camera_type.as_str() {
        "kb4" => (LensModel::KannalaBrandt, &["k1", "k2", "k3", "k4"]),
        "pinhole" => (LensModel::Brown, &[]),
        "pinhole-radtan8" => (
            LensModel::BrownRational,
            &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
        ),
        _ => {
            return Err(FormatError::Wrong {
                line: 1,
                key: path("camera_type"),
                expected: "kb4, pinhole or pinhole-radtan8 (ds, eucm and ucm are not supported)",
            });
        }
    };
    let value = |key: &str| {
        let found = camera.intrinsics.get(key).copied();
        found
            .filter(|v| v.abs() <= MAX_PARAMETER)
            .ok_or_else(|| FormatError::Missing {
                key: path(&format!("intrinsics.{key}")),
                expected: "a number",
            })
    };
    let focal = DVec2::new(value("fx")?, value("fy")?);
    if focal.min_element() < 1.0 || size.0 == 0 || size.1 == 0 {
        return Err(FormatError::Wrong {
            line: 1,
            key: path("intrinsics.fx"),
            expected: "a focal length of at least 1 pixel, in a picture with pixels",
        });
    }
    let centre = DVec2::new(value("cx")?, value("cy")?);
    let coefficients: Vec<f64> = keys.iter().map(|key| value(key)).collect::<Result<_>>()?;
    let lens = Lens::ideal(model, size, focal, centre);
    Ok(with_coefficients(lens, model, &coefficients))
}
