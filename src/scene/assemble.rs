//! The scene that a session brings with it: phantoms, ground and virtual object from its
//! attachments.

use super::enclosed;
use super::gltf_file::load_gltf_bytes;
use super::primitives;
use super::{Material, Part, Scene, SceneError, load_ply};
use crate::calibration::environment_file::apply_environment_file;
use crate::calibration::environment_view::MirrorSphere;
use crate::calibration::latency_file::apply_latency_file;
use crate::calibration::lens_files::{apply_lens_files, size_of_lens};
use crate::calibration::markers_file::apply_markers_file;
use crate::calibration::photometric_file::apply_photometric_file;
use crate::calibration::rig_json::{GroundPlane, z_up_from_y_up};
use crate::calibration::tracker_file::apply_tracker_file;
use crate::calibration::{RigCalibration, RigDocument};
use glam::{DMat4, DQuat, DVec3, Vec3};
use std::sync::Arc;

/// Finds an attachment's bytes by its name (`rig.json`, `object/object.glb`).
pub type Attachments<'a> = dyn Fn(&str) -> Option<&'a [u8]> + 'a;

impl Scene {
    /// Calibration and scene of a session.
    pub fn from_session(attachments: &Attachments) -> Result<(RigCalibration, Self), SceneError> {
        let rig = rig_of_session(attachments)?;
        let scene = Self::of_rig(&rig, attachments)?;
        Ok((rig.calibration, scene))
    }

    /// The scene that `rig` describes: phantoms, and the session's own virtual object
    /// and lamps.
    pub fn of_rig(rig: &RigDocument, attachments: &Attachments) -> Result<Self, SceneError> {
        let mut scene = Self::phantoms_of_rig(rig, attachments)?;
        scene.lamps.clone_from(&rig.virtual_lights);
        if let Some(object) = &rig.object {
            let bytes = attachment(attachments, &object.file, "object.glb in rig.json names")?;
            let folder = object
                .file
                .rsplit_once('/')
                .map_or("", |(folder, _)| folder);
            let model = load_gltf_bytes(bytes, &object.file, &|uri| {
                let name = format!("{folder}/{uri}");
                attachments(name.trim_start_matches('/'))
                    .map(<[u8]>::to_vec)
                    .ok_or_else(|| "the session has no such attachment".into())
            })?;
            // The loader has turned the coordinates +Z up already; T_world_glb wants them
            // as they are in the file.
            let world_from_model = object.world_from_glb * z_up_from_y_up().transpose();
            scene.virtual_parts = model.placed(world_from_model);
        }
        scene.warnings = (0..scene.lamps.len())
            .filter_map(|i| {
                let place = format!("rig.json: `virtual_lights.lights[{i}].keys`: ");
                enclosed::warning(&scene, i, &place)
            })
            .collect();
        Ok(scene)
    }

    /// As [`Scene::of_rig`], with nothing virtual.
    pub fn phantoms_of_rig(
        rig: &RigDocument,
        attachments: &Attachments,
    ) -> Result<Self, SceneError> {
        let mut scene = Self::default();
        if let Some(ground) = &rig.ground {
            scene.add_ground(ground);
        }
        for phantom in &rig.phantoms {
            let bytes = attachment(attachments, &phantom.file, "phantoms in rig.json names")?;
            let mesh = load_ply(bytes, &phantom.file)?;
            scene.phantom_parts.push(Part {
                name: phantom.name.clone(),
                mesh: Arc::new(mesh),
                material: Arc::new(Material::default()),
                world_from_part: phantom.world_from_file,
                mirror: phantom.mirror,
                albedo: phantom.albedo,
            });
        }
        if let Some(sphere) = rig.mirror_sphere.as_ref().filter(|s| s.in_scene) {
            scene.phantom_parts.push(mirror_phantom(sphere));
        }
        Ok(scene)
    }

    /// A square phantom; a level one also sets [`Scene::ground_height`].
    pub(super) fn add_ground(&mut self, ground: &GroundPlane) {
        let turn = DQuat::from_rotation_arc(DVec3::Z, ground.normal);
        if ground.normal.z > 0.999_999 {
            self.ground_height = Some(ground.offset / ground.normal.z);
        }
        self.phantom_parts.push(Part {
            name: "ground".into(),
            mesh: Arc::new(primitives::plane(ground.size as f32, ground.size as f32)),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::from_rotation_translation(turn, ground.normal * ground.offset),
            mirror: false,
            albedo: ground.albedo,
        });
    }
}

