//! Reads glTF 2.0 files (`.glb`, `.gltf`), in memory or on disk: meshes, node transforms,
//! metallic-roughness materials, lights (KHR_lights_punctual) and one animation of nodes. Converts
//! from glTF's +Y up to Penumbra's +Z up.
//!
//! Skins, morph targets and cameras are ignored: meshes have their rest shape.

use super::check::{MAX_FILE_BYTES, MAX_TRIANGLES, check_mesh};
use super::gltf_bytes::{Fault, Resolver, Source, named_files};
use super::gltf_lamp::{ModelLamp, lamp};
use super::gltf_material::{Materials, UvMaterial};
pub use super::gltf_motion::Playing;
use super::gltf_motion::{Skeleton, names, z_up_from_y_up};
use super::lamps::MAX_LAMPS;
use super::motion::Motion;
use super::normals::{normalise_directions, recompute_normals, recompute_tangents};
use crate::error::SceneError;
use crate::mesh::{Material, Mesh, Part, Vertex};
use glam::{DMat3, DMat4, Mat4, Vec2, Vec3, Vec4};
use gltf::accessor::Dimensions;
use gltf::mesh::Mode;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum depth of the node hierarchy.
const MAX_DEPTH: usize = 256;
/// Maximum number of parts of a file.
const MAX_PARTS: usize = 10_000;

/// Contents of a model file in its own frame (+Z up).
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// One part for every primitive of every node.
    pub parts: Vec<ModelPart>,
    /// Lamps.
    pub lamps: Vec<ModelLamp>,
    /// Motion of each part in the selected animation, model from part; `None` if it does not move.
    pub part_motions: Vec<Option<Motion>>,
    /// Motion of each lamp, model from its node.
    pub lamp_motions: Vec<Option<Motion>>,
    /// Names of all animations.
    pub animations: Vec<String>,
    /// Whether the selected animation exists.
    pub plays: bool,
    /// One line for each kind of property that the file uses and Penumbra ignores.
    pub warnings: Vec<String>,
}

/// One mesh with one material in its model.
#[derive(Clone, Debug)]
pub struct ModelPart {
    /// The node's name, else the mesh's.
    pub name: String,
    /// Geometry, shared between nodes.
    pub mesh: Arc<Mesh>,
    /// Material.
    pub material: Arc<Material>,
    /// The node's transform, parents included.
    pub model_from_part: DMat4,
}

impl Model {
    /// Returns the motion of part `index` in the world.
    pub(super) fn part_motion(&self, index: usize, world_from_model: &Motion) -> Motion {
        let world = world_from_model.clone();
        match (self.part_motions.get(index), self.parts.get(index)) {
            (Some(Some(own)), _) => world.then_all(own),
            (_, Some(part)) => world.then(part.model_from_part),
            (_, None) => world,
        }
    }

    /// Returns the motion of lamp `index` relative to its initial pose.
    pub(super) fn lamp_motion(&self, index: usize, world_from_model: &Motion) -> Motion {
        let world = world_from_model.clone();
        let chain = match self.lamp_motions.get(index) {
            Some(Some(own)) => world.then_all(own),
            _ => world,
        };
        let home = chain.at(0.0).inverse();
        chain.then(home)
    }

    /// Returns the parts in the world.
    #[must_use]
    pub fn placed(&self, world_from_model: DMat4) -> Vec<Part> {
        self.parts
            .iter()
            .map(|p| Part {
                name: p.name.clone(),
                mesh: p.mesh.clone(),
                material: p.material.clone(),
                world_from_part: world_from_model * p.model_from_part,
                mirror: false,
                albedo: None,
            })
            .collect()
    }
}

/// Reads a glTF file in its rest pose. Files that it names must be in its folder or below.
///
/// # Errors
/// The file, or one that it names, cannot be read, is damaged or too large.
pub fn load_gltf(path: &Path) -> Result<Model, SceneError> {
    load_gltf_playing(path, Playing::Nothing)
}

