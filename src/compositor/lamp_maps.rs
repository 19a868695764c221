//! The lamps on the GPU: their uniforms, and shadow maps seen from them in perspective.
//!
//! A lamp outside the casters has one map that fits around them, or around a narrow spot's
//! cone. A lamp among the casters looks all round with the six faces of a cube.

use super::gpu_data::{LampUniform, LampsUniform};
use super::lamp_layers::{Assigned, LampLayers, LampViews};
use super::shadow_slots::CasterHull;
use super::targets::format;
use crate::scene::PlacedLamp;
use crate::scene::lamps::MOST_LAMPS;
use glam::{Mat4, Vec3, Vec4};

/// Layers that all lamps together may need.
pub const MOST_VIEWS: usize = 6 * MOST_LAMPS;
/// Layers at their full size; more of them share the memory of so many, 192 MB at 1024² texels.
const FULL_LAYERS: usize = 48;
/// Twin of WGSL `LAMP_NEAR`.
const NEAR: f32 = 1e-3;
/// A single map is not made wider than this half angle: its corners would be coarse.
const WIDEST: f32 = 0.9;

/// What a lamp sees through its maps.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Coverage {
    /// No casters.
    Nothing,
    /// A square pyramid around `forward`, `tangent` wide to each side.
    One { forward: Vec3, tangent: f32 },
    /// All round.
    Cube,
}

impl Coverage {
    fn of(lamp: &PlacedLamp, hull: &CasterHull) -> Self {
        let Some((forward, angle)) = hull.cone_from(lamp.position) else {
            return Self::Nothing;
        };
        let spot = lamp.cone.map(|(_, cutoff)| (lamp.direction, cutoff));
        let hull = Some((forward, angle + 0.01)).filter(|_| angle.is_finite());
        let narrowest = [hull, spot]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match narrowest {
            Some((forward, angle)) if angle < WIDEST => Self::One {
                forward,
                tangent: angle.tan(),
            },
            _ => Self::Cube,
        }
    }

    const fn views(&self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::One { .. } => 1,
            Self::Cube => 6,
        }
    }

    /// Right, up, forward and the tangent of the half width of each view. Texels on the
    /// edge of a cube's face show a little of what lies beyond it.
    fn axes(&self, size: u32) -> Vec<([Vec3; 3], f32)> {
        match *self {
            Self::Nothing => Vec::new(),
            Self::One { forward, tangent } => {
                let (right, up) = forward.any_orthonormal_pair();
                vec![([right, up, forward], tangent)]
            }
            Self::Cube => (0..6)
                .map(|face| {
                    let axis = |k: usize| Vec3::AXES[(face / 2 + k) % 3];
                    let forward = if face % 2 == 0 { axis(0) } else { -axis(0) };
                    ([axis(1), axis(2), forward], 1.0 + 4.0 / size as f32)
                })
                .collect(),
        }
    }
}

/// A layer to draw, and its view in the buffer of views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LampDraw {
    pub layer: u32,
    pub view: u32,
}

/// See the module.
pub struct LampMaps {
    pub uniform: wgpu::Buffer,
    pub views: wgpu::Buffer,
    pub array: wgpu::TextureView,
    pub layers: Vec<wgpu::TextureView>,
    pub compare: wgpu::Sampler,
    /// To draw in this frame.
    pub draws: Vec<LampDraw>,
    size: u32,
    assigned: LampLayers,
    /// Casters, wanted size and lamps that the uniforms tell of.
    known: (u64, u32, Vec<PlacedLamp>),
}

