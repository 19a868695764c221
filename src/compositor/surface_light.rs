//! The surface cache on the GPU: its table of pages and its atlas, kept up to date page by page.

use super::bindings::view;
use super::textures::format;
use crate::compiled::Device;
use glam::{DMat4, DVec2, Vec3};
use half::f16;
use penumbra_interface::threads;
use penumbra_lighting::{DomeLight, Harmonics};
use penumbra_scene::IndirectLight;
use penumbra_surface_cache::{
    BORDERED, Bounds, Layer, ReceiverPage, SurfaceCache, SurfaceLight, TABLE_WIDTH,
};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

/// Pages in a row of the atlas, a power of two; twin of `PAGES_LOG`.
pub const ROW: usize = 64;
/// Texels in a row of the atlas.
pub const WIDTH: usize = ROW * BORDERED;

/// The textures in which the light on all pages lies.
pub struct CacheAtlas([wgpu::Texture; 2]);

impl CacheAtlas {
    fn new(device: &Device, pages: usize) -> Self {
        let size = (WIDTH as u32, (pages.div_ceil(ROW).max(1) * BORDERED) as u32);
        let none = wgpu::TextureUsages::empty();
        Self([(); 2].map(|()| texture(device, size, format::LIGHT, none)))
    }

    /// Uploads `count` pages of `row` from the one in `column` on; `texels` of both textures are
    /// those of the whole row.
    pub fn upload(
        &self,
        queue: &wgpu::Queue,
        row: usize,
        (column, count): (usize, usize),
        texels: [&[[f16; 4]]; 2],
    ) {
        let place = [column, row, count].map(|pages| (pages * BORDERED) as u32);
        for (texture, texels) in self.0.iter().zip(texels) {
            let texels = &texels[column * BORDERED..];
            let bytes = bytemuck::cast_slice(texels);
            write(queue, texture, (place, BORDERED as u32), bytes, 8);
        }
    }
}

/// The textures that every pass binds.
pub struct CacheTextures {
    table: wgpu::TextureView,
    atlas: [wgpu::TextureView; 2],
}

impl CacheTextures {
    /// Placeholders without a cache.
    pub fn none(device: &Device) -> Self {
        let none = |format| {
            view_of(&texture(
                device,
                (1, 1),
                format,
                wgpu::TextureUsages::empty(),
            ))
        };
        let atlas = || none(format::LIGHT);
        Self {
            table: none(format::PAGE_TABLE),
            atlas: [atlas(), atlas()],
        }
    }

    /// What the frame's group binds.
    pub fn bindings(&self) -> [wgpu::BindingResource<'_>; 3] {
        [
            view(&self.table),
            view(&self.atlas[0]),
            view(&self.atlas[1]),
        ]
    }
}

/// A light that an update keeps while the frame path goes on.
#[derive(Clone, Default)]
pub struct KeptLight {
    generation: u64,
    irradiance: Harmonics,
    ground_radiance: Vec3,
    lights: Vec<DomeLight>,
    indirect: Option<IndirectLight>,
}

impl KeptLight {
    pub fn keep(&mut self, light: &SurfaceLight<'_>) {
        self.generation = light.generation;
        self.irradiance.clone_from(light.irradiance);
        self.ground_radiance = light.ground_radiance;
        self.lights.clear();
        self.lights.extend_from_slice(light.lights);
        let generation = |l: Option<&IndirectLight>| l.map(|l| l.generation);
        if generation(self.indirect.as_ref()) != generation(light.indirect) {
            self.indirect = light.indirect.cloned();
        }
    }

    pub fn light(&self) -> SurfaceLight<'_> {
        SurfaceLight {
            generation: self.generation,
            irradiance: &self.irradiance,
            ground_radiance: self.ground_radiance,
            lights: &self.lights,
            indirect: self.indirect.as_ref(),
        }
    }
}

/// The cache, and what it is to be brought up to date with.
struct Work {
    cache: SurfaceCache,
    light: KeptLight,
    renewed: Vec<usize>,
    /// Whether a row of pages has changed.
    changed: Vec<bool>,
}

