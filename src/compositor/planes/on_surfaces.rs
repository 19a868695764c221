//! The light of shadowing planes in the surface cache: for drivers that run on the processor, where
//! the planes of every pixel are too many look-ups.

use super::super::bindings::{PipelineSpec, Slot, group, layout, view};
use super::super::gpu::Gpu;
use super::super::recorder::{Recorder, bind_all, colour};
use super::super::shaders::{self, Variant};
use super::super::surface_light::{AtlasPages, CacheAtlas, ROW, atlas_size};
use super::super::textures::{DRAWN, FrameTexture, format};
use super::choice::{Planes, Served, choose};
use bytemuck::Pod;
use glam::{DMat4, DVec3, Vec3};
use half::f16;
use penumbra_surface_cache::{BORDERED, Bounds, Layer, ReceiverPage};
use std::sync::Arc;

/// The compiled passes, which do not depend on a bake or a scene. Each has a pipeline for real and
/// one for virtual surfaces.
pub(super) struct SurfacePasses {
    indirect: [wgpu::RenderPipeline; 2],
    light: [wgpu::RenderPipeline; 2],
    /// Layouts of the texels with and without their indirect light.
    layouts: [wgpu::BindGroupLayout; 2],
}

impl SurfacePasses {
    /// `groups`: the layouts of the frame and of the sums.
    pub fn new(
        device: &wgpu::Device,
        groups: [&wgpu::BindGroupLayout; 2],
        variant: Variant,
    ) -> Self {
        let module = shaders::module(device, "planes_surface", variant);
        let layouts = [8, 4].map(|count| {
            let slots = [Slot::Unfilterable; 8];
            layout(device, "served texels", &slots[..count])
        });
        let page = wgpu::VertexBufferLayout {
            array_stride: 8,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &wgpu::vertex_attr_array![0 => Uint32x2],
        };
        let pipeline = |fragment: &str, texels| {
            PipelineSpec {
                label: "planes on surfaces",
                module: &module,
                groups: &[groups[0], groups[1], texels],
                vertex: "page_run",
                buffers: std::slice::from_ref(&page),
                fragment: Some(fragment),
                targets: &[format::LIGHT; 2],
                colours: wgpu::ColorWrites::ALL,
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        Self {
            light: ["light_on_real", "light_on_virtual"].map(|f| pipeline(f, &layouts[0])),
            indirect: ["indirect_on_real", "indirect_on_virtual"].map(|f| pipeline(f, &layouts[1])),
            layouts,
        }
    }
}

/// The texels of a scene's surface cache on the device, with the planes that serve them.
pub(super) struct ServedSurfaces {
    /// Identifies the scene.
    pages: Arc<AtlasPages>,
    /// Bounds of the pages of real surfaces that some plane serves.
    bounds: Vec<Bounds>,
    /// Pages by number, those of real surfaces first.
    order: Vec<PageState>,
    textures: TexelTextures,
    light: PageList,
    indirect: PageList,
}

/// The viewer of a frame: clip space from the world, and the eye.
pub(super) type Viewer = (DMat4, DVec3);

/// A page, and how far its light is up to date.
struct PageState {
    number: u32,
    is_real: bool,
    cone: Cone,
    is_stale: bool,
    /// Generation of the indirect light on its texels, 0 for none.
    indirect: u64,
}

impl ServedSurfaces {
    /// Chooses the planes of all texels. May run on any thread.
    pub fn new(
        gpu: &Gpu,
        passes: &SurfacePasses,
        planes: &Planes<'_>,
        pages: Arc<AtlasPages>,
    ) -> Self {
        let served = choose(planes, &pages.each);
        let is_served = |texels: &[Served]| texels.iter().flatten().any(|s| s[3] != f16::ZERO);
        let each = pages.each.iter().zip(&served);
        let bounds = each.filter(|(page, served)| is_real(page) && is_served(served));
        let state = |(page, number): (&ReceiverPage, u32)| PageState {
            number,
            is_real: is_real(page),
            cone: Cone::of(page),
            is_stale: true,
            indirect: 0,
        };
        let mut order: Vec<PageState> = pages.each.iter().zip(0..).map(state).collect();
        order.sort_by_key(|page| !page.is_real);
        Self {
            bounds: bounds.map(|(page, _)| page.bounds).collect(),
            order,
            textures: TexelTextures::new(gpu, passes, &pages, &served),
            light: PageList::new(&gpu.device, pages.each.len()),
            indirect: PageList::new(&gpu.device, pages.each.len()),
            pages,
        }
    }

    /// Whether these are the texels of `pages`.
    pub fn is_of(&self, pages: &Arc<AtlasPages>) -> bool {
        Arc::ptr_eq(&self.pages, pages)
    }

    /// Bounds of the pages of real surfaces that some plane serves.
    pub fn bounds(&self) -> &[Bounds] {
        &self.bounds
    }

    /// Has the light of every page written again before it is seen.
    pub fn expire(&mut self) {
        self.order.iter_mut().for_each(|page| page.is_stale = true);
    }

    /// Lists the pages that the viewer may see and whose light is out of date; `indirect` is the
    /// generation of the indirect light.
    pub fn prepare(&mut self, queue: &wgpu::Queue, viewer: &Viewer, indirect: u64) {
        self.light.clear();
        self.indirect.clear();
        for page in self.order.iter_mut().filter(|page| page.is_stale) {
            let place = &self.pages.each[page.number as usize];
            if !may_see(viewer, &place.bounds, &page.cone) {
                continue;
            }
            page.is_stale = false;
            self.light.push(page);
            if page.indirect != indirect {
                page.indirect = indirect;
                self.indirect.push(page);
            }
        }
        self.light.upload(queue);
        self.indirect.upload(queue);
    }

    /// Writes the light of the listed pages into `atlas`. `groups`: the frame, without the cache,
    /// and the sums.
    pub fn record(
        &self,
        r: &mut Recorder<'_>,
        passes: &SurfacePasses,
        [frame, sums]: [&wgpu::BindGroup; 2],
        atlas: &CacheAtlas,
    ) {
        let textures = &self.textures;
        let [first, second] = &textures.indirect;
        let jobs = [
            (
                "indirect_on_surfaces",
                &passes.indirect,
                &self.indirect,
                [&first.view, &second.view],
            ),
            (
                "planes_on_surfaces",
                &passes.light,
                &self.light,
                atlas.views.each_ref(),
            ),
        ];
        for ((name, pipelines, list, targets), texels) in jobs.into_iter().zip(&textures.groups) {
            if list.runs.is_empty() {
                continue;
            }
            // Only pages are ever read, and the others keep their light.
            let keep = wgpu::LoadOp::Load;
            let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(name),
                color_attachments: &targets.map(|target| colour(target, keep)),
                timestamp_writes: r.timer.span(name, true, true),
                ..Default::default()
            });
            bind_all(&mut pass, &[frame, sums, texels]);
            pass.set_vertex_buffer(0, list.buffer.slice(..));
            let last = list.runs.len() as u32;
            for (pipeline, runs) in pipelines.iter().zip([0..list.real, list.real..last]) {
                pass.set_pipeline(pipeline);
                pass.draw(0..6, runs);
            }
        }
    }
}

