//! Indirect light at points of surfaces; twin of `irradiance.wgsl`.

use crate::layout::{BORDERED, TEXELS};
use crate::texels::{PageTexels, between};
use glam::{UVec3, Vec3, Vec4};
use penumbra_scene::IndirectLight;
use penumbra_scene::indirect_light::{OnReal, VOLUME_SIZE};

/// Writes the indirect irradiance on each texel of a page of a real surface.
pub fn fill(light: &IndirectLight, kind: &OnReal, page: &PageTexels, to: &mut [[f32; TEXELS]; 3]) {
    fill_with(page, to, |p, n| on_real(light, kind, p, n).to_array());
}

/// The same on a virtual surface, with the share to which the exchange of light between virtual
/// surfaces is known; only the rest of it is unknown.
pub fn fill_on_virtual(light: &IndirectLight, page: &PageTexels, to: &mut [[f32; TEXELS]; 4]) {
    fill_with(page, to, |p, n| on_virtual(light, p, n).to_array());
}

/// Indirect irradiance at `p` on a virtual surface with normal `n`, and in w the share to which
/// that includes light of other virtual surfaces. Twin of `indirect_light_on_virtual`.
fn on_virtual(light: &IndirectLight, p: Vec3, n: Vec3) -> Vec4 {
    let known = light.on_virtual.on(p, n);
    let real = from_phantoms(light, p, n);
    real.lerp(known.truncate(), known.w).extend(known.w)
}

/// Writes a function of position and normal on each texel of a page, channel by channel. It is
/// evaluated once for every [`PageTexels::stride`] texels along each axis and interpolated between.
fn fill_with<const N: usize>(
    page: &PageTexels,
    to: &mut [[f32; TEXELS]; N],
    value: impl Fn(Vec3, Vec3) -> [f32; N],
) {
    let is_corner = |at: usize| at.is_multiple_of(page.stride) || at + 1 == BORDERED;
    for y in (0..BORDERED).filter(|y| is_corner(*y)) {
        let row = y * BORDERED;
        for x in (0..BORDERED).filter(|x| is_corner(*x)) {
            let value = value(page.positions[row + x], page.normals[row + x]);
            for (channel, value) in to.iter_mut().zip(value) {
                channel[row + x] = value;
            }
        }
        for channel in to.iter_mut() {
            for x in (0..BORDERED).filter(|x| !is_corner(*x)) {
                let ([left, right], share) = between(x, page.stride);
                channel[row + x] = mix(channel[row + left], channel[row + right], share);
            }
        }
    }
    for y in (0..BORDERED).filter(|y| !is_corner(*y)) {
        let ([top, bottom], share) = between(y, page.stride);
        for channel in to.iter_mut() {
            for x in 0..BORDERED {
                let column = |y: usize| channel[y * BORDERED + x];
                channel[y * BORDERED + x] = mix(column(top), column(bottom), share);
            }
        }
    }
}

fn mix(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

/// Place in the region of `light`, from 0 to 1; `None` outside.
fn in_region(light: &IndirectLight, p: Vec3) -> Option<Vec3> {
    let at = (p - light.low) / (light.high - light.low);
    let margin = Vec3::new(0.0, 0.0, 0.02);
    let is_inside = at.cmpge(-margin).all() && at.cmple(Vec3::ONE).all();
    (light.generation != 0 && is_inside).then_some(at)
}

fn is_on_ground(at: Vec3, n: Vec3) -> bool {
    n.z > 0.99 && at.z < 0.02
}

/// Indirect irradiance at `p` on a real surface with normal `n` from one of the kinds of `light`; zero
/// outside its region. Twin of `indirect_on_real`.
pub fn on_real(light: &IndirectLight, kind: &OnReal, p: Vec3, n: Vec3) -> Vec3 {
    let Some(at) = in_region(light, p) else {
        return Vec3::ZERO;
    };
    if is_on_ground(at, n) {
        let value = light.on_ground.value(&kind.ground, at.truncate());
        return value.unwrap_or_default();
    }
    let found = kind.surfaces.on(p, n);
    found.truncate() * found.w
}

/// Irradiance at `p` on a virtual surface with normal `n` by light that phantoms reflect; zero outside the
/// region. Twin of `from_phantoms`.
fn from_phantoms(light: &IndirectLight, p: Vec3, n: Vec3) -> Vec3 {
    let Some(at) = in_region(light, p) else {
        return Vec3::ZERO;
    };
    if is_on_ground(at, n) {
        let value = light.on_ground.value(&light.real_now.ground, at.truncate());
        return value.unwrap_or_default();
    }
    let size = UVec3::from(VOLUME_SIZE).as_vec3();
    // Half a probe off the surface: probes behind it are inside objects or on their far side.
    let off = at + 0.5 * n / size;
    let weights = n * n;
    (0..3)
        .map(|axis| {
            let face = 2 * axis + usize::from(n[axis] < 0.0);
            in_volume(&light.real_now.volume[face], off) * weights[axis]
        })
        .sum()
}

fn in_volume(volume: &[Vec3], at: Vec3) -> Vec3 {
    let [nx, ny, nz] = VOLUME_SIZE.map(|n| n as usize);
    let axis = |x: f32, n: usize| {
        let x = (x * n as f32 - 0.5).clamp(0.0, (n - 1) as f32);
        let low = (x as usize).min(n - 2);
        (low, x - low as f32)
    };
    let ((x, fx), (y, fy), (z, fz)) = (axis(at.x, nx), axis(at.y, ny), axis(at.z, nz));
    let value = |x: usize, y: usize, z: usize| {
        volume
            .get((z * ny + y) * nx + x)
            .copied()
            .unwrap_or_default()
    };
    let line = |y, z| value(x, y, z).lerp(value(x + 1, y, z), fx);
    let plane = |z| line(y, z).lerp(line(y + 1, z), fy);
    plane(z).lerp(plane(z + 1), fz)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CacheOptions, SurfaceCache};
    use penumbra_scene::{Material, Part, Scene, primitives};
    use std::sync::Arc;

    #[test]
    fn interpolated_light_is_near_that_of_each_texel() {
        let ball = Part {
            name: "ball".to_owned(),
            mesh: Arc::new(primitives::sphere(0.1, 48, 24)),
            material: Arc::new(Material::default()),
            world_from_part: glam::DMat4::IDENTITY,
            mirror: false,
            albedo: None,
        };
        let scene = Scene {
            virtual_parts: vec![ball],
            ..Scene::default()
        };
        let options = CacheOptions {
            pages: 600,
            map_size: 64,
            lights: 1,
        };
        let cache = SurfaceCache::new(&scene, &penumbra_scene::casters(&scene), &options);
        let value = |p: Vec3, n: Vec3| [p.dot(Vec3::new(1.0, 2.0, 3.0)) + n.z * n.z];
        let (mut texels, mut interpolated) = (0, 0);
        for page in cache.receiver_pages() {
            let page = &page.texels;
            let mut found = [[0.0; TEXELS]];
            fill_with(page, &mut found, value);
            for k in (0..TEXELS).filter(|k| page.is_used[*k]) {
                let [expected] = value(page.positions[k], page.normals[k]);
                assert!((found[0][k] - expected).abs() < 0.06, "{}", page.stride);
                texels += 1;
                interpolated += usize::from(page.stride > 1);
            }
        }
        assert!(interpolated * 2 > texels, "{interpolated} of {texels}");
    }
}
