use super::*;
use crate::mesh::Material;
use crate::planes::generate;
use crate::planes::{BakeSettings, Basis, Image, Receiver, ReceiverImage};
use crate::primitives;
use glam::{DMat4, DVec2, Vec3};
use std::sync::Arc;

fn cuboid(x: f64, size: f32) -> Part {
    Part {
        name: format!("box at {x}"),
        mesh: Arc::new(primitives::cuboid(Vec3::splat(size))),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(DVec3::new(x, 0.0, 0.0)),
        mirror: false,
        albedo: None,
    }
}

fn scene(boxes: Vec<Part>) -> Scene {
    let mut ground = cuboid(0.0, 1.0);
    ground.name = "ground".into();
    ground.mesh = Arc::new(primitives::plane(60.0, 60.0));
    Scene {
        virtual_parts: boxes,
        phantom_parts: vec![ground],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

const SETTINGS: PlaneSettings = PlaneSettings {
    count: 24,
    clusters: 4,
    offset_m: 0.02,
    receiver: Receiver::Surface,
};

/// The bake of `scene` without its images.
fn bake(scene: &Scene) -> Bake {
    let mut planes = generate(scene, &SETTINGS).unwrap();
    planes.sort_by_key(|p| p.layer == Layer::Virtual);
    let nothing = Basis {
        past_all: Image::White,
        past_phantoms: Image::White,
    };
    Bake {
        key: [0; 32],
        settings: BakeSettings::default(),
        receivers: vec![ReceiverImage::default(); planes.len()],
        images: vec![nothing; 40 * planes.len()],
        planes,
        texels: Vec::new(),
    }
}

fn renewed(old: &Scene, new: &Scene) -> Renewal {
    renew(&bake(old), old, new, &SETTINGS).unwrap()
}

#[test]
fn unchanged_scene_needs_no_baking() {
    let old = scene(vec![cuboid(-4.0, 1.0), cuboid(4.0, 1.0)]);
    let renewal = renewed(&old, &old.clone());
    assert_eq!(renewal.counts(), (0, 0));
    assert_eq!(renewal.planes, bake(&old).planes);
    let straight: Vec<Option<usize>> = (0..renewal.planes.len()).map(Some).collect();
    assert_eq!(renewal.from, straight);
}

#[test]
fn only_a_changed_object_has_new_planes() {
    let old = scene(vec![cuboid(-4.0, 1.0), cuboid(4.0, 1.0)]);
    let mut turned = cuboid(4.0, 1.0);
    turned.world_from_part *= DMat4::from_rotation_z(0.5);
    let new = scene(vec![cuboid(-4.0, 1.0), turned]);
    let renewal = renewed(&old, &new);
    for (plane, from) in renewal.planes.iter().zip(&renewal.from) {
        let on_changed = plane.layer == Layer::Virtual && plane.parts.contains(&1);
        // The ground's planes stay: the shadows still fit on them.
        assert_eq!(on_changed, from.is_none(), "{plane:?}");
    }
    let (new_planes, images) = renewal.counts();
    assert!((3..=12).contains(&new_planes), "{new_planes}");
    let lights = renewal.drawn.len() / renewal.planes.len();
    // All images of new planes, and of the others those that the rotated box can shadow.
    assert!(images >= new_planes * lights);
    assert!(images < renewal.drawn.len() * 3 / 4, "{images}");
    // The sides of the other box that face away are out of reach.
    let away = renewal
        .planes
        .iter()
        .position(|p| p.normal().x < -0.9 && p.parts == [0]);
    let row = &renewal.drawn[away.unwrap() * lights..][..lights];
    assert!(!row.contains(&true));
    // Every side of the changed box has a plane.
    for side in [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y] {
        let side = DMat4::from_rotation_z(0.5).transform_vector3(side);
        let faces = |p: &ShadowingPlane| p.parts.contains(&1) && p.normal().dot(side) > 0.5;
        assert!(renewal.planes.iter().any(faces), "{side}");
    }
}

#[test]
fn accepts_added_and_removed_objects() {
    let (left, right) = (cuboid(-4.0, 1.0), cuboid(4.0, 1.0));
    let both = scene(vec![left.clone(), right.clone()]);
    let one = scene(vec![right]);
    let removed = renewed(&both, &one);
    assert!(
        removed
            .planes
            .iter()
            .all(|p| p.layer == Layer::Real || p.parts == [0])
    );
    let kept = removed.from.iter().flatten().count();
    assert!(
        kept + 3 >= removed.planes.len(),
        "{kept} of {}",
        removed.planes.len()
    );
    let come = renewed(&one, &both);
    assert!(
        come.planes
            .iter()
            .any(|p| p.layer == Layer::Virtual && p.parts == [0])
    );
    let same = come.planes.iter().zip(&come.from);
    let right = same.filter(|(p, _)| p.layer == Layer::Virtual && p.parts == [1]);
    assert!(right.clone().count() > 0 && right.clone().all(|(_, from)| from.is_some()));
}

#[test]
fn never_omits_an_image_that_a_ray_can_shadow() {
    let mut random = 7u32;
    let mut next = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(random >> 8) / f64::from(1 << 24)
    };
    let mut vector = |scale: f64| DVec3::new(next() - 0.5, next() - 0.5, next() - 0.5) * scale;
    let (mut reached, mut spared) = (0, 0);
    for _ in 0..1000 {
        let (a, size) = (vector(4.0), vector(3.0).abs());
        let caster = Extent {
            low: a,
            high: a + size,
        };
        let normal = vector(2.0).normalize();
        let right = normal.any_orthonormal_vector();
        let plane = ShadowingPlane {
            centre: vector(4.0),
            right,
            up: normal.cross(right),
            half_size: DVec2::new(0.7, 0.4),
            depth: 0.5,
            layer: Layer::Virtual,
            receiver: Receiver::Surface,
            parts: Vec::new(),
        };
        let corners: Vec<DVec3> = (0..3)
            .map(|_| (DVec3::Z * 1.5 + vector(1.0)).normalize())
            .collect();
        let is_possible = may_shadow(&caster, &corners, &plane);
        let within = corners.iter().sum::<DVec3>().normalize();
        let slab = slab_corners(&plane);
        let hit = (0..300).any(|_| {
            let (u, v, w) = (vector(1.0) + 0.5, vector(1.0) + 0.5, vector(1.0) + 0.5);
            let across = slab[0].lerp(slab[1], u.x) - slab[0] + slab[0].lerp(slab[2], u.y);
            let point = across + (slab[4] - slab[0]) * u.z;
            let light = corners[0] * v.x + corners[1] * v.y + corners[2] * v.z + within * w.x * 0.1;
            meets(point, light.normalize(), &caster)
        });
        assert!(is_possible || !hit, "{caster:?} {plane:?} {corners:?}");
        reached += u32::from(hit);
        spared += u32::from(!is_possible);
    }
    // Both cases must be common for the test to be meaningful.
    assert!(reached > 20 && spared > 100, "{reached} {spared}");
}

/// Whether the ray from `origin` hits the box.
fn meets(origin: DVec3, towards: DVec3, extent: &Extent) -> bool {
    let (a, b) = (
        (extent.low - origin) / towards,
        (extent.high - origin) / towards,
    );
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    far >= near.max(0.0)
}
