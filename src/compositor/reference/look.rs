//! The camera's look on a composed picture, computed on the CPU.

use super::super::cover::{Corners, Cover, corners};
use super::super::frame_input::FrameInput;
use super::super::frame_view::clip_from_camera;
use super::super::look::{
    BlurField, BlurredBox, MAX_TAPS, filtered_class, grain, reach, samples, without_sharpening,
};
use super::super::textures::{TILE, tile_grid};
use glam::{DVec2, DVec3, DVec4};
use penumbra_camera::{CameraNoise, PointSpread, Response};
use penumbra_picture::Picture;
use penumbra_scene::Scene;

/// Light that is added before the change of the real picture is expressed as a ratio: `DARK` of the
/// shaders.
const DARK: f64 = 1.0 / 64.0;

/// The virtual surfaces, and the change of the real picture with its weight, premultiplied.
#[derive(Clone, Copy, Default)]
struct Layers {
    surface: DVec4,
    change: DVec4,
}

/// A composed picture, the camera's, and how much of each pixel virtual surfaces cover.
struct Composed<'a> {
    picture: &'a Picture,
    real: &'a Picture,
    coverage: &'a [f64],
    response: &'a Response,
}

/// Returns the picture that `composed`, made from `input` without a look, shows with the look of
/// `input`: for scenes at rest, a lens without distortion and the camera's own exposure. `coverage`
/// is the share of each pixel that virtual surfaces cover; in the picture returned every pixel is
/// computed.
#[must_use]
pub fn looked(
    composed: &Picture,
    coverage: &[f64],
    input: &FrameInput<'_>,
    (scene, response): (&Scene, &Response),
) -> Picture {
    let all = Composed {
        picture: composed,
        real: input.picture,
        coverage,
        response,
    };
    let size = (composed.width as i64, composed.height as i64);
    let pixels = || (0..size.1).flat_map(move |y| (0..size.0).map(move |x| (x, y)));
    let mut layers: Vec<Layers> = pixels().map(|p| all.layers(p)).collect();
    let extent = blur(&mut layers, size, input, scene);
    let spread = input.look.spread.unwrap_or(PointSpread::NONE);
    layers = filtered(&layers, size, (1, 0), spread.across);
    layers = filtered(&layers, size, (0, 1), spread.down);
    let filtered = filtered_pixels(size, input, (scene, extent));
    let noise = input.look.noise.map(|n| (n, grain::tile(&n.texture)));
    let offset = grain::offset(input.look.picture);
    let mut picture = composed.clone();
    for ((x, y), layers) in pixels().zip(layers) {
        let at = |i: usize| (([x, y][i] as u32 + offset[i]) as usize) % grain::SIDE;
        let noise = noise
            .as_ref()
            .map(|(n, tile)| (n, tile[at(1) * grain::SIDE + at(0)]));
        let i = 4 * (y * size.0 + x) as usize;
        // Shadows away from virtual objects are not filtered.
        let layers = if filtered[i / 4] {
            layers
        } else {
            all.layers((x, y))
        };
        if let Some(rgb) = all.finished((x, y), layers, noise) {
            picture.rgba[i..i + 3].copy_from_slice(&rgb);
        }
    }
    picture
}

