//! Reads scene files: virtual objects, lamps, shadowing planes and further phantoms, in TOML. Lengths
//! are metres, angles degrees, the world is +Z up. All keys:
//!
//! ```toml
//! session_phantoms = true          # keep the phantoms of the session (the default)
//!
//! [model]                          # pose of all objects and planes together: theirs are
//! position_m = [0.0, 0.0, 0.0]     # relative to it
//! rotation_deg = [0.0, 0.0, 0.0]   # or rotation_wxyz
//!
//! [[object]]                       # any number of them
//! name = "teapot"
//! file = "teapot.glb"              # .glb, .gltf or .ply, from this file's folder; or a
//! # shape = "torus"                # plane, box, cylinder, cone, sphere or torus with
//! # size_m = [0.1, 0.1, 0.1]       #   box: x, y, z; plane: x, y
//! # radius_m = 0.05                #   cylinder, cone, sphere; torus: axis to tube
//! # tube_radius_m = 0.02           #   torus
//! # height_m = 0.1                 #   cylinder, cone
//! # segments = 64                  #   subdivision of round shapes; a "temple-gate", 6 m wide,
//!                                  #   has only this and `scale`
//! position_m = [0.0, 0.0, 0.0]
//! rotation_deg = [30.0, 0.0, 0.0]  # yaw, pitch, roll about z, y, x; or rotation_wxyz
//! scale = 1.0                      # a number, or one for each axis
//! # each of these replaces the value of the file, and its texture:
//! material = { base_colour = "#c04020", metallic = 0.0, roughness = 0.4, emissive = [0, 0, 0] }
//! repeat_s = 6.0                   # motion: period of the path; without it, the object stays at
//! easing = "smooth"                # the end. Between keys "smooth", "linear" or "step"
//! keys = [                         # a key's missing values are those of the object
//!     { at_s = 0.0 },              # angles are interpolated separately: 0 to 360 is a full turn;
//!     { at_s = 3.0, position_m = [0.1, 0.0, 0.0], rotation_deg = [390.0, 0.0, 0.0], scale = 1.2 },
//! ]                                # rotation_wxyz takes the shorter arc
//! # animation = true               # or a name: an animation of a .glb or .gltf, repeated
//!
//! [[object]]
//! shape = "sphere"
//! radius_m = 0.05
//! # Phong's model instead of metallic, roughness and specular: the shares of light that are
//! # reflected diffusely and by a lobe cos^exponent about the mirror direction, normalised so
//! # that `specular` is its reflectance of a uniform sky at normal incidence. Their sum is at
//! # most 1 in each channel; the exponent is 0 to 10000.
//! material.phong = { diffuse = [0.4, 0.1, 0.1], specular = [0.3, 0.3, 0.3], exponent = 50 }
//! # material.base_colour_texture = "wood.png"    # PNG or JPEG, from this file's folder; as in
//! # material.metallic_roughness_texture = "mr.png" # glTF they multiply the factors above
//! # material.normal_texture = "bumps.png"        # (of Phong's model the diffuse share),
//! # material.normal_scale = 1.0                  # +X red, +Y green, towards the picture's top
//! # material.occlusion_texture = "ao.png"
//! # material.emissive_texture = "glow.png"
//!
//! [[phantom]]                      # a proxy of a real object: as an object, but without
//! shape = "box"                    # material
//! size_m = [0.2, 0.1, 0.1]
//! mirror = false                   # whether it is a mirror
//! albedo = [0.5, 0.5, 0.5]         # its colour, if known: linear, or "#rrggbb"
//!
//! [[lamp]]                         # lights real and virtual surfaces; at most 32
//! position_m = [0.2, 0.0, 0.4]
//! intensity = [0.3, 0.3, 0.3]      # white paper at r metres has radiance intensity / (pi r²)
//! target_m = [0.0, 0.0, 0.0]       # a spot; without it a point light
//! beam_deg = 20.0                  # half angles: full light inside, falling to zero at
//! cutoff_deg = 30.0                # the second
//! repeat_s = 8.0                   # period of its path; without `keys` it does not move
//! keys = [{ at_s = 0.0 }, { at_s = 4.0, position_m = [0.3, 0.0, 0.4], gain = 0.0 }]
//!
//! [[lamp]]                         # in photometric units, in place of `intensity`
//! attached_to = "teapot"           # its positions are relative to that object
//! position_m = [0.0, 0.0, 0.3]
//! candela = 60.0                   # or `lumen`, its luminous flux
//! kelvin = 2700.0                  # or `colour`
//!
//! [[lamp]]                         # a visible rectangle that emits: a screen, a window
//! kind = "area"                    # default: "spot" with target_m, "point" without
//! size_m = [0.3, 0.2]              # width and height, without the scale of its object
//! position_m = [0.0, 0.3, 0.15]    # its centre
//! target_m = [0.0, 0.0, 0.0]       # what it faces; or `direction`, along its normal
//! up = [0.0, 0.0, 1.0]             # of its picture (the default)
//! nit = 400.0                      # cd/m² of its white; or lumen, candela along the normal,
//! # texture = "screen.png"         #   or intensity, each of all of it. PNG or JPEG, from this
//! # two_sided = false              #   file's folder
//! # visible = true                 # false: it emits, and is invisible itself
//!
//! [photometry]                     # luminance of the scene camera's white, cd/m²; or `ev100`, its
//! white_cd_m2 = 300.0              # exposure value at ISO 100
//!
//! [[plane]]                        # technique "shadowing-planes"; with a plane for a
//! centre_m = [0.0, 0.0, 0.0]       # layer, none are generated for that layer.
//! normal = [0.0, 0.0, 1.0]         # Away from the covered surfaces; its camera looks against it
//! up = [0.0, 1.0, 0.0]             # of its picture; default +Z, +Y for level planes
//! size_m = [1.0, 0.8]              # width and height
//! depth_m = 0.05                   # maximum distance behind it of the surfaces that it covers
//! layer = "real"                   # or "virtual" (the default): surfaces that show its shadows
//! receiver = "plane"               # or "surface": shadows are baked for the rectangle itself or
//!                                  #   for the surfaces behind it (the default for "virtual")
//!
//! [ground]                         # replaces the session's ground
//! height_m = 0.0
//! size_m = 8.0
//! ```
//!
//! Boxes, cylinders, cones and gates stand on their origin; other shapes are centred on it.