/// Reads the session's `rig.json`, and what was calibrated since.
pub fn rig_of_session(attachments: &Attachments) -> Result<RigDocument, SceneError> {
    let bytes = attachment(attachments, "rig.json", "holds the rig's calibration")?;
    calibrated(RigDocument::parse(bytes)?, attachments)
}

/// A rig that nobody has written a `rig.json` for: what was calibrated of it, and guesses for
/// the rest. Its scene camera's pictures are of `usual_size` where no calibration says theirs.
///
/// # Errors
/// A calibration file that cannot be read or used.
pub fn rig_without_document(
    usual_size: (u32, u32),
    attachments: &Attachments,
) -> Result<RigDocument, SceneError> {
    let (width, height) = size_of_lens(attachments)?.unwrap_or(usual_size);
    calibrated(RigDocument::uncalibrated(width, height), attachments)
}

/// With what was calibrated since, in files of its own.
fn calibrated(mut rig: RigDocument, attachments: &Attachments) -> Result<RigDocument, SceneError> {
    // It may bring the environment camera itself, whose lens may have been calibrated.
    apply_environment_file(&mut rig, attachments)?;
    apply_lens_files(&mut rig, attachments)?;
    apply_photometric_file(&mut rig, attachments)?;
    apply_markers_file(&mut rig, attachments)?;
    apply_tracker_file(&mut rig, attachments)?;
    apply_latency_file(&mut rig, attachments)?;
    Ok(rig)
}

fn attachment<'a>(
    attachments: &Attachments<'a>,
    name: &str,
    wanted_by: &str,
) -> Result<&'a [u8], SceneError> {
    attachments(name).ok_or_else(|| SceneError::NoAttachment {
        file: name.to_owned(),
        wanted_by: wanted_by.to_owned(),
    })
}