impl Work {
    fn update(&mut self) {
        for page in self.cache.update(&self.light.light(), &self.renewed) {
            self.changed[*page as usize / ROW] = true;
        }
    }
}

/// A thread that brings the cache up to date; it ends with the ends of its channels.
struct Worker {
    to: SyncSender<Box<Work>>,
    back: Receiver<Box<Work>>,
}

impl Worker {
    fn start() -> Option<Self> {
        let (to, jobs) = sync_channel::<Box<Work>>(1);
        let (done, back) = sync_channel(1);
        let work = move || {
            while let Ok(mut work) = jobs.recv() {
                work.update();
                if done.send(work).is_err() {
                    return;
                }
            }
        };
        threads::spawn("surface-light", work).ok()?;
        Some(Self { to, back })
    }
}

/// A cache with its atlas.
pub struct CachedLight {
    /// `None` while the worker has it.
    work: Option<Box<Work>>,
    /// `None`: updates are made on the frame path.
    worker: Option<Worker>,
    /// Placements of moving parts that came while the worker had the cache.
    placed: Vec<(usize, DMat4)>,
    pages: Arc<[ReceiverPage]>,
    /// Virtual parts without pages.
    left_out: Vec<usize>,
    /// Bounds of the shadowed pages that are in the atlas.
    shadowed: Vec<Bounds>,
    atlas: CacheAtlas,
    /// Whether the atlas is left to shadowing planes.
    is_apart: bool,
    /// Whether all pages must be uploaded with the next update.
    is_overwritten: bool,
    /// Whether there is no light yet: the next update is made at once.
    is_empty: bool,
    /// How often [`Self::renew`] has changed any visibility.
    renewals: u64,
    /// The number of lights of its last call, if `shadowed` is theirs.
    renewed_lights: Option<usize>,
    /// One row of pages.
    staging: [Vec<[f16; 4]>; 2],
}

impl CachedLight {
    /// Allocates the atlas of `cache`. `in_background`: updates never keep a frame waiting.
    pub fn new(
        device: &Device,
        queue: &wgpu::Queue,
        cache: SurfaceCache,
        in_background: bool,
    ) -> (Self, CacheTextures) {
        let is_summed = cache.is_summed();
        let pages: Arc<[ReceiverPage]> = cache.receiver_pages().into();
        let left_out = cache.left_out().filter_map(|layer| match layer {
            Layer::Virtual(part) => Some(part),
            Layer::Phantom(_) => None,
        });
        let left_out = left_out.collect();
        let count = pages.len();
        let atlas = CacheAtlas::new(device, count);
        let cells = cache.table();
        let cell_rows = cells.len() as u32 / TABLE_WIDTH;
        let only_read = wgpu::TextureUsages::empty();
        let cells_across = (TABLE_WIDTH, cell_rows);
        let table = texture(device, cells_across, format::PAGE_TABLE, only_read);
        let place = ([0, 0, TABLE_WIDTH], cell_rows);
        write(queue, &table, place, bytemuck::cast_slice(&cells), 4);
        let textures = CacheTextures {
            table: view_of(&table),
            atlas: atlas.0.each_ref().map(view_of),
        };
        let work = Work {
            cache,
            light: KeptLight::default(),
            renewed: Vec::new(),
            changed: vec![false; count.div_ceil(ROW).max(1)],
        };
        let mut cached = Self {
            work: Some(Box::new(work)),
            worker: in_background.then(Worker::start).flatten(),
            placed: Vec::new(),
            shadowed: Vec::with_capacity(count),
            pages,
            left_out,
            atlas,
            is_apart: false,
            is_overwritten: true,
            is_empty: true,
            renewals: 0,
            renewed_lights: None,
            staging: [(); 2].map(|()| vec![[f16::ZERO; 4]; WIDTH * BORDERED]),
        };
        if is_summed {
            cached.upload(queue);
        }
        (cached, textures)
    }

    /// The pages by number, as they lay when the cache was made.
    pub const fn pages(&self) -> &Arc<[ReceiverPage]> {
        &self.pages
    }

    /// Virtual parts that keep no light.
    pub fn left_out(&self) -> &[usize] {
        &self.left_out
    }