use super::enclosed;
use super::gate::temple_gate;
use super::gltf_file::{ModelPart, Playing, files_of_gltf, load_gltf_playing, read_file};
use super::motion::Motions;
use super::planes::{ShadowingPlane, covered_parts};
use super::primitives;
use crate::edit::SceneObject;
use crate::error::SceneError;
use crate::gltf_file::Model;
use crate::ground_plane::GroundPlane;
use crate::mesh::{Material, Mesh, Part};
use crate::ply::load_ply;
use crate::scene::Scene;
use crate::virtual_light::VirtualLight;
use glam::{DMat4, DVec3, Vec3};
use lamp::Surroundings;
use penumbra_interface::RigidTransform;
use penumbra_strict_toml::{Fault, TomlText};
use placed::Placed;
use std::collections::HashSet;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use typed::{Entry, Ground, SceneFile, Shape};

mod area;
mod displaced;
mod lamp;
mod material;
mod motion;
mod place;
mod placed;
mod plane;
mod typed;

pub use displaced::{displaced_text, model_text};

/// Maximum number of objects or phantoms of a file.
const MAX_ENTRIES: usize = 1000;
/// Maximum subdivision of a round shape.
const MAX_SEGMENTS: u32 = 1024;
/// Maximum number of triangles of all shapes of a file together: a few lines must not take
/// gigabytes.
const MAX_SHAPE_TRIANGLES: usize = 2_000_000;

/// Contents of a scene file, checked.
#[derive(Clone, Debug)]
pub struct SceneAddition {
    /// Virtual objects.
    pub objects: Vec<Part>,
    /// Which of them, and of `lamps`, belong together.
    pub groups: Vec<SceneObject>,
    /// Further proxies of real objects.
    pub phantoms: Vec<Part>,
    /// Virtual lights.
    pub lamps: Vec<VirtualLight>,
    /// Prefix of a message about each lamp: file, line and key.
    pub lamp_places: Vec<String>,
    /// Shadowing planes that are placed by hand.
    pub planes: Vec<ShadowingPlane>,
    /// Motions of `objects` and `lamps`.
    pub motions: Motions,
    /// Properties of the model files that are ignored, one line each.
    pub warnings: Vec<String>,
    /// Replaces the session's ground.
    pub ground: Option<GroundPlane>,
    /// Whether the session's phantoms are kept.
    pub session_phantoms: bool,
}

