//! Lamps inside of things, whose light nobody would see.

use crate::mesh::{Part, Scene};
use glam::{DMat4, DVec3};
use std::f64::consts::TAU;

/// Share of all directions that a closed part blocks from inside; an open shade blocks less.
const CLOSED: f64 = 0.99;

/// Why nothing of lamp `number`'s light comes out, wherever its path leads it: what it is in. One that
/// hangs on something that moves is looked for where that is at the beginning.
#[must_use]
pub fn enclosure(scene: &Scene, number: usize) -> Option<String> {
    let lamp = scene.lamps.get(number)?;
    let carrier = scene.motions.lamps.iter().find(|m| m.index == number);
    let place = carrier.map_or(DMat4::IDENTITY, |m| m.motion.at(0.0));
    let places = || {
        let shining = lamp.keys.iter().filter(|key| key.gain > 0.0);
        shining.map(|key| place.transform_point3(key.position))
    };
    let first = places().next()?;
    let below = |p: DVec3| scene.ground_height.is_some_and(|height| p.z < height);
    if places().all(below) {
        return Some("below the ground".to_owned());
    }
    let holds = |part: &&Part| winds_around(part, first) && places().all(|p| winds_around(part, p));
    let object = scene.virtual_parts.iter().find(holds);
    let phantom = || scene.phantom_parts.iter().find(holds);
    object
        .map(|part| format!("inside the object \"{}\"", part.name))
        .or_else(|| phantom().map(|part| format!("inside the phantom \"{}\"", part.name)))
}

/// The warning about lamp `number`; `place` says where it was written down.
#[must_use]
pub fn warning(scene: &Scene, number: usize, place: &str) -> Option<String> {
    let reason = enclosure(scene, number)?;
    let name = &scene.lamps.get(number)?.name;
    Some(format!(
        "{place}the lamp \"{name}\" is {reason}, which hides its light; move it out"
    ))
}

/// The winding number of a part's triangles about a point, by the solid angles that they fill (Van
/// Oosterom and Strackee 1983).
fn winds_around(part: &Part, point: DVec3) -> bool {
    let place = |i: u32| {
        let vertex = part.mesh.vertices.get(i as usize)?;
        Some(
            part.world_from_part
                .transform_point3(vertex.position.as_dvec3())
                - point,
        )
    };
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in (0..part.mesh.vertices.len() as u32).filter_map(place) {
        (low, high) = (low.min(p), high.max(p));
    }
    if low.max_element() > 0.0 || high.min_element() < 0.0 {
        return false;
    }
    let solid_angle = |t: &[u32]| {
        let (Some(a), Some(b), Some(c)) = (place(t[0]), place(t[1]), place(t[2])) else {
            return 0.0;
        };
        let (x, y, z) = (a.length(), b.length(), c.length());
        let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
        2.0 * a.dot(b.cross(c)).atan2(below)
    };
    let sum: f64 = part.mesh.indices.chunks_exact(3).map(solid_angle).sum();
    sum.abs() / (2.0 * TAU) > CLOSED
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
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
    fn a_lamp_in_a_ball_is_named_and_one_beside_it_is_not() {
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
    fn a_lamp_goes_along_with_what_it_hangs_on() {
        let mut carried = with(&scene(), lamp(&[DVec3::new(0.0, 0.1, 0.1)]));
        assert_eq!(enclosure(&carried, 0), None);
        let motion = Motion::default().then(DMat4::from_translation(DVec3::Z));
        carried.motions.lamps = vec![Mover { index: 0, motion }];
        assert!(enclosure(&carried, 0).is_some());
    }

    #[test]
    fn mirrored_parts_hide_lamps_and_open_ones_do_not() {
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
