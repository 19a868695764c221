//! ROS's `camera_info` YAML (sensor_msgs/CameraInfo), as camera_calibration writes it.

use super::fields::Fields;
use super::{NamedLens, Result, camera_matrix, numbers, with_coefficients};
use penumbra_camera::LensModel;
use std::fmt::Write;

/// Names of the models in ROS.
const MODELS: [(LensModel, &str); 3] = [
    (LensModel::Brown, "plumb_bob"),
    (LensModel::BrownRational, "rational_polynomial"),
    (LensModel::KannalaBrandt, "equidistant"),
];

pub(super) fn read(root: &Fields) -> Result<NamedLens> {
    const EXPECTED: &str = "plumb_bob, rational_polynomial or equidistant";
    let size = (root.pixels("image_width")?, root.pixels("image_height")?);
    let name = match root.find("camera_name") {
        Some(_) => root.text("camera_name", "a name")?.to_owned(),
        None => "camera".to_owned(),
    };
    let model_name = root.text("distortion_model", EXPECTED)?;
    let model = MODELS.iter().find(|(_, name)| *name == model_name);
    let &(model, _) = model.ok_or_else(|| root.wrong("distortion_model", EXPECTED))?;
    let lens = root.lens("camera_matrix", size)?;
    let k = root.matrix("distortion_coefficients")?;
    if k.len() != model.coefficients().len() {
        return Err(root.wrong(
            "distortion_coefficients",
            "5 numbers for plumb_bob, 8 for rational_polynomial, 4 for equidistant",
        ));
    }
    Ok(NamedLens {
        name,
        lens: with_coefficients(lens, model, &k),
    })
}

pub(super) fn write(camera: &NamedLens) -> String {
    let lens = &camera.lens;
    let named = MODELS.iter().find(|(model, _)| *model == lens.model);
    let k = &lens.coefficients[..lens.model.coefficients().len()];
    let [fx, _, cx, _, fy, cy, ..] = camera_matrix(lens);
    let projection = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    let rectification = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let mut out = String::new();
    let _ = writeln!(
        out,
        "image_width: {}\nimage_height: {}",
        lens.width, lens.height
    );
    // Quotes and line breaks would end the name.
    let plain = |c: &char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.');
    let name: String = camera.name.chars().filter(plain).collect();
    let _ = writeln!(out, "camera_name: {name}");
    matrix(&mut out, "camera_matrix", (3, 3), &camera_matrix(lens));
    let _ = writeln!(out, "distortion_model: {}", named.map_or("", |m| m.1));
    matrix(&mut out, "distortion_coefficients", (1, k.len()), k);
    matrix(&mut out, "rectification_matrix", (3, 3), &rectification);
    matrix(&mut out, "projection_matrix", (3, 4), &projection);
    out
}

fn matrix(out: &mut String, key: &str, (rows, columns): (usize, usize), data: &[f64]) {
    let data = numbers(data);
    let _ = writeln!(
        out,
        "{key}:\n  rows: {rows}\n  cols: {columns}\n  data: [{data}]"
    );
}