impl SceneAddition {
    /// Reads a scene file and the models that it names.
    ///
    /// # Errors
    /// A file cannot be read or is invalid; the message names file, line and key.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let text = TomlText::read(path)?;
        Self::read(&text, path.parent().unwrap_or(Path::new("")))
    }

    /// Reads a scene of one object: a model, at the origin of the world.
    ///
    /// # Errors
    /// The model cannot be read or is invalid, or it has lamps, whose units need a scene file.
    pub fn load_model(path: &Path) -> Result<Self, SceneError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let object = Entry {
            file: Some(name.into_owned()),
            ..Entry::default()
        };
        let file = SceneFile {
            object: vec![object],
            ..SceneFile::default()
        };
        let text = TomlText::new(path.display().to_string(), "");
        Self::convert(file, &text, path.parent().unwrap_or(Path::new("")))
    }

    fn read(text: &TomlText, folder: &Path) -> Result<Self, SceneError> {
        Self::convert(text.parse()?, text, folder)
    }

    fn convert(file: SceneFile, text: &TomlText, folder: &Path) -> Result<Self, SceneError> {
        let located = |fault: Fault| SceneError::from(text.locate(fault));
        let model = file.model.as_ref().map(|m| m.placement("model"));
        let model = model.transpose().map_err(located)?;
        let model = model.unwrap_or(RigidTransform::IDENTITY);
        if file.object.len().max(file.phantom.len()) > MAX_ENTRIES {
            return Err(located(Fault::new(
                "object",
                format!("expected at most {MAX_ENTRIES} entries"),
            )));
        }
        let world_from_model = model.to_matrix();
        let white = lamp::white(file.photometry.as_ref()).map_err(located)?;
        let mut placed = Placed::default();
        let mut triangles = 0;
        for entry in file.object.iter().enumerate() {
            let first = placed.objects.len();
            placed.add_object(entry, (folder, text), world_from_model, white)?;
            let at = format!("object[{}]", entry.0);
            let parts = &placed.objects[first..];
            count(entry.1, &at, parts, &mut triangles).map_err(located)?;
        }
        placed.add_lamps(&file.lamp, (folder, text), white)?;
        let mut phantoms = Vec::new();
        for (i, entry) in file.phantom.iter().enumerate() {
            let at = format!("phantom[{i}]");
            let parts = entry.phantom_parts(&at, folder, text)?;
            count(entry, &at, &parts, &mut triangles).map_err(located)?;
            phantoms.extend(parts);
        }
        let planes = planes(&file.plane, model).map_err(located)?;
        let ground = file
            .ground
            .map(|g| ground(&g))
            .transpose()
            .map_err(located)?;
        let Placed {
            objects,
            groups,
            lamps,
            lamp_places,
            motions,
            warnings,
            ..
        } = placed;
        Ok(Self {
            objects,
            groups,
            phantoms,
            lamps,
            lamp_places,
            planes,
            motions,
            warnings,
            ground,
            session_phantoms: file.session_phantoms.unwrap_or(true),
        })
    }

    /// Replaces the virtual objects of `session` and adds to its phantoms.
    #[must_use]
    pub fn onto(self, session: Scene) -> Scene {
        let mut scene = if self.session_phantoms {
            session
        } else {
            Scene::default()
        };
        scene.virtual_parts = self.objects;
        scene.objects = self.groups;
        scene.lamps = self.lamps;
        scene.planes = self.planes;
        scene.motions = self.motions;
        if let Some(ground) = &self.ground {
            scene.phantom_parts.retain(|p| p.name != "ground");
            scene.ground_height = None;
            scene.add_ground(ground);
        }
        scene.phantom_parts.extend(self.phantoms);
        covered_parts(&mut scene);
        let places = self.lamp_places.iter().enumerate();
        let enclosed = places.filter_map(|(i, place)| enclosed::warning(&scene, i, place));
        scene.warnings = self.warnings.into_iter().chain(enclosed).collect();
        scene
    }
}

