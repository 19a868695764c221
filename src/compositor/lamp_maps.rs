//! The lamps on the GPU: their uniforms and their perspective shadow maps.

use super::caster_hull::CasterHull;
use super::gpu_data::{LampUniform, LampsUniform};
use super::lamp_coverage::{Coverage, MAX_VIEWS_EACH, MapAxes, clip, eyes};
use super::lamp_layers::{Assigned, LampLayers, LampViews};
use super::lamp_screens::LampScreens;
use super::textures::format;
use crate::compiled::Device;
use glam::{Mat4, Vec3};
use penumbra_scene::PlacedLamp;
use penumbra_scene::lamps::MAX_LAMPS;

/// Maximum number of views of all lamps.
pub const MAX_VIEWS: usize = MAX_VIEWS_EACH * MAX_LAMPS;
/// Maximum number of layers at full size; more layers share the memory of this number, 192 MB at
/// 1024² texels.
const FULL_LAYERS: usize = 48;

/// A layer to draw: `across²` views, row by row, from index `view` on in the buffer of views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LampDraw {
    pub layer: u32,
    pub view: u32,
    pub across: u32,
}

/// The uniforms and shadow maps of lamps.
pub struct LampMaps {
    pub uniform: wgpu::Buffer,
    pub views: wgpu::Buffer,
    pub array: wgpu::TextureView,
    pub layers: Vec<wgpu::TextureView>,
    pub compare: wgpu::Sampler,
    /// The layers to draw in this frame.
    pub draws: Vec<LampDraw>,
    size: u32,
    assigned: LampLayers,
    /// Generation of casters, requested size and lamps for which the uniforms were made.
    known: (u64, u32, Vec<PlacedLamp>),
}

impl LampMaps {
    /// Creates maps for no lamps.
    pub fn new(device: &Device) -> Self {
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
            // With reversed depth, nearer is larger.
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        let (array, layers) = maps(device, 1, 1);
        Self {
            uniform: buffer(size_of::<LampsUniform>()),
            views: buffer(size_of::<Mat4>() * MAX_VIEWS),
            array,
            layers,
            compare,
            draws: Vec::new(),
            size: 1,
            assigned: LampLayers::default(),
            known: (0, 0, Vec::new()),
        }
    }

    /// Uploads the lamps of this frame, at most [`MAX_LAMPS`], and lists the maps that must be
    /// drawn. `casters` is the hull and its generation. Returns true if the texture of the maps was
    /// replaced and must be bound again.
    pub fn write(
        &mut self,
        device: &Device,
        queue: &wgpu::Queue,
        (lamps, screens): (&[PlacedLamp], &LampScreens),
        (hull, generation): (&CasterHull, u64),
        size: u32,
    ) -> bool {
        self.draws.clear();
        let lamps = &lamps[..lamps.len().min(MAX_LAMPS)];
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
        let coverages: Vec<_> = lamps.iter().map(|l| Coverage::for_lamp(l, hull)).collect();
        let renewed = self.fit(device, coverages.iter().map(Coverage::layers).sum(), size);
        self.place(queue, (lamps, screens), &coverages);
        renewed
    }

    /// Texels along a side of a layer.
    pub const fn size(&self) -> u32 {
        self.size
    }

    /// Marks the uniforms as out of date.
    pub fn forget_uniform(&mut self) {
        self.known.1 = 0;
    }

