//! Finds lamps inside closed objects or below the ground, whose light is invisible.

use crate::mesh::Part;
use crate::scene::Scene;
use glam::{DMat4, DVec3};
use std::cell::Cell;
use std::f64::consts::TAU;

/// Minimum share of all directions that a closed part blocks from inside; an open lampshade blocks
/// less.
const MIN_BLOCKED: f64 = 0.99;
/// Maximum number of vertices and triangles that are looked at for all lamps of a scene, a tenth of a
/// second: a long path in a large model is left untested instead of delaying the scene.
const MAX_WORK: usize = 4_000_000;

/// Returns where lamp `index` is enclosed along its entire path; `None` if its light gets out. A
/// lamp on a moving carrier is tested at the carrier's initial pose. Long paths in large models are not
/// tested.
#[must_use]
pub fn enclosure(scene: &Scene, index: usize) -> Option<String> {
    let lamp = scene.lamps.get(index)?;
    let carrier = scene.motions.lamps.iter().find(|m| m.index == index);
    let world_from_carrier = carrier.map_or(DMat4::IDENTITY, |m| m.motion.at(0.0));
    let positions = || {
        let shining = lamp.keys.iter().filter(|key| key.gain > 0.0);
        shining.map(|key| world_from_carrier.transform_point3(key.position))
    };
    let first = positions().next()?;
    let below = |p: DVec3| scene.ground_height.is_some_and(|height| p.z < height);
    if positions().all(below) {
        return Some("below the ground".to_owned());
    }
    let work = Cell::new(MAX_WORK / scene.lamps.len());
    let encloses = |part: &Part, p: DVec3| {
        let cost = part.mesh.vertices.len() + part.mesh.indices.len() / 3;
        let left = work.get().checked_sub(cost);
        work.set(left.unwrap_or_default());
        left.is_some() && encloses(part, p)
    };
    let holds = |part: &&Part| encloses(part, first) && positions().all(|p| encloses(part, p));
    let object = scene.virtual_parts.iter().find(holds);
    let phantom = || scene.phantom_parts.iter().find(holds);
    object
        .map(|part| format!("inside the object \"{}\"", part.name))
        .or_else(|| phantom().map(|part| format!("inside the phantom \"{}\"", part.name)))
}

/// Returns the warning about an enclosed lamp `index`. `place` is the message's prefix: file, line
/// and key.
#[must_use]
pub fn warning(scene: &Scene, index: usize, place: &str) -> Option<String> {
    let reason = enclosure(scene, index)?;
    let name = &scene.lamps.get(index)?.name;
    Some(format!(
        "{place}the lamp \"{name}\" is {reason}, which hides its light; move it out"
    ))
}

