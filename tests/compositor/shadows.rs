//! Shadows on real surfaces, against the twin and closed forms.

use crate::comparison::{Rule, assert_like, assert_same_where, away_from_edges, untouched};
use crate::stage::{Stage, cell, flat, lighting, looking_from, part, spiral, sun};
use glam::{DMat4, DVec3, Vec3};
use penumbra_camera::Response;
use penumbra_compositor::reference::Seen;
use penumbra_lighting::DomeLight;
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::dome::DomeGrid;
use penumbra_picture::Picture;
use penumbra_scene::ShadowMode;
use penumbra_scene::{Part, primitives};
use std::f32::consts::PI;

fn cube(side: f32, at: DVec3) -> Part {
    part(primitives::cuboid(Vec3::splat(side)), at)
}

fn slanted_sun() -> DomeLight {
    sun(Vec3::new(-0.6, 0.5, 1.0), Vec3::new(2.0, 1.8, 1.5))
}

/// A virtual box on the table under the sun and a uniform sky light from straight above.
fn sunny_box() -> Stage {
    let lights = vec![slanted_sun(), cell(Vec3::Z, Vec3::new(0.8, 0.9, 1.0))];
    Stage::new(128, 96)
        .with_virtual(cube(0.1, DVec3::ZERO))
        .lit(lighting(lights, 0.0))
}

#[test]
fn other_lights_remain_in_the_umbra_of_one() {
    let stage = sunny_box();
    let (twin, ours) = (stage.twin(), stage.compose());
    assert_like("sunny-box", &ours, &twin, Rule::within(2));
    // The sky light comes from straight above, so that only the sun's shadow is on the table.
    let lights = &stage.lighting.as_ref().unwrap().lights;
    let (from_sun, rest) = (
        lights[0].irradiance * lights[0].direction.z,
        lights[1].irradiance,
    );
    let factor = rest / (rest + from_sun);
    let camera = Vec3::from(stage.response.linear_from_rgb(ours_at(&stage.picture, 0)));
    let expected = (camera * factor)
        .to_array()
        .map(|v| stage.response.code_from_linear(v));
    let calm = away_from_edges(&twin, 2);
    let umbra: Vec<usize> = (0..calm.len())
        .filter(|i| calm[*i] && twin.pixels[*i].seen == Seen::Phantom)
        .filter(|i| !twin.pixels[*i].untouched)
        .collect();
    assert!(umbra.len() > 200, "{}", umbra.len());
    for i in umbra {
        let codes = ours_at(&ours, i);
        let off = (0..3).map(|c| codes[c].abs_diff(expected[c])).max();
        assert!(off <= Some(1), "{codes:?} {expected:?}");
    }
}

fn ours_at(picture: &Picture, i: usize) -> [u8; 3] {
    [0, 1, 2].map(|c| picture.rgba[4 * i + c])
}

#[test]
fn shadow_of_red_light_changes_only_red() {
    let mut stage = Stage::new(96, 72)
        .with_virtual(cube(0.1, DVec3::ZERO))
        .lit(lighting(
            vec![
                sun(Vec3::new(-0.6, 0.5, 1.0), Vec3::X),
                sun(Vec3::new(0.2, 0.1, 1.0), Vec3::X),
            ],
            0.0,
        ));
    stage.scene.virtual_parts[0].material = crate::stage::matt(Vec3::ZERO).into();
    let (twin, ours) = (stage.twin(), stage.compose());
    assert_like("red-light", &ours, &twin, Rule::within(1));
    let shadowed = |i: &usize| twin.pixels[*i].seen == Seen::Phantom && !twin.pixels[*i].untouched;
    for i in (0..twin.pixels.len()).filter(shadowed) {
        if !away_from_edges(&twin, 1)[i] {
            continue;
        }
        assert_eq!(ours_at(&ours, i)[1..], [150, 120], "{i}");
    }
}

