//! A few complete pictures, compared with versions that were inspected and found correct.
//! `PENUMBRA_GOLDEN=write cargo test --test compositor golden` rewrites them: inspect them before
//! committing.

use crate::comparison::{keep, square_differences, write};
use crate::stage::{Stage, painted};
use glam::{DVec2, DVec3, Vec3};
use penumbra_interface::MonotonicTime;
use penumbra_lighting::box_chain::box_chain;
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::dome::DomeGrid;
use penumbra_lighting::harmonics::HarmonicsTable;
use penumbra_lighting::prefilter::Prefilter;
use penumbra_lighting::{DomeLight, LightKind, LightPlace, Lighting};
use penumbra_picture::Picture;
use penumbra_scene::{Material, Phong, SceneTexture, primitives};
use penumbra_scene::{Screen, VirtualLightKind};
use std::path::Path;
use std::sync::Arc;

/// Maximum difference of a square's mean, codes.
const LARGEST: f64 = 4.0;
/// Maximum mean difference of the entire picture, codes.
const MEAN: f64 = 0.5;

pub fn assert_golden(name: &str, ours: &Picture) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(format!("{name}.png"));
    if std::env::var_os("PENUMBRA_GOLDEN").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        write(&path, ours);
        return;
    }
    let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let golden = Picture::from_file_bytes(&bytes).unwrap();
    assert_eq!((ours.width, ours.height), (golden.width, golden.height));
    let squares = square_differences(ours, &golden);
    let mean = squares.iter().map(|s| s.1).sum::<f64>() / squares.len() as f64;
    let (at, largest) = squares
        .into_iter()
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap();
    if largest > LARGEST || mean > MEAN {
        let kept = keep(name, ours);
        panic!(
            "{name}: {largest:.1} codes off around {at:?}, {mean:.2} on average; compare {} \
             with {}, and if the new one is correct, accept it with PENUMBRA_GOLDEN=write",
            kept.display(),
            path.display()
        );
    }
}

/// A room: blue sky light from above, warm walls, a bright window to the right (+X), and a small
/// compact lamp behind to the left.
fn room() -> Lighting {
    let fine = CubeGrid::new(32);
    let sky: Vec<Vec3> = fine
        .directions
        .iter()
        .map(|d| {
            let window = d.x > 0.75 && d.z > 0.1 && d.z < 0.6 && d.y.abs() < 0.4;
            let wall = Vec3::new(0.30, 0.26, 0.22).lerp(Vec3::new(0.3, 0.4, 0.6), d.z.max(0.0));
            if window {
                Vec3::new(5.0, 5.2, 5.5)
            } else {
                wall
            }
        })
        .collect();
    let lamp = DomeLight {
        direction: Vec3::new(-0.5, 0.6, 0.7).normalize(),
        irradiance: Vec3::new(1.3, 1.1, 0.8),
        angular_radius: 0.03,
        kind: LightKind::Compact,
        place: LightPlace::FAR,
    };
    let mut lights = DomeGrid::new(64, true, &fine).lights(&sky, &fine);
    // The last of the 64 lights are below the horizon, and dark.
    *lights.last_mut().unwrap() = lamp;
    let mut radiance = sky.clone();
    for (l, d) in radiance.iter_mut().zip(&fine.directions) {
        if d.dot(lamp.direction) > 0.06_f32.cos() {
            *l += lamp.irradiance * 60.0;
        }
    }
    Lighting {
        captured_at: MonotonicTime::default(),
        generation: 1,
        radiance: Arc::new(Prefilter::new(32).with_phong(true).apply(&radiance)),
        irradiance: HarmonicsTable::new(&fine.directions, &fine.solid_angles).project(&sky),
        lights,
        ground_radiance: Vec3::new(0.25, 0.22, 0.2),
        faces: None,
    }
}

/// The table as a camera sees it: dark and light squares of 5 cm.
fn chequered(stage: &Stage) -> Picture {
    let pose = stage.pose.unwrap();
    let (width, height) = (stage.picture.width, stage.picture.height);
    let shade = |x: f64, y: f64| {
        let ray = pose.rotation * stage.camera.unproject(DVec2::new(x, y));
        let foot = pose.translation - ray * (pose.translation.z / ray.z);
        let odd = ((foot.x / 0.05).floor() + (foot.y / 0.05).floor()) as i64 % 2 != 0;
        if odd {
            Vec3::new(0.1, 0.16, 0.2)
        } else {
            Vec3::new(0.5, 0.45, 0.4)
        }
    };
    let mut rgba = Vec::new();
    for i in 0..width * height {
        let (x, y) = (f64::from(i % width), f64::from(i / width));
        let sum: Vec3 = (0..16)
            .map(|k| {
                shade(
                    x + f64::from(k % 4) / 4.0 - 0.375,
                    y + f64::from(k / 4) / 4.0 - 0.375,
                )
            })
            .sum();
        let codes = (sum / 16.0)
            .to_array()
            .map(|v| stage.response.code_from_linear(v));
        rgba.extend(codes);
        rgba.push(255);
    }
    Picture {
        width,
        height,
        rgba,
    }
}

