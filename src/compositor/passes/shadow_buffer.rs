//! The shadow buffer, for the real and for the virtual surfaces.

use super::super::bindings::{DepthTest, PipelineSpec, Slot, group, layout, sampler, view};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::shadow_map::ShadowMaps;
use super::{cleared, cleared_depth};
use wgpu::{ColorWrites, CompareFunction as Compare};

/// The pass, with the dome's shadow maps.
pub struct ShadowBufferPass {
    by_maps: MarkedPasses,
    maps_layout: wgpu::BindGroupLayout,
    surfaces_layout: wgpu::BindGroupLayout,
    compare: wgpu::Sampler,
}

/// Both layers of the shadow buffer, whatever their shadows come from.
pub struct MarkedPasses {
    phantom: Marked,
    virtual_light: Marked,
}

/// What marks texels, and what works on the marked ones.
struct Marked {
    mark: wgpu::RenderPipeline,
    work: wgpu::RenderPipeline,
}

/// What it binds of the shadow maps and the targets.
pub struct ShadowBufferInputs {
    pub maps: wgpu::BindGroup,
    pub surfaces: wgpu::BindGroup,
}

impl MarkedPasses {
    /// `shader` names the module; `groups` are the frame's layout, that of the shadows, that of
    /// the surfaces.
    fn new(
        device: &wgpu::Device,
        shader: &str,
        groups: [&wgpu::BindGroupLayout; 3],
        variant: Variant,
    ) -> Self {
        let module = shaders::module(device, shader, variant);
        let build = |vertex: &str, fragment: &str, target, colours, depth| {
            PipelineSpec {
                label: shader,
                module: &module,
                groups: &groups,
                vertex,
                buffers: &[],
                fragment: Some(fragment),
                targets: &[target],
                colours,
                depth: Some(depth),
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let marked = |mark: &str, work: &str, target| Marked {
            mark: build(
                "cover",
                mark,
                target,
                ColorWrites::empty(),
                DepthTest::writing(Compare::Always),
            ),
            work: build(
                "behind_marks",
                work,
                target,
                ColorWrites::ALL,
                DepthTest::without_writing(Compare::Less),
            ),
        };
        Self {
            phantom: marked("mark_phantoms", "phantom_shadow", format::LIGHT),
            virtual_light: marked("mark_virtual", "virtual_light", format::LIGHT_TEXEL),
        }
    }

    /// `groups`: the frame, the shadows, the surfaces.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        groups: [&wgpu::BindGroup; 3],
        targets: &Targets,
        unshadowed: f64,
    ) {
        let lit = wgpu::Color {
            r: unshadowed,
            g: unshadowed,
            b: unshadowed,
            a: 0.0,
        };
        let nothing = wgpu::Color::TRANSPARENT;
        let jobs = [
            ("phantom_shadow", &targets.shadow, lit, &self.phantom),
            (
                "virtual_light",
                &targets.light,
                nothing,
                &self.virtual_light,
            ),
        ];
        for (name, target, clear, pipelines) in jobs {
            let mut colour = cleared(&target.view);
            if let Some(colour) = &mut colour {
                colour.ops.load = wgpu::LoadOp::Clear(clear);
            }
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(name),
                color_attachments: &[colour],
                depth_stencil_attachment: cleared_depth(&targets.marks.view, 0.0),
                timestamp_writes: timer.span(name, true, true),
                ..Default::default()
            });
            for (group, index) in groups.iter().zip(0..) {
                pass.set_bind_group(index, *group, &[]);
            }
            for pipeline in [&pipelines.mark, &pipelines.work] {
                pass.set_pipeline(pipeline);
                pass.draw(0..3, 0..1);
            }
        }
    }
}

impl ShadowBufferPass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let maps_layout = layout(
            device,
            "shadow maps",
            &[Slot::DepthArray, Slot::DepthArray, Slot::Comparison],
        );
        let (packed, depth) = Slot::sampled(variant.samples);
        let surfaces_layout = layout(
            device,
            "surfaces",
            &[
                Slot::Unfilterable,
                Slot::Depth,
                packed,
                depth,
                Slot::Integer,
                Slot::Integer,
                Slot::Integer,
                Slot::Integer,
                Slot::Integer,
            ],
        );
        let compare = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow compare"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::LessEqual),
            ..Default::default()
        });
        let groups = [frame, &maps_layout, &surfaces_layout];
        Self {
            by_maps: MarkedPasses::new(device, "shadow_buffer", groups, variant),
            maps_layout,
            surfaces_layout,
            compare,
        }
    }

    /// The same with shadowing planes in the place of shadow maps; `shown` is their layout.
    pub fn of_planes(
        &self,
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        shown: &wgpu::BindGroupLayout,
        variant: Variant,
    ) -> MarkedPasses {
        let groups = [frame, shown, &self.surfaces_layout];
        MarkedPasses::new(device, "planes_shadow", groups, variant)
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
                view(&targets.virtual_depth.view),
                view(&targets.tiles[0].view),
                view(&targets.tiles[1].view),
                view(&targets.covered.view),
                view(&targets.lamp_tiles[0].view),
                view(&targets.lamp_tiles[1].view),
            ],
        );
        ShadowBufferInputs { maps, surfaces }
    }

    /// The passes that look shadow maps up.
    pub const fn by_maps(&self) -> &MarkedPasses {
        &self.by_maps
    }
}