impl Composed<'_> {
    fn index(&self, (x, y): (i64, i64)) -> usize {
        let x = x.clamp(0, i64::from(self.picture.width) - 1);
        let y = y.clamp(0, i64::from(self.picture.height) - 1);
        (y * i64::from(self.picture.width) + x) as usize
    }

    fn linear(&self, picture: &Picture, i: usize) -> DVec3 {
        let codes = [0, 1, 2].map(|c| picture.rgba[4 * i + c]);
        DVec3::from(self.response.linear_from_rgb(codes).map(f64::from))
    }

    /// Ratio of the composed to the real picture, and the pixel's weight.
    fn change(&self, i: usize) -> (DVec3, f64) {
        let real = self.linear(self.real, i);
        let same = (0..3).all(|c| self.picture.rgba[4 * i + c] == self.real.rgba[4 * i + c]);
        let ratio = (self.linear(self.picture, i) + DARK) / (real + DARK);
        let weight = real.element_sum() / 3.0 + DARK;
        (if same { DVec3::ONE } else { ratio }, weight)
    }

    /// Mean change of the neighbours without virtual surfaces; `None` if there are none.
    fn change_beside(&self, (x, y): (i64, i64)) -> Option<DVec3> {
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
        let open = around
            .map(|p| self.index(p))
            .filter(|i| self.coverage[*i] == 0.0);
        let (sum, weight) = open.fold((DVec3::ZERO, 0.0), |(sum, weight), i| {
            let (ratio, w) = self.change(i);
            (sum + ratio * w, weight + w)
        });
        (weight > 0.0).then(|| sum / weight)
    }

    fn layers(&self, at: (i64, i64)) -> Layers {
        let i = self.index(at);
        let covered = self.coverage[i];
        let (own, weight) = self.change(i);
        if covered == 0.0 {
            let change = (own * weight).extend(weight);
            return Layers {
                change,
                ..Layers::default()
            };
        }
        let open = 1.0 - covered;
        let beside = self.change_beside(at);
        let ratio = beside.unwrap_or(DVec3::ONE);
        let weight = if beside.is_some() { open * weight } else { 0.0 };
        let behind = (self.linear(self.real, i) + DARK) * ratio - DARK;
        let behind = behind.max(DVec3::ZERO) * open;
        let surface = (self.linear(self.picture, i) - behind).max(DVec3::ZERO);
        Layers {
            surface: surface.extend(covered),
            change: (ratio * weight).extend(weight),
        }
    }

    /// Codes of a pixel; `None` where nothing virtual changes it. `noise`: the camera's, and that
    /// of the tile at this pixel.
    fn finished(
        &self,
        at: (i64, i64),
        layers: Layers,
        noise: Option<(&CameraNoise, [f64; 3])>,
    ) -> Option<[u8; 3]> {
        let Layers { surface, change } = layers;
        let ratio = if change.w > 1e-4 {
            change.truncate() / change.w
        } else {
            DVec3::ONE
        };
        let same = (ratio - DVec3::ONE).abs().max_element() < 1.0 / 2048.0;
        if same && surface.abs().max_element() < 1.0 / 4096.0 {
            return None;
        }
        let real = self.linear(self.real, self.index(at));
        let behind = ((real + DARK) * ratio - DARK).max(DVec3::ZERO);
        let open = 1.0 - surface.w;
        let mut linear = (surface.truncate() + behind * open).max(DVec3::ZERO);
        if let Some((noise, unit)) = noise {
            let variance = |v: DVec3| DVec3::from(noise.read) + DVec3::from(noise.shot) * v;
            let share = ratio * open;
            let missing = variance(linear) - share * share * variance(real);
            let sigma = missing.max(DVec3::ZERO).to_array().map(f64::sqrt);
            linear += DVec3::from(sigma) * DVec3::from(unit);
        }
        let code = |v: f64| self.response.code_from_linear(v.clamp(0.0, 1.0) as f32);
        Some(linear.to_array().map(code))
    }
}

/// Filters by five weights in the direction `step`.
fn filtered(
    layers: &[Layers],
    (width, height): (i64, i64),
    (dx, dy): (i64, i64),
    weights: [f64; 3],
) -> Vec<Layers> {
    let soft = without_sharpening(weights);
    let at =
        |x: i64, y: i64| layers[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize];
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels
        .map(|(x, y)| {
            let mut sum = Layers::default();
            for k in -2..=2_i64 {
                let there = at(x + k * dx, y + k * dy);
                let k = k.unsigned_abs() as usize;
                sum.surface += there.surface * weights[k];
                sum.change += there.change * soft[k];
            }
            sum
        })
        .collect()
}

