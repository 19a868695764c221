//! Finding the visibility of a light again, on all pages.

use crate::cache::CHUNK;
use crate::casters::{Casters, Maps};
use crate::disc::Disc;
use crate::layout::{Layout, TEXELS};
use crate::receivers::{CachedPart, Extent, Layer};
use crate::sums::PageLight;
use crate::texels::PageTexels;
use crate::visibility::{LitMap, Offset, Reach};
use glam::Vec3;
use penumbra_interface::threads;
use penumbra_lighting::{DomeLight, LightKind};
use std::sync::Arc;

/// Look-ups for the search for blockers and for the filter, each, of a light whose shadow hardly shows
/// by itself and of one whose shadow does: on a texel, and on one of those between which visibility is
/// interpolated.
const SAMPLES: [[usize; 2]; 2] = [[8, 16], [16, 64]];
/// Share of all light from which on a compact light's shadow shows by itself: below, a step of one
/// look-up of 16 is less than half a code of a bright picture.
const STRONG: f32 = 0.06;

/// The discs for lights whose shadow hardly shows by itself, and for others.
pub fn discs() -> [Disc; 2] {
    SAMPLES.map(Disc::new)
}

/// One light's visibility on all pages.
pub struct LightPages {
    /// Past virtual casters, past phantoms.
    pub reach: [Vec<Reach>; 2],
    pub seen: [Vec<u8>; 2],
    /// Whether a page is another one since the visibility was last found.
    pub is_touched: Vec<bool>,
}

impl LightPages {
    /// A light that everything sees.
    pub fn new(pages: usize) -> Self {
        Self {
            reach: [vec![Reach::Open; pages], vec![Reach::Open; pages]],
            seen: [vec![0; pages * TEXELS], vec![0; pages * TEXELS]],
            is_touched: vec![false; pages],
        }
    }

    /// What each texel of page `p` sees past virtual casters, and past phantoms; `None` where all see
    /// the light.
    pub fn seen_on(&self, p: usize) -> [Option<&[u8; TEXELS]>; 2] {
        [0, 1].map(|which| {
            let seen = self.seen[which].get(p * TEXELS..(p + 1) * TEXELS)?;
            let is_partial = self.reach[which][p] == Reach::Partial;
            is_partial.then(|| seen.try_into().ok()).flatten()
        })
    }

    /// The light on page `p`, if it is blocked there anywhere.
    pub fn on_page<'a>(&'a self, p: usize, light: &'a DomeLight) -> Option<PageLight<'a>> {
        let [past_virtual, past_phantoms] = self.seen_on(p);
        let is_blocked = past_virtual.is_some() || past_phantoms.is_some();
        (is_blocked && light.irradiance != Vec3::ZERO).then_some(PageLight {
            light,
            past_virtual,
            past_phantoms,
        })
    }
}

/// What finding the visibility of a light reads.
pub struct PagesView<'a> {
    pub parts: &'a [CachedPart],
    pub layout: &'a Layout,
    pub texels: &'a [Arc<PageTexels>],
    pub extents: &'a [Extent],
    pub casters: &'a Casters,
    pub discs: &'a [Disc; 2],
    /// Irradiance of all lights, the sum over the channels.
    pub total: f32,
}

/// Some pages of one light: number of the first, visibility past casters of one kind, reach,
/// whether they have changed.
pub type SomePages<'a> = (usize, &'a mut [u8], &'a mut [Reach], &'a mut [bool]);

/// Finding the visibility on some pages, with the instructions that the processor has.
struct Search<'a> {
    view: &'a PagesView<'a>,
    lit: Option<&'a LitMap<'a>>,
    which: usize,
    pages: SomePages<'a>,
}

impl pulp::WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        self.view.find(simd, self.lit, self.which, self.pages);
    }
}

impl PagesView<'_> {
    /// Finds the visibility of a light on all pages, `divided` between threads or on this one.
    pub fn renew(&self, kept: &mut LightPages, light: &DomeLight, maps: &mut Maps, divided: bool) {
        let chunk = if divided {
            CHUNK
        } else {
            self.texels.len().max(1)
        };
        let is_compact = light.kind == LightKind::Compact;
        let is_strong = is_compact && light.irradiance.element_sum() > STRONG * self.total;
        let drawn = self.casters.draw(light, maps.of(is_compact));
        for (which, map) in drawn.into_iter().enumerate() {
            let lit = map.map(|(map, view)| LitMap {
                map,
                view,
                spread: light.angular_radius.tan(),
                disc: &self.discs[usize::from(is_strong)],
            });
            let seen = kept.seen[which].chunks_mut(chunk * TEXELS);
            let reach = kept.reach[which].chunks_mut(chunk);
            let touched = kept.is_touched.chunks_mut(chunk);
            let pages = seen.zip(reach).zip(touched).enumerate();
            let pages = pages.map(|(i, ((s, r), t))| (i * chunk, s, r, t)).collect();
            let lit = lit.as_ref();
            threads::for_each(pages, |pages| {
                pulp::Arch::new().dispatch(Search {
                    view: self,
                    lit,
                    which,
                    pages,
                });
            });
        }
    }

    /// Finds the visibility on some pages.
    #[inline(always)]
    pub fn find<S: pulp::Simd>(
        &self,
        simd: S,
        lit: Option<&LitMap<'_>>,
        which: usize,
        pages: SomePages<'_>,
    ) {
        let (first, seen, reach, touched) = pages;
        let each = seen.chunks_exact_mut(TEXELS).zip(reach).zip(touched);
        for (p, ((seen, reach), touched)) in (first..).zip(each) {
            let before = *reach;
            *reach = Reach::Open;
            if let Some(lit) = lit {
                *reach = self.look(simd, lit, which, p, seen);
            }
            *touched |= before == Reach::Partial || *reach == Reach::Partial;
        }
    }

    #[inline(always)]
    fn look<S: pulp::Simd>(
        &self,
        simd: S,
        lit: &LitMap<'_>,
        which: usize,
        p: usize,
        seen: &mut [u8],
    ) -> Reach {
        let offset = match (self.parts[self.layout.pages[p].receiver].layer, which) {
            (Layer::Virtual(_), 0) => Offset::Lift,
            (Layer::Phantom(_), 1) => Offset::Shift,
            _ => Offset::None,
        };
        let place = (&self.extents[p], self.layout.length(p));
        lit.look(simd, &self.texels[p], place, offset, seen)
    }
}