impl LampMaps {
    /// No lamps.
    pub fn new(device: &wgpu::Device) -> Self {
        let buffer = |size: usize| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("lamps"),
                size: size as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let compare = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("lamp compare"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            // Nearer is more.
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        let (array, layers) = maps(device, 1, 1);
        Self {
            uniform: buffer(size_of::<LampsUniform>()),
            views: buffer(size_of::<Mat4>() * MOST_VIEWS),
            array,
            layers,
            compare,
            draws: Vec::new(),
            size: 1,
            assigned: LampLayers::default(),
            known: (0, 0, Vec::new()),
        }
    }

    /// Uploads this frame's lamps, at most [`MOST_LAMPS`], and notes which maps must be
    /// drawn. `casters` is the hull and its generation. Returns true when the maps'
    /// texture is a new one and must be bound again.
    pub fn write(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        lamps: &[PlacedLamp],
        (hull, generation): (&CasterHull, u64),
        size: u32,
    ) -> bool {
        self.draws.clear();
        let lamps = &lamps[..lamps.len().min(MOST_LAMPS)];
        let (casters, asked, known) = &mut self.known;
        if lamps == known.as_slice()
            && (lamps.is_empty() || (*casters, *asked) == (generation, size))
        {
            return false;
        }
        if *casters != generation {
            self.assigned.forget();
        }
        (*casters, *asked) = (generation, size);
        known.clear();
        known.extend_from_slice(lamps);
        let coverages: Vec<_> = lamps.iter().map(|l| Coverage::of(l, hull)).collect();
        let renewed = self.fit(device, coverages.iter().map(Coverage::views).sum(), size);
        self.place(queue, lamps, &coverages);
        renewed
    }

    /// Makes the maps anew where `needed` layers do not fit. Lamps that go leave theirs behind.
    fn fit(&mut self, device: &wgpu::Device, needed: usize, wanted: u32) -> bool {
        let layers = needed.max(if self.size > 1 { self.layers.len() } else { 0 });
        let size = size_of_layers(layers, wanted);
        if needed == 0 || (layers == self.layers.len() && size == self.size) {
            return false;
        }
        self.size = size;
        (self.array, self.layers) = maps(device, size, layers as u32);
        self.assigned.forget();
        true
    }

    fn place(&mut self, queue: &wgpu::Queue, lamps: &[PlacedLamp], coverages: &[Coverage]) {
        let axes: Vec<_> = coverages.iter().map(|c| c.axes(self.size)).collect();
        let views = lamps.iter().zip(&axes).map(|(lamp, axes)| LampViews {
            clips: axes
                .iter()
                .map(|(axes, tangent)| clip(lamp.position, axes, *tangent))
                .collect(),
            layers: axes.len(),
        });
        let views: Vec<_> = views.collect();
        let assigned = self.assigned.assign(views.clone(), self.layers.len());
        let mut uniform = LampsUniform::default();
        uniform.count[0] = lamps.len() as u32;
        for (k, slot) in uniform.each.iter_mut().enumerate().take(lamps.len()) {
            *slot = lamp_uniform(&lamps[k], &axes[k], assigned[k].first, self.size);
        }
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        self.list_draws(queue, &views, &assigned);
    }

    fn list_draws(&mut self, queue: &wgpu::Queue, views: &[LampViews], assigned: &[Assigned]) {
        let mut clips = Vec::new();
        for (views, place) in views.iter().zip(assigned).filter(|(_, place)| place.stale) {
            for (layer, clip) in (place.first..).zip(&views.clips) {
                self.draws.push(LampDraw {
                    layer: layer as u32,
                    view: clips.len() as u32,
                });
                clips.push(*clip);
            }
        }
        if !clips.is_empty() {
            queue.write_buffer(&self.views, 0, bytemuck::cast_slice(&clips));
        }
    }
}

/// Texels a side of so many layers, where `wanted` is that of a few.
fn size_of_layers(layers: usize, wanted: u32) -> u32 {
    if layers <= FULL_LAYERS {
        return wanted;
    }
    let share = (FULL_LAYERS as f32 / layers as f32).sqrt();
    ((wanted as f32 * share) as u32 & !15).max(16)
}

fn lamp_uniform(
    lamp: &PlacedLamp,
    views: &[([Vec3; 3], f32)],
    layer: usize,
    size: u32,
) -> LampUniform {
    let ([right, up, forward], tangent) = views.first().copied().unwrap_or_default();
    // A point is a spot that has not begun to fade at any angle.
    let (beam, cutoff) = lamp.cone.unwrap_or((10.0, 11.0));
    let with = |v: Vec3, w: f32| v.extend(w).to_array();
    LampUniform {
        position: with(lamp.position, views.len() as f32),
        direction: with(lamp.direction, cutoff),
        intensity: with(lamp.intensity, 1.0 / (cutoff - beam).max(1e-6)),
        right: with(right, layer as f32),
        up: with(up, tangent),
        forward: with(forward, 2.0 * tangent / size as f32),
    }
}

/// Reversed depth with the far plane at infinity.
fn clip(eye: Vec3, [right, up, forward]: &[Vec3; 3], tangent: f32) -> Mat4 {
    let row = |axis: Vec3| axis.extend(-axis.dot(eye));
    Mat4::from_cols(
        row(*right / tangent),
        row(*up / tangent),
        Vec4::new(0.0, 0.0, 0.0, NEAR),
        row(*forward),
    )
    .transpose()
}

fn maps(
    device: &wgpu::Device,
    size: u32,
    layers: u32,
) -> (wgpu::TextureView, Vec<wgpu::TextureView>) {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("lamp maps"),
        size: wgpu::Extent3d {
            width: size,
            height: size,
            depth_or_array_layers: layers,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: format::DEPTH,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    let view = |dimension, base_array_layer, count| {
        texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(dimension),
            base_array_layer,
            array_layer_count: Some(count),
            ..Default::default()
        })
    };
    let single = |layer| view(wgpu::TextureViewDimension::D2, layer, 1);
    (
        view(wgpu::TextureViewDimension::D2Array, 0, layers),
        (0..layers).map(single).collect(),
    )
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    #[test]
    fn many_layers_take_no_more_memory_than_eight_cubes() {
        let bytes =
            |layers: usize| layers as u64 * u64::from(size_of_layers(layers, 1024)).pow(2) * 4;
        for layers in 1..=MOST_VIEWS {
            assert!(bytes(layers) <= 192 << 20, "{layers}");
        }
        assert_eq!(size_of_layers(48, 1024), 1024);
        assert_eq!(size_of_layers(192, 1024), 512);
    }
}
