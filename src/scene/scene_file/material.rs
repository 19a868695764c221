//! Materials of a scene file, which override those of the model file.

use super::typed::{Colour, MaterialFile, PhongFile};
use crate::error::SceneError;
use crate::gltf_file::{path_inside, read_file};
use crate::gltf_material::decode;
use crate::mesh::{Material, Mesh, Part, Phong, SceneTexture};
use crate::normals::recompute_tangents;
use glam::{Vec2, Vec3};
use penumbra_lighting::lobes::MAX_EXPONENT;
use penumbra_strict_toml::Fault;
use std::path::Path;
use std::sync::Arc;

/// Maximum size of a decoded texture, bytes.
const TEXTURE_BYTES: u64 = 1 << 29;
/// Tolerance of the sum of two shares.
const ROUNDING: f32 = 1e-5;

/// Replaces factors and textures of a part's material by those of the scene file.
pub(super) fn apply(
    part: &mut Part,
    file: &MaterialFile,
    at: &str,
    folder: &Path,
) -> Result<(), Fault> {
    let at = format!("{at}.material");
    let mut material = overridden(&part.material, file, &at)?;
    textured(&mut material, file, &at, folder)?;
    let wants_map = file.textures().into_iter().find(|(_, name)| name.is_some());
    if let Some((key, _)) = wants_map
        && !has_coordinates(&part.mesh)
    {
        return Err(Fault::new(
            format!("{at}.{key}"),
            "its mesh has no texture coordinates; export it with them, or remove this key",
        ));
    }
    if material.normal_texture.is_some() && !has_tangents(&part.mesh) {
        recompute_tangents(Arc::make_mut(&mut part.mesh));
    }
    part.material = Arc::new(material);
    Ok(())
}

