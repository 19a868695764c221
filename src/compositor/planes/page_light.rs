//! The light of shadowing planes on the texels of a page. Equations as in `planes_shadow`.

use super::super::gpu_data::FrameUniform;
use super::super::light_maps::BY_NORMAL;
use super::choice::{LookUp, Served};
use super::normal_table::{NormalTable, Place};
use glam::{Vec3, Vec4};
use penumbra_lighting::{DomeLight, LightKind};
use penumbra_surface_cache::TEXELS;
use std::f32::consts::FRAC_PI_2;

/// RGBA of the texels of a page, interleaved.
pub(super) type Texels = [f32; 4 * TEXELS];

/// RGB of the texels of a page, channel by channel.
pub(super) type Channels = [[f32; TEXELS]; 3];

/// A texel of a page that is read, with the planes that serve it.
pub(super) struct ServedTexel {
    /// Its number on the page.
    pub at: u16,
    /// Which of the page's normals it has.
    pub normal: u16,
    pub planes: Served,
}

/// A normal of a page, with its place in the tables of [`OpenLight`].
pub(super) struct PageNormal {
    pub normal: Vec3,
    pub place: Place,
}

/// Unshadowed light by normal.
pub(super) struct OpenLight {
    /// Of the dome that planes shadow.
    dome: NormalTable,
    /// Of the environment without the compact sources that planes leave out.
    sky: NormalTable,
    /// Irradiance from the ground on a surface that faces the horizon.
    ground: Vec4,
}

/// Unshadowed irradiance on a surface.
#[derive(Clone, Copy, Default)]
struct Open {
    /// Of the dome that planes shadow.
    dome: Vec4,
    /// On real surfaces of the ground, on virtual ones of the whole environment.
    other: Vec4,
}

impl OpenLight {
    /// Darkness.
    pub fn new() -> Self {
        Self {
            dome: NormalTable::new(BY_NORMAL),
            sky: NormalTable::new(BY_NORMAL),
            ground: Vec4::ZERO,
        }
    }

    /// The normal `n`, for its look-ups.
    pub fn normal(&self, n: Vec3) -> PageNormal {
        PageNormal {
            normal: n,
            place: self.dome.place(n),
        }
    }

    /// Takes over the light of a frame, whose `lights` shade surfaces; `leaves_sources`: without
    /// compact sources.
    pub fn fill(&mut self, uniform: &FrameUniform, lights: &[DomeLight], leaves_sources: bool) {
        let kept = lights.iter();
        let kept = kept.filter(|l| !leaves_sources || l.kind != LightKind::Compact);
        self.dome
            .sum(kept.clone().map(|l| (l.direction, l.irradiance)));
        let compact = kept.filter(|l| l.kind == LightKind::Compact);
        let harmonics = uniform.harmonics.map(Vec4::from);
        self.sky.fill(|n| {
            let each = compact.clone();
            let compact = each.map(|l| l.irradiance * l.direction.dot(n).max(0.0));
            sky(&harmonics, n) + compact.sum::<Vec3>().extend(0.0)
        });
        let ground = Vec4::from(uniform.ground).with_w(0.0);
        self.ground = ground * (uniform.params[2] * FRAC_PI_2);
    }

    fn on_real(&self, n: &PageNormal) -> Open {
        Open {
            dome: self.dome.at(n.place),
            other: self.ground * (1.0 - n.normal.z),
        }
    }

    fn on_virtual(&self, n: &PageNormal) -> Open {
        Open {
            dome: self.dome.at(n.place),
            other: self.sky.at(n.place),
        }
    }
}

/// Twin of `sky_irradiance` in `lib/frame.wgsl`.
fn sky(h: &[Vec4; 9], n: Vec3) -> Vec4 {
    let linear = h[0] + h[1] * n.y + h[2] * n.z + h[3] * n.x;
    let mixed = h[4] * (n.x * n.y) + h[5] * (n.y * n.z) + h[7] * (n.x * n.z);
    let squares = h[6] * (3.0 * n.z * n.z - 1.0) + h[8] * (n.x * n.x - n.y * n.y);
    (linear + mixed + squares).max(Vec4::ZERO)
}

/// Light of compact sources on a texel.
#[derive(Clone, Copy, Default)]
pub(super) struct Compact {
    /// Unshadowed.
    pub open: Vec4,
    /// Past phantoms.
    pub real: Vec4,
    /// Past phantoms and virtual objects.
    pub all: Vec4,
}

impl Compact {
    /// Adds a light to the `texels` of a page, with the places (world, metres) of all of the page's
    /// texels; `seen`: the share of it, from 0 to 255, that each texel sees past virtual objects and
    /// past phantoms.
    pub fn add(
        sums: &mut [Self; TEXELS],
        (normals, texels, places): (&[PageNormal], &[ServedTexel], &[Vec3]),
        light: &DomeLight,
        seen: [Option<&[u8; TEXELS]>; 2],
    ) {
        let on = |n: &PageNormal, place: Vec3| {
            (light.irradiance * light.facing(place, n.normal)).extend(0.0)
        };
        let share = |seen: Option<&[u8; TEXELS]>, k: usize| {
            seen.map_or(1.0, |seen| f32::from(seen[k]) * (1.0 / 255.0))
        };
        for texel in texels {
            let k = usize::from(texel.at);
            let open = on(&normals[usize::from(texel.normal)], places[k]);
            let real = open * share(seen[1], k);
            let sum = &mut sums[k];
            sum.open += open;
            sum.real += real;
            sum.all += real * share(seen[0], k);
        }
    }
}