pub fn golden_stage() -> Stage {
    let mut stage = Stage::new(160, 120).lit(room());
    stage.picture = chequered(&stage);
    stage
}

#[test]
fn golden_box_under_64_lights() {
    let red = Material {
        base_colour: Vec3::new(0.7, 0.25, 0.2).extend(1.0),
        roughness: 0.6,
        ..Material::default()
    };
    let stage = golden_stage().with_virtual(painted(
        primitives::cuboid(Vec3::new(0.1, 0.1, 0.12)),
        DVec3::new(0.0, 0.02, 0.0),
        red,
    ));
    assert_golden("box-64-lights", &stage.compose());
}

#[test]
fn golden_glossy_sphere_and_a_real_box() {
    let gold = Material {
        base_colour: Vec3::new(0.95, 0.75, 0.4).extend(1.0),
        metallic: 1.0,
        roughness: 0.25,
        ..Material::default()
    };
    let stage = golden_stage()
        .with_virtual(painted(
            primitives::sphere(0.07, 96, 48),
            DVec3::new(0.0, 0.0, 0.07),
            gold,
        ))
        .with_phantom(crate::stage::part(
            primitives::cuboid(Vec3::new(0.05, 0.03, 0.06)),
            DVec3::new(0.06, -0.1, 0.0),
        ));
    assert_golden("glossy-ball", &stage.compose());
}

/// A table with a lamp's reflection that is clipped in the centre, and around it in red only.
fn stage_with_clipped_reflection() -> Stage {
    let mut stage = golden_stage().with_virtual(painted(
        primitives::cuboid(Vec3::new(0.1, 0.1, 0.12)),
        DVec3::new(0.0, 0.02, 0.0),
        Material {
            base_colour: Vec3::new(0.2, 0.45, 0.7).extend(1.0),
            roughness: 0.3,
            ..Material::default()
        },
    ));
    let width = stage.picture.width;
    for (i, pixel) in (0_u32..).zip(stage.picture.rgba.chunks_exact_mut(4)) {
        let (x, y) = ((i % width) as f32, (i / width) as f32);
        let off = (x - 32.0).hypot(2.0 * (y - 88.0)) / 22.0;
        let glow = Vec3::new(3.0, 2.0, 1.2) * (-3.0 * off * off).exp();
        let linear = stage
            .response
            .linear_from_rgb([pixel[0], pixel[1], pixel[2]]);
        let codes = (Vec3::from(linear) * (1.0 + glow * 2.0) + glow * 0.4).to_array();
        pixel[..3].copy_from_slice(&codes.map(|v| stage.response.code_from_linear(v)));
    }
    stage.lamps = vec![penumbra_scene::PlacedLamp {
        position: Vec3::new(0.12, -0.1, 0.25),
        direction: Vec3::new(-0.3, 0.3, -1.0).normalize(),
        intensity: Vec3::new(0.5, 0.45, 0.3),
        cone: Some((0.3, 0.6)),
        area: None,
    }];
    stage
}

#[test]
fn golden_shorter_and_longer_exposure() {
    let mut stage = stage_with_clipped_reflection();
    for (name, stops) in [("exposure-shorter", -1.5), ("exposure-longer", 0.7)] {
        stage.exposure = penumbra_compositor::Exposure::Stops(stops);
        assert_golden(name, &stage.compose());
    }
}

/// Orange to the left, blue to the right.
fn halves() -> Arc<SceneTexture> {
    let texel = |i: u32| {
        if i % 64 < 32 {
            [230, 110, 20, 255]
        } else {
            [20, 60, 230, 255]
        }
    };
    Arc::new(SceneTexture {
        width: 64,
        height: 64,
        rgba: (0..64 * 64).flat_map(texel).collect(),
    })
}

