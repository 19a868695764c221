//! Puts the picture together.

use super::super::bindings::{PipelineSpec, Slot, group, layout, sampler, view};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::tiles;

/// The pass.
pub struct CompositePass {
    real: wgpu::RenderPipeline,
    virtual_surfaces: wgpu::RenderPipeline,
    picture_layout: wgpu::BindGroupLayout,
    surfaces_layout: wgpu::BindGroupLayout,
    light_layout: wgpu::BindGroupLayout,
    smooth: wgpu::Sampler,
}

/// What it binds.
pub struct CompositeInputs {
    picture: wgpu::BindGroup,
    surfaces: wgpu::BindGroup,
    light: wgpu::BindGroup,
}

impl CompositePass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let module = shaders::module(device, "composite", variant);
        let (u, i) = (Slot::Unfilterable, Slot::Integer);
        let (colour, depth) = Slot::sampled(variant.samples);
        let picture_layout = layout(
            device,
            "composite picture",
            &[u, Slot::Uniform, u, i, u, i, i],
        );
        let surfaces_layout = layout(
            device,
            "composite surfaces",
            &[colour, colour, colour, colour, depth],
        );
        let light_layout = layout(
            device,
            "composite light",
            &[Slot::Sampler, Slot::Cube, Slot::Texture, Slot::Texture],
        );
        let build = |vertex: &str, fragment: &str| {
            PipelineSpec {
                label: "composite",
                module: &module,
                groups: &[frame, &picture_layout, &surfaces_layout, &light_layout],
                vertex,
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::OUTPUT],
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let real = build("real_tile", "real");
        let virtual_surfaces = build("virtual_tile", "composite");
        let smooth = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("smooth"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self {
            real,
            virtual_surfaces,
            picture_layout,
            surfaces_layout,
            light_layout,
            smooth,
        }
    }

    /// Binds the targets, the prefiltered radiance map and the table of specular scales.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        targets: &Targets,
        radiance: &wgpu::TextureView,
        specular_table: &wgpu::TextureView,
    ) -> CompositeInputs {
        let t = targets;
        let picture = [
            view(&t.camera.view),
            t.codes.as_entire_binding(),
            view(&t.shadow.view),
            view(&t.light.view),
            view(&t.phantom_normal.view),
            view(&t.tiles[0].view),
            view(&t.covered.view),
        ];
        let s = &t.virtual_surface;
        let surfaces = [&s[0], &s[1], &s[2], &s[3], &t.virtual_depth].map(|t| view(&t.view));
        let light = [
            sampler(&self.smooth),
            view(radiance),
            view(&t.surroundings.view),
            view(specular_table),
        ];
        CompositeInputs {
            picture: group(device, "composite picture", &self.picture_layout, &picture),
            surfaces: group(
                device,
                "composite surfaces",
                &self.surfaces_layout,
                &surfaces,
            ),
            light: group(device, "composite light", &self.light_layout, &light),
        }
    }

    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        inputs: &CompositeInputs,
        targets: &Targets,
    ) {
        let groups = [frame, &inputs.picture, &inputs.surfaces, &inputs.light];
        // Where nothing virtual is, the picture is the camera's, bit for bit.
        encoder.copy_texture_to_texture(
            targets.camera.texture.as_image_copy(),
            targets.output.texture.as_image_copy(),
            targets.output.texture.size(),
        );
        let writes = timer.span("composite", true, true);
        let (view, count) = (&targets.output.view, targets.tile_count());
        tiles(
            encoder,
            "composite",
            view,
            None,
            writes,
            &[&self.real, &self.virtual_surfaces],
            &groups,
            count,
        );
    }
}
