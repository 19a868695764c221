//! The pages of a scene's surface cache with the planes that serve them.

use super::super::surface_light::{CacheAtlas, ROW, WIDTH};
use super::choice::{Planes, Served, choose};
use super::page_light::{Channels, OpenLight, PageLight, Texels};
use super::visible_pages::{Cone, Viewer, may_see};
use glam::Vec4;
use half::f16;
use half::slice::HalfFloatSliceExt;
use penumbra_interface::threads;
use penumbra_scene::IndirectLight;
use penumbra_surface_cache::{
    BORDERED, Bounds, Layer, ReceiverPage, SurfaceCache, TEXELS, fill_indirect,
};
use pulp::Arch;
use std::sync::Arc;

/// Texels in a row of pages.
const ROW_TEXELS: usize = WIDTH * BORDERED;

/// All pages, and their light as it lies in the atlas.
pub(super) struct ServedPages {
    /// Identifies the scene.
    pages: Arc<[ReceiverPage]>,
    /// Bounds of the pages of real surfaces that some plane serves.
    bounds: Vec<Bounds>,
    each: Vec<ServedPage>,
    texels: [Vec<[f16; 4]>; 2],
}

/// A page, and how far its light is up to date.
struct ServedPage {
    cone: Cone,
    served: Vec<Served>,
    is_stale: bool,
    /// Whether its light is written in this frame.
    is_due: bool,
    /// Generation of the indirect light on its texels, 0 for none.
    generation: u64,
    indirect: Vec<Channels>,
}

/// The light of a frame.
pub(super) struct FrameLight<'a> {
    pub open: &'a OpenLight,
    /// Of the real and of the virtual layer, for the texels of all planes.
    pub shares: &'a [Vec<Vec4>; 2],
    /// Texels along a side of a plane.
    pub side: usize,
    pub indirect: Option<&'a IndirectLight>,
    /// The surface cache with the light of compact sources, where planes leave it out.
    pub apart: Option<&'a SurfaceCache>,
}

impl ServedPages {
    /// Chooses the planes of all texels. May run on any thread.
    pub fn new(planes: &Planes<'_>, pages: Arc<[ReceiverPage]>) -> Self {
        let served = choose(planes, &pages);
        let is_served = |texels: &[Served]| texels.iter().flatten().any(|l| l.weight > 0.0);
        let each = pages.iter().zip(&served);
        let bounds = each.filter(|(page, served)| is_real(page) && is_served(served));
        let bounds = bounds.map(|(page, _)| page.bounds).collect();
        let state = |(page, served): (&ReceiverPage, Vec<Served>)| ServedPage {
            cone: Cone::of(page),
            served,
            is_stale: true,
            is_due: false,
            generation: 0,
            indirect: Vec::new(),
        };
        let texels = pages.len().div_ceil(ROW) * ROW_TEXELS;
        Self {
            bounds,
            each: pages.iter().zip(served).map(state).collect(),
            texels: [(); 2].map(|()| vec![[f16::ZERO; 4]; texels]),
            pages,
        }
    }

    /// Whether these are the texels of `pages`.
    pub fn is_of(&self, pages: &Arc<[ReceiverPage]>) -> bool {
        Arc::ptr_eq(&self.pages, pages)
    }

    /// Bounds of the pages of real surfaces that some plane serves.
    pub fn bounds(&self) -> &[Bounds] {
        &self.bounds
    }

    /// The look-ups of all texels, with whether they are on real surfaces.
    pub fn look_ups(&self) -> impl Iterator<Item = (bool, &Served)> {
        let each = self.pages.iter().zip(&self.each);
        each.flat_map(|(page, state)| state.served.iter().map(|served| (is_real(page), served)))
    }

    /// Has the light of every page written again before it is seen.
    pub fn expire(&mut self) {
        self.each.iter_mut().for_each(|page| page.is_stale = true);
    }

    /// Writes the light of the pages that the viewer may see and whose light is out of date.
    pub fn write(
        &mut self,
        queue: &wgpu::Queue,
        viewer: &Viewer,
        light: &FrameLight<'_>,
        atlas: &CacheAtlas,
    ) {
        let stale = self.each.iter_mut().zip(self.pages.iter());
        for (state, page) in stale.filter(|(state, _)| state.is_stale) {
            state.is_due = may_see(viewer, &page.bounds, &state.cone);
            state.is_stale = !state.is_due;
        }
        let [first, second] = &mut self.texels;
        let texels = first.chunks_mut(ROW_TEXELS);
        let texels = texels.zip(second.chunks_mut(ROW_TEXELS));
        let pages = self.pages.chunks(ROW).zip(self.each.chunks_mut(ROW));
        let rows = pages.zip(texels).zip((0..).step_by(ROW));
        let rows = rows.filter(|(((_, states), _), _)| states.iter().any(|state| state.is_due));
        threads::for_each(rows.collect(), |(((pages, states), texels), number)| {
            light.write_row(number, (pages, states), texels);
        });
        self.upload(queue, atlas);
    }

