//! The cache of a scene: pages on all receivers, the visibility of each light on each page, and the
//! sums.

use crate::casters::{Casters, Maps};
use crate::disc::Disc;
use crate::layout::{Bounds, Layout, Page, Receiver, TEXELS};
use crate::receivers::{CachedPart, Extent, Layer, MovingReceiver, receivers};
use crate::renewal::{LightPages, PagesView, discs};
use crate::sums::{Packed, Sums, Unshadowed};
use crate::texels::{PageTexels, texels};
use glam::{DMat4, Vec3};
use half::f16;
use penumbra_interface::threads;
use penumbra_lighting::{DomeLight, Harmonics, Lighting};
use penumbra_scene::{IndirectLight, Part, Scene};
use std::sync::{Arc, Mutex};

/// Sizes of a cache.
#[derive(Clone, Copy, Debug)]
pub struct CacheOptions {
    /// Maximum number of pages.
    pub pages: usize,
    /// Texels along a side of a light's depth maps, a power of two from 16 to 2048.
    pub map_size: usize,
    /// Maximum number of lights.
    pub lights: usize,
}

/// The light of an update.
#[derive(Clone, Copy)]
pub struct SurfaceLight<'a> {
    /// Changes with the light.
    pub generation: u64,
    /// Of the environment without its compact sources.
    pub irradiance: &'a Harmonics,
    /// Mean radiance of the ground.
    pub ground_radiance: Vec3,
    /// The dome lights within the budget.
    pub lights: &'a [DomeLight],
    /// Indirect light, if it is wanted.
    pub indirect: Option<&'a IndirectLight>,
}

impl<'a> SurfaceLight<'a> {
    /// The light of `lighting`, of whose dome lights `lights` are within the budget.
    #[must_use]
    pub fn new(
        lighting: &'a Lighting,
        lights: &'a [DomeLight],
        indirect: Option<&'a IndirectLight>,
    ) -> Self {
        Self {
            generation: lighting.generation,
            irradiance: &lighting.irradiance,
            ground_radiance: lighting.ground_radiance,
            lights,
            indirect,
        }
    }

    /// Generations of the light and of the indirect light.
    fn generations(&self) -> (u64, u64) {
        (self.generation, self.indirect.map_or(0, |l| l.generation))
    }
}

/// A page of texels on a surface.
#[derive(Clone, Debug)]
pub struct ReceiverPage {
    /// The part to which the surface belongs.
    pub layer: Layer,
    /// Bounds of its used texels.
    pub bounds: Bounds,
    /// Its texels.
    pub texels: Arc<PageTexels>,
}

/// The sums of a page.
struct PageSums {
    texels: [Vec<[f16; 4]>; 2],
    is_shadowed: bool,
}

/// The cache of one scene.
pub struct SurfaceCache {
    pub(crate) parts: Vec<CachedPart>,
    pub(crate) layout: Layout,
    pub(crate) texels: Vec<Arc<PageTexels>>,
    extents: Vec<Extent>,
    casters: Casters,
    moving: Vec<MovingReceiver>,
    /// For lights whose shadow hardly shows by itself, and for others.
    discs: [Disc; 2],
    has_ground: bool,
    lights: Vec<LightPages>,
    sums: Vec<PageSums>,
    /// Generations of the light and of the indirect light in the sums.
    summed: Option<(u64, u64)>,
    /// Of the light with this generation.
    unshadowed: Option<(u64, Unshadowed)>,
    /// Pages that the last update has changed, as a list and by number.
    changed: Vec<u32>,
    is_changed: Vec<bool>,
    /// One for each thread.
    maps: Vec<Mutex<Maps>>,
}

impl SurfaceCache {
    /// Places texels on the surfaces of `scene`. `casters` are its virtual parts as they cast
    /// shadows.
    #[must_use]
    pub fn new(scene: &Scene, casters: &[Part], options: &CacheOptions) -> Self {
        let (parts, normals) = receivers(scene);
        let casters = Casters::new(scene, casters, options.map_size);
        let receivers: Vec<&Receiver> = parts.iter().map(|p| &p.receiver).collect();
        let layout = Layout::fitted(&receivers, casters.virtual_bounds(), options.pages);
        let place = |page: &Page| {
            let receiver = receivers[page.receiver];
            Arc::new(texels(&layout, page, receiver, &normals[page.receiver]))
        };
        let texels: Vec<Arc<PageTexels>> = layout.pages.iter().map(place).collect();
        let pages = layout.pages.len();
        let sums = || PageSums {
            texels: [vec![[f16::ZERO; 4]; TEXELS], vec![[f16::ZERO; 4]; TEXELS]],
            is_shadowed: false,
        };
        Self {
            lights: (0..options.lights)
                .map(|_| LightPages::new(pages))
                .collect(),
            sums: (0..pages).map(|_| sums()).collect(),
            extents: texels.iter().map(|t| Extent::of(t)).collect(),
            moving: MovingReceiver::all(scene, &parts, &layout, &texels),
            parts,
            layout,
            texels,
            casters,
            discs: discs(),
            has_ground: scene.ground_height.is_some(),
            summed: None,
            unshadowed: None,
            changed: Vec::with_capacity(pages),
            is_changed: vec![false; pages],
            maps: (0..threads::processors())
                .map(|_| Mutex::new(Maps::new(options.map_size)))
                .collect(),
        }
    }