/// Reads a glTF file with one of its animations.
///
/// # Errors
/// As [`load_gltf`].
pub fn load_gltf_playing(path: &Path, playing: Playing<'_>) -> Result<Model, SceneError> {
    let file = path.display().to_string();
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let bytes = read_file(path)?;
    load_bytes(&bytes, &file, &|uri| read_relative(&folder, uri), playing)
}

/// Returns the files that a glTF file names, whether they exist or not.
#[must_use]
pub fn files_of_gltf(path: &Path) -> Vec<PathBuf> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let bytes = read_file(path).unwrap_or_default();
    let named = named_files(&bytes).into_iter();
    named.map(|name| folder.join(name)).collect()
}

/// Reads a file of limited size.
///
/// # Errors
/// It cannot be read, is no file or is too large.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, SceneError> {
    let refuse = |reason: String| SceneError::Unreadable {
        file: path.display().to_string(),
        reason,
    };
    let found = std::fs::metadata(path).map_err(|e| refuse(e.to_string()))?;
    if !found.is_file() {
        return Err(refuse("it is not a file".into()));
    }
    if found.len() > MAX_FILE_BYTES as u64 {
        return Err(refuse(format!("it is larger than {MAX_FILE_BYTES} bytes")));
    }
    std::fs::read(path).map_err(|e| refuse(e.to_string()))
}

/// Reads a file inside `folder`; links must not lead out of it.
fn read_relative(folder: &Path, uri: &str) -> Result<Vec<u8>, Fault> {
    let path = path_inside(folder, uri)?
        .ok_or("it lies outside the model's folder; put the file itself there")?;
    read_file(&path).map_err(|e| e.to_string())
}

/// Returns the path of a file, with links followed; `None` if it is outside `folder`.
///
/// # Errors
/// There is no such file.
pub(super) fn path_inside(folder: &Path, name: &str) -> Result<Option<PathBuf>, Fault> {
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let canonical = |p: &Path| p.canonicalize().map_err(|e| e.to_string());
    let (home, path) = (canonical(folder)?, canonical(&folder.join(name))?);
    Ok(path.starts_with(&home).then_some(path))
}

/// Reads a glTF from memory. `file` is its name, for messages; `resolve` returns the files that it
/// names.
///
/// # Errors
/// As [`load_gltf`].
pub fn load_gltf_bytes(bytes: &[u8], file: &str, resolve: &Resolver) -> Result<Model, SceneError> {
    load_bytes(bytes, file, resolve, Playing::Nothing)
}

fn load_bytes(
    bytes: &[u8],
    file: &str,
    resolve: &Resolver,
    playing: Playing<'_>,
) -> Result<Model, SceneError> {
    read(bytes, file, resolve, playing)
        .map_err(|reason| SceneError::broken(file, format!("not a usable glTF: {reason}")))
}

fn read(
    bytes: &[u8],
    file: &str,
    resolve: &Resolver,
    playing: Playing<'_>,
) -> Result<Model, Fault> {
    let source = Source::open(bytes, resolve)?;
    let skeleton = Skeleton::read(&source, playing, file)?;
    let mut reader = Reader {
        source: &source,
        materials: Materials::new(&source, resolve, file),
        meshes: HashMap::new(),
        model: Model {
            animations: names(&source.document),
            plays: skeleton.found,
            ..Model::default()
        },
        triangles: 0,
    };
    for (node, matrix) in placed_nodes(&source.document)? {
        let motion = skeleton.motion(node.index());
        let z_up = z_up_from_y_up();
        let matrix = motion
            .as_ref()
            .map_or(matrix, |m| z_up.transpose() * m.at(0.0) * z_up);
        if let Some(light) = node.light() {
            if reader.model.lamps.len() >= MAX_LAMPS {
                return Err(format!("more than {MAX_LAMPS} lights; remove some"));
            }
            let model = &mut reader.model;
            model.lamps.push(lamp(&node, &light, matrix)?);
            model.lamp_motions.push(motion.clone());
        }
        if let Some(mesh) = node.mesh() {
            if node.skin().is_some() || mesh.weights().is_some() {
                tracing::warn!(file, node = ?node.name(), "skin and morph weights are ignored: the mesh has its rest shape");
            }
            reader.add(&node, &mesh, matrix)?;
            let count = reader.model.parts.len();
            reader.model.part_motions.resize(count, motion);
        }
    }
    if reader.model.parts.is_empty() && reader.model.lamps.is_empty() {
        return Err("its scene has no triangles; export it with a mesh in its scene".into());
    }
    reader.model.warnings.extend(reader.materials.warning());
    Ok(reader.model)
}

