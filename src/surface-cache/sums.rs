//! Sums the lights on a page's texels (Supan 2006, eq. 3).

use crate::cache::SurfaceLight;
use crate::indirect;
use crate::layout::TEXELS;
use crate::texels::PageTexels;
use glam::{Vec2, Vec3};
use half::f16;
use half::slice::HalfFloatSliceExt;
use penumbra_lighting::place::near_lights;
use penumbra_lighting::{DomeLight, LightKind};
use penumbra_scene::IndirectLight;

/// Texels a side of a table by normal.
const SIDE: usize = 65;

/// Irradiance by normal on an octahedron.
pub struct Table(Vec<Vec3>);

impl Table {
    fn new(irradiance: impl Fn(Vec3) -> Vec3) -> Self {
        let at = |k: usize| 2.0 * k as f32 / (SIDE - 1) as f32 - 1.0;
        let normal = |i: usize| {
            let (x, y) = (at(i % SIDE), at(i / SIDE));
            let mut n = Vec3::new(x, y, 1.0 - x.abs() - y.abs());
            let t = (-n.z).max(0.0);
            n.x -= t.copysign(n.x);
            n.y -= t.copysign(n.y);
            n.normalize()
        };
        Self((0..SIDE * SIDE).map(|i| irradiance(normal(i))).collect())
    }

    /// Writes the irradiance on each texel of a page.
    #[inline(always)]
    fn fill(&self, page: &PageTexels, to: &mut Channels) {
        if let Some(n) = page.plane {
            let value = self.on(n).to_array();
            for (channel, value) in to.iter_mut().zip(value) {
                channel.fill(value);
            }
            return;
        }
        for (k, n) in page.normals.iter().enumerate() {
            for (c, value) in self.on(*n).to_array().into_iter().enumerate() {
                to[c][k] = value;
            }
        }
    }

    #[inline(always)]
    fn on(&self, n: Vec3) -> Vec3 {
        let q = n / (n.x.abs() + n.y.abs() + n.z.abs());
        let fold = |a: f32, b: f32| (1.0 - b.abs()) * if a >= 0.0 { 1.0 } else { -1.0 };
        let flat = if q.z >= 0.0 {
            Vec2::new(q.x, q.y)
        } else {
            Vec2::new(fold(q.x, q.y), fold(q.y, q.x))
        };
        let at = (flat * 0.5 + 0.5) * (SIDE - 1) as f32;
        let low = at.as_uvec2().min(glam::UVec2::splat(SIDE as u32 - 2));
        let f = at - low.as_vec2();
        let first = low.y as usize * SIDE + low.x as usize;
        let top = self.0[first].lerp(self.0[first + 1], f.x);
        let bottom = self.0[first + SIDE].lerp(self.0[first + SIDE + 1], f.x);
        top.lerp(bottom, f.y)
    }
}

/// Unshadowed irradiance by normal.
pub struct Unshadowed {
    /// On real surfaces: of all lights and of the ground.
    open: Table,
    /// On virtual surfaces: of the environment with its compact sources.
    sky: Table,
    /// Of the lights that stand for cells.
    cells: Table,
    /// Near lights, which are in no table: they differ from point to point.
    near: Vec<DomeLight>,
}

impl Unshadowed {
    /// Computes the tables for `light`.
    pub fn new(light: &SurfaceLight<'_>, has_ground: bool) -> Self {
        let lights = light.lights;
        let sum = |n: Vec3, wanted: fn(&DomeLight) -> bool| -> Vec3 {
            let wanted = lights.iter().filter(|l| l.place.is_far() && wanted(l));
            wanted
                .map(|l| l.irradiance * l.direction.dot(n).max(0.0))
                .sum()
        };
        let ground = |n: Vec3| {
            let below = if has_ground { 0.5 * (1.0 - n.z) } else { 0.0 };
            light.ground_radiance * (std::f32::consts::PI * below)
        };
        let mut near = Vec::new();
        near_lights(lights, &mut near);
        let compact: fn(&DomeLight) -> bool = |l| l.kind == LightKind::Compact;
        let cell: fn(&DomeLight) -> bool = |l| l.kind == LightKind::Cell;
        Self {
            open: Table::new(|n| sum(n, |_| true) + ground(n)),
            sky: Table::new(|n| light.irradiance.irradiance(n) + sum(n, compact)),
            cells: Table::new(|n| sum(n, cell)),
            near,
        }
    }
}

/// One light on a page.
pub struct PageLight<'a> {
    /// The light.
    pub light: &'a DomeLight,
    /// Share of it, as a number from 0 to 255, that each texel sees past virtual casters; `None`
    /// where all see it.
    pub past_virtual: Option<&'a [u8; TEXELS]>,
    /// The same past phantoms.
    pub past_phantoms: Option<&'a [u8; TEXELS]>,
}

/// RGB over the texels of a page.
type Channels = [[f32; TEXELS]; 3];

