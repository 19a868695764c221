//! Kalibr's camchain YAML: pinhole cameras with radtan or equidistant distortion.

use super::fields::Fields;
use super::{FormatError, NamedLens, Result, numbers, with_coefficients};
use glam::DVec2;
use penumbra_camera::{Lens, LensModel};
use std::fmt::Write;

pub(super) fn read(root: &Fields) -> Result<Vec<NamedLens>> {
    if root.find("camera_model").is_some() {
        return Ok(vec![camera("cam0", root)?]);
    }
    root.keys()
        .filter(|key| key.starts_with("cam") && key[3..].parse::<u32>().is_ok())
        .map(|key| camera(key, &root.map(key, "a camera")?))
        .collect()
}

fn camera(name: &str, node: &Fields) -> Result<NamedLens> {
    if node.text("camera_model", "pinhole")? != "pinhole" {
        return Err(node.wrong(
            "camera_model",
            "pinhole (omni, eucm and ds are not supported)",
        ));
    }
    let model = match node.text("distortion_model", "radtan or equidistant")? {
        "radtan" => LensModel::Brown,
        "equidistant" | "equi" => LensModel::KannalaBrandt,
        _ => return Err(node.wrong("distortion_model", "radtan or equidistant")),
    };
    let four = |key: &str, expected: &'static str| -> Result<[f64; 4]> {
        let list = node.numbers(key, expected)?;
        list.try_into().map_err(|_| node.wrong(key, expected))
    };
    let k = four("distortion_coeffs", "four numbers")?;
    let [fu, fv, pu, pv] = four("intrinsics", "fu, fv, pu, pv in pixels")?;
    if fu <= 0.0 || fv <= 0.0 {
        return Err(node.wrong("intrinsics", "fu, fv, pu, pv in pixels, fu and fv above 0"));
    }
    let size = node.numbers("resolution", "[width, height] in pixels")?;
    let is_valid = |x: &f64| (1.0..=65_536.0).contains(x) && x.fract() == 0.0;
    if size.len() != 2 || !size.iter().all(is_valid) {
        return Err(node.wrong("resolution", "[width, height] in pixels"));
    }
    let size = (size[0] as u32, size[1] as u32);
    let lens = Lens::ideal(model, size, DVec2::new(fu, fv), DVec2::new(pu, pv));
    Ok(NamedLens {
        name: name.to_owned(),
        lens: with_coefficients(lens, model, &k),
    })
}

pub(super) fn write(cameras: &[NamedLens]) -> Result<String> {
    let mut out = String::new();
    for (i, NamedLens { lens, .. }) in cameras.iter().enumerate() {
        let inexpressible = |what| FormatError::Inexpressible {
            dialect: "Kalibr",
            what,
        };
        let model = match lens.model {
            LensModel::Brown if lens.coefficients[4] != 0.0 => return Err(inexpressible("k3")),
            LensModel::Brown => "radtan",
            LensModel::BrownRational => return Err(inexpressible("a rational distortion")),
            LensModel::KannalaBrandt => "equidistant",
        };
        let (f, c) = (lens.focal, lens.centre);
        let _ = writeln!(
            out,
            "cam{i}:\n  camera_model: pinhole\n  distortion_coeffs: [{}]\n  \
             distortion_model: {model}\n  intrinsics: [{}]\n  resolution: [{}, {}]",
            numbers(&lens.coefficients[..4]),
            numbers(&[f.x, f.y, c.x, c.y]),
            lens.width,
            lens.height
        );
    }
    Ok(out)
}
