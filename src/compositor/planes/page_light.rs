//! The light of shadowing planes on the texels of a page. Equations as in `planes_shadow`.

use super::super::gpu_data::FrameUniform;
use super::super::light_maps::BY_NORMAL;
use super::choice::{LookUp, Served};
use super::normal_table::NormalTable;
use glam::{Vec3, Vec4};
use penumbra_lighting::{DomeLight, LightKind};
use penumbra_surface_cache::{PageTexels, TEXELS};
use std::f32::consts::FRAC_PI_2;

/// RGBA of the texels of a page, interleaved.
pub(super) type Texels = [f32; 4 * TEXELS];

/// RGB of the texels of a page, channel by channel.
pub(super) type Channels = [[f32; TEXELS]; 3];

/// Unshadowed light by normal.
pub(super) struct OpenLight {
    lights: NormalTable,
    compact: NormalTable,
    /// Whether planes leave compact sources out.
    leaves_sources: bool,
    harmonics: [Vec4; 9],
    /// Irradiance from the ground on a surface that faces the horizon.
    ground: Vec4,
}

/// Unshadowed irradiance on a surface.
#[derive(Clone, Copy)]
struct Open {
    /// Of the dome that planes shadow.
    planes: Vec4,
    /// Of the compact sources that planes leave out.
    apart: Vec4,
    /// On real surfaces of what is neither, on virtual ones of the whole environment.
    other: Vec4,
}

impl OpenLight {
    /// Darkness.
    pub fn new() -> Self {
        Self {
            lights: NormalTable::new(BY_NORMAL),
            compact: NormalTable::new(BY_NORMAL),
            leaves_sources: false,
            harmonics: [Vec4::ZERO; 9],
            ground: Vec4::ZERO,
        }
    }

    /// Takes over the light of a frame, whose `lights` shade surfaces.
    pub fn fill(&mut self, uniform: &FrameUniform, lights: &[DomeLight], leaves_sources: bool) {
        let each = lights.iter().map(|l| (l.direction, l.irradiance));
        self.lights.fill(each);
        let compact = lights.iter().filter(|l| l.kind == LightKind::Compact);
        self.compact
            .fill(compact.map(|l| (l.direction, l.irradiance)));
        self.leaves_sources = leaves_sources;
        self.harmonics = uniform.harmonics.map(Vec4::from);
        let ground = Vec4::from(uniform.ground).with_w(0.0);
        self.ground = ground * (uniform.params[2] * FRAC_PI_2);
    }

    fn on_real(&self, n: Vec3) -> Open {
        let apart = if self.leaves_sources {
            self.compact.on(n)
        } else {
            Vec4::ZERO
        };
        Open {
            planes: self.lights.on(n) - apart,
            apart,
            other: self.ground * (1.0 - n.z),
        }
    }

    fn on_virtual(&self, n: Vec3) -> Open {
        Open {
            other: self.sky(n) + self.compact.on(n),
            ..self.on_real(n)
        }
    }

    /// Twin of `sky_irradiance` in `lib/frame.wgsl`.
    fn sky(&self, n: Vec3) -> Vec4 {
        let h = &self.harmonics;
        let linear = h[0] + h[1] * n.y + h[2] * n.z + h[3] * n.x;
        let mixed = h[4] * (n.x * n.y) + h[5] * (n.y * n.z) + h[7] * (n.x * n.z);
        let squares = h[6] * (3.0 * n.z * n.z - 1.0) + h[8] * (n.x * n.x - n.y * n.y);
        (linear + mixed + squares).max(Vec4::ZERO)
    }
}

/// What lights a page.
pub(super) struct PageLight<'a> {
    pub open: &'a OpenLight,
    /// Of the texels of all planes of the page's layer, the shares of the light on an open surface
    /// that arrive: past all casters, and on the real layer past phantoms.
    pub shares: &'a [Vec4],
    /// Texels along a side of a plane.
    pub side: usize,
    /// Indirect light: on real surfaces the change that virtual objects cause, and the light in the
    /// real scene; on virtual ones all of it.
    pub indirect: &'a [Channels],
    /// The light of compact sources, as in the surface cache, where planes leave it out.
    pub compact: Option<&'a [Texels; 2]>,
}