/// Returns every node of the default scene with its transform in glTF's frame; without scenes,
/// every root node and its descendants.
fn placed_nodes(document: &gltf::Document) -> Result<Vec<(gltf::Node<'_>, DMat4)>, Fault> {
    let scene = document
        .default_scene()
        .or_else(|| document.scenes().next());
    let roots: Vec<gltf::Node> = match scene {
        Some(scene) => scene.nodes().collect(),
        None => {
            let children: std::collections::HashSet<usize> = document
                .nodes()
                .flat_map(|n| n.children().map(|c| c.index()).collect::<Vec<_>>())
                .collect();
            document
                .nodes()
                .filter(|n| !children.contains(&n.index()))
                .collect()
        }
    };
    let mut seen = vec![false; document.nodes().len()];
    let mut waiting: Vec<_> = roots
        .into_iter()
        .rev()
        .map(|n| (n, DMat4::IDENTITY, 0))
        .collect();
    let mut out = Vec::new();
    while let Some((node, parent, depth)) = waiting.pop() {
        let first = seen
            .get_mut(node.index())
            .is_some_and(|s| !std::mem::replace(s, true));
        if !first || depth > MAX_DEPTH {
            return Err("its nodes are not a tree; export it again".into());
        }
        let local = Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        let matrix = parent * local;
        if !matrix.is_finite() {
            return Err(format!(
                "the transform of node {} is not finite; export it again",
                node.index()
            ));
        }
        let children: Vec<_> = node.children().map(|c| (c, matrix, depth + 1)).collect();
        waiting.extend(children.into_iter().rev());
        out.push((node, matrix));
    }
    Ok(out)
}

/// Mesh and material of a primitive; `None` for points and lines.
type Drawable = Option<(Arc<Mesh>, Arc<Material>)>;

struct Reader<'s, 'b> {
    source: &'s Source<'b>,
    materials: Materials<'s, 'b>,
    /// By mesh and primitive.
    meshes: HashMap<(usize, usize), Drawable>,
    model: Model,
    triangles: usize,
}

