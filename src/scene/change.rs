//! Classifies the change from one scene to another, which decides what must be computed again:
//! nothing if only materials changed, little if the virtual parts moved as one rigid body.

use crate::mesh::{Mesh, Part};
use crate::scene::Scene;
use glam::{DMat3, DMat4, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use std::sync::Arc;

/// Tolerance for equal positions, metres, and for unit vectors.
const SAME: f64 = 1e-6;

/// Change from one scene to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Only materials, lamps or names differ.
    Looks,
    /// All virtual parts moved as one rigid body; real parts did not.
    Moved {
        /// Rigid motion from the old to the new pose, world.
        new_from_old: RigidTransform,
    },
    /// Parts were changed, added or removed.
    Shapes,
}

impl Change {
    /// Classifies the change from `old` to `new`.
    #[must_use]
    pub fn between(old: &Scene, new: &Scene) -> Self {
        let real = same_parts(&old.phantom_parts, &new.phantom_parts)
            && old.ground_height == new.ground_height;
        if !real || old.virtual_parts.len() != new.virtual_parts.len() {
            return Self::Shapes;
        }
        let pairs = || old.virtual_parts.iter().zip(&new.virtual_parts);
        let Some(motion) = pairs()
            .next()
            .map_or(Some(RigidTransform::IDENTITY), |(a, b)| motion(a, b))
        else {
            return Self::Shapes;
        };
        let moved = |part: &Part| Part {
            world_from_part: motion.to_matrix() * part.world_from_part,
            ..part.clone()
        };
        if !pairs().all(|(a, b)| is_same(&moved(a), b)) || !same_planes(old, new, motion) {
            return Self::Shapes;
        }
        if is_identity(motion) {
            Self::Looks
        } else {
            Self::Moved {
                new_from_old: motion,
            }
        }
    }
}

/// Whether a motion keeps the vertical and all heights, so that shadows on level ground move with
/// their casters.
#[must_use]
pub fn is_level(motion: RigidTransform) -> bool {
    let up = motion.rotation * DVec3::Z;
    up.distance(DVec3::Z) < SAME && motion.translation.z.abs() < SAME
}

/// Whether both parts have the same shape and pose.
#[must_use]
pub fn is_same(a: &Part, b: &Part) -> bool {
    let close = |(x, y): (&f64, &f64)| (x - y).abs() < SAME;
    let (m, n) = (
        a.world_from_part.to_cols_array(),
        b.world_from_part.to_cols_array(),
    );
    m.iter().zip(&n).all(close) && is_same_shape(a, b)
}

fn is_same_shape(a: &Part, b: &Part) -> bool {
    let cut = |p: &Part| p.material.alpha_cutoff;
    let is_ground = |p: &Part| p.name == "ground";
    (Arc::ptr_eq(&a.mesh, &b.mesh) || has_same_triangles(&a.mesh, &b.mesh))
        && a.mirror == b.mirror
        && a.material.double_sided == b.material.double_sided
        && is_ground(a) == is_ground(b)
        && cut(a).to_bits() == cut(b).to_bits()
}

fn has_same_triangles(a: &Mesh, b: &Mesh) -> bool {
    let places = |m: &Mesh| m.vertices.len();
    places(a) == places(b)
        && a.indices == b.indices
        && a.vertices
            .iter()
            .zip(&b.vertices)
            .all(|(v, w)| v.position == w.position && v.normal == w.normal)
}

/// Whether both lists hold the same parts in the same order and poses.
#[must_use]
pub fn same_parts(a: &[Part], b: &[Part]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_same(a, b))
}

/// Returns the rigid motion from the pose of `a` to that of `b`; `None` if there is none.
fn motion(a: &Part, b: &Part) -> Option<RigidTransform> {
    let carried: DMat4 = b.world_from_part * a.world_from_part.inverse();
    let linear = DMat3::from_mat4(carried);
    let error = linear.transpose() * linear - DMat3::IDENTITY;
    let rigid = error.to_cols_array().iter().all(|v| v.abs() < SAME) && linear.determinant() > 0.0;
    rigid.then(|| {
        let rotation = DQuat::from_mat3(&linear).normalize();
        RigidTransform::new(rotation, carried.w_axis.truncate())
    })
}

fn is_identity(motion: RigidTransform) -> bool {
    motion.translation.length() < SAME
        && DVec3::AXES
            .iter()
            .all(|axis| (motion.rotation * *axis).distance(*axis) < SAME)
}

