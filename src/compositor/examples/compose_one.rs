//! Composes one frame off-screen: a white box on a table, under a uniform sky.
//!
//! ```text
//! cargo run -p penumbra-compositor --example compose_one -- compose_one.png
//! ```
//!
//! Prints how many pixels the box and its shadow changed; writes the picture if a file is named.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, Vec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_compositor::{Compositor, CompositorSettings, FrameInput, Gpu, GpuError};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace, Lighting};
use penumbra_picture::Picture;
use penumbra_scene::{Material, Mesh, Part, Scene, casters, primitives};
use std::error::Error;
use std::f32::consts::PI;
use std::sync::Arc;

/// Width and height of the picture, pixels.
pub const SIZE: (u32, u32) = (320, 240);
/// sRGB code of all channels of the camera picture.
pub const GREY: u8 = 160;
/// Radiance of the sky; a white surface that reflects all of it has the linear value 0.5.
const RADIANCE: f32 = 0.5;
/// Number of dome lights.
const LIGHTS: u32 = 64;

fn main() -> Result<(), Box<dyn Error>> {
    let Some(picture) = compose_one()? else {
        println!("SKIPPED compose_one: no adapter");
        return Ok(());
    };
    let codes = || picture.rgba.chunks_exact(4).map(|p| p[0]);
    let brighter = codes().filter(|code| *code > GREY).count();
    let darker = codes().filter(|code| *code < GREY).count();
    let (width, height) = (picture.width, picture.height);
    println!("{width}×{height} pixels: {brighter} brighter than the camera's, {darker} darker");
    if let Some(path) = std::env::args().nth(1) {
        write_png(&path, &picture)?;
        println!("wrote {path}");
    }
    Ok(())
}

/// Composes the frame; `None` without a graphics adapter.
///
/// # Errors
/// The adapter cannot run the compositor, or the device failed.
pub fn compose_one() -> Result<Option<Picture>, GpuError> {
    let gpu = match Gpu::open(None) {
        Ok(gpu) => gpu,
        Err(GpuError::NoAdapter) => return Ok(None),
        Err(error) => return Err(error),
    };
    let settings = CompositorSettings::for_adapter(gpu.software);
    let mut compositor = Compositor::new(gpu, settings, Response::srgb());
    let scene = scene();
    compositor.set_scene(&scene, &casters(&scene));
    let (camera, lighting) = (camera(), uniform_light());
    let camera_picture = Picture {
        width: SIZE.0,
        height: SIZE.1,
        rgba: [GREY, GREY, GREY, 255].repeat((SIZE.0 * SIZE.1) as usize),
    };
    compositor.compose(&FrameInput {
        world_from_camera: Some(looking_at_origin(DVec3::new(0.1, -0.5, 0.4))),
        lighting: Some(&lighting),
        ..FrameInput::new(&camera_picture, &camera)
    })?;
    let mut picture = Picture::default();
    compositor.read(&mut picture)?;
    Ok(Some(picture))
}

/// A table of 2 m × 2 m, which is real, and a box of 10 cm on it, which is virtual. +Z is up.
fn scene() -> Scene {
    let cube = primitives::cuboid(Vec3::splat(0.1));
    Scene {
        phantom_parts: vec![part("table", primitives::plane(2.0, 2.0), DVec3::ZERO)],
        virtual_parts: vec![part("box", cube, DVec3::new(0.0, 0.0, 0.05))],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

fn part(name: &str, mesh: Mesh, position: DVec3) -> Part {
    Part {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(position),
        mirror: false,
        albedo: None,
    }
}

fn camera() -> PinholeCamera {
    let (width, height) = SIZE;
    PinholeCamera {
        width,
        height,
        focal: DVec2::splat(f64::from(width)),
        centre: DVec2::new(f64::from(width - 1), f64::from(height - 1)) * 0.5,
        distortion: [0.0; 5],
    }
}

/// Pose of a camera (+X right, +Y down, +Z forward) at `eye` that looks at the origin.
fn looking_at_origin(eye: DVec3) -> RigidTransform {
    let forward = -eye.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    RigidTransform::new(DQuat::from_mat3(&axes), eye)
}

/// A uniform sky: dome lights of equal irradiance on a spiral over the upper hemisphere, its
/// irradiance as spherical harmonics, and a radiance map of one colour for reflections.
fn uniform_light() -> Lighting {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    let lights = (0..LIGHTS).map(|i| {
        let z = 1.0 - (i as f32 + 0.5) / LIGHTS as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DomeLight {
            direction: Vec3::new(r * cos, r * sin, z),
            // Each light stands for an equal share of the solid angle 2π.
            irradiance: Vec3::splat(2.0 * PI * RADIANCE / LIGHTS as f32),
            angular_radius: 0.2,
            kind: LightKind::Cell,
            place: LightPlace::FAR,
        }
    });
    let mut irradiance = Harmonics::default();
    irradiance.coefficients[0] = Vec3::splat(PI * RADIANCE);
    let levels = (0..4).map(|level| vec![[RADIANCE; 3]; 6 << (2 * (3 - level))]);
    Lighting {
        captured_at: MonotonicTime::default(),
        generation: 1,
        lights: lights.collect(),
        irradiance,
        radiance: Arc::new(CubeMap {
            size: 8,
            levels: levels.collect(),
            ..CubeMap::default()
        }),
        ground_radiance: Vec3::splat(RADIANCE),
        faces: None,
    }
}

fn write_png(path: &str, picture: &Picture) -> Result<(), Box<dyn Error>> {
    let file = std::fs::File::create(path)?;
    let mut encoder = png::Encoder::new(file, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header()?.write_image_data(&picture.rgba)?;
    Ok(())
}