/// Whether each pixel is filtered: all with a large blur, else those in tiles that virtual objects
/// may cover, and next to them.
fn filtered_pixels(
    (width, height): (i64, i64),
    input: &FrameInput<'_>,
    (scene, extent): (&Scene, f64),
) -> Vec<bool> {
    let size = (width as u32, height as u32);
    let mut cover = Cover::default();
    cover.set_boxes(boxes(scene).map(Some).collect());
    let to_camera = input.world_from_camera.map(|p| p.inverse().to_matrix());
    let clip = clip_from_camera(input.camera) * to_camera.unwrap_or_default();
    cover.update(clip, size, true, std::iter::empty(), std::iter::empty());
    let reach = reach(input.look.spread.is_some(), extent)[3] as i64;
    let across = tile_grid(size).0;
    let is_covered = |x: i64, y: i64| {
        let at = |v: i64, limit: i64| v.clamp(0, limit - 1) as u32 / TILE;
        let tile = at(y, height) * across + at(x, width);
        cover.tiles()[tile as usize] != 0
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let steps = [-reach, 0, reach];
    pixels
        .map(|(x, y)| {
            let mut near = steps.iter().flat_map(|v| steps.iter().map(move |u| (u, v)));
            filtered_class(extent) == 1 || near.any(|(u, v)| is_covered(x + u, y + v))
        })
        .collect()
}

/// Boxes around the virtual parts, world.
fn boxes(scene: &Scene) -> impl Iterator<Item = Corners> {
    scene.virtual_parts.iter().filter_map(|part| {
        let points = part.mesh.vertices.iter().map(|v| v.position.as_dvec3());
        corners(points, part.world_from_part)
    })
}

/// Blurs both layers by motion and defocus; returns the largest extent of a blur.
fn blur(layers: &mut Vec<Layers>, size: (i64, i64), input: &FrameInput<'_>, scene: &Scene) -> f64 {
    let boxes: Vec<BlurredBox> = boxes(scene)
        .map(|corners| BlurredBox {
            corners,
            moved: None,
        })
        .collect();
    let mut field = BlurField::default();
    let extent = field.update(input.camera, input, &boxes, scene.ground_height);
    if extent == 0.0 {
        return 0.0;
    }
    let taps = BlurField::taps(extent);
    let samples: [[f32; 4]; MAX_TAPS] = samples(taps);
    let pixels = (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y)));
    *layers = pixels
        .map(|(x, y)| {
            let centre = DVec2::new(x as f64, y as f64);
            let [dx, dy, radius] = field.at(centre);
            let shift = (jitter(centre + 0.5) - 0.5) / taps as f64;
            let mut sum = Layers::default();
            for [along, u, v, _] in &samples[..taps] {
                let motion = DVec2::new(dx, dy) * (f64::from(*along) + shift);
                let disc = DVec2::new(f64::from(*u), f64::from(*v)) * radius;
                let there = interpolated(layers, size, centre + motion + disc);
                sum.surface += there.surface / taps as f64;
                sum.change += there.change / taps as f64;
            }
            sum
        })
        .collect();
    extent
}

/// Interleaved gradient noise (Jimenez 2014).
fn jitter(at: DVec2) -> f64 {
    (52.982_918_9 * at.dot(DVec2::new(0.067_110_56, 0.005_837_15)).fract()).fract()
}

fn interpolated(layers: &[Layers], (width, height): (i64, i64), at: DVec2) -> Layers {
    let corner = at.floor();
    let part = at - corner;
    let mut sum = Layers::default();
    for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let x = (corner.x as i64 + i).clamp(0, width - 1);
        let y = (corner.y as i64 + j).clamp(0, height - 1);
        let share = |k: i64, p: f64| if k == 1 { p } else { 1.0 - p };
        let weight = share(i, part.x) * share(j, part.y);
        let there = layers[(y * width + x) as usize];
        sum.surface += there.surface * weight;
        sum.change += there.change * weight;
    }
    sum
}
