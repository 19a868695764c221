//! The shadow buffer, for real and for virtual surfaces.

use super::super::bindings::{CachedGroup, DepthTest, PipelineSpec, Slot, sampler, view};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, bind_all, cleared_depth, colour};
use super::super::shaders::{self, Variant};
use super::super::textures::{DRAWN, FrameTexture, format, tile_grid};
use super::phantom_geometry::{PhantomPictures, unshadowed_texel};
use super::shadow_map::DomeShadowMaps;
use super::tiles::TilePictures;
use super::virtual_geometry::VirtualPictures;
use wgpu::{ColorWrites, CompareFunction as Compare};

/// The pass, with the shadow maps of the dome lights.
pub struct ShadowBufferPass {
    by_maps: MarkedPasses,
    /// With light from the surface cache and that of lamps; in place of `by_maps` if the variant is
    /// cached.
    by_cache: Option<MarkedPasses>,
    /// Whether phantoms are drawn with their shadows, and there is nothing to look up.
    is_drawn: bool,
    maps: CachedGroup,
    surfaces: CachedGroup,
    compare: wgpu::Sampler,
}

/// The passes of both layers of the shadow buffer, for either source of shadows.
pub struct MarkedPasses {
    phantom: Marked,
    virtual_light: Marked,
}

/// A pipeline that marks texels, and one that computes the marked texels; or one that computes all
/// texels of some tiles.
struct Marked {
    mark: Option<wgpu::RenderPipeline>,
    work: wgpu::RenderPipeline,
}

/// Lost light of real surfaces and remaining light of virtual ones, one texel per pixel.
pub struct ShadowPictures {
    /// Factor on the real picture, or the light that is subtracted from it.
    pub phantom_shadow: FrameTexture,
    /// Remaining irradiance on virtual surfaces, packed.
    pub virtual_light: FrameTexture,
    /// Depth buffer of both layers: the texels that need work.
    marks: FrameTexture,
}

impl ShadowPictures {
    /// For pictures of `size` pixels.
    pub fn new(device: &Device, size: (u32, u32)) -> Self {
        let marks = wgpu::TextureUsages::RENDER_ATTACHMENT;
        Self {
            phantom_shadow: FrameTexture::new(device, "shadow", size, format::LIGHT, DRAWN),
            virtual_light: FrameTexture::new(device, "light", size, format::LIGHT_TEXEL, DRAWN),
            marks: FrameTexture::new(device, "marks", size, format::DEPTH, marks),
        }
    }
}

/// The shader that reads the surface cache.
const CACHED: &str = "cached_shadow";

/// Light that surfaces receive or lose.
#[derive(Clone, Copy)]
pub struct SurfaceLight<'a> {
    pub shadows: &'a ShadowPictures,
    /// Light that virtual lights add to the real picture, where it is not a part of `shadows`.
    pub lamp_light: &'a FrameTexture,
}

/// Where shadows are looked up.
pub enum ShadowSource<'a> {
    /// The shadow maps of the dome lights.
    Maps(&'a DomeShadowMaps),
    /// Sums of basis images on shadowing planes, and the passes that read them.
    Planes(&'a MarkedPasses, &'a wgpu::BindGroup),
}

/// The surfaces in the picture.
#[derive(Clone, Copy)]
pub struct Surfaces<'a> {
    pub phantoms: &'a PhantomPictures,
    pub virtual_surfaces: &'a VirtualPictures,
    pub tiles: &'a TilePictures,
    /// Tiles that virtual surfaces may cover.
    pub covered_tiles: &'a FrameTexture,
}

