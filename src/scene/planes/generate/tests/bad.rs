//! Invalid and extreme models: either planes or an error of one line.

use super::*;
use crate::mesh::Vertex;
use glam::{Vec2, Vec4};
use proptest::prelude::*;

fn mesh(corners: &[[f32; 3]], indices: Vec<u32>) -> Mesh {
    let vertex = |p: &[f32; 3]| Vertex {
        position: Vec3::from(*p),
        normal: Vec3::Z,
        uv: Vec2::ZERO,
        tangent: Vec4::ZERO,
    };
    Mesh {
        vertices: corners.iter().map(vertex).collect(),
        indices,
    }
}

/// Planes, or an error of one line.
fn try_it(parts: Vec<Part>) -> Result<Vec<ShadowingPlane>, PlaneError> {
    let result = generate(&scene(parts), &PlaneSettings::default());
    match &result {
        Ok(planes) => assert_valid(planes, 38),
        Err(e) => assert_eq!(e.to_string().lines().count(), 1, "{e}"),
    }
    result
}

fn one(mesh: Mesh) -> Result<Vec<ShadowingPlane>, PlaneError> {
    try_it(vec![part("it", mesh, DVec3::ZERO)])
}

#[test]
fn empty_scene_has_no_planes() {
    assert_eq!(try_it(Vec::new()), Ok(Vec::new()));
    assert_eq!(one(Mesh::default()), Err(PlaneError::NoSurface));
    let needle = mesh(&[[0.0; 3], [1.0; 3], [2.0; 3]], vec![0, 1, 2, 0, 0, 1]);
    assert_eq!(one(needle), Err(PlaneError::NoSurface));
}

#[test]
fn errors_name_parts_that_are_not_finite_or_too_far_away() {
    for bad in [f32::NAN, f32::INFINITY, 1e30] {
        let error = one(mesh(
            &[[0.0, 0.0, bad], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            vec![0, 1, 2],
        ));
        assert_eq!(error, Err(PlaneError::FarAway { part: "it".into() }));
    }
    let mut placed = part("it", primitives::cuboid(Vec3::ONE), DVec3::ZERO);
    placed.world_from_part.w_axis.x = f64::NAN;
    assert_eq!(
        try_it(vec![placed]),
        Err(PlaneError::FarAway { part: "it".into() })
    );
}

#[test]
fn refuses_numbers_of_planes_out_of_range() {
    for count in [0, 1, 1001, u32::MAX] {
        let settings = PlaneSettings {
            count,
            ..PlaneSettings::default()
        };
        let error = generate(&scene(Vec::new()), &settings).unwrap_err();
        assert_eq!(error, PlaneError::Count { count });
    }
}

#[test]
fn accepts_open_flat_crossing_and_mirrored_models() {
    let triangle = mesh(
        &[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]],
        vec![0, 1, 2],
    );
    assert!(
        one(triangle)
            .unwrap()
            .iter()
            .any(|p| p.layer == Layer::Virtual)
    );
    let mut half = primitives::sphere(1.0, 32, 16);
    half.indices.truncate(half.indices.len() / 2);
    one(half).unwrap();
    let cross = |at| part("bar", primitives::cuboid(Vec3::new(4.0, 0.5, 0.5)), at);
    let mut other = cross(DVec3::ZERO);
    other.world_from_part = DMat4::from_rotation_z(1.3);
    check("cross", &scene(vec![cross(DVec3::ZERO), other]));
    let mut mirrored = part("it", primitives::cuboid(Vec3::ONE), DVec3::ZERO);
    mirrored.world_from_part = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    check("mirrored", &scene(vec![mirrored]));
    // Folded onto itself: both sides coincide.
    let fold = mesh(
        &[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]],
        vec![0, 1, 2, 0, 2, 1],
    );
    one(fold).unwrap();
}

#[test]
fn accepts_tiny_and_enormous_models() {
    for scale in [1e-3, 1e5, 9e5] {
        let mut tower = part("it", primitives::torus(1.0, 0.3, 40, 20), DVec3::ZERO);
        tower.world_from_part = DMat4::from_scale(DVec3::splat(scale));
        check(&format!("torus × {scale}"), &scene(vec![tower]));
    }
}

#[test]
fn divides_many_parts_together() {
    let at = |i: i32| DVec3::new(f64::from(i % 10), f64::from(i / 10), 0.0) * 0.3;
    let parts = (0..100).map(|i| part("stone", primitives::cuboid(Vec3::splat(0.2)), at(i)));
    let planes = try_it(parts.collect()).unwrap();
    assert!(planes.len() > 10);
}

#[test]
fn accepts_a_quarter_of_a_million_triangles() {
    check(
        "torus",
        &scene(vec![part(
            "it",
            primitives::torus(1.0, 0.3, 500, 250),
            DVec3::Z,
        )]),
    );
}

fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -2.0f32..2.0,
        2 => prop::sample::select(vec![0.0, 1.0, -1.0, 0.5]),
        1 => prop::sample::select(vec![1e-30, 1e5, -1e6, 1e-7]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn any_triangles_yield_planes_or_an_error(
        corners in prop::collection::vec([coordinate(), coordinate(), coordinate()], 0..30),
        indices in prop::collection::vec(0u32..32, 0..90),
        double_sided: bool,
        stretch in prop::sample::select(vec![1.0, 1e-6, 1e4, 0.0, f64::NAN]),
    ) {
        let mut soup = part("soup", mesh(&corners, indices), DVec3::ZERO);
        soup.world_from_part *= DMat4::from_scale(DVec3::new(1.0, stretch, 1.0));
        Arc::make_mut(&mut soup.material).double_sided = double_sided;
        let _ = try_it(vec![soup]);
    }
}