fn planes(
    entries: &[typed::PlaneFile],
    model: RigidTransform,
) -> Result<Vec<ShadowingPlane>, Fault> {
    if entries.len() > MAX_ENTRIES {
        let reason = format!("expected at most {MAX_ENTRIES} planes");
        return Err(Fault::new("plane", reason));
    }
    let planes = entries.iter().enumerate();
    planes
        .map(|(i, p)| Ok(plane::plane(p, &format!("plane[{i}]"))?.moved(model)))
        .collect()
}

/// Adds the triangles of a built-in shape to those of the shapes before it.
fn count(entry: &Entry, at: &str, parts: &[Part], triangles: &mut usize) -> Result<(), Fault> {
    if entry.shape.is_some() {
        *triangles += parts
            .iter()
            .map(|p| p.mesh.indices.len() / 3)
            .sum::<usize>();
    }
    if *triangles > MAX_SHAPE_TRIANGLES {
        let reason = format!(
            "the shapes of this file have more than {MAX_SHAPE_TRIANGLES} triangles together; reduce segments"
        );
        return Err(Fault::new(format!("{at}.shape"), reason));
    }
    Ok(())
}

/// Returns the scene file at `path`, the files that it names and those that its models name, whether
/// they exist or not.
#[must_use]
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let mut files = vec![path.to_owned()];
    let folder = path.parent().unwrap_or(Path::new(""));
    let text = TomlText::read(path);
    if let Ok(file) = text.and_then(|text| text.parse::<SceneFile>()) {
        let entries = || file.object.iter().chain(&file.phantom);
        let models = || entries().filter_map(|entry| entry.file.as_ref());
        let materials = entries().filter_map(|entry| entry.material.as_ref());
        let named = models()
            .chain(materials.flat_map(|m| m.textures().into_iter().filter_map(|(_, name)| name)));
        let named = named.chain(file.lamp.iter().filter_map(|lamp| lamp.texture.as_ref()));
        files.extend(named.take(MAX_ENTRIES).map(|name| folder.join(name)));
        let models = models().take(MAX_ENTRIES).map(|name| folder.join(name));
        files.extend(models.flat_map(|model| files_of_gltf(&model)));
    }
    let mut known = HashSet::new();
    files.retain(|file| known.insert(file.clone()));
    files
}

/// Returns the model at `path` and the files that it names, whether they exist or not.
#[must_use]
pub fn files_of_model(path: &Path) -> Vec<PathBuf> {
    let mut files = vec![path.to_owned()];
    files.extend(files_of_gltf(path));
    files
}

/// Reads a PNG or JPEG as a texture would be.
///
/// # Errors
/// The file cannot be read, is neither, damaged or too large.
pub fn check_texture(path: &Path) -> Result<(), SceneError> {
    material::check_texture(path)
}

/// Returns the first file that the scene file or model at `path` names outside of its folder, links
/// followed. Files that do not exist are left to the loaders.
#[must_use]
pub fn file_outside(path: &Path) -> Option<PathBuf> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let home = folder.canonicalize().ok()?;
    let is_scene = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let named = if is_scene {
        files_of(path)
    } else {
        files_of_model(path)
    };
    named.into_iter().find(|file| match file.canonicalize() {
        Ok(file) => !file.starts_with(&home),
        Err(_) => file.components().any(|c| c == Component::ParentDir),
    })
}

fn refuse_phantom_keys(entry: &Entry, at: &str) -> Result<(), Fault> {
    let key = match (&entry.mirror, &entry.albedo) {
        (Some(_), _) => "mirror",
        (_, Some(_)) => "albedo",
        _ => return Ok(()),
    };
    Err(Fault::new(
        format!("{at}.{key}"),
        "goes with [[phantom]] only; use `material` for an object",
    ))
}

