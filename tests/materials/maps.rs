//! Environment maps.

use glam::Vec3;
use penumbra_lighting::cube::{CubeGrid, face_direction};
use std::f32::consts::PI;
use std::path::Path;

/// Direction of the small source.
pub const SPOT: Vec3 = Vec3::new(0.3, 0.5, 0.81);

/// A source of 3° half angle, 2000 times as bright as the rest.
pub fn spot(d: Vec3) -> Vec3 {
    let lit = d.dot(SPOT.normalize()) > 3.0_f32.to_radians().cos();
    Vec3::splat(if lit { 100.0 } else { 0.05 })
}

/// The window towards +X: half its width, the height of its middle and half its height, at a distance of 1.
pub const WINDOW: (f32, f32, f32) = (0.58, 0.6, 0.36);

/// A window that is 100 times as bright as the room.
pub fn window(d: Vec3) -> Vec3 {
    let (half_width, middle, half_height) = WINDOW;
    let at = d / d.x;
    let lit = d.x > 0.1 && at.y.abs() < half_width && (at.z - middle).abs() < half_height;
    Vec3::splat(if lit { 10.0 } else { 0.1 })
}

pub fn rendered(size: u32, radiance: impl Fn(Vec3) -> Vec3) -> Vec<Vec3> {
    CubeGrid::new(size)
        .directions
        .into_iter()
        .map(radiance)
        .collect()
}

/// Photographed maps, one indoors and one in the sun; `None` if they are missing.
pub fn real(size: u32) -> Option<Vec<(String, Vec<Vec3>)>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/envmaps");
    let names = ["aerodynamics_workshop_1k", "noon_grass_1k"];
    let maps = names.map(|name| {
        let picture = image::open(folder.join(format!("{name}.hdr")))
            .ok()?
            .into_rgb32f();
        Some((name.to_owned(), cube(size, &picture)))
    });
    let all: Option<Vec<_>> = maps.into_iter().collect();
    if all.is_none() {
        eprintln!("SKIPPED photographed maps: ../shared is missing");
    }
    all
}

/// Converts an equirectangular map: means over its texels.
fn cube(size: u32, picture: &image::Rgb32FImage) -> Vec<Vec3> {
    const PARTS: u32 = 4;
    let (width, height) = (picture.width() as f32, picture.height() as f32);
    let at = |d: Vec3| {
        let u = 0.5 - d.y.atan2(d.x) / (2.0 * PI);
        let v = d.z.clamp(-1.0, 1.0).acos() / PI;
        let (x, y) = ((u * width).min(width - 1.0), (v * height).min(height - 1.0));
        Vec3::from(picture.get_pixel(x as u32, y as u32).0)
    };
    let texel = |i: u32| {
        let (face, y, x) = (i / (size * size), i / size % size, i % size);
        let part = |k: u32, part: u32| {
            (f64::from(k) + (f64::from(part) + 0.5) / f64::from(PARTS)) / f64::from(size)
        };
        let all = (0..PARTS * PARTS).map(|k| {
            at(face_direction(face as usize, part(x, k % PARTS), part(y, k / PARTS)).as_vec3())
        });
        all.sum::<Vec3>() / (PARTS * PARTS) as f32
    };
    (0..6 * size * size).map(texel).collect()
}