    /// The atlas.
    pub const fn atlas(&self) -> &CacheAtlas {
        &self.atlas
    }

    /// The lights of [`Self::renew`], the cache with their visibility, and how often that has
    /// changed.
    pub fn apart(&self) -> Option<(&SurfaceCache, &[DomeLight], u64)> {
        let work = self.work.as_ref().filter(|_| self.is_apart)?;
        Some((&work.cache, &work.light.lights, self.renewals))
    }

    /// Has the visibility of the lights `renewed` among `lights` found again, for passes that sum
    /// and write their light themselves.
    pub fn renew(&mut self, lights: &[DomeLight], renewed: &[usize]) {
        let Some(work) = &mut self.work else {
            return;
        };
        work.light.lights.clear();
        work.light.lights.extend_from_slice(lights);
        if renewed.is_empty() && self.renewed_lights == Some(lights.len()) {
            return;
        }
        work.cache.renew(lights, renewed);
        self.renewals += 1;
        self.renewed_lights = Some(lights.len());
        let is_shadowed = |(page, number): &(&ReceiverPage, u32)| {
            let is_real = matches!(page.layer, Layer::Phantom(_));
            is_real && (0..lights.len()).any(|l| work.cache.seen(l, *number)[0].is_some())
        };
        let pages = self.pages.iter().zip(0..).filter(is_shadowed);
        self.shadowed.clear();
        self.shadowed.extend(pages.map(|(page, _)| page.bounds));
    }

    /// Keeps light out of the atlas from now on, because shadowing planes write it, or ends that.
    /// False while an update is under way: its light belongs to the other lights, and the atlas stays
    /// as it is.
    pub fn keep_apart(&mut self, apart: bool) -> bool {
        if self.is_apart == apart {
            return true;
        }
        if self.work.is_none() {
            self.work = self.worker.as_ref().and_then(|w| w.back.try_recv().ok());
        }
        if self.work.is_none() {
            return false;
        }
        self.is_apart = apart;
        self.is_overwritten = true;
        self.renewed_lights = None;
        true
    }

    /// Moves a moving virtual part to `world`.
    pub fn place(&mut self, part: usize, world: DMat4) {
        match (&mut self.work, self.placed.iter_mut().find(|p| p.0 == part)) {
            (Some(work), _) => work.cache.place(part, world),
            (None, Some(placed)) => placed.1 = world,
            (None, None) => self.placed.push((part, world)),
        }
    }

    /// Takes the result of the last update into the atlas; false while the update is under way.
    pub fn collect(&mut self, queue: &wgpu::Queue) -> bool {
        if self.work.is_none() {
            let back = self.worker.as_ref().map(|worker| worker.back.try_recv());
            let Some(Ok(work)) = back else { return false };
            self.work = Some(work);
            self.upload(queue);
        }
        if let Some(work) = &mut self.work {
            let placed = self.placed.drain(..);
            placed.for_each(|(part, world)| work.cache.place(part, world));
        }
        true
    }

    /// Waits for an update that is under way, and has the next one made at once.
    pub fn start_again(&mut self, queue: &wgpu::Queue) {
        self.wait();
        self.collect(queue);
        self.is_empty = true;
    }

    /// Waits for an update that is under way.
    fn wait(&mut self) {
        if self.work.is_none()
            && let Some(Ok(work)) = self.worker.as_ref().map(|worker| worker.back.recv())
        {
            self.work = Some(work);
        }
    }

    /// Has the visibility of the lights `renewed` found again and the atlas brought up to date with
    /// `light`: at once, or in the background until a later [`Self::collect`].
    pub fn update(&mut self, queue: &wgpu::Queue, light: &SurfaceLight<'_>, renewed: &[usize]) {
        let Some(mut work) = self.work.take() else {
            return;
        };
        let is_current = !self.is_overwritten && !work.cache.is_outdated(light);
        if renewed.is_empty() && is_current {
            self.work = Some(work);
            return;
        }
        work.light.keep(light);
        work.renewed.clear();
        work.renewed.extend_from_slice(renewed);
        let left = match &self.worker {
            Some(worker) if !self.is_empty => match worker.to.try_send(work) {
                Ok(()) => return,
                Err(TrySendError::Full(work) | TrySendError::Disconnected(work)) => work,
            },
            _ => work,
        };
        let mut work = left;
        work.update();
        self.work = Some(work);
        self.upload(queue);
    }

