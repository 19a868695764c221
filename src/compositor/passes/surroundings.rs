//! The shadowed real picture in linear light with its mip levels, which virtual objects reflect.

use super::super::bindings::{CachedGroup, PipelineSpec, Slot, group, layout, view};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, cover};
use super::super::response_table::RealPicture;
use super::super::shaders::{self, Variant};
use super::super::textures::{FrameTexture, coarse_size, format};
use super::phantom_geometry::PhantomPictures;
use super::shadow_buffer::SurfaceLight;

/// The pass.
pub struct SurroundingsPass {
    gather: wgpu::RenderPipeline,
    halve: wgpu::RenderPipeline,
    picture: CachedGroup,
    finer_layout: wgpu::BindGroupLayout,
    /// Bind groups of the finer level for each level, and the first level for which they were made.
    finer: Option<(wgpu::TextureView, Vec<wgpu::BindGroup>)>,
}

/// The levels, of which the first has half the size of the picture.
pub struct SurroundingsPictures {
    pub all: FrameTexture,
    levels: Vec<wgpu::TextureView>,
}

impl SurroundingsPictures {
    /// For pictures of `size` pixels.
    pub fn new(device: &Device, size: (u32, u32)) -> Self {
        let half = coarse_size(size, 2);
        let count = (half.0.max(half.1)).ilog2().clamp(1, 7);
        let all = FrameTexture::with_levels(device, "surroundings", half, format::LIGHT, count);
        let level = |base_mip_level| {
            all.texture.create_view(&wgpu::TextureViewDescriptor {
                base_mip_level,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        let levels = (0..count).map(level).collect();
        Self { all, levels }
    }

    /// The number of the coarsest level; 0 = the finest.
    pub fn highest_level(&self) -> u32 {
        self.levels.len() as u32 - 1
    }
}

impl SurroundingsPass {
    pub fn new(device: &Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let shader = shaders::shader("surroundings", variant);
        let u = Slot::Unfilterable;
        let slots = [u, Slot::Uniform, u, u, Slot::Depth];
        let picture = CachedGroup::from_slots(device, "surroundings picture", &slots);
        let finer_layout = layout(device, "surroundings level", &[u]);
        let build = |fragment: &str| {
            PipelineSpec {
                label: "surroundings",
                shader: &shader,
                groups: &[frame, &picture.layout, &finer_layout],
                vertex: "cover",
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::LIGHT],
                colours: wgpu::ColorWrites::ALL,
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let (gather, halve) = (build("gather"), build("halve"));
        Self {
            gather,
            halve,
            picture,
            finer_layout,
            finer: None,
        }
    }

    /// Gathers the real picture with its shadows and the light of virtual lights, and halves it
    /// level by level.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        real: RealPicture<'_>,
        (light, phantoms): (SurfaceLight<'_>, &PhantomPictures),
        output: &'a SurroundingsPictures,
    ) -> &'a SurroundingsPictures {
        let shadow = &light.shadows.phantom_shadow.view;
        let resources = [
            view(&real.shown().view),
            real.codes.binding(),
            view(shadow),
            view(&light.lamp_light.view),
            view(&phantoms.depth.view),
        ];
        let picture = self.picture.get(r.device, &resources);
        let first = &output.levels[0];
        let kept = self.finer.take().filter(|(of, _)| of == first);
        let (_, finer) = self.finer.insert(kept.unwrap_or_else(|| {
            // The first level reads only the picture; its layout still requires a finer level: any
            // texture that is not being drawn.
            let finer = std::iter::once(shadow).chain(&output.levels);
            let bound = |v| {
                group(
                    r.device,
                    "surroundings level",
                    &self.finer_layout,
                    &[view(v)],
                )
            };
            (first.clone(), finer.map(bound).collect())
        }));
        let last = output.levels.len() - 1;
        for (level, target) in output.levels.iter().enumerate() {
            let pipeline = if level == 0 {
                &self.gather
            } else {
                &self.halve
            };
            let span = r.timer.span("surroundings", level == 0, level == last);
            let groups = [frame, picture, &finer[level]];
            cover(r.encoder, "surroundings", target, span, pipeline, &groups);
        }
        output
    }
}