impl Entry {
    fn phantom_parts(
        &self,
        at: &str,
        folder: &Path,
        text: &TomlText,
    ) -> Result<Vec<Part>, SceneError> {
        let located = |key: &str, reason: &str| {
            SceneError::from(text.locate(Fault::new(format!("{at}.{key}"), reason)))
        };
        if self.material.is_some() {
            return Err(located(
                "material",
                "goes with [[object]] only; a phantom shows no colour of its own",
            ));
        }
        if let Some(key) = self.moving_key() {
            return Err(located(
                key,
                "goes with [[object]] only; phantoms do not move",
            ));
        }
        let albedo = self.albedo.map(|c| c.0);
        if albedo.is_some_and(|a| a.max_element() > 1.0) {
            return Err(located(
                "albedo",
                "expected three numbers from 0 to 1, or \"#rrggbb\"",
            ));
        }
        let model = self.model(at, folder, text)?;
        let motion = self.motion(at, DMat4::IDENTITY);
        let motion = motion.map_err(|fault| SceneError::from(text.locate(fault)))?;
        let mut parts = self.parts(&model, at, folder, text)?;
        for (k, part) in parts.iter_mut().enumerate() {
            part.world_from_part = model.part_motion(k, &motion).at(0.0);
            part.mirror = self.mirror.unwrap_or(false);
            part.albedo = albedo;
        }
        Ok(parts)
    }

    fn model(&self, at: &str, folder: &Path, text: &TomlText) -> Result<Model, SceneError> {
        let located = |fault: Fault| SceneError::from(text.locate(fault));
        match (&self.file, self.shape) {
            (Some(file), None) => {
                let playing = self.playing(at).map_err(located)?;
                let path = self.model_path(at, file, folder).map_err(located)?;
                let model = load_model(&path, playing)?;
                if model.plays || playing == Playing::Nothing {
                    return Ok(model);
                }
                let reason = no_animation(playing, &model.animations);
                Err(located(Fault::new(format!("{at}.animation"), reason)))
            }
            (None, Some(shape)) => {
                self.playing(at).map_err(located)?;
                self.built_in(at, shape).map_err(located)
            }
            _ => {
                let reason = "expected either `file` or `shape` (plane, box, cylinder, cone, sphere, torus, temple-gate)";
                Err(located(Fault::new(at, reason)))
            }
        }
    }

    /// Returns the parts of its `model`, in the model's frame, with the file's names and materials.
    fn parts(
        &self,
        model: &Model,
        at: &str,
        folder: &Path,
        text: &TomlText,
    ) -> Result<Vec<Part>, SceneError> {
        let located = |fault: Fault| SceneError::from(text.locate(fault));
        let mut parts = model.placed(DMat4::IDENTITY);
        let several = parts.len() > 1;
        for part in &mut parts {
            if let Some(name) = &self.name {
                part.name = if several {
                    format!("{name}/{}", part.name)
                } else {
                    name.clone()
                };
            }
            if let Some(file) = &self.material {
                material::apply(part, file, at, folder).map_err(located)?;
            }
        }
        Ok(parts)
    }

    fn model_path(&self, at: &str, file: &str, folder: &Path) -> Result<PathBuf, Fault> {
        let sizes = [
            ("size_m", self.size_m.is_some()),
            ("radius_m", self.radius_m.is_some()),
            ("tube_radius_m", self.tube_radius_m.is_some()),
            ("height_m", self.height_m.is_some()),
            ("segments", self.segments.is_some()),
        ];
        if let Some((key, _)) = sizes.iter().find(|(_, given)| *given) {
            return Err(Fault::new(
                format!("{at}.{key}"),
                "goes with `shape` only; use `scale` for a file",
            ));
        }
        let path = folder.join(file);
        if !path.is_file() {
            return Err(Fault::new(
                format!("{at}.file"),
                format!(
                    "there is no file {}; expected a .glb, .gltf or .ply",
                    path.display()
                ),
            ));
        }
        Ok(path)
    }

