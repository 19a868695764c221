#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
//! Planes of real and of damaged models.

use super::*;
use crate::scene::{Material, Mesh, primitives};
use glam::{DMat4, DVec2, Vec3};
use std::sync::Arc;

pub(super) fn part(name: &str, mesh: Mesh, at: DVec3) -> Part {
    Part {
        name: name.into(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(at),
        mirror: false,
        albedo: None,
    }
}

fn scene(parts: Vec<Part>) -> Scene {
    Scene {
        virtual_parts: parts,
        phantom_parts: vec![part("ground", primitives::plane(10.0, 10.0), DVec3::ZERO)],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

/// Share of the area of `parts` that can be seen from outside and does not face down, which
/// some plane of `layer` holds with a cosine above 0.2.
pub(super) fn coverage(planes: &[ShadowingPlane], parts: &[Part], layer: Layer) -> f64 {
    let mut surface = Surface::new(parts, &all(parts)).unwrap();
    let extent = longest(surface.bounds());
    surface.weigh(&PhantomRays::from_parts(parts), extent);
    let (mut held, mut whole) = (0.0, 0.0);
    for f in surface.fragments.iter().filter(|f| f.normal.z > -0.3) {
        whole += f.area;
        let holds = |p: &&ShadowingPlane| {
            let from = f.centre - p.centre;
            let flat = DVec2::new(from.dot(p.right), from.dot(p.up)).abs();
            let depth = -from.dot(p.normal());
            p.layer == layer
                && f.normal.dot(p.normal()) > 0.2
                && flat.cmple(p.half_size).all()
                && (0.0..=p.depth).contains(&depth)
        };
        if planes.iter().any(|p| holds(&p)) {
            held += f.area;
        }
    }
    held / whole
}

#[test]
fn a_box_gets_its_five_sides_and_the_ground() {
    let scene = scene(vec![part(
        "box",
        primitives::cuboid(Vec3::new(0.2, 0.1, 0.3)),
        DVec3::ZERO,
    )]);
    let planes = generate(&scene, &PlaneSettings::default()).unwrap();
    let ground: Vec<_> = planes.iter().filter(|p| p.layer == Layer::Real).collect();
    assert_eq!(ground.len(), 3);
    let virtual_planes: Vec<_> = planes
        .iter()
        .filter(|p| p.layer == Layer::Virtual)
        .collect();
    for normal in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z] {
        assert!(
            virtual_planes
                .iter()
                .any(|p| p.normal().dot(normal) > 0.999),
            "{normal}"
        );
    }
    eprintln!("{} planes", planes.len());
    assert!(coverage(&planes, &scene.virtual_parts, Layer::Virtual) > 0.999);
}

#[test]
fn round_things_are_covered() {
    for (name, mesh) in [
        ("torus", primitives::torus(0.08, 0.02, 225, 130)),
        ("sphere", primitives::sphere(30.0, 128, 64)),
        ("cone", primitives::cone(0.1, 0.2, 64)),
    ] {
        let scene = scene(vec![part(name, mesh, DVec3::Z * 0.1)]);
        let start = std::time::Instant::now();
        let planes = generate(&scene, &PlaneSettings::default()).unwrap();
        let share = coverage(&planes, &scene.virtual_parts, Layer::Virtual);
        eprintln!(
            "{name}: {} planes, {share:.4}, {:?}",
            planes.len(),
            start.elapsed()
        );
        assert!(share > 0.97, "{name}");
    }
}
