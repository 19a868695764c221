//! The pages of a scene's surface cache with the planes that serve them.

use super::super::surface_light::{CacheAtlas, ROW, WIDTH};
use super::choice::{LookUp, Planes, Served, choose};
use super::page_light::{Channels, Compact, OpenLight, PageLight, PageNormal, ServedTexel};
use super::visible_pages::{Cone, Viewer, may_see};
use glam::{Vec3, Vec4};
use half::f16;
use half::slice::HalfFloatSliceExt;
use penumbra_interface::threads;
use penumbra_lighting::DomeLight;
use penumbra_scene::IndirectLight;
use penumbra_surface_cache::{
    BORDERED, Bounds, Layer, ReceiverPage, SurfaceCache, TEXELS, fill_indirect,
    fill_indirect_on_virtual,
};
use std::collections::HashMap;
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
    normals: Vec<PageNormal>,
    /// Those that are read.
    texels: Vec<ServedTexel>,
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
    /// The compact sources that planes leave out, and the surface cache with their visibility.
    pub apart: Option<(&'a SurfaceCache, &'a [DomeLight])>,
}

impl ServedPages {
    /// Chooses the planes of all texels. May run on any thread.
    pub fn new(planes: &Planes<'_>, pages: Arc<[ReceiverPage]>, open: &OpenLight) -> Self {
        let served = choose(planes, &pages);
        let each = pages.iter().zip(served);
        let each: Vec<_> = each.map(|(p, s)| ServedPage::new(p, s, open)).collect();
        let bounds = pages.iter().zip(&each);
        let bounds = bounds.filter(|(page, state)| is_real(page) && state.look_ups().count() > 0);
        let texels = pages.len().div_ceil(ROW) * ROW_TEXELS;
        Self {
            bounds: bounds.map(|(page, _)| page.bounds).collect(),
            each,
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
    pub fn look_ups(&self) -> impl Iterator<Item = (bool, &LookUp)> {
        let each = self.pages.iter().zip(&self.each);
        each.flat_map(|(page, state)| state.look_ups().map(|l| (is_real(page), l)))
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
        let mut compact = [Compact::default(); TEXELS];
        let mut half = [f16::ZERO; 4 * TEXELS];
        let each = pages.iter().zip(states).zip(number..).enumerate();
        for (column, ((page, state), number)) in each.filter(|(_, ((_, s), _))| s.is_due) {
            state.renew_indirect(self.indirect, page);
            self.sum_compact((number, page), state, &mut compact);
            let kinds = if is_real(page) { 2 } else { 1 };
            let of_page = PageLight {
                open: self.open,
                normals: &state.normals,
                shares: &self.shares[2 - kinds],
                side: self.side,
                indirect: &state.indirect,
                compact: &compact,
            };
            light.as_flattened_mut().fill(0.0);
            if is_real(page) {
                of_page.on_real(&state.texels, &mut light);
            } else {
                of_page.on_virtual(&state.texels, &mut light[0]);
            }
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

    /// Sums the light of compact sources on a page.
    fn sum_compact(
        &self,
        (number, receiver): (u32, &ReceiverPage),
        page: &ServedPage,
        sums: &mut [Compact; TEXELS],
    ) {
        let Some((cache, lights)) = self.apart else {
            return;
        };
        let none = Compact::default();
        let used = page.texels.iter().map(|texel| usize::from(texel.at));
        used.for_each(|k| sums[k] = none);
        let places = receiver.texels.positions.as_slice();
        let texels = (page.normals.as_slice(), page.texels.as_slice(), places);
        for (i, light) in lights.iter().enumerate() {
            Compact::add(sums, texels, light, cache.seen(i, number));
        }
    }
}

impl ServedPage {
    fn new(page: &ReceiverPage, served: Vec<Served>, open: &OpenLight) -> Self {
        let mut normals = Vec::new();
        let mut known: HashMap<[u32; 3], u16> = HashMap::new();
        let mut number = |n: Vec3| {
            *known
                .entry(n.to_array().map(f32::to_bits))
                .or_insert_with(|| {
                    normals.push(open.normal(n));
                    normals.len() as u16 - 1
                })
        };
        let each = served.into_iter().zip(&page.texels.normals).zip(0..);
        let used = each.zip(&page.texels.is_used).filter(|(_, used)| **used);
        let texel = |(((planes, n), at), _): (((Served, &Vec3), u16), &bool)| ServedTexel {
            at,
            normal: number(*n),
            planes,
        };
        let texels = used.map(texel).collect();
        Self {
            cone: Cone::of(page),
            normals,
            texels,
            is_stale: true,
            is_due: false,
            generation: 0,
            indirect: Vec::new(),
        }
    }

    fn look_ups(&self) -> impl Iterator<Item = &LookUp> {
        let each = self.texels.iter().flat_map(|texel| &texel.planes);
        each.filter(|l| l.weight > 0.0)
    }

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
        if is_real(page) {
            self.indirect.resize(2, [[0.0; TEXELS]; 3]);
            for (kind, to) in [&light.change, &light.real].iter().zip(&mut self.indirect) {
                fill_indirect(light, kind, &page.texels, to);
            }
        } else {
            let mut all = [[0.0; TEXELS]; 4];
            fill_indirect_on_virtual(light, &page.texels, &mut all);
            let [r, g, b, _] = all;
            self.indirect.clear();
            self.indirect.push([r, g, b]);
        }
    }
}