fn mirror_phantom(sphere: &MirrorSphere) -> Part {
    Part {
        name: "mirror sphere".into(),
        mesh: Arc::new(primitives::sphere(sphere.radius as f32, 96, 48)),
        material: Arc::new(Material {
            base_colour: Vec3::from(sphere.reflectance).extend(1.0),
            metallic: 1.0,
            roughness: 0.0,
            ..Material::default()
        }),
        world_from_part: DMat4::from_translation(sphere.centre_in_world),
        mirror: true,
        albedo: None,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use crate::scene::Mesh;
    use std::collections::HashMap;
    use std::path::{Path, PathBuf};

    pub(crate) const TRUTH: [&str; 5] = [
        "desk",
        "desk-sphere",
        "courtyard",
        "desk-marker",
        "desk-lamp",
    ];

    pub(crate) fn truth(test: &str) -> Option<PathBuf> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/truth");
        if path.is_dir() {
            return Some(path);
        }
        eprintln!("SKIPPED {test}: ../shared is missing");
        None
    }

    pub(crate) fn attachments_of(folder: &Path) -> HashMap<String, Vec<u8>> {
        let mut files = HashMap::new();
        let mut add = |name: String| {
            files.insert(name.clone(), std::fs::read(folder.join(name)).unwrap());
        };
        add("rig.json".into());
        for sub in ["object", "phantoms"] {
            for entry in std::fs::read_dir(folder.join(sub)).unwrap() {
                add(format!("{sub}/{}", entry.unwrap().file_name().display()));
            }
        }
        files
    }

    fn bounds(mesh: &Mesh, matrix: DMat4) -> (DVec3, DVec3) {
        mesh.vertices
            .iter()
            .map(|v| matrix.transform_point3(v.position.as_dvec3()))
            .fold((DVec3::MAX, DVec3::MIN), |(low, high), p| {
                (low.min(p), high.max(p))
            })
    }

    #[test]
    fn the_object_stands_where_its_ply_twins_stand() {
        let Some(truth) = truth("the_object_stands_where_its_ply_twins_stand") else {
            return;
        };
        for name in TRUTH {
            let files = attachments_of(&truth.join(name));
            let find = |n: &str| files.get(n).map(Vec::as_slice);
            let (_, scene) = Scene::from_session(&find).unwrap();
            let json: serde_json::Value = serde_json::from_slice(&files["rig.json"]).unwrap();
            let rows = &json["object"]["T_world_object"]["matrix_row_major"];
            let cell = |i: usize| rows[i / 4][i % 4].as_f64().unwrap();
            let world_from_object = DMat4::from_cols_array(&std::array::from_fn(cell)).transpose();
            let parts = json["object"]["parts"].as_array().unwrap();
            assert_eq!(parts.len(), scene.virtual_parts.len(), "{name}");
            for part in parts {
                let (label, file) = (
                    part["name"].as_str().unwrap(),
                    part["ply"].as_str().unwrap(),
                );
                let twin = load_ply(&files[file], file).unwrap();
                let ours = scene
                    .virtual_parts
                    .iter()
                    .find(|p| p.name == label)
                    .unwrap();
                let a = bounds(&ours.mesh, ours.world_from_part);
                let b = bounds(&twin, world_from_object);
                assert!(
                    a.0.distance(b.0) < 1e-5 && a.1.distance(b.1) < 1e-5,
                    "{name} {label} {a:?} {b:?}"
                );
                let factor = part["material"]["gltf"]["roughnessFactor"]
                    .as_f64()
                    .unwrap();
                assert!((f64::from(ours.material.roughness) - factor).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn phantoms_ground_and_mirror_ball_are_there() {
        let Some(truth) = truth("phantoms_ground_and_mirror_ball_are_there") else {
            return;
        };
        for name in TRUTH {
            let files = attachments_of(&truth.join(name));
            let find = |n: &str| files.get(n).map(Vec::as_slice);
            let rig = rig_of_session(&find).unwrap();
            let scene = Scene::phantoms_of_rig(&rig, &find).unwrap();
            assert!(scene.virtual_parts.is_empty());
            assert_eq!(scene.ground_height, Some(0.0));
            let mirrors: Vec<_> = scene.phantom_parts.iter().filter(|p| p.mirror).collect();
            let has_ball = matches!(name, "desk-sphere" | "desk-marker");
            assert_eq!(mirrors.len(), usize::from(has_ball), "{name}");
            let expected = 1 + rig.phantoms.len() + mirrors.len();
            assert_eq!(scene.phantom_parts.len(), expected);
            let json: serde_json::Value = serde_json::from_slice(&files["rig.json"]).unwrap();
            for (phantom, part) in json["phantoms"]
                .as_array()
                .unwrap()
                .iter()
                .zip(&scene.phantom_parts[1..])
            {
                // A box or cylinder stands on the ground and is as high as its owner says.
                let (low, high) = bounds(&part.mesh, part.world_from_part);
                let shape = &phantom["shape"];
                let height = shape["height"]
                    .as_f64()
                    .or(shape["size"][2].as_f64())
                    .unwrap();
                assert!(
                    low.z.abs() < 1e-6 && (high.z - height).abs() < 1e-6,
                    "{name}"
                );
            }
        }
    }

    #[test]
    fn a_calibrated_lens_counts_without_a_document_and_says_the_size() {
        use crate::calibration::intrinsics::{Lens, LensModel};
        use crate::calibration::record::LensRecord;
        use glam::DVec2;
        let lens = Lens::ideal(
            LensModel::Brown,
            (800, 600),
            DVec2::splat(700.0),
            DVec2::new(401.0, 299.0),
        );
        let record = LensRecord::of_lens(&lens, "scene", String::new());
        let bytes = serde_json::to_vec(&record).unwrap();
        let file = |name: &str| (name == "calibration/scene_camera.json").then_some(&bytes[..]);
        let rig = rig_without_document((640, 480), &file).unwrap();
        let camera = rig.calibration.scene_camera.camera;
        assert_eq!((camera.width, camera.focal.x), (800, 700.0));
        let none = rig_without_document((640, 480), &|_| None).unwrap();
        assert_eq!(none.calibration.scene_camera.camera.width, 640);
        let broken = rig_without_document((640, 480), &|_| Some(b"{")).unwrap_err();
        assert!(broken.to_string().contains("scene_camera.json: line 1"));
    }

    #[test]
    fn a_session_without_calibration_says_so() {
        let error = Scene::from_session(&|_| None).unwrap_err().to_string();
        assert!(
            error.contains("rig.json") && error.contains("import"),
            "{error}"
        );
    }
}
