use super::super::trace::tests::traced;
use super::*;
use penumbra_scene::{Material, Part, Scene, primitives};
use std::sync::Arc;

/// A metal ball fourteen pixels wide, at which the camera looks, beside a box.
fn ball_beside_a_box() -> Scene {
    let part = |mesh, at: Vec3, metallic, roughness| Part {
        name: "part".to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material {
            metallic,
            roughness,
            ..Material::default()
        }),
        world_from_part: DMat4::from_translation(at.as_dvec3()),
        mirror: false,
        albedo: None,
    };
    let size = Vec3::new(0.05, 0.1, 0.1);
    let (ball, body) = (primitives::sphere(0.03, 64, 32), primitives::cuboid(size));
    Scene {
        virtual_parts: vec![
            part(ball, Vec3::ZERO, 1.0, 0.2),
            part(body, Vec3::new(0.07, 0.0, 0.0), 0.0, 1.0),
        ],
        ..Scene::default()
    }
}

#[test]
fn curved_surface_that_shows_more_than_the_sky_gets_many_rays() {
    let side = TILE as usize;
    let rays = LobeRays::new(FEW_RAYS);
    // The ball is in the middle of the camera's 200 pixels.
    let first = 2 * side;
    traced(&ball_beside_a_box(), |tracer| {
        let work = Work {
            tracer,
            tiles: ReflectionTiles {
                covered: &[1; 49],
                across: 7,
                rectangle: [2; 4],
            },
            step: 2,
            rays: &rays,
        };
        let across = 2 * side;
        let mut lattice = vec![Nearby::NOTHING; across * across / 4];
        for (number, strip) in lattice.chunks_exact_mut(ROWS * across / 2).enumerate() {
            work.trace(number, strip);
        }
        let mut texels = vec![NOTHING; across * across];
        for (number, strip) in texels.chunks_exact_mut(PIXEL_ROWS * across).enumerate() {
            work.fill(&lattice, number, strip);
        }
        let with = |slopes: &[Vec2], x: usize, y: usize| {
            let lobes = Lobes {
                fixed: slopes,
                soft: None,
            };
            let pixel = Vec2::new((first + x) as f32, (first + y) as f32);
            work.tracer.trace_smoothly(lobes, [pixel; LANES])[0]
        };
        let mut count = [0; 2];
        for (x, y) in (0..across).flat_map(|y| (0..across).map(move |x| (x, y))) {
            if matches!(work.between(&lattice, across, (x, y)), Between::Curve) {
                let few = with(&rays.few, x, y);
                let is_sky = few.open == 1.0;
                let expected = if is_sky { few } else { with(&rays.many, x, y) };
                assert_eq!(texels[y * across + x], packed(&expected), "{x} {y}");
                count[usize::from(is_sky)] += 1;
            }
        }
        assert!(count.iter().all(|count| *count > 5), "{count:?}");
    });
}

#[test]
fn soft_points_divide_a_lobe_between_them() {
    let rays = LobeRays::new(FEW_RAYS);
    let packets = [0, PACKET[1]].map(|row| rays.of_packet(row).soft.expect("soft"));
    let mut together: Vec<Vec2> = packets.concat().concat();
    let mut lobe = slopes(FEW_RAYS * PERIOD * PERIOD);
    for all in [&mut together, &mut lobe] {
        all.sort_by(|a, b| a.length().total_cmp(&b.length()));
    }
    assert_eq!(together, lobe);
}

/// Twin of WGSL `light_of`.
fn light_of(bits: u32) -> Vec3 {
    let number = |shift: u32| (bits >> shift & 511) as f32;
    let exponent = (bits >> 27) as i32 + LEAST_EXPONENT;
    Vec3::new(number(0), number(9), number(18)) * (exponent as f32).exp2()
}

#[test]
fn light_is_kept_to_a_512th_of_the_brightest_channel() {
    let mut light = Vec3::new(0.3, 1.0, 0.07);
    for _ in 0..40 {
        let error = (light_of(with_common_exponent(light)) - light).abs();
        let brightest = light.max_element().max(1e-4);
        assert!(error.max_element() <= brightest / 511.0, "{light}");
        light *= if light.y > 5e4 { 1e-6 } else { 1.37 };
    }
    assert_eq!(light_of(with_common_exponent(Vec3::ZERO)), Vec3::ZERO);
    let most = light_of(with_common_exponent(Vec3::INFINITY));
    assert!(most.is_finite() && most.x > 6e4);
}