/// Pages to be written, in runs: number of the first page and how many follow in its row, itself
/// included. Software drivers draw squares of four pixels, of which a single page fills half.
struct PageList {
    runs: Vec<[u32; 2]>,
    /// Number of runs on real surfaces, which come first.
    real: u32,
    buffer: wgpu::Buffer,
}

impl PageList {
    fn new(device: &wgpu::Device, pages: usize) -> Self {
        Self {
            runs: Vec::with_capacity(pages),
            real: 0,
            buffer: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("pages"),
                size: 8 * pages.max(1) as u64,
                usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
        }
    }

    fn clear(&mut self) {
        self.runs.clear();
        self.real = 0;
    }

    fn push(&mut self, page: &PageState) {
        let is_first_virtual = !page.is_real && self.real as usize == self.runs.len();
        let begins_row = page.number.is_multiple_of(ROW as u32);
        match self.runs.last_mut() {
            Some([first, count])
                if *first + *count == page.number && !begins_row && !is_first_virtual =>
            {
                *count += 1;
            }
            _ => {
                self.runs.push([page.number, 1]);
                self.real += u32::from(page.is_real);
            }
        }
    }

    fn upload(&self, queue: &wgpu::Queue) {
        if !self.runs.is_empty() {
            queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&self.runs));
        }
    }
}

const fn is_real(page: &ReceiverPage) -> bool {
    matches!(page.layer, Layer::Phantom(_))
}

/// Normals of a page: all lie within the angle of the given sine and cosine about the axis.
struct Cone {
    axis: Vec3,
    sine: f32,
    cosine: f32,
}

impl Cone {
    fn of(page: &ReceiverPage) -> Self {
        let texels = page.texels.normals.iter().zip(&page.texels.is_used);
        let normals = || texels.clone().filter(|(_, used)| **used).map(|(n, _)| *n);
        let axis = normals().sum::<Vec3>().normalize_or_zero();
        let cosine = normals().map(|n| n.dot(axis)).fold(1.0, f32::min);
        Self {
            axis,
            sine: (1.0 - cosine * cosine).max(0.0).sqrt(),
            cosine,
        }
    }

