use super::super::trace::tests::traced;
use super::*;
use glam::Vec3;
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

/// The ball in the middle of the camera's 200 pixels: two tiles by two, after two others.
const FIRST: usize = 2 * TILE as usize;
const ACROSS: usize = 2 * TILE as usize;

/// Work on the ball, at every second pixel, and the points of its lattice.
fn with_ball(look: impl FnOnce(&Work<'_>, &[Nearby])) {
    let rays = LobeRays::new(FEW_RAYS);
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
        let mut lattice = vec![Nearby::NOTHING; ACROSS * ACROSS / 4];
        for (number, strip) in lattice.chunks_exact_mut(ROWS * ACROSS / 2).enumerate() {
            work.trace(number, strip);
        }
        look(&work, &lattice);
    });
}

fn filled(work: &Work<'_>, lattice: &[Nearby]) -> Vec<Texel> {
    let mut texels = vec![NOTHING; ACROSS * ACROSS];
    for (number, strip) in texels.chunks_exact_mut(PIXEL_ROWS * ACROSS).enumerate() {
        work.fill(lattice, number, strip);
    }
    texels
}

fn pixels() -> impl Iterator<Item = (usize, usize)> {
    (0..ACROSS).flat_map(|y| (0..ACROSS).map(move |x| (x, y)))
}

/// The pixel of the picture.
fn at((x, y): (usize, usize)) -> Vec2 {
    Vec2::new((FIRST + x) as f32, (FIRST + y) as f32)
}

const fn everywhere(fixed: &[Vec2]) -> Lobes<'_> {
    Lobes { fixed, soft: None }
}

#[test]
fn curved_surface_that_shows_more_than_the_sky_gets_more_rays() {
    with_ball(|work, lattice| {
        let texels = filled(work, lattice);
        let with = |slopes: &[Vec2], pixel| {
            let pixels = [at(pixel); LANES];
            work.tracer.trace_smoothly(everywhere(slopes), pixels)[0]
        };
        let mut count = [0; 2];
        for (x, y) in pixels() {
            if matches!(work.between(lattice, ACROSS, (x, y)), Between::Curve) {
                let few = with(&work.rays.few, (x, y));
                let is_sky = few.open == 1.0;
                let expected = if is_sky {
                    few
                } else {
                    with(&work.rays.some, (x, y))
                };
                assert_eq!(texels[y * ACROSS + x], packed(&expected), "{x} {y}");
                count[usize::from(is_sky)] += 1;
            }
        }
        assert!(count.iter().all(|count| *count > 5), "{count:?}");
    });
}

#[test]
fn pixels_that_differ_from_those_beside_them_are_nearer_to_their_mean() {
    let many = slopes(8 * RAYS);
    with_ball(|work, lattice| {
        let texels = filled(work, lattice);
        let mut refined = texels.clone();
        for (number, strip) in refined.chunks_exact_mut(PIXEL_ROWS * ACROSS).enumerate() {
            work.refine(&texels, ACROSS, number, strip);
        }
        let (mut errors, mut count) = ([0.0; 2], 0);
        for (x, y) in pixels() {
            let own = y * ACROSS + x;
            let pair = [&texels, &refined].map(|texels| unpacked(&texels[own]));
            if !is_uneven(&texels, ACROSS, own) {
                assert_eq!(texels[own], refined[own], "{x} {y}");
                continue;
            }
            let place = |k: usize| Vec2::new((k % 4) as f32, (k / 4) as f32) / 4.0 - 0.375;
            let places: [Vec2; 2 * LANES] = std::array::from_fn(|k| at((x, y)) + place(k));
            let halves = [0, LANES].map(|k| places[k..k + LANES].try_into().expect("eight"));
            let open = halves.map(|pixels| work.tracer.trace(everywhere(&many), pixels));
            if open
                .as_flattened()
                .iter()
                .all(|found| found.is_as_far_as(&pair[0]))
            {
                let mean: f32 = open.as_flattened().iter().map(|found| found.open).sum();
                for (error, found) in errors.iter_mut().zip(pair) {
                    *error += (found.open - mean / places.len() as f32).abs();
                }
                count += 1;
            }
        }
        assert!(
            count > 10 && errors[1] < 0.7 * errors[0],
            "{count} {errors:?}"
        );
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