    /// Number of pages.
    #[must_use]
    pub fn page_count(&self) -> usize {
        self.layout.pages.len()
    }

    /// All pages by number, as they lie now.
    #[must_use]
    pub fn receiver_pages(&self) -> Vec<ReceiverPage> {
        let each = self.layout.pages.iter().zip(&self.texels);
        let each = each.zip(&self.extents);
        each.map(|((page, texels), extent)| ReceiverPage {
            layer: self.parts[page.receiver].layer,
            bounds: extent.bounds,
            texels: texels.clone(),
        })
        .collect()
    }

    /// The parts that keep no light: their surfaces are so rough that they have more charts than there
    /// are pages.
    pub fn left_out(&self) -> impl Iterator<Item = Layer> {
        let left_out = self.layout.left_out.iter();
        left_out.map(|r| self.parts[*r].layer)
    }

    /// Length of the finest texels, metres.
    #[must_use]
    pub fn texel(&self) -> f32 {
        self.layout.texel
    }

    /// Moves a moving virtual part to `world`, as a receiver and as a caster. The visibility of
    /// lights follows as they are renewed.
    pub fn place(&mut self, part: usize, world: DMat4) {
        self.casters.place(part, world);
        if let Some(moving) = self.moving.iter().find(|moving| moving.is(part)) {
            moving.place(world, &mut self.texels, &mut self.extents);
            moving.pages().for_each(|p| self.is_changed[p] = true);
        }
    }

    /// Whether it has the light of some update.
    #[must_use]
    pub const fn is_summed(&self) -> bool {
        self.summed.is_some()
    }

    /// Whether an update without renewed lights would change anything.
    #[must_use]
    pub fn is_outdated(&self, light: &SurfaceLight<'_>) -> bool {
        self.summed != Some(light.generations()) || self.is_changed.contains(&true)
    }

    /// Finds the visibility of the lights `renewed` (by number) again and brings the sums of all
    /// pages up to date with `light`; returns the pages that have changed. Lights that are not
    /// renewed cast the shadows of the direction for which their visibility was found.
    pub fn update(&mut self, light: &SurfaceLight<'_>, renewed: &[usize]) -> &[u32] {
        self.renew(light.lights, renewed);
        let wanted = light.generations();
        if self.summed != Some(wanted) {
            self.is_changed.fill(true);
            self.summed = Some(wanted);
        }
        let pages = self.is_changed.iter_mut().zip(0..);
        self.changed.clear();
        self.changed
            .extend(pages.filter_map(|(changed, p)| std::mem::take(changed).then_some(p)));
        self.sum(light);
        &self.changed
    }

    /// Finds the visibility of the lights `renewed` among `lights` again, and leaves the sums to a
    /// later update.
    pub fn renew(&mut self, lights: &[DomeLight], renewed: &[usize]) {
        let view = PagesView {
            parts: &self.parts,
            layout: &self.layout,
            texels: &self.texels,
            extents: &self.extents,
            casters: &self.casters,
            discs: &self.discs,
            total: lights.iter().map(|l| l.irradiance.element_sum()).sum(),
        };
        let mut jobs: Vec<(&mut LightPages, &DomeLight)> = self
            .lights
            .iter_mut()
            .zip(lights)
            .enumerate()
            .filter_map(|(i, job)| renewed.contains(&i).then_some(job))
            .collect();
        // A thread for each light; those that are left over are divided between threads.
        let whole = jobs.len() - jobs.len() % self.maps.len();
        let divided = jobs.split_off(whole);
        let maps = &self.maps;
        threads::for_each(jobs, |(kept, light)| {
            let free = maps.iter().find_map(|maps| maps.try_lock().ok());
            if let Some(mut maps) = free {
                view.renew(kept, light, &mut maps, false);
            }
        });
        for (kept, light) in divided {
            if let Some(mut maps) = maps.first().and_then(|maps| maps.lock().ok()) {
                view.renew(kept, light, &mut maps, true);
            }
        }
        for kept in &mut self.lights {
            for (changed, touched) in self.is_changed.iter_mut().zip(&mut kept.is_touched) {
                *changed |= std::mem::take(touched);
            }
        }
    }

