//! Indirect light at points of surfaces; twin of `irradiance.wgsl`.

use crate::layout::{BORDERED, TEXELS};
use crate::texels::PageTexels;
use glam::{UVec3, Vec3, Vec4};
use penumbra_scene::IndirectLight;
use penumbra_scene::indirect_light::{Irradiance, VOLUME_SIZE};

/// Texels along each axis at which a plane page is evaluated; between them indirect light is
/// interpolated.
const LATTICE: [usize; 3] = [0, 8, BORDERED - 1];

/// Writes the indirect irradiance on each texel of a page.
pub fn fill(
    light: &IndirectLight,
    kind: &Irradiance,
    page: &PageTexels,
    to: &mut [[f32; TEXELS]; 3],
) {
    fill_with(page, to, |p, n| irradiance(light, kind, p, n).to_array());
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
    let real = irradiance(light, &light.real_now, p, n);
    real.lerp(known.truncate(), known.w).extend(known.w)
}

/// Writes a function of position and normal on each texel of a page, channel by channel.
fn fill_with<const N: usize>(
    page: &PageTexels,
    to: &mut [[f32; TEXELS]; N],
    value: impl Fn(Vec3, Vec3) -> [f32; N],
) {
    let at = |k: usize| value(page.positions[k], page.normals[k]);
    let mut set = |k: usize, value: [f32; N]| {
        for (channel, value) in to.iter_mut().zip(value) {
            channel[k] = value;
        }
    };
    if page.plane.is_none() {
        (0..TEXELS).for_each(|k| set(k, at(k)));
        return;
    }
    let known = LATTICE.map(|y| LATTICE.map(|x| at(y * BORDERED + x)));
    for k in 0..TEXELS {
        let part = |texel: usize| {
            let i = usize::from(texel >= LATTICE[1]);
            let length = (LATTICE[i + 1] - LATTICE[i]) as f32;
            (i, (texel - LATTICE[i]) as f32 / length)
        };
        let ((x, fx), (y, fy)) = (part(k % BORDERED), part(k / BORDERED));
        let top = mix(known[y][x], known[y][x + 1], fx);
        let bottom = mix(known[y + 1][x], known[y + 1][x + 1], fx);
        set(k, mix(top, bottom, fy));
    }
}

fn mix<const N: usize>(a: [f32; N], b: [f32; N], t: f32) -> [f32; N] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t)
}

/// Indirect irradiance at `p` on a surface with normal `n` from one of the kinds of `light`; zero
/// outside its region.
pub fn irradiance(light: &IndirectLight, kind: &Irradiance, p: Vec3, n: Vec3) -> Vec3 {
    let at = (p - light.low) / (light.high - light.low);
    let margin = Vec3::new(0.0, 0.0, 0.02);
    if light.generation == 0 || at.cmplt(-margin).any() || at.cmpgt(Vec3::ONE).any() {
        return Vec3::ZERO;
    }
    if n.z > 0.99 && at.z < 0.02 {
        let value = light.on_ground.value(&kind.ground, at.truncate());
        return value.unwrap_or_default();
    }
    let size = UVec3::from(VOLUME_SIZE).as_vec3();
    // Half a probe off the surface: probes behind it are inside objects or on their far side.
    let off = at + 0.5 * n / size;
    let weights = n * n;
    (0..3)
        .map(|axis| {
            let face = 2 * axis + usize::from(n[axis] < 0.0);
            in_volume(&kind.volume[face], off) * weights[axis]
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