#[test]
fn many_lights_match_the_twin() {
    // 130 lights share the 64 bits of a tile's mask.
    for (count, mode) in [
        (16, ShadowMode::Ratio),
        (16, ShadowMode::Subtract),
        (130, ShadowMode::Ratio),
    ] {
        let mut stage = Stage::new(96, 72)
            .with_virtual(part(
                primitives::sphere(0.07, 48, 24),
                DVec3::new(0.03, 0.0, 0.1),
            ))
            .with_phantom(cube(0.09, DVec3::new(-0.12, 0.02, 0.0)))
            .lit(lighting(spiral(count, 2.0), 0.2));
        stage.mode = mode;
        let rule = Rule {
            calm: if count > 100 { 0.02 } else { 0.3 },
            ..Rule::within(1)
        };
        let name = format!("many-{count}-{mode:?}");
        assert_like(&name, &stage.compose(), &stage.twin(), rule);
    }
}

#[test]
fn objects_partly_outside_the_picture_cast_shadows_into_it() {
    let stage = Stage::new(101, 67)
        .with_virtual(cube(0.2, DVec3::new(0.35, 0.0, 0.0)))
        .with_virtual(cube(0.1, DVec3::new(0.0, -0.5, 0.3)))
        .with_phantom(cube(0.1, DVec3::new(-0.2, 0.1, 0.0)))
        .lit(lighting(
            vec![
                sun(Vec3::new(1.0, 0.1, 0.6), Vec3::ONE),
                sun(Vec3::new(-0.4, -0.7, 0.4), Vec3::splat(0.6)),
                cell(Vec3::Z, Vec3::ONE),
            ],
            0.0,
        ));
    let twin = stage.twin();
    let shadowed = twin.pixels.iter().filter(|p| !p.untouched).count();
    assert!(shadowed > 500, "{shadowed}");
    assert_like("outside", &stage.compose(), &twin, Rule::within(2));
}

#[test]
fn wall_that_hides_half_the_sky_halves_the_light() {
    // The lights of the grid are symmetric about every axis.
    let fine = CubeGrid::new(32);
    let texels = vec![Vec3::ONE; fine.directions.len()];
    let lights = DomeGrid::new(64, true, &fine).lights(&texels, &fine);
    let mut stage = Stage::new(96, 72)
        .with_virtual(part(
            primitives::cuboid(Vec3::new(40.0, 0.02, 40.0)),
            DVec3::new(0.0, 0.11, 0.0),
        ))
        .lit(lighting(lights, 1.0));
    stage.picture = flat(96, 72, [188; 3]);
    stage.pose = Some(looking_from(
        DVec3::new(0.0, -0.5, 0.5),
        DVec3::new(0.0, -0.3, 0.0),
    ));
    let out = stage.compose();
    // Half the linear light of code 188 (0.5) is 0.25: code 137.
    let bottom = out.rgb(48, 71);
    assert!(bottom.iter().all(|c| c.abs_diff(137) <= 2), "{bottom:?}");
}

/// A small disc high above hides only the zenith from the point below it.
#[test]
fn uniform_sky_lights_the_ground_with_pi_times_its_radiance() {
    let fine = CubeGrid::new(32);
    let texels = vec![Vec3::splat(0.4); fine.directions.len()];
    for budget in [64, 96, 384] {
        let mut lights = DomeGrid::new(budget, true, &fine).lights(&texels, &fine);
        lights.truncate(383);
        let zenith = Vec3::splat(1.5);
        let kept: f32 = lights.iter().map(|l| l.irradiance.x * l.direction.z).sum();
        assert!((kept - 0.4 * PI).abs() < 0.02, "{kept}");
        lights.push(sun(Vec3::Z, zenith));
        let mut stage = Stage::new(64, 48)
            .with_virtual(part(
                primitives::cylinder(0.08, 0.005, 32),
                DVec3::new(0.0, 0.0, 1.2),
            ))
            .lit(lighting(lights, 0.4));
        stage.picture = flat(64, 48, [220; 3]);
        let factor = 0.4 * PI / (0.4 * PI + zenith.x);
        let lit = stage.response.linear_from_code()[220];
        let expected = stage.response.code_from_linear(lit * factor);
        let code = stage.compose().rgb(32, 24)[0];
        assert!(code.abs_diff(expected) <= 2, "{budget}: {code} {expected}");
    }
}