impl MaterialFile {
    /// Key and file of each texture.
    pub(super) fn textures(&self) -> [(&'static str, Option<&String>); 5] {
        [
            ("base_colour_texture", self.base_colour_texture.as_ref()),
            (
                "metallic_roughness_texture",
                self.metallic_roughness_texture.as_ref(),
            ),
            ("normal_texture", self.normal_texture.as_ref()),
            ("occlusion_texture", self.occlusion_texture.as_ref()),
            ("emissive_texture", self.emissive_texture.as_ref()),
        ]
    }
}

fn overridden(material: &Material, file: &MaterialFile, at: &str) -> Result<Material, Fault> {
    let mut out = material.clone();
    if let Some(Colour(rgb)) = file.base_colour {
        out.base_colour = rgb.extend(material.base_colour.w);
        out.base_colour_texture = None;
    }
    if file.metallic.is_some() || file.roughness.is_some() {
        out.metallic_roughness_texture = None;
    }
    out.metallic = unit(at, "metallic", file.metallic, out.metallic)?;
    out.roughness = unit(at, "roughness", file.roughness, out.roughness)?;
    out.specular = unit(at, "specular", file.specular, out.specular)?;
    if let Some(Colour(rgb)) = file.emissive {
        out.emissive = rgb;
        out.emissive_texture = None;
    }
    if let Some(phong) = &file.phong {
        refuse_with_phong(file, at)?;
        with_phong(&mut out, phong, &format!("{at}.phong"))?;
    }
    Ok(out)
}

/// Refuses keys that Phong's model does not have.
fn refuse_with_phong(file: &MaterialFile, at: &str) -> Result<(), Fault> {
    let given = [
        ("base_colour", file.base_colour.is_some()),
        ("metallic", file.metallic.is_some()),
        ("roughness", file.roughness.is_some()),
        ("specular", file.specular.is_some()),
        (
            "metallic_roughness_texture",
            file.metallic_roughness_texture.is_some(),
        ),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((key, _)) => Err(Fault::new(
            format!("{at}.{key}"),
            "goes without `phong`, which has diffuse, specular and exponent; leave one out",
        )),
        None => Ok(()),
    }
}

fn with_phong(out: &mut Material, file: &PhongFile, at: &str) -> Result<(), Fault> {
    let wrong = |key: &str, reason: String| Fault::new(format!("{at}.{key}"), reason);
    let missing = |key: &str, what: &str| wrong(key, format!("phong needs it: {what}"));
    let specular = file.specular.map(|c| c.0);
    let specular = specular.ok_or_else(|| missing("specular", "a colour from 0 to 1"))?;
    let exponent = file
        .exponent
        .ok_or_else(|| missing("exponent", "0 to 10000"))?;
    if !(0.0..=f64::from(MAX_EXPONENT)).contains(&exponent) {
        let reason = format!("expected a number from 0 to {MAX_EXPONENT}, found {exponent}");
        return Err(wrong("exponent", reason));
    }
    if let Some(Colour(rgb)) = file.diffuse {
        out.base_colour = rgb.extend(out.base_colour.w);
        out.base_colour_texture = None;
    }
    let diffuse = out.base_colour.truncate();
    let sum = (diffuse + specular).to_array();
    let channels = ["red", "green", "blue"].iter().zip(sum);
    let brightest = channels.max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((channel, sum)) = brightest.filter(|(_, sum)| *sum > 1.0 + ROUNDING) {
        let reason = format!(
            "with the diffuse share of {} it reflects {sum:.3} times the incident light in {channel}; their sum must be at most 1",
            shown(diffuse)
        );
        return Err(wrong("specular", reason));
    }
    out.metallic = 0.0;
    out.metallic_roughness_texture = None;
    out.phong = Some(Phong {
        specular,
        exponent: exponent as f32,
    });
    Ok(())
}

fn shown(rgb: Vec3) -> String {
    format!("[{:.3}, {:.3}, {:.3}]", rgb.x, rgb.y, rgb.z)
}

fn textured(out: &mut Material, file: &MaterialFile, at: &str, folder: &Path) -> Result<(), Fault> {
    let places = [
        &mut out.base_colour_texture,
        &mut out.metallic_roughness_texture,
        &mut out.normal_texture,
        &mut out.occlusion_texture,
        &mut out.emissive_texture,
    ];
    for (place, (key, name)) in places.into_iter().zip(file.textures()) {
        if let Some(name) = name {
            let texture = read_texture(folder, name);
            let texture = texture.map_err(|reason| Fault::new(format!("{at}.{key}"), reason))?;
            *place = Some(Arc::new(texture));
        }
    }
    match file.normal_scale {
        Some(scale) if !(-100.0..=100.0).contains(&scale) => Err(Fault::new(
            format!("{at}.normal_scale"),
            format!("expected a number from -100 to 100, found {scale}"),
        )),
        Some(scale) => {
            out.normal_scale = scale as f32;
            Ok(())
        }
        None => Ok(()),
    }
}

/// Reads a texture in the folder of the scene file. A scene may come from somebody else, so it
/// reads no pictures elsewhere.
pub(super) fn read_texture(folder: &Path, name: &str) -> Result<SceneTexture, String> {
    let path = folder.join(name);
    let shown = path.display();
    if !path.is_file() {
        return Err(format!("there is no file {shown}; expected a PNG or JPEG"));
    }
    let inside = path_inside(folder, name)?;
    let inside = inside.ok_or_else(|| {
        format!("{shown} lies outside the folder of the scene file; put the picture there")
    })?;
    let bytes = read_file(&inside).map_err(|e| e.to_string())?;
    decode(&bytes, TEXTURE_BYTES).map_err(|e| format!("{shown}: {e}"))
}

pub(super) fn check_texture(path: &Path) -> Result<(), SceneError> {
    let bytes = read_file(path)?;
    let decoded = decode(&bytes, TEXTURE_BYTES);
    decoded
        .map(|_| ())
        .map_err(|reason| SceneError::broken(&path.display().to_string(), reason.to_string()))
}

fn has_coordinates(mesh: &Mesh) -> bool {
    let first = mesh.vertices.first().map_or(Vec2::ZERO, |v| v.uv);
    mesh.vertices.iter().any(|v| v.uv != first)
}

fn has_tangents(mesh: &Mesh) -> bool {
    let given = |v: &crate::mesh::Vertex| v.tangent.truncate() != Vec3::ZERO;
    mesh.vertices.iter().all(given)
}

fn unit(at: &str, key: &str, value: Option<f64>, default: f32) -> Result<f32, Fault> {
    match value {
        Some(v) if !(0.0..=1.0).contains(&v) => Err(Fault::new(
            format!("{at}.{key}"),
            format!("expected a number from 0 to 1, found {v}"),
        )),
        Some(v) => Ok(v as f32),
        None => Ok(default),
    }
}