impl Reader<'_, '_> {
    fn add(&mut self, node: &gltf::Node, mesh: &gltf::Mesh, matrix: DMat4) -> Result<(), Fault> {
        let determinant = DMat3::from_mat4(matrix).determinant();
        if determinant == 0.0 {
            // Blender hides objects by a scale of zero.
            return Ok(());
        }
        let name = node.name().or(mesh.name()).unwrap_or("object");
        for primitive in mesh.primitives() {
            let key = (mesh.index(), primitive.index());
            let known = match self.meshes.get(&key) {
                Some(known) => known.clone(),
                None => {
                    let new = self
                        .primitive(&primitive)
                        .map_err(|e| format!("`{name}` {e}"))?;
                    self.meshes.insert(key, new.clone());
                    new
                }
            };
            let Some((mesh, material)) = known else {
                continue;
            };
            self.triangles += mesh.indices.len() / 3;
            if self.triangles > MAX_TRIANGLES || self.model.parts.len() >= MAX_PARTS {
                return Err(format!(
                    "more than {MAX_TRIANGLES} triangles or {MAX_PARTS} parts; simplify it"
                ));
            }
            let z_up = z_up_from_y_up();
            self.model.parts.push(ModelPart {
                name: name.to_owned(),
                mesh,
                material,
                model_from_part: z_up * matrix * z_up.transpose(),
            });
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &gltf::Primitive) -> Result<Drawable, Fault> {
        if matches!(
            primitive.mode(),
            Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip
        ) {
            return Ok(None);
        }
        let material = self.materials.material(&primitive.material())?;
        let mesh = self.geometry(primitive, &material)?;
        Ok(Some((Arc::new(mesh), material.material)))
    }

    fn geometry(&self, primitive: &gltf::Primitive, material: &UvMaterial) -> Result<Mesh, Fault> {
        let positions = primitive
            .get(&gltf::Semantic::Positions)
            .ok_or("has no positions; export it again")?;
        let positions = self.source.floats::<3>(&positions, Dimensions::Vec3)?;
        let count = positions.len();
        let normals =
            self.attribute::<3>(primitive, &gltf::Semantic::Normals, Dimensions::Vec3, count)?;
        let tangents = self.attribute::<4>(
            primitive,
            &gltf::Semantic::Tangents,
            Dimensions::Vec4,
            count,
        )?;
        let uvs = self.attribute::<2>(
            primitive,
            &gltf::Semantic::TexCoords(material.uv.set),
            Dimensions::Vec2,
            count,
        )?;
        let indices = match primitive.indices() {
            Some(accessor) => self.source.indices(&accessor)?,
            None => (0..count as u32).collect(),
        };
        let mut mesh = Mesh {
            vertices: Vec::with_capacity(count),
            indices: as_triangles(primitive.mode(), indices),
        };
        for (i, p) in positions.into_iter().enumerate() {
            let at = |list: &Option<Vec<[f32; 3]>>| list.as_ref().and_then(|l| l.get(i).copied());
            let uv = uvs
                .as_ref()
                .and_then(|l| l.get(i))
                .map_or(Vec2::ZERO, |uv| Vec2::from(*uv));
            let tangent = tangents.as_ref().and_then(|l| l.get(i).copied());
            mesh.vertices.push(Vertex {
                position: z_up(p),
                normal: at(&normals).map_or(Vec3::ZERO, z_up),
                uv: material.uv.apply(uv),
                tangent: tangent.map_or(Vec4::ZERO, |[x, y, z, w]| z_up([x, y, z]).extend(w)),
            });
        }
        check_mesh(&mesh)?;
        complete(&mut mesh, normals.is_some(), tangents.is_some(), material);
        Ok(mesh)
    }

    /// Reads an attribute, if present; it must have `count` elements.
    fn attribute<const N: usize>(
        &self,
        primitive: &gltf::Primitive,
        semantic: &gltf::Semantic,
        shape: Dimensions,
        count: usize,
    ) -> Result<Option<Vec<[f32; N]>>, Fault>
    where
        [f32; N]: Default,
    {
        let Some(accessor) = primitive.get(semantic) else {
            return Ok(None);
        };
        let values = self.source.floats::<N>(&accessor, shape)?;
        if values.len() != count {
            return Err(format!(
                "has {} of {semantic:?} for {count} positions; export it again",
                values.len()
            ));
        }
        Ok(Some(values))
    }
}

/// Adds missing data: flat normals (section 3.7.2.1), and tangents for a normal map.
fn complete(mesh: &mut Mesh, has_normals: bool, has_tangents: bool, material: &UvMaterial) {
    if !has_normals {
        recompute_normals(mesh, 0.0);
    }
    normalise_directions(mesh);
    let mapped = material.material.normal_texture.is_some();
    if mapped && !(has_tangents && has_normals) {
        recompute_tangents(mesh);
    }
}

fn z_up([x, y, z]: [f32; 3]) -> Vec3 {
    Vec3::new(x, -z, y)
}

/// Converts strips and fans to separate triangles (section 3.7.2.1).
fn as_triangles(mode: Mode, indices: Vec<u32>) -> Vec<u32> {
    match mode {
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .flat_map(|(i, w)| {
                if i % 2 == 0 {
                    [w[0], w[1], w[2]]
                } else {
                    [w[0], w[2], w[1]]
                }
            })
            .collect(),
        Mode::TriangleFan => match indices.split_first() {
            Some((hub, rim)) => rim.windows(2).flat_map(|w| [w[0], w[1], *hub]).collect(),
            None => indices,
        },
        _ => {
            let mut indices = indices;
            indices.truncate(indices.len() / 3 * 3);
            indices
        }
    }
}

#[cfg(test)]
mod tests;