/// Share of the light that may be lost without a difference of half a code in 8 bits.
const INVISIBLE: f32 = 1e-3;

/// Buffers for the sums of a page.
pub struct Sums {
    /// Blocked by virtual casters; on virtual surfaces by any casters.
    first: Channels,
    /// Blocked by phantoms; on virtual surfaces the light of cells that virtual casters block.
    second: Channels,
    /// Unshadowed.
    open: Channels,
    /// The same of cells alone.
    cells: Channels,
    /// Indirect light.
    added: [Channels; 2],
    /// Indirect light on a virtual surface; see [`indirect::fill_on_virtual`].
    on_virtual: [[f32; TEXELS]; 4],
    facing: [f32; TEXELS],
    /// RGBA, interleaved.
    packed: [f32; 4 * TEXELS],
}

/// Two texels in half floats for each texel of a page.
pub struct Packed<'a> {
    /// On real surfaces the light that virtual casters block; on virtual ones the irradiance times
    /// a weight, and that weight in alpha.
    pub first: &'a mut [f16],
    /// On real surfaces the light that arrives in the real scene.
    pub second: &'a mut [f16],
}

impl Sums {
    /// Empty buffers.
    pub const fn new() -> Self {
        let empty = [[0.0; TEXELS]; 3];
        Self {
            first: empty,
            second: empty,
            open: empty,
            cells: empty,
            added: [empty; 2],
            on_virtual: [[0.0; TEXELS]; 4],
            facing: [0.0; TEXELS],
            packed: [0.0; 4 * TEXELS],
        }
    }

    #[inline(always)]
    fn clear(&mut self) {
        self.first = [[0.0; TEXELS]; 3];
        self.second = [[0.0; TEXELS]; 3];
        self.added = [[[0.0; TEXELS]; 3]; 2];
    }

    /// Adds the unshadowed light of near lights.
    #[inline(always)]
    fn add_near(&mut self, page: &PageTexels, unshadowed: &Unshadowed) {
        for light in &unshadowed.near {
            face(&mut self.facing, page, light);
            add(&mut self.open, &self.facing, light.irradiance, |_| 1.0);
        }
    }

    /// Sums the light that virtual casters block on a real surface, and that which arrives; true if
    /// any is blocked.
    #[inline(always)]
    pub fn real<'a>(
        &mut self,
        page: &PageTexels,
        lights: impl Iterator<Item = PageLight<'a>>,
        unshadowed: &Unshadowed,
        indirect: Option<&IndirectLight>,
        packed: &mut Packed<'_>,
    ) -> bool {
        self.clear();
        for l in lights {
            face(&mut self.facing, page, l.light);
            let colour = l.light.irradiance;
            if let Some(seen) = l.past_phantoms {
                let hidden = |k: usize| 255.0 - f32::from(seen[k]);
                add(&mut self.second, &self.facing, colour / 255.0, hidden);
            }
            let squared = colour / (255.0 * 255.0);
            match (l.past_virtual, l.past_phantoms) {
                (Some(seen), Some(real)) => {
                    let hidden = |k: usize| (255.0 - f32::from(seen[k])) * f32::from(real[k]);
                    add(&mut self.first, &self.facing, squared, hidden);
                }
                (Some(seen), None) => {
                    let hidden = |k: usize| 255.0 - f32::from(seen[k]);
                    add(&mut self.first, &self.facing, colour / 255.0, hidden);
                }
                (None, _) => {}
            }
        }
        unshadowed.open.fill(page, &mut self.open);
        self.add_near(page, unshadowed);
        if let Some(light) = indirect {
            let [change, real] = &mut self.added;
            indirect::fill(light, &light.change, page, change);
            indirect::fill(light, &light.real, page, real);
        }
        let mut is_shadowed = false;
        let mut shares = [1.0; TEXELS];
        let (first, second) = (&mut self.first, &mut self.second);
        for c in 0..3 {
            for k in 0..TEXELS {
                let lost = first[c][k] - self.added[0][c][k];
                let arriving = self.open[c][k] - second[c][k] + self.added[1][c][k];
                let arriving = arriving.max(lost).max(1e-6);
                is_shadowed |= lost.abs() > INVISIBLE * arriving;
                first[c][k] = lost;
                second[c][k] = arriving;
            }
        }
        for (k, share) in shares.iter_mut().enumerate() {
            *share = second[1][k] / self.open[1][k].max(1e-6);
        }
        pack(first, None, &mut self.packed, packed.first);
        pack(second, Some(&shares), &mut self.packed, packed.second);
        is_shadowed
    }

    /// Sums the light that remains on a virtual surface of a mean `albedo`.
    #[inline(always)]
    pub fn remaining<'a>(
        &mut self,
        page: &PageTexels,
        lights: impl Iterator<Item = PageLight<'a>>,
        unshadowed: &Unshadowed,
        indirect: Option<&IndirectLight>,
        albedo: Vec3,
        packed: &mut Packed<'_>,
    ) {
        self.clear();
        for l in lights {
            face(&mut self.facing, page, l.light);
            let colour = l.light.irradiance / 255.0;
            match (l.past_virtual, l.past_phantoms) {
                (Some(a), Some(b)) => {
                    let hidden =
                        |k: usize| 255.0 - f32::from(a[k]) * f32::from(b[k]) * (1.0 / 255.0);
                    add(&mut self.first, &self.facing, colour, hidden);
                }
                (Some(seen), None) | (None, Some(seen)) => {
                    let hidden = |k: usize| 255.0 - f32::from(seen[k]);
                    add(&mut self.first, &self.facing, colour, hidden);
                }
                (None, None) => {}
            }
            if let (Some(seen), LightKind::Cell) = (l.past_virtual, l.light.kind) {
                let hidden = |k: usize| 255.0 - f32::from(seen[k]);
                add(&mut self.second, &self.facing, colour, hidden);
            }
        }
        unshadowed.sky.fill(page, &mut self.open);
        self.add_near(page, unshadowed);
        unshadowed.cells.fill(page, &mut self.cells);
        match indirect {
            Some(light) => indirect::fill_on_virtual(light, page, &mut self.on_virtual),
            None => self.on_virtual = [[0.0; TEXELS]; 4],
        }
        let mut weights = [0.0; TEXELS];
        for (k, weight) in weights.iter_mut().enumerate() {
            let (cells, sky) = (at(&self.cells, k), at(&self.open, k));
            let hidden = at(&self.second, k) / cells.max(Vec3::splat(1e-6));
            let open = (1.0 - hidden).clamp(Vec3::ZERO, Vec3::ONE);
            let [r, g, b, known] = self.on_virtual.each_ref().map(|channel| channel[k]);
            let guessed = cells * (with_bounces(open, albedo) - open) * (1.0 - known);
            let light = sky - at(&self.first, k) + guessed + Vec3::new(r, g, b);
            let light = light.max(Vec3::ZERO);
            // Texels inside other objects are black; the weight keeps them out of interpolation
            // with their neighbours.
            let share = light.element_sum() / sky.element_sum().max(1e-6);
            *weight = (8.0 * share).clamp(0.01, 1.0);
            for (c, light) in (light * *weight).to_array().into_iter().enumerate() {
                self.first[c][k] = light;
            }
        }
        pack(&self.first, Some(&weights), &mut self.packed, packed.first);
    }
}

