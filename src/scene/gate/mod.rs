//! A Japanese temple gate (chūmon) of the seventh century, for demonstrations and benchmarks (virtual
//! restoration on site, Kakuta et al. 2004, 2007): a stone platform with steps, round columns with
//! entasis, brackets, a hip-and-gable roof of round tiles with raised corners and ridge ornaments,
//! white walls, vermilion wood, an open doorway. It stands on z = 0 and faces −Y; about 6.1 m wide,
//! 5.6 m deep with its steps, 6.3 m high.

mod body;
mod roof;
mod solids;

use super::gltf_file::{Model, ModelPart};
use crate::mesh::Material;
use glam::{DMat4, Vec3};
use penumbra_camera::linear_from_srgb;
use solids::Solids;
use std::sync::Arc;

/// Level of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Detail {
    /// Sides of a column.
    column: u32,
    /// Sides of a round tile.
    tile: u32,
    /// Segments of curved parts.
    along: u32,
}

impl Detail {
    fn from_segments(segments: u32) -> Self {
        let segments = segments.clamp(3, 2048);
        Self {
            column: (segments * 9 / 16).clamp(6, 256),
            tile: (segments / 8).clamp(4, 64),
            along: (segments / 8).clamp(3, 128),
        }
    }
}

/// Creates the gate. `segments` as for round shapes: 64 gives the 58,500 triangles of the paper's
/// model, 16 about 20,000.
#[must_use]
pub fn temple_gate(segments: u32) -> Model {
    let detail = Detail::from_segments(segments);
    let (mut timber, mut tips, mut plaster) =
        (Solids::default(), Solids::default(), Solids::default());
    body::timber(&mut timber, detail);
    roof::wood(&mut timber, &mut tips, detail);
    body::plaster(&mut plaster);
    roof::gables(&mut plaster, detail);
    let (doors, studs) = body::doors(detail);
    let parts = [
        ("platform", body::stone(detail), 0x9d978a, 0.9),
        ("timber", timber, 0xb23a22, 0.55),
        ("rafter tips", tips, 0xd9a63c, 0.6),
        ("plaster", plaster, 0xeae4d6, 0.95),
        ("lattice", body::lattice(), 0x3f6d52, 0.6),
        ("doors", doors, 0x8f2f1e, 0.55),
        ("studs", studs, 0x5b4a2c, 0.4),
        ("roof", roof::tiles(detail), 0x565b61, 0.5),
    ];
    let part = |(name, solids, colour, roughness): (&str, Solids, u32, f32)| ModelPart {
        name: name.to_owned(),
        mesh: Arc::new(solids.mesh()),
        material: Arc::new(material(colour, roughness)),
        model_from_part: DMat4::IDENTITY,
    };
    Model {
        parts: parts.map(part).into(),
        ..Model::default()
    }
}

fn material(srgb: u32, roughness: f32) -> Material {
    let linear = |shift: u32| linear_from_srgb(((srgb >> shift) & 255) as f32 / 255.0);
    Material {
        base_colour: Vec3::new(linear(16), linear(8), linear(0)).extend(1.0),
        roughness,
        ..Material::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check_mesh, triangles};
    use std::collections::HashMap;

    fn count(model: &Model) -> usize {
        model.parts.iter().map(|p| p.mesh.indices.len() / 3).sum()
    }

    #[test]
    fn every_part_is_closed_and_faces_outwards() {
        for segments in [3, 24, 64] {
            for part in &temple_gate(segments).parts {
                check_mesh(&part.mesh).unwrap();
                let bits = |v: Vec3| [v.x + 0.0, v.y + 0.0, v.z + 0.0].map(f32::to_bits);
                let mut edges: HashMap<_, i32> = HashMap::new();
                let mut volume = 0.0;
                for [a, b, c] in triangles(&part.mesh) {
                    volume += a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3())) / 6.0;
                    for (p, q) in [(a, b), (b, c), (c, a)] {
                        *edges.entry((bits(p), bits(q))).or_default() += 1;
                        *edges.entry((bits(q), bits(p))).or_default() -= 1;
                    }
                }
                let open = edges.values().filter(|n| **n != 0).count();
                assert_eq!(open, 0, "{}", part.name);
                assert!(volume > 0.0, "{}: {volume}", part.name);
            }
        }
    }

    #[test]
    fn has_the_papers_triangle_count_and_the_size_of_a_gate() {
        let counts = [16, 32, 48, 128].map(|n| count(&temple_gate(n)));
        assert!(counts.is_sorted() && counts[0] > 15_000, "{counts:?}");
        let model = temple_gate(64);
        let corners = model
            .parts
            .iter()
            .flat_map(|p| p.mesh.vertices.iter().map(|v| v.position));
        let (low, high) = corners.fold((Vec3::MAX, Vec3::MIN), |(l, h), p| (l.min(p), h.max(p)));
        assert_eq!(count(&model), 58_500);
        assert!((high - low - Vec3::new(6.2, 5.6, 6.2)).abs().max_element() < 0.4);
    }
}
