//! Reads a rig's files together: `rig.json`, the calibration files beside it, and the scene of
//! phantoms, ground and virtual object that they describe.

use super::environment_file::apply_environment_file;
use super::latency_file::apply_latency_file;
use super::lens_files::{apply_lens_files, size_of_lens};
use super::markers_file::apply_markers_file;
use super::tracker_file::apply_tracker_file;
use crate::CalibrationFileError;
use crate::radiometric_file::apply_radiometric_file;
use crate::{RigDocument, RigJsonError};
use glam::{DMat4, Vec3};
use penumbra_camera::MirrorSphere;
use penumbra_scene::load_gltf_bytes;
use penumbra_scene::z_up_from_y_up;
use penumbra_scene::{Material, Part, Scene, SceneAddition, SceneChoice, SceneError};
use penumbra_scene::{enclosed, load_ply, primitives};
use std::sync::Arc;
use thiserror::Error;

/// Returns the bytes of an attachment by its name (`rig.json`, `object/object.glb`).
pub type Attachments<'a> = dyn Fn(&str) -> Option<&'a [u8]> + 'a;

/// A file of a rig cannot be used.
#[derive(Debug, Error)]
pub enum RigFilesError {
    /// A session lacks an attachment.
    #[error(
        "the session has no attachment {file}, which {wanted_by}; import it again from a complete folder"
    )]
    NoAttachment {
        /// Name of the attachment.
        file: String,
        /// What refers to the attachment.
        wanted_by: &'static str,
    },
    /// `rig.json` is invalid.
    #[error(transparent)]
    Document(#[from] RigJsonError),
    /// A calibration file beside it is invalid.
    #[error(transparent)]
    Calibration(#[from] CalibrationFileError),
    /// A model, or the scene file, cannot be used.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl RigDocument {
    /// Reads a session's `rig.json` and the calibration files beside it, which take precedence.
    ///
    /// # Errors
    /// There is no `rig.json`, or a file cannot be used.
    pub fn from_session(attachments: &Attachments) -> Result<Self, RigFilesError> {
        let bytes = attachment(attachments, "rig.json", "holds the rig's calibration")?;
        calibrated(Self::parse(bytes)?, attachments)
    }

    /// Creates the document of a rig without `rig.json` from its calibration files and defaults. The
    /// scene camera's pictures have `default_size` (width, height in pixels) unless a calibration
    /// file states their size.
    ///
    /// # Errors
    /// A calibration file cannot be used.
    pub fn without_rig_json(
        default_size: (u32, u32),
        attachments: &Attachments,
    ) -> Result<Self, RigFilesError> {
        let (width, height) = size_of_lens(attachments)?.unwrap_or(default_size);
        calibrated(Self::uncalibrated(width, height), attachments)
    }

    /// Returns the scene of `choice`, with the rig's phantoms.
    ///
    /// # Errors
    /// A file that the rig or the scene names is missing or cannot be used.
    pub fn chosen_scene(
        &self,
        choice: &SceneChoice,
        attachments: &Attachments,
    ) -> Result<Scene, RigFilesError> {
        match choice {
            SceneChoice::Session => self.scene(attachments),
            SceneChoice::None => self.phantom_scene(attachments),
            SceneChoice::File(path) => {
                let addition = SceneAddition::load(path)?;
                Ok(addition.onto(self.phantom_scene(attachments)?))
            }
        }
    }

    /// Returns the scene that the rig's files describe: phantoms, ground, virtual object and lamps.
    ///
    /// # Errors
    /// A file that the rig names is missing or cannot be used.
    pub fn scene(&self, attachments: &Attachments) -> Result<Scene, RigFilesError> {
        let mut scene = self.phantom_scene(attachments)?;
        scene.lamps.clone_from(&self.virtual_lights);
        if let Some(object) = &self.object {
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
            // The loader has already converted the coordinates to +Z up; T_world_glb expects those of
            // the file.
            let world_from_model = object.world_from_glb * z_up_from_y_up().transpose();
            scene.virtual_parts = model.placed(world_from_model);
            scene.warnings = model.warnings;
        }
        let enclosed = (0..scene.lamps.len()).filter_map(|i| {
            let place = format!("rig.json: `virtual_lights.lights[{i}].keys`: ");
            enclosed::warning(&scene, i, &place)
        });
        let enclosed: Vec<String> = enclosed.collect();
        scene.warnings.extend(enclosed);
        Ok(scene)
    }

    /// As [`Self::scene`], without virtual objects and lamps.
    ///
    /// # Errors
    /// A file that the rig names is missing or cannot be used.
    pub fn phantom_scene(&self, attachments: &Attachments) -> Result<Scene, RigFilesError> {
        let mut scene = Scene::default();
        if let Some(ground) = &self.ground {
            scene.add_ground(ground);
        }
        for phantom in &self.phantoms {
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
        // A ball that is carried about is in no certain place.
        let is_fixed = self.calibration.sphere_marker.is_none();
        let sphere = self.mirror_sphere.as_ref();
        if let Some(sphere) = sphere.filter(|s| s.in_scene && is_fixed) {
            scene.phantom_parts.push(mirror_phantom(sphere));
        }
        Ok(scene)
    }
}

/// Applies the calibration files, which take precedence over `rig.json`.
fn calibrated(
    mut rig: RigDocument,
    attachments: &Attachments,
) -> Result<RigDocument, RigFilesError> {
    // First, because it may add the environment camera, whose lens has a separate file.
    apply_environment_file(&mut rig, attachments)?;
    apply_lens_files(&mut rig, attachments)?;
    apply_radiometric_file(&mut rig, attachments)?;
    apply_markers_file(&mut rig, attachments)?;
    apply_tracker_file(&mut rig, attachments)?;
    apply_latency_file(&mut rig, attachments)?;
    Ok(rig)
}

fn attachment<'a>(
    attachments: &Attachments<'a>,
    name: &str,
    wanted_by: &'static str,
) -> Result<&'a [u8], RigFilesError> {
    attachments(name).ok_or_else(|| RigFilesError::NoAttachment {
        file: name.to_owned(),
        wanted_by,
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
    use super::*;
    use glam::DVec3;
    use penumbra_scene::Mesh;
    use std::collections::HashMap;
    use std::path::Path;

    const TRUTH: [&str; 5] = [
        "desk",
        "desk-sphere",
        "courtyard",
        "desk-marker",
        "desk-lamp",
    ];

    fn attachments_in(folder: &Path) -> HashMap<String, Vec<u8>> {
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
    fn object_has_the_bounds_of_its_ply_parts() {
        let Some(truth) = penumbra_test_data::shared("truth") else {
            return;
        };
        for name in TRUTH {
            let files = attachments_in(&truth.join(name));
            let find = |n: &str| files.get(n).map(Vec::as_slice);
            let scene = RigDocument::from_session(&find)
                .unwrap()
                .scene(&find)
                .unwrap();
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
    fn ball_that_is_carried_is_no_phantom() {
        let mut rig = RigDocument::uncalibrated(64, 48);
        rig.mirror_sphere = Some(MirrorSphere {
            centre_in_world: DVec3::new(0.1, 0.2, 0.04),
            radius: 0.04,
            position_sigma: 0.0,
            reflectance: [0.9; 3],
            in_scene: true,
        });
        let nothing = |_: &str| None;
        assert_eq!(rig.phantom_scene(&nothing).unwrap().phantom_parts.len(), 1);
        rig.calibration.sphere_marker = Some(crate::SphereMarker {
            family: penumbra_fiducials::Family::Tag36h11,
            id: 5,
            size: 0.05,
            centre_in_marker: DVec3::ZERO,
        });
        assert!(
            rig.phantom_scene(&nothing)
                .unwrap()
                .phantom_parts
                .is_empty()
        );
    }

    #[test]
    fn scene_has_phantoms_ground_and_mirrored_sphere() {
        let Some(truth) = penumbra_test_data::shared("truth") else {
            return;
        };
        for name in TRUTH {
            let files = attachments_in(&truth.join(name));
            let find = |n: &str| files.get(n).map(Vec::as_slice);
            let rig = RigDocument::from_session(&find).unwrap();
            let scene = rig.phantom_scene(&find).unwrap();
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
                // A box or cylinder stands on the ground and has the stated height.
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
    fn calibrated_lens_applies_without_rig_json_and_sets_the_size() {
        use crate::lens_record::LensRecord;
        use glam::DVec2;
        use penumbra_camera::{Lens, LensModel};
        let lens = Lens::ideal(
            LensModel::Brown,
            (800, 600),
            DVec2::splat(700.0),
            DVec2::new(401.0, 299.0),
        );
        let record = LensRecord::from_lens(&lens, "scene", String::new());
        let bytes = serde_json::to_vec(&record).unwrap();
        let file = |name: &str| (name == "calibration/scene_camera.json").then_some(&bytes[..]);
        let rig = RigDocument::without_rig_json((640, 480), &file).unwrap();
        let camera = rig.calibration.scene_camera.camera;
        assert_eq!((camera.width, camera.focal.x), (800, 700.0));
        let none = RigDocument::without_rig_json((640, 480), &|_| None).unwrap();
        assert_eq!(none.calibration.scene_camera.camera.width, 640);
        let broken = RigDocument::without_rig_json((640, 480), &|_| Some(b"{")).unwrap_err();
        assert!(broken.to_string().contains("scene_camera.json: line 1"));
    }

    #[test]
    fn reports_session_without_calibration() {
        let error = RigDocument::from_session(&|_| None)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("rig.json") && error.contains("import"),
            "{error}"
        );
    }
}