    fn sum(&mut self, light: &SurfaceLight<'_>) {
        if self.changed.is_empty() {
            return;
        }
        let known = self.unshadowed.take();
        let known = known.filter(|(generation, _)| *generation == light.generation);
        let new = || (light.generation, Unshadowed::new(light, self.has_ground));
        let (_, unshadowed) = self.unshadowed.insert(known.unwrap_or_else(new));
        let view = SumsView {
            parts: &self.parts,
            layout: &self.layout,
            texels: &self.texels,
            lights: &self.lights,
            of: light.lights,
            unshadowed,
            indirect: light.indirect,
        };
        let mut wanted = self.changed.iter().copied().peekable();
        let sums = self.sums.iter_mut().zip(0..);
        let mut pages: Vec<(&mut PageSums, u32)> = sums
            .filter(|(_, p)| wanted.next_if_eq(p).is_some())
            .collect();
        threads::for_each(pages.chunks_mut(CHUNK).collect(), |chunk| {
            pulp::Arch::new().dispatch(Summing { view: &view, chunk });
        });
    }

    /// Share of light `light`, as a number from 0 to 255, that each texel of a page sees past virtual casters, and
    /// past phantoms; `None` where all see it.
    #[must_use]
    pub fn seen(&self, light: usize, page: u32) -> [Option<&[u8; TEXELS]>; 2] {
        let kept = self.lights.get(light);
        kept.map_or([None; 2], |kept| kept.seen_on(page as usize))
    }

    /// The sums of a page, row by row with its border: on real surfaces the light that virtual
    /// casters block and the light that arrives; on virtual ones the irradiance times a weight,
    /// with the weight in alpha, and nothing.
    #[must_use]
    pub fn page(&self, page: u32) -> (&[[f16; 4]], &[[f16; 4]]) {
        let [first, second] = &self.sums[page as usize].texels;
        (first, second)
    }

    /// Bounds of the pages of real surfaces on which something is in shadow.
    pub fn shadowed(&self) -> impl Iterator<Item = Bounds> {
        let pages = self.extents.iter().zip(&self.sums);
        pages.filter_map(|(extent, sums)| sums.is_shadowed.then_some(extent.bounds))
    }
}

/// Pages that a thread takes at a time.
pub const CHUNK: usize = 64;

/// What the sums are made of.
struct SumsView<'a> {
    parts: &'a [CachedPart],
    layout: &'a Layout,
    texels: &'a [Arc<PageTexels>],
    lights: &'a [LightPages],
    of: &'a [DomeLight],
    unshadowed: &'a Unshadowed,
    indirect: Option<&'a IndirectLight>,
}

/// Summing on some pages, with the instructions that the processor has.
struct Summing<'a, 'b> {
    view: &'a SumsView<'a>,
    chunk: &'a mut [(&'b mut PageSums, u32)],
}

impl pulp::WithSimd for Summing<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let mut buffers = Sums::new();
        for (sums, p) in self.chunk {
            self.view.sum(&mut buffers, *p as usize, sums);
        }
    }
}

impl SumsView<'_> {
    #[inline(always)]
    fn sum(&self, buffers: &mut Sums, p: usize, sums: &mut PageSums) {
        let page = &self.texels[p];
        let lights = self.lights.iter().zip(self.of);
        let lights = lights.filter_map(|(kept, light)| kept.on_page(p, light));
        let [first, second] = &mut sums.texels;
        let mut packed = Packed {
            first: first.as_flattened_mut(),
            second: second.as_flattened_mut(),
        };
        let (unshadowed, indirect) = (self.unshadowed, self.indirect);
        let part = &self.parts[self.layout.pages[p].receiver];
        match part.layer {
            Layer::Phantom(_) => {
                sums.is_shadowed = buffers.real(page, lights, unshadowed, indirect, &mut packed);
            }
            Layer::Virtual(_) => {
                let albedo = part.albedo;
                buffers.remaining(page, lights, unshadowed, indirect, albedo, &mut packed);
            }
        }
    }
}
