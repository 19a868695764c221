//! Objects of a scene, and their displacement by a user.

use crate::mesh::Part;
use crate::motion::{Motion, Mover};
use crate::scene::Scene;
use glam::{DMat4, DVec3};
use std::iter::repeat;
use std::ops::{Range, RangeInclusive};

/// Scales that an [`Edit`] may have.
pub const EDIT_SCALES: RangeInclusive<f64> = 0.05..=20.0;
/// Maximum displacement per axis, metres.
pub const MAX_OFFSET: f64 = 1000.0;

/// A virtual object: parts that belong together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SceneObject {
    /// Name in the scene file, else that of its first part.
    pub name: String,
    /// Its parts, indices of [`Scene::virtual_parts`].
    pub parts: Range<usize>,
    /// Its lamps, indices of [`Scene::lamps`].
    pub lamps: Vec<usize>,
}

/// Displacement of an object from its place in the scene's files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edit {
    /// World, metres.
    pub offset: DVec3,
    /// About the vertical through the middle of its base, radians.
    pub turn: f64,
    /// About the middle of its base.
    pub scale: f64,
}

impl Default for Edit {
    fn default() -> Self {
        Self {
            offset: DVec3::ZERO,
            turn: 0.0,
            scale: 1.0,
        }
    }
}

impl Edit {
    /// Transform from the world of the scene's files to the world; `base` is the point that turning and
    /// scaling keep.
    fn to_matrix(self, base: DVec3) -> DMat4 {
        DMat4::from_translation(base + self.offset)
            * DMat4::from_rotation_z(self.turn)
            * DMat4::from_scale(DVec3::splat(self.scale))
            * DMat4::from_translation(-base)
    }
}

impl Scene {
    /// Returns the objects; a scene that does not name any is one object.
    #[must_use]
    pub fn object_list(&self) -> Vec<SceneObject> {
        if !self.objects.is_empty() || self.virtual_parts.is_empty() {
            return self.objects.clone();
        }
        vec![SceneObject {
            name: self.virtual_parts[0].name.clone(),
            parts: 0..self.virtual_parts.len(),
            lamps: Vec::new(),
        }]
    }

    /// Returns the scene with its objects displaced by `edits`, one for each; objects without one stay.
    #[must_use]
    pub fn edited(&self, edits: &[Edit]) -> Self {
        let mut scene = self.clone();
        let displacements = self.displacements(edits);
        for (object, by) in self.object_list().iter().zip(displacements) {
            if by != DMat4::IDENTITY {
                scene.displace(object, by);
            }
        }
        scene
    }

    /// Returns the displacement of each object by `edits`, world; the identity without an edit.
    #[must_use]
    pub fn displacements(&self, edits: &[Edit]) -> Vec<DMat4> {
        let edits = edits.iter().copied().chain(repeat(Edit::default()));
        let objects = self.object_list().into_iter().zip(edits);
        let displacement = |(object, edit): (SceneObject, Edit)| {
            if edit == Edit::default() {
                return DMat4::IDENTITY;
            }
            let parts = self.virtual_parts.get(object.parts);
            edit.to_matrix(middle_of_base(parts.unwrap_or_default()))
        };
        objects.map(displacement).collect()
    }

    fn displace(&mut self, object: &SceneObject, by: DMat4) {
        let displaced = |motion: &Motion| Motion::default().then(by).then_all(motion);
        for part in self
            .virtual_parts
            .get_mut(object.parts.clone())
            .unwrap_or_default()
        {
            part.world_from_part = by * part.world_from_part;
        }
        for mover in &mut self.motions.parts {
            if object.parts.contains(&mover.index) {
                mover.motion = displaced(&mover.motion);
            }
        }
        for &index in &object.lamps {
            match self.motions.lamps.binary_search_by_key(&index, |m| m.index) {
                Ok(at) => {
                    let mover = &mut self.motions.lamps[at];
                    mover.motion = displaced(&mover.motion);
                }
                Err(at) => {
                    let motion = displaced(&Motion::default());
                    self.motions.lamps.insert(at, Mover { index, motion });
                }
            }
        }
    }
}

