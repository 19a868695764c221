//! The rows of Supan 2006, table 1: 800×600, an object of 58,500 triangles on a plane,
//! 0 to 64 dome lights, with one or all shadow maps updated per frame.

use super::BenchOptions;
use super::percentiles::Percentiles;
use super::report::{BenchReport, Row};
use super::stage::{Passes, WARM_UP, camera, look_at, picture};
use glam::{DMat4, DVec3, Vec3, Vec4};
use penumbra_camera::Response;
use penumbra_compositor::{Compositor, CompositorSettings, FrameInput, Gpu, GpuError, Refresh};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace, Lighting};
use penumbra_scene::{Material, Mesh, Part, Scene, primitives};
use std::sync::Arc;
use std::time::Instant;

pub(super) fn run(
    gpu: &Gpu,
    options: &BenchOptions,
    report: &mut BenchReport,
    progress: &mut dyn FnMut(&Row),
) -> Result<(), GpuError> {
    let size = options.size.unwrap_or((800, 600));
    for (lights, all) in [(0, false), (8, false), (48, false), (64, false), (64, true)] {
        let row = measure(gpu, size, lights, all, options.frames.unwrap_or(60))?;
        progress(&row);
        report.rows.push(row);
    }
    Ok(())
}

fn measure(
    gpu: &Gpu,
    (width, height): (u32, u32),
    lights: u32,
    all: bool,
    frames: u32,
) -> Result<Row, GpuError> {
    let scene = scene();
    let mut compositor = Compositor::new(
        gpu.clone(),
        CompositorSettings::for_adapter(gpu.software),
        Response::srgb(),
    );
    compositor.set_scene(&scene, &penumbra_scene::casters(&scene));
    let lighting = lighting(lights);
    let picture = picture(width, height);
    let camera = camera(width, height);
    let refreshed = if all { lights } else { lights.min(1) };
    let (mut wall, mut gpu_total, mut passes) = (Vec::new(), Vec::new(), Passes::default());
    for i in 0..WARM_UP + frames {
        let start = Instant::now();
        compositor.compose(&FrameInput {
            world_from_camera: Some(pose(i)),
            lighting: Some(&lighting),
            refresh: Refresh::InTurn(refreshed as usize),
            ..FrameInput::new(&picture, &camera)
        })?;
        gpu.wait()?;
        let elapsed = start.elapsed().as_secs_f64() * 1e3;
        if i >= WARM_UP {
            wall.push(elapsed);
            let times = compositor.pass_times();
            gpu_total.push(times.iter().map(|(_, ms)| ms).sum());
            passes.add(&times);
        }
    }
    let mean = wall.iter().sum::<f64>() / wall.len().max(1) as f64;
    Ok(Row {
        case: "supan".to_owned(),
        width,
        height,
        lights,
        refreshed_per_frame: refreshed,
        planes: 0,
        basis_images: 0,
        light_changes: false,
        triangles: scene
            .virtual_parts
            .iter()
            .map(|p| p.mesh.indices.len() / 3)
            .sum(),
        lamps: 0,
        environment: None,
        fps: 1e3 / mean,
        wall_ms: Percentiles::from_values(&wall),
        gpu_ms: Percentiles::from_values(&gpu_total),
        processor_ms: None,
        stages: Vec::new(),
        passes: passes.medians(),
    })
}

/// A torus of 58,500 triangles above a plane.
fn scene() -> Scene {
    let part = |name: &str, mesh: Mesh, at: DVec3, material: Material| Part {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(material),
        world_from_part: DMat4::from_translation(at),
        mirror: false,
        albedo: None,
    };
    let gold = Material {
        base_colour: Vec4::new(0.9, 0.7, 0.3, 1.0),
        metallic: 0.2,
        roughness: 0.4,
        ..Material::default()
    };
    let torus = primitives::torus(0.09, 0.035, 225, 130);
    Scene {
        virtual_parts: vec![part("torus", torus, DVec3::new(0.0, 0.0, 0.06), gold)],
        phantom_parts: vec![part(
            "table",
            primitives::plane(8.0, 8.0),
            DVec3::ZERO,
            Material::default(),
        )],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

/// Lights spread evenly over the upper hemisphere, of slightly different colours.
fn lighting(count: u32) -> Lighting {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let lights = (0..count)
        .map(|i| {
            let z = 1.0 - (i as f32 + 0.5) / count as f32;
            let (sin, cos) = (golden * i as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            DomeLight {
                direction: Vec3::new(r * cos, r * sin, z.max(0.05)).normalize(),
                irradiance: Vec3::new(0.8 + 0.4 * cos * r, 1.0, 0.8 - 0.4 * cos * r) * 3.0
                    / count as f32,
                angular_radius: 0.12,
                kind: LightKind::Cell,
                place: LightPlace::FAR,
            }
        })
        .collect();
    let mut irradiance = Harmonics::default();
    irradiance.coefficients[0] = Vec3::splat(2.0);
    let levels = (0..6).map(|m| vec![[0.6; 3]; 6 << (2 * (5 - m))]).collect();
    Lighting {
        captured_at: MonotonicTime::default(),
        generation: 1,
        radiance: Arc::new(CubeMap {
            size: 32,
            levels,
            ..CubeMap::default()
        }),
        irradiance,
        lights,
        ground_radiance: Vec3::splat(0.3),
        faces: None,
    }
}

/// Pose of a camera that slowly orbits the object and looks down at it.
fn pose(frame: u32) -> RigidTransform {
    let angle = -1.3 + 0.01 * f64::from(frame);
    let eye = DVec3::new(0.42 * angle.cos(), 0.42 * angle.sin(), 0.36);
    look_at(eye, DVec3::new(0.0, 0.0, 0.02))
}