impl PageLight<'_> {
    /// Light on a real surface: what virtual objects block, and what arrives.
    #[inline(always)]
    pub fn on_real(&self, texels: &PageTexels, served: &[Served], out: &mut [Texels; 2]) {
        let flat = texels.plane.map(|n| self.open.on_real(n));
        let [first, second] = out.each_mut().map(|t| t.as_chunks_mut::<4>().0);
        let each = served.iter().zip(&texels.normals).enumerate();
        for ((k, (served, n)), (first, second)) in each.zip(first.iter_mut().zip(second)) {
            let open = flat.unwrap_or_else(|| self.open.on_real(*n));
            let [all, real] = self.shares_of::<2>(served);
            let kept = open.planes * (real - all).max(Vec4::ZERO);
            let [kept_apart, arriving_apart] = self.compact_at(k);
            // Minus the indirect light from virtual objects.
            let lost = kept + kept_apart - self.indirect_at(0, k);
            let other = open.other + self.indirect_at(1, k);
            let unshadowed = other + open.planes + open.apart;
            let arriving = other + open.planes * real + arriving_apart;
            let bounded = arriving.max(lost).max(Vec4::splat(1e-6));
            let share = bounded.y / unshadowed.y.max(1e-6);
            *first = lost.with_w(1.0).to_array();
            *second = bounded.with_w(share).to_array();
        }
    }

    /// Irradiance on a virtual surface times a weight, and that weight.
    #[inline(always)]
    pub fn on_virtual(&self, texels: &PageTexels, served: &[Served], out: &mut Texels) {
        let flat = texels.plane.map(|n| self.open.on_virtual(n));
        let each = served.iter().zip(&texels.normals).enumerate();
        for ((k, (served, n)), out) in each.zip(out.as_chunks_mut::<4>().0) {
            let open = flat.unwrap_or_else(|| self.open.on_virtual(*n));
            let [share] = self.shares_of::<1>(served);
            let [compact, _] = self.compact_at(k);
            let remaining_apart = compact / compact.w.max(1e-4);
            let hidden = open.planes * (Vec4::ONE - share) + open.apart - remaining_apart;
            let light = (open.other - hidden + self.indirect_at(0, k)).max(Vec4::ZERO);
            // Texels inside other objects are black; the weight keeps them out of interpolation.
            let rgb = |v: Vec4| v.truncate().element_sum();
            let weight = (8.0 * rgb(light) / rgb(open.other).max(1e-6)).clamp(0.01, 1.0);
            *out = (light * weight).with_w(weight).to_array();
        }
    }

    /// Shares of `N` kinds at a texel; what no plane serves is unshadowed.
    #[inline(always)]
    fn shares_of<const N: usize>(&self, served: &Served) -> [Vec4; N] {
        let [a, b] = served.map(|l| l.weight);
        let mut sums = [Vec4::splat(1.0 - a - b); N];
        for LookUp {
            first,
            part: [x, y],
            weight,
        } in served.iter().filter(|l| l.weight > 0.0)
        {
            let row = |first: usize| &self.shares[N * first..][..2 * N];
            let rows = [row(*first as usize), row(*first as usize + self.side)];
            let weights = [weight * (1.0 - y), weight * y].map(|w| [w * (1.0 - x), w * x]);
            for (row, [left, right]) in rows.into_iter().zip(weights) {
                for (j, sum) in sums.iter_mut().enumerate() {
                    *sum += row[j] * left + row[N + j] * right;
                }
            }
        }
        sums
    }

    #[inline(always)]
    fn compact_at(&self, k: usize) -> [Vec4; 2] {
        let at = |texels: &Texels| Vec4::from_slice(&texels[4 * k..]);
        self.compact
            .map_or([Vec4::ZERO; 2], |both| both.each_ref().map(at))
    }

    #[inline(always)]
    fn indirect_at(&self, kind: usize, k: usize) -> Vec4 {
        let at = |[r, g, b]: &Channels| Vec4::new(r[k], g[k], b[k], 0.0);
        self.indirect.get(kind).map_or(Vec4::ZERO, at)
    }
}
