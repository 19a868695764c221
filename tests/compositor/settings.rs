//! Settings made before the first frame or between frames: coarse shadows, the number of maps that
//! are drawn per frame, the number of lights.

use crate::comparison::difference;
use crate::stage::{Stage, cell, lighting, part, spiral, sun};
use glam::{DVec3, Vec3};
use penumbra_compositor::Refresh;
use penumbra_lighting::DomeLight;
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::dome::DomeGrid;
use penumbra_scene::{Part, primitives};

fn cube(side: f32, at: DVec3) -> Part {
    part(primitives::cuboid(Vec3::splat(side)), at)
}

#[test]
fn one_map_per_frame_converges_to_the_same_picture() {
    let mut stage = Stage::new(96, 72)
        .with_virtual(cube(0.1, DVec3::ZERO))
        .lit(lighting(spiral(8, 2.0), 0.2));
    stage.refresh = Refresh::UpTo(1);
    let mut compositor = stage.compositor();
    let before = stage.compose_with(&mut compositor);
    let rotated: Vec<_> = spiral(8, 2.0)
        .into_iter()
        .map(|l| DomeLight {
            direction: glam::Quat::from_rotation_z(0.5) * l.direction,
            ..l
        })
        .collect();
    let stage = stage.lit(lighting(rotated, 0.2));
    let frames: Vec<_> = (0..8)
        .map(|_| {
            let picture = stage.compose_with(&mut compositor);
            assert_eq!(compositor.maps_refreshed(), 1);
            picture
        })
        .collect();
    assert!(frames[0] != frames[7] && before != frames[7]);
    assert_eq!(difference(&frames[7], &stage.compose()), (0, 0.0));
    stage.compose_with(&mut compositor);
    assert_eq!(compositor.maps_refreshed(), 0, "nothing has moved");
}

#[test]
fn same_input_gives_the_same_bytes() {
    let stage = Stage::new(101, 67)
        .with_virtual(cube(0.1, DVec3::ZERO))
        .lit(lighting(spiral(8, 2.0), 0.2));
    assert!(stage.compose() == stage.compose());
}

#[test]
fn shadows_do_not_bleed_over_steps() {
    // A low sun from the right and a virtual wall outside the picture, whose shadow covers the
    // table; a real step in front rises above the shadow.
    let lights = vec![
        sun(Vec3::new(1.0, 0.0, 0.04), Vec3::splat(20.0)),
        cell(Vec3::Z, Vec3::ONE),
    ];
    let wall = part(
        primitives::cuboid(Vec3::new(0.02, 8.0, 0.08)),
        DVec3::new(0.45, 0.0, 0.0),
    );
    // The step's edge lies in an even or an odd row of the picture.
    for back in [0.0, 0.003, 0.006, 0.009] {
        let step = primitives::cuboid(Vec3::new(3.0, 1.0, 0.1));
        let stage = Stage::new(96, 72)
            .with_virtual(wall.clone())
            .with_phantom(part(step, DVec3::new(0.0, back - 0.5, 0.0)))
            .lit(lighting(lights.clone(), 0.0));
        let (ours, twin) = (stage.compose(), stage.twin());
        let (mut dark, mut lit) = (0, 0);
        for i in 0..twin.pixels.len() {
            let (code, expected) = (ours.rgba[4 * i], twin.picture.rgba[4 * i]);
            let at = (i % 96, i / 96);
            assert!(code.abs_diff(expected) <= 2, "{at:?}: {code} {expected}");
            *(if twin.pixels[i].untouched {
                &mut lit
            } else {
                &mut dark
            }) += 1;
        }
        assert!(dark > 500 && lit > 500, "{dark} {lit}");
    }
}

#[test]
fn every_light_budget_works() {
    let mut stage = Stage::new(64, 48).with_virtual(cube(0.1, DVec3::ZERO));
    stage.settings.light_budget = 384;
    let mut compositor = stage.compositor();
    let fine = CubeGrid::new(32);
    let texels = vec![Vec3::ONE; fine.directions.len()];
    let mut pictures = Vec::new();
    for budget in [8, 24, 48, 64, 96, 384] {
        let lights = DomeGrid::new(budget, true, &fine).lights(&texels, &fine);
        stage.lighting = Some(lighting(lights, 1.0));
        compositor.set_light_budget(budget as u32);
        pictures.push(stage.compose_with(&mut compositor));
        assert_eq!(compositor.maps_refreshed(), budget);
    }
    // With more lights the picture converges to a single soft shadow.
    let last = pictures.last().unwrap();
    let off: Vec<f64> = pictures.iter().map(|p| difference(p, last).1).collect();
    assert!(off[0] > off[4] && off[4] < 2.0, "{off:?}");
    assert!(difference(last, &stage.picture).1 > 3.0);
}