#[test]
fn shadows_of_several_lights_add_up() {
    let lights: Vec<_> = [
        Vec3::new(-0.6, 0.5, 1.0),
        Vec3::new(0.7, 0.2, 0.9),
        Vec3::new(0.1, -0.5, 1.2),
        Vec3::new(-0.2, 0.8, 0.7),
    ]
    .map(|d| sun(d, Vec3::new(0.5, 0.6, 0.7)))
    .into();
    let mut stage = Stage::new(96, 72)
        .with_virtual(cube(0.1, DVec3::ZERO))
        .lit(lighting(lights.clone(), 0.0));
    stage.picture = flat(96, 72, [255; 3]);
    stage.response = Response::linear();
    stage.mode = ShadowMode::Subtract;
    let seen = stage.twin();
    let calm = away_from_edges(&seen, 2);
    let together = stage.compose();
    let mut sum = vec![0.0; together.rgba.len()];
    for light in lights {
        let alone = stage.clone().lit(lighting(vec![light], 0.0)).compose();
        for (sum, code) in sum.iter_mut().zip(&alone.rgba) {
            *sum += 255.0 - f64::from(*code);
        }
    }
    let mut dark = 0;
    for (i, sum) in sum.iter().enumerate() {
        if i % 4 == 3 || !calm[i / 4] || seen.pixels[i / 4].seen != Seen::Phantom {
            continue;
        }
        let ours = 255.0 - f64::from(together.rgba[i]);
        assert!((ours - sum).abs() <= 2.5, "{i}: {ours} {sum}");
        dark += usize::from(*sum > 30.0);
    }
    assert!(dark > 100, "{dark}");
}

#[test]
fn virtual_shadow_is_not_applied_inside_a_real_one() {
    // A real box blocks the sun; a virtual one stands in its shadow.
    let mut stage = Stage::new(128, 96)
        .with_phantom(part(
            primitives::cuboid(Vec3::new(0.4, 0.05, 0.4)),
            DVec3::new(0.0, 0.15, 0.0),
        ))
        .with_virtual(cube(0.06, DVec3::ZERO))
        .lit(lighting(
            vec![sun(Vec3::new(0.0, 0.7, 0.7), Vec3::ONE)],
            0.0,
        ));
    let twin = stage.twin();
    let real = untouched(&twin, 1);
    assert!(
        twin.pixels
            .iter()
            .all(|p| p.untouched || p.seen == Seen::Virtual)
    );
    assert_same_where("double-shadow", &stage.compose(), &stage.picture, &real);
    // With sky lights there is a shadow again, of the sky light alone.
    let lights = vec![
        sun(Vec3::new(0.0, 0.7, 0.7), Vec3::ONE),
        cell(Vec3::new(0.2, -0.4, 1.0).normalize(), Vec3::splat(0.5)),
        cell(Vec3::new(-0.9, -0.4, 1.0).normalize(), Vec3::splat(0.5)),
    ];
    stage.scene.virtual_parts[0].material = crate::stage::matt(Vec3::ZERO).into();
    let stage = stage.lit(lighting(lights, 0.0));
    assert_like(
        "half-shadow",
        &stage.compose(),
        &stage.twin(),
        Rule::within(2),
    );
}

#[test]
fn virtual_object_above_a_real_one_shades_only_its_top() {
    let stage = Stage::new(128, 96)
        .with_phantom(cube(0.12, DVec3::ZERO))
        .with_virtual(cube(0.04, DVec3::new(0.0, 0.0, 0.18)))
        .lit(lighting(
            vec![
                sun(Vec3::new(0.15, 0.1, 1.0), Vec3::ONE),
                cell(Vec3::new(0.4, -1.0, 0.8), Vec3::ONE),
            ],
            0.0,
        ));
    let (twin, ours) = (stage.twin(), stage.compose());
    assert_like("stacked", &ours, &twin, Rule::within(2));
}

#[test]
fn slanted_real_surface_matches_the_twin() {
    let mut ramp = part(primitives::plane(0.6, 0.6), DVec3::ZERO);
    ramp.world_from_part = DMat4::from_rotation_y(0.5) * DMat4::from_rotation_x(0.2);
    let mut stage = Stage::new(96, 72)
        .with_virtual(part(
            primitives::sphere(0.06, 32, 16),
            DVec3::new(0.0, 0.0, 0.14),
        ))
        .lit(lighting(spiral(12, 2.0), 0.3));
    stage.scene.phantom_parts = vec![ramp];
    let (twin, ours) = (stage.twin(), stage.compose());
    assert_like("ramp", &ours, &twin, Rule::within(1));
}
