//! The pictures of area lamps from which their light is computed: small, with all mip levels.

use super::texels::{half_texel, write_level};
use super::textures::format;
use crate::compiled::Device;
use glam::Vec3;
use penumbra_camera::linear_from_srgb;
use penumbra_scene::SceneTexture;
use penumbra_scene::VirtualLight;
use penumbra_scene::photometric::{luminance, mean_colour};

/// Texels a side: the light of a lamp needs no finer detail.
const SIDE: u32 = 64;

/// The pictures of a scene's area lamps. Twin of WGSL `lamp_screens`.
pub struct LampScreens {
    pub view: wgpu::TextureView,
    /// The layer of each lamp of the scene; layer 0 is white.
    layers: Vec<u32>,
}

impl LampScreens {
    /// Uploads the pictures of a scene's `lamps`.
    pub fn new(device: &Device, queue: &wgpu::Queue, lamps: &[VirtualLight]) -> Self {
        let texture_of = |lamp: &VirtualLight| lamp.screen.as_ref()?.texture.clone();
        let mut all = vec![vec![Vec3::ONE; (SIDE * SIDE) as usize]];
        let layers = lamps.iter().map(|lamp| match texture_of(lamp) {
            Some(texture) => {
                all.push(screen(&texture));
                all.len() as u32 - 1
            }
            None => 0,
        });
        let layers = layers.collect();
        Self {
            view: upload(device, queue, all),
            layers,
        }
    }

    /// The layer of lamp `k`.
    pub fn layer(&self, k: usize) -> u32 {
        self.layers.get(k).copied().unwrap_or(0)
    }
}

/// The texture in linear light, box-filtered and divided by its mean luminance.
fn screen(texture: &SceneTexture) -> Vec<Vec3> {
    let linear: [f32; 256] = std::array::from_fn(|code| linear_from_srgb(code as f32 / 255.0));
    let scale = 1.0 / luminance(mean_colour(texture)).max(1e-6);
    let texel = |x: u32, y: u32| {
        let at = 4 * (y * texture.width + x) as usize;
        Vec3::from([0, 1, 2].map(|c| linear[usize::from(texture.rgba[at + c])]))
    };
    let spans = |size: u32| (0..SIDE).map(move |k| span(k, size));
    let rows: Vec<Vec<Vec3>> = (0..texture.height)
        .map(|y| {
            let mean = |(from, to)| mean(from, to, |x| texel(x, y));
            spans(texture.width).map(mean).collect()
        })
        .collect();
    let column = |x: usize, (from, to)| mean(from, to, |y| rows[y as usize][x]) * scale;
    spans(texture.height)
        .flat_map(|s| (0..SIDE as usize).map(move |x| (x, s)))
        .map(|(x, s)| column(x, s))
        .collect()
}

/// The range of texel `k` of [`SIDE`] among `size` texels.
fn span(k: u32, size: u32) -> (f32, f32) {
    let share = size as f32 / SIDE as f32;
    (k as f32 * share, (k + 1) as f32 * share)
}

/// Mean of a row of texels between two positions.
fn mean(from: f32, to: f32, texel: impl Fn(u32) -> Vec3) -> Vec3 {
    let last = (to.ceil() as u32).max(1) - 1;
    let part = |i: u32| (to.min(i as f32 + 1.0) - from.max(i as f32)).max(0.0);
    let sum: Vec3 = (from as u32..=last).map(|i| texel(i) * part(i)).sum();
    sum / (to - from)
}

fn halved(level: &[Vec3], side: u32) -> Vec<Vec3> {
    let at = |x: u32, y: u32| level[(y * side + x) as usize];
    let four = |x: u32, y: u32| at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1);
    let half = side / 2;
    (0..half * half)
        .map(|i| four(i % half * 2, i / half * 2) / 4.0)
        .collect()
}

fn upload(device: &Device, queue: &wgpu::Queue, mut layers: Vec<Vec<Vec3>>) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("lamp screens"),
        size: wgpu::Extent3d {
            width: SIDE,
            height: SIDE,
            depth_or_array_layers: layers.len() as u32,
        },
        mip_level_count: SIDE.ilog2() + 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: format::LIGHT,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    for level in 0..=SIDE.ilog2() {
        let side = SIDE >> level;
        let texels: Vec<_> = layers
            .iter()
            .flatten()
            .map(|t| half_texel(t.to_array()))
            .collect();
        write_level(queue, &texture, level, side, layers.len() as u32, &texels);
        for layer in layers.iter_mut().filter(|_| side > 1) {
            *layer = halved(layer, side);
        }
    }
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn screen_keeps_its_colours_in_place_with_a_mean_luminance_of_one() {
        for (width, height) in [(3, 2), (64, 64), (200, 150), (1, 5)] {
            let texel = |i: u32| {
                let (x, y) = (i % width, i / width);
                [(x * 255 / width) as u8, (y * 255 / height) as u8, 40, 255]
            };
            let texture = SceneTexture {
                width,
                height,
                rgba: (0..width * height).flat_map(texel).collect(),
            };
            let mut level = screen(&texture);
            let (first, last) = (level[0], level[level.len() - 1]);
            assert!(first.x <= last.x && first.y < last.y, "{first} {last}");
            let mut side = SIDE;
            while side > 1 {
                level = halved(&level, side);
                side /= 2;
            }
            let wanted = mean_colour(&texture) / luminance(mean_colour(&texture));
            assert!(level[0].distance(wanted) < 1e-4, "{} {wanted}", level[0]);
        }
    }
}
