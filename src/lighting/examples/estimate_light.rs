//! Estimates the light from two exposures of a fisheye camera that looks up, and prints the
//! irradiance of the sky and the lights that cast shadows.
//!
//! ```text
//! cargo run -p penumbra-lighting --example estimate_light
//! ```
//! The pictures are rendered: a blue sky and a sun, which the longer exposure clips.

use glam::{DVec2, Vec3};
use penumbra_camera::{EnvironmentView, FisheyeLens, Response};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::{
    Bracket, EnvironmentError, EnvironmentEstimator, EnvironmentInput, EnvironmentSettings,
    LightKind, Lighting,
};
use penumbra_picture::Picture;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// Width and height of the pictures, pixels.
const SIZE: u32 = 480;
/// Stops of the two exposures relative to the base exposure.
const EXPOSURES_EV: [f64; 2] = [0.0, -9.0];
/// Radiance of the sky; 1 is white at the base exposure.
pub const SKY: Vec3 = Vec3::new(0.2, 0.3, 0.5);
/// Radiance of the sun.
pub const SUN: Vec3 = Vec3::new(200.0, 180.0, 140.0);
/// Half the angle that the sun subtends, radians.
pub const SUN_RADIUS: f32 = 0.06;

fn main() -> Result<(), EnvironmentError> {
    let light = estimate(sun_direction(40.0, 30.0))?;
    let sky = light.irradiance.irradiance(Vec3::Z);
    println!("irradiance of level ground without compact sources: {sky:.2}");
    for light in light.lights.iter().filter(|l| l.kind == LightKind::Compact) {
        let d = light.direction;
        println!(
            "compact source: azimuth {:.1}°, elevation {:.1}°, irradiance {:.2}",
            d.y.atan2(d.x).to_degrees(),
            d.z.asin().to_degrees(),
            light.irradiance
        );
    }
    Ok(())
}

/// Returns the unit vector to the sun in the world (+Z up) from angles in degrees.
pub fn sun_direction(azimuth: f32, elevation: f32) -> Vec3 {
    let (sin, cos) = azimuth.to_radians().sin_cos();
    let (up, level) = elevation.to_radians().sin_cos();
    Vec3::new(cos * level, sin * level, up)
}

/// Estimates the light of a rendered sky with the sun at `sun`.
pub fn estimate(sun: Vec3) -> Result<Arc<Lighting>, EnvironmentError> {
    let lens = FisheyeLens {
        width: SIZE,
        height: SIZE,
        focal: f64::from(SIZE) / 2.0 / FRAC_PI_2,
        centre: DVec2::splat(f64::from(SIZE - 1) / 2.0),
        distortion: [0.0; 4],
        max_theta: FRAC_PI_2,
    };
    let pictures = EXPOSURES_EV.map(|ev| photograph(&lens, sun, ev));
    let brackets: Vec<Bracket> = pictures
        .iter()
        .zip(EXPOSURES_EV)
        .map(|(picture, ev)| Bracket { picture, ev })
        .collect();
    // The camera's axis, +Z of its frame, points up, +Z of the world.
    let view = EnvironmentView::Fisheye {
        lens,
        world_from_camera: RigidTransform::IDENTITY,
    };
    let settings = EnvironmentSettings::default();
    let mut estimator = EnvironmentEstimator::new(&view, &Response::srgb(), settings, None)?;
    estimator.update(&EnvironmentInput::new(&brackets, MonotonicTime::default()))
}

/// Renders the sky as an sRGB camera with this lens records it, `ev` stops from the base exposure.
fn photograph(lens: &FisheyeLens, sun: Vec3, ev: f64) -> Picture {
    let response = Response::srgb();
    let mut rgba = Vec::with_capacity((4 * SIZE * SIZE) as usize);
    for pixel in 0..SIZE * SIZE {
        let at = DVec2::new(f64::from(pixel % SIZE), f64::from(pixel / SIZE));
        let radiance = lens.unproject(at).map_or(Vec3::ZERO, |direction| {
            let in_sun = direction.as_vec3().angle_between(sun) < SUN_RADIUS;
            if in_sun { SUN } else { SKY }
        });
        let exposed = radiance * 2_f32.powf(ev as f32);
        rgba.extend(
            exposed
                .to_array()
                .map(|linear| response.code_from_linear(linear.min(1.0))),
        );
        rgba.push(255);
    }
    Picture {
        width: SIZE,
        height: SIZE,
        rgba,
    }
}