/// Whether a part encloses a point: its winding number by the triangles' solid angles (Van Oosterom
/// and Strackee 1983).
fn encloses(part: &Part, point: DVec3) -> bool {
    let from_point = |i: u32| {
        let vertex = part.mesh.vertices.get(i as usize)?;
        Some(
            part.world_from_part
                .transform_point3(vertex.position.as_dvec3())
                - point,
        )
    };
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in (0..part.mesh.vertices.len() as u32).filter_map(from_point) {
        (low, high) = (low.min(p), high.max(p));
    }
    if low.max_element() > 0.0 || high.min_element() < 0.0 {
        return false;
    }
    let solid_angle = |t: &[u32]| {
        let (Some(a), Some(b), Some(c)) = (from_point(t[0]), from_point(t[1]), from_point(t[2]))
        else {
            return 0.0;
        };
        let (x, y, z) = (a.length(), b.length(), c.length());
        let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
        2.0 * a.dot(b.cross(c)).atan2(below)
    };
    let sum: f64 = part.mesh.indices.chunks_exact(3).map(solid_angle).sum();
    sum.abs() / (2.0 * TAU) > MIN_BLOCKED
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Material, Mesh};
    use crate::motion::{Motion, Mover};
    use crate::primitives;
    use crate::virtual_light::{VirtualLight, VirtualLightKey, VirtualLightKind};
    use glam::Vec3;
    use std::sync::Arc;

    fn lamp(places: &[DVec3]) -> VirtualLight {
        let key = |(i, position): (usize, &DVec3)| VirtualLightKey {
            seconds: i as f64,
            position: *position,
            target: None,
            gain: 1.0,
        };
        VirtualLight {
            name: "bulb".into(),
            kind: VirtualLightKind::Point,
            intensity: Vec3::ONE,
            screen: None,
            keys: places.iter().enumerate().map(key).collect(),
            repeat: None,
        }
    }

    fn part(mesh: Mesh, place: DMat4) -> Part {
        Part {
            name: "ball".into(),
            mesh: Arc::new(mesh),
            material: Arc::new(Material::default()),
            world_from_part: place,
            mirror: false,
            albedo: None,
        }
    }

    #[test]
    fn long_path_in_a_large_object_is_not_tested() {
        let mut scene = scene();
        let ball = primitives::sphere(0.2, 512, 256);
        scene.virtual_parts = vec![part(ball, DMat4::from_translation(DVec3::Z))];
        scene.lamps = vec![lamp(&[DVec3::Z; 2])];
        assert!(enclosure(&scene, 0).is_some());
        scene.lamps = vec![lamp(&vec![DVec3::Z; 1000]); 32];
        assert!((0..32).all(|i| enclosure(&scene, i).is_none()));
    }

    fn scene() -> Scene {
        let place = DMat4::from_translation(DVec3::Z);
        Scene {
            virtual_parts: vec![part(primitives::sphere(0.2, 32, 16), place)],
            ground_height: Some(0.0),
            ..Scene::default()
        }
    }

    fn with(scene: &Scene, lamp: VirtualLight) -> Scene {
        Scene {
            lamps: vec![lamp],
            ..scene.clone()
        }
    }

    fn enclosed(scene: &Scene, places: &[DVec3]) -> Option<String> {
        enclosure(&with(scene, lamp(places)), 0)
    }

    #[test]
    fn warns_of_a_lamp_inside_a_ball_and_not_of_one_beside_it() {
        let (inside, beside) = (DVec3::new(0.0, 0.1, 1.1), DVec3::new(0.19, 0.19, 1.0));
        let found = warning(
            &with(&scene(), lamp(&[inside])),
            0,
            "s.toml:3: `lamp[0].position_m`: ",
        );
        let text = "s.toml:3: `lamp[0].position_m`: the lamp \"bulb\" is inside the object \"ball\", which hides its light; move it out";
        assert_eq!(found.as_deref(), Some(text));
        assert_eq!(enclosed(&scene(), &[beside]), None);
        assert_eq!(enclosed(&scene(), &[inside, beside]), None);
        let under = [DVec3::new(0.0, 0.0, -0.1)];
        assert_eq!(enclosed(&scene(), &under).unwrap(), "below the ground");
    }

    #[test]
    fn tests_a_lamp_at_the_pose_of_its_carrier() {
        let mut carried = with(&scene(), lamp(&[DVec3::new(0.0, 0.1, 0.1)]));
        assert_eq!(enclosure(&carried, 0), None);
        let motion = Motion::default().then(DMat4::from_translation(DVec3::Z));
        carried.motions.lamps = vec![Mover { index: 0, motion }];
        assert!(enclosure(&carried, 0).is_some());
    }

    #[test]
    fn mirrored_parts_enclose_lamps_and_open_parts_do_not() {
        let mut mirrored = scene();
        mirrored.virtual_parts[0].world_from_part *= DMat4::from_scale(DVec3::new(-1.0, 2.0, 1.0));
        let phantoms = Scene {
            phantom_parts: std::mem::take(&mut mirrored.virtual_parts),
            ..Scene::default()
        };
        let found = enclosed(&phantoms, &[DVec3::new(0.0, 0.3, 1.0)]).unwrap();
        assert_eq!(found, "inside the phantom \"ball\"");
        let mut open = primitives::sphere(0.2, 32, 16);
        open.indices.truncate(open.indices.len() * 3 / 4);
        let mut shade = scene();
        shade.virtual_parts = vec![part(open, DMat4::from_translation(DVec3::Z))];
        assert_eq!(enclosed(&shade, &[DVec3::Z]), None);
    }
}