    /// Uploads the rows of pages that have changed.
    fn upload(&mut self, queue: &wgpu::Queue) {
        let Some(mut work) = self.work.take() else {
            return;
        };
        self.is_empty = false;
        if std::mem::take(&mut self.is_overwritten) {
            work.changed.fill(true);
        }
        for row in 0..work.changed.len() {
            if std::mem::take(&mut work.changed[row]) {
                self.upload_row(queue, &work.cache, row);
            }
        }
        self.shadowed.clear();
        self.shadowed.extend(work.cache.shadowed());
        self.work = Some(work);
    }

    fn upload_row(&mut self, queue: &wgpu::Queue, cache: &SurfaceCache, row: usize) {
        let last = self.pages.len().min((row + 1) * ROW);
        for number in row * ROW..last {
            let (first, second) = cache.page(number as u32);
            let at = (number - row * ROW) * BORDERED;
            for (staging, page) in self.staging.iter_mut().zip([first, second]) {
                for (y, texels) in page.chunks_exact(BORDERED).enumerate() {
                    let to = y * WIDTH + at;
                    staging[to..to + BORDERED].copy_from_slice(texels);
                }
            }
        }
        let [first, second] = &self.staging;
        self.atlas.upload(queue, row, (0, ROW), [first, second]);
    }

    /// Bounds of the pages of real surfaces on which something is in shadow.
    pub fn shadowed(&self) -> &[Bounds] {
        &self.shadowed
    }
}

/// Writes 1 for each tile of `side` pixels that some of the bounds may touch into `tiles` (across ×
/// down, row by row).
pub fn mark_tiles(
    each: &[Bounds],
    clip_from_world: DMat4,
    size: (u32, u32),
    (side, margin): (u32, f64),
    tiles: &mut [[u32; 4]],
) {
    let grid = (size.0.div_ceil(side), size.1.div_ceil(side));
    for bounds in each {
        let Some((low, high)) = rectangle(bounds, clip_from_world, size) else {
            tiles.fill([1, 0, 0, 0]);
            return;
        };
        let tile = |x: f64, count: u32| (x / f64::from(side)).clamp(0.0, f64::from(count)) as u32;
        let more = 1.0 + margin;
        if high.x + more < 0.0 || high.y + more < 0.0 {
            continue;
        }
        for y in tile(low.y - more, grid.1)..=tile(high.y + more, grid.1).min(grid.1 - 1) {
            for x in tile(low.x - more, grid.0)..=tile(high.x + more, grid.0).min(grid.0 - 1) {
                tiles[(y * grid.0 + x) as usize] = [1, 0, 0, 0];
            }
        }
    }
}

/// The rectangle of pixels around a box; `None` if the box reaches behind the camera.
fn rectangle(b: &Bounds, clip_from_world: DMat4, size: (u32, u32)) -> Option<(DVec2, DVec2)> {
    let size = DVec2::new(f64::from(size.0), f64::from(size.1));
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for corner in b.corners() {
        let clip = clip_from_world * corner.as_dvec3().extend(1.0);
        if clip.w < 1e-3 {
            return None;
        }
        let pixel = (clip.truncate().truncate() / clip.w * DVec2::new(0.5, -0.5) + 0.5) * size;
        low = low.min(pixel);
        high = high.max(pixel);
    }
    Some((low, high))
}

fn texture(
    device: &Device,
    (width, height): (u32, u32),
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("surface cache"),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: usage | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Uploads a rectangle of a texture: left, top and width, and height. `texels` are rows of the
/// texture's width that begin with the rectangle's first texel.
fn write(
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
    ([x, y, width], height): ([u32; 3], u32),
    texels: &[u8],
    texel_bytes: u32,
) {
    queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x, y, z: 0 },
            aspect: wgpu::TextureAspect::All,
        },
        texels,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(texel_bytes * texture.width()),
            rows_per_image: None,
        },
        wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
    );
}