impl MarkedPasses {
    /// `shader` names the module; `groups` are the layouts of the frame, the shadows and the
    /// surfaces.
    fn new(
        device: &Device,
        shader: &str,
        groups: [&wgpu::BindGroupLayout; 3],
        variant: Variant,
    ) -> Self {
        let text = shaders::shader(shader, variant);
        let build = |vertex: &str, fragment: &str, target, colours, depth| {
            PipelineSpec {
                label: shader,
                shader: &text,
                groups: &groups,
                vertex,
                buffers: &[],
                fragment: Some(fragment),
                targets: &[target],
                colours,
                depth,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let marked = |mark: &str, work: &str, target| Marked {
            mark: Some(build(
                "cover",
                mark,
                target,
                ColorWrites::empty(),
                Some(DepthTest::writing(Compare::Always)),
            )),
            work: build(
                "behind_marks",
                work,
                target,
                ColorWrites::ALL,
                Some(DepthTest::without_writing(Compare::Less)),
            ),
        };
        // A look-up in the cache costs less than to mark the texels that need one.
        let by_tiles = |work: &str, target| Marked {
            mark: None,
            work: build("shadowed_tile", work, target, ColorWrites::ALL, None),
        };
        Self {
            phantom: if shader == CACHED {
                by_tiles("phantom_shadow", format::LIGHT)
            } else {
                marked("mark_phantoms", "phantom_shadow", format::LIGHT)
            },
            virtual_light: marked("mark_virtual", "virtual_light", format::LIGHT_TEXEL),
        }
    }

    /// `groups`: the frame, the shadows, the surfaces. Real surfaces without shadow get
    /// `unshadowed`.
    fn record(
        &self,
        r: &mut Recorder<'_>,
        groups: [&wgpu::BindGroup; 3],
        unshadowed: f64,
        output: &ShadowPictures,
    ) {
        let lit = unshadowed_texel(unshadowed);
        let none = wgpu::Color::TRANSPARENT;
        let (shadow, light) = (&output.phantom_shadow, &output.virtual_light);
        let jobs = [
            ("phantom_shadow", shadow, lit, &self.phantom),
            ("virtual_light", light, none, &self.virtual_light),
        ];
        for (name, picture, clear, pipelines) in jobs {
            let marks = pipelines.mark.as_ref().map(|_| &output.marks.view);
            let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(name),
                color_attachments: &[colour(&picture.view, wgpu::LoadOp::Clear(clear))],
                depth_stencil_attachment: marks.and_then(|marks| cleared_depth(marks, 0.0)),
                timestamp_writes: r.timer.span(name, true, true),
                ..Default::default()
            });
            bind_all(&mut pass, &groups);
            if let Some(mark) = &pipelines.mark {
                pass.set_pipeline(mark);
                pass.draw(0..3, 0..1);
                pass.set_pipeline(&pipelines.work);
                pass.draw(0..3, 0..1);
            } else {
                let (across, down) = tile_grid(picture.size());
                pass.set_pipeline(&pipelines.work);
                pass.draw(0..6 * across * down, 0..1);
            }
        }
    }
}

impl ShadowBufferPass {
    pub fn new(device: &Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let slots = [Slot::DepthArray, Slot::DepthArray, Slot::Comparison];
        let maps = CachedGroup::from_slots(device, "shadow maps", &slots);
        let surfaces = surfaces_group(device, variant);
        let compare = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow compare"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::LessEqual),
            ..Default::default()
        });
        let groups = [frame, &maps.layout, &surfaces.layout];
        Self {
            by_maps: MarkedPasses::new(device, "shadow_buffer", groups, variant),
            is_drawn: variant.shadows_phantoms(),
            by_cache: (variant.cached && variant.lamps)
                .then(|| MarkedPasses::new(device, CACHED, groups, variant)),
            maps,
            surfaces,
            compare,
        }
    }

    /// Compiles the same with shadowing planes in place of shadow maps; `sums` is the layout of
    /// what they bind.
    pub fn by_planes(
        device: &Device,
        frame: &wgpu::BindGroupLayout,
        sums: &wgpu::BindGroupLayout,
        variant: Variant,
    ) -> MarkedPasses {
        let surfaces = surfaces_group(device, variant);
        let groups = [frame, sums, &surfaces.layout];
        MarkedPasses::new(device, "planes_shadow", groups, variant)
    }

    /// Draws both layers into `output`. Real surfaces without shadow get `unshadowed`.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        source: &ShadowSource<'_>,
        surfaces: Surfaces<'_>,
        unshadowed: f64,
        output: &'a ShadowPictures,
    ) -> &'a ShadowPictures {
        if self.is_drawn {
            return output;
        }
        let (phantoms, virtual_surfaces) = (surfaces.phantoms, surfaces.virtual_surfaces);
        let tiles = surfaces.tiles;
        let resources = [
            view(&phantoms.normal.view),
            view(&phantoms.depth.view),
            view(&virtual_surfaces.surface[0].view),
            view(&virtual_surfaces.depth.view),
            view(&tiles.phantom.lights.view),
            view(&tiles.virtual_surface.lights.view),
            view(&surfaces.covered_tiles.view),
            view(&tiles.phantom.lamps.view),
            view(&tiles.virtual_surface.lamps.view),
        ];
        let place = phantoms.place.as_ref().map(|place| view(&place.view));
        let resources: Vec<_> = resources.into_iter().chain(place).collect();
        let bound = self.surfaces.get(r.device, &resources);
        let (passes, shadows) = match source {
            ShadowSource::Planes(passes, sums) => (*passes, *sums),
            ShadowSource::Maps(maps) => {
                let resources = [
                    view(&maps.virtual_casters.array),
                    view(&maps.phantom_casters.array),
                    sampler(&self.compare),
                ];
                let passes = self.by_cache.as_ref().unwrap_or(&self.by_maps);
                (passes, self.maps.get(r.device, &resources))
            }
        };
        passes.record(r, [frame, shadows, bound], unshadowed, output);
        output
    }
}

/// The group of the surfaces in the picture.
fn surfaces_group(device: &Device, variant: Variant) -> CachedGroup {
    let (packed, depth) = Slot::sampled(variant.samples);
    let masks = [Slot::Integer; 5];
    let cached: &[Slot] = if variant.cached {
        &[Slot::Integer]
    } else {
        &[]
    };
    let slots = [
        &[Slot::Unfilterable, Slot::Depth, packed, depth][..],
        &masks,
        cached,
    ]
    .concat();
    CachedGroup::from_slots(device, "surfaces", &slots)
}