/// What lights a page.
pub(super) struct PageLight<'a> {
    pub open: &'a OpenLight,
    pub normals: &'a [PageNormal],
    /// Of the texels of all planes of the page's layer, the shares of the light on an open surface
    /// that arrive: past all casters, and on the real layer past phantoms.
    pub shares: &'a [Vec4],
    /// Texels along a side of a plane.
    pub side: usize,
    /// Indirect light: on real surfaces the change that virtual objects cause, and the light in the
    /// real scene; on virtual ones all of it.
    pub indirect: &'a [Channels],
    /// Light of the compact sources that planes leave out.
    pub compact: &'a [Compact; TEXELS],
}

impl PageLight<'_> {
    /// Light on the `texels` of a real surface: what virtual objects block, and what arrives, with
    /// the fraction of the unshadowed light that it is.
    pub fn on_real(&self, texels: &[ServedTexel], [first, second]: &mut [Texels; 2]) {
        let open = self.open_by_normal(OpenLight::on_real);
        for texel in texels {
            let (k, open) = (usize::from(texel.at), open[usize::from(texel.normal)]);
            let [all, real] = self.shares_of::<2>(&texel.planes);
            let compact = &self.compact[k];
            let kept = open.dome * (real - all).max(Vec4::ZERO);
            // Minus the indirect light from virtual objects.
            let lost = kept + (compact.real - compact.all) - self.indirect_at(0, k);
            let other = open.other + self.indirect_at(1, k);
            let unshadowed = other + open.dome + compact.open;
            let arriving = other + open.dome * real + compact.real;
            let bounded = arriving.max(lost).max(Vec4::splat(1e-6));
            let share = bounded.y / unshadowed.y.max(1e-6);
            write(first, k, lost.with_w(1.0));
            write(second, k, bounded.with_w(share));
        }
    }

    /// Irradiance on the `texels` of a virtual surface times a weight, and that weight.
    pub fn on_virtual(&self, texels: &[ServedTexel], out: &mut Texels) {
        let open = self.open_by_normal(OpenLight::on_virtual);
        for texel in texels {
            let (k, open) = (usize::from(texel.at), open[usize::from(texel.normal)]);
            let [share] = self.shares_of::<1>(&texel.planes);
            let compact = &self.compact[k];
            let hidden = open.dome * (Vec4::ONE - share) - compact.all;
            let light = (open.other - hidden + self.indirect_at(0, k)).max(Vec4::ZERO);
            // Texels inside other objects are black; the weight keeps them out of interpolation.
            let unshadowed = (open.other + compact.open).truncate().element_sum();
            let share = light.truncate().element_sum() / unshadowed.max(1e-6);
            let weight = (8.0 * share).clamp(0.01, 1.0);
            write(out, k, (light * weight).with_w(weight));
        }
    }

    fn open_by_normal(&self, on: fn(&OpenLight, &PageNormal) -> Open) -> [Open; TEXELS] {
        let mut open = [Open::default(); TEXELS];
        for (open, n) in open.iter_mut().zip(self.normals) {
            *open = on(self.open, n);
        }
        open
    }

    /// Shares of `N` kinds at a texel; what no plane serves is unshadowed.
    #[inline]
    fn shares_of<const N: usize>(&self, planes: &Served) -> [Vec4; N] {
        let mut sums = [Vec4::splat(1.0 - planes[0].weight - planes[1].weight); N];
        for look_up in planes.iter().filter(|l| l.weight > 0.0) {
            let LookUp {
                first,
                part: [x, y],
                weight,
            } = *look_up;
            let first = N * first as usize;
            let top = &self.shares[first..first + 2 * N];
            let bottom = &self.shares[first + N * self.side..][..2 * N];
            let (above, below) = (weight * (1.0 - y), weight * y);
            for (j, sum) in sums.iter_mut().enumerate() {
                *sum += top[j] * (above * (1.0 - x)) + top[N + j] * (above * x);
                *sum += bottom[j] * (below * (1.0 - x)) + bottom[N + j] * (below * x);
            }
        }
        sums
    }

    #[inline]
    fn indirect_at(&self, kind: usize, k: usize) -> Vec4 {
        match self.indirect.get(kind) {
            Some([r, g, b]) => Vec4::new(r[k], g[k], b[k], 0.0),
            None => Vec4::ZERO,
        }
    }
}

/// Maximum of what is kept in half floats.
const MAX: Vec4 = Vec4::splat(60_000.0);

#[inline]
fn write(texels: &mut Texels, k: usize, value: Vec4) {
    texels[4 * k..4 * k + 4].copy_from_slice(&value.min(MAX).to_array());
}
