//! The shadow buffer, for the real and for the virtual surfaces.

use super::super::bindings::{PipelineSpec, Slot, group, layout, sampler, view};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::shadow_map::ShadowMaps;
use super::tiles;

/// The pass.
pub struct ShadowBufferPass {
    phantom: wgpu::RenderPipeline,
    virtual_light: wgpu::RenderPipeline,
    maps_layout: wgpu::BindGroupLayout,
    surfaces_layout: wgpu::BindGroupLayout,
    compare: wgpu::Sampler,
}

/// What it binds of the shadow maps and the targets.
pub struct ShadowBufferInputs {
    maps: wgpu::BindGroup,
    surfaces: wgpu::BindGroup,
}

impl ShadowBufferPass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let module = shaders::module(device, "shadow_buffer", variant);
        let maps_layout = layout(
            device,
            "shadow maps",
            &[Slot::DepthArray, Slot::DepthArray, Slot::Comparison],
        );
        let (colour, depth) = Slot::sampled(variant.samples);
        let surfaces_layout = layout(
            device,
            "surfaces",
            &[
                Slot::Unfilterable,
                Slot::Depth,
                colour,
                colour,
                depth,
                Slot::Integer,
                Slot::Integer,
                Slot::Integer,
            ],
        );
        let build = |vertex: &str, fragment: &str, target: wgpu::TextureFormat| {
            PipelineSpec {
                label: "shadow_buffer",
                module: &module,
                groups: &[frame, &maps_layout, &surfaces_layout],
                vertex,
                buffers: &[],
                fragment: Some(fragment),
                targets: &[target],
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let compare = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow compare"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::LessEqual),
            ..Default::default()
        });
        Self {
            phantom: build("phantom_tile", "phantom_shadow", format::LIGHT),
            virtual_light: build("virtual_tile", "virtual_light", format::LIGHT_TEXEL),
            maps_layout,
            surfaces_layout,
            compare,
        }
    }

    /// Binds maps and targets.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        maps: (&ShadowMaps, &ShadowMaps),
        targets: &Targets,
    ) -> ShadowBufferInputs {
        let maps = group(
            device,
            "shadow maps",
            &self.maps_layout,
            &[
                view(&maps.0.array),
                view(&maps.1.array),
                sampler(&self.compare),
            ],
        );
        let surfaces = group(
            device,
            "surfaces",
            &self.surfaces_layout,
            &[
                view(&targets.phantom_normal.view),
                view(&targets.phantom_depth.view),
                view(&targets.virtual_surface[0].view),
                view(&targets.virtual_surface[2].view),
                view(&targets.virtual_depth.view),
                view(&targets.tiles[0].view),
                view(&targets.tiles[1].view),
                view(&targets.covered.view),
            ],
        );
        ShadowBufferInputs { maps, surfaces }
    }

    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        inputs: &ShadowBufferInputs,
        targets: &Targets,
        unshadowed: f64,
    ) {
        let groups = [frame, &inputs.maps, &inputs.surfaces];
        let count = targets.tile_count();
        let lit = wgpu::Color {
            r: unshadowed,
            g: unshadowed,
            b: unshadowed,
            a: 1.0,
        };
        let jobs = [
            ("phantom_shadow", &targets.shadow, lit, &self.phantom),
            (
                "virtual_light",
                &targets.light,
                wgpu::Color::TRANSPARENT,
                &self.virtual_light,
            ),
        ];
        for (name, target, clear, pipeline) in jobs {
            let writes = timer.span(name, true, true);
            tiles(
                encoder,
                name,
                &target.view,
                Some(clear),
                writes,
                &[pipeline],
                &groups,
                count,
            );
        }
    }
}