/// The cosine to a light on every texel, 0 behind; of a near one also its fall-off.
#[inline(always)]
fn face(facing: &mut [f32; TEXELS], page: &PageTexels, light: &DomeLight) {
    if !light.place.is_far() {
        let each = page.positions.iter().zip(&page.normals);
        for (facing, (p, n)) in facing.iter_mut().zip(each) {
            *facing = light.facing(*p, *n);
        }
        return;
    }
    let direction = light.direction;
    if let Some(n) = page.plane {
        facing.fill(n.dot(direction).max(0.0));
        return;
    }
    for (facing, n) in facing.iter_mut().zip(&page.normals) {
        *facing = n.dot(direction).max(0.0);
    }
}

/// Adds `colour` times the facing and a factor per texel.
#[inline(always)]
fn add(sums: &mut Channels, facing: &[f32; TEXELS], colour: Vec3, factor: impl Fn(usize) -> f32) {
    let [r, g, b] = sums;
    for k in 0..TEXELS {
        let share = facing[k] * factor(k);
        r[k] += colour.x * share;
        g[k] += colour.y * share;
        b[k] += colour.z * share;
    }
}

#[inline(always)]
fn at(sums: &Channels, k: usize) -> Vec3 {
    Vec3::new(sums[0][k], sums[1][k], sums[2][k])
}

/// Converts sums to half floats, with 1 or `alpha` as their fourth channel.
#[inline(always)]
fn pack(
    sums: &Channels,
    alpha: Option<&[f32; TEXELS]>,
    packed: &mut [f32; 4 * TEXELS],
    half: &mut [f16],
) {
    for (k, texel) in packed.chunks_exact_mut(4).enumerate() {
        let limited = |c: usize| sums[c][k].clamp(-60_000.0, 60_000.0);
        let alpha = alpha.map_or(1.0, |alpha| alpha[k]);
        texel.copy_from_slice(&[limited(0), limited(1), limited(2), alpha]);
    }
    half.convert_from_f32_slice(packed);
}

/// Jimenez et al. 2016, eq. 10: the open share of the sky, corrected for interreflection between
/// surfaces of one colour.
#[inline(always)]
fn with_bounces(open: Vec3, albedo: Vec3) -> Vec3 {
    let a = 2.0404 * albedo - 0.3324;
    let b = -4.7951 * albedo + 0.6417;
    let c = 2.7552 * albedo + 0.6903;
    open.max(((open * a + b) * open + c) * open)
}
