//! Dots whose centre can be measured to a hundredth of a pixel: they are brightest in the centre
//! and fade to zero, so that neither the few samples of a pixel nor 8-bit codes shift it.

use crate::stage::painted;
use glam::{DMat4, DVec2, DVec3, Vec3, Vec4};
use penumbra_camera::Response;
use penumbra_picture::Picture;
use penumbra_scene::{Material, Part, SceneTexture, primitives};
use std::f64::consts::PI;
use std::sync::Arc;

/// Rotation of a dot's square about its centre, radians.
const ROTATION: f64 = 0.3;

/// Light at a position in a dot's square (−1 to 1): half a cosine wave, zero at the rim.
fn profile(p: DVec2) -> f64 {
    0.5 + 0.5 * (PI * p.length().min(1.0)).cos()
}

/// The light of a dot as a texture.
fn light() -> Arc<SceneTexture> {
    // Texels are larger than pixels, so that no mip level is used.
    const TEXELS: u32 = 8;
    let response = Response::srgb();
    let positions =
        (0..TEXELS * TEXELS).map(|i| DVec2::new((i % TEXELS).into(), (i / TEXELS).into()));
    let codes = positions.map(|p| {
        let shown = profile((p + 0.5) / f64::from(TEXELS) * 2.0 - 1.0);
        (response.encoded_from_linear(shown as f32) * 255.0).round() as u8
    });
    Arc::new(SceneTexture {
        width: TEXELS,
        height: TEXELS,
        rgba: codes.flat_map(|c| [c, c, c, 255]).collect(),
    })
}

/// A dot facing up, `side` metres wide, at a position in the world.
pub fn dot(side: f64, at: DVec3) -> Part {
    let shining = Material {
        base_colour: Vec4::new(0.0, 0.0, 0.0, 1.0),
        emissive: Vec3::splat(0.7),
        specular: 0.0,
        emissive_texture: Some(light()),
        ..Material::default()
    };
    let mut part = painted(primitives::plane(side as f32, side as f32), at, shining);
    part.world_from_part *= DMat4::from_rotation_z(ROTATION);
    part
}

/// Centre of a dot's light in the picture, where `seen` projects a point of the world: the mean of
/// its cells' centres, weighted by their light and projected area.
pub fn truth(side: f64, at: DVec3, seen: impl Fn(DVec3) -> DVec2) -> DVec2 {
    const CELLS: usize = 16;
    let position = |i: usize| 2.0 * i as f64 / CELLS as f64 - 1.0;
    let corner = |i: usize, j: usize| {
        let off =
            DVec2::from_angle(ROTATION).rotate(DVec2::new(position(i), position(j)) * 0.5 * side);
        seen(at + off.extend(0.0))
    };
    let corners: Vec<DVec2> = (0..=CELLS)
        .flat_map(|j| (0..=CELLS).map(move |i| (i, j)))
        .map(|(i, j)| corner(i, j))
        .collect();
    let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
    for (i, j) in (0..CELLS).flat_map(|j| (0..CELLS).map(move |i| (i, j))) {
        let at = |i: usize, j: usize| corners[j * (CELLS + 1) + i];
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        let area = 0.5 * (c - a).perp_dot(d - b).abs();
        let centre = DVec2::new(position(i), position(j)) + 1.0 / CELLS as f64;
        let shown = area * profile(centre);
        sum += (a + b + c + d) * 0.25 * shown;
        weight += shown;
    }
    sum / weight
}

/// Centroid of the light within `reach` pixels of `near`.
pub fn found(picture: &Picture, near: DVec2, reach: i64) -> DVec2 {
    let response = Response::srgb();
    let linear = response.linear_from_code();
    let (width, height) = (i64::from(picture.width), i64::from(picture.height));
    let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
    let (cx, cy) = (near.x.round() as i64, near.y.round() as i64);
    let rows = (cy - reach).max(0)..=(cy + reach).min(height - 1);
    let columns = (cx - reach).max(0)..=(cx + reach).min(width - 1);
    for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
        let code = picture.rgba[4 * (y * width + x) as usize];
        let light = f64::from(linear[usize::from(code)]);
        sum += DVec2::new(x as f64, y as f64) * light;
        weight += light;
    }
    sum / weight
}

/// Root mean square and maximum of errors.
pub fn rms_and_worst(off: &[f64]) -> (f64, f64) {
    let squares: f64 = off.iter().map(|o| o * o).sum();
    let worst = off.iter().copied().fold(0.0, f64::max);
    ((squares / off.len() as f64).sqrt(), worst)
}
