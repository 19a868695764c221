//! Key of a bake: a hash of everything on which it depends.

use super::content::write_plane;
use crate::mesh::Part;
use crate::planes::{BakeSettings, PlaneSettings, Receiver};
use crate::scene::Scene;
use sha2::{Digest, Sha256};

/// Version of the generation and baking of planes. Increment it whenever a scene yields other results.
const METHOD: u32 = 3;
/// Number of bytes that are collected before they are hashed.
const BATCH: usize = 1 << 16;

/// SHA-256 of the versions of format and method, the geometry in the world, planes placed by hand, and
/// the settings. Names (except the ground's), colours and lamps have no effect.
#[must_use]
pub fn key(scene: &Scene, planes: &PlaneSettings, settings: &BakeSettings) -> [u8; 32] {
    let mut hash = Hash::default();
    let BakeSettings {
        resolution,
        frequency,
        samples,
    } = *settings;
    for n in [super::VERSION, METHOD, resolution, frequency, samples] {
        hash.add(&n.to_le_bytes());
    }
    let PlaneSettings {
        count,
        clusters,
        offset_m,
        receiver,
    } = *planes;
    for n in [count, clusters, u32::from(receiver == Receiver::Plane)] {
        hash.add(&n.to_le_bytes());
    }
    hash.add(&offset_m.to_bits().to_le_bytes());
    hash.parts(&scene.virtual_parts);
    hash.parts(&scene.phantom_parts);
    let ground = scene.ground_height.map_or(u64::MAX, f64::to_bits);
    hash.add(&ground.to_le_bytes());
    hash.count(scene.planes.len());
    for plane in &scene.planes {
        write_plane(&mut hash.waiting, plane);
    }
    hash.finish()
}

#[derive(Default)]
struct Hash {
    sha: Sha256,
    waiting: Vec<u8>,
}

impl Hash {
    fn add(&mut self, bytes: &[u8]) {
        self.waiting.extend(bytes);
        if self.waiting.len() >= BATCH {
            self.sha.update(&self.waiting);
            self.waiting.clear();
        }
    }

    fn count(&mut self, n: usize) {
        self.add(&(n as u64).to_le_bytes());
    }

    fn parts(&mut self, parts: &[Part]) {
        self.count(parts.len());
        for part in parts {
            self.part(part);
        }
    }

    fn part(&mut self, part: &Part) {
        for x in part.world_from_part.to_cols_array() {
            self.add(&x.to_bits().to_le_bytes());
        }
        let material = &part.material;
        let is_ground = part.name == "ground";
        let marks = [part.mirror, material.double_sided, is_ground];
        self.add(&marks.map(u8::from));
        self.add(&material.alpha_cutoff.to_bits().to_le_bytes());
        self.count(part.mesh.vertices.len());
        for v in &part.mesh.vertices {
            // A plane's camera renders normals.
            for x in v.position.to_array().into_iter().chain(v.normal.to_array()) {
                self.add(&x.to_bits().to_le_bytes());
            }
        }
        self.count(part.mesh.indices.len());
        for i in &part.mesh.indices {
            self.add(&i.to_le_bytes());
        }
        if material.alpha_cutoff > 0.0 {
            self.cut_out(part);
        }
    }

    /// Adds the properties that determine the holes of a cut-out material.
    fn cut_out(&mut self, part: &Part) {
        self.add(&part.material.base_colour.w.to_bits().to_le_bytes());
        for v in &part.mesh.vertices {
            for x in v.uv.to_array() {
                self.add(&x.to_bits().to_le_bytes());
            }
        }
        let Some(texture) = &part.material.base_colour_texture else {
            return;
        };
        self.count(texture.width as usize);
        for texel in texture.rgba.chunks(BATCH) {
            self.add(texel);
        }
    }

    fn finish(mut self) -> [u8; 32] {
        self.sha.update(&self.waiting);
        self.sha.finalize().into()
    }
}