/// Whether the planes that were placed by hand underwent the same motion.
fn same_planes(old: &Scene, new: &Scene, motion: RigidTransform) -> bool {
    let close = |a: DVec3, b: DVec3| a.distance(b) < SAME;
    old.planes.len() == new.planes.len()
        && old.planes.iter().zip(&new.planes).all(|(a, b)| {
            let a = a.moved(motion);
            close(a.centre, b.centre)
                && close(a.right, b.right)
                && close(a.up, b.up)
                && (a.half_size, a.depth, a.layer, a.receiver, &a.parts)
                    == (b.half_size, b.depth, b.layer, b.receiver, &b.parts)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Material;
    use crate::primitives;
    use glam::{Vec3, Vec4};

    fn part(place: DMat4) -> Part {
        Part {
            name: "box".into(),
            mesh: Arc::new(primitives::cuboid(Vec3::ONE)),
            material: Arc::new(Material::default()),
            world_from_part: place,
            mirror: false,
            albedo: None,
        }
    }

    fn scene() -> Scene {
        let at = |x: f64| part(DMat4::from_translation(DVec3::new(x, 0.0, 0.0)));
        Scene {
            virtual_parts: vec![at(0.0), at(3.0)],
            phantom_parts: vec![at(-5.0)],
            ..Scene::default()
        }
    }

    fn moved(scene: &Scene, motion: RigidTransform) -> Scene {
        let mut scene = scene.clone();
        for part in &mut scene.virtual_parts {
            part.world_from_part = motion.to_matrix() * part.world_from_part;
        }
        scene
    }

    #[test]
    fn changed_material_is_a_change_of_looks() {
        let (old, mut new) = (scene(), scene());
        new.virtual_parts[0].material = Arc::new(Material {
            base_colour: Vec4::new(1.0, 0.0, 0.0, 1.0),
            ..Material::default()
        });
        assert_eq!(Change::between(&old, &new), Change::Looks);
        assert_eq!(
            Change::between(&Scene::default(), &Scene::default()),
            Change::Looks
        );
    }

    #[test]
    fn finds_rigid_motion_and_whether_it_is_level() {
        let yaw = RigidTransform::new(DQuat::from_rotation_z(0.7), DVec3::new(1.0, 2.0, 0.0));
        let tilt = RigidTransform::new(DQuat::from_rotation_x(0.2), DVec3::ZERO);
        let lift = RigidTransform::new(DQuat::IDENTITY, DVec3::Z * 0.5);
        for (motion, level) in [(yaw, true), (tilt, false), (lift, false)] {
            let old = scene();
            let Change::Moved { new_from_old } = Change::between(&old, &moved(&old, motion)) else {
                panic!("{motion:?} was not found");
            };
            let corner = DVec3::new(1.0, -2.0, 3.0);
            let error = new_from_old
                .transform_point(corner)
                .distance(motion.transform_point(corner));
            assert!(error < 1e-9, "{error}");
            assert_eq!(is_level(new_from_old), level);
        }
    }

    #[test]
    fn non_rigid_changes_and_changes_of_single_parts_are_changes_of_shape() {
        let old = scene();
        let change = |edit: &dyn Fn(&mut Scene)| {
            let mut new = scene();
            edit(&mut new);
            Change::between(&old, &new)
        };
        let all = |scene: &mut Scene, m: DMat4| {
            for part in &mut scene.virtual_parts {
                part.world_from_part = m * part.world_from_part;
            }
        };
        let shift = DMat4::from_translation(DVec3::X);
        let edits: [&dyn Fn(&mut Scene); 6] = [
            &|s| s.virtual_parts[1].world_from_part = DMat4::from_translation(DVec3::Y),
            &|s| s.phantom_parts[0].world_from_part = DMat4::from_translation(DVec3::Y),
            &|s| all(s, DMat4::from_scale(DVec3::splat(1.5))),
            &|s| all(s, DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0))),
            &|s| s.virtual_parts.truncate(1),
            &|s| {
                all(s, shift);
                s.virtual_parts[0].mesh = Arc::new(primitives::cuboid(Vec3::splat(0.5)));
            },
        ];
        for (i, edit) in edits.iter().enumerate() {
            assert_eq!(change(edit), Change::Shapes, "edit {i}");
        }
    }
}