    fn built_in(&self, at: &str, shape: Shape) -> Result<Model, Fault> {
        let length = |key: &str, value: Option<f64>| self.length(at, shape, key, value);
        let segments = self.segments(at)?;
        let mesh = match shape {
            Shape::TempleGate => return Ok(temple_gate(segments)),
            Shape::Plane => {
                let [x, y] = self.size(at, "a plane: [x, y]")?;
                primitives::plane(x, y)
            }
            Shape::Box => primitives::cuboid(Vec3::from(self.size::<3>(at, "a box: [x, y, z]")?)),
            Shape::Cylinder => primitives::cylinder(
                length("radius_m", self.radius_m)?,
                length("height_m", self.height_m)?,
                segments,
            ),
            Shape::Cone => primitives::cone(
                length("radius_m", self.radius_m)?,
                length("height_m", self.height_m)?,
                segments,
            ),
            Shape::Sphere => primitives::sphere(
                length("radius_m", self.radius_m)?,
                segments,
                segments.div_ceil(2),
            ),
            Shape::Torus => {
                let (major, minor) = (
                    length("radius_m", self.radius_m)?,
                    length("tube_radius_m", self.tube_radius_m)?,
                );
                if minor >= major {
                    return Err(Fault::new(
                        format!("{at}.tube_radius_m"),
                        "expected less than radius_m",
                    ));
                }
                primitives::torus(major, minor, segments, segments.div_ceil(2))
            }
        };
        Ok(single(mesh))
    }

    fn segments(&self, at: &str) -> Result<u32, Fault> {
        let segments = self.segments.unwrap_or(64);
        if !(3..=MAX_SEGMENTS).contains(&segments) {
            let reason = format!("expected a whole number from 3 to {MAX_SEGMENTS}");
            return Err(Fault::new(format!("{at}.segments"), reason));
        }
        Ok(segments)
    }

    fn length(&self, at: &str, shape: Shape, key: &str, value: Option<f64>) -> Result<f32, Fault> {
        let wrong = |reason: String| Fault::new(format!("{at}.{key}"), reason);
        match value {
            None => Err(wrong(
                format!("a {shape:?} needs it, in metres").to_lowercase(),
            )),
            Some(v) if !(1e-4..=1e5).contains(&v) => Err(wrong(format!(
                "expected metres from 0.0001 to 100000, found {v}"
            ))),
            Some(v) => Ok(v as f32),
        }
    }

    fn size<const N: usize>(&self, at: &str, what: &str) -> Result<[f32; N], Fault> {
        let size = self.size_m.clone().unwrap_or_default();
        let array: Option<[f64; N]> = size.try_into().ok();
        array
            .filter(|a| a.iter().all(|v| (1e-4..=1e5).contains(v)))
            .map(|a| a.map(|v| v as f32))
            .ok_or_else(|| {
                Fault::new(
                    format!("{at}.size_m"),
                    format!("expected the size of {what}, metres"),
                )
            })
    }
}

/// The message about an animation that a model does not have.
fn no_animation(playing: Playing<'_>, known: &[String]) -> String {
    if known.is_empty() {
        return "the model has no animation; remove the key".to_owned();
    }
    let wanted = match playing {
        Playing::Named(name) => name,
        Playing::First | Playing::Nothing => "",
    };
    let known: Vec<String> = known.iter().take(20).map(|n| format!("\"{n}\"")).collect();
    let known = known.join(", ");
    format!("the model has no animation \"{wanted}\"; it has {known}")
}

fn load_model(path: &Path, playing: Playing<'_>) -> Result<Model, SceneError> {
    let is_ply = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("ply"));
    if is_ply {
        let file = path.display().to_string();
        return Ok(single(load_ply(&read_file(path)?, &file)?));
    }
    load_gltf_playing(path, playing)
}

fn single(mesh: Mesh) -> Model {
    Model {
        parts: vec![ModelPart {
            name: "object".into(),
            mesh: Arc::new(mesh),
            material: Arc::new(Material::default()),
            model_from_part: DMat4::IDENTITY,
        }],
        ..Model::default()
    }
}

fn ground(file: &Ground) -> Result<GroundPlane, Fault> {
    let offset = file.height_m.unwrap_or(0.0);
    let size = file.size_m.unwrap_or(10.0);
    if !(-1e5..=1e5).contains(&offset) {
        return Err(Fault::new(
            "ground.height_m",
            "expected metres within 100000",
        ));
    }
    if !(1e-3..=1e5).contains(&size) {
        return Err(Fault::new(
            "ground.size_m",
            "expected metres from 0.001 to 100000",
        ));
    }
    Ok(GroundPlane {
        normal: DVec3::Z,
        offset,
        size,
        albedo: file.albedo.map(|c| c.0),
    })
}

#[cfg(test)]
mod tests;
