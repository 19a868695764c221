//! Equirectangular environment map, for display and files.

use super::light::{DomeLight, LightKind, Lighting};
use super::sources::LUMINANCE;
use super::{CubeMap, cube};
use glam::Vec3;
use penumbra_camera::srgb_from_linear;
use penumbra_picture::Picture;
use std::f32::consts::PI;

/// Linear radiance by longitude and latitude: φ = 2π (½ − (u + ½)/W) from +X towards +Y,
/// θ = π (v + ½)/H from +Z, d = (sin θ cos φ, sin θ sin φ, cos θ).
#[derive(Clone, Debug, PartialEq)]
pub struct Equirect {
    /// Columns, twice the rows.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major.
    pub texels: Vec<Vec3>,
}

impl Equirect {
    /// Fills a map of `height` rows from a function of the direction.
    #[must_use]
    pub fn from_fn(height: u32, radiance: impl Fn(Vec3) -> Vec3) -> Self {
        let width = 2 * height;
        let texels = (0..width * height)
            .map(|i| {
                radiance(direction(
                    width,
                    height,
                    (i % width) as f32,
                    (i / width) as f32,
                ))
            })
            .collect();
        Self {
            width,
            height,
            texels,
        }
    }

    /// Resamples level 0 of a cube map.
    #[must_use]
    pub fn from_cube(map: &CubeMap, height: u32) -> Self {
        Self::from_fn(height, |d| cube::sample(map, 0, d))
    }

    /// Returns the radiance in a direction, bilinear between the pixels around it.
    #[must_use]
    pub fn sample(&self, direction: Vec3) -> Vec3 {
        let (u, v) = pixel(self.width, self.height, direction);
        let (x, y) = (u.floor(), v.floor());
        let (fx, fy) = (u - x, v - y);
        let at = |dx: i64, dy: i64| {
            let column = (x as i64 + dx).rem_euclid(i64::from(self.width).max(1));
            let row = (y as i64 + dy).clamp(0, i64::from(self.height) - 1);
            let i = usize::try_from(row * i64::from(self.width) + column);
            let texel = i.ok().and_then(|i| self.texels.get(i));
            texel.copied().unwrap_or(Vec3::ZERO)
        };
        let upper = at(0, 0).lerp(at(1, 0), fx);
        let lower = at(0, 1).lerp(at(1, 1), fx);
        upper.lerp(lower, fy)
    }

    /// Tone-maps the map with an exposure for which nine tenths of the sphere are below white.
    #[must_use]
    pub fn to_picture(&self) -> Picture {
        let exposure = self.exposure();
        let code = |v: f32| (srgb_from_linear(v * exposure) * 255.0 + 0.5) as u8;
        let rgba = self
            .texels
            .iter()
            .flat_map(|t| [code(t.x), code(t.y), code(t.z), 255])
            .collect();
        Picture {
            width: self.width,
            height: self.height,
            rgba,
        }
    }

    fn exposure(&self) -> f32 {
        let mut values: Vec<f32> = self.texels.iter().map(|t| t.dot(LUMINANCE)).collect();
        let k = (values.len() * 9 / 10).min(values.len().saturating_sub(1));
        if values.is_empty() {
            return 1.0;
        }
        let (_, high, _) = values.select_nth_unstable_by(k, f32::total_cmp);
        0.8 / high.max(1e-6)
    }
}

/// Returns the direction of the point (`u`, `v`), pixels, of a map.
fn direction(width: u32, height: u32, u: f32, v: f32) -> Vec3 {
    let phi = 2.0 * PI * (0.5 - (u + 0.5) / width as f32);
    let theta = PI * (v + 0.5) / height as f32;
    Vec3::new(
        theta.sin() * phi.cos(),
        theta.sin() * phi.sin(),
        theta.cos(),
    )
}

/// Returns the pixel of a direction: the inverse of [`direction`].
fn pixel(width: u32, height: u32, d: Vec3) -> (f32, f32) {
    let u = (0.5 - d.y.atan2(d.x) / (2.0 * PI)) * width as f32 - 0.5;
    let v = d.z.clamp(-1.0, 1.0).acos() / PI * height as f32 - 0.5;
    (u, v)
}

/// Draws the dome lights on the environment map: rings for cells, discs for compact sources, with
/// areas proportional to their share of the light. For the dashboard.
#[must_use]
pub fn preview(lighting: &Lighting, height: u32) -> Picture {
    let mut picture = Equirect::from_cube(&lighting.radiance, height).to_picture();
    let total: f32 = lighting.lights.iter().map(strength).sum();
    for light in lighting.lights.iter().filter(|l| strength(l) > 0.0) {
        let share = strength(light) / total.max(f32::MIN_POSITIVE);
        let radius = (share.sqrt() * height as f32 * 0.2).clamp(1.5, height as f32 / 8.0);
        draw(&mut picture, light, radius);
    }
    picture
}

fn strength(light: &DomeLight) -> f32 {
    light.irradiance.dot(LUMINANCE)
}

fn draw(picture: &mut Picture, light: &DomeLight, radius: f32) {
    let (width, height) = (picture.width as i32, picture.height as i32);
    let (u, v) = pixel(picture.width, picture.height, light.direction);
    let colour: [u8; 3] = match light.kind {
        LightKind::Compact => [255, 64, 32],
        LightKind::Cell => [64, 200, 255],
    };
    let reach = radius.ceil() as i32 + 1;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let distance = ((dx * dx + dy * dy) as f32).sqrt();
            let y = v.round() as i32 + dy;
            if (distance - radius).abs() > 0.7 || y < 0 || y >= height {
                continue;
            }
            let x = (u.round() as i32 + dx).rem_euclid(width);
            let i = 4 * (y * width + x) as usize;
            picture.rgba[i..i + 3].copy_from_slice(&colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_and_directions_are_inverse() {
        for (u, v) in [(0.0, 0.0), (10.0, 31.0), (100.3, 5.5), (127.0, 63.0)] {
            let (a, b) = pixel(128, 64, direction(128, 64, u, v));
            assert!(
                (a - u).abs() < 1e-3 && (b - v).abs() < 1e-3,
                "{u} {v} {a} {b}"
            );
        }
        // +X is in the middle, +Y a quarter to the left, the zenith at the top.
        assert_eq!(pixel(128, 64, Vec3::X), (63.5, 31.5));
        assert_eq!(pixel(128, 64, Vec3::Y), (31.5, 31.5));
    }

    #[test]
    fn black_and_empty_maps_give_finite_pictures() {
        assert_eq!(
            Equirect::from_fn(4, |_| Vec3::ZERO).to_picture().rgb(0, 0),
            [0, 0, 0]
        );
        assert!(
            Equirect::from_fn(0, |_| Vec3::ZERO)
                .to_picture()
                .rgba
                .is_empty()
        );
    }
}
