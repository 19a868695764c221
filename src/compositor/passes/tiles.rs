//! Classifies the tiles of the picture by the dome lights that may be blocked there, and by the
//! virtual lights that reach them.

use super::super::bindings::{CachedGroup, PipelineSpec, Slot, view};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, bind_all, cleared};
use super::super::shaders::{self, Variant};
use super::super::textures::{DRAWN, FrameTexture, format, tile_grid};
use super::phantom_geometry::PhantomPictures;
use super::virtual_geometry::VirtualPictures;

/// The pass.
pub struct TilesPass {
    real: wgpu::RenderPipeline,
    virtual_surfaces: wgpu::RenderPipeline,
    surfaces: CachedGroup,
}

/// One texel per tile: masks of the lights that affect it.
pub struct TileMasks {
    /// Dome lights that may be blocked.
    pub lights: FrameTexture,
    /// Virtual lights that reach the tile.
    pub lamps: FrameTexture,
}

/// The masks for real and for virtual surfaces.
pub struct TilePictures {
    pub phantom: TileMasks,
    pub virtual_surface: TileMasks,
}

impl TilePictures {
    /// For pictures of `size` pixels.
    pub fn new(device: &Device, size: (u32, u32)) -> Self {
        // Where light is read from the surface cache, tiles are found on the processor.
        let usage = DRAWN | wgpu::TextureUsages::COPY_DST;
        let picture =
            |label, format| FrameTexture::new(device, label, tile_grid(size), format, usage);
        let masks = |lights, lamps| TileMasks {
            lights: picture(lights, format::TILES),
            lamps: picture(lamps, format::LAMP_TILES),
        };
        Self {
            phantom: masks("phantom tiles", "phantom lamp tiles"),
            virtual_surface: masks("virtual tiles", "virtual lamp tiles"),
        }
    }
}

impl TilesPass {
    pub fn new(device: &Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let shader = shaders::shader("tiles", variant);
        let (packed, depth) = Slot::sampled(variant.samples);
        let slots = [Slot::Unfilterable, Slot::Depth, packed, depth];
        let surfaces = CachedGroup::from_slots(device, "tile surfaces", &slots);
        let build = |fragment: &str| {
            PipelineSpec {
                label: "tiles",
                shader: &shader,
                groups: &[frame, &surfaces.layout],
                vertex: "cover",
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::TILES, format::LAMP_TILES],
                colours: wgpu::ColorWrites::ALL,
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let (real, virtual_surfaces) = (build("classify_real"), build("classify_virtual"));
        Self {
            real,
            virtual_surfaces,
            surfaces,
        }
    }

    /// Classifies all tiles for real surfaces, and those in the rectangle `covered` (x, y, width,
    /// height, tiles) for virtual ones.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        (phantoms, virtual_surfaces): (&PhantomPictures, &VirtualPictures),
        covered: [u32; 4],
        output: &'a TilePictures,
    ) -> &'a TilePictures {
        let resources = [
            view(&phantoms.normal.view),
            view(&phantoms.depth.view),
            view(&virtual_surfaces.surface[0].view),
            view(&virtual_surfaces.depth.view),
        ];
        let groups = [frame, self.surfaces.get(r.device, &resources)];
        let (across, down) = output.phantom.lights.size();
        let jobs = [
            (&self.real, [0, 0, across, down], &output.phantom),
            (&self.virtual_surfaces, covered, &output.virtual_surface),
        ];
        for (k, (pipeline, [x, y, width, height], masks)) in jobs.into_iter().enumerate() {
            let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("tiles"),
                color_attachments: &[cleared(&masks.lights.view), cleared(&masks.lamps.view)],
                timestamp_writes: r.timer.span("tiles", k == 0, k == 1),
                ..Default::default()
            });
            pass.set_pipeline(pipeline);
            bind_all(&mut pass, &groups);
            if width > 0 {
                pass.set_scissor_rect(x, y, width, height);
                pass.draw(0..3, 0..1);
            }
        }
        output
    }
}