    /// Allocates the maps again if `needed` layers do not fit. The layers of removed lamps are
    /// kept.
    fn fit(&mut self, device: &Device, needed: usize, wanted: u32) -> bool {
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

    fn place(
        &mut self,
        queue: &wgpu::Queue,
        (lamps, screens): (&[PlacedLamp], &LampScreens),
        coverages: &[Coverage],
    ) {
        let areas = lamps.iter().filter(|lamp| lamp.area.is_some()).count();
        let pairs = || lamps.iter().zip(coverages);
        let across: Vec<_> = pairs().map(|(lamp, c)| c.across(lamp, areas)).collect();
        let sizes = across.iter().map(|n| self.size / n);
        let axes: Vec<_> = coverages
            .iter()
            .zip(sizes)
            .map(|(c, s)| c.axes(s))
            .collect();
        let views: Vec<_> = (0..lamps.len())
            .map(|k| {
                let eyes = || eyes(&lamps[k], across[k]);
                let clips = axes[k]
                    .iter()
                    .flat_map(|a| eyes().map(move |eye| clip(eye, a)));
                LampViews {
                    clips: clips.collect(),
                    layers: axes[k].len(),
                }
            })
            .collect();
        let assigned = self.assigned.assign(views.clone(), self.layers.len());
        let mut uniform = LampsUniform::default();
        uniform.count[0] = lamps.len() as u32;
        for (k, slot) in uniform.each.iter_mut().enumerate().take(lamps.len()) {
            *slot = lamp_uniform(
                &lamps[k],
                &axes[k],
                assigned[k].first,
                self.size / across[k],
            );
            if let Some(area) = lamps[k].area {
                slot.half_right[3] = screens.layer(area.screen) as f32;
                slot.intensity[3] = across[k] as f32;
                uniform.count[1] |= 1 << k;
            }
        }
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        self.list_draws(queue, &views, &assigned);
    }

    fn list_draws(&mut self, queue: &wgpu::Queue, views: &[LampViews], assigned: &[Assigned]) {
        let mut clips = Vec::new();
        for (views, place) in views.iter().zip(assigned).filter(|(_, place)| place.stale) {
            for layer in 0..views.layers {
                let each = views.clips.len() / views.layers;
                self.draws.push(LampDraw {
                    layer: (place.first + layer) as u32,
                    view: clips.len() as u32,
                    across: each.isqrt() as u32,
                });
                clips.extend_from_slice(&views.clips[layer * each..][..each]);
            }
        }
        if !clips.is_empty() {
            queue.write_buffer(&self.views, 0, bytemuck::cast_slice(&clips));
        }
    }
}

/// Texels a side of `layers` layers; `wanted` for a small number.
fn size_of_layers(layers: usize, wanted: u32) -> u32 {
    if layers <= FULL_LAYERS {
        return wanted;
    }
    let share = (FULL_LAYERS as f32 / layers as f32).sqrt();
    ((wanted as f32 * share) as u32 & !15).max(16)
}

fn lamp_uniform(lamp: &PlacedLamp, views: &[MapAxes], layer: usize, size: u32) -> LampUniform {
    let ([right, up, forward], tangent) = views.first().copied().unwrap_or_default();
    // A point light is a spot whose beam covers all angles.
    let (beam, cutoff) = lamp.cone.unwrap_or((10.0, 11.0));
    let with = |v: Vec3, w: f32| v.extend(w).to_array();
    LampUniform {
        position: with(lamp.position, views.len() as f32),
        direction: with(lamp.direction, cutoff),
        intensity: with(lamp.intensity, 1.0 / (cutoff - beam).max(1e-6)),
        right: with(right, layer as f32),
        up: with(up, tangent),
        forward: with(forward, 2.0 * tangent / size as f32),
        half_right: with(lamp.area.map_or(Vec3::ZERO, |a| a.half_right), 0.0),
        half_up: lamp.area.map_or([0.0; 4], |a| {
            with(a.half_up, f32::from(u8::from(a.two_sided)))
        }),
    }
}

fn maps(device: &Device, size: u32, layers: u32) -> (wgpu::TextureView, Vec<wgpu::TextureView>) {
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
    use super::*;

    #[test]
    fn many_layers_take_at_most_the_memory_of_eight_cubes() {
        let bytes =
            |layers: usize| layers as u64 * u64::from(size_of_layers(layers, 1024)).pow(2) * 4;
        for layers in 1..=6 * MAX_LAMPS {
            assert!(bytes(layers) <= 192 << 20, "{layers}");
        }
        assert_eq!(size_of_layers(48, 1024), 1024);
        assert_eq!(size_of_layers(192, 1024), 512);
    }
}
