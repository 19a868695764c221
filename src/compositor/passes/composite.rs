//! Composes the picture: the real picture with its shadows, and the shaded virtual surfaces.

use super::super::bindings::{CachedGroup, DepthTest, PipelineSpec, Slot, sampler, view};
use super::super::compiled::Device;
use super::super::gloss_maps::GlossMaps;
use super::super::recorder::{Recorder, bind_all, cleared_depth, colour};
use super::super::response_table::RealPicture;
use super::super::shaders::{self, Variant};
use super::super::textures::{FrameTexture, format, tile_grid};
use super::shadow_buffer::{SurfaceLight, Surfaces};
use super::surroundings::SurroundingsPictures;
use wgpu::CompareFunction as Compare;

/// Depth of a pixel without virtual surfaces; `NOTHING_VIRTUAL` in the shader.
const NOTHING_VIRTUAL: f32 = 0.5;

/// The bindings of what virtual surfaces reflect.
const LIGHT: [Slot; 7] = [
    Slot::Sampler,
    Slot::Cube,
    Slot::Texture,
    Slot::Texture,
    Slot::Cube,
    Slot::Uniform,
    Slot::Integer,
];

/// The pass.
pub struct CompositePass {
    /// For tiles without virtual surfaces, without and with edges; then, for tiles with some: the
    /// background without and with edges, pixels that one surface covers, pixels on outlines.
    pipelines: [wgpu::RenderPipeline; 6],
    picture: CachedGroup,
    surfaces: CachedGroup,
    light: CachedGroup,
    smooth: wgpu::Sampler,
    /// The output already holds the real picture, in another exposure.
    exposed: bool,
}

/// The pictures that the pass reads.
pub struct CompositeInputs<'a> {
    pub real: RealPicture<'a>,
    pub surfaces: Surfaces<'a>,
    pub light: SurfaceLight<'a>,
    /// Tiles in which edges of the real scene matter.
    pub edge_tiles: &'a FrameTexture,
    /// The real picture as virtual objects reflect it.
    pub surroundings: &'a SurroundingsPictures,
    /// The environment as virtual objects reflect it.
    pub gloss: &'a GlossMaps,
    /// What glossy surfaces mirror of their neighbourhood.
    pub nearby: &'a FrameTexture,
}

impl CompositePass {
    pub fn new(device: &Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let shader = shaders::shader("composite", variant);
        let (u, i) = (Slot::Unfilterable, Slot::Integer);
        let (packed, depth) = Slot::sampled(variant.samples);
        let slots = [u, Slot::Uniform, u, i, i, i, i, u, i];
        let picture = CachedGroup::from_slots(device, "composite picture", &slots);
        let slots = [packed, packed, depth, packed];
        let slots = &slots[..if variant.cached { 4 } else { 3 }];
        let surfaces = CachedGroup::from_slots(device, "composite surfaces", slots);
        let light = CachedGroup::from_slots(device, "composite light", &LIGHT);
        let build = |vertex: &str, fragment: &str, compare, write| {
            PipelineSpec {
                label: "composite",
                shader: &shader,
                groups: &[frame, &picture.layout, &surfaces.layout, &light.layout],
                vertex,
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::OUTPUT],
                colours: wgpu::ColorWrites::ALL,
                depth: Some(DepthTest { compare, write }),
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let pipelines = [
            build("real_tile", "real", Compare::Always, false),
            build("real_edge_tile", "real_by_edge", Compare::Always, false),
            build("background_tile", "background", Compare::Always, true),
            build(
                "background_edge_tile",
                "background_by_edge",
                Compare::Always,
                true,
            ),
            build("interior_tile", "interior", Compare::Less, false),
            build("outline_tile", "outline", Compare::Greater, false),
        ];
        let smooth = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("smooth"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self {
            pipelines,
            picture,
            surfaces,
            light,
            smooth,
            exposed: variant.exposed,
        }
    }

    /// Draws the composed picture into `output`; `kinds` is its depth buffer.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        inputs: &CompositeInputs<'_>,
        kinds: &FrameTexture,
        output: &'a FrameTexture,
    ) -> &'a FrameTexture {
        // Without virtual objects the picture is the camera's, bit for bit.
        if !self.exposed {
            r.encoder.copy_texture_to_texture(
                inputs.real.camera.texture.as_image_copy(),
                output.texture.as_image_copy(),
                output.texture.size(),
            );
        }
        let groups = self.groups(r.device, inputs);
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("composite"),
            color_attachments: &[colour(&output.view, wgpu::LoadOp::Load)],
            depth_stencil_attachment: cleared_depth(&kinds.view, NOTHING_VIRTUAL),
            timestamp_writes: r.timer.span("composite", true, true),
            ..Default::default()
        });
        let [picture, surfaces, light] = &groups;
        bind_all(&mut pass, &[frame, picture, surfaces, light]);
        let (across, down) = tile_grid(output.size());
        for pipeline in &self.pipelines {
            pass.set_pipeline(pipeline);
            pass.draw(0..6 * across * down, 0..1);
        }
        output
    }

    fn groups(&mut self, device: &Device, inputs: &CompositeInputs<'_>) -> [wgpu::BindGroup; 3] {
        let Surfaces {
            virtual_surfaces,
            tiles,
            covered_tiles,
            ..
        } = inputs.surfaces;
        let picture = [
            view(&inputs.real.shown().view),
            inputs.real.codes.binding(),
            view(&inputs.light.shadows.phantom_shadow.view),
            view(&inputs.light.shadows.virtual_light.view),
            view(&tiles.phantom.lights.view),
            view(&covered_tiles.view),
            view(&tiles.virtual_surface.lamps.view),
            view(&inputs.light.lamp_light.view),
            view(&inputs.edge_tiles.view),
        ];
        let [first, second] = &virtual_surfaces.surface;
        let surfaces = [first, second, &virtual_surfaces.depth].into_iter();
        let surfaces = surfaces.chain(virtual_surfaces.place.as_ref());
        let surfaces: Vec<_> = surfaces.map(|t| view(&t.view)).collect();
        let gloss = inputs.gloss;
        let light = [
            sampler(&self.smooth),
            view(&gloss.ggx.view),
            view(&inputs.surroundings.all.view),
            view(&gloss.table),
            view(&gloss.phong.view),
            gloss.compact_sources.as_entire_binding(),
            view(&inputs.nearby.view),
        ];
        [
            self.picture.get(device, &picture).clone(),
            self.surfaces.get(device, &surfaces).clone(),
            self.light.get(device, &light).clone(),
        ]
    }
}