/// Returns the middle of the lowest face of the box around parts, world, metres.
fn middle_of_base(parts: &[Part]) -> DVec3 {
    let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let corners = parts.iter().flat_map(|part| {
        let each = part.mesh.vertices.iter();
        each.map(|v| part.world_from_part.transform_point3(v.position.as_dvec3()))
    });
    let (low, high) = corners.fold(nothing, |(low, high), p| (low.min(p), high.max(p)));
    if low.x > high.x {
        return DVec3::ZERO;
    }
    (0.5 * (low + high)).with_z(low.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Material;
    use crate::primitives;
    use glam::Vec3;
    use std::f64::consts::FRAC_PI_2;
    use std::sync::Arc;

    fn part(name: &str, at: DVec3) -> Part {
        Part {
            name: name.to_owned(),
            mesh: Arc::new(primitives::cuboid(Vec3::new(0.4, 0.2, 0.2))),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::from_translation(at),
            mirror: false,
            albedo: None,
        }
    }

    fn object(name: &str, parts: Range<usize>) -> SceneObject {
        SceneObject {
            name: name.to_owned(),
            parts,
            lamps: Vec::new(),
        }
    }

    #[test]
    fn an_object_turns_and_grows_about_its_base_and_others_stay() {
        let scene = Scene {
            virtual_parts: vec![part("a", DVec3::X), part("b", DVec3::ZERO)],
            objects: vec![object("a", 0..1), object("b", 1..2)],
            ..Scene::default()
        };
        let edit = Edit {
            offset: DVec3::Y,
            turn: FRAC_PI_2,
            scale: 2.0,
        };
        let edited = scene.edited(&[edit]);
        let base = middle_of_base(&scene.virtual_parts[..1]);
        let moved = middle_of_base(&edited.virtual_parts[..1]);
        assert!(moved.distance(base + DVec3::Y) < 1e-9, "{moved}");
        // The long side, 0.4 m along X, is 0.8 m along Y.
        let matrix = edited.virtual_parts[0].world_from_part;
        let along = matrix.transform_vector3(DVec3::X);
        assert!(along.distance(2.0 * DVec3::Y) < 1e-9, "{along}");
        assert_eq!(
            edited.virtual_parts[1].world_from_part,
            scene.virtual_parts[1].world_from_part
        );
        let same = scene.edited(&[Edit::default(); 2]);
        assert_eq!(
            same.virtual_parts[0].world_from_part,
            scene.virtual_parts[0].world_from_part
        );
    }

    #[test]
    fn a_moving_part_and_the_lamps_of_an_object_go_with_it() {
        let still = Motion::default().then(DMat4::from_translation(DVec3::Z));
        let mut scene = Scene {
            virtual_parts: vec![part("a", DVec3::Z)],
            objects: vec![SceneObject {
                lamps: vec![1],
                ..object("a", 0..1)
            }],
            ..Scene::default()
        };
        scene.motions.parts = vec![Mover {
            index: 0,
            motion: still,
        }];
        let edit = Edit {
            offset: DVec3::X,
            ..Edit::default()
        };
        let edited = scene.edited(&[edit]);
        let place = edited.motions.parts[0].motion.at(3.0);
        assert!(place.w_axis.truncate().distance(DVec3::X + DVec3::Z) < 1e-9);
        assert_eq!(edited.motions.lamps.len(), 1);
        let lamp = &edited.motions.lamps[0];
        let at = lamp.motion.at(0.0).transform_point3(DVec3::Y);
        assert_eq!(lamp.index, 1);
        assert!(at.distance(DVec3::X + DVec3::Y) < 1e-9);
    }

    #[test]
    fn a_scene_without_named_objects_is_one_object() {
        let scene = Scene {
            virtual_parts: vec![part("body", DVec3::X), part("lid", DVec3::Z)],
            ..Scene::default()
        };
        assert_eq!(scene.object_list(), [object("body", 0..2)]);
        assert!(Scene::default().object_list().is_empty());
    }
}