    /// Uploads the pages that were written, those side by side together.
    fn upload(&mut self, queue: &wgpu::Queue, atlas: &CacheAtlas) {
        let [first, second] = &self.texels;
        let texels = first.chunks(ROW_TEXELS).zip(second.chunks(ROW_TEXELS));
        let rows = self.each.chunks_mut(ROW).zip(texels).enumerate();
        for (row, (states, (first, second))) in rows {
            let mut column = 0;
            for run in states.chunk_by(|a, b| a.is_due == b.is_due) {
                if run[0].is_due {
                    atlas.upload(queue, row, (column, run.len()), [first, second]);
                }
                column += run.len();
            }
            states.iter_mut().for_each(|state| state.is_due = false);
        }
    }
}

const fn is_real(page: &ReceiverPage) -> bool {
    matches!(page.layer, Layer::Phantom(_))
}

impl FrameLight<'_> {
    /// Writes the pages of a row that are due; `number` is that of its first page.
    fn write_row(
        &self,
        number: u32,
        (pages, states): (&[ReceiverPage], &mut [ServedPage]),
        (first, second): (&mut [[f16; 4]], &mut [[f16; 4]]),
    ) {
        let mut light = [[0.0; 4 * TEXELS]; 2];
        let mut compact = light;
        let mut half = [f16::ZERO; 4 * TEXELS];
        let each = pages.iter().zip(states).enumerate();
        for (column, (page, state)) in each.filter(|(_, (_, state))| state.is_due) {
            state.renew_indirect(self.indirect, page);
            if let Some(cache) = self.apart {
                let (first, second) = cache.page(number + column as u32);
                for (to, from) in compact.iter_mut().zip([first, second]) {
                    from.as_flattened().convert_to_f32_slice(to);
                }
            }
            let kinds = if is_real(page) { 2 } else { 1 };
            let of_page = PageLight {
                open: self.open,
                shares: &self.shares[2 - kinds],
                side: self.side,
                indirect: &state.indirect,
                compact: self.apart.map(|_| &compact),
            };
            of_page.fill(page, &state.served, &mut light);
            let both = light.iter().zip([&mut *first, &mut *second]);
            for (light, row) in both.take(kinds) {
                half.convert_from_f32_slice(light);
                let lines = row.chunks_exact_mut(WIDTH);
                for (line, texels) in lines.zip(half.chunks_exact(4 * BORDERED)) {
                    let to = &mut line[column * BORDERED..][..BORDERED];
                    to.as_flattened_mut().copy_from_slice(texels);
                }
            }
        }
    }
}

impl PageLight<'_> {
    fn fill(&self, page: &ReceiverPage, served: &[Served], light: &mut [Texels; 2]) {
        Arch::new().dispatch(
            #[inline(always)]
            || {
                if is_real(page) {
                    self.on_real(&page.texels, served, light);
                } else {
                    self.on_virtual(&page.texels, served, &mut light[0]);
                }
                for value in light.as_flattened_mut() {
                    *value = value.min(MAX);
                }
            },
        );
    }
}

/// Maximum of what is kept in half floats.
const MAX: f32 = 60_000.0;

impl ServedPage {
    /// Brings the indirect light up to date; done when it changes, because it costs more than all
    /// else.
    fn renew_indirect(&mut self, light: Option<&IndirectLight>, page: &ReceiverPage) {
        let generation = light.map_or(0, |light| light.generation);
        if self.generation == generation {
            return;
        }
        self.generation = generation;
        let Some(light) = light.filter(|_| generation != 0) else {
            self.indirect.clear();
            return;
        };
        let kinds: &[_] = if is_real(page) {
            &[&light.change, &light.real]
        } else {
            &[&light.real_now]
        };
        self.indirect.resize(kinds.len(), [[0.0; TEXELS]; 3]);
        for (kind, to) in kinds.iter().zip(&mut self.indirect) {
            fill_indirect(light, kind, &page.texels, to);
        }
    }
}
