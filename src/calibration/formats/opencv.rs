//! OpenCV's FileStorage YAML, with the keys of its calibration samples.

use super::fields::Fields;
use super::{FormatError, NamedLens, Result, camera_matrix, numbers, with_coefficients};
use penumbra_camera::LensModel;
use std::fmt::Write;

/// Keys of camera matrix and coefficients in OpenCV's samples and common programs, and the
/// camera's name.
const NAMES: [(&str, &str, &str); 4] = [
    ("camera_matrix", "distortion_coefficients", "camera"),
    ("cameraMatrix", "distCoeffs", "camera"),
    ("M1", "D1", "left"),
    ("M2", "D2", "right"),
];

pub(super) fn read(root: &Fields, default_size: Option<(u32, u32)>) -> Result<Vec<NamedLens>> {
    let size = match (root.find("image_width"), default_size) {
        (None, Some(size)) => size,
        _ => (root.pixels("image_width")?, root.pixels("image_height")?),
    };
    // Key of OpenCV's camera_calibration sample.
    let fisheye =
        root.find("fisheye_model").is_some() && root.text("fisheye_model", "0 or 1")? != "0";
    let mut out = Vec::new();
    for (matrix, coefficients, name) in NAMES {
        if root.find(matrix).is_none() {
            continue;
        }
        let lens = root.lens(matrix, size)?;
        let k = root.matrix(coefficients)?;
        let model = match (fisheye, k.len()) {
            (true, 4) => LensModel::KannalaBrandt,
            (false, 4 | 5) => LensModel::Brown,
            (false, 8) => LensModel::BrownRational,
            // Coefficients of thin prisms and of a tilted sensor are accepted if they are zero.
            (false, 12 | 14) if k[8..].iter().all(|x| *x == 0.0) => LensModel::BrownRational,
            _ => {
                return Err(root.wrong(
                    coefficients,
                    "4, 5 or 8 coefficients (4 for a fisheye); thin-prism terms are not supported",
                ));
            }
        };
        out.push(NamedLens {
            name: name.to_owned(),
            lens: with_coefficients(lens, model, &k[..k.len().min(8)]),
        });
    }
    if out.is_empty() {
        return Err(FormatError::Unknown);
    }
    Ok(out)
}

pub(super) fn write(camera: &NamedLens) -> String {
    let lens = &camera.lens;
    let fisheye = lens.model == LensModel::KannalaBrandt;
    let k = &lens.coefficients[..lens.model.coefficients().len()];
    let mut out = String::from("%YAML:1.0\n---\n");
    let _ = writeln!(
        out,
        "image_width: {}\nimage_height: {}",
        lens.width, lens.height
    );
    let _ = writeln!(out, "fisheye_model: {}", i32::from(fisheye));
    matrix(&mut out, "camera_matrix", (3, 3), &camera_matrix(lens));
    matrix(&mut out, "distortion_coefficients", (k.len(), 1), k);
    out
}

fn matrix(out: &mut String, key: &str, (rows, columns): (usize, usize), data: &[f64]) {
    let _ = writeln!(
        out,
        "{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {} ]",
        numbers(data)
    );
}