    /// Whether some surface in `bounds` may face the eye.
    fn may_face(&self, bounds: &Bounds, eye: Vec3) -> bool {
        let radius = 0.5 * bounds.low.distance(bounds.high);
        let to_eye = eye - 0.5 * (bounds.low + bounds.high);
        let distance = to_eye.length();
        if self.cosine <= 0.0 || distance <= radius {
            return true;
        }
        // The most that a normal of the cone points towards the eye, seen from the centre.
        let along = self.axis.dot(to_eye);
        let aside = (distance * distance - along * along).max(0.0).sqrt();
        along * self.cosine + aside * self.sine > -radius
    }
}

/// Share of the picture by which a page may lie outside it: a rolling shutter displaces surfaces.
const OUTSIDE: f64 = 0.1;

/// Whether a page may be seen.
fn may_see((clip_from_world, eye): &Viewer, bounds: &Bounds, cone: &Cone) -> bool {
    let mut outside = [true; 5];
    for corner in bounds.corners() {
        let clip = *clip_from_world * corner.as_dvec3().extend(1.0);
        let limit = clip.w * (1.0 + 2.0 * OUTSIDE);
        let beyond = [
            clip.x < -limit,
            clip.x > limit,
            clip.y < -limit,
            clip.y > limit,
            clip.w <= 0.0,
        ];
        outside
            .iter_mut()
            .zip(beyond)
            .for_each(|(all, beyond)| *all &= beyond);
    }
    !outside.contains(&true) && cone.may_face(bounds, eye.as_vec3())
}

/// Points, normals, planes, indirect light and the light of compact sources of all texels.
struct TexelTextures {
    indirect: [FrameTexture; 2],
    /// What the passes of the indirect light and of the light read.
    groups: [wgpu::BindGroup; 2],
}

impl TexelTextures {
    fn new(gpu: &Gpu, passes: &SurfacePasses, pages: &AtlasPages, served: &[Vec<Served>]) -> Self {
        let (wide, light) = (wgpu::TextureFormat::Rgba32Float, format::LIGHT);
        let (each, count) = (&pages.each, pages.each.len());
        let plane = |which: usize| move |page: usize, k: usize| served[page][k][which];
        let textures = [
            texture(gpu, count, wide, |page, k| {
                each[page].texels.positions[k].extend(0.0).to_array()
            }),
            texture(gpu, count, light, |page, k| {
                let n = each[page].texels.normals[k].extend(0.0);
                n.to_array().map(f16::from_f32)
            }),
            texture(gpu, count, light, plane(0)),
            texture(gpu, count, light, plane(1)),
        ];
        let (width, height) = atlas_size(count);
        let size = (width as u32, height as u32);
        let indirect = [(); 2]
            .map(|()| FrameTexture::new(&gpu.device, "indirect on surfaces", size, light, DRAWN));
        let apart = pages.apart(&gpu.device);
        let all: Vec<_> = textures
            .iter()
            .chain(&indirect)
            .map(|t| view(&t.view))
            .chain(apart.views.iter().map(view))
            .collect();

        let group_of = |(layout, count): (&wgpu::BindGroupLayout, usize)| {
            group(&gpu.device, "served texels", layout, &all[..count])
        };
        let [with_indirect, without] = &passes.layouts;
        Self {
            groups: [(without, 4), (with_indirect, 8)].map(group_of),
            indirect,
        }
    }
}

/// Creates a texture in the arrangement of the atlas, of one `texel` for each of its texels.
fn texture<T: Pod>(
    gpu: &Gpu,
    pages: usize,
    format: wgpu::TextureFormat,
    texel: impl Fn(usize, usize) -> [T; 4],
) -> FrameTexture {
    let (width, height) = atlas_size(pages);
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let size = (width as u32, height as u32);
    let texture = FrameTexture::new(&gpu.device, "served texels", size, format, usage);
    let mut texels = vec![[T::zeroed(); 4]; width * height];
    for page in 0..pages {
        let first = (page / ROW) * BORDERED * width + (page % ROW) * BORDERED;
        for k in 0..BORDERED * BORDERED {
            texels[first + (k / BORDERED) * width + k % BORDERED] = texel(page, k);
        }
    }
    texture.upload(
        &gpu.queue,
        bytemuck::cast_slice(&texels),
        4 * size_of::<T>() as u32,
    );
    texture
}