#[test]
fn golden_screen_over_a_table() {
    let mut lamp = crate::area_lamps::area(
        DVec3::new(0.02, 0.13, 0.09),
        DVec3::new(0.0, -0.1, 0.03),
        DVec2::new(0.16, 0.1),
        Vec3::splat(0.035),
    );
    lamp.screen = Some(Screen {
        texture: Some(halves()),
        visible: true,
    });
    if let VirtualLightKind::Area { up, .. } = &mut lamp.kind {
        *up = DVec3::Z;
    }
    let white = Material {
        base_colour: Vec3::splat(0.8).extend(1.0),
        roughness: 0.5,
        ..Material::default()
    };
    let mut stage = golden_stage()
        .with_virtual(painted(
            primitives::sphere(0.025, 96, 48),
            DVec3::new(0.05, 0.0, 0.025),
            white.clone(),
        ))
        .with_virtual(painted(
            primitives::cuboid(Vec3::new(0.03, 0.03, 0.06)),
            DVec3::new(-0.04, 0.02, 0.0),
            white,
        ))
        .with_phantom(crate::stage::part(
            primitives::cuboid(Vec3::new(0.04, 0.02, 0.03)),
            DVec3::new(0.1, -0.08, 0.0),
        ));
    stage.settings.soft_samples = 4;
    stage.scene.lamps = vec![lamp];
    stage.scene.lamps_at(0.0, &mut stage.lamps);
    assert_golden("screen", &stage.compose());
}

/// A pattern of 4 by 4 knobs, as a normal map.
fn knobs() -> Arc<SceneTexture> {
    const SIDE: u32 = 64;
    let texel = |i: u32| {
        let at = |k: u32| ((k % 16) as f32 + 0.5) / 8.0 - 1.0;
        let (x, y) = (at(i % SIDE), -at(i / SIDE));
        let r2 = x * x + y * y;
        let n = if r2 < 0.8 {
            Vec3::new(x, y, (1.3 - r2).sqrt()).normalize()
        } else {
            Vec3::Z
        };
        let code = |v: f32| (127.5 * (v + 1.0)).round() as u8;
        [code(n.x), code(n.y), code(n.z), 255]
    };
    Arc::new(SceneTexture {
        width: SIDE,
        height: SIDE,
        rgba: (0..SIDE * SIDE).flat_map(texel).collect(),
    })
}

fn stripes() -> Arc<SceneTexture> {
    let texel = |i: u32| {
        if (i % 64 / 8).is_multiple_of(2) {
            [230, 120, 40, 255]
        } else {
            [40, 90, 200, 255]
        }
    };
    Arc::new(SceneTexture {
        width: 64,
        height: 64,
        rgba: (0..64 * 64).flat_map(texel).collect(),
    })
}

/// Three spheres with Phong's lobe, the last striped, and a box with knobs.
fn phong_stage() -> Stage {
    let phong = |diffuse: Vec3, exponent: f32| Material {
        base_colour: diffuse.extend(1.0),
        phong: Some(Phong {
            specular: Vec3::new(0.6, 0.5, 0.4),
            exponent,
        }),
        ..Material::default()
    };
    let striped = Material {
        base_colour_texture: Some(stripes()),
        ..phong(Vec3::splat(0.4), 300.0)
    };
    let knobbed = Material {
        normal_texture: Some(knobs()),
        ..phong(Vec3::new(0.1, 0.2, 0.1), 60.0)
    };
    let sphere = |x: f64, y: f64, material| {
        painted(
            primitives::sphere(0.04, 96, 48),
            DVec3::new(x, y, 0.04),
            material,
        )
    };
    golden_stage()
        .with_virtual(sphere(-0.1, 0.06, phong(Vec3::splat(0.1), 3.0)))
        .with_virtual(sphere(0.0, 0.08, phong(Vec3::splat(0.1), 30.0)))
        .with_virtual(sphere(0.1, 0.06, striped))
        .with_virtual(painted(
            primitives::cuboid(Vec3::new(0.14, 0.1, 0.05)),
            DVec3::new(0.0, -0.06, 0.0),
            knobbed,
        ))
}

#[test]
fn golden_phong_spheres_and_a_box_with_knobs() {
    assert_golden("phong", &phong_stage().compose());
}

#[test]
fn golden_phong_from_the_papers_chain() {
    let mut stage = phong_stage();
    let towards = stage.pose.unwrap().rotation * DVec3::NEG_Z;
    if let Some(lighting) = &mut stage.lighting {
        let texels: Vec<Vec3> = lighting.radiance.levels[0]
            .iter()
            .map(|t| Vec3::from(*t))
            .collect();
        lighting.radiance = Arc::new(box_chain(32, &texels, towards.as_vec3()));
    }
    assert_golden("phong-box", &stage.compose());
}
